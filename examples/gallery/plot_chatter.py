"""
Chatter
=======

A ball on a table that is shaken so hard that it lifts off once in a cycle. The impacts follow one
another ever faster until the ball rests on the table, after infinitely many impacts in a finite
time; it is released again when the table falls away faster than the ball would. The rest begins
at an instant that is known in closed form.
"""

import matplotlib.pyplot as plt
import numpy as np

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters

plt.style.use('print.mplstyle')  # beside this script

# Upright, with the table below as stop 1 only; the ball is too light to move the table.
omega = 10.0 * np.pi
parameters = RigParameters(
    primary_mass=10.0,
    stiffness=1e5,
    damping=100.0,
    damper_mass=0.001,
    gap=0.2,
    restitution_1=0.3,
    angle=0.5 * np.pi,
    one_sided=True,
    force_amplitudes=1.4 * 9.81 * 1e5 * (1.0 - 1e-4 * omega**2) / omega**2,
    force_frequencies=omega,
)
cycle = 2.0 * np.pi / omega  # s
rig = Rig(parameters, InitialConditions(initial_damper_offset=0.0999))
rig.run(20 * cycle, record=False)
begin, end = 20 * cycle, 22 * cycle
run = rig.run(end, instants=np.linspace(begin, end, 4001))
height = run.samples['stop_1'] - run.samples['z']  # the axis points downwards
time = run.samples['time'] - begin
impacts = run.impacts()
rests = run.events[run.events['kind'] == EventKind.REST]['time'] - begin
leaves = run.events[run.events['kind'] == EventKind.RELEASE]['time'] - begin

figure, axes = plt.subplots()
axes.plot(1e3 * time, 1e3 * height)
axes.plot(1e3 * (impacts['time'] - begin), np.zeros(len(impacts)), 'k|', ms=6, label='impacts')
axes.plot(1e3 * rests, np.zeros(len(rests)), 's', color='C1', label='comes to rest')
axes.plot(1e3 * leaves, np.zeros(len(leaves)), '^', color='C2', label='is released')
axes.set(xlabel='time, ms', ylabel='height of the ball over the table, mm')
axes.set_ylim(-0.3, 6.6)
axes.legend(ncols=3, loc='upper center', columnspacing=1.0)
plt.savefig('chatter.png')
plt.show()
