"""
Time history at the best gap
============================

The bench rig with a gap of 27 mm starts from rest under a force at its resonance. Without impacts
its vibration would grow to 30 mm (dashed: the envelope). With the damper it soon comes to two
impacts per cycle, near the passages of X through zero.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

bench, _, _ = load_parameters('bench_rig')
parameters = bench.replace(gap=0.027)
end = 10.0
run = Rig(parameters).run(end, instants=np.arange(0.0, end, 0.002))
samples, impacts = run.samples, run.impacts()
x0 = parameters.force_amplitudes[0] / (parameters.damping * parameters.omega)
decay = 0.5 * parameters.damping / parameters.primary_mass

figure, (above, below) = plt.subplots(2, 1, figsize=(3.5, 3.6))
envelope = 1e3 * x0 * (1.0 - np.exp(-decay * samples['time']))
above.plot(samples['time'], envelope, '--', color='0.5', label='without impacts')
above.plot(samples['time'], 1e3 * samples['x'], lw=0.6, label='X')
above.set(xlabel='time, s', ylabel='X, mm', xlim=(0.0, end))
above.legend(loc='upper left')

late = samples[samples['time'] > end - 0.6]
hits = impacts[impacts['time'] > end - 0.6]
below.plot(late['time'], 1e3 * late['x'], label='X of M')
below.plot(late['time'], 1e3 * late['z'], label='Z of m')
below.plot(late['time'], 1e3 * late['stop_1'], color='0.6', lw=0.7, label='stops')
below.plot(late['time'], 1e3 * late['stop_2'], color='0.6', lw=0.7)
below.plot(hits['time'], 1e3 * (hits['x'] + hits['y']), 'ko', label='impacts')
below.set(xlabel='time, s', ylabel='position, mm', xlim=(end - 0.6, end), ylim=(-20.0, 30.0))
below.legend(ncols=4, loc='upper center', columnspacing=0.8, handlelength=1.2)
plt.savefig('time_history.png')
plt.show()
