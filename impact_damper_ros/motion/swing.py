# SPDX-License-Identifier: Apache-2.0
"""Displacement of the primary mass: its turning points between samples, and largest |X|."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .event import Event, Sample


def turning_point(
    time_0: float, x_0: float, v_0: float, time_1: float, x_1: float, v_1: float
) -> float:
    """
    Return X where M turns between two instants at which its velocities have opposite signs.

    X is the cubic through both with their velocities; the error falls with the fourth power of
    the time between them.
    """
    step = time_1 - time_0
    if step <= 0.0:
        return x_1
    rise = (x_1 - x_0) / step
    # In parts of the largest velocity, since squares of very small ones are 0
    largest = max(abs(v_0), abs(v_1), abs(rise))
    first, last, mean = v_0 / largest, v_1 / largest, rise / largest
    a, b = 3.0 * (first + last - 2.0 * mean), 2.0 * (3.0 * mean - 2.0 * first - last)
    # The cubic's velocity, first + b s + a s^2, changes sign once in 0 < s < 1.
    root = math.copysign(math.sqrt(max(b * b - 4.0 * a * first, 0.0)), first)
    if root * b > 0.0:
        s = -(b + root) / (2.0 * a)
    else:
        s = 2.0 * first / ((root - b) or 1.0)
    return x_0 + step * largest * s * (first + s * (b / 2.0 + s * a / 3.0))


def positions_passed(last: Sample, events: Sequence[Event], sample: Sample) -> list[float]:
    """Return X at all events between two samples, and wherever M turns."""
    positions = []
    time, x, velocity = last.time, last.x, last.primary_velocity
    for event in events:
        if velocity * event.primary_velocity_before < 0.0:
            positions.append(
                turning_point(
                    time, x, velocity, event.time, event.x, event.primary_velocity_before
                )
            )
        time, x, velocity = event.time, event.x, event.primary_velocity_after
        positions.append(x)
    after = sample.primary_velocity
    if velocity * after < 0.0:
        positions.append(turning_point(time, x, velocity, sample.time, sample.x, after))
    return positions


class Swing:
    """
    Largest displacement of M, from samples in a row and the events between them.

    Attributes
    ----------
    largest : float
        Largest |X| so far, m.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> rig, swing = Rig(RigParameters(gravity=0.0)), Swing()
    >>> for instant in (10.0, 20.0, 30.0):
    ...     events = rig.advance(instant)
    ...     swing.look(rig.sample(), events)
    >>> round(swing.largest, 6)
    25.457471
    """

    def __init__(self) -> None:
        self.largest = 0.0
        self._last: Sample | None = None

    def look(self, sample: Sample, events: Sequence[Event]) -> None:
        """Take the next sample and the events since the one before."""
        if self._last is None:
            passed = [event.x for event in events]
        else:
            passed = positions_passed(self._last, events, sample)
        self._last = sample
        self.largest = max(self.largest, abs(sample.x), *map(abs, passed))
