# SPDX-License-Identifier: Apache-2.0
"""`sweep_rig`: the steady states of a rig over its parameters, as a table and figures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any, get_args

from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.sweep import (
    MEASURES,
    Grid,
    GridError,
    Settling,
    WorkersError,
    branches_of,
    draw_sweep,
    find_optimum,
    range_from_text,
    summary_of,
    summary_text,
)
from impact_damper_ros.sweep.execution import MOST_JOBS, run_grid
from impact_damper_ros.sweep.grid import Follow
from impact_damper_ros.sweep.part_file import part_path
from impact_damper_ros.sweep.table import FORMATS, Columns, check_format

from .command_line import (
    EXIT_FAILED,
    CommandError,
    add_json_option,
    add_quiet_option,
    check_outputs,
    command_parser,
    outcome,
    path_of,
    progress_bar,
    say,
    up_to,
    write_json,
)
from .rig_options import (
    add_law_option,
    add_params_argument,
    add_set_option,
    announce,
    given_law,
    given_rig,
)

_DEFAULT = Settling()
#: Exit code if every rig failed.
_ALL_FAILED = 4

_DESCRIPTION = """\
Run an impact damper for many values of its parameters or initial conditions, each until its motion
has settled, and write the steady states as a table (Parquet or CSV): largest and rms X, impacts
per cycle, period and stops, Lyapunov exponent, shares of the time in chatter, sticking and at
rest, and the section of the motion. All quantities are in SI units.
"""
_EPILOG = """\
RANGE is LOW:HIGH:COUNT, LOW:HIGH:COUNT:log, or a list such as 10,20,40. Several names before it
take the same value: --vary restitution_1=restitution_2=0.5:0.9:41. An entry of an array is named
as in force_frequencies[0].

The same command resumes an interrupted sweep; finished rigs are not run again. The row of a rig
that cannot be simulated holds the reason. With gap_control in the parameters file or in --set, the
rigs run under control, which takes longer; the parameters of the control can be varied as well.

Examples:
  sweep_rig config/paper.yaml --vary gap=5:80:400 --follow both -o gap.parquet --figure gap.png
  sweep_rig config/bench_rig.yaml --vary gap=0.005:0.05:120 --vary force_frequencies=28:36:100 \\
      --measure x_max -o surface.parquet --figure surface.svg
  sweep_rig config/paper.yaml --vary initial_primary_position=-60:60:200 \\
      --vary initial_primary_velocity=-60:60:200 -o basins.parquet --figure basins.png

