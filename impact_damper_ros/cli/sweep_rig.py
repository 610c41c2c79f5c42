"""`sweep_rig`: steady states of a rig over any of its parameters, as a table and a figure."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tqdm import tqdm

from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.entry_points import run
from impact_damper_ros.orbits.settling import Settling
from impact_damper_ros.outputs import check_file, in_words
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.parameters_file import YamlError, guarded_yaml
from impact_damper_ros.sweep.columns import MEASURES
from impact_damper_ros.sweep.execution import (
    DaskWorkers,
    Here,
    LocalWorkers,
    Workers,
    WorkersError,
    run_sweep,
)
from impact_damper_ros.sweep.optimum import Best, Optimum, find_optimum, summary_of, summary_text
from impact_damper_ros.sweep.plan import (
    Axis,
    AxisError,
    Follow,
    SweepPlan,
    axis_from_mapping,
    axis_from_text,
)
from impact_damper_ros.sweep.table import (
    FORMATS,
    MetadataError,
    SweepTable,
    need_pyarrow,
    stored_inputs,
    write_table,
)
from impact_damper_ros.sweep.work import Journal, differences, journal_path

from .command_line import (
    EXIT_FAILED,
    EXIT_INPUT,
    EXIT_INTERRUPTED,
    CommandError,
    add_quiet_option,
    check_figure,
    command_parser,
    outcome,
    up_to,
    write_json,
)
from .rig_options import add_params_argument, add_set_option, announce, given_rig

__all__ = ['main', 'parser', 'plan_of']


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
    options = command_parser('sweep_rig', _DESCRIPTION, _EPILOG)
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
    add_quiet_option(options, 'summary')
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
    """Return the sweep that was asked for."""
    parameters, initial, control = given_rig(arguments.params, arguments.set)
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


EXIT_ALL_FAILED = 4


def _check_outputs(arguments: argparse.Namespace, plan: SweepPlan) -> None:
    """Find out before the work what could not be written after it."""
    figures: list[Path] = arguments.figure
    if arguments.output.suffix.lower() not in FORMATS:
        raise CommandError(
            f'{arguments.output}: give the table a name that ends in .parquet (for pandas and '
            'xarray, with units) or .csv (for a spreadsheet)',
            EXIT_INPUT,
        )
    outputs = [arguments.output, *figures, *([arguments.json] if arguments.json else [])]
    for path in outputs:
        if str(path) == '-' and path is not arguments.output:
            continue
        if path.is_dir():
            raise CommandError(f'{path} is a directory: give the name of a file', EXIT_INPUT)
        if not path.absolute().parent.is_dir():
            raise CommandError(
                f'{path.absolute().parent} is no directory: make it, or give another place for '
                f'{path.name}',
                EXIT_INPUT,
            )
        check_file(path)
    if len({path.absolute() for path in outputs}) < len(outputs):
        raise CommandError('two outputs have the same name: give each its own', EXIT_INPUT)
    for path in figures:
        check_figure(path)
    if figures and len(plan.axes) > 2:
        raise CommandError(
            f'a figure shows one axis or two, not {len(plan.axes)}: leave out --figure, and draw '
            'the table',
            EXIT_INPUT,
        )


def _announce(plan: SweepPlan) -> None:
    """Say what is swept, and whether frequencies look as if they were in Hz."""
    varied = [
        (float(axis.values[0]), float(axis.values[-1]))
        for axis in plan.axes
        if any(target.name == 'force_frequencies' and not target.index for target in axis.targets)
    ]
    announce(
        *('sweep_rig', plan.parameters, plan.control), frequencies=varied[0] if varied else None
    )


def _is_complete(plan: SweepPlan, output: Path, *, overwrite: bool) -> bool:
    """Return whether the table is there already; refuse to touch another one."""
    if not output.exists():
        return False
    try:
        stored = stored_inputs(output)
    except MetadataError as error:
        if overwrite:
            return False
        raise CommandError(
            f'{error}: give another --output, or --overwrite it', EXIT_INPUT
        ) from None
    differing = differences(stored, plan.inputs())
    if differing and not overwrite:
        raise CommandError(
            f'{output} is the table of a sweep with other inputs:\n  '
            + '\n  '.join(differing[:12])
            + '\ngive another --output, or --overwrite it',
            EXIT_INPUT,
        )
    return not differing


def _workers(arguments: argparse.Namespace) -> Workers:
    if arguments.scheduler:
        workers = DaskWorkers(arguments.scheduler)
        # What matters of a lost connection is said here, in a line
        for name in ('distributed.batched', 'distributed.client'):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        return workers
    return Here() if arguments.jobs == 1 else LocalWorkers(arguments.jobs)


@contextmanager
def _stopped_by_sigterm() -> Iterator[None]:
    """Let SIGTERM stop the sweep as Ctrl-C does."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _left(journal: Journal, plan: SweepPlan) -> str:
    return (
        f'{len(journal.points)} of {plan.size} rigs are in {journal.path}: give the same command '
        'again to go on'
    )


