# SPDX-License-Identifier: Apache-2.0
"""Transmissibility: how much of the motion of its base a rig takes up."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .flight_arrays import Flights
from .response import Array

#: Points in a cycle of the fastest line of the base, or of the rig.
_POINTS = 128
_MOST_POINTS = 2_000_000


class Transmissibility(NamedTuple):
    """
    Motion of M over that of its base; NaN for a base at rest.

    Attributes
    ----------
    absolute : float
        rms X over rms b, each about its mean.
    relative : float
        rms (X - b) over rms b: what the spring, and a strain gauge on it, see.
    """

    absolute: float
    relative: float

    @classmethod
    def of(cls, x: Array, base: Array) -> Transmissibility:
        """Return that of X and b at evenly spaced instants of whole cycles; b moves."""
        moved = np.std(base)
        return cls(float(np.std(x) / moved), float(np.std(x - base) / moved))


def transmissibility(flights: Flights) -> Transmissibility:
    """
    Return the transmissibility over flights, which should last for whole periods.

    X and b are closed formulas, of which the means are taken at evenly spaced instants.
    """
    rig = flights.rig
    base, rows = rig.base_motion, rig.base_rows
    if not base.moves or flights.drive is None or not len(flights):
        return Transmissibility(math.nan, math.nan)
    begin, end = float(flights.rows['time'][0]), float(flights.rows['time'][-1])
    fastest = max(rig.omega, *base.frequencies)
    count = math.ceil((end - begin) * fastest / math.tau * _POINTS)
    count = min(max(count, _POINTS), _MOST_POINTS)
    times = begin + (np.arange(count) + 0.5) * ((end - begin) / count)
    index = np.searchsorted(flights.starts, times, side='right') - 1
    x = flights.motion(index, times - flights.starts[index])[0]
    place = np.zeros(count)
    lines = zip(*base, flights.drive.angles[rows], strict=True)
    for size, rate, phase, angle in lines:
        place += size * np.sin(angle + rate * (times - flights.drive.time) + phase)
    return Transmissibility.of(x, place)
