# SPDX-License-Identifier: Apache-2.0
"""`compare_run`: compare a recorded run with the periodic theory."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from impact_damper_ros.compare import RunComparison, compare_bag
from impact_damper_ros.outputs import check_directory, check_file
from impact_damper_ros.report.text_report import comparison_text
from impact_damper_ros.rig import load_parameters
from impact_damper_ros.rig.quoting import printable

from .command_line import (
    add_bag_argument,
    add_json_option,
    add_node_option,
    add_path_option,
    add_quiet_option,
    command_parser,
    need_matplotlib,
    outcome,
    progress_bar,
    text_stream,
    write_json,
)
from .rig_options import add_recorded_law_option, announce

_DESCRIPTION = """\
Compare a recorded run with the periodic theory. The run is divided where its parameters change and
where it is reset. Each stretch is classified as transient, periodic, quasi-periodic or chaotic,
the matching periodic problem is solved for the logged parameters, and both are shown side by side:
impacts, largest |X|, energy, decay into the steady state, and a verdict. Every recorded number is
also held against a replay of the run. Works without ROS, on a bag directory or a single .mcap
file, also a recovered one.
"""
_EPILOG = """\
Exit code: 0 if no stretch differs from theory (a stretch that is not settled, or for which theory
finds no motion, does not differ); 1 if one does (or a file cannot be written); 2 if the bag or an
argument is invalid; 3 if nothing differs, but the bag is cut, damaged, or holds messages that
contradict one another; 130 on Ctrl-C, 143 on SIGTERM.
Example: compare_run runs/run_20250131_120000 --json result.json --report report
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('compare_run', _DESCRIPTION, _EPILOG)
    add_bag_argument(parser)
    add_node_option(parser)
    add_recorded_law_option(parser)
    add_json_option(parser)
    page = 'write an HTML report with plots, and the result as JSON beside it'
    add_path_option(parser, '--report', page, 'DIR')
    parser.add_argument(
        '--gap-curves',
        action='store_true',
        help='with --report: follow each predicted motion in the gap, about a second each '
        '(default: the first three)',
    )
    rig = 'parameters of the rig, for a bag recorded without them (without snapshot)'
    add_path_option(parser, '--params', rig, 'FILE.yaml')
    add_quiet_option(parser, 'tables')
    return parser


def _compared(arguments: argparse.Namespace) -> RunComparison:
    """Compare the bag, with a progress bar for each pass through it."""
    rig = None
    if arguments.params is not None:
        rig = load_parameters(arguments.params)[0]
        if not arguments.quiet:
            announce('compare_run', rig)
    with ExitStack() as stack:

        def progress(what: str, span: float) -> Callable[[float], None]:
            bar = stack.enter_context(progress_bar(what, span, 's', quiet=arguments.quiet))
            start: float | None = None

            def reached(time: float) -> None:
                nonlocal start
                start = time if start is None else start
                bar.update(min(span, time - start) - bar.n)

            return reached

        return compare_bag(
            arguments.bag, arguments.node, rig, law=arguments.law, progress=progress
        )


def _write_report(arguments: argparse.Namespace, comparison: RunComparison, command: str) -> Path:
    from impact_damper_ros.report.html_report import write_report

    count = len(comparison.stretches)
    with progress_bar('drawn', count, 'steps', quiet=arguments.quiet) as bar:

        def drawn(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return write_report(
            comparison,
            arguments.report,
            command=command,
            gap_curves=arguments.gap_curves,
            drawn=drawn,
        )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    command = shlex.join(['compare_run', *(sys.argv[1:] if argv is None else argv)])

    def work() -> int:
        # Before the work, not after it
        if arguments.json is not None:
            check_file(arguments.json)
        if arguments.report is not None:
            need_matplotlib()
            check_directory(arguments.report)
        comparison = _compared(arguments)
        write_json(arguments.json, comparison.as_dict())
        stream = text_stream(arguments.json)
        if not arguments.quiet:
            print(printable(comparison_text(comparison)), file=stream)
        if arguments.report is not None:
            page = _write_report(arguments, comparison, command)
            if not arguments.quiet:
                print(f'report       {page}', file=stream)
        return comparison.exit_code

    return outcome('compare_run', work)


if __name__ == '__main__':
    sys.exit(main())
