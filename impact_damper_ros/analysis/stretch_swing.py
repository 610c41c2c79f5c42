"""How far the primary mass swings in a stretch of a run, between its samples too."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig.long_run import Stretch

from .cubic import cubic_swing

__all__ = ['StretchSwing', 'stretch_swing']

Array = NDArray[np.float64]


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
    swing = cubic_swing(
        span,
        x[:-1][kept],
        x[1:][kept],
        leaving[:-1][kept] * span,
        arriving[1:][kept] * span,
    )
    largest = max(float(np.abs(x).max()), swing.largest)
    whole = float(time[-1] - time[0])
    return StretchSwing(largest, swing.total / whole, math.sqrt(swing.squares / whole))
