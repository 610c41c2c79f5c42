# SPDX-License-Identifier: Apache-2.0
"""
Restitution, friction and gap from the jumps of M alone, by a robust linear regression.

After impact i m has the velocity z = v_i + alpha_i J_i - (M/m) J_i, and it reaches impact e on the
other stop after T, with s the acceleration along the axis, if

    z + (s - lambda f) T = v_e + alpha_e J_e,
    z T + (s - lambda f) T^2/2 = x_e - x_i + p_e - p_i,

which is linear in alpha, f and the gap d: no start value is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .partition import Jumps
from .unknowns import Unknowns
from .vibration import Array

_ROUNDS = 60


def regressed(
    unknowns: Unknowns, jumps: Jumps, stops: NDArray[np.int64], rate: float
) -> tuple[Array, float, float]:
    """Return alpha of both stops, the grip and the gap from flights that cross the gap."""
    ratio = unknowns.rig.primary_mass / unknowns.rig.damper_mass
    span = np.diff(jumps.time)
    direction = -stops[:-1]
    push = unknowns.slope + direction * unknowns.air
    crossing = stops[1:] != stops[:-1]
    jump, z = jumps.jump, jumps.velocity[:-1] - ratio * jumps.jump[:-1]
    size = 2 if unknowns.separate else 1
    at_stop = [stops == 1, stops == -1] if unknowns.separate else [np.ones(len(stops), bool)]
    alphas = np.array([jump * own for own in at_stop]).T
    speed = np.column_stack([alphas[:-1] - alphas[1:], -direction * span, 0.0 * span])
    place = np.column_stack(
        [alphas[:-1] * span[:, None], -0.5 * direction * span**2, -0.5 * np.diff(stops)]
    )
    matrix = np.vstack([speed, rate * place])[np.tile(crossing, 2)]
    wanted = -np.concatenate(
        [
            z + push * span - jumps.velocity[1:],
            rate * (z * span + 0.5 * push * span**2 - np.diff(jumps.x)),
        ]
    )[np.tile(crossing, 2)]
    if not unknowns.normal > 0.0:
        matrix[:, size] = 0.0  # so that least squares give no friction
    weight = np.ones(len(wanted))
    found = np.zeros(size + 2)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(matrix * weight[:, None], wanted * weight, rcond=None)[0]
        left = matrix @ found - wanted
        spread = 1.4826 * np.median(np.abs(left)) + 1e-12 * rate
        weight = 1.0 / (1.0 + (left / (2.0 * spread)) ** 2)
    least = 1.0 / (2.0 * unknowns.share)
    alpha = np.clip(found[:size], least, None)
    return np.resize(alpha, 2), max(float(found[-2]), 0.0), abs(float(found[-1]))
