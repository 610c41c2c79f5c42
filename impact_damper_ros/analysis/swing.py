"""How far the primary mass swings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from impact_damper_ros.rig import Event, Sample

__all__ = ['Swing']


class Swing:
    """
    Largest displacement of M, from samples in a row and the events between them.

    Between two samples without an event X is taken as the cubic through both with their
    velocities, so that the error falls with the fourth power of the sampling interval.

    Attributes
    ----------
    largest : float
        Largest |X| so far, m.
    """

    def __init__(self) -> None:
        self.largest = 0.0
        self._last: Sample | None = None

    def look(self, sample: Sample, events: Sequence[Event]) -> None:
        """Take the next sample and the events since the one before."""
        last = self._last
        self._last = sample
        self.largest = max([self.largest, abs(sample.x), *(abs(e.x) for e in events)])
        if last is None or events or last.primary_velocity * sample.primary_velocity >= 0.0:
            return
        step = sample.time - last.time
        rise = (sample.x - last.x) / step
        v_0, v_1 = last.primary_velocity, sample.primary_velocity
        a, b = 3.0 * (v_0 + v_1 - 2.0 * rise), 2.0 * (3.0 * rise - 2.0 * v_0 - v_1)
        # The cubic's velocity v_0 + b s + a s^2 changes sign once in 0 < s < 1.
        root = math.sqrt(max(b * b - 4.0 * a * v_0, 0.0))
        s = 2.0 * v_0 / (-b + math.copysign(root, v_0))
        x = last.x + step * s * (v_0 + s * (b / 2.0 + s * a / 3.0))
        self.largest = max(self.largest, abs(x))
