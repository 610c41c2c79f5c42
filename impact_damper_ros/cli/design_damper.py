# SPDX-License-Identifier: Apache-2.0
"""`design_damper`: from a structure to its damper."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from impact_damper_ros.design.damper_design import (
    Design,
    Uncertain,
    best_design,
    over_frequency,
    over_level,
    uncertain,
)
from impact_damper_ros.design.mass_damper import bare_response, mass_damper_response
from impact_damper_ros.outputs import write_text
from impact_damper_ros.parameters.parameter_spec import ParameterError, ParameterSpec
from impact_damper_ros.parameters.quoting import shown
from impact_damper_ros.parameters.rig_parameters import RIG_SPECS, RigParameters
from impact_damper_ros.report import design_report as report
from impact_damper_ros.report.design_report import Comparison

from .command_line import (
    CommandError,
    add_json_option,
    add_path_option,
    check_outputs,
    command_parser,
    long_work,
    need_matplotlib,
    outcome,
    text_stream,
    write_json,
)
from .rig_options import rig_line

EXIT_NONE = 3
#: Mass ratios that are tried if none are given.
MASS_RATIOS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1)
_FREQUENCIES, _LEVELS = 61, 33

_DESCRIPTION = """\
From a structure to its impact damper: how heavy, which gap, and how sure. For each mass the gap
with which the structure moves least at the given excitation, whether a rig from rest gets there,
and how far gap, level and frequency may go; then the gap whose worst case is best where
restitution and level are uncertain, and the same mass as a tuned mass damper.
"""
_EPILOG = """\
The amplitude is that of the absolute displacement X of the structure. Ranges are LOW:HIGH.
Exit code: 0 if done; 3 if no damper was found; 2 if the input is invalid; 1 if a file cannot be
written; 130 on Ctrl-C, 143 on SIGTERM.
Examples:
  design_damper --mass 5kg --frequency 10Hz --damping-ratio 2% --base 0.2g --figure design.png
  design_damper --mass 5kg --frequency 10Hz --damping-ratio 2% --force 6N --restitution 0.3:0.8 \\
      --mass-ratio 2%:10% --rig-out damper.yaml
