"""
Rigs that are admissible and absurd, on a live node: times to answer and to end, and the bag.

Each rig is set on a node that records the bench rig. Printed are the times to answer the change,
a reset and another change while the rig is at it, what /diagnostics says, the time from SIGINT to
the end of the process, and what the tools say of the bag.

    python benchmarks/absurd_rigs.py [NAME ...] [--json FILE]

Asked for are 0.5 s for an answer, and 2 s for the end.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from node_process import DEADLINE_S, Listener, node_command, running, say
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from impact_damper_ros.bag import RunReader

#: How long each rig is left at it before it is asked.
AT_IT_S = 2.0
ANSWER_S, END_S = 0.5, 2.0
RATE = 1000
TOOL_S = 120.0
TOOLS = ('replay_run', 'compare_run', 'recover_run')

STEEP = {'angle': 0.7854}
ELASTIC = {'restitution_1': 1.0, 'restitution_2': 1.0}
RIGS: dict[str, dict[str, Any]] = {
    'the bench rig': {},
    'stiffness 1e15': {'stiffness': 1e15},
    'and M 1e-6': {'stiffness': 1e15, 'primary_mass': 1e-6, 'damping': 0.0},
    'force 1e6 rad/s': {'force_frequencies': [1e6]},
    'gap 1e-9, g 1e4': {'gap': 1e-9, 'gravity': 1e4, 'friction': 0.0, **ELASTIC, **STEEP},
    'R = 1 at 45 deg': {**ELASTIC, **STEEP, 'friction': 0.0},
    '1e9 N of air': {**ELASTIC, 'air_force': 1e9},
    '512 lines, 2 kHz': {
        'multisine_level': 1.0,
        'multisine_low': 12000.0,
        'multisine_high': 12566.0,
        'multisine_lines': 512,
    },
    'balanced': {'angle': 0.7853981633974483, 'friction': 1.0, 'force_amplitudes': [0.0]},
    'timed, k 1e12': {'gap_control': 'timed', 'stiffness': 1e12},
    'runaway': {
        'gap': 1e-9,
        'gravity': 0.0,
        'friction': 0.0,
        'initial_damper_velocity': 1e9,
        **ELASTIC,
    },
}


class Client:
    """Asks one node, and keeps its reports."""

    def __init__(self, listener: Listener) -> None:
        """Make the clients."""
        self._listener = listener
        node = listener.node
        self._set = node.create_client(
            SetParametersAtomically, '/sim_node/set_parameters_atomically'
        )
        self._reset = node.create_client(Trigger, '/sim_node/reset')
        self.reports: list[DiagnosticArray] = []
        node.create_subscription(DiagnosticArray, '/diagnostics', self.reports.append, 10)

    def wait_for_node(self) -> None:
        """Wait until the services are there."""
        for client in (self._set, self._reset):
            if not client.wait_for_service(DEADLINE_S):
                raise SystemExit(f'{client.srv_name} is not there')
        # That a service is there does not mean that it knows where to send its answer.
        self.listen(1.0)

    def listen(self, seconds: float) -> None:
        """Let messages come in for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._listener.executor.spin_once(timeout_sec=left)

    def _ask(self, client: Any, request: Any) -> tuple[float, Any]:
        began = time.monotonic()
        future = client.call_async(request)
        while not future.done() and time.monotonic() < began + DEADLINE_S:
            self._listener.executor.spin_once(timeout_sec=0.05)
        return time.monotonic() - began, future.result() if future.done() else None

    def set(self, **values: Any) -> float:
        """Return after how long parameters are set."""
        request = SetParametersAtomically.Request(
            parameters=[Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        )
        seconds, response = self._ask(self._set, request)
        if response is not None and not response.result.successful:
            raise SystemExit(f'{values} is refused: {response.result.reason}')
        return seconds

    def reset(self) -> float:
        """Return after how long the rig is reset."""
        seconds, response = self._ask(self._reset, Trigger.Request())
        return seconds if response is not None and response.success else float('inf')

    def said(self) -> str:
        """Return what the last reports say of pacing and rig."""
        messages = [
            str(status.message)
            for array in self.reports
            for status in array.status
            if status.name.endswith((': pacing', ': rig')) and status.level != b'\0'
        ]
        # The one with the cause is the longest.
        return max(messages, key=len, default='all is well')


def bag_states(directory: Path) -> dict[str, Any]:
    """Return what the tools say of the one bag in a directory."""
    (bag,) = (directory / 'runs').iterdir()
    reader = RunReader(bag)
    found: dict[str, Any] = {
        'complete': reader.complete and reader.unusable == 0,
        'messages': reader.message_count,
    }
    for tool in TOOLS:
        command = [sys.executable, '-m', f'impact_damper_ros.cli.{tool}', str(bag)]
        if tool == 'recover_run':
            command += ['--output', str(directory / 'recovered')]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=TOOL_S, check=False
            )
        except subprocess.TimeoutExpired:
            # It may well take as long to say what theory has for such a rig.
            found[tool] = f'not within {TOOL_S:g} s'
            continue
        found[tool] = done.returncode
        found['complete'] &= 'Traceback' not in done.stderr
    return found


def measure(listener: Listener, name: str) -> dict[str, Any]:
    """Return what one rig does to a node of its own."""
    listener.until_alone()
    with tempfile.TemporaryDirectory() as temporary:
        command = node_command(RATE, record=True, bag_directory=f'{temporary}/runs')
        began_ns = time.time_ns()
        with running(command) as process:
            listener.first(process, began_ns)
            client = Client(listener)
            client.wait_for_node()
            found: dict[str, Any] = {'change': client.set(**RIGS[name]) if RIGS[name] else 0.0}
            if 'initial_damper_velocity' in RIGS[name]:
                client.reset()
            client.listen(AT_IT_S)
            client.reports.clear()
            client.listen(1.5)
            found['said'] = client.said()
            found['reset'] = client.reset()
            client.listen(AT_IT_S)
            found['set'] = client.set(damper_mass=0.11)
            client.listen(AT_IT_S)
            began = time.monotonic()
            process.send_signal(signal.SIGINT)
            try:
                found['code'] = process.wait(DEADLINE_S)
            except subprocess.TimeoutExpired:
                found['code'] = None
            found['end'] = time.monotonic() - began
        return {**found, **bag_states(Path(temporary))}


def main() -> int:
    """Measure, and print a table; 1 if a limit is exceeded or a bag not whole."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n\n')[0])
    parser.add_argument('names', nargs='*', metavar='NAME', help='only these rigs')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the numbers')
    arguments = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    rclpy.init()
    listener = Listener()
    results = {}
    print(f'{"rig":18} change  reset    set    end  bag      replay  what is said')
    for name in arguments.names or RIGS:
        say(f'{name} ...')
        found = results[name] = measure(listener, name)
        times = '  '.join(f'{found[key]:5.3f}' for key in ('change', 'reset', 'set', 'end'))
        # What compare_run makes of such a motion is another matter.
        whole = found['complete'] and found['recover_run'] == 0
        replay = 'same' if found['replay_run'] == 0 else str(found['replay_run'])
        found['good'] = (
            max(found['reset'], found['set']) <= ANSWER_S
            and found['end'] <= END_S
            and found['code'] == 0
            and whole
            and found['replay_run'] == 0
        )
        print(
            f'{name:18} {times}  {"whole" if whole else "NOT"}    {replay:7} {found["said"]}',
            flush=True,
        )
    rclpy.shutdown()
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1))
    return 0 if all(found['good'] for found in results.values()) else 1


if __name__ == '__main__':
    sys.exit(main())
