"""
Ten thousand gaps from 10 to 60 m, five hundred cycles of each, on one and on two threads.

    python benchmarks/ensemble.py [--count 10000] [--cycles 500] [--threads 1 2] [--json FILE]

All are run from rest in compiled code by `run_ensemble`. What comes out of a gap is the same
whatever the number of threads, which is checked. The set-up is what all rigs take that run for no
time. On a machine that does other work, read the CPU time.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from simulator import CASES

from impact_damper_ros.control import run_ensemble
from impact_damper_ros.rig import RigParameters

GAPS = 10.0, 60.0
ROUNDS = 3
#: The golden cases, and the first one with eight harmonics more.
NINE = {
    'force_amplitudes': (1.0,) + (0.05,) * 8,
    'force_frequencies': tuple(1.0 + 0.1 * k for k in range(9)),
    'force_phases': (0.0,) * 9,
}
RIGS = {case.name: case.changes for case in CASES} | {
    'nine harmonics': {**CASES[0].changes, **NINE}
}


def run_all(changes: dict[str, Any], count: int, cycles: int, threads: int) -> dict[str, Any]:
    """Run all gaps of a case; of the times the best of some rounds."""
    rig = RigParameters(**changes)
    end = cycles * 2.0 * np.pi / rig.force_frequencies[0]
    gaps = {'gap': np.linspace(*GAPS, count)}
    seconds, spent, set_up = [], [], []
    for _ in range(ROUNDS):
        began = perf_counter()
        run_ensemble(rig, gaps, 0.0, [0.0], threads=threads)
        set_up.append(perf_counter() - began)
        began, cpu = perf_counter(), process_time()
        result = run_ensemble(rig, gaps, end, [end], threads=threads)
        seconds.append(perf_counter() - began)
        spent.append(process_time() - cpu)
    return {
        'seconds': min(seconds),
        'cpu_seconds': min(spent),
        'set_up_seconds': min(set_up),
        'failed': int(np.count_nonzero(result.outcomes)),
        'events': int(result.event_counts.sum()),
        'cycles_per_second': count * cycles / min(seconds),
        'samples': result.samples.tobytes().hex(),
    }


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--count', type=int, default=10_000, help='gaps')
    parser.add_argument('--cycles', type=int, default=500, help='forcing cycles of each')
    parser.add_argument('--threads', type=int, nargs='+', default=[1, 2])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    for name, changes in RIGS.items():
        rows = {
            threads: run_all(changes, arguments.count, arguments.cycles, threads)
            for threads in arguments.threads
        }
        first = rows[arguments.threads[0]]
        same = first['samples']
        for threads, row in rows.items():
            print(
                f'{name}, {arguments.count} gaps x {arguments.cycles} cycles, {threads} '
                f'thread{"s" * (threads > 1)}: {row["seconds"]:.2f} s, '
                f'{row["cpu_seconds"]:.2f} s of CPU, '
                f'{row["cycles_per_second"]:.3g} cycles/s, '
                f'set-up {row["set_up_seconds"] / arguments.count * 1e6:.1f} us a rig, '
                f'{row["set_up_seconds"] / row["seconds"]:.3f} of all, {row["failed"]} failed, '
                f'{"same" if row.pop("samples") == same else "OTHER"} results, '
                f'{first["seconds"] / row["seconds"]:.2f} times as fast as the first'
            )
        results[name] = rows
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    return int(any(row['failed'] for rows in results.values() for row in rows.values()))


if __name__ == '__main__':
    sys.exit(main())
