"""
Ten thousand gaps from 10 to 60 m, five hundred cycles of each, on one and on two threads.

    python benchmarks/ensemble.py [--count 10000] [--cycles 500] [--threads 1 2] [--json FILE]

All are run from rest in compiled code by `run_ensemble`. What comes out of a gap is the same
whatever the number of threads, which is checked. The set-up is what all rigs take that run for no
time. On a machine that does other work, read the CPU time.
"""

from __future__ import annotations

import sys
from functools import partial
from math import tau
from time import perf_counter, process_time
from typing import Any

import numpy as np
from golden_cases import CASES
from timing import in_turns, options, table, write_results

from impact_damper_ros import GapControlParameters, RigParameters, run_ensemble

GAPS = 10.0, 60.0
#: The golden cases, and the first one with eight harmonics more, and under control.
NINE = {
    'force_amplitudes': (1.0,) + (0.05,) * 8,
    'force_frequencies': tuple(1.0 + 0.1 * k for k in range(9)),
    'force_phases': (0.0,) * 9,
}
RIGS = {case.name: case.changes for case in CASES} | {
    'nine harmonics': {**CASES[0].changes, **NINE},
    'timed law': CASES[0].changes,
}
TIMED = GapControlParameters(gap_control='timed', gap_control_rate=5.0)


def main() -> int:
    """Run and print."""
    parser = options(__doc__ or '', rounds=3)
    parser.add_argument('--count', type=int, default=10_000, help='gaps')
    parser.add_argument('--cycles', type=int, default=500, help='forcing cycles of each')
    parser.add_argument('--threads', type=int, nargs='+', default=[1, 2])
    arguments = parser.parse_args()
    count = arguments.count
    results: dict[str, Any] = {}
    failed = 0
    for name, changes in RIGS.items():
        rig = RigParameters(**changes)
        gaps = {'gap': np.linspace(*GAPS, count)}
        end = arguments.cycles * tau / rig.force_frequencies[0]
        law = TIMED if name == 'timed law' else None

        def calls(
            end: float, rig: RigParameters = rig, gaps: Any = gaps, law: Any = law
        ) -> dict[str, Any]:
            return {
                f'{n} thread{"s" * (n > 1)}': partial(
                    run_ensemble, rig, gaps, end, [end], control=law, threads=n
                )
                for n in arguments.threads
            }

        found = [run() for run in calls(end).values()]
        if any(one.samples.tobytes() != found[0].samples.tobytes() for one in found):
            raise SystemExit('the results depend on the number of threads')
        failed += int(np.count_nonzero(found[0].outcomes))
        idle = in_turns(calls(0.0), arguments.rounds, f'{name}, set-up', perf_counter)
        wall = in_turns(calls(end), arguments.rounds, name, perf_counter)
        cpu = in_turns(calls(end), 1, f'{name}, CPU', process_time)
        least = {n: min(times) for n, times in wall.items()}
        rows = [
            (
                n,
                f'{least[n]:.2f}',
                f'{min(cpu[n]):.2f}',
                f'{count * arguments.cycles / least[n]:.3g}',
                f'{1e6 * min(idle[n]) / count:.1f}',
                f'{next(iter(least.values())) / least[n]:.2f}',
            )
            for n in least
        ]
        print(f'\n{name}\n')
        print(table(('', 'wall [s]', 'CPU [s]', 'cycles/s', 'set-up [us/rig]', 'gain'), rows))
        results[name] = {'set_up': idle, 'wall': wall, 'cpu': cpu}
    print(f'\n{count} gaps, {arguments.cycles} cycles each; {failed} rigs failed')
    write_results(arguments.json, results)
    return int(failed > 0)


if __name__ == '__main__':
    sys.exit(main())
