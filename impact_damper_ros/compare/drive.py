# SPDX-License-Identifier: Apache-2.0
"""The phase of a force, found from a recorded motion that lacks it."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.orbits.flight_arrays import Drive
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.rows import Samples

_MOST_SAMPLES = 4000
#: Share of the impulses that the force may leave unexplained, and of the modulus of each phase.
_LEFT, _MODULUS = 1e-2, 0.5


def fitted_drive(rig: RigParameters, samples: Samples) -> Drive | None:
    """
    Find the phase of a force of one harmonic from samples; None if it does not explain them.

    The impulse of the force in an interval is what the momentum of M and m together gains, beside
    what spring, dashpot and weight take. Impacts, friction and air are forces between the two and
    drop out. It is linear in sine and cosine of the phase, which are found by least squares.
    """
    samples = samples[:_MOST_SAMPLES]
    if len(samples) < 4 or not rig.periodic_force or len(rig.force_phases) > 1:
        return None
    x, velocity = samples['x'], samples['primary_velocity']
    start, step = float(samples['time'][0]), np.diff(samples['time'])
    momentum = rig.primary_mass * velocity + rig.damper_mass * samples['damper_velocity']
    weight = rig.damper_mass * rig.gravity * math.sin(rig.angle)
    # The integral of the cubic through both ends
    mean = 0.5 * (x[1:] + x[:-1]) - step / 12.0 * np.diff(velocity)
    impulse = np.diff(momentum) + rig.damping * np.diff(x)
    impulse += (rig.stiffness * mean - weight) * step
    amplitude, frequency, phase = (part[0] for part in rig.harmonics)
    angle = frequency * (samples['time'] - start) + phase
    parts = np.stack(
        [-amplitude / frequency * np.diff(np.cos(angle + turn)) for turn in (0.0, 0.5 * math.pi)]
    )
    found, *_ = np.linalg.lstsq(parts.T, impulse, rcond=None)
    cosine, sine = found.tolist()
    left = impulse - found @ parts
    explained = float(np.linalg.norm(left)) < _LEFT * float(np.linalg.norm(impulse))
    if not explained or abs(math.hypot(sine, cosine) - 1.0) > _MODULUS:
        return None
    return Drive(start, (math.atan2(sine, cosine),), rig.harmonics[1])
