# SPDX-License-Identifier: Apache-2.0
"""`simulate_rig`: run a rig without ROS, and write impacts, events, states or a bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import count
from typing import Any

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.rig_recorder import RigRecorder
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.compare.random_response import ResponseSamples
from impact_damper_ros.compare.record_response import RecordSamples
from impact_damper_ros.control.own_law import LawError, OwnLaw
from impact_damper_ros.measured.random_motion import RandomLines
from impact_damper_ros.measured.record import MeasuredRecord
from impact_damper_ros.motion.event import Event, EventKind, Sample
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.orbits.swept_response import SweptResponse, SweptRun
from impact_damper_ros.outputs import is_stream
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterSpec
from impact_damper_ros.parameters.quoting import setting
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    RigParameters,
)
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS
from impact_damper_ros.report.csv_tables import (
    IMPACT_COLUMNS,
    CsvTable,
    impact_rows,
    open_table,
    row,
)
from impact_damper_ros.report.random_response_figure import response_csv, response_figure
from impact_damper_ros.report.record_figure import record_figure, record_text
from impact_damper_ros.report.swept_response_figure import swept_figure, swept_table, swept_text
from impact_damper_ros.report.table import Table
from impact_damper_ros.rig.observed_run import Observer, TimedChange, run
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.snapshot import LATEST
from impact_damper_ros.rig.stepped_sine import rig_at

from .command_line import (
    ALLOW_MORE,
    EXIT_FAILED,
    CommandError,
    add_most_events_option,
    add_path_option,
    add_quiet_option,
    check_outputs,
    command_parser,
    draw,
    number_in,
    outcome,
    path_of,
    progress_bar,
    say,
    write_output,
)
from .rig_options import (
    GivenRig,
    add_law_option,
    add_params_argument,
    add_set_option,
    announce,
    given_law,
    given_rig,
    rig_line,
    setting_value,
    timed_changes,
)
from .run_summary import RunSummary, cycle_at
from .shaker_options import (
    add_levels_option,
    add_random_options,
    add_record_options,
    shaker_files,
    with_random_lines,
    with_records,
    with_sweep_levels,
)

#: The force on M is that of the harmonics and of a controller.
STATE_COLUMNS = (*Sample._fields, 'force', 'primary_acceleration')
EVENT_COLUMNS = ('kind', *Event._fields[:1], *Event._fields[2:-1], 'force_frequency')

# Cycles, and samples of a bag, from which on compiled code saves more than its loading takes
_COMPILED_FROM, _SAMPLES_FROM = 500, 3_000
# Ten days at 1 kHz, about 200 GB
_MOST_SAMPLES = 1e9
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
or a file cannot be written; 2 if an argument is invalid; 130 on Ctrl-C, 143 on SIGTERM. A table
grows in FILE.part, and replaces FILE when the run is complete; a run that ends early leaves
FILE.part, and an older FILE unchanged.
Example: simulate_rig bench_rig --duration 60 --impacts impacts.csv --set gap=0.03
"""


