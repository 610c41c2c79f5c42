"""`simulate_rig`: run a rig without ROS; impacts, events and states as CSV, or all as a bag."""

from __future__ import annotations

import argparse
import heapq
import itertools
import math
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.rig_recorder import RigRecorder
from impact_damper_ros.control import GAP_CONTROL_SPECS, Action, OwnLaw, Rig
from impact_damper_ros.entry_points import run
from impact_damper_ros.report.csv_tables import IMPACT_COLUMNS, impact_rows, open_table, row
from impact_damper_ros.report.formatting import mode_words, setting
from impact_damper_ros.report.table import Table
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    SETTING_SPECS,
    Event,
    EventKind,
    ParameterSpec,
    RigParameters,
    Sample,
)
from impact_damper_ros.rig.event_budget import EndlessEventsError, EventBudget
from impact_damper_ros.rig.forcing import SWEEP_FIELDS, frequency_at
from impact_damper_ros.rig.snapshot import LATEST
from impact_damper_ros.rig.swing import Swing

from .command_line import (
    BUDGET_REMEDY,
    EXIT_FAILED,
    CommandError,
    add_most_events_option,
    add_path_option,
    add_quiet_option,
    command_parser,
    outcome,
    progress_bar,
)
from .rig_options import (
    GivenRig,
    TimedChange,
    add_law_option,
    add_params_argument,
    add_set_option,
    announce,
    given_law,
    given_rig,
    timed_changes,
)

EVENT_COLUMNS = ('kind', *Event._fields[:1], *Event._fields[2:], 'force_frequency')

# The end of a run that its summary describes, and how closely it looks for the largest |X|
_WATCHED_CYCLES = 20
_LOOKS_PER_CYCLE = 256
# Stamps are whole nanoseconds.
_SHORTEST, _SLOWEST, _FASTEST = 1e-9, 1e-12, 1e9

_DESCRIPTION = """\
Run an impact damper exactly, without ROS, from the same parameters file as sim_node. The rig
starts at rest with the loose mass in the middle of the gap, unless the file gives initial_*. All
quantities are in SI units; velocities are absolute, along the axis, positive downwards.
"""
_EPILOG = """\
A chatter (ever smaller impacts that end in finite time) is written impact by impact up to its cut,
and then once as rest: a row with the same velocities before and after.
Exit code: 0 if the whole duration was simulated; 1 if the rig has more events than --most-events,
or a file cannot be written; 2 if an argument is invalid; 130 on Ctrl-C, 143 on SIGTERM. The output
up to a failure or a signal is written.
Example: simulate_rig config/paper.yaml --duration 300 --impacts impacts.csv --set gap=30
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('simulate_rig', _DESCRIPTION, _EPILOG)
    add_params_argument(parser)
    parser.add_argument(
        '--parameters', action=_ListParameters, help='list all parameters of a rig and exit'
    )
    parser.add_argument(
        '--duration',
        type=_number(_SHORTEST, LATEST, 's'),
        required=True,
        metavar='T',
        help='time to simulate [s]',
    )
    add_path_option(parser, '--impacts', 'write the impacts as CSV (- : stdout)')
    add_path_option(
        parser,
        '--events',
        'write all events as CSV: impacts, rest, stick, release, reversals, frequency steps of a '
        'sweep and, under gap control, the motion of the stops; the last column, '
        'force_frequency, is the circular frequency of the first harmonic after the event '
        '[rad/s] (- : stdout)',
    )
    add_path_option(parser, '--states', 'write sampled states as CSV (- : stdout)')
    add_path_option(
        parser, '--bag', 'write the MCAP bag that sim_node would record; DIR must not exist', 'DIR'
    )
    parser.add_argument(
        '--max-bag-size',
        type=_limit('max_bag_size', int),
        default=0,
        metavar='BYTES',
        help='continue the bag in a new file after this many bytes [0: a single file]',
    )
    parser.add_argument(
        '--max-bag-duration',
        type=_limit('max_bag_duration', float),
        default=0.0,
        metavar='T',
        help='continue the bag in a new file after this time [s] [0: a single file]',
    )
    parser.add_argument(
        '--rate',
        type=_number(_SLOWEST, _FASTEST, 'Hz'),
        default=200.0,
        metavar='HZ',
        help='rate of --states and of the joint states in --bag [200]',
    )
    add_set_option(parser)
    add_law_option(parser)
    parser.add_argument(
        '--change',
        action='append',
        default=[],
        metavar='TIME:NAME=VALUE',
        help='change a parameter during the run, for example --change 20:gap=0.03; may be '
        'repeated; changes at the same time take effect together',
    )
    add_most_events_option(parser)
    add_quiet_option(parser, 'summary')
    return parser


class _ListParameters(argparse.Action):
    """Print all parameters of a rig as a Markdown table, and exit."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:  # noqa: A002
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        parser.exit(outcome('simulate_rig', _print_parameters))


def _print_parameters() -> int:
    print(parameter_table(PARAMETER_SPECS, INITIAL_SPECS))
    print(parameter_table(GAP_CONTROL_SPECS), end='', flush=True)
    return 0