"""


def _value(name: str) -> Callable[[str], float]:
    """Return a reader of a number of a parameter, with its unit."""
    spec: ParameterSpec = RIG_SPECS[name]

    def read(text: str) -> float:
        try:
            value = spec.checked(text)
        except ParameterError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        return float(value[0] if isinstance(value, tuple) else value)

    return read


def _range(name: str) -> Callable[[str], tuple[float, float]]:
    """Return a reader of a number or a range of a parameter."""
    one = _value(name)

    def read(text: str) -> tuple[float, float]:
        ends = [one(part) for part in text.split(':')]
        if len(ends) > 2 or ends[0] > ends[-1]:
            raise argparse.ArgumentTypeError(
                f'{shown(text)}: give a number, or a range LOW:HIGH with the low end first'
            )
        return ends[0], ends[-1]

    return read


def _levels(text: str) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in text.split(':'))
    except ValueError:
        low = high = math.nan
    if not 0.0 < low <= 1.0 <= high < 1e3:
        raise argparse.ArgumentTypeError(
            f'{shown(text)}: give a range of factors around 1, such as 0.5:2'
        )
    return low, high


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('design_damper', _DESCRIPTION, _EPILOG)
    structure = parser.add_argument_group('the structure')
    structure.add_argument(
        '--mass', type=_value('primary_mass'), required=True, metavar='KG', help='its modal mass'
    )
    structure.add_argument(
        '--frequency',
        type=_value('natural_frequency'),
        required=True,
        metavar='HZ',
        help='its natural frequency',
    )
    structure.add_argument(
        '--damping-ratio',
        type=_value('damping_ratio'),
        required=True,
        metavar='ZETA',
        help='its damping ratio, such as 2%%',
    )
    shaken = parser.add_mutually_exclusive_group(required=True)
    shaken.add_argument(
        '--base',
        metavar='SIZE',
        help='amplitude of its base: an acceleration, velocity or displacement, such as 0.2g',
    )
    shaken.add_argument(
        '--force', type=_value('force_amplitudes'), metavar='N', help='amplitude of a force on it'
    )
    parser.add_argument(
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
        help='its mass over that of the structure, or a range such as 1%%:10%% [1%%:10%%]',
    )
    damper.add_argument(
        '--restitution',
        type=_range('restitution_1'),
        default=(0.6, 0.6),
        metavar='R',
        help='coefficient of restitution of its stops, or the range in which it may be [0.6]',
    )
    for name, text in (('friction', 'its coefficient of friction'), ('angle', 'its inclination')):
        damper.add_argument(
            f'--{name}', type=_value(name), default=0.0, metavar='X', help=f'{text} [0]'
        )
    damper.add_argument(
        '--levels',
        type=_levels,
        default=(0.5, 2.0),
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
    add_path_option(parser, '--csv', 'write the designs as a table')
    add_json_option(parser)
    add_path_option(parser, '--figure', 'draw the choice; .png, .svg or .pdf')
    add_path_option(parser, '--rig-out', 'write the chosen rig as a parameters file')
    return parser


def _rig(arguments: argparse.Namespace) -> RigParameters:
    """Return the structure with a damper of some mass."""
    frequency = 2.0 * math.pi * (arguments.at or arguments.frequency)
    low, high = arguments.restitution
    shaken = (
        {'force_amplitudes': arguments.force, 'force_frequencies': frequency}
        if arguments.base is None
        else {
            'force_amplitudes': 0.0,
            'base_amplitudes': arguments.base,
            'base_frequencies': frequency,
        }
    )
    rig = RigParameters.of_structure(
        primary_mass=arguments.mass,
        natural_frequency=arguments.frequency,
        damping_ratio=arguments.damping_ratio,
        mass_ratio=0.05,
        restitution_1=0.5 * (low + high),
        restitution_2=0.5 * (low + high),
        friction=arguments.friction,
        angle=arguments.angle,
        **shaken,
    )
    if rig.first_harmonic[0] == 0.0:
        raise ValueError('the excitation is 0: give --base or --force an amplitude')
    if rig.damping == 0.0:
        raise ValueError('--damping-ratio is 0: give what the structure has, such as 0.5%')
    return rig


def _mass_ratios(given: tuple[float, float] | None) -> Sequence[float]:
    if given is None:
        return MASS_RATIOS
    low, high = given
    if low == high:
        return (low,)
    return [float(f'{ratio:.3g}') for ratio in np.geomspace(low, high, len(MASS_RATIOS))]


def _found(rig: RigParameters, ratios: Sequence[float]) -> list[Design]:
    """Return the best damper of each mass ratio, computed by two processes."""
    rigs = [rig.replace(mass_ratio=ratio) for ratio in ratios]
    if len(rigs) == 1:
        found = list(map(best_design, rigs))
    else:
        with ProcessPoolExecutor(2, mp_context=get_context('forkserver')) as pool:
            found = list(pool.map(best_design, rigs))
    return [design for design in found if design is not None]


def _restitutions(low: float, high: float) -> list[float]:
    return [low] if low == high else [low, 0.5 * (low + high), high]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)

    def work() -> int:
        check_outputs(arguments)
        if arguments.figure is not None:
            need_matplotlib()
        rig = _rig(arguments)
        with long_work('design_damper', 'still looking for the best gaps; Ctrl-C ends it'):
            found = _found(rig, _mass_ratios(arguments.mass_ratio))
            if not found:
                raise CommandError(
                    'no stable motion of two impacts per cycle was found: give another range of '
                    '--mass-ratio, a lower --restitution or less --friction',
                    EXIT_NONE,
                )
            good = [d for d in found if d.x_max <= arguments.reduction * d.bare]
            chosen = good[0] if good else min(found, key=lambda d: d.x_max)
            low, high = arguments.levels
            levels = sorted({low, 1.0, high})
            unsure = uncertain(chosen, _restitutions(*arguments.restitution), levels)
            compared = _compared(chosen, low, high)
        _write(arguments, found, chosen, unsure, compared)
        return 0

    return outcome('design_damper', work)


def _compared(chosen: Design, low: float, high: float) -> Comparison:
    """Return the chosen damper beside nothing and a tuned mass damper."""
    rate = chosen.rig.first_harmonic[1]
    rates = rate * np.linspace(0.75, 1.25, _FREQUENCIES)
    levels = np.geomspace(min(low, 0.25), max(high, 4.0), _LEVELS)
    return Comparison(
        rates,
        bare_response(chosen.rig, rates),
        mass_damper_response(chosen.rig, rates),
        over_frequency(chosen.built, rates),
        levels,
        over_level(chosen.built, levels),
    )


def _write(
    arguments: argparse.Namespace,
    found: Sequence[Design],
    chosen: Design,
    unsure: Uncertain,
    compared: Comparison,
) -> None:
    """Write and print all that was asked for."""
    title = rig_line(chosen.built)
    write_json(arguments.json, report.design_json(found, chosen, unsure, compared))
    if arguments.csv is not None:
        write_text(arguments.csv, report.design_csv(found))
    if arguments.rig_out is not None:
        write_text(arguments.rig_out, report.rig_yaml(chosen.built, title))
    if arguments.figure is not None:
        from impact_damper_ros.report.drawing import save_figure

        figure = report.design_figure(found, chosen, unsure, compared, title)
        save_figure(figure, arguments.figure)
    texts = [title, '', report.design_table(found).text(), '']
    texts += [report.design_text(chosen, unsure, compared), '', report.test_plan(chosen)]
    print('\n'.join(texts), file=text_stream(arguments.json))


if __name__ == '__main__':
    sys.exit(main())
