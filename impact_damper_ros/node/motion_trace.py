# SPDX-License-Identifier: Apache-2.0
"""The last impacts and turning points of a rig, which are kept for the reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import nan
from typing import Any

from impact_damper_ros.motion.event import Event, EventKind, Sample
from impact_damper_ros.motion.swing import positions_passed
from impact_damper_ros.orbits.transmissibility import Moments, Transmissibility
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.stepped_sine import FirstAngle, SteppedSine, rig_at

#: Numbers of impacts and turning points that are kept: dozens of periods, or a few with many
#: impacts.
KEPT = 512
#: Cycles of the force of which the motion of a moving base and X are kept.
KEPT_CYCLES = 20


class MotionTrace:
    """
    The motion of a rig since its last change or reset, or the last step of its frequency.

    The engine's thread writes. Other threads may read; they copy at once.
    """

    def __init__(
        self, parameters: RigParameters, began: float, angle: FirstAngle, sweep: SteppedSine
    ) -> None:
        self.parameters = parameters
        self.began = began  # rig time, s
        self.present = rig_at(parameters, sweep.step)  # the rig of the present step
        self.frequency = self.present.first_harmonic[1]  # circular, rad/s
        #: Angle of the first harmonic at an instant (s), in cycles since its zero
        self.cycles = angle.at
        self._angle, self._sweep = angle, sweep
        self._impacts: deque[Event] = deque(maxlen=KEPT)
        self._turns: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: Sample | None = None
        self._passed: Sequence[Event] = ()
        # Sums over the samples of each whole cycle, the first and the present one left out
        self._shaken = parameters.base_motion.moves and self.frequency > 0.0
        self._moments: deque[Moments] = deque(maxlen=KEPT_CYCLES)
        self._sums, self._turn = [0.0] * 6, -1

    @classmethod
    def at(cls, parameters: RigParameters, snapshot: Mapping[str, Any]) -> MotionTrace:
        """Begin at a snapshot of the rig."""
        sweep, origin = SteppedSine.of_dict(snapshot['sweep']), snapshot['origin']
        angle = FirstAngle.of(rig_at(parameters, sweep.step), origin['time'], origin['angles'][0])
        return cls(parameters, snapshot['time'], angle, sweep)

    def after(self, events: Sequence[Event]) -> MotionTrace:
        """Take all events since the last sample; return the trace from there on."""
        trace, first = self, 0
        for i, event in enumerate(events):
            if event.kind is EventKind.IMPACT:
                trace._impacts.append(event)
            elif event.kind is EventKind.FREQUENCY_STEP:
                sweep = trace._sweep.following(trace.parameters)
                angle = trace._angle.after_step(event.time, rig_at(trace.parameters, sweep.step))
                trace = MotionTrace(trace.parameters, event.time, angle, sweep)
                first = i + 1
        # Between two ticks there may be several moves of the rig, each with many events.
        before = [] if trace is not self else trace._passed
        trace._passed = [*before, *events[first:]][-KEPT:] if before or first else events
        return trace

    def sample(self, sample: Sample) -> None:
        """Take the next sample, unless it was taken before."""
        last = self._last
        if last is not None and sample.time <= last.time:
            return
        self._last = sample
        if self._shaken:
            self._sum_up(sample)
        if last is None:
            self._passed = ()
        elif self._passed or last.primary_velocity * sample.primary_velocity < 0.0:
            for x in positions_passed(last, self._passed, sample):
                self._turns.append((sample.time, abs(x)))
            self._passed = ()

    def _sum_up(self, sample: Sample) -> None:
        """Add X and b of a sample to the sums of its cycle."""
        turn, x, base = int(self.cycles(sample.time)), sample.x, sample.base
        if turn != self._turn:
            if self._turn > int(self.cycles(self.began)):
                self._moments.append(Moments(*(*self._sums, nan, nan)))
            self._sums, self._turn = [0.0] * 6, turn
        terms = 1.0, x, x * x, base, base * base, x * base
        self._sums = [total + term for total, term in zip(self._sums, terms, strict=True)]

    # For other threads

    @property
    def time(self) -> float:
        """Rig time of the last sample, s."""
        return self._last.time if self._last is not None else self.began

    def impacts(self) -> list[Event]:
        """Return the last impacts."""
        return list(self._impacts)

    def transmissibility(self) -> Transmissibility:
        """Return the transmissibility in the last whole cycles; NaN for a base at rest."""
        kept = list(self._moments)
        return Transmissibility.of_moments(Moments(*map(sum, zip(*kept, strict=True))))

    def largest(self, since: float) -> float:
        """Return the largest |X| from an instant (s) on, m."""
        turns = list(self._turns)
        within = [x for time, x in turns if time >= since]
        if self._last is not None:
            within.append(abs(self._last.x))
        return max(within, default=0.0)
