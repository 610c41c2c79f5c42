"""
What the engine notes of the motion: the impacts, and how far M swings between them.

It costs the tick next to nothing, since only impacts and turning points of M are kept; whoever
wants to know more looks at them in another thread.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from impact_damper_ros.analysis.rhythm import turned_cycles
from impact_damper_ros.analysis.swing import extremes
from impact_damper_ros.rig import Event, EventKind, RigParameters, Sample

__all__ = ['MotionTrace']

#: Impacts and turning points that are kept: of some dozens of periods.
KEPT = 1024


class MotionTrace:
    """
    The motion of a rig since it was last changed or reset.

    The engine's thread writes; any other may read, since what it reads is copied at once.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    snapshot : mapping
        Its snapshot at the beginning.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    began : float
        Rig time at the beginning, s.
    """

    def __init__(self, parameters: RigParameters, snapshot: Mapping[str, Any]) -> None:
        """Begin without impacts."""
        self.parameters = parameters
        self.began: float = snapshot['time']
        self._turned = turned_cycles(snapshot)
        self._frequency = parameters.force_frequencies[0] / math.tau
        self._impacts: deque[Event] = deque(maxlen=KEPT)
        self._turns: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: Sample | None = None
        self._passed: Sequence[Event] = ()

    def events(self, events: Sequence[Event]) -> None:
        """Take all events since the last sample."""
        self._passed = events
        for event in events:
            if event.kind is EventKind.IMPACT:
                self._impacts.append(event)

    def sample(self, sample: Sample) -> None:
        """Take the next sample."""
        last, self._last = self._last, sample
        if last is None:
            self._passed = ()
        elif self._passed or last.primary_velocity * sample.primary_velocity < 0.0:
            for x in extremes(last, self._passed, sample):
                self._turns.append((sample.time, abs(x)))
            self._passed = ()

    # For other threads

    @property
    def time(self) -> float:
        """Rig time of the last sample, s."""
        return self._last.time if self._last is not None else self.began

    def cycles(self, time: float) -> float:
        """Return the angle of the first harmonic at an instant (s), in cycles since its zero."""
        return self._turned + (time - self.began) * self._frequency

    def impacts(self) -> list[Event]:
        """Return the last impacts."""
        return list(self._impacts)

    def largest(self, since: float) -> float:
        """Return the largest |X| from an instant (s) on, m."""
        turns = list(self._turns)
        within = [x for time, x in turns if time >= since]
        if self._last is not None:
            within.append(abs(self._last.x))
        return max(within, default=0.0)
