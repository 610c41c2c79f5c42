"""`reproduce_paper`: the figures and claims of Bapat (1995), computed again."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, as_completed
from typing import TYPE_CHECKING, Any

from impact_damper_ros.entry_points import run
from impact_damper_ros.outputs import check_directory

from .command_line import (
    add_directory_option,
    add_jobs_option,
    command_parser,
    need_matplotlib,
    outcome,
    process_pool,
    say_how_long,
    work_bar,
)

if TYPE_CHECKING:
    from impact_damper_ros.studies.paper.series import AngleOptimum, Series


_DESCRIPTION = """\
Compute and draw the figures of Bapat (1995) by the periodic theory and the exact simulator, and
compare every claim of the paper's section 3 and conclusions with the numbers. Writes PNG files, a
CSV file for each figure and, if all figures are made, README.md with captions and the table of
claims. The claims are also printed. On two idle cores it takes three to four minutes.
"""
_EPILOG = """\
Exit code: 0 on success; 1 if a file could not be written or a process died; 2 if the input is
invalid or matplotlib is missing; 130 on Ctrl-C, 143 on SIGTERM, which leaves no unfinished file.
Example: reproduce_paper --only 3a,5 --output /tmp/paper
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('reproduce_paper', _DESCRIPTION, _EPILOG)
    add_directory_option(parser, 'docs/paper')
    add_jobs_option(parser)
    parser.add_argument(
        '--quick',
        action='store_true',
        help='compute a quarter of the values, in two minutes',
    )
    parser.add_argument(
        '--only',
        metavar='2a,4,...',
        help='make these figures only, without README.md; a panel stands for its figure',
    )
    return parser


def _compute(
    figures: Sequence[str], jobs: int, quick: bool
) -> tuple[dict[str, Series], list[AngleOptimum]]:
    """Compute all series and optima in processes, under one progress bar, in a fixed order."""
    from impact_damper_ros.studies.paper.series import (
        COST_OF_OPTIMUM,
        SECONDS_PER_VALUE,
        compute_series,
        cost_of,
        figure_5_angles,
        needs_others,
        optimum_at,
        plans_of,
    )

    plans = [plan for figure in figures for plan in plans_of(figure, quick=quick)]
    angles = figure_5_angles(quick=quick) if '5' in figures else ()
    whole = sum(map(cost_of, plans)) + COST_OF_OPTIMUM * len(angles)
    say_how_long('reproduce_paper', SECONDS_PER_VALUE * whole, jobs)
    with process_pool(jobs) as pool:
        first = [plan for plan in plans if not needs_others(plan)]
        series: dict[str, Future[Series]] = {
            plan.name: pool.submit(compute_series, plan) for plan in first
        }
        optima: list[Future[AngleOptimum]] = [pool.submit(optimum_at, v) for v in angles]
        cost: dict[Future[Any], int] = dict.fromkeys(optima, COST_OF_OPTIMUM)
        cost |= {series[plan.name]: cost_of(plan) for plan in first}
        with work_bar('curves', whole) as bar:

            def finish(work: Iterable[Future[Any]]) -> None:
                for done in as_completed(work):
                    done.result()
                    bar.update(cost[done])

            finish([*series.values(), *optima])
            last = {}
            for plan in plans:
                if needs_others(plan):
                    figure = [one.name for one in first if one.name[0] == plan.name[0]]
                    others = [series[name].result() for name in figure]
                    last[plan.name] = pool.submit(compute_series, plan, others)
                    cost[last[plan.name]] = cost_of(plan)
            finish(last.values())
        found = {plan.name: (series | last)[plan.name].result() for plan in plans}
        return found, [one.result() for one in optima]


def _run(arguments: argparse.Namespace) -> int:
    from impact_damper_ros.studies.paper.figure_claims import claims_of
    from impact_damper_ros.studies.paper.report import write_figure, write_report
    from impact_damper_ros.studies.paper.series import FIGURES, figure_of

    need_matplotlib()
    figures = list(FIGURES)
    if arguments.only is not None:
        asked = {figure_of(name.strip()) for name in arguments.only.split(',')}
        figures = [figure for figure in FIGURES if figure in asked]
    # Before the work, which takes minutes
    check_directory(arguments.output)
    arguments.output.mkdir(parents=True, exist_ok=True)
    results, optima = _compute(figures, arguments.jobs, arguments.quick)
    for figure in figures:
        for path in write_figure(figure, results, optima, arguments.output):
            print(path)
    if arguments.only is None:
        claims = write_report(results, optima, arguments.output)
        print(arguments.output / 'README.md')
    else:
        claims = [claim for figure in figures for claim in claims_of(figure, results, optima)]
    for number, claim in enumerate(claims, 1):
        print(f'\n{number}. [{claim.figure}] {claim.claim}')
        print(f'   {claim.computed}')
        print(f'   -> {claim.verdict}')
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome(
        'reproduce_paper', lambda: _run(arguments), 'interrupted; no unfinished file is left'
    )


if __name__ == '__main__':
    sys.exit(run('reproduce_paper', main))
