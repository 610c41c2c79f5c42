# SPDX-License-Identifier: Apache-2.0
"""
The equations of the flights of m as a linear regression.

After impact i m has the velocity z = v_i + alpha_i J_i - (M/m) J_i, where v is the velocity of M
before an impact, J its jump there, and alpha = (M + m)/(m (1 + R)). It reaches the next impact e
after T, with s the acceleration along the axis, and lambda the sign of its sliding, if

    z + (s - lambda f) T = v_e + alpha_e J_e,
    z T + (s - lambda f) T^2/2 = x_e - x_i + (p_e - p_i) d,

p being 1/2 on stop 1 and -1/2 on stop 2. Both are linear in alpha, in the deceleration f by
friction, and in the gap d.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def flight_regressors(time: Array, jump: Array, stop: NDArray[Any], slides: NDArray[Any]) -> Array:
    """
    Return the factors of the unknowns in the equations of flights between neighbouring impacts.

    Parameters
    ----------
    time, jump, stop : ndarray, shape (n + 1,)
        Instant of each impact, the jump of X' there, and +1 or -1 for stop 1 or 2.
    slides : ndarray, shape (n,)
        Sign lambda of the sliding in each flight, in which m does not reverse.

    Returns
    -------
    ndarray, shape (n, 2, 4)
        For each flight, in the equation of velocities (m/s) and in that of places (m): the factors
        of alpha of the first and of the second impact, of f and of d. All other terms are on the
        other side.
    """
    span = np.diff(time)
    none = np.zeros(len(span))
    speed = [jump[:-1], -jump[1:], -slides * span, none]
    place = [jump[:-1] * span, none, -0.5 * slides * span**2, -0.5 * np.diff(stop)]
    return np.stack([np.stack(speed, axis=-1), np.stack(place, axis=-1)], axis=1)
