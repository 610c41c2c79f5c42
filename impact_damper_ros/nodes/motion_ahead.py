"""
The motion of a rig, and its joint states some ticks ahead of what has gone out.

Between two events the motion is a closed formula, so that nothing but a request can change what
the joint states of the next ticks will be. They are made in one go, for two reasons: a processor
that has slept for a millisecond has lost the code and data of the last time, and the first sample
after that takes ten times as long as the second; and a tick whose message lies ready is not late.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from impact_damper_ros.control import ControlledRig
from impact_damper_ros.nodes.motion_trace import MotionTrace
from impact_damper_ros.nodes.pacing import TickGrid
from impact_damper_ros.nodes.tick_messages import Happening, TickMessages
from impact_damper_ros.rig import Event, Sample

__all__ = ['MotionAhead', 'ticks_ahead']

#: Joint states are made for so much wall time ahead, no longer than a nap of the pacer, and for so
#: many ticks at most.
SPAN_NS = 20_000_000
MOST_TICKS = 20
#: The same after an event, when the search for the next one has taken some of the time.
AFTER_EVENT = 4


def ticks_ahead(period_ns: int, real_time_factor: float) -> int:
    """
    Return for how many ticks joint states should be made in one go.

    Parameters
    ----------
    period_ns : int
        Rig time between two ticks.
    real_time_factor : float
        Rig seconds per wall second; 0 for as fast as possible.
    """
    return max(1, min(MOST_TICKS, int(SPAN_NS * (real_time_factor or 1.0) / period_ns)))


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

    def move_to(self, tick: int, offset_ns: int) -> list[Happening]:
        """
        Move the rig to the next tick, whose joint states are not known.

        Parameters
        ----------
        tick : int
            Number of the tick.
        offset_ns : int
            Stamp of rig time 0.

        Returns
        -------
        list of Happening
            What has to go out before the joint states of that tick.
        """
        events = self._rig.advance(self._grid.instant(tick) / 1e9)
        happenings = self.passed(events, offset_ns)
        self._look_ahead(tick, offset_ns, min(self._most, AFTER_EVENT) if events else self._most)
        return happenings

    def passed(self, events: Sequence[Event], offset_ns: int) -> list[Happening]:
        """Take note of what the rig has gone through; return it as messages."""
        if events:
            self.trace = self.trace.after(events)
        deflection = self._rig.parameters.static_deflection
        return self._messages.happenings(events, self._rig.records, offset_ns, deflection)

    def take_states(self, time_ns: int, offset_ns: int) -> bytes:
        """Return the joint states of the tick that is due, at an instant of rig time, once."""
        return self.known.popleft() if self.known else self.states(time_ns, offset_ns)

    def states(self, time_ns: int, offset_ns: int) -> bytes:
        """Return the joint states of the tick at which the rig stands, made anew."""
        deflection = self._rig.parameters.static_deflection
        return self._message(offset_ns + time_ns, self._rig.sample(), deflection)

    def stand_at(self, time_ns: int) -> None:
        """Put the rig to a tick, up to which nothing happens to it that is not known."""
        time = time_ns / 1e9
        if self._rig.time < time:
            self._rig.advance(time)

    def discard(self) -> None:
        """Forget the joint states that are known: the rig or the stamps are about to change."""
        self.known.clear()

    def _look_ahead(self, tick: int, offset_ns: int, most: int) -> None:
        """Make the joint states of the tick at which the rig stands, and more as far as known."""
        instants = [self._grid.instant(tick + i) for i in range(most)]
        samples = self._rig.preview([instant / 1e9 for instant in instants])
        deflection = self._rig.parameters.static_deflection
        for instant, sample in zip(instants, samples or [self._rig.sample()], strict=False):
            self.known.append(self._message(offset_ns + instant, sample, deflection))

    def _message(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        self.trace.sample(sample)
        return self._messages.states(stamp_ns, sample, deflection)