#: See `needs`.
NEEDS = (
    ('--parameters', 'only'),
    ('--urdf', 'only PARAMS --set --node'),
    ('--rate', '--states', '--bag'),
    *(('--max-bag-size', '--bag'), ('--max-bag-duration', '--bag')),
    *((option, '--base-psd', '--force-psd') for option in ('--seed', '--psd-lines')),
)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('simulate_rig', _DESCRIPTION, _EPILOG, NEEDS)
    add_params_argument(parser).nargs = '?'
    parser.add_argument(
        '--parameters', action='store_true', help='list all parameters of a rig and exit'
    )
    parser.add_argument(
        '--urdf', action='store_true', help='print the robot description of the rig and exit'
    )
    parser.add_argument(
        '--duration',
        type=number_in(_SHORTEST, LATEST, 's'),
        metavar='T',
        help='time to simulate [s]; if a record is given, as long as that lasts',
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
    parser.add_argument(
        '--bag',
        dest='recording',
        type=path_of,
        metavar='DIR',
        help='write the MCAP bag that sim_node would record; DIR must not exist',
    )
    parser.add_argument(
        '--max-bag-size',
        type=setting_value('max_bag_size'),
        default=0,
        metavar='BYTES',
        help='continue the bag in a new file after this many bytes [0: a single file]',
    )
    parser.add_argument(
        '--max-bag-duration',
        type=setting_value('max_bag_duration'),
        default=0.0,
        metavar='T',
        help='continue the bag in a new file after this time [s] [0: a single file]',
    )
    parser.add_argument(
        '--rate',
        type=number_in(_SLOWEST, _FASTEST, 'Hz'),
        default=200.0,
        metavar='HZ',
        help='rate of --states and of the joint states in --bag [200]',
    )
    add_set_option(parser)
    add_random_options(parser)
    add_record_options(parser)
    add_path_option(
        parser,
        '--transmissibility',
        'with a base of many lines: write its level, that of M, and the transmissibility at each '
        'of them, with and without damper, as CSV (- : stdout)',
    )
    add_levels_option(parser)
    add_path_option(
        parser,
        '--response',
        'of a sweep: write the response at each of its frequencies, on the ways up and down, with '
        'and without damper, as CSV (- : stdout)',
    )
    add_path_option(
        parser,
        '--figure',
        'draw the response over frequency, to a random base or a sweep; else the motion over '
        'time, and the records; .png, .svg or .pdf',
    )
    add_path_option(
        parser, '--rig-out', 'write the rig, with its lines, as a parameters file (- : stdout)'
    )
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


def _parameter_tables() -> str:
    groups = (PARAMETER_SPECS, INITIAL_SPECS), (STRUCTURE_SPECS,), (GAP_CONTROL_SPECS,)
    return '\n'.join(parameter_markdown(*group) for group in groups)


def parameter_markdown(*groups: Mapping[str, ParameterSpec]) -> str:
    """Return name, unit, range, default and meaning of every parameter, in Markdown."""
    rows = [
        (
            *(f'`{spec.name}`', spec.unit, spec.span, spec.usual_span),
            *(setting(spec.default), spec.description),
        )
        for group in groups
        for spec in group.values()
    ]
    head = ('parameter', 'unit', 'range', 'usual', 'default', 'meaning')
    return Table.of_rows(head, rows).markdown() + '\n'


class _Progress(Observer):
    """The progress bar of a run."""

    def __init__(self, rig: Rig, bar: Any) -> None:
        self._rig, self._bar, self._events = rig, bar, 0

    def take_events(self, events: Sequence[Event]) -> None:
        self._events += len(events)
        self._bar.set_postfix_str(f'{self._events} events', refresh=False)
        self._bar.update(self._rig.time - self._bar.n)


class _ImpactTable(Observer):
    """The impacts as CSV."""

    def __init__(self, table: CsvTable) -> None:
        self._table = table

    def take_events(self, events: Sequence[Event]) -> None:
        self._table.write(impact_rows(events))


class _EventTable(Observer):
    """All events as CSV, each with the frequency after it."""

    def __init__(self, rig: Rig, table: CsvTable) -> None:
        self._rig, self._table = rig, table
        # The frequency before the next events
        self._sweep = rig.sweep

    def take_change(
        self, time_ns: int, values: Mapping[str, Any], events: Sequence[Event]
    ) -> None:
        self._sweep = self._rig.sweep
        super().take_change(time_ns, values, events)

    def take_events(self, events: Sequence[Event]) -> None:
        parameters = self._rig.parameters
        for event in events:
            if event.kind is EventKind.FREQUENCY_STEP:
                self._sweep = self._sweep.following(parameters)
            frequency = rig_at(parameters, self._sweep.step).first_harmonic[1]
            self._table.write(row((event.kind.name.lower(), event.time, *event[2:-1], frequency)))


class _StateTable(Observer):
    """Samples of the motion as CSV."""

    def __init__(self, rig: Rig, table: CsvTable, rate: float) -> None:
        self._rig, self._table, self._rate = rig, table, rate
        self._written = 0

    def ticks(self) -> Iterator[float]:
        return (k / self._rate for k in count())

    def look_at(self, instant: float) -> None:
        if instant == self._written / self._rate:
            self._table.write(row((*self._rig.sample(), *self._rig.drive())))
            self._written += 1


def _outputs(
    arguments: argparse.Namespace, given: GivenRig, rig: Rig, stack: ExitStack
) -> Iterator[Observer]:
    """Open the requested tables and the bag."""
    if (table := open_table(arguments.impacts, IMPACT_COLUMNS, stack)) is not None:
        yield _ImpactTable(table)
    if (table := open_table(arguments.events, EVENT_COLUMNS, stack)) is not None:
        yield _EventTable(rig, table)
    if (table := open_table(arguments.states, STATE_COLUMNS, stack)) is not None:
        yield _StateTable(rig, table, arguments.rate)
    if arguments.recording is not None:
        recorder = RigRecorder(
            arguments.recording,
            rig,
            given.as_dict(),
            arguments.rate,
            arguments.duration,
            max_size=arguments.max_bag_size,
            max_duration=arguments.max_bag_duration,
        )
        stack.callback(recorder.close)
        yield recorder


def _simulate(
    arguments: argparse.Namespace,
    given: GivenRig,
    law: OwnLaw | None,
    changes: Sequence[TimedChange],
    records: Sequence[MeasuredRecord],
) -> None:
    """Simulate, write the files and print the summary, also of a run that ended early."""
    duration = arguments.duration
    rig = _rig(given, law, records)
    swept = _swept_run(arguments, rig, records)
    if arguments.transmissibility is not None and (records or swept is not None):
        raise CommandError(
            '--transmissibility needs a base of many lines, without records or a sweep: leave it '
            'out, or them'
        )
    response = None if records or swept is not None else _response(arguments, rig)
    summary = RunSummary(rig, duration, response)
    drawn = arguments.figure is not None and response is None and swept is None
    sampled = RecordSamples(rig, duration) if records or drawn else None

    # A call of compiled code at each of many stops takes longer than plain code.
    stops = arguments.states, swept, arguments.max_bag_size, arguments.max_bag_duration
    if law is None and not any(stops):
        samples = arguments.rate * duration if arguments.recording else 0.0
        long = duration / cycle_at(rig.parameters) / _COMPILED_FROM + samples / _SAMPLES_FROM > 1.0
        rig.compiled = long and has_numba()

    def report(*, whole: bool) -> None:
        if not arguments.quiet:
            print(summary.text(whole=whole), file=sys.stderr)

    try:
        with ExitStack() as stack:
            outputs = list(_outputs(arguments, given, rig, stack))
            bar = stack.enter_context(
                progress_bar('simulated', duration, 's', quiet=arguments.quiet)
            )
            observers = [summary, *outputs, _Progress(rig, bar)]
            observers += filter(None, [response, sampled, swept])
            run(rig, duration, observers, changes, arguments.most_events)
    except RunawayError as error:
        report(whole=False)
        raise CommandError(
            f'{error}{ALLOW_MORE}; {_place_of_output(arguments)}', EXIT_FAILED
        ) from error
    except LawError as error:
        raise CommandError(f'{error}; {_place_of_output(arguments)}') from error
    report(whole=True)
    if sampled is not None:
        shaken = sampled.response()
        if records and not arguments.quiet:
            print(record_text(shaken, records), file=sys.stderr)
        draw(arguments.figure, record_figure, shaken, records, rig_line(rig.parameters))
    if swept is not None:
        _write_sweep(arguments, rig.parameters, swept.response())
    if response is not None:
        found = response.response()
        write_output(arguments.transmissibility, response_csv, found)
        draw(arguments.figure, response_figure, found, rig_line(rig.parameters))


def _rig(given: GivenRig, law: OwnLaw | None, records: Sequence[MeasuredRecord]) -> Rig:
    return Rig(given.parameters, given.initial, control=given.control, law=law, records=records)


def _swept_run(
    arguments: argparse.Namespace, rig: Rig, records: Sequence[MeasuredRecord]
) -> SweptRun | None:
    """Return the observer of the response to a sweep; None without the option."""
    if arguments.response is not None and rig.parameters.sweep_mode == 'off':
        raise CommandError('--response needs a sweep: give --set sweep_mode=up, too')
    if rig.parameters.sweep_mode == 'off' or not (arguments.response or arguments.figure):
        return None
    if not records and not arguments.change:
        return SweptRun(rig)
    if arguments.response is None:
        return None
    raise CommandError(
        '--response needs one rig in one sweep: leave it out, or --change and the records'
    )


def _write_sweep(arguments: argparse.Namespace, rig: RigParameters, found: SweptResponse) -> None:
    """Print the response to a sweep, and write table and figure."""
    if not arguments.quiet:
        print(swept_text(rig, found), file=sys.stderr)
    write_output(arguments.response, swept_table, rig, found)
    draw(arguments.figure, swept_figure, rig, found, rig_line(rig))


def _response(arguments: argparse.Namespace, rig: Rig) -> ResponseSamples | None:
    """Return the observer of the response to a base of many lines; None for another rig."""
    wanted = arguments.transmissibility is not None
    if sum(map(bool, rig.parameters.base_motion.amplitudes)) < 2:
        if wanted:
            raise CommandError(
                '--transmissibility needs a base of many lines: give --base-psd, or leave it out'
            )
        return None
    try:
        return ResponseSamples(rig, arguments.duration)
    except ValueError:
        if wanted:
            raise
        return None


def _check_size(arguments: argparse.Namespace) -> None:
    """Raise ValueError if the samples are too many for a file."""
    samples = arguments.rate * arguments.duration
    if (arguments.states or arguments.recording) and samples > _MOST_SAMPLES:
        raise ValueError(
            f'--rate {arguments.rate:g} Hz over {arguments.duration:g} s: {samples:.3g} samples: '
            f'give a rate of at most {_MOST_SAMPLES / arguments.duration:.3g} Hz'
        )


def _place_of_output(arguments: argparse.Namespace) -> str:
    """Return the places of the output of a run that ends early."""
    tables = [arguments.impacts, arguments.events, arguments.states]
    files = [path for path in tables if path is not None and str(path) != '-']
    places = [str(path) if is_stream(path) else f'{path}.part' for path in files]
    if arguments.recording is not None:
        places.append(str(arguments.recording))
    return f'the output so far is in {" and ".join(places)}' if places else 'nothing is written'


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = _parser()
    arguments = parser.parse_args(argv)

    def work() -> int:
        if arguments.parameters:
            print(_parameter_tables(), end='')
            return 0
        if arguments.params is None:
            parser.error('the following arguments are required: PARAMS')
        given = given_rig(arguments.params, arguments.set, arguments.node, with_records=True)
        if arguments.urdf:
            print(robot_description(given.parameters, given.control.widest_gap))
            return 0
        given, random = with_random_lines(arguments, given)
        given, records = with_records(arguments, given)
        if arguments.duration is None:
            parser.error('the following arguments are required: --duration')
        given = with_sweep_levels(arguments, given)
        law, given = given_law(arguments.law, given)
        check_outputs(arguments, arguments.params, *shaker_files(arguments, given))
        _check_size(arguments)
        changes = timed_changes(arguments.change, given, arguments.duration)
        if not arguments.quiet:
            announce(
                *('simulate_rig', given.parameters, given.control),
                law='' if law is None else law.name,
            )
            shakers: list[RandomLines | MeasuredRecord] = [*random, *records]
            for shaker in shakers:
                say('simulate_rig', shaker.description())
            beside = records or arguments.base_psd is not None
            if beside and arguments.force_psd is None and any(given.parameters.force_amplitudes):
                say(
                    'simulate_rig',
                    'note: the force of the rig acts, too: --set force_amplitudes=0 switches it '
                    'off',
                )
        write_output(arguments.rig_out, given.yaml)
        try:
            _simulate(arguments, given, law, changes, records)
        except RecordingError as error:
            raise CommandError(str(error), EXIT_FAILED) from error
        return 0

    return outcome('simulate_rig', work, f'interrupted; {_place_of_output(arguments)}')


if __name__ == '__main__':
    sys.exit(main())
