"""The motion of a run as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ['Motion']

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """
    Sampled motion and impacts of a run.

    Attributes
    ----------
    time, x, z, stop_1, stop_2 : ndarray of shape (n,)
        Time since the start of the run, s; positions of M, m and the stops along the axis, m.
    impact_time, impact_position : ndarray of shape (k,)
        Instants of the impacts, s, and where m then is, m.
    impact_stop : ndarray of shape (k,)
        The stops hit, 1 or 2.
    impact_impulse : ndarray of shape (k,)
        Impulses, N s.
    """

    time: Array
    x: Array
    z: Array
    stop_1: Array
    stop_2: Array
    impact_time: Array
    impact_position: Array
    impact_stop: NDArray[np.int64]
    impact_impulse: Array
