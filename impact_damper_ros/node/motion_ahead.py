"""
The motion of a rig, and its joint states some ticks ahead of what has gone out.

Between two events the motion is a closed formula, so that nothing but a request can change what
the joint states of the next ticks will be. They are made in one go, for two reasons: a processor
that has slept for a millisecond has lost the code and data of the last time, and the first sample
after that takes ten times as long as the second; and a tick whose message lies ready is not late.

Some rigs take longer to the next tick than anybody would wait for. So they are moved in slices,
each of which ends at a whole nanosecond: there all that can be done to a rig can be done to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import ceil
from time import monotonic_ns, thread_time_ns
from typing import NamedTuple

from impact_damper_ros.control import ControlledRig, ControlRecord
from impact_damper_ros.rig import Event, Sample
from impact_damper_ros.rig.hybrid_motion import RunawayError

from .measured_motion import MotionTrace
from .pacing import TickGrid
from .publishing import Happening, TickMessages

__all__ = ['RIG_FAILURES', 'MotionAhead', 'Moved', 'ticks_ahead']


#: What a rig may end in that nobody should have made, but that is admissible.
RIG_FAILURES = (RunawayError, ArithmeticError, ValueError)
#: Wall time of a slice, which few rigs need for a tick, and the computing time for which it goes
#: on after that: a machine that stands still is no reason to interrupt the rig.
SLICE_NS = 20_000_000
GRACE_NS = 15_000_000
#: Most events on the way to the next whole nanosecond.
MOST_WITHIN_NS = 1000

#: Joint states are made for so much wall time ahead, no longer than a nap of the pacer, and for so
#: many ticks at most.
SPAN_NS = 20_000_000
MOST_TICKS = 20
#: The same after an event, when the search for the next one has taken some of the time.
AFTER_EVENT = 4


def ticks_ahead(period_ns: int, real_time_factor: float) -> int:
    """Return for how many ticks joint states should be made in one go."""
    return max(1, min(MOST_TICKS, int(SPAN_NS * (real_time_factor or 1.0) / period_ns)))


class Moved(NamedTuple):
    """
    A move of the rig.

    Attributes
    ----------
    time_ns : int
        Rig time that it has come to: the next tick, or one before it.
    happenings : list of Happening
        What has to go out before the joint states of that tick.
    """

    time_ns: int
    happenings: list[Happening]


def _slice() -> Callable[[], bool]:
    """Return what asks whether a slice is over that begins now."""
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
    Move a rig from tick to tick.

    The rig itself stands at the tick before the first one that is known, or earlier in the same
    flight: before anything is done to it, it has to be put to the present tick by `stand_at`, and
    afterwards `discard` forgets what is not true any more.

    Parameters
    ----------
    rig : ControlledRig
        The rig.
    messages : TickMessages
        Makes the messages.
    grid : TickGrid
        The instants of the ticks.
    trace : MotionTrace
        Takes note of the motion.
    most : int
        For how many ticks joint states are made in one go.

    Attributes
    ----------
    trace : MotionTrace
        What the rig has done since it was last changed or reset, and will have done by the last
        tick that is known; to be replaced at a change.
    known : deque of bytes
        Joint states of the next ticks, as far as they are known.
    events : int
        How many the rig has had so far.
    """

    def __init__(
        self,
        rig: ControlledRig,
        messages: TickMessages,
        grid: TickGrid,
        trace: MotionTrace,
        most: int,
    ) -> None:
        """Know nothing yet."""
        self.trace = trace
        self._rig = rig
        self._messages = messages
        self._grid = grid
        self._most = most
        self.known: deque[bytes] = deque()
        self.events = 0

    def move_to(self, time_ns: int, tick: int, offset_ns: int) -> Moved:
        """Move the rig to the next tick without known joint states, at most by one slice."""
        mark = self._rig.mark()
        try:
            return self._move(time_ns, tick, offset_ns, _slice())
        except RIG_FAILURES:
            self._rig.go_back(mark)
            raise

    def _move(
        self, time_ns: int, tick: int, offset_ns: int, interrupted: Callable[[], bool]
    ) -> Moved:
        rig, due_ns = self._rig, self._grid.instant(tick)
        events, records = rig.advance(due_ns / 1e9, interrupted=interrupted), rig.records
        reached_ns = due_ns
        if rig.time < due_ns / 1e9:
            reached_ns = min(due_ns, max(time_ns, ceil(rig.time * 1e9)))
            while reached_ns / 1e9 < rig.time:
                reached_ns += 1
            events += rig.advance(reached_ns / 1e9, MOST_WITHIN_NS)
            records = [*records, *rig.records]
            if rig.time < reached_ns / 1e9:
                raise RunawayError(MOST_WITHIN_NS, rig.time)
        instants, samples = [], []
        if reached_ns == due_ns:
            most = min(self._most, AFTER_EVENT) if events else self._most
            instants = [self._grid.instant(tick + i) for i in range(most)]
            samples = rig.preview([instant / 1e9 for instant in instants], interrupted)
            samples = samples or [rig.sample()]
        happenings = self.passed(events, records, offset_ns)
        deflection = rig.parameters.static_deflection
        for instant, sample in zip(instants, samples, strict=False):
            self.known.append(self._message(offset_ns + instant, sample, deflection))
        return Moved(reached_ns, happenings)

    def passed(
        self, events: Sequence[Event], records: Sequence[ControlRecord], offset_ns: int
    ) -> list[Happening]:
        """Take note of what the rig has gone through; return it as messages."""
        if events:
            self.events += len(events)
            self.trace = self.trace.after(events)
        deflection = self._rig.parameters.static_deflection
        return self._messages.happenings(events, records, offset_ns, deflection)

    def take_states(self, time_ns: int, offset_ns: int) -> bytes:
        """Return the joint states of the tick that is due, at an instant of rig time, once."""
        return self.known.popleft() if self.known else self.states(time_ns, offset_ns)

    def states(self, time_ns: int, offset_ns: int) -> bytes:
        """Return the joint states of the tick at which the rig stands, made anew."""
        deflection = self._rig.parameters.static_deflection
        return self._message(offset_ns + time_ns, self._rig.sample(), deflection)

    def paused_states(self, stamp_ns: int) -> bytes:
        """Return the joint states of a rig that is held where it stands, with a stamp of now."""
        deflection = self._rig.parameters.static_deflection
        return self._messages.paused_states(stamp_ns, self._rig.sample(), deflection)

    def stand_at(self, time_ns: int) -> None:
        """Put the rig to a tick, up to which nothing happens to it that is not known."""
        time = time_ns / 1e9
        if self._rig.time < time:
            self._rig.advance(time)

    def discard(self) -> None:
        """Forget the joint states that are known: the rig or the stamps are about to change."""
        self.known.clear()

    def _message(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        self.trace.sample(sample)
        return self._messages.states(stamp_ns, sample, deflection)
