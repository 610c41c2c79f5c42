"""The motion of a run as arrays, and what it amounts to over a stretch of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ['Motion', 'Stretch', 'measure']

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


@dataclass(frozen=True)
class Stretch:
    """
    What happened in a stretch of time.

    Attributes
    ----------
    start, end : float
        The stretch, s.
    largest : float
        Largest sampled |X - mean X|, m.
    impacts : int
        Number of impacts.
    impacts_per_cycle : float
        The same per cycle of the force.
    impulse : float
        Mean impulse of an impact, N s; 0 without impacts.
    """

    start: float
    end: float
    largest: float
    impacts: int
    impacts_per_cycle: float
    impulse: float


def measure(motion: Motion, start: float, end: float, cycle: float) -> Stretch:
    """
    Measure a stretch of a run.

    Parameters
    ----------
    motion : Motion
        The run.
    start, end : float
        The stretch, s, without its end: a sample there may already show the next change.
    cycle : float
        Period of the force, s.

    Raises
    ------
    ValueError
        If no sample lies in the stretch.
    """
    inside = (motion.time >= start) & (motion.time < end)
    if not inside.any():
        raise ValueError(f'no samples from {start:g} s to {end:g} s: the run has none there')
    hits = (motion.impact_time >= start) & (motion.impact_time < end)
    x = motion.x[inside]
    count = int(hits.sum())
    return Stretch(
        start=start,
        end=end,
        largest=float(np.abs(x - x.mean()).max()),
        impacts=count,
        impacts_per_cycle=count * cycle / (end - start),
        impulse=float(motion.impact_impulse[hits].mean()) if count else 0.0,
    )
