# SPDX-License-Identifier: Apache-2.0
"""`fit_rig`: a rig fitted to measured data."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from impact_damper_ros.outputs import check_directory
from impact_damper_ros.parameters.parameters_file import presets, rig_yaml
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .command_line import (
    EXIT_FAILED,
    CommandError,
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    draw,
    long_work,
    motion_size,
    need_matplotlib,
    number_in,
    outcome,
    path_of,
    say,
    text_stream,
    write_json,
    write_output,
)
from .rig_options import add_set_option, given_rig, hint, rig_line

if TYPE_CHECKING:
    from impact_damper_ros.fit.estimate import Estimate
    from impact_damper_ros.fit.measured_motion import MeasuredMotion, ReadingOptions
    from impact_damper_ros.fit.structure import StructureFit

#: Further parameters that may be fitted, see `fit.rig_fit.FURTHER`.
_FURTHER = (
    *('restitution_2', 'restitution_speed', 'bias', 'force_delay'),
    *('damper_mass', 'primary_mass'),
)
#: Constants whose uncertainty may be given, see `fit.unknowns.CONSTANTS`.
_UNCERTAIN = ('damper_mass', 'primary_mass', 'force_amplitudes', 'base_amplitudes')
#: Largest uncertainty of a constant, %; a larger one would mean a guess.
_MOST_UNCERTAIN = 30.0

_DESCRIPTION = """\
Fit a rig to the measured motion of M: stiffness, damping, restitution, friction and gap, each with
its 95 % interval. FILE is a CSV file whose header has units (t [s], x [mm], accel [g],
force [N], impact), the export of a phone, .uff, .lvm, or a bag. With --structure frequency and
damping come from a ring-down or a sweep without the damper.
"""
_EPILOG = """\
Masses, force and angle are those of --rig, whose stiffness and damping are guesses (within 5 and
60 %); its gap, restitution and friction do not count. Record a start from rest.
Exit code: 0 if the model describes the data; 1 if it does not (or a file cannot be written); 2 if
the input is invalid; 130 on Ctrl-C, 143 on SIGTERM.
Examples:
  fit_rig free.csv --structure --rig rig.yaml --rig-out start.yaml
  fit_rig run.csv --impacts hits.csv --rig start.yaml --rig-out fitted.yaml --report report
  fit_rig runs/run_20250131_120000 --rig bench_rig
