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
from impact_damper_ros.rig.sweep import frequency_at

__all__ = ['MotionTrace']

#: Impacts and turning points that are kept: some dozens of periods, or a few with many impacts.
KEPT = 512


class MotionTrace:
    """
    The motion of a rig since it was last changed or reset, or its frequency was.

    The engine's thread writes; any other may read, since what it reads is copied at once.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    began : float
        Rig time at the beginning, s.
    turned : float
        Angle of the first harmonic then, in cycles since its zero.
    step : int
        Steps of a sweep done by then.

    Attributes
    ----------
    parameters, began
        As given.
    frequency : float
        Of the first harmonic, rad/s.
    """

    def __init__(
        self, parameters: RigParameters, began: float, turned: float, step: int = 0
    ) -> None:
        """Begin without impacts."""
        self.parameters = parameters
        self.began = began
        self.frequency = frequency_at(parameters, step)
        self._turned = turned
        self._step = step
        self._impacts: deque[Event] = deque(maxlen=KEPT)
        self._turns: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: Sample | None = None
        self._passed: Sequence[Event] = ()

    @classmethod
    def at(cls, parameters: RigParameters, snapshot: Mapping[str, Any]) -> MotionTrace:
        """Begin at a snapshot of the rig."""
        step = snapshot['sweep']['step']
        turned = turned_cycles(snapshot, frequency_at(parameters, step))
        return cls(parameters, snapshot['time'], turned, step)

    def after(self, events: Sequence[Event]) -> MotionTrace:
        """Take all events since the last sample, and return the trace that goes on from there."""
        trace, first = self, 0
        for i, event in enumerate(events):
            if event.kind is EventKind.IMPACT:
                trace._impacts.append(event)
            elif event.kind is EventKind.FREQUENCY_STEP:
                turned = trace.cycles(event.time)
                trace = MotionTrace(trace.parameters, event.time, turned, trace._step + 1)
                first = i + 1
        # Between two ticks far apart there may be several moves of the rig, and any many events.
        before = [] if trace is not self else trace._passed
        trace._passed = [*before, *events[first:]][-KEPT:] if before or first else events
        return trace

    def sample(self, sample: Sample) -> None:
        """Take the next sample; one that was taken before is left alone."""
        last = self._last
        if last is not None and sample.time <= last.time:
            return
        self._last = sample
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
        return self._turned + (time - self.began) * self.frequency / math.tau

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
