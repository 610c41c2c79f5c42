# SPDX-License-Identifier: Apache-2.0
"""
The motion of a rig from tick to tick, and its joint states some ticks ahead.

Between two events the motion is a closed formula, so that only a request can change the joint
states of the next ticks. They are made at once, for two reasons: after a sleep of a millisecond a
processor has lost the code and data from its caches, so that the first sample takes ten times as
long as the second; and a tick whose message is ready is not late.

Some rigs take long to the next tick. They are moved in slices, each of which ends at a whole
nanosecond, where a rig can be changed, reset or paused.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import ceil, inf, nextafter, tau
from time import monotonic_ns, thread_time_ns
from typing import Any

from impact_damper_ros.bag.rig_topics import RigMessages
from impact_damper_ros.control.record import Action, ControlRecord
from impact_damper_ros.motion.event import Event, EventKind, Sample
from impact_damper_ros.motion.swing import extremes
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.event_budget import EventBudget, RunawayError
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.stepped_sine import frequency_at
from impact_damper_ros.rig.tick_grid import TickGrid

from .publishing import OutgoingMessage, RigPublishers

#: Impacts and turning points that are kept: some dozens of periods, or a few with many impacts.
KEPT = 512


class MotionTrace:
    """
    The motion of a rig since its last change or reset, or the last step of its frequency.

    The engine's thread writes. Other threads may read; they copy at once.
    """

    def __init__(
        self, parameters: RigParameters, began: float, turned: float, step: int = 0
    ) -> None:
        self.parameters = parameters
        self.began = began  # rig time, s
        self.frequency = frequency_at(parameters, step)  # circular, of the first harmonic, rad/s
        self.turned = turned  # its angle at the beginning, in cycles since its zero
        self.step = step  # steps of the stepped sine done by then
        self._impacts: deque[Event] = deque(maxlen=KEPT)
        self._turns: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: Sample | None = None
        self._passed: Sequence[Event] = ()

    @classmethod
    def at(cls, parameters: RigParameters, snapshot: Mapping[str, Any]) -> MotionTrace:
        """Begin at a snapshot of the rig."""
        step, origin = snapshot['sweep']['step'], snapshot['origin']
        since = snapshot['time'] - origin['time']
        angle = origin['angles'][0] + frequency_at(parameters, step) * since
        return cls(parameters, snapshot['time'], angle / tau, step)

    def after(self, events: Sequence[Event]) -> MotionTrace:
        """Take all events since the last sample; return the trace from there on."""
        trace, first = self, 0
        for i, event in enumerate(events):
            if event.kind is EventKind.IMPACT:
                trace._impacts.append(event)
            elif event.kind is EventKind.FREQUENCY_STEP:
                turned = trace.cycles(event.time)
                trace = MotionTrace(trace.parameters, event.time, turned, trace.step + 1)
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
        return self.turned + (time - self.began) * self.frequency / tau

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


#: Failures of rigs that are admissible, but absurd.
RIG_FAILURES = (RunawayError, ArithmeticError, ValueError)
#: Wall time of a slice, which few rigs need for a tick, and the computing time that must have
#: passed after that: a stalled machine is no reason to interrupt the rig.
SLICE_NS = 20_000_000
GRACE_NS = 15_000_000
#: Most events on the way to the next whole nanosecond, and to the next tick.
MOST_WITHIN_NS = 1000
MOST_TO_TICK = 5000

#: Wall time for which joint states are made ahead, no longer than a nap of the pacer, and the
#: largest number of ticks.
SPAN_NS = 20_000_000
MOST_TICKS = 20
#: The largest number after an event, as the search for the next one has taken time.
AFTER_EVENT = 4


def ticks_ahead(period_ns: int, real_time_factor: float) -> int:
    """Return the number of ticks for which joint states should be made at once."""
    return max(1, min(MOST_TICKS, int(SPAN_NS * (real_time_factor or 1.0) / period_ns)))


def _slice() -> Callable[[], bool]:
    """Begin a slice; return a function that returns whether it is over."""
    end, grace_end = monotonic_ns() + SLICE_NS, 0

    def over() -> bool:
        nonlocal grace_end
        if monotonic_ns() < end:
            return False
        grace_end = grace_end or thread_time_ns() + GRACE_NS
        return thread_time_ns() > grace_end

    return over


class MotionAhead:
    """
    Moves a rig from tick to tick and encodes its messages.

    The rig itself is at the tick before the first one that is known, or earlier in the same
    flight: before a request changes it, `stand_at` moves it to the present tick, and afterwards
    `discard` drops the joint states that no longer hold.
    """

    def __init__(
        self,
        rig: Rig,
        publishers: RigPublishers,
        grid: TickGrid,
        trace: MotionTrace,
        most: int,
    ) -> None:
        #: Up to the last tick that is known; to be replaced at a change
        self.trace = trace
        #: Joint states of the next ticks
        self.known: deque[bytes] = deque()
        # So far; commands are those of the gap control
        self.events = self.impacts = self.commands = 0
        self.last_act: ControlRecord | None = None
        self._rig = rig
        self._publishers = publishers
        self._encoder = RigMessages()
        self._grid = grid
        #: Largest number of ticks that are made ahead
        self.most = most
        # Of the events on the way to the next tick
        self._budget = EventBudget(MOST_TO_TICK)

    def move_to(
        self, time_ns: int, target_ns: int, tick: int, offset_ns: int
    ) -> tuple[int, list[OutgoingMessage]]:
        """
        Move the rig to an instant, at most by one slice.

        The instant is that of the next tick whose joint states are not known, or an earlier one.
        Returns the rig time reached, ns, and the impacts and acts of the gap control on the way.
        """
        mark = self._rig.mark()
        try:
            return self._move(time_ns, target_ns, tick, offset_ns, _slice())
        except RIG_FAILURES:
            self._rig.go_back(mark)
            raise

    def _move(
        self,
        time_ns: int,
        target_ns: int,
        tick: int,
        offset_ns: int,
        interrupted: Callable[[], bool],
    ) -> tuple[int, list[OutgoingMessage]]:
        rig = self._rig
        events, records = rig.advance(target_ns / 1e9, interrupted=interrupted), rig.records
        reached_ns = target_ns
        if rig.time < target_ns / 1e9:
            # Beyond the present instant, even if the events so far round to it: a change after
            # some of them could not be replayed.
            later = max(rig.time, nextafter(time_ns / 1e9, inf))
            reached_ns = min(target_ns, ceil(later * 1e9))
            while reached_ns / 1e9 < later:
                reached_ns += 1
            events += rig.advance(reached_ns / 1e9, MOST_WITHIN_NS)
            records = [*records, *rig.records]
            if rig.time < reached_ns / 1e9:
                raise RunawayError(MOST_WITHIN_NS, rig.time)
        if reached_ns < target_ns:
            self._budget.take(rig, len(events))
        else:
            self._budget.restart(rig)
        instants, samples = [], []
        if reached_ns == self._grid.instant(tick):
            most = min(self.most, AFTER_EVENT) if events else self.most
            instants = [self._grid.instant(tick + i) for i in range(most)]
            samples = rig.preview([instant / 1e9 for instant in instants], interrupted)
            samples = samples or [rig.sample()]
        messages = self.passed(events, records, offset_ns)
        deflection, angle = rig.parameters.static_deflection, rig.parameters.angle
        for instant, sample in zip(instants, samples, strict=False):
            self.known.append(self._encoded(offset_ns + instant, sample, deflection, angle))
        return reached_ns, messages

    def passed(
        self, events: Sequence[Event], records: Sequence[ControlRecord], offset_ns: int
    ) -> list[OutgoingMessage]:
        """Take note of events and acts; return the messages of impacts, then those of acts."""
        if events:
            self.events += len(events)
            self.trace = self.trace.after(events)
        out = []
        deflection = self._rig.parameters.static_deflection
        for event in events:
            if event.kind is EventKind.IMPACT:
                stamp_ns = offset_ns + round(event.time * 1e9)
                content = self._encoder.impact(stamp_ns, event, deflection)
                out.append(OutgoingMessage(self._publishers['impacts'], content, stamp_ns))
                self.impacts += 1
        for record in records:
            stamp_ns = offset_ns + round(record.time * 1e9)
            content = self._encoder.control(stamp_ns, record)
            out.append(OutgoingMessage(self._publishers['gap_control'], content, stamp_ns))
            self.commands += record.action is Action.COMMAND
            if record.action is not Action.ORDER:
                self.last_act = record
        return out

    def take_states(self, time_ns: int, offset_ns: int) -> bytes:
        """Return the joint states of the tick that is due, and forget them."""
        return self.known.popleft() if self.known else self.states(time_ns, offset_ns)

    def states(self, time_ns: int, offset_ns: int) -> bytes:
        """Encode the joint states of the tick at which the rig is."""
        rig = self._rig.parameters
        sample, stamp_ns = self._rig.sample(), offset_ns + time_ns
        return self._encoded(stamp_ns, sample, rig.static_deflection, rig.angle)

    def paused_states(self, stamp_ns: int) -> bytes:
        """Return the joint states of a paused or held rig, with a stamp of now."""
        rig, sample = self._rig.parameters, self._rig.sample()
        return self._encoder.paused_states(stamp_ns, sample, rig.static_deflection, rig.angle)

    def stand_at(self, time_ns: int) -> None:
        """Move the rig to a tick that no unknown event precedes."""
        time = time_ns / 1e9
        if self._rig.time < time:
            self._rig.advance(time)

    def discard(self) -> None:
        """Drop the joint states that are known: the rig or the stamps are about to change."""
        self.known.clear()
        self._budget.restart(self._rig)

    def _encoded(self, stamp_ns: int, sample: Sample, deflection: float, angle: float) -> bytes:
        self.trace.sample(sample)
        return self._encoder.states(stamp_ns, sample, deflection, angle)
