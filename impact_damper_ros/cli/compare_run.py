"""`compare_run`: compare a recorded run with the periodic theory."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from impact_damper_ros.compare import GapCurves, RunComparison, StretchComparison, compare_bag
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
Compare a recorded run with the periodic theory. The run is cut into stretches where its
parameters change and where it is reset. For each stretch the command finds out whether the motion
is transient, periodic, quasi-periodic or chaotic, solves the matching periodic problem for the
logged parameters, and shows both side by side: impacts, swing, energy, decay into the steady
state, and a verdict. Every recorded number is also checked against the equations of motion,
whatever the motion. It works without ROS, on a bag directory or a single .mcap file, also a
recovered one.
"""
_EPILOG = """\
Exit status: 0 if no stretch differs from theory (stretches that are not settled, or for which
theory has no motion, do not differ); 1 if one does (or a file cannot be written); 2 if the bag or
an argument cannot be used; 3 if nothing differs, but the bag is cut, damaged, or holds wrong
messages; 130 on Ctrl-C.
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
        help='the rig, for a bag that does not hold its parameters (recorded without snapshot)',
    )
    add_quiet_option(parser, 'tables')
    return parser


def _compared(arguments: argparse.Namespace) -> RunComparison:
    """Compare the bag, with a progress bar for each pass through it."""
    rig = load_parameters(arguments.params)[0] if arguments.params is not None else None
    if rig is not None and not arguments.quiet:
        announce('compare_run', rig)
    with ExitStack() as stack:

        def shown(what: str, span: float) -> Callable[[float], None]:
            bar = stack.enter_context(progress_bar(what, span, 's', quiet=arguments.quiet))
            begun: list[float] = []

            def progress(time: float) -> None:
                begun.append(time) if not begun else None
                bar.update(min(span, time - begun[0]) - bar.n)

            return progress

        compared = compare_bag(arguments.bag, arguments.node, rig, progress=shown)
        if arguments.report is not None:
            compared = replace(compared, stretches=_with_gap_curves(compared.stretches))
    return compared


def _with_gap_curves(stretches: Sequence[StretchComparison]) -> tuple[StretchComparison, ...]:
    """Follow the predicted motions in the gap, of those stretches that the report shows."""
    from impact_damper_ros.report.html_report import MOST_DETAILED, shown_stretches

    curves = GapCurves()
    shown = {stretch.number for stretch in shown_stretches(stretches, MOST_DETAILED)}
    return tuple(
        replace(stretch, curves=curves.added(stretch)) if stretch.number in shown else stretch
        for stretch in stretches
    )


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
