"""`study_gap_control`: what the laws of the gap control do, measured and drawn."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

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
    from impact_damper_ros.studies.gap_control.runs import Extent, Measured

#: How many times as long it takes without numba.
_WITHOUT_NUMBA = 50

_DESCRIPTION = """\
Run rigs under each law of the gap control and with fixed gaps: over a sixteenfold range of force
at resonance, under broadband excitation, through the resonance up and down, under a changing load,
inclined with friction, and with delays, slow stops, noise and coarse sampling. Writes README.md
with the tables and a PNG file for each part, and prints the targets. On two cores it takes half a
minute, and another minute at the first time, when the simulator is compiled.
"""
_EPILOG = """\
Exit code: 0 on success; 1 if a file could not be written or a process died; 2 if the input is
invalid or matplotlib is missing; 130 on Ctrl-C, 143 on SIGTERM. The numbers are the same every
time. Without numba (extra compiled) the runs take more than 50 times as long.
Example: study_gap_control --output /tmp/gap_control --quick
"""


def _parser() -> argparse.ArgumentParser:
    parser = command_parser('study_gap_control', _DESCRIPTION, _EPILOG)
    add_directory_option(parser, 'docs/gap_control')
    add_jobs_option(parser)
    parser.add_argument('--quick', action='store_true', help='make a few short runs of each part')
    return parser


def _compute(extent: Extent, jobs: int) -> dict[tuple[object, ...], Measured]:
    """Make all runs in processes, with a progress bar for each part."""
    from impact_damper_ros.rig.compiled import has_numba
    from impact_damper_ros.studies.gap_control.findings import tuned_shares
    from impact_damper_ros.studies.gap_control.runs import (
        ANGLES,
        all_cases,
        cost_of,
        run_case,
        tuning_cases,
    )

    results: dict[tuple[object, ...], Measured] = {}
    # The shares do not change how much work there is
    every = [*tuning_cases(extent), *all_cases(extent, dict.fromkeys((0, *ANGLES), 1.0))]
    seconds = sum(map(cost_of, every)) * (1.0 if has_numba() else _WITHOUT_NUMBA)
    say_how_long('study_gap_control', seconds, jobs)
    with process_pool(jobs) as pool:
        for what in ('fixed gaps', 'all runs'):
            shares = tuned_shares(results, extent) if results else {}
            cases = all_cases(extent, shares) if results else tuning_cases(extent)
            done = pool.map(run_case, cases, chunksize=1)
            with work_bar(what, sum(map(cost_of, cases))) as bar:
                for case, one in zip(cases, done, strict=True):
                    results[case.key] = one
                    bar.update(cost_of(case))
    return results


def _run(arguments: argparse.Namespace) -> int:
    from impact_damper_ros.studies.gap_control.findings import targets
    from impact_damper_ros.studies.gap_control.report import write_study
    from impact_damper_ros.studies.gap_control.runs import Extent

    need_matplotlib()
    extent = Extent.quick() if arguments.quick else Extent()
    # Before the work
    check_directory(arguments.output)
    arguments.output.mkdir(parents=True, exist_ok=True)
    results = _compute(extent, arguments.jobs)
    for path in write_study(results, extent, arguments.output):
        print(path)
    for target in targets(results, extent):
        verdict = 'met' if target.met else 'MISSED'
        print(
            f'{verdict}: {target.text}: {target.reached:.4f}, at most {target.limit:g}; with '
            f'stops at finite speed {target.real:.4f}, for which the actuators spend '
            f'{100.0 * target.share:.0f} % of what is dissipated'
        )
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    arguments = _parser().parse_args(argv)
    return outcome('study_gap_control', lambda: _run(arguments))


if __name__ == '__main__':
    sys.exit(run('study_gap_control', main))
