"""
The periodic solver: solutions per second, and Figure 2 by theory against by simulation.

    python benchmarks/orbits.py [--quick] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import time
from pathlib import Path

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.studies.paper.curves import enumerated_curves, followed_curves, settle
from impact_damper_ros.studies.paper.series import plans_of

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


def figure_2(every: int) -> list[dict]:
    """Time the curves of Figure 2, and simulations to steady state at every n-th of its gaps."""
    rows = []
    for plan in plans_of('2'):
        print(f'  {plan.name} ...', file=sys.stderr, flush=True)
        gaps = plan.values[every // 2 :: every]
        started = time.process_time()
        settled = [settle(Rig(plan.at(gap)), gap) for gap in gaps]
        simulated = (time.process_time() - started) / len(gaps)
        started = time.process_time()
        curves = enumerated_curves(plan)
        two = (time.process_time() - started) / len(plan.values)
        starts = [(m.value, m.orbit) for m in settled if m.orbit is not None and m.cycles == 1]
        for impacts in (3, 4):
            curves += followed_curves(plan, starts, impacts)
        theory = (time.process_time() - started) / len(plan.values)
        rows.append(
            {
                'sweep': plan.name,
                'gaps': len(plan.values),
                'simulated_gaps': len(gaps),
                'settled': sum(motion.cycles == 1 for motion in settled),
                'points': sum(len(curve.points) for curve in curves),
                'two_ms_per_gap': 1e3 * two,
                'theory_ms_per_gap': 1e3 * theory,
                'simulation_ms_per_gap': 1e3 * simulated,
                'ratio_two': simulated / two,
                'ratio': simulated / theory,
            }
        )
    return rows


def main() -> int:
    """Run both and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0].strip())
    parser.add_argument('--quick', action='store_true', help='a few rigs and gaps only')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the numbers')
    arguments = parser.parse_args()
    rigs = 10 if arguments.quick else 60
    print('searches ...', file=sys.stderr, flush=True)
    searches = {}
    for name, rig in GOLDEN.items():
        searches[f'N=2, {name}'] = solutions_per_second(rig, (1, 2), rigs)
        if rig.friction == 0.0:
            searches[f'N=3, {name}'] = solutions_per_second(rig, THREE, rigs // 2)
    print('search (all of N=2; 400 starts for N=3)      rigs  solutions  ms/rig  solutions/s')
    for name, row in searches.items():
        print(
            f'{name:<44} {row["rigs"]:5d}  {row["solutions"]:9d}  '
            f'{row["milliseconds_per_rig"]:6.1f}  {row["solutions_per_second"]:11.0f}'
        )
    rows = figure_2(24 if arguments.quick else 6)
    print('\nFigure 2, CPU milliseconds per gap: theory against simulation to steady state')
    print('sweep               gaps  points   N=2  N=2,3,4  simulation  ratio N=2  ratio all')
    for row in rows:
        print(
            f'{row["sweep"]:<18} {row["gaps"]:5d}  {row["points"]:6d} '
            f'{row["two_ms_per_gap"]:5.1f}  {row["theory_ms_per_gap"]:7.1f}  '
            f'{row["simulation_ms_per_gap"]:10.1f}  {row["ratio_two"]:9.1f}  {row["ratio"]:9.1f}'
        )
    theory = sum(row['theory_ms_per_gap'] * row['gaps'] for row in rows)
    simulated = sum(row['simulation_ms_per_gap'] * row['gaps'] for row in rows)
    print(
        f'whole figure: theory {theory / 1e3:.1f} s, simulation {simulated / 1e3:.1f} s '
        f'(from every {24 if arguments.quick else 6}th gap), ratio {simulated / theory:.1f}; the '
        'theory also has the unstable motions, the simulation one motion per gap'
    )
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({'searches': searches, 'figure_2': rows}, indent=2))
    return 0


if __name__ == '__main__':
    sys.exit(main())
