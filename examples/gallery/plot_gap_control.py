"""
Gap control at four levels of the force
=======================================

The force on the bench rig is 0.6 N, 1.2 N, 2.4 N and 4.8 N, for 20 s each. A gap of 24 mm is
right for the second level only. The timed law closes each stop on m where M is fastest, and holds
the vibration at the same share of that without a damper at every level.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import GapControlParameters, Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

parameters, _, settings = load_parameters('bench_rig')
timed = GapControlParameters(**{**settings, 'gap_control': 'timed'})
levels, lasts = (0.6, 1.2, 2.4, 4.8), 20.0
cycle = 2.0 * np.pi / parameters.force_frequencies[0]  # s

figure, axes = plt.subplots()
for control, label in ((None, 'gap of 24 mm'), (timed, 'timed law')):
    rig = Rig(parameters.replace(force_amplitudes=levels[0]), control=control)
    samples = []
    for i, level in enumerate(levels):
        rig.change(parameters.replace(force_amplitudes=level))
        end = (i + 1) * lasts
        samples.append(rig.run(end, instants=np.arange(rig.time, end, cycle / 40)).samples)
    samples = np.concatenate(samples)
    # The largest |X| of each cycle
    whole = len(samples) // 40 * 40
    largest = np.abs(samples['x'][:whole]).reshape(-1, 40).max(axis=1)
    axes.plot(samples['time'][:whole:40], 1e3 * largest, label=label)
for i, level in enumerate(levels):
    alone = 1e3 * level / (parameters.damping * parameters.omega)
    name = 'without impacts' if i == 0 else None
    axes.plot([i * lasts, (i + 1) * lasts], [alone, alone], '--', color='0.5', label=name)
    axes.text((i + 0.5) * lasts, 1.0, f'{level} N', ha='center', fontsize=7)
axes.set(xlabel='time, s', ylabel='largest |X| of a cycle, mm', yscale='log', xlim=(0.0, 80.0))
axes.set(ylim=(0.8, 200.0))
axes.legend(loc='upper left')
plt.savefig('gap_control.png')
plt.show()
