# SPDX-License-Identifier: Apache-2.0
"""A measured motion of the primary mass M: the one record that every reader returns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class MeasuredMotion(NamedTuple):
    """
    What was measured of a rig, in SI units.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Instants of the samples, s, rising.
    motion : ndarray, shape (n,)
        Displacement (m), velocity (m/s) or acceleration (m/s^2) of M; any number where `used` is
        False.
    quantity : {'displacement', 'velocity', 'acceleration'}
        What `motion` is.
    used : ndarray of bool, shape (n,)
        False for samples that are saturated or missing.
    force : ndarray, shape (n,), or None
        Force on M, N, if it was measured.
    base : ndarray, shape (n,), or None
        Motion of the base, if it was measured.
    base_quantity : str
        What `base` is; empty without it.
    impact_times : ndarray, shape (k,), or None
        Measured instants of impacts, s, rising; None if none were measured.
    impact_deviation : float
        Standard deviation of an impact time, s.
    source : str
        Where the motion comes from, for messages.
    """

    time: Array
    motion: Array
    quantity: str
    used: NDArray[np.bool_]
    force: Array | None = None
    base: Array | None = None
    base_quantity: str = ''
    impact_times: Array | None = None
    impact_deviation: float = 0.0
    source: str = ''
