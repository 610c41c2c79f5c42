"""
Phase portraits with impacts
============================

The velocity of m relative to M over its position in the gap. At each stop the velocity jumps from
an open circle to a full one, to minus R times what it was. In a gap of 24 mm the motion is
periodic, one of 34 mm makes it chaotic.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

parameters, _, _ = load_parameters('bench_rig')
cycle = 2.0 * np.pi / parameters.force_frequencies[0]  # s

figure, panels = plt.subplots(1, 2, figsize=(7.2, 2.8), sharey=True)
for axes, gap, cycles in zip(panels, (0.024, 0.034), (1, 30), strict=True):
    rig = Rig(parameters.replace(gap=gap))
    rig.run(300 * cycle, record=False)
    begin, end = 300 * cycle, (300 + cycles) * cycle
    run = rig.run(end, instants=np.linspace(begin, end, 400 * cycles))
    impacts = run.impacts()
    before = impacts['damper_velocity_before'] - impacts['primary_velocity_before']
    after = impacts['damper_velocity_after'] - impacts['primary_velocity_after']
    # No line across a jump
    times = np.concatenate([run.samples['time'], impacts['time']])
    y = np.concatenate([run.samples['z'] - run.samples['x'], impacts['y']])
    rate = run.samples['damper_velocity'] - run.samples['primary_velocity']
    rate = np.concatenate([rate, np.full(len(impacts), np.nan)])
    order = np.argsort(times)
    axes.plot(1e3 * y[order], rate[order], lw=1.0 if cycles == 1 else 0.4)
    axes.plot(1e3 * impacts['y'], before, 'o', mfc='white', color='C1', mew=0.7, label='before')
    axes.plot(1e3 * impacts['y'], after, 'o', color='C1', label='after an impact')
    for stop in (-0.5e3 * gap, 0.5e3 * gap):
        axes.axvline(stop, color='0.6', lw=0.8)
    axes.set(xlabel='position Y of m in the gap, mm', title=f'gap {1e3 * gap:.0f} mm')
panels[0].set_ylabel("velocity Y', m/s")
panels[1].legend(loc='upper left', bbox_to_anchor=(0.06, 1.0))
plt.savefig('phase_portrait.png')
plt.show()