def parameter_table(*groups: Mapping[str, ParameterSpec]) -> str:
    """Return name, unit, range, default and meaning of every parameter, in Markdown."""
    rows = [
        (f'`{spec.name}`', spec.unit, spec.span, setting(spec.default), spec.description)
        for group in groups
        for spec in group.values()
    ]
    head = ('parameter', 'unit', 'range', 'default', 'meaning')
    return Table.of_rows(head, rows).markdown() + '\n'


def _number(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return a reader of numbers in a range, for `argparse`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(
                f'{text!r}: give a number from {low:g} to {high:g} {unit}'
            )
        return value

    return read


def _limit(name: str, kind: type[float]) -> Callable[[str], float]:
    """Return a reader of limits to the files of a bag, as of the node, for `argparse`."""
    spec = SETTING_SPECS[name]
    least, most = spec.least, spec.high
    assert most is not None

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = -1.0
        if kind is int:
            # 1e6 is a whole number, too.
            value = int(value) if value.is_integer() else -1
        if value != 0 and not least <= value <= most:
            whole = ' whole' if kind is int else ''
            raise argparse.ArgumentTypeError(
                f'{text!r}: give 0 (no limit) or a{whole} number from {least:g} to {most:g} '
                f'{spec.unit}'
            )
        return value

    return read


def _instants(
    duration: float,
    rate: float | None,
    cycle: float,
    watched_from: float,
    ticks: Iterator[float],
    changes: Iterator[float],
) -> Iterator[float]:
    """
    Yield the instants to advance to, in order; the motion does not depend on them.

    They are the sampling grid, or one per cycle without it; the ticks of the recording; the
    changes of parameters; and closely those at the end, which is watched for its largest |X|.
    """
    grid = rate if rate is not None else 1.0 / cycle
    last = math.floor(duration * grid * (1.0 + 1e-15))
    regular = (k / grid for k in range(1, last + 1))
    close = cycle / _LOOKS_PER_CYCLE
    looks = math.floor((duration - watched_from) / close)
    watched = (watched_from + k * close for k in range(looks + 1))
    for instant in heapq.merge(regular, watched, ticks, changes):
        if instant < duration:
            yield instant
    yield duration


def _cycle(parameters: RigParameters) -> float:
    """Return the period of the first harmonic, or the natural one if that is off or stepped."""
    frequency = parameters.force_frequencies[0]
    if not frequency or not parameters.force_amplitudes[0] or parameters.sweep_mode != 'off':
        frequency = parameters.omega
    return math.tau / frequency


class _Watch:
    """Collects what the summary reports: events, commands, last impacts, largest |X|."""

    def __init__(self) -> None:
        self.counts: Counter[EventKind] = Counter()
        self.swing = Swing()
        self._commands = 0
        self._impacts: dict[int, Event] = {}

    def look(self, rig: Rig, events: Sequence[Event]) -> None:
        """Take what happened in the last advance or change of a rig."""
        self._commands += sum(record.action is Action.COMMAND for record in rig.records)
        self.counts.update(event.kind for event in events)
        self._impacts |= {e.stop: e for e in events if e.kind is EventKind.IMPACT}

    def summary(self, rig: Rig, spent: float, *, whole: bool) -> str:
        """Return the summary of a run, given its computing time, s, and whether it is complete."""
        parameters, largest = rig.parameters, self.swing.largest
        mode = mode_words(rig.mode.name)
        events = [f'{number} {kind.name.lower()}' for kind, number in self.counts.items()]
        lines = [
            f'simulated   {rig.time:g} s in {spent:.2f} s; the loose mass is now in mode "{mode}"',
            f'events      {", ".join(events) or "none"}',
        ]
        if whole:
            lines.append(f'largest |X| {largest:.7g} m in the last {_WATCHED_CYCLES} cycles')
            amplitude = parameters.response_amplitude
            if parameters.periodic_force and math.isfinite(amplitude):
                lines[-1] += (
                    f', {largest / amplitude:.7f} of the {amplitude:.6g} m without impacts'
                )
        if rig.control.active:
            (spent_1, spent_2), (stop_1, stop_2) = rig.energies, rig.stops
            lines.append(
                f'gap control {rig.law}: {self._commands} commands; stop 1 spent '
                f'{spent_1:.6g} J, stop 2 {spent_2:.6g} J; they are at Y = {stop_1:.6g} m and '
                f'{stop_2:.6g} m'
            )
        for stop, event in sorted(self._impacts.items()):
            phase = ''
            if parameters.periodic_force:
                phase = f'phase {event.time / _cycle(parameters) % 1.0:.7f} cycles, '
            lines.append(
                f'last impact on stop {stop}: t = {event.time:.9f} s, {phase}'
                f'X = {event.x:.7f} m; just after it '
                f"X' = {event.primary_velocity_after:.7f} m/s, "
                f"Z' = {event.damper_velocity_after:.7f} m/s"
            )
        return '\n'.join(lines)


class _Tables:
    """The requested CSV files."""

    def __init__(self, arguments: argparse.Namespace, stack: ExitStack) -> None:
        self._impacts = open_table(arguments.impacts, IMPACT_COLUMNS, stack)
        self._events = open_table(arguments.events, EVENT_COLUMNS, stack)
        self._states = open_table(arguments.states, Sample._fields, stack)
        #: Of the states, Hz; None if they are not written.
        self.rate: float | None = None if self._states is None else arguments.rate
        self._states_written = 0
        # Of the present stepped sine
        self._steps = 0

    def write_events(self, rig: Rig, events: Sequence[Event]) -> None:
        """Write the events of the last advance or change of a rig."""
        if self._impacts is not None:
            self._impacts.write(impact_rows(events))
        if self._events is not None:
            for event in events:
                self._steps += event.kind is EventKind.FREQUENCY_STEP
                frequency = frequency_at(rig.parameters, self._steps)
                kind = event.kind.name.lower()
                self._events.write(row((kind, event.time, *event[2:], frequency)))

    def write_state(self, rig: Rig, instant: float) -> None:
        """Write a state that is due."""
        if self._states and self.rate and instant == self._states_written / self.rate:
            self._states.write(row(rig.sample()))
            self._states_written += 1

    def begin_sweep(self) -> None:
        """Count the steps of a stepped sine from here on."""
        self._steps = 0


def _run(
    arguments: argparse.Namespace,
    given: GivenRig,
    changes: Sequence[TimedChange],
    law: OwnLaw | None,
) -> tuple[str, str]:
    """Simulate, write the files; return the summary, and why the run ended early, if it did."""
    parameters, initial, control = given
    rig = Rig(parameters, initial, control=control, law=law)
    watch = _Watch()
    duration = arguments.duration
    cycle = _cycle(parameters)
    watched_from = max(0.0, duration - _WATCHED_CYCLES * cycle)
    started = time.perf_counter()
    failure = ''
    with ExitStack() as stack:
        tables = _Tables(arguments, stack)
        recording = None
        if arguments.bag is not None:
            recording = RigRecorder(
                arguments.bag,
                rig,
                {**parameters.as_dict(), **initial.as_dict(), **control.as_dict()},
                arguments.rate,
                duration,
                max_size=arguments.max_bag_size,
                max_duration=arguments.max_bag_duration,
            )
            stack.callback(recording.close)
        bar = stack.enter_context(progress_bar('simulated', duration, 's', quiet=arguments.quiet))
        ticks = recording.ticks() if recording is not None else iter(())
        changed_at = (change.time_ns / 1e9 for change in changes)
        instants = _instants(duration, tables.rate, cycle, watched_from, ticks, changed_at)
        waiting = deque(changes)
        budget = EventBudget(arguments.most_events, BUDGET_REMEDY)
        for instant in itertools.chain([0.0], instants):
            before = rig.time
            events: list[Event] = []
            try:
                for portion in budget.portions(rig, instant):
                    watch.look(rig, portion)
                    tables.write_events(rig, portion)
                    if recording is not None:
                        recording.happened(portion)
                    events += portion if instant >= watched_from else ()
                    bar.set_postfix_str(f'{watch.counts.total()} events', refresh=False)
                    bar.update(rig.time - before)
                    before = rig.time
            except EndlessEventsError as error:
                failure = str(error)
                break
            if waiting and waiting[0].time_ns / 1e9 == instant:
                change = waiting.popleft()
                new, old = change.parameters, rig.parameters
                if any(getattr(new, name) != getattr(old, name) for name in SWEEP_FIELDS):
                    tables.begin_sweep()
                caused = rig.change(new, change.control)
                watch.look(rig, caused)
                tables.write_events(rig, caused)
                if recording is not None:
                    recording.changed(change.time_ns, change.values, caused)
                events += caused
            if recording is not None:
                recording.reached(instant)
            if instant >= watched_from:
                watch.swing.look(rig.sample(), events)
            tables.write_state(rig, instant)
    spent = time.perf_counter() - started
    return watch.summary(rig, spent, whole=not failure), failure


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse two tables in one file."""
    named = [path for path in (arguments.impacts, arguments.events, arguments.states) if path]
    for place, path in enumerate(named):
        if path.resolve() in [other.resolve() for other in named[:place]]:
            raise ValueError(f'{path}: two tables go to this file; give each one of its own')


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        given = given_rig(arguments.params, arguments.set)
        law, control = given_law(arguments.law, given.control)
        given = given._replace(control=control)
        _check_outputs(arguments)
        changes = timed_changes(arguments.change, given, arguments.duration)
        if not arguments.quiet:
            announce(
                *('simulate_rig', given.parameters, given.control),
                law='' if law is None else law.name,
            )
        try:
            summary, failure = _run(arguments, given, changes, law)
        except RecordingError as error:
            raise CommandError(str(error), EXIT_FAILED) from error
        if not arguments.quiet:
            print(summary, file=sys.stderr)
        if failure:
            raise CommandError(f'{failure}; what was simulated is written', EXIT_FAILED)
        return 0

    return outcome('simulate_rig', work, 'interrupted; what was simulated is written')


if __name__ == '__main__':
    sys.exit(run('simulate_rig', main))
