# SPDX-License-Identifier: Apache-2.0
"""
Restitution, friction and gap from the jumps of M alone, by a robust linear regression.

The equations of the flights from stop to stop are linear in these (`orbits.flight_regressors`): no
start value is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.flight_regressors import flight_regressors

from .partition import Jumps
from .unknowns import Unknowns
from .vibration import Array

_ROUNDS = 60


def regress(
    unknowns: Unknowns, jumps: Jumps, stops: NDArray[np.int64], rate: float
) -> tuple[Array, float, float]:
    """Return alpha of both stops, the grip and the gap from flights from stop to stop."""
    ratio = unknowns.rig.primary_mass / unknowns.rig.damper_mass
    span = np.diff(jumps.time)
    direction = -stops[:-1]
    push = unknowns.slope + direction * unknowns.air
    transit = stops[1:] != stops[:-1]
    z = jumps.velocity[:-1] - ratio * jumps.jump[:-1]
    laws = flight_regressors(jumps.time, jumps.jump, stops, direction)
    size = 2 if unknowns.separate else 1
    at_stop = [stops == 1, stops == -1] if unknowns.separate else [np.ones(len(stops), bool)]
    alphas = [laws[..., 0] * own[:-1, None] + laws[..., 1] * own[1:, None] for own in at_stop]
    columns = np.stack([*alphas, laws[..., 2], laws[..., 3]], axis=-1)
    matrix = np.vstack([columns[:, 0], rate * columns[:, 1]])[np.tile(transit, 2)]
    wanted = -np.concatenate(
        [
            z + push * span - jumps.velocity[1:],
            rate * (z * span + 0.5 * push * span**2 - np.diff(jumps.x)),
        ]
    )[np.tile(transit, 2)]
    if not unknowns.normal > 0.0:
        matrix[:, size] = 0.0  # so that least squares give no friction
    weight = np.ones(len(wanted))
    found = np.zeros(size + 2)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(matrix * weight[:, None], wanted * weight, rcond=None)[0]
        left = matrix @ found - wanted
        spread = 1.4826 * np.median(np.abs(left)) + 1e-12 * rate
        weight = 1.0 / (1.0 + (left / (2.0 * spread)) ** 2)
    alpha = np.clip(found[:size], unknowns.alpha(1.0), None)
    return np.resize(alpha, 2), max(float(found[-2]), 0.0), abs(float(found[-1]))
