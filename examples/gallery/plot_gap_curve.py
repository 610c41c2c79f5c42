"""
The gap curve: stable and unstable branches
===========================================

Each periodic motion is the solution of a boundary-value problem, so it can be followed through
the gap where it is unstable (dashed) and no rig settles into it. Motions with two and three
impacts per cycle of the frictionless rig a little above its resonance, and the bifurcations on
their way. A branch ends at a grazing: beyond it the rig cannot perform the motion.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import find_orbits, follow, load_parameters

plt.style.use('print.mplstyle')  # beside this script

parameters, _, _ = load_parameters('bench_rig')
rig = parameters.replace(friction=0.0, force_frequencies=1.02 * parameters.omega)

figure, axes = plt.subplots(figsize=(3.5, 2.8))
marks = {}
for stops, start, color in (((1, 2), 0.02, 'C0'), ((1, 1, 2), 0.011, 'C1')):
    orbit = find_orbits(rig.replace(gap=start), stops).orbits[0]
    branch = follow(orbit, 'gap', 0.004, 0.04)
    gap, x = 1e3 * np.array(branch.values), 1e3 * np.array([o.x_max for o in branch.orbits])
    axes.plot([], [], color=color, label=f'{len(stops)} impacts per cycle')
    for status, part in branch.parts():
        if status != 'not viable':
            look = {'ls': '-'} if status == 'stable' else {'ls': '--', 'lw': 0.8}
            axes.plot(gap[part], x[part], color=color, **look)
    for point in branch.special:
        marks.setdefault(point.kind.value, []).append((1e3 * point.value, 1e3 * point.orbit.x_max))
for (name, points), shape in zip(marks.items(), 'os^Dv', strict=False):
    axes.plot(*np.transpose(points), shape, color='k', mfc='white', mew=0.8, label=name)
axes.set(xlabel='gap d, mm', ylabel='largest |X|, mm', ylim=(0.0, None))
axes.legend()
plt.savefig('gap_curve.png')
plt.show()
