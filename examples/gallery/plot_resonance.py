"""
Resonance curve with and without the damper
===========================================

The largest displacement of M over the frequency of the force: without impacts by the formula of a
damped oscillator, with the damper from rest by simulation. The damper works near the resonance,
where the structure needs it. Some three percent below, M moves more than without impacts.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import Rig, load_parameters, settle

plt.style.use('print.mplstyle')  # beside this script

rig, _, _ = load_parameters('bench_rig')
ratios = np.linspace(0.85, 1.15, 101)  # frequency of the force over that of the rig
rigs = [rig.replace(force_frequencies=ratio * rig.omega) for ratio in ratios]
alone = np.array([one.response_amplitude for one in rigs])
motions = [settle(Rig(one), cycles=300, watch=100, tolerance=1e-5) for one in rigs]
largest = np.array([motion.x_max for motion in motions])
repeats = np.array([motion.period is not None for motion in motions])

figure, axes = plt.subplots()
axes.plot(ratios, 1e3 * alone, '--', color='0.5', label='without impacts')
axes.plot(ratios[repeats], 1e3 * largest[repeats], 'o', label='with damper, repeats')
axes.plot(ratios[~repeats], 1e3 * largest[~repeats], 'x', label='with damper, does not repeat')
axes.set(xlabel='frequency ratio r', ylabel='largest |X|, mm', ylim=(0.0, 42.0))
axes.legend(loc='upper left')
plt.savefig('resonance.png')
plt.show()
