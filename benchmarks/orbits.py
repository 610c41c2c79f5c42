"""
The periodic solver: searches and branches per second, and settled motions against the theory.

    python benchmarks/orbits.py [--quick] [--rounds RIGS] [--json FILE]
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections import Counter
from pathlib import Path

from timing import options, say, table, write_results

from impact_damper_ros import Rig, RigParameters, find_orbits, follow, settle

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from motion.random_rigs import any_rig

GOLDEN = {
    'horizontal, r=1': RigParameters(gravity=0.0),
    '45 deg, r=1.02': RigParameters(gravity=1.0, angle=math.pi / 4, force_frequencies=(1.02,)),
    '45 deg, friction 0.5, r=1.02': RigParameters(
        gravity=1.0, angle=math.pi / 4, friction=0.5, force_frequencies=(1.02,)
    ),
}
THREE = (1, 1, 2)


def solutions_per_second(rig: RigParameters, stops: tuple[int, ...], rigs: int) -> dict:
    """Time the search over a range of gaps; CPU time of the process."""
    low, high = (25.0, 55.0) if len(stops) == 2 else (13.0, 20.0)
    seconds, found = [], 0
    for k in range(rigs):
        at_gap = rig.replace(gap=low + (high - low) * (k + 0.5) / rigs)
        started = time.process_time()
        search = find_orbits(at_gap, stops, simulate=False)
        seconds.append(time.process_time() - started)
        found += len(search.orbits)
    return {
        'rigs': rigs,
        'solutions': found,
        'milliseconds_per_rig': 1e3 * statistics.median(seconds),
        'solutions_per_second': found / sum(seconds),
    }


def branch_of(rig: RigParameters, repeats: int) -> dict:
    """Time the branch of a motion in the gap, with its special points; the fastest of a few."""
    orbit = find_orbits(rig, (1, 2), simulate=False).orbits[0]
    seconds = []
    for _ in range(repeats):
        started = time.process_time()
        branch = follow(orbit, 'gap', 20.0, 60.0)
        seconds.append(time.process_time() - started)
    return {
        'points': len(branch.points),
        'special': len(branch.special),
        'milliseconds': 1e3 * min(seconds),
    }


def settled_motions(rigs: int) -> dict:
    """Let rigs of any kind settle, and hold what they come to against the theory."""
    kinds: Counter[str] = Counter()
    sizes: Counter[tuple[int, int]] = Counter()
    events: Counter[str] = Counter()
    missed: list[int] = []
    distances, multipliers = [0.0], [0.0]
    for seed in range(rigs):
        found = settle(Rig(any_rig(seed), compiled=None), cycles=1500)
        kinds[found.kind.value] += 1
        if found.rhythm is None:
            continue
        if found.orbit is None:
            missed.append(seed)
            continue
        sizes[found.rhythm.impacts, found.rhythm.cycles] += 1
        events.update({event.kind.name.lower() for event in found.orbit.events})
        # What the tolerance leaves of the transient does not count
        left = 1.0 - min(abs(found.orbit.multipliers[0]), 1.0 - 1e-9)
        distances.append(found.orbit.distance(found.rhythm) * left)
        multipliers.append(abs(abs(found.orbit.multipliers[0]) - found.multiplier) * left)
    return {
        'rigs': rigs,
        'kinds': dict(kinds),
        'impacts_and_cycles': {f'{n},{k}': count for (n, k), count in sorted(sizes.items())},
        'with_events': dict(events),
        'missed_seeds': missed,
        'largest_distance': max(distances),
        'largest_difference_of_a_multiplier': max(multipliers),
    }


def show(head: str, rows: dict) -> None:
    """Print rows of numbers by their names."""
    texts = ([name, *(f'{value:.4g}' for value in row.values())] for name, row in rows.items())
    print(table([head, *next(iter(rows.values()))], texts), end='\n\n')


def main() -> int:
    """Run all and print the tables."""
    arguments = options(__doc__, 60).parse_args()
    rigs = arguments.rounds
    say('searches ...')
    searches = {}
    for name, rig in GOLDEN.items():
        searches[f'N=2, {name}'] = solutions_per_second(rig, (1, 2), rigs)
        if rig.friction == 0.0:
            searches[f'N=3, {name}'] = solutions_per_second(rig, THREE, rigs // 2)
    show('search (all of N=2; 400 starts for N=3)', searches)
    say('branches ...')
    branches = {name: branch_of(rig, 3) for name, rig in GOLDEN.items()}
    show('branch in the gap from 20 to 60 m', branches)
    say('settled motions ...')
    settled = settled_motions(10 * rigs)
    found = sum(settled['impacts_and_cycles'].values())
    print(
        f'{settled["rigs"]} rigs of any kind: '
        + ', '.join(f'{count} {kind}' for kind, count in settled['kinds'].items())
        + f'\ntheory has {found} of the {found + len(settled["missed_seeds"])} motions with '
        f'impacts, to within {settled["largest_distance"]:.1e}, multipliers '
        f'{settled["largest_difference_of_a_multiplier"]:.1e}; '
        + ', '.join(f'{count} with {name}' for name, count in settled['with_events'].items())
        + '\nN,k: '
        + ', '.join(f'{size} ({count})' for size, count in settled['impacts_and_cycles'].items())
    )
    numbers = {'searches': searches, 'branches': branches, 'settled_motions': settled}
    write_results(arguments.json, numbers)
    return 0


if __name__ == '__main__':
    sys.exit(main())
