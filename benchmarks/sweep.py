"""
What sweeps of 100 and of 1,000 gaps take, on one thread and on two, here and at another commit.

    python benchmarks/sweep.py [--beside COMMIT] [--gaps 100 1000] [--rounds 3] [--json FILE]

The command as users run it, its start and its table included: the least time of the rounds by the
clock, and the CPU time with it. The tables of one tree have to be equal to the byte; those of two
trees are compared number by number.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from theory import ROOT, checked_out, run
from timing import options, say, table, write_results


def swept(tree: Path, gaps: int, jobs: int, path: Path) -> tuple[float, float]:
    """Let a tree sweep the bench rig into a table; return time by the clock and CPU time, s."""
    words = ['-m', 'impact_damper_ros.cli.sweep_rig', 'bench_rig', '--quiet', '--overwrite']
    words += ['--vary', f'gap=0.004:0.06:{gaps}', '--jobs', str(jobs), '-o', str(path)]
    ran = run(tree, words)
    return ran.clock, ran.spent


def apart(one: Path, other: Path) -> float:
    """Return by how much the numbers of two tables differ, relative to each column's size."""
    found = 0.0
    tables = [pd.read_csv(path, comment='#') for path in (one, other)]
    for name, column in tables[0].select_dtypes('number').items():
        values = column.to_numpy(float), tables[1][name].to_numpy(float)
        size = np.nanmax(np.abs(values[0]), initial=0.0) or 1.0
        found = max(found, float(np.nanmax(np.abs(values[0] - values[1]), initial=0.0) / size))
    return found


def main() -> int:
    """Measure both and print the table."""
    parser = options(__doc__ or '', 3)
    parser.add_argument('--beside', metavar='COMMIT', help='measure another commit, too')
    parser.add_argument('--gaps', type=int, nargs='+', default=[100, 1000])
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory)
        trees = {'here': ROOT}
        if arguments.beside:
            (place / 'tree').mkdir()
            trees[arguments.beside] = checked_out(arguments.beside, place / 'tree')
        tasks = [(gaps, jobs) for gaps in arguments.gaps for jobs in (1, 2)]
        paths = {
            key: place / f'{"_".join(map(str, key))}.csv'
            for key in ((t, *task) for t in trees for task in tasks)
        }
        for tree in trees.values():
            # What is kept for later runs is compiled before
            swept(tree, 2, 1, place / 'first.csv')
        for turn in range(arguments.rounds):
            say(f'round {turn + 1} of {arguments.rounds}')
            for (name, gaps, jobs), path in paths.items():
                times = swept(trees[name], gaps, jobs, path)
                key = f'{name}, {gaps} gaps, {jobs} thread{"s" * (jobs > 1)}'
                results[key] = min(times, results.get(key, times))
        for name, gaps in ((name, gaps) for name in trees for gaps in arguments.gaps):
            one, two = (paths[name, gaps, jobs].read_bytes() for jobs in (1, 2))
            if one != two:
                raise SystemExit(f'{name}: the table of {gaps} gaps depends on the threads')
            if name != 'here':
                far = apart(paths['here', gaps, 1], paths[name, gaps, 1])
                results[f'{gaps} gaps: largest difference of tables'] = far
    rows = [(key, *(f'{s:.2f}' for s in v)) for key, v in results.items() if isinstance(v, tuple)]
    print(table(['', 'clock [s]', 'CPU [s]'], rows))
    for key, value in results.items():
        if isinstance(value, float):
            print(f'{key}: {value:.1e}')
    write_results(arguments.json, results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
