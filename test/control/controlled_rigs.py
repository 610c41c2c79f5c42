"""The controlled rig of the design trials."""

from __future__ import annotations

import math
from typing import Any

from impact_damper_ros import GapControlParameters, Rig, RigParameters

#: zeta = 0.01, mu = 0.1, R = 0.5, at resonance and level: X = 50 without impacts.
TRIAL = RigParameters(
    damping=0.02, damper_mass=0.1, restitution_1=0.5, restitution_2=0.5, gravity=0.0, gap=20.0
)
#: X over that without impacts, at best: zeta/(zeta + zeta_eq).
_ZETA_EQ = 2.0 / math.pi * 0.1 / 1.1 * 1.5 / 0.5
IDEAL = 0.01 / (0.01 + _ZETA_EQ)


def control(mode: str, **values: Any) -> GapControlParameters:
    """Return a control that samples some thirty times a cycle of a rig of unit frequency."""
    return GapControlParameters(gap_control=mode, **{'gap_control_rate': 5.0, **values})


def amplitude_ratio(rig: Rig, cycles: int, watched: int) -> float:
    """Return the rms amplitude of X in the last cycles, over that of the rig without impacts."""
    cycle = math.tau / rig.parameters.force_frequencies[0]
    begun = rig.time + (cycles - watched) * cycle
    rig.run(begun, record=False)
    instants = [begun + k * cycle / 32 for k in range(1, 32 * watched + 1)]
    x = rig.run(instants[-1], instants, record=False).samples['x']
    return math.sqrt(2.0 * float((x**2).mean())) / rig.parameters.response_amplitude
