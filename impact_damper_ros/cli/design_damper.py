# SPDX-License-Identifier: Apache-2.0
"""`design_damper`: from a structure to its damper."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from impact_damper_ros.design.bench_plan import PlannedRun, planned_runs
from impact_damper_ros.design.damper_design import Design, best_design
from impact_damper_ros.design.fit_file import load_fitted
from impact_damper_ros.design.mass_damper import Comparison, compare_dampers
from impact_damper_ros.design.runs_from_rest import widest_hit
from impact_damper_ros.design.worst_case import WorstCases, worst_cases
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.parameters.all_parameters import RIG_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterError, ParameterSpec
from impact_damper_ros.parameters.parameters_file import presets, rig_yaml
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import si_value, split_number
from impact_damper_ros.report import design_report as report
from impact_damper_ros.report.formatting import quantity as written
from impact_damper_ros.report.plan_report import plan_text

from .command_line import (
    EXIT_FAILED,
    CommandError,
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    draw,
    long_work,
    outcome,
    text_stream,
    write_json,
    write_output,
)
from .rig_options import given_rig, hint, rig_line

EXIT_NONE = 3
#: Mass ratios that are tried by default.
MASS_RATIOS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1)
_LEVELS = (0.5, 2.0)
#: Restitution by default.
_RESTITUTION = 0.6
#: A range as it is written in a text.
_DASHED = re.compile(r'([\d.]+%?) ?[-–] ?([\d.]+%?)')

_DESCRIPTION = """\
From a structure to its impact damper: its mass, its gap, and their margins. For each mass it finds
the gap with which the structure moves least at the given excitation, whether a rig from rest
reaches that motion, and the ranges of gap, level and frequency; then the gap whose worst case is
best where restitution and level are uncertain, and compares the damper with tuned mass dampers of
the same mass.
With --fitted the structure and its uncertainty are those of a fit.
With --check no damper is designed: it lists which runs of a rig to record on a bench.
"""
_EPILOG = """\
The amplitude is of the absolute displacement X of the structure. Ranges are LOW:HIGH.
Exit code: 0 if done; 3 if no damper was found; 2 if the input is invalid; 1 if a file cannot be
written, or numba is missing; 130 on Ctrl-C, 143 on SIGTERM.
Examples:
  design_damper --mass 5kg --frequency 10Hz --damping-ratio 2% --base 0.2g --figure design.png
  design_damper --mass 5kg --frequency 10Hz --damping-ratio 2% --force 6N --restitution 0.3:0.8 \\
      --mass-ratio 2%:10% --rig-out damper.yaml
  design_damper --check damper.yaml
  design_damper --fitted fit.json --rig-out damper.yaml
