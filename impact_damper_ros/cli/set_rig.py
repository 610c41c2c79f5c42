# SPDX-License-Identifier: Apache-2.0
"""`set_rig`: set, list and watch a running rig, without the `ros2` command."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import chain
from typing import Any

from impact_damper_ros.bag.messages import (
    DIAGNOSTIC_ARRAY,
    DiagnosticArray,
    DiagnosticStatus,
    decode,
)
from impact_damper_ros.bag.rig_topics import rig_nodes
from impact_damper_ros.parameters.all_parameters import ALL_SPECS, unit_of
from impact_damper_ros.parameters.description import frequency_hint
from impact_damper_ros.parameters.quoting import as_name, printable, setting
from impact_damper_ros.parameters.rig_parameters import (
    PARAMETER_SPECS,
    RigParameters,
    checked_number,
)
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS, resolve_structure
from impact_damper_ros.report.table import Table

from .command_line import EXIT_FAILED, MISSING_ROS, CommandError, command_parser, outcome, say
from .rig_options import values_of

#: Time for the discovery of rigs, time in which a rig must answer, and longest wait for the
#: diagnostics of a rig, s.
DISCOVERY_S, PATIENCE_S, REPORT_S = 1.0, 15.0, 5.0
#: Interval at which an answer is looked for, s.
_LOOK_S = 0.01

_DESCRIPTION = """\
Set parameters of a running rig, all at once, or list all with values, units and ranges; or print
its diagnostics as they come. The same as "ros2 param set", "ros2 param list" and "ros2 topic echo
/diagnostics", without the ros2 command.
"""
_EPILOG = """\
Exit code: 0 on success; 1 if no rig answers; 2 if a name or a value is invalid, or the rig rejects
it: nothing is changed then; 130 on Ctrl-C, 143 on SIGTERM.
Examples: set_rig gap=0.012 record=true
          set_rig --watch --node /rig1/sim_node
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('set_rig', _DESCRIPTION, _EPILOG)
    parser.add_argument(
        'settings',
        nargs='*',
        metavar='NAME=VALUE',
        help='a parameter and its new value, as in gap=0.012, gap="12 mm" or '
        'force_amplitudes=[2.4]; without any, all parameters are listed',
    )
    parser.add_argument(
        '--node', metavar='NAME', help='full name of the node of the rig, if several run'
    )
    parser.add_argument(
        '--watch',
        action='store_true',
        help='print the diagnostics of the rig, once a second, until Ctrl-C',
    )
    return parser


class RigParameterClient:
    """The parameters of a running rig; without a name, of the only rig of the network."""

    def __init__(self, node: Any, name: str | None = None) -> None:
        from rclpy.exceptions import NameValidationException

        from impact_damper_ros.node.rig_client import PARAMETERS, RigClient

        self._node = node
        # Time at which the rig was found; others of its name may be found later.
        self._found_at = math.inf
        self.name = name or self._only_rig()
        try:
            # The graph shows a service that has clients only: this client asks for none by which a
            # rig is recognised.
            self._rig = RigClient(node, self.name, PARAMETERS)
        except NameValidationException as error:
            raise CommandError(
                f'--node {as_name(self.name)}: no node has such a name; give one such as /sim_node'
            ) from error
        end = time.monotonic() + PATIENCE_S
        while not self._rig.ready:
            if time.monotonic() > end:
                raise CommandError(f'{self.name} does not answer: does it run?', EXIT_FAILED)
            time.sleep(_LOOK_S)
        self._found_at = min(self._found_at, time.monotonic())
        self._check_alone()

    def _check_alone(self) -> None:
        """Raise CommandError if another node has the name of the rig."""
        space, _, name = self.name.rpartition('/')
        counts: list[int] = []
        # The rig may have found nodes that this process has not found yet.
        reports = Reports(self._node, self.name)
        end, last = self._found_at + DISCOVERY_S, self._found_at + REPORT_S
        while True:
            counts += [
                int(dict(status.values)['Nodes of this name'])
                for status in chain(*reports.take())
                if status.name.endswith(': network')
            ]
            graph = self._node.get_node_names_and_namespaces().count((name, space or '/'))
            count = max(graph, *counts, 0)
            if count > 1 or time.monotonic() >= (end if counts else last):
                break
            time.sleep(_LOOK_S)
        reports.close()
        if count > 1:
            from impact_damper_ros.node.network import other_namespace

            raise CommandError(
                f'{count} nodes are named {self.name}, and a request reaches any one of them: '
                'stop all but one, or start each in a namespace of its own '
                f'(-r __ns:={other_namespace(space)})'
            )

    def _only_rig(self) -> str:
        """Return the node that offers the services of a rig."""
        start = time.monotonic()
        rigs: list[str] = []
        # Rigs are discovered one after the other.
        while time.monotonic() < start + (DISCOVERY_S if rigs else PATIENCE_S) and len(rigs) < 2:
            services = dict(self._node.get_service_names_and_types())
            rigs = rig_nodes(services)
            if rigs:
                self._found_at = min(self._found_at, time.monotonic())
            time.sleep(0.05)
        if not rigs:
            raise CommandError(
                'no rig runs on this ROS network: start one with sim_node, or rig_page --start',
                EXIT_FAILED,
            )
        if len(rigs) > 1:
            raise CommandError(f'several rigs run, {", ".join(rigs)}: name one with --node')
        return rigs[0]

    def _answer(self, key: str, change: str = '', **fields: Any) -> Any:
        """Return the answer of a service."""
        try:
            return self._rig.call(key, PATIENCE_S, **fields)
        except TimeoutError as error:
            raise CommandError(f'{error}{change}', EXIT_FAILED) from error

    def values(self) -> dict[str, Any]:
        """Return the values of all parameters of the rig by name, in the order of the table."""
        from impact_damper_ros.node.rig_client import plain_values

        there = self._answer('list_parameters').result.names
        names = [name for name in ALL_SPECS if name in there]
        return plain_values(names, self._answer('get_parameters', names=names).values)

    def set(self, values: Mapping[str, Any]) -> str:
        """
        Set parameters, all or none; return the waiting ones, in words.

        Raises CommandError if the rig rejects them.
        """
        from impact_damper_ros.node.rig_client import parameter_messages

        request = parameter_messages(values)
        change = ': the change may or may not have been made; set_rig alone prints the values'
        result = self._answer('set_parameters_atomically', change, parameters=request).result
        if not result.successful:
            raise CommandError(result.reason)
        return str(result.reason)