Exit code: 0 on success; 1 if an output could not be written or workers died; 2 if the input is
invalid; 4 if every rig of the sweep failed; 130 on Ctrl-C, 143 on SIGTERM.
"""


#: See `needs`.
NEEDS = (('--no-theory', '--figure'), ('--measure', '--figure', 'no --optimum none'))


def _parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    options = command_parser('sweep_rig', _DESCRIPTION, _EPILOG, NEEDS)
    add = options.add_argument
    add_params_argument(options)
    add(
        '--vary',
        action='append',
        default=[],
        metavar='NAME=RANGE',
        help='a parameter and its values; may be repeated for further axes, the first of which is '
        'the one that --follow uses',
    )
    add_set_option(options)
    add_law_option(options)
    add(
        *('-o', '--output'),
        type=path_of,
        required=True,
        metavar='FILE',
        help='the table, a .parquet or .csv file; until it is complete, its rows are in FILE.part',
    )
    add('--overwrite', action='store_true', help='run all rigs anew, and replace the table')
    add(
        '--follow',
        choices=get_args(Follow),
        default='none',
        help='start each rig from the last state of the one before, along the first axis upwards, '
        'downwards or both [none]',
    )
    watched = options.add_argument_group('settling and measurement')
    for name, meaning, *aliases in (
        ('cycles', 'most cycles of the force to settle in'),
        ('watch', 'cycles that are measured if the motion does not repeat'),
        ('events', 'most events of one rig', '--most-events'),
        ('section', 'most points of the section that are kept'),
    ):
        default = getattr(_DEFAULT, name)
        watched.add_argument(
            *(f'--{name}', *aliases),
            type=int,
            default=default,
            metavar='N',
            help=f'{meaning} [{default}]',
        )
    watched.add_argument(
        '--tolerance',
        type=float,
        default=_DEFAULT.tolerance,
        metavar='EPS',
        help='relative tolerance within which periods must agree for a motion to be settled '
        f'[{_DEFAULT.tolerance:g}]',
    )
    drawn = options.add_argument_group('results from the table')
    drawn.add_argument(
        '--figure',
        type=path_of,
        action='append',
        default=[],
        metavar='FILE',
        help='draw the table as png, svg or pdf: a bifurcation diagram of one axis with the '
        'branches of its periodic motions, a response surface of two, basins of attraction of two '
        'initial conditions; may be repeated',
    )
    drawn.add_argument(
        '--no-theory',
        action='store_true',
        help='leave the branches, which may take a minute to follow, out of the diagram',
    )
    drawn.add_argument(
        '--measure',
        choices=list(MEASURES),
        metavar='NAME',
        help=f'measure to draw and to optimise: {", ".join(MEASURES)} [x_max_ratio; x_max, if the '
        'force has several harmonics, or none]',
    )
    drawn.add_argument(
        '--optimum',
        choices=['least', 'greatest', 'none'],
        default='least',
        help='which value of the measure is best [least]',
    )
    add_json_option(drawn, 'counts, attractors and optimum')
    add(
        '--jobs',
        type=up_to(MOST_JOBS),
        metavar='N',
        help='number of threads; of processes, if a law is plain Python [as many as cores]',
    )
    add_quiet_option(options, 'summary')
    return options


def _grid(arguments: argparse.Namespace) -> Grid:
    given = given_rig(arguments.params, arguments.set, arguments.node)
    law, (parameters, initial, control, _) = given_law(arguments.law, given)
    ranges = [range_from_text(text) for text in arguments.vary]
    names = [name for name, _, _ in ranges]
    axes: dict[str, Any] = {name: values for name, values, _ in ranges}
    if len(axes) < len(ranges):
        twice = next(name for name in names if names.count(name) > 1)
        raise GridError(f'{twice} is varied twice: give each name once')
    settling = Settling(**{name: getattr(arguments, name) for name in asdict(_DEFAULT)})
    return Grid(
        *(parameters, initial, control, law.name if law and control.active else ''),
        follow=arguments.follow,
        settling=settling,
        units={name: unit for name, _, unit in ranges},
        **axes,
    )


def _check_outputs(arguments: argparse.Namespace, grid: Grid) -> None:
    """Check before the work that all outputs can be written after it."""
    if arguments.output.suffix.lower() not in FORMATS:
        raise ValueError(
            f'{arguments.output}: give the table a name that ends in .parquet (for pandas and '
            'xarray, with units) or .csv (for a spreadsheet)'
        )
    try:
        check_format(arguments.output, frame=bool(arguments.figure))
    except ImportError as error:
        raise CommandError(str(error)) from error
    check_outputs(arguments, arguments.params)
    if arguments.figure and len(grid.axes) > 2:
        raise ValueError(
            f'a figure shows one axis or two, not {len(grid.axes)}: leave out --figure, and draw '
            'the table'
        )


def _announce(grid: Grid) -> None:
    """Print the rig, and notes on a frequency that may be in Hz and on a slow law."""
    announce('sweep_rig', grid.setup.parameters, grid.setup.control, law=grid.setup.law)
    slow = grid.setup.law and not OwnLaw.from_text(grid.setup.law).compiles
    if slow and find_spec('numba'):
        say(
            'sweep_rig',
            f'note: the law {grid.setup.law} is plain Python, so that the whole run is, too: with '
            '@numba.njit before its def the sweep takes a fraction of the time',
        )


def _swept(grid: Grid, arguments: argparse.Namespace) -> Columns:
    """Run the rest of the sweep; return its table."""
    part = part_path(arguments.output)
    try:
        with progress_bar('rigs', grid.size, 'rigs', quiet=arguments.quiet) as bar:
            done = 0

            def reached(now: int) -> None:
                nonlocal done
                if not done:
                    # Rigs of an earlier run are not counted.
                    bar.initial = bar.n = now
                bar.update(now - bar.n)
                done = now

            return run_grid(
                *(grid, arguments.output, None, arguments.jobs),
                overwrite=arguments.overwrite,
                progress=reached,
            )
    except (KeyboardInterrupt, WorkersError, OSError) as error:
        if part.exists():
            say(
                'sweep_rig',
                f'{done} of {grid.size} rigs are in {part}: give the same command again to resume',
            )
        if isinstance(error, WorkersError):
            raise CommandError(str(error), EXIT_FAILED) from error
        if isinstance(error, OSError):
            error.filename = error.filename or str(part)
        raise


def _report(columns: Columns, arguments: argparse.Namespace) -> int:
    """Draw and summarise the table; return the exit code."""
    grid, values = columns
    if arguments.measure is None:
        known = any(ratio is not None for ratio in values['x_max_ratio']) or not any(values['ok'])
        arguments.measure = 'x_max_ratio' if known else 'x_max'
    measure, best = arguments.measure, arguments.optimum
    optimum = None if best == 'none' else find_optimum(columns, measure, best)
    summary = summary_of(columns, optimum)
    if arguments.figure:
        table = columns.frame()
        branches = [] if arguments.no_theory else branches_of(table)
        for path in arguments.figure:
            draw_sweep(table, arguments.measure, optimum, path, branches)
    write_json(arguments.json, summary)
    if not arguments.quiet:
        print(summary_text(arguments.output, summary), file=sys.stderr)
        missed = optimum is None and arguments.optimum != 'none' and not summary['attractors']
        if missed and summary['failed'] < summary['rigs']:
            why = f'no motion has {arguments.measure}: give another --measure'
            if grid.setup.control.active:
                why += '; under gap control exponents and multipliers are not measured'
            elif not any(values['settled']):
                why = 'no motion repeats: give more --cycles'
            print(f'  no optimum, since {why}', file=sys.stderr)
    return _ALL_FAILED if summary['failed'] == summary['rigs'] else 0


def _run(arguments: argparse.Namespace) -> int:
    grid = _grid(arguments)
    _check_outputs(arguments, grid)
    if not arguments.quiet:
        _announce(grid)
    return _report(_swept(grid, arguments), arguments)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('sweep_rig', lambda: _run(arguments))


if __name__ == '__main__':
    sys.exit(main())
