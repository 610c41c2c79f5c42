"""Options of `sweep_rig`, and the plan that they make."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from impact_damper_ros.analysis.settling_rig import Settling
from impact_damper_ros.analysis.sweep_axes import (
    Axis,
    AxisError,
    axis_from_mapping,
    axis_from_text,
)
from impact_damper_ros.analysis.sweep_columns import MEASURES
from impact_damper_ros.analysis.sweep_plan import Follow, SweepPlan
from impact_damper_ros.commands.command_line import add_params_argument, add_version_option
from impact_damper_ros.commands.overrides import (
    add_set_option,
    overridden,
    overridden_control,
)
from impact_damper_ros.commands.whole_number import up_to
from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.rig import RigParameters, load_parameters
from impact_damper_ros.rig.guarded_yaml import YamlError, guarded_yaml

__all__ = ['parser', 'plan_of']
_DEFAULT = Settling()

_DESCRIPTION = """\
Run an impact damper for many values of any of its parameters and initial conditions, each until
its motion has settled, and write what it settles into as a table (Parquet or CSV): largest and
rms X, impacts per cycle, period and stops, Lyapunov exponent, shares of time in chatter, sticking
and at rest, and the section of the motion. All quantities are in SI units.
"""
_EPILOG = """\
RANGE is LOW:HIGH:COUNT, LOW:HIGH:COUNT:log, or a list such as 10,20,40. Several names before it
take the same value: --vary restitution_1=restitution_2=0.5:0.9:41. One entry of an array is
force_frequencies[0].

An interrupted sweep goes on when the same command is given again; nothing that was done is lost.
A rig that cannot be simulated is a row with its reason. With gap_control in the parameters file or
by --set, the rigs run under control, which takes longer; its parameters can be varied, too.

Examples:
  sweep_rig config/paper.yaml --vary gap=5:80:400 --follow both -o gap.parquet --figure gap.png
  sweep_rig config/bench_rig.yaml --vary gap=0.005:0.05:120 --vary force_frequencies=28:36:100 \\
      --measure x_max -o surface.parquet --figure surface.svg
  sweep_rig config/paper.yaml --vary initial_primary_position=-60:60:200 \\
      --vary initial_primary_velocity=-60:60:200 -o basins.parquet --figure basins.png

Exit code: 0; 1 if something could not be written, or workers died; 2 if the input is not usable;
4 if every rig of the sweep failed; 130 on Ctrl-C.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    options = argparse.ArgumentParser(
        'sweep_rig',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = options.add_argument
    add_params_argument(options)
    add(
        '--vary',
        action='append',
        default=[],
        metavar='NAME=RANGE',
        help='what to vary; once for each axis, the one that is followed first',
    )
    add('--ranges', type=Path, metavar='FILE.yaml', help='the same as "vary:" in a YAML file')
    add_set_option(options)
    add(
        *('-o', '--output'),
        type=Path,
        required=True,
        metavar='FILE',
        help='the table: a name that ends in .parquet or .csv; while the sweep runs, what is done '
        'is in FILE.part',
    )
    add('--overwrite', action='store_true', help='replace the table of another sweep')
    add(
        '--follow',
        choices=[follow.value for follow in Follow],
        default=Follow.NONE.value,
        help='start each rig from the last state of the one before, along the first axis upwards, '
        'downwards or both [none]',
    )
    watched = options.add_argument_group('how each rig is watched')
    for name, meaning in (
        ('cycles', 'most cycles of the force to settle in'),
        ('watch', 'cycles measured of a motion that does not repeat'),
        ('events', 'most events of one rig'),
        ('section', 'most points of the section that are kept'),
    ):
        default = getattr(_DEFAULT, name)
        watched.add_argument(
            f'--{name}', type=int, default=default, metavar='N', help=f'{meaning} [{default}]'
        )
    watched.add_argument(
        '--tolerance',
        type=float,
        default=_DEFAULT.tolerance,
        metavar='EPS',
        help=f'how closely periods must agree to be taken as settled [{_DEFAULT.tolerance:g}]',
    )
    drawn = options.add_argument_group('what is made of the table')
    drawn.add_argument(
        '--figure',
        type=Path,
        action='append',
        default=[],
        metavar='FILE',
        help='draw it, as png, svg or pdf: a bifurcation diagram of one axis, a response surface '
        'of two, basins of attraction of two initial conditions; may be repeated',
    )
    drawn.add_argument(
        '--measure',
        choices=list(MEASURES),
        default='x_max_ratio',
        metavar='NAME',
        help=f'measure to draw and to find the optimum of: {", ".join(MEASURES)} [x_max_ratio]',
    )
    drawn.add_argument(
        '--optimum',
        choices=['least', 'greatest', 'none'],
        default='least',
        help='which value of the measure is best [least]',
    )
    drawn.add_argument(
        '--no-search',
        action='store_true',
        help='leave the optimum on the grid: no search between its values, which takes long for '
        'rigs under gap control',
    )
    drawn.add_argument(
        '--json',
        type=Path,
        metavar='FILE',
        help='write counts, attractors and optimum (- : stdout)',
    )
    where = options.add_argument_group('where it runs').add_mutually_exclusive_group()
    where.add_argument(
        '--jobs', type=up_to(1024), default=_cores(), metavar='N', help=f'processes [{_cores()}]'
    )
    where.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help='run on the workers of this Dask scheduler, such as tcp://10.0.0.1:8786',
    )
    add('--quiet', action='store_true', help='no progress bar and no summary')
    add_version_option(options)
    return options


def _cores() -> int:
    return max(1, len(os.sched_getaffinity(0)))


def _ranges(path: Path, rig: RigParameters) -> list[Axis]:
    """Read the axes of a ranges file."""
    try:
        content: Any = guarded_yaml(path)
    except OSError as error:
        reason = error.strerror or error
        raise AxisError(f'{path}: cannot be read ({reason}): give a YAML file') from error
    except YamlError as error:
        raise AxisError(f'{path}: {error}') from error
    ranges = content.get('vary') if isinstance(content, dict) else None
    if not isinstance(ranges, dict) or set(content) != {'vary'}:
        raise AxisError(
            f'{path}: start the file with "vary:" and, indented below it, lines such as '
            '"gap: 10:60:200" or "gap: {from: 10, to: 60, count: 200}"'
        )
    return [axis_from_mapping(str(name), entry, rig) for name, entry in ranges.items()]


def plan_of(arguments: argparse.Namespace) -> SweepPlan:
    """
    Return the sweep that was asked for.

    Raises
    ------
    ValueError
        If something is not usable; the message says what, and the remedy.
    """
    parameters, initial, other = load_parameters(arguments.params)
    control = GapControlParameters(**{k: v for k, v in other.items() if k in GAP_CONTROL_SPECS})
    settings, control = overridden_control(arguments.set, control)
    parameters, initial = overridden(settings, parameters, initial)
    axes: Sequence[Axis] = [
        *([] if arguments.ranges is None else _ranges(arguments.ranges, parameters)),
        *(axis_from_text(text, parameters) for text in arguments.vary),
    ]
    settling = Settling(
        cycles=arguments.cycles,
        watch=arguments.watch,
        tolerance=arguments.tolerance,
        events=arguments.events,
        section=arguments.section,
    )
    if not control.active:
        # Nothing depends on the rest of it
        control = GapControlParameters()
    return SweepPlan(
        *(parameters, initial, tuple(axes), Follow(arguments.follow), settling, control)
    )
