"""
A controller that looks for the best gap
========================================

It knows nothing of the rig but the vibration of M. Every 5 s it makes the gap wider or narrower
by 6 %, and turns round when the rms of X has grown. The force on the bench rig grows from 1.2 N to
2.8 N in three steps; a gap of 24 mm is right for the first level only. As a node of ROS 2 the
controller would send the same orders over the topic ``stop_commands``.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import GapControlParameters, Order, Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

parameters, _, settings = load_parameters('bench_rig')
parameters = parameters.replace(gap=0.024)
external = GapControlParameters(**{**settings, 'gap_control': 'external', 'gap_max': 0.2})
levels, lasts, looks, rate = (1.2, 1.6, 2.1, 2.8), 200.0, 5.0, 100.0  # N, s, s, Hz


def run(factor):
    """Return a table of instant, gap and rms of X, for a factor between two gaps."""
    rig = Rig(parameters, control=external, compiled=None)
    gap, last, table = parameters.gap, np.inf, []
    for level in levels:
        rig.change(parameters.replace(force_amplitudes=level), external)
        for _ in range(round(lasts / looks)):
            begun, end = rig.time, rig.time + looks
            seen = rig.run(end, instants=np.arange(begun, end, 1.0 / rate)).samples
            rms = np.sqrt(np.mean(seen['x'] ** 2))
            table.append((end, gap, rms))
            if rms > last:
                factor = 1.0 / factor
            last, gap = rms, min(gap * factor, 0.2)
            rig.order(Order(stop_1=0.5 * gap, stop_2=-0.5 * gap))
    return np.array(table).T


figure, (above, below) = plt.subplots(2, 1, sharex=True)
for factor, label in ((1.0, 'gap of 24 mm'), (1.06, 'looking for the best')):
    time, gap, rms = run(factor)
    above.plot(time, 1e3 * rms, label=label)
    below.step(time, 1e3 * gap)
for i, level in enumerate(levels):
    below.text((i + 0.5) * lasts, 4.0, f'{level} N', ha='center', fontsize=7)
above.set(ylabel='rms of X, mm', ylim=(0.0, None))
above.legend(loc='upper left')
below.set(xlabel='time, s', ylabel='gap, mm', xlim=(0.0, lasts * len(levels)), ylim=(0.0, None))
plt.savefig('controllers.png')
plt.show()
