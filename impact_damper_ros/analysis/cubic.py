"""Cubics through recorded positions and velocities, between two knots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .run_curves import Array

__all__ = ['CubicSwing', 'cubic_rates', 'cubic_swing', 'turning_points']

# Four points of Gauss integrate the square of a cubic exactly
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


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


class CubicSwing(NamedTuple):
    """
    Displacement along cubics, between their ends.

    Attributes
    ----------
    largest : float
        Largest |X| where X turns between two ends, m; 0 if it does not.
    total, squares : float
        Integrals of X, m s, and of its square, m^2 s.
    """

    largest: float
    total: float
    squares: float


def cubic_swing(span: Array, start: Array, end: Array, v_0: Array, v_1: Array) -> CubicSwing:
    """
    Measure how X moves along the cubics between knots.

    Parameters
    ----------
    span : ndarray of shape (n,)
        Durations, s.
    start, end : ndarray of shape (n,)
        X at both ends, m.
    v_0, v_1 : ndarray of shape (n,)
        X' there, times the duration, m.
    """
    rise = end - start
    square, cube = 3.0 * rise - 2.0 * v_0 - v_1, v_0 + v_1 - 2.0 * rise

    def at(s: Array) -> Array:
        value: Array = start + s * (v_0 + s * (square + s * cube))
        return value

    largest = 0.0
    # X' = v_0 + 2 square s + 3 cube s^2, its two roots in the form that does not cancel
    root = np.sqrt(np.maximum(square * square - 3.0 * cube * v_0, 0.0))
    half = -(square + np.copysign(root, square))
    with np.errstate(divide='ignore', invalid='ignore'):
        for s in (half / (3.0 * cube), v_0 / half):
            inside = (s > 0.0) & (s < 1.0)
            if inside.any():
                largest = max(largest, float(np.abs(at(np.where(inside, s, 0.0))).max()))
    total = squares = 0.0
    # Sums and not products of vectors, whose bits depend on the number of threads
    for place, weight in zip(0.5 * (1.0 + _GAUSS), 0.5 * _WEIGHTS, strict=True):
        value = at(np.full_like(start, place))
        total += weight * float(np.sum(value * span))
        squares += weight * float(np.sum(value * value * span))
    return CubicSwing(largest, total, squares)
