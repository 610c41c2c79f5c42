"""Rigs that have impacts without end: whoever runs one has to stop it."""

import math

from rigs import LIVELY

from impact_damper_ros import InitialConditions, RigParameters

_RIG = LIVELY.replace(gravity=0.0)
_NEXT_TO_THE_STOP = InitialConditions(initial_damper_offset=0.005 - 1.25e-13)
#: Bounces of 0.1 pm under 1e4 m/s^2: 1e8 impacts per second.
_HAMMERING = _RIG.replace(angle=math.pi / 2, gravity=1e4, one_sided=True, restitution_1=1.0)
ENDLESS = {
    'weight': (_HAMMERING, _NEXT_TO_THE_STOP),
    'high frequency': (
        _HAMMERING.replace(force_amplitudes=1e4, force_frequencies=1e5),
        _NEXT_TO_THE_STOP,
    ),
    'air': (
        _RIG.replace(air_force=1e9, restitution_1=1.0, restitution_2=1.0),
        InitialConditions(initial_damper_velocity=1.0),
    ),
    'tiny gap': (
        _RIG.replace(gap=1e-9, restitution_1=1.0, restitution_2=1.0),
        InitialConditions(initial_damper_velocity=1.0),
    ),
}
#: m flies from stop to stop faster than anybody could follow: 1e18 impacts per second.
RUNAWAY = (
    RigParameters(gap=1e-9, restitution_1=1.0, restitution_2=1.0, gravity=0.0),
    InitialConditions(initial_damper_velocity=1e9),
)