"""


def _value(name: str) -> Callable[[str], float]:
    """Return a function that reads the number of a parameter, with its unit."""
    spec: ParameterSpec = RIG_SPECS[name]

    def read(text: str) -> float:
        try:
            value = spec.check(text)
        except ParameterError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        return float(value[0] if isinstance(value, tuple) else value)

    return read


def _range(name: str) -> Callable[[str], tuple[float, float]]:
    """Return a function that reads a number or a range of a parameter."""
    one = _value(name)

    def read(text: str) -> tuple[float, float]:
        if ends_given := _DASHED.fullmatch(text):
            raise argparse.ArgumentTypeError(
                f'{quote(text)}: a range is LOW:HIGH: write {ends_given[1]}:{ends_given[2]}'
            )
        ends = [one(part) for part in text.split(':')]
        if len(ends) > 2 or ends[0] > ends[-1]:
            raise argparse.ArgumentTypeError(
                f'{quote(text)}: give a number, or a range LOW:HIGH with the low end first'
            )
        return ends[0], ends[-1]

    return read


def _size(text: str) -> str:
    """Return the size of a motion with a point for a decimal comma: it is a single number."""
    number, unit, other = split_number(text)
    return text if number is None or other else f'{number!r} {unit}'


def _levels(text: str) -> tuple[float, float]:
    try:
        low, high = (si_value(part, '') for part in text.split(':'))
    except ValueError:
        low = high = math.nan
    if not 0.0 < low <= 1.0 <= high < 1e3:
        raise argparse.ArgumentTypeError(
            f'{quote(text)}: give a range of factors around 1, such as 0.5:2'
        )
    return low, high


#: See `needs`.
NEEDS = (
    ('--check', 'only --json'),
    ('--worst-case', '--rig-out'),
)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('design_damper', _DESCRIPTION, _EPILOG, NEEDS)
    rigs = parser.add_mutually_exclusive_group()
    add_path_option(
        rigs,
        '--check',
        'list which runs of this rig to record, and what each determines; no design: a '
        f'parameters file, as --rig-out writes it, or a preset: {", ".join(presets())}',
        'RIG',
    )
    add_path_option(
        rigs,
        '--fitted',
        'structure, excitation and damper from fit_rig --json; their '
        '95 %% intervals are the uncertainty. Other options override it',
        'FITTED',
    )
    structure = parser.add_argument_group('the structure')
    structure.add_argument(
        '--mass', type=_value('primary_mass'), metavar='KG', help='its modal mass'
    )
    structure.add_argument(
        '--frequency', type=_value('natural_frequency'), metavar='HZ', help='its natural frequency'
    )
    structure.add_argument(
        '--damping-ratio',
        type=_value('damping_ratio'),
        metavar='ZETA',
        help='its damping ratio, such as 2%%',
    )
    shaken = structure.add_mutually_exclusive_group()
    shaken.add_argument(
        '--base',
        type=_size,
        metavar='SIZE',
        help='amplitude of its base: an acceleration, velocity or displacement, such as 0.2g',
    )
    shaken.add_argument(
        '--force', type=_value('force_amplitudes'), metavar='N', help='amplitude of a force on it'
    )
    structure.add_argument(
        '--at',
        type=_value('natural_frequency'),
        metavar='HZ',
        help='frequency of the excitation [the natural frequency]',
    )
    damper = parser.add_argument_group('the damper')
    damper.add_argument(
        '--mass-ratio',
        type=_range('mass_ratio'),
        metavar='MU',
        help='its mass over that of the structure, or a range such as 1%%:10%% [1%%:10%%, or '
        'that of the fitted damper]',
    )
    damper.add_argument(
        '--restitution',
        type=_range('restitution_1'),
        metavar='R',
        help='coefficient of restitution of its stops, or the range in which it may be '
        f'[{_RESTITUTION}]',
    )
    damper.add_argument(
        '--restitution-speed',
        type=_value('restitution_speed'),
        metavar='V',
        help='scale of the fall of restitution with the speed v of an impact, R (1 + v/V)^-p '
        '[R is constant]',
    )
    damper.add_argument(
        '--friction',
        type=_range('friction'),
        metavar='GAMMA',
        help='its coefficient of friction, or the range in which it may be [0]',
    )
    damper.add_argument(
        '--angle', type=_value('angle'), metavar='ANGLE', help='its inclination [0]'
    )
    damper.add_argument(
        '--levels',
        type=_levels,
        metavar='LOW:HIGH',
        help='factors within which the level of the excitation may be [0.5:2]',
    )
    damper.add_argument(
        '--reduction',
        type=_value('damping_ratio'),
        default=0.25,
        metavar='RATIO',
        help='the lightest damper is chosen that leaves at most this part of the amplitude [0.25]',
    )
    add_json_option(parser)
    add_path_option(parser, '--figure', 'draw the choice; .png, .svg or .pdf')
    add_path_option(parser, '--rig-out', 'write the chosen rig as a parameters file')
    parser.add_argument(
        '--worst-case',
        action='store_true',
        help='let --rig-out have the gap whose worst case is best, not the best gap at this level',
    )
    return parser


#: Options of the structure, and the entries of a fit that each replaces.
_STRUCTURE = {
    'mass': ('primary_mass', 'primary_mass'),
    'frequency': ('natural_frequency', 'stiffness'),
    'damping_ratio': ('damping_ratio', 'damping'),
}
_SHAKERS = ('force_', 'base_', 'multisine_', 'sweep_')
_Ranges = dict[str, tuple[float, float]]


def _rig(arguments: argparse.Namespace) -> tuple[RigParameters, _Ranges, Sequence[float]]:
    """Return the structure with a damper, its uncertain parameters, and mass ratios to try."""
    fitted = None if arguments.fitted is None else load_fitted(arguments.fitted)
    values, ranges = (dict(fitted.values), dict(fitted.ranges)) if fitted else ({}, {})
    for option, (name, replaced) in _STRUCTURE.items():
        given = getattr(arguments, option)
        if given is not None:
            values.pop(replaced, None)
            ranges.pop(replaced, None)
            values[name] = given
    known = {name: name in values or replaced in values for name, replaced in _STRUCTURE.values()}
    if not all(known.values()):
        missing = [o for o, (name, _) in _STRUCTURE.items() if not known[name]]
        words = ', '.join(f'--{option.replace("_", "-")}' for option in missing)
        raise ValueError(f'the structure is not known: give {words}, or a fitted rig by --fitted')
    if arguments.restitution is not None or 'restitution_1' not in values:
        low, high = arguments.restitution or (_RESTITUTION, _RESTITUTION)
        for name in ('restitution_1', 'restitution_2'):
            values[name], ranges[name] = 0.5 * (low + high), (low, high)
    if arguments.friction is not None:
        values['friction'] = 0.5 * sum(arguments.friction)
        ranges['friction'] = arguments.friction
    for name in ('angle', 'restitution_speed'):
        if getattr(arguments, name) is not None:
            values[name] = getattr(arguments, name)
    ratios = _mass_ratios(arguments)
    if 'damper_mass' not in values:
        values['mass_ratio'] = ratios[0]
    rig = _shaken(arguments, values)
    if 'damper_mass' in values and arguments.mass_ratio is None:
        ratios = (rig.mass_ratio,)
    if not rig.periodic_force:
        raise ValueError(
            'the excitation is 0, or not one lasting sine: give --base or --force an amplitude'
        )
    if rig.damping == 0.0:
        raise ValueError('--damping-ratio is 0: give what the structure has, such as 0.5%')
    return rig, {name: ends for name, ends in ranges.items() if ends[0] < ends[1]}, ratios


def _shaken(arguments: argparse.Namespace, values: dict[str, Any]) -> RigParameters:
    """Return a rig with the excitation that is given, or that of the fit."""
    plain = RigParameters.of_structure(
        **{name: value for name, value in values.items() if not name.startswith(_SHAKERS)}
    )
    rate = math.tau * arguments.at if arguments.at else plain.omega
    if arguments.base is not None:
        # The unit decides whether it is an acceleration.
        base = {'base_amplitudes': arguments.base, 'base_frequencies': rate}
        return plain.replace(force_amplitudes=0.0, force_frequencies=rate, **base)
    if arguments.force is not None:
        return plain.replace(force_amplitudes=arguments.force, force_frequencies=rate)
    if not any(name.startswith(_SHAKERS) for name in values):
        raise ValueError('the excitation is not known: give --base or --force')
    rig = RigParameters.of_structure(**values)
    return rig.with_first_frequency(rate) if arguments.at else rig


def _mass_ratios(arguments: argparse.Namespace) -> Sequence[float]:
    if arguments.mass_ratio is None:
        return MASS_RATIOS
    low, high = arguments.mass_ratio
    if high > 1.0:
        raise ValueError(
            f'--mass-ratio is {high:g}, a damper heavier than the structure: give at most 1, or '
            f'{high:g}%'
        )
    if low == high:
        return (low,)
    return [float(f'{ratio:.3g}') for ratio in np.geomspace(low, high, len(MASS_RATIOS))]


def _check(arguments: argparse.Namespace) -> int:
    """List the runs of a rig to record on a bench."""
    rig = given_rig(arguments.check, with_control=False).parameters
    hint('design_damper', rig)
    with long_work('design_damper', 'still running the rig; Ctrl-C ends it'):
        plan, widest = planned_runs(rig), widest_hit(rig)
    title = rig_line(rig)
    found = {'gap': rig.gap, 'widest_gap_from_rest': widest, 'plan': plan}
    write_json(arguments.json, as_plain(found))
    gap, reach = written(rig.gap, 'm', 4), written(widest, 'm', 4)
    start = f'From rest m is hit with gaps up to {reach}; that of the rig is {gap}.'
    text = '\n\n'.join([title, start, plan_text(rig, plan)])
    print(text, file=text_stream(arguments.json))
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        check_outputs(arguments, arguments.check, arguments.fitted)
        return _check(arguments) if arguments.check is not None else _design(arguments)

    return outcome('design_damper', work)


def _design(arguments: argparse.Namespace) -> int:
    """Find the damper of a structure."""
    rig, ranges, ratios = _rig(arguments)
    if not has_numba():
        raise CommandError(
            'a design runs thousands of rigs, for which they have to be compiled: pip install '
            '"numba>=0.59"',
            EXIT_FAILED,
        )
    with long_work('design_damper', 'still looking for the best gaps; Ctrl-C ends it'):
        tried = {r: best_design(rig.replace(mass_ratio=r)) for r in ratios}
        found = [design for design in tried.values() if design is not None]
        if not found:
            raise CommandError(
                'no stable motion of two impacts per cycle was found: give another range of '
                '--mass-ratio, a lower --restitution or less --friction',
                EXIT_NONE,
            )
        good = [d for d in found if d.x_max <= arguments.reduction * d.bare]
        chosen = good[0] if good else min(found, key=lambda d: d.x_max)
        low, high = arguments.levels or _LEVELS
        unsure = worst_cases(chosen, ranges, (low, high))
        compared = compare_dampers(chosen.built, low, high)
        plan = planned_runs(chosen.built)
    choice = report.choice_text(tried, arguments.reduction, missed=not good)
    _write(arguments, found, choice, chosen, unsure, compared, plan)
    return 0


def _write(
    arguments: argparse.Namespace,
    found: Sequence[Design],
    choice: str,
    chosen: Design,
    unsure: WorstCases,
    compared: Comparison,
    plan: Sequence[PlannedRun],
) -> None:
    """Write and print the requested outputs."""
    title = rig_line(chosen.built)
    write_json(arguments.json, report.design_json(found, chosen, unsure, compared, plan))
    built = chosen.rig.replace(gap=unsure.best.gap if arguments.worst_case else chosen.gap)
    write_output(arguments.rig_out, rig_yaml, built, rig_line(built))
    draw(arguments.figure, report.design_figure, found, chosen, unsure, compared, title)
    texts = [title, '', report.design_table(found).text(), choice]
    texts += [
        report.design_text(chosen, unsure, compared),
        '',
        plan_text(chosen.built, plan),
    ]
    print('\n'.join(texts), file=text_stream(arguments.json))


if __name__ == '__main__':
    sys.exit(main())
