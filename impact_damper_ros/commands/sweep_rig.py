"""`sweep_rig`: steady states of a rig over any of its parameters, as a table and a figure."""

from __future__ import annotations

import argparse
import json
import logging
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from tqdm import tqdm

from impact_damper_ros.analysis.sweep_executors import (
    DaskWorkers,
    Here,
    LocalWorkers,
    Workers,
    WorkersError,
)
from impact_damper_ros.analysis.sweep_journal import (
    Journal,
    differences,
    journal_path,
)
from impact_damper_ros.analysis.sweep_optimum import Best, Optimum, find_optimum
from impact_damper_ros.analysis.sweep_plan import SweepPlan
from impact_damper_ros.analysis.sweep_run import run_sweep
from impact_damper_ros.analysis.sweep_summary import summary_of, summary_text
from impact_damper_ros.analysis.sweep_table import (
    FORMATS,
    MetadataError,
    SweepTable,
    need_pyarrow,
    stored_inputs,
    write_table,
)
from impact_damper_ros.commands.command_line import announce, say
from impact_damper_ros.commands.outputs import check_figure, check_file, in_words, write_text
from impact_damper_ros.commands.sweep_options import parser, plan_of
from impact_damper_ros.entry_points import run

__all__ = ['main']

EXIT_WRITE, EXIT_INPUT, EXIT_ALL_FAILED, EXIT_INTERRUPTED = 1, 2, 4, 130


class _StopError(Exception):
    """The command cannot go on; what to say, and the exit code."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


def _check_outputs(arguments: argparse.Namespace, plan: SweepPlan) -> None:
    """Find out before the work what could not be written after it."""
    figures: list[Path] = arguments.figure
    if arguments.output.suffix.lower() not in FORMATS:
        raise _StopError(
            f'{arguments.output}: give the table a name that ends in .parquet (for pandas and '
            'xarray, with units) or .csv (for a spreadsheet)',
            EXIT_INPUT,
        )
    outputs = [arguments.output, *figures, *([arguments.json] if arguments.json else [])]
    for path in outputs:
        if str(path) == '-' and path is not arguments.output:
            continue
        if path.is_dir():
            raise _StopError(f'{path} is a directory: give the name of a file', EXIT_INPUT)
        if not path.absolute().parent.is_dir():
            raise _StopError(
                f'{path.absolute().parent} is no directory: make it, or give another place for '
                f'{path.name}',
                EXIT_INPUT,
            )
        check_file(path)
    if len({path.absolute() for path in outputs}) < len(outputs):
        raise _StopError('two outputs have the same name: give each its own', EXIT_INPUT)
    for path in figures:
        check_figure(path)
    if figures and len(plan.axes) > 2:
        raise _StopError(
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
        raise _StopError(
            f'{error}: give another --output, or --overwrite it', EXIT_INPUT
        ) from None
    differing = differences(stored, plan.inputs())
    if differing and not overwrite:
        raise _StopError(
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
        raise _StopError(f'interrupted; {_left(journal, plan)}', EXIT_INTERRUPTED) from None
    except WorkersError as error:
        raise _StopError(f'{error}; {_left(journal, plan)}', EXIT_WRITE) from error
    except OSError as error:
        raise _StopError(
            f'cannot write {error.filename or journal.path}: {error.strerror or error}; '
            f'{_left(journal, plan)} once that is put right',
            EXIT_WRITE,
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
        raise _StopError(str(error), EXIT_WRITE) from error
    with workers:
        try:
            journal = Journal(journal_path(output), plan.inputs(), anew=arguments.overwrite)
        except OSError as error:
            raise _StopError(
                in_words(error, journal_path(output)),
                EXIT_WRITE,
            ) from error
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
        from impact_damper_ros.analysis.sweep_figure import draw_sweep

        draw_sweep(table, arguments.measure, optimum, path)
    if arguments.json is not None:
        text = json.dumps(summary, indent=2) + '\n'
        write_text(arguments.json, text)
    if not arguments.quiet:
        print(summary_text(arguments.output, summary), file=sys.stderr)
        missed = optimum is None and arguments.optimum != 'none' and not summary['attractors']
        if missed and summary['failed'] < summary['rigs']:
            print('  no optimum, since no motion repeats: give more --cycles', file=sys.stderr)
    return EXIT_ALL_FAILED if summary['failed'] == summary['rigs'] else 0


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the command.

    Returns
    -------
    int
        0; 1 if something could not be written or workers died; 2 if the input is not usable; 4 if
        every rig failed; 130 on Ctrl-C or SIGTERM, with all finished rigs on disk.
    """
    arguments = parser().parse_args(argv)
    try:
        need_pyarrow()
        plan = plan_of(arguments)
        _check_outputs(arguments, plan)
        if not arguments.quiet:
            _announce(plan)
        with _stopped_by_sigterm():
            _sweep(arguments, plan)
            return _report(arguments)
    except (ImportError, ValueError) as error:
        say('sweep_rig', error)
        return EXIT_INPUT
    except _StopError as error:
        say('sweep_rig', error)
        return error.code
    except OSError as error:
        say('sweep_rig', in_words(error))
        return EXIT_WRITE
    except KeyboardInterrupt:
        print('sweep_rig: interrupted; give the same command again to go on', file=sys.stderr)
        return EXIT_INTERRUPTED


if __name__ == '__main__':
    sys.exit(run('sweep_rig', main))