class Reports:
    """The diagnostics of a rig."""

    def __init__(self, node: Any, name: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray as Message
        from rclpy.qos import QoSProfile

        from impact_damper_ros.node.raw_subscription import RawSubscription

        self._own = f'{name.lstrip("/")}: '
        self._subscription = RawSubscription(node, Message, '/diagnostics', QoSProfile(depth=10))
        self.close = self._subscription.destroy

    def take(self) -> list[list[DiagnosticStatus]]:
        """Return the statuses of each report that has come."""
        arrays = [decode(DIAGNOSTIC_ARRAY, one.content) for one in self._subscription.take(10)]
        found = (
            [status for status in array.status if status.name.startswith(self._own)]
            for array in arrays
            if isinstance(array, DiagnosticArray)
        )
        return [statuses for statuses in found if statuses]


@contextmanager
def ros_node(name: str) -> Iterator[Any]:
    """Join the ROS network as a node without a public name; Python keeps its signal handlers."""
    if find_spec('rclpy') is None:
        raise CommandError(MISSING_ROS)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        # The node is hidden, as those of the command ros2 are.
        yield rclpy.create_node(f'_{name}', start_parameter_services=False)
    finally:
        rclpy.try_shutdown()


def parameter_list(names: Iterable[str], values: Mapping[str, Any]) -> str:
    """Return a table of some parameters of a rig with values, units, ranges and usual ranges."""
    head = ('parameter', 'value', 'unit', 'range', 'usual range')
    rows = [
        (name, setting(values[name]), unit_of(name, values), spec.span, spec.usual_span)
        for name in names
        for spec in (ALL_SPECS[name],)
    ]
    return Table.of_rows(head, rows, len(head)).text()


_LEVELS = 'OK', 'WARN', 'ERROR', 'STALE'


def status_lines(statuses: Sequence[DiagnosticStatus]) -> str:
    """Return some statuses of the diagnostics in a line each."""
    rows = [(s.name, _LEVELS[s.level], s.message) for s in statuses]
    return '\n'.join(
        Table.of_rows(('status', 'level', 'message'), rows, 3).text().splitlines()[1:]
    )


def watch(node: Any, name: str) -> None:
    """Print the diagnostics of a rig as they come, without end."""
    say('set_rig', f'waiting for the first report of {name}; Ctrl-C ends it')
    reports = Reports(node, name)
    while True:
        for statuses in reports.take():
            print(printable(status_lines(statuses)), end='\n\n', flush=True)
        # Python handles signals in between.
        time.sleep(0.1)


def _unit_note(*values: Mapping[str, Any]) -> str:
    """Return whether a change, to the first values, may have given a frequency in Hz, in words."""
    return frequency_hint(
        *(RigParameters(**{name: one[name] for name in PARAMETER_SPECS}) for one in values)
    )


def _set(arguments: argparse.Namespace) -> int:
    with ros_node('set_rig') as node:
        rig = RigParameterClient(node, arguments.node)
        if arguments.watch and not arguments.settings:
            watch(node, rig.name)
        present = rig.values()
        before = present
        given = values_of(arguments.settings, [*present, *STRUCTURE_SPECS], '', 'set_rig')
        given = resolve_structure(
            given, checked_number, present['primary_mass'], present['stiffness']
        )
        if given:
            if waits := rig.set(given):
                say('set_rig', waits)
            present = rig.values()
        print(parameter_list(given or present, present))
        if note := _unit_note(present, before):
            say('set_rig', f'note: {note}')
        if arguments.watch:
            watch(node, rig.name)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('set_rig', lambda: _set(arguments))


if __name__ == '__main__':
    sys.exit(main())
