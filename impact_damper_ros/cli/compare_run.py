"""`compare_run`: hold a recorded run against the periodic theory."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from impact_damper_ros import __version__
from impact_damper_ros.compare.bag_stretches import BagStretches
from impact_damper_ros.compare.clock_fit import with_fitted_clock
from impact_damper_ros.compare.compare_stretch import compare_stretch
from impact_damper_ros.compare.comparison_curves import GapCurves
from impact_damper_ros.compare.log_replay import replayed_log
from impact_damper_ros.compare.run_comparison import RunComparison, StretchComparison
from impact_damper_ros.entry_points import run
from impact_damper_ros.outputs import check_directory, check_file
from impact_damper_ros.report.text import comparison_text
from impact_damper_ros.rig import load_parameters
from impact_damper_ros.rig.quoting import printable

from .command_line import (
    add_bag_argument,
    add_json_option,
    add_node_option,
    add_quiet_option,
    command_parser,
    need_matplotlib,
    outcome,
    progress_bar,
    text_stream,
    write_json,
)
from .rig_options import announce

__all__ = ['main']


_DESCRIPTION = """\
Hold a recorded run against the periodic theory. The run is cut where its parameters change and
where it is reset; for each stretch it is found out whether the motion is transient, periodic,
quasi-periodic or chaotic, the matching periodic problem is solved for the logged parameters, and
both are shown side by side: impacts, swing, energy, decay into the steady state, and a verdict.
Every recorded number is also checked against the equations of motion, whatever the motion. Works
without ROS, on a bag directory or a single .mcap file, also a recovered one.
"""
_EPILOG = """\
Exit status: 0 if no stretch differs from theory (stretches that are not settled, or for which
theory has no motion, do not differ); 1 if one does (or a file cannot be written); 2 if the bag or
an argument cannot be used; 3 if nothing differs, but the bag is cut, damaged, or holds messages
that are not sound; 130 on Ctrl-C.
Example: compare_run runs/run_20250131_120000 --json result.json --report report
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('compare_run', _DESCRIPTION, _EPILOG)
    add_bag_argument(parser)
    add_node_option(parser)
    add_json_option(parser)
    parser.add_argument(
        '--report',
        type=Path,
        metavar='DIR',
        help='write a page with plots, and the JSON beside it',
    )
    parser.add_argument(
        '--params',
        type=Path,
        metavar='FILE.yaml',
        help='the rig, for a bag that does not tell its parameters (recorded without snapshot)',
    )
    add_quiet_option(parser, 'tables')
    return parser


def _compared(arguments: argparse.Namespace) -> RunComparison:
    """Read the bag and compare its stretches."""
    rig = load_parameters(arguments.params)[0] if arguments.params is not None else None
    if rig is not None and not arguments.quiet:
        announce('compare_run', rig)
    stretches: list[StretchComparison] = []
    remarks: list[str] = []
    with ExitStack() as stack:
        bag = BagStretches(arguments.bag, arguments.node, rig)
        reader = bag.history.reader
        span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9

        def shown(what: str) -> Callable[[float], None]:
            bar = stack.enter_context(progress_bar(what, span, 's', quiet=arguments.quiet))
            begun: list[float] = []

            def progress(time: float) -> None:
                begun.append(time) if not begun else None
                bar.update(min(span, time - begun[0]) - bar.n)

            return progress

        log = replayed_log(arguments.bag, arguments.node, shown('replayed'))
        # What a replay has reproduced bit for bit needs no other check.
        bag.checks = not log.check.replayed or bool(log.differences)
        bag.progress = shown('compared')
        for (stretch, search), replayed in log.judged(bag):
            if stretch.clock is None:
                stretch, search = with_fitted_clock(stretch)
                if stretch.clock is not None:
                    remarks.append(
                        f'the phase of the force in stretch {stretch.number} is not in the bag; '
                        'it was found from the motion'
                    )
            stretches.append(compare_stretch(stretch, search, replayed))
        if arguments.report is not None:
            stretches = _with_gap_curves(stretches)
    topics = bag.history.topics
    return RunComparison(
        bag=str(arguments.bag),
        node=topics.name,
        version=__version__,
        complete=reader.complete,
        stamps='rig time' if bag.history.stamped else 'times of arrival',
        start=(bag.start_ns or 0) / 1e9,
        end=(bag.end_ns or 0) / 1e9,
        samples=bag.samples,
        impacts=bag.impacts,
        stretches=tuple(stretches),
        log=log.check,
        faults=tuple(dict.fromkeys([*bag.all_faults(), *log.faults])),
        remarks=(*bag.all_remarks(), *remarks),
    )


def _with_gap_curves(stretches: Sequence[StretchComparison]) -> list[StretchComparison]:
    """Follow the predicted motions in the gap, of those stretches that the report shows."""
    from impact_damper_ros.report.html_report import MOST_DETAILED, shown_stretches

    curves = GapCurves()
    shown = {stretch.number for stretch in shown_stretches(stretches, MOST_DETAILED)}
    return [
        replace(stretch, curves=curves.added(stretch)) if stretch.number in shown else stretch
        for stretch in stretches
    ]


def _report(arguments: argparse.Namespace, comparison: RunComparison, command: str) -> int:
    write_json(arguments.json, comparison.as_dict())
    stream = text_stream(arguments.json)
    if not arguments.quiet:
        print(printable(comparison_text(comparison)), file=stream)
    if arguments.report is not None:
        from impact_damper_ros.report.html_report import write_report

        count = len(comparison.stretches)
        with progress_bar('drawn', count, 'stretches', quiet=arguments.quiet) as bar:

            def drawn(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            page = write_report(comparison, arguments.report, command=command, drawn=drawn)
        if not arguments.quiet:
            print(f'report       {page}', file=stream)
    return comparison.exit_code


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    words = sys.argv[1:] if argv is None else argv

    def work() -> int:
        # Before the work, not after it
        if arguments.json is not None:
            check_file(arguments.json)
        if arguments.report is not None:
            need_matplotlib()
            check_directory(arguments.report)
        # A wrong number may be as large as numbers are.
        with np.errstate(over='ignore', invalid='ignore'):
            compared = _compared(arguments)
        return _report(arguments, compared, shlex.join(['compare_run', *words]))

    return outcome('compare_run', work)


if __name__ == '__main__':
    sys.exit(run('compare_run', main))