def _run(
    plan: SweepPlan, journal: Journal, workers: Workers, output: Path, *, quiet: bool
) -> None:
    """Run what is left of the sweep, and write the table."""
    try:
        with tqdm(
            total=plan.size,
            initial=len(journal.points),
            desc='rigs',
            unit='rig',
            smoothing=0.05,
            disable=True if quiet else None,
        ) as bar:
            run_sweep(
                plan,
                journal,
                workers,
                at_once=lambda: workers.at_once,
                losses=workers.losses,
                progress=bar.update,
            )
        write_table(plan, journal, output)
    except KeyboardInterrupt:
        raise CommandError(f'interrupted; {_left(journal, plan)}', EXIT_INTERRUPTED) from None
    except WorkersError as error:
        raise CommandError(f'{error}; {_left(journal, plan)}', EXIT_FAILED) from error
    except OSError as error:
        raise CommandError(
            f'cannot write {error.filename or journal.path}: {error.strerror or error}; '
            f'{_left(journal, plan)} once that is put right',
            EXIT_FAILED,
        ) from error


def _sweep(arguments: argparse.Namespace, plan: SweepPlan) -> None:
    """Make the table, if it is not there already."""
    output: Path = arguments.output
    if _is_complete(plan, output, overwrite=arguments.overwrite):
        journal_path(output).unlink(missing_ok=True)
        return
    if find_spec('numba') is None and not arguments.quiet:
        print(
            'sweep_rig: numba is not installed; with it (extra [compiled]) this is many times as '
            'fast',
            file=sys.stderr,
        )
    try:
        workers = _workers(arguments)
    except OSError as error:
        raise CommandError(str(error), EXIT_FAILED) from error
    with workers:
        try:
            journal = Journal(journal_path(output), plan.inputs(), anew=arguments.overwrite)
        except OSError as error:
            raise CommandError(in_words(error, journal_path(output)), EXIT_FAILED) from error
        with journal:
            _run(plan, journal, workers, output, quiet=arguments.quiet)
            journal.path.unlink(missing_ok=True)


def _optimum(table: SweepTable, arguments: argparse.Namespace) -> Optimum | None:
    """Find the best rig, and show how the search for it goes on if it takes long."""
    with tqdm(
        desc='optimum', unit='rig', delay=2.0, disable=True if arguments.quiet else None
    ) as bar:
        return find_optimum(
            *(table, arguments.measure, Best(arguments.optimum)),
            refine=not arguments.no_search,
            progress=bar.update,
        )


def _report(arguments: argparse.Namespace) -> int:
    """Draw and say what the table holds."""
    table = SweepTable(arguments.output)
    optimum: Optimum | None = None
    if arguments.optimum != 'none':
        optimum = _optimum(table, arguments)
    summary = summary_of(table, optimum)
    for path in arguments.figure:
        from impact_damper_ros.sweep.figures import draw_sweep

        draw_sweep(table, arguments.measure, optimum, path)
    write_json(arguments.json, summary)
    if not arguments.quiet:
        print(summary_text(arguments.output, summary), file=sys.stderr)
        missed = optimum is None and arguments.optimum != 'none' and not summary['attractors']
        if missed and summary['failed'] < summary['rigs']:
            print('  no optimum, since no motion repeats: give more --cycles', file=sys.stderr)
    return EXIT_ALL_FAILED if summary['failed'] == summary['rigs'] else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = parser().parse_args(argv)

    def work() -> int:
        try:
            need_pyarrow()
            plan = plan_of(arguments)
            _check_outputs(arguments, plan)
            if not arguments.quiet:
                _announce(plan)
            with _stopped_by_sigterm():
                _sweep(arguments, plan)
                return _report(arguments)
        except ImportError as error:
            raise CommandError(str(error)) from error

    return outcome('sweep_rig', work, 'interrupted; give the same command again to go on')


if __name__ == '__main__':
    sys.exit(run('sweep_rig', main))
