"""Cubics through recorded positions and velocities, between two knots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .run_curves import Array

__all__ = ['cubic_rates', 'turning_points']


def cubic_rates(step: Array, rise: Array, begin: Array, end: Array) -> tuple[Array, Array]:
    """
    Return b and a of the cubic's velocity begin + b s + a s^2, with s from 0 to 1.

    Parameters
    ----------
    step, rise : ndarray of shape (n,)
        Duration and displacement from one knot to the next.
    begin, end : ndarray of shape (n,)
        Velocities there.
    """
    mean = rise / step
    return 2.0 * (3.0 * mean - 2.0 * begin - end), 3.0 * (begin + end - 2.0 * mean)


def turning_points(
    step: Array, rise: Array, begin: Array, end: Array
) -> tuple[NDArray[np.intp], Array]:
    """
    Return where the velocity changes sign between two knots.

    Parameters
    ----------
    step, rise, begin, end : ndarray of shape (n,)
        As for `cubic_rates`.

    Returns
    -------
    intervals : ndarray of int, shape (t,)
        The intervals with a turn.
    displacement : ndarray of shape (t,)
        Displacement from the first knot to the turn.
    """
    turns = np.flatnonzero(begin * end < 0.0)
    step, v_0 = step[turns], begin[turns]
    b, a = cubic_rates(step, rise[turns], v_0, end[turns])
    # Between velocities of different signs there is one root.
    root = np.sqrt(np.maximum(b * b - 4.0 * a * v_0, 0.0))
    s = 2.0 * v_0 / (-b + np.copysign(root, v_0))
    out: Array = step * s * (v_0 + s * (b / 2.0 + s * a / 3.0))
    return turns, out
