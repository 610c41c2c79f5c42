"""
Basins of attraction
====================

A little above its resonance a rig with friction has two steady motions: two impacts per cycle, or
none, with m carried along by friction. Which of them is reached depends on the displacement and
the velocity of M at the start; m starts in the middle of the gap, at rest. Around the motion
without impacts its basin is whole; elsewhere the two are finely mixed. One start of a hundred has
not settled after 60 cycles; it is counted by its impacts.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

from impact_damper_ros import InitialConditions, Rig, load_parameters

plt.style.use('print.mplstyle')  # beside this script

parameters, _, _ = load_parameters('bench_rig')
frequency = 1.05 * parameters.omega
rig = parameters.replace(damping=4.0, friction=0.1, gap=0.014, force_frequencies=frequency)
cycle = 2.0 * np.pi / frequency  # s
places = np.linspace(-0.012, 0.012, 48)  # m
rates = np.linspace(-0.4, 0.4, 48)  # m/s


def impacts_per_cycle(x, velocity):
    """Return how often m hits a stop in a cycle, in the end."""
    start = InitialConditions(initial_primary_position=x, initial_primary_velocity=velocity)
    moving = Rig(rig, start, compiled=None)  # compiled, where numba is installed
    moving.run(50 * cycle, record=False)
    return len(moving.run(60 * cycle).impacts()) / 10.0


count = np.array([[impacts_per_cycle(x, velocity) for x in places] for velocity in rates])

figure, axes = plt.subplots(figsize=(3.5, 2.8))
axes.grid(False)
colors = ListedColormap(['#f0d9c4', '#0072b2'])
axes.pcolormesh(1e3 * places, rates, count > 1.0, cmap=colors, shading='nearest')
axes.plot([], [], 's', color=colors(0), label='without impacts')
axes.plot([], [], 's', color=colors(1), label='two impacts per cycle')
axes.set(xlabel='X at the start, mm', ylabel='velocity of M at the start, m/s')
figure.legend(loc='outside upper center', ncols=2, markerscale=2.0)
plt.savefig('basin.png')
plt.show()
