"""How far the primary mass swings in a stretch of a run, between its samples too."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig.long_run import Stretch

__all__ = ['StretchSwing', 'stretch_swing']

Array = NDArray[np.float64]

# Four points of Gauss integrate the square of a cubic exactly
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class StretchSwing(NamedTuple):
    """
    Displacement of M over a stretch.

    Attributes
    ----------
    largest : float
        Largest |X|, m.
    mean, rms : float
        Mean and root mean square of X, m.
    """

    largest: float
    mean: float
    rms: float


def stretch_swing(stretch: Stretch) -> StretchSwing:
    """
    Measure how M swings from the first sample to the last.

    Between two neighbours, samples or events, X is the cubic through both with their velocities,
    so that the error falls with the fourth power of the sampling interval; see `Swing`.
    """
    samples = stretch.samples
    within = stretch.events['time'] > samples['time'][0]
    events = stretch.events[within & (stretch.events['time'] <= samples['time'][-1])]
    time = np.concatenate([events['time'], samples['time']])
    # At the same instant a sample shows what the event has left
    order = np.argsort(time, kind='stable')
    time = time[order]
    x = np.concatenate([events['x'], samples['x']])[order]
    after = samples['primary_velocity']
    arriving = np.concatenate([events['primary_velocity_before'], after])[order]
    leaving = np.concatenate([events['primary_velocity_after'], after])[order]

    span = np.diff(time)
    kept = span > 0.0
    span = span[kept]
    start, end = x[:-1][kept], x[1:][kept]
    rise, v_0, v_1 = end - start, leaving[:-1][kept] * span, arriving[1:][kept] * span
    square, cube = 3.0 * rise - 2.0 * v_0 - v_1, v_0 + v_1 - 2.0 * rise

    def at(s: Array) -> Array:
        value: Array = start + s * (v_0 + s * (square + s * cube))
        return value

    largest = float(np.abs(x).max())
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
    whole = float(time[-1] - time[0])
    return StretchSwing(largest, total / whole, math.sqrt(squares / whole))
