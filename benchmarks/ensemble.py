"""
Ten thousand gaps from 10 to 60 m, five hundred cycles of each, on one and on two cores.

    python benchmarks/ensemble.py [--count 10000] [--cycles 500] [--workers 1 2] [--json FILE]

Each gap is a rig of its own, run from rest in compiled code. Workers are processes that take the
gaps in blocks; what comes out of a gap is the same whoever has run it, which is checked. On a
machine that does other work, read the CPU time: workers that do not wait for one another have
together no more of it than one. What two processes gain on such a machine with arithmetic alone,
which shares neither memory nor anything else, is printed first, and again after each case.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from floor_chain import chain
from simulator import CASES

from impact_damper_ros.control import Outcome, Rig
from impact_damper_ros.rig import RigParameters

BLOCK = 125
GAPS = 10.0, 60.0


def load() -> None:
    """Have the compiled code, and nothing else to do later."""
    Rig(RigParameters(), compiled=True).run(1.0)
    chain()


def run_block(
    changes: dict[str, Any], gaps: list[float], cycles: int
) -> tuple[int, int, bytes, float]:
    """Return how many rigs did not come to the end, all events, the last states, CPU time."""
    began, failed, events = process_time(), 0, 0
    state = hashlib.sha256()
    rig = RigParameters(**changes)
    end = cycles * 2.0 * np.pi / rig.force_frequencies[0]
    for gap in gaps:
        stretch = Rig(rig.replace(gap=gap), compiled=True).run(end, [end], record=False)
        failed += stretch.outcome != Outcome.COMPLETE
        events += stretch.event_count
        state.update(stretch.samples.tobytes())
    return failed, events, state.digest(), process_time() - began


def run_all(
    pool: ProcessPoolExecutor, changes: dict[str, Any], count: int, cycles: int
) -> dict[str, Any]:
    """Run all gaps of a case."""
    gaps = np.linspace(*GAPS, count).tolist()
    blocks = [gaps[k : k + BLOCK] for k in range(0, count, BLOCK)]
    began = perf_counter()
    jobs = [pool.submit(run_block, changes, block, cycles) for block in blocks]
    results = [job.result() for job in jobs]
    seconds = perf_counter() - began
    digest = hashlib.sha256(b''.join(result[2] for result in results)).hexdigest()
    return {
        'seconds': seconds,
        'cpu_seconds': sum(result[3] for result in results),
        'failed': sum(result[0] for result in results),
        'events': sum(result[1] for result in results),
        'cycles_per_second': count * cycles / seconds,
        'digest': digest,
    }


def arithmetic(count: int) -> None:
    """Keep a processor busy with nothing but arithmetic."""
    chain()(count)


def arithmetic_seconds(pool: ProcessPoolExecutor, parts: int = 40) -> float:
    """Return the least wall time of the same arithmetic in parts, whoever does them, s."""
    best = float('inf')
    for _ in range(3):
        began = perf_counter()
        for job in [pool.submit(arithmetic, 200_000) for _ in range(parts)]:
            job.result()
        best = min(best, perf_counter() - began)
    return best


def say_arithmetic(pools: dict[int, ProcessPoolExecutor]) -> dict[int, float]:
    """Print how much faster the workers are with arithmetic alone; return their seconds."""
    seconds = {workers: arithmetic_seconds(pool) for workers, pool in pools.items()}
    first = next(iter(seconds.values()))
    for workers, spent in list(seconds.items())[1:]:
        print(f'arithmetic alone: {workers} workers are {first / spent:.2f} times as fast')
    return seconds


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--count', type=int, default=10_000, help='gaps')
    parser.add_argument('--cycles', type=int, default=500, help='forcing cycles of each')
    parser.add_argument('--workers', type=int, nargs='+', default=[1, 2])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    load()
    results: dict[str, Any] = {}
    pools = {
        workers: ProcessPoolExecutor(workers, get_context('fork'), load)
        for workers in arguments.workers
    }
    results['arithmetic'] = [say_arithmetic(pools)]
    for case in CASES:
        results[case.name] = {
            workers: run_all(pool, case.changes, arguments.count, arguments.cycles)
            for workers, pool in pools.items()
        }
        rows = results[case.name]
        first = rows[arguments.workers[0]]
        for workers, row in rows.items():
            print(
                f'{case.name}, {arguments.count} gaps x {arguments.cycles} cycles, {workers} '
                f'worker{"s" * (workers > 1)}: {row["seconds"]:.2f} s, '
                f'{row["cpu_seconds"]:.2f} s of CPU, '
                f'{row["cycles_per_second"]:.3g} cycles/s, {row["failed"]} failed, '
                f'{"same" if row["digest"] == first["digest"] else "OTHER"} results, '
                f'{first["seconds"] / row["seconds"]:.2f} times as fast as the first'
            )
        results['arithmetic'].append(say_arithmetic(pools))
    for pool in pools.values():
        pool.shutdown()
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    return int(any(row['failed'] for case in CASES for row in results[case.name].values()))


if __name__ == '__main__':
    sys.exit(main())
