"""
Bifurcation diagram in the gap
==============================

At which phases of the force does m hit the stops? One column of points for each gap, from rest:
lines where the motion repeats, a cloud where it does not. Two impacts per cycle, half a cycle
apart, are lost just beyond the best gap.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

COLORS = {1: '#00848c', 2: '#7a4fb5'}  # of the stops

parameters, _, _ = load_parameters('bench_rig')
cycle = 2.0 * np.pi / parameters.force_frequencies[0]  # s

figure, axes = plt.subplots()
for gap in np.linspace(0.004, 0.04, 181):
    rig = Rig(parameters.replace(gap=gap))
    rig.run(150 * cycle, record=False)
    impacts = rig.run(190 * cycle).impacts()
    for stop, color in COLORS.items():
        phases = impacts['time'][impacts['stop'] == stop] / cycle % 1.0
        axes.plot(np.full(len(phases), 1e3 * gap), phases, '.', color=color, ms=1.4, mew=0.0)
for stop, color in COLORS.items():
    axes.plot([], [], 's', color=color, label=f'stop {stop}')
axes.set(xlabel='gap d, mm', ylabel='phase of the impacts, cycles', ylim=(0.0, 1.0))
axes.legend(loc='upper center')
plt.savefig('bifurcation.png')
plt.show()
