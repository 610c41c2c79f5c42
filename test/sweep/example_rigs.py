"""Rigs with motions that tests of steady states look for."""

from impact_damper_ros import InitialConditions, RigParameters

#: One-sided and vertical; m comes to rest by chatter in each cycle, if it starts on the stop.
CHATTERING = RigParameters(
    angle=1.5708,
    one_sided=True,
    gap=1.0,
    gravity=1.0,
    damping=0.1,
    damper_mass=0.01,
    force_amplitudes=1.15 * 0.99,
    force_frequencies=10.0,
)
ON_THE_STOP = InitialConditions(initial_damper_offset=0.5)
