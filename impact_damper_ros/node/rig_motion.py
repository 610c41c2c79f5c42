# SPDX-License-Identifier: Apache-2.0
"""
The motion of a rig from tick to tick, as messages.

A rig that takes long to the next tick is moved in slices. Each slice ends at a whole nanosecond,
where the rig can be changed, reset or paused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, inf, nextafter
from time import monotonic_ns, thread_time_ns

from impact_damper_ros.bag.rig_topics import RigMessages
from impact_damper_ros.control.act import Action, ControlAct
from impact_damper_ros.motion.event import Event, EventKind
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import RunawayError

from .motion_trace import MotionTrace
from .publishing import OutgoingMessage, RigPublishers

#: Failures of rigs that are admissible, but absurd.
RIG_FAILURES = (RunawayError, ArithmeticError, ValueError)
#: Wall time of a slice, which few rigs need for a tick, and least computing time of a slice: a
#: stalled machine does not interrupt the rig.
SLICE_NS = 20_000_000
GRACE_NS = 15_000_000
#: Most events in one period of the fastest of spring and force.
MOST_IN_PERIOD = 5000


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


class RigMotion:
    """Moves a rig and encodes its messages."""

    def __init__(self, rig: Rig, publishers: RigPublishers, trace: MotionTrace) -> None:
        #: Replaced at each change
        self.trace = trace
        # Counts so far; commands are those of the gap control
        self.events = self.impacts = self.commands = 0
        self.last_act: ControlAct | None = None
        self._rig = rig
        self._publishers = publishers
        self._encoder = RigMessages()

    def move_to(
        self, time_ns: int, target_ns: int, offset_ns: int
    ) -> tuple[int, list[OutgoingMessage]]:
        """
        Move the rig from an instant to a later one, at most by one slice.

        Returns the rig time reached, ns, and the impacts and acts of the gap control on the way.
        """
        mark = self._rig.mark()
        try:
            reached_ns, events, acts = self._move(time_ns, target_ns)
        except RIG_FAILURES:
            self._rig.go_back(mark)
            raise
        return reached_ns, self.messages_of(events, acts, offset_ns)

    def _move(self, time_ns: int, target_ns: int) -> tuple[int, list[Event], Sequence[ControlAct]]:
        rig = self._rig
        events = rig.advance(target_ns / 1e9, MOST_IN_PERIOD, _slice())
        acts = rig.acts
        if rig.time >= target_ns / 1e9:
            return target_ns, events, acts
        # The end is beyond the present instant, even if the events so far round to it: a change
        # among them could not be replayed.
        later = max(rig.time, nextafter(time_ns / 1e9, inf))
        reached_ns = min(target_ns, ceil(later * 1e9))
        while reached_ns / 1e9 < later:
            reached_ns += 1
        events += rig.advance(reached_ns / 1e9, MOST_IN_PERIOD)
        return reached_ns, events, [*acts, *rig.acts]

    def messages_of(
        self, events: Sequence[Event], acts: Sequence[ControlAct], offset_ns: int
    ) -> list[OutgoingMessage]:
        """Count events and acts; return the messages of impacts, then those of acts."""
        if events:
            self.events += len(events)
            self.trace = self.trace.after(events)
        self.impacts += sum(event.kind is EventKind.IMPACT for event in events)
        self.commands += sum(act.action is Action.COMMAND for act in acts)
        for act in acts:
            if act.action is not Action.ORDER:
                self.last_act = act
        deflection = self._rig.parameters.static_deflection
        return [
            OutgoingMessage(self._publishers[key], content, stamp_ns)
            for key, content, stamp_ns in self._encoder.events(offset_ns, events, acts, deflection)
        ]

    def states(self, stamp_ns: int) -> bytes:
        """Return the joint states of the tick that the rig is at."""
        rig, sample = self._rig.parameters, self._rig.sample()
        self.trace.sample(sample)
        return self._encoder.states(stamp_ns, sample, rig.static_deflection, rig.angle)

    def paused_states(self, stamp_ns: int) -> bytes:
        """Return the joint states of a rig that stands still, with the present stamp."""
        rig, sample = self._rig.parameters, self._rig.sample()
        return self._encoder.paused_states(stamp_ns, sample, rig.static_deflection, rig.angle)
