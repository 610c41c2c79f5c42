# SPDX-License-Identifier: Apache-2.0
"""`compare_run`: compare a recorded run with the periodic theory."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from impact_damper_ros.compare.comparison import compare_run
from impact_damper_ros.compare.result import RunComparison
from impact_damper_ros.outputs import check_directory
from impact_damper_ros.parameters.quoting import printable
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS
from impact_damper_ros.replay.run import runs_of
from impact_damper_ros.report.text_report import comparison_text

from .command_line import (
    add_bag_argument,
    add_json_option,
    add_node_option,
    add_path_option,
    add_quiet_option,
    add_run_option,
    check_outputs,
    command_parser,
    draw,
    need_matplotlib,
    number_in,
    outcome,
    progress_bar,
    share_done,
    text_stream,
    write_json,
)
from .rig_options import add_recorded_law_option

_Result = TypeVar('_Result')

_DESCRIPTION = """\
Compare a recorded run with the periodic theory. The run is divided where its parameters change and
where it is reset. Each stretch is classified as transient, periodic, quasi-periodic or chaotic,
the matching periodic problem is solved for the logged parameters, and both are shown side by side:
impacts, largest |X|, energy, decay into the steady state, and a verdict. Every recorded number is
also compared with a replay of the run. Works without ROS, on a bag directory or a single .mcap
file, also a recovered one. A recording over a restart of the node holds several runs; each is
compared by itself.
"""
_EPILOG = """\
Exit code: 0 if no stretch differs from theory (a stretch that is not settled, or for which theory
finds no motion, does not differ); 1 if one does (or a file cannot be written); 2 if the bag or an
argument is invalid; 3 if nothing differs, but the bag is cut, damaged, or holds messages that
contradict one another; 130 on Ctrl-C, 143 on SIGTERM.
Example: compare_run runs/run_20250131_120000 --json result.json --report report
Scores:  compare_run --score runs/timed runs/amplitude --score-gap '24 mm' --figure score.png
"""


#: See `needs`.
NEEDS = (
    *((option, '--score') for option in ('--figure', '--score-gap')),
    ('--report', 'no --score'),
)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('compare_run', _DESCRIPTION, _EPILOG, NEEDS)
    add_bag_argument(parser, several=True)
    add_node_option(parser)
    add_run_option(parser)
    add_recorded_law_option(parser)
    add_json_option(parser)
    page = 'write an HTML report with plots, and the result as JSON beside it'
    add_path_option(parser, '--report', page, 'DIR')
    spec = PARAMETER_SPECS['gap']
    parser.add_argument(
        '--score',
        action='store_true',
        help='score the control of one or several recordings, each compared with the '
        'same run at the gap with which it begins, and without damper',
    )
    parser.add_argument(
        '--score-gap',
        type=number_in(spec.low or 0.0, spec.high or math.inf, 'm'),
        metavar='GAP',
        help='with --score: fixed gap to compare with [the gap at the start of the run]',
    )
    add_path_option(parser, '--figure', 'with --score: draw the amplitudes of all recordings')
    add_quiet_option(parser, 'tables')
    return parser


def _each(
    arguments: argparse.Namespace, purpose: str, work: Callable[..., _Result]
) -> list[_Result]:
    """Apply `work` to each requested run, with a progress bar."""
    how = {'purpose': purpose, 'law': arguments.law}
    bags = (runs_of(bag, arguments.node, arguments.run, **how) for bag in arguments.bag)
    runs, quiet = [run for bag in bags for run in bag], arguments.quiet
    with share_done('compare_run', f'{purpose}d', len(runs), quiet=quiet) as reached:
        return [
            work(recorded, progress=lambda share, before=number: reached(before + share))
            for number, recorded in enumerate(runs)
        ]


def _write_report(arguments: argparse.Namespace, comparison: RunComparison, command: str) -> Path:
    """Write the report of a run; of several runs each into another directory."""
    from impact_damper_ros.report.html_report import MOST_DETAILED, write_report

    directory = arguments.report
    if comparison.run_count > 1 and arguments.run is None:
        directory /= f'run_{comparison.run}'
    steps = 2 * min(len(comparison.stretches), MOST_DETAILED)
    with progress_bar('drawn', steps, 'steps', quiet=arguments.quiet) as bar:
        return write_report(comparison, directory, command=command, done=bar.update)


def _score_recordings(arguments: argparse.Namespace) -> int:
    """Score recordings, and write the requested outputs."""
    from impact_damper_ros.compare.score import score_run
    from impact_damper_ros.report.score_report import score_figure, score_text

    runs = _each(arguments, 'score', partial(score_run, gap=arguments.score_gap))
    write_json(arguments.json, {'runs': runs})
    draw(arguments.figure, score_figure, runs)
    if not arguments.quiet:
        print(printable(score_text(runs)), file=text_stream(arguments.json))
    return min((code for run in runs if (code := run.exit_code)), default=0)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if len(arguments.bag) > 1 and not arguments.score:
        parser.error('several recordings are scored: give --score, or one of them')
    command = shlex.join(['compare_run', *(sys.argv[1:] if argv is None else argv)])

    def work() -> int:
        check_outputs(arguments, *arguments.bag)
        if arguments.report is not None:
            need_matplotlib()
            check_directory(arguments.report)
        if arguments.score:
            return _score_recordings(arguments)
        found = _each(arguments, 'compare', compare_run)
        write_json(arguments.json, found[0] if len(found) == 1 else {'runs': found})
        stream = text_stream(arguments.json)
        if not arguments.quiet:
            print(printable('\n\n'.join(map(comparison_text, found))), file=stream)
        if arguments.report is not None:
            for comparison in found:
                page = _write_report(arguments, comparison, command)
                if not arguments.quiet:
                    print(f'report       {page}', file=stream)
        return min((code for one in found if (code := one.exit_code)), default=0)

    return outcome('compare_run', work)


if __name__ == '__main__':
    sys.exit(main())