"""


#: See `needs`.
NEEDS = (
    *(('--set', '--rig'), ('--node', '--rig')),
    ('--also', 'no --structure'),
    ('--uncertain', 'no --structure'),
    ('--unit', '--column'),
    (
        '--look',
        'only FILE --column --unit --time --base-column --force-column --impacts '
        '--impact-deviation --saturation --topic --joint --from --to',
    ),
)


def _uncertainty(text: str) -> tuple[str, float]:
    """Return a constant and its relative standard deviation."""
    name, _, percent = text.partition('=')
    try:
        value = float(percent.strip().removesuffix('%'))
    except ValueError:
        value = math.nan
    if name not in _UNCERTAIN or not 0.0 <= value <= _MOST_UNCERTAIN:
        raise argparse.ArgumentTypeError(
            f'{text!r}: give one of {", ".join(_UNCERTAIN)}, =, and 0 to {_MOST_UNCERTAIN:g} %, '
            'as in damper_mass=2%'
        )
    return name, value / 100.0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('fit_rig', _DESCRIPTION, _EPILOG, NEEDS)
    parser.add_argument('data', type=path_of, metavar='FILE', help='measured data, or a bag')
    parser.add_argument(
        '--rig',
        type=path_of,
        metavar='PARAMS',
        help='parameters file of the rig with masses and force, or a preset: '
        f'{", ".join(presets())} [of a recording: the rig that it names]',
    )
    parser.add_argument(
        '--node', default='', metavar='NAME', help='which rig, if that file describes several'
    )
    add_set_option(parser)
    parser.add_argument(
        '--structure',
        action='store_true',
        help='fit frequency and damping of the structure alone; with --rig its masses are used',
    )
    parser.add_argument(
        '--also',
        action='append',
        choices=_FURTHER,
        default=[],
        help='what to fit besides: restitution of stop 2, offset of the sensor (always, of an '
        'acceleration), delay of the force, or a mass; may be repeated',
    )
    parser.add_argument(
        '--uncertain',
        action='append',
        type=_uncertainty,
        metavar='NAME=PERCENT',
        default=[],
        help='standard deviation of a constant of the file, such as damper_mass=2%%; may be '
        'repeated [damper_mass=0.5%%, force_amplitudes=1%%, base_amplitudes=1%%, '
        'primary_mass=0%%; one that is not given may be wrong by 10%%]',
    )
    data = parser.add_argument_group('the data')
    add_path_option(
        data, '--impacts', 'times of impacts, or a signal or sound (.wav) with their spikes'
    )
    data.add_argument(
        '--impact-deviation',
        type=number_in(1e-7, 1.0, 's'),
        metavar='TIME',
        help='standard deviation of an impact time [0.5ms of a file, else by the sampling]',
    )
    data.add_argument(
        '--column', default='', metavar='NAME', help='column of the motion of M, or its number'
    )
    data.add_argument(
        '--unit', default='', metavar='UNIT', help='unit of that column, where it has none'
    )
    for option, what in (
        ('--time', 'the time'),
        ('--base-column', 'the motion of the base'),
        ('--force-column', 'the force on M'),
    ):
        data.add_argument(option, default='', metavar='NAME', help=f'column of {what}')
    data.add_argument(
        '--saturation',
        type=motion_size,
        metavar='SIZE',
        help='size from which on the sensor is saturated, such as 16g [detected]',
    )
    for name, text in (('from', 'first'), ('to', 'last')):
        data.add_argument(
            f'--{name}',
            dest=f'{name}_time',
            type=number_in(-1e12, 1e12, 's'),
            metavar='TIME',
            help=f'{text} instant of the data that is used',
        )
    data.add_argument('--topic', default='', metavar='NAME', help='topic of a bag')
    data.add_argument(
        '--joint', default='', metavar='NAME', help='joint of a JointState, axis of an Imu'
    )
    add_path_option(parser, '--look', 'draw the data as they are read, without a fit', 'FIGURE')
    add_json_option(parser)
    add_path_option(parser, '--report', 'write an HTML report, and its numbers beside it', 'DIR')
    add_path_option(parser, '--rig-out', 'write the fitted rig, with its intervals as comments')
    return parser


def _options(arguments: argparse.Namespace) -> ReadingOptions:
    from impact_damper_ros.fit.measured_motion import ReadingOptions

    saturation = arguments.saturation
    return ReadingOptions(
        column=arguments.column,
        unit=arguments.unit,
        time_column=arguments.time,
        base_column=arguments.base_column,
        force_column=arguments.force_column,
        saturation=None if saturation is None else saturation[0],
        impacts=arguments.impact_file,
        impact_deviation=arguments.impact_deviation,
        topic=arguments.topic,
        joint=arguments.joint,
        first=-math.inf if arguments.from_time is None else arguments.from_time,
        last=math.inf if arguments.to_time is None else arguments.to_time,
    )


def _data(arguments: argparse.Namespace) -> tuple[MeasuredMotion, RigParameters | None]:
    from impact_damper_ros.fit.recorded_motion import read_motion_and_rig

    saturation = arguments.saturation
    try:
        data, rig = read_motion_and_rig(arguments.data, _options(arguments))
    except OSError as error:
        name = error.filename or arguments.data
        raise CommandError(
            f'{name}: cannot be read ({error.strerror or error}): give the path of a file'
        ) from error
    if saturation is not None and saturation[1] != data.quantity:
        raise ValueError(
            f'--saturation is an {saturation[1]}, and {data.source} a {data.quantity}: give the '
            'size of the quantity that was measured'
        )
    if data.columns:
        say('fit_rig', data.columns)
    return data, rig


def _start(arguments: argparse.Namespace, recorded: RigParameters | None) -> RigParameters | None:
    """Return the rig that a fit starts from."""
    if arguments.rig is not None:
        given = given_rig(arguments.rig, arguments.set, arguments.node, with_control=False)
        return given.parameters
    return recorded


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    # `impacts` is an output of other commands
    arguments.impact_file = arguments.__dict__.pop('impacts')
    arguments.figure = arguments.look
    command = shlex.join(['fit_rig', *(sys.argv[1:] if argv is None else argv)])

    def work() -> int:
        check_outputs(arguments, arguments.data, arguments.impact_file, arguments.rig)
        if arguments.report is not None:
            need_matplotlib()
            check_directory(arguments.report)
        if arguments.look is not None:
            return _look(arguments)
        run = _structure if arguments.structure else _rig
        return run(arguments, command)

    return outcome('fit_rig', work)


def _look(arguments: argparse.Namespace) -> int:
    """Draw the data as they are read, and print the reason if they cannot be used."""
    from impact_damper_ros.fit.recorded_motion import bag_messages, is_bag, read_motion_and_rig
    from impact_damper_ros.report.look_figure import look_figure, message_columns, raw_columns

    options, problem, data = _options(arguments), None, None
    if is_bag(arguments.data):
        columns = message_columns(bag_messages(arguments.data, options), options)
    else:
        columns = raw_columns(arguments.data, options)
    try:
        data, _ = read_motion_and_rig(arguments.data, options)
    except ValueError as error:
        problem = error
    draw(arguments.look, look_figure, columns, data, data.source if data else str(problem))
    if problem is not None:
        raise problem
    if data is not None and data.columns:
        say('fit_rig', data.columns)
    return 0


def _finish(
    arguments: argparse.Namespace, text: str, accepted: bool, rig_text: Callable[[], str]
) -> int:
    """Print the text, write the rig of a fit that is accepted, and return the exit code."""
    print(text, file=text_stream(arguments.json))
    if not accepted:
        if arguments.rig_out is not None:
            say('fit_rig', f'{arguments.rig_out} is not written: the model does not fit')
        return EXIT_FAILED
    write_output(arguments.rig_out, rig_text)
    return 0


def _rig(arguments: argparse.Namespace, command: str) -> int:
    from impact_damper_ros.fit.rig_fit import fit_rig
    from impact_damper_ros.report import fit_report

    data, recorded = _data(arguments)
    start = _start(arguments, recorded)
    if start is None:
        raise CommandError(
            'masses and force are not known: give the parameters file of the rig with --rig, or '
            '--structure for frequency and damping alone'
        )
    hint('fit_rig', start)
    with long_work('fit_rig', 'still fitting; Ctrl-C ends it'):
        found = fit_rig(data, start, also=arguments.also, uncertain=dict(arguments.uncertain))
    write_json(arguments.json, fit_report.rig_fit_json(found, data))
    if arguments.report is not None:
        page = fit_report.write_rig_report(found, data, start, arguments.report, command)
        print(f'report       {page}', file=text_stream(arguments.json))

    def rig_text() -> str:
        assert found.rig is not None
        title = (
            f'{rig_line(found.rig)}\nfitted to {data.source}: chi squared '
            f'{found.chi_squared:.3g}, fit {found.fit_percent:.4g} %'
        )
        return rig_yaml(found.rig, title, notes=fit_report.fit_notes(found.parameters))

    text = fit_report.rig_fit_text(found, data)
    return _finish(arguments, text, found.accepted, rig_text)


def _structure(arguments: argparse.Namespace, command: str) -> int:
    from impact_damper_ros.fit.structure import fit_structure
    from impact_damper_ros.report import fit_report

    data, recorded = _data(arguments)
    start = _start(arguments, recorded)
    if arguments.rig_out is not None and start is None:
        raise CommandError('--rig-out needs the masses: give a parameters file with --rig')
    with long_work('fit_rig', 'still fitting; Ctrl-C ends it'):
        found = fit_structure(data)
    write_json(arguments.json, found.as_dict())
    if arguments.report is not None:
        page = fit_report.write_structure_report(found, arguments.report, command)
        print(f'report       {page}', file=text_stream(arguments.json))

    def rig_text() -> str:
        assert start is not None
        estimates = _of_rig(found, start.primary_mass)
        rig = start.replace(**{name: one.value for name, one in estimates.items()})
        title = f'{rig_line(rig)}\nstiffness and damping fitted to {data.source}'
        return rig_yaml(rig, title, notes=fit_report.fit_notes(estimates))

    text = '\n'.join([fit_report.structure_text(found), *_beside_file(found, start)])
    return _finish(arguments, text, found.accepted, rig_text)


#: Factors by which a fit may differ from the file without a note; and units in which data and file
#: may differ.
_ALIKE = 1.25
_UNIT_FACTORS = {9.80665: 'g', 1e3: 'thousandths', 2.0 * math.pi: 'rad/s and Hz'}


def _beside_file(found: StructureFit, start: RigParameters | None) -> Iterator[str]:
    """Yield a note on each result that is far from that of the file."""
    if start is None:
        return
    pairs = [('natural frequency', found.frequency, start.omega / math.tau, 'Hz')]
    if found.mass is not None:
        pairs.append(('modal mass', found.mass, start.primary_mass, 'kg'))
    for name, one, there, unit in pairs:
        ratio = one.value / there
        if 1.0 / _ALIKE < ratio < _ALIKE:
            continue
        units = [
            f', the factor between units ({words})'
            for factor, words in _UNIT_FACTORS.items()
            if 1.0 / 1.1 < max(ratio, 1.0 / ratio) / factor < 1.1
        ]
        yield (
            f'note: the {name} is {ratio:.3g} times that of the file, {there:.4g} {unit}'
            f'{"".join(units)}: check the units of the data, and the file'
        )


def _of_rig(found: StructureFit, mass: float) -> dict[str, Estimate]:
    """Return stiffness and damping of a structure, with its mass where that is fitted."""
    from impact_damper_ros.fit.estimate import Estimate

    known, of_mass = {}, 0.0
    if found.mass is not None:
        known['primary_mass'] = found.mass
        mass, of_mass = found.mass.value, found.mass.standard_deviation / found.mass.value
    omega, zeta = math.tau * found.frequency.value, found.damping_ratio.value
    of_omega = found.frequency.standard_deviation / found.frequency.value
    of_zeta = found.damping_ratio.standard_deviation / zeta
    both = of_omega**2 + of_zeta**2 + 2.0 * found.correlation * of_omega * of_zeta
    stiffness, damping = mass * omega**2, 2.0 * mass * zeta * omega
    parts = math.hypot(2.0 * of_omega, of_mass), math.sqrt(both + of_mass**2)
    return known | {
        'stiffness': Estimate.normal(stiffness, parts[0] * stiffness, 'N/m'),
        'damping': Estimate.normal(damping, parts[1] * damping, 'N s/m'),
    }


if __name__ == '__main__':
    sys.exit(main())
