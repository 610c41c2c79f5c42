"""
The phase of the force, found from a recorded motion.

The impulse of the force in an interval is what the momentum of M and m together gains, beside what
spring, dashpot and weight take. Impacts, friction and air are forces between the two and drop out.
It is linear in the sine and the cosine of the phase, which are found by least squares.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .recorded_stretch import ForceClock, RecordedStretch

_MOST_STATES = 4000
#: Share of the impulses that the force may leave unexplained, and the modulus of its phase.
_LEFT, _MODULUS = 1e-2, 0.5


def with_fitted_clock(stretch: RecordedStretch) -> RecordedStretch:
    """
    Return a stretch with the phase of its force.

    The clock stays unknown if the force is not one harmonic, or does not explain the motion.
    """
    rig, states = stretch.parameters, stretch.states[:_MOST_STATES]
    if len(states) < 4 or not rig.periodic_force or len(rig.force_phases) > 1:
        return stretch
    start, step = float(states.time[0]), np.diff(states.time)
    momentum = rig.primary_mass * states.velocity + rig.damper_mass * states.damper_velocity
    weight = rig.damper_mass * rig.gravity * math.sin(rig.angle)
    # The integral of the cubic through both ends
    mean = 0.5 * (states.x[1:] + states.x[:-1]) - step / 12.0 * np.diff(states.velocity)
    impulse = np.diff(momentum) + rig.damping * np.diff(states.x)
    impulse += (rig.stiffness * mean - weight) * step
    time = states.time - start
    amplitude, frequency, phase = (part[0] for part in rig.harmonics)
    parts = np.stack(
        [
            -amplitude / frequency * np.diff(np.cos(frequency * time + phase + turn))
            for turn in (0.0, 0.5 * math.pi)
        ]
    )
    found, *_ = np.linalg.lstsq(parts.T, impulse, rcond=None)
    cosine, sine = found.tolist()
    left = impulse - found @ parts
    explained = float(np.linalg.norm(left)) < _LEFT * float(np.linalg.norm(impulse))
    if not explained or abs(math.hypot(sine, cosine) - 1.0) > _MODULUS:
        return stretch
    return replace(stretch, clock=ForceClock(rig, start, (math.atan2(sine, cosine),)))
