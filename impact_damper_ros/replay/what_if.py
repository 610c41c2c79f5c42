"""
What-if: another rig in place of the recorded one.

The other rig starts as the recorded one did, with the same force and the same changes and resets,
but some parameters are held at other values all the time.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import Event, InitialConditions, ParameterError, Sample
from impact_damper_ros.rig.event_budget import EventBudget

from .recorded_snapshot import RecordedSnapshot, motion_of
from .replay import Replay, Tick
from .replayed_rig import Setting, Step, setting_of

#: Values of a parameter that are kept with their times.
_MOST_VALUES = 100


class WhatIf:
    """
    A rig with some parameters held, in a recorded run.

    Parameters
    ----------
    start : RecordedSnapshot
        Where the run begins.
    initial : InitialConditions or None
        Those of the recorded rig; None if they are not known.
    held : mapping
        Parameters of the rig and of its gap control, and their values.
    held_initial : mapping, optional
        Initial conditions and their values.
    budget : EventBudget, optional
        The most events that the rig may have.

    Attributes
    ----------
    rig : Rig
        The rig.
    from_initial : bool
        Whether it started from the initial conditions. Otherwise it took over the recorded state,
        and the held values came as a change at that instant: a gap that is too narrow closes on m
        as it does on a live rig.

    Raises
    ------
    ParameterError
        If the values are not admissible.
    ValueError
        If initial conditions are held and the run does not begin with them.
    """

    def __init__(
        self,
        start: RecordedSnapshot,
        initial: InitialConditions | None,
        held: Mapping[str, Any],
        held_initial: Mapping[str, Any] | None = None,
        budget: EventBudget | None = None,
    ) -> None:
        self._budget = budget or EventBudget()
        self._held = dict(held)
        self._held_initial = dict(held_initial or {})
        self._logged = setting_of(start.state)
        setting = self._logged.replaced(held)
        self.early_events: list[Event] = []
        rig = _from_initial(start, self._logged, initial, setting, self._held_initial)
        self.from_initial = rig is not None
        if rig is None:
            if self._held_initial:
                raise ValueError(
                    f'{", ".join(self._held_initial)} cannot be set: the bag begins in the middle '
                    'of the run, at a recorded state; set rig parameters only'
                )
            rig = Rig.restore(start.state)
            self.early_events += rig.change(*setting)
        self.rig = rig

    def copied(self) -> WhatIf:
        """Return a copy that continues from here."""
        other = copy.copy(self)
        other.rig = Rig.restore(self.rig.snapshot())
        other._budget = copy.copy(self._budget)
        return other

    def follow(self, tick: Tick) -> tuple[Sample, list[Event]]:
        """
        Go on to a sample of the recorded run.

        Returns
        -------
        sample : Sample
            The motion there.
        events : list of Event
            The events on the way.

        Raises
        ------
        ParameterError
            If a change or reset of the recorded rig is not admissible here.
        EndlessEventsError
            If the rig has more events than it may.
        """
        events, self.early_events = self.early_events, []
        for time_ns, step in tick.steps:
            events += self.advance(time_ns)
            events += self.carry_out(step)
        events += self.advance(tick.time_ns)
        return self.rig.sample(), [event for event in events if event.time >= tick.begun]

    def advance(self, time_ns: int) -> list[Event]:
        """Go on to an instant, in one call as the node does."""
        time = time_ns / 1e9
        return self._budget.advance(self.rig, time) if time > self.rig.time else []

    def carry_out(self, step: Step) -> list[Event]:
        """
        Repeat a change or reset of the recorded rig, with the held values.

        Raises
        ------
        ParameterError
            If it is not admissible.
        """
        rig = self.rig
        if isinstance(step, Setting):
            self._logged = step
            return rig.change(*step.replaced(self._held))
        initial = InitialConditions(**{**step.as_dict(), **self._held_initial})
        try:
            rig.reset(initial)
        except ParameterError:
            # m would be outside a narrower gap, which then closes on it, as at the start.
            held = rig.parameters
            rig.change(self._logged.rig)
            rig.reset(initial)
            return rig.change(held)
        return []


def _from_initial(
    start: RecordedSnapshot,
    logged: Setting,
    initial: InitialConditions | None,
    setting: Setting,
    held_initial: Mapping[str, Any],
) -> Rig | None:
    """Return a rig at its initial conditions, if the run begins at those of the logged one."""
    if initial is None or start.time_ns != 0:
        return None
    try:
        fresh = Rig(logged.rig, initial, control=logged.control).snapshot()
        if motion_of(fresh) != motion_of(start.state):
            return None
        held = InitialConditions(**{**initial.as_dict(), **held_initial})
        return Rig(setting.rig, held, control=setting.control)
    except ParameterError:
        if held_initial:
            raise
        return None


class RecordedValues:
    """
    The values of a held parameter in the recorded run.

    It begins with the first one; None if that is not known.
    """

    def __init__(self, value: Any) -> None:
        self.value = self._last = value
        #: The first values after that one, each with the rig time of its change, s
        self.first: list[tuple[float, Any]] = []
        #: How many there are after that one
        self.count = 0
        #: Rig time of the last change, s
        self.last_time = -math.inf
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        #: The smallest and the largest of all; None if they are no numbers
        self.range = (value, value) if number else None

    def take(self, time: float, value: Any) -> None:
        """Take the value from an instant on, s, if it differs from the last one."""
        if value == self._last:
            return
        self._last = value
        self.last_time = time
        self.count += 1
        if self.count <= _MOST_VALUES:
            self.first.append((time, value))
        if self.range is not None:
            self.range = min(self.range[0], value), max(self.range[1], value)

    def described(self, shown: Callable[[Any], str], most: int) -> str:
        """
        Return the values as text, each as `shown` gives it.

        At most `most` are listed with their times, the others by number and range.
        """
        listed = self.first[:most]
        parts = [shown(self.value), *(f'{shown(v)} from {t:.9g} s' for t, v in listed)]
        if more := self.count - len(listed):
            parts.append(f'and {more} more until {self.last_time:.9g} s')
            if self.range is not None:
                parts.append('all within {} to {}'.format(*map(shown, self.range)))
        return ', '.join(parts)

    def as_json(self) -> dict[str, Any]:
        """Return the values for JSON; times in s."""
        return {
            'at_first': self.value,
            'changes': [list(entry) for entry in self.first],
            'change_count': self.count,
            'range': self.range,
        }


@dataclass(frozen=True)
class Trace:
    """Closely sampled motion of a rig, and the impacts meanwhile."""

    samples: Sequence[Sample]
    impacts: Sequence[Event]


class Ending:
    """
    The end of a replay and of its what-if, kept to be sampled closely afterwards.

    The what-if runs along with the replay; the end is `span` s of rig time.
    """

    def __init__(self, replay: Replay, other: WhatIf, span: float) -> None:
        self._replay = replay
        self._other = other
        self._span_ns = round(span * 1e9)
        self._kept: deque[tuple[int, Rig, WhatIf]] = deque()
        self._steps: deque[tuple[int, Step]] = deque()
        self._time_ns = 0

    def look(self, tick: Tick) -> None:
        """Take the next sample, which both rigs have reached."""
        now_ns = self._time_ns = tick.time_ns
        self._steps.extend(tick.steps)
        kept = self._kept
        if not kept or now_ns - kept[-1][0] >= self._span_ns // 4:
            rig = Rig.restore(self._replay.replayed.rig.snapshot())
            kept.append((now_ns, rig, self._other.copied()))
        while len(kept) > 1 and kept[1][0] <= now_ns - self._span_ns:
            kept.popleft()
        while self._steps and self._steps[0][0] < kept[0][0]:
            self._steps.popleft()

    def traces(self, points: int) -> tuple[Trace, Trace]:
        """Return the motion of recorded rig and what-if at a number of instants."""
        if not self._kept:
            return Trace((), ()), Trace((), ())
        from_ns, rig, other = self._kept[0]
        start_ns = max(from_ns, self._time_ns - self._span_ns)
        instants = [
            start_ns + (self._time_ns - start_ns) * k // max(1, points - 1) for k in range(points)
        ]
        # Steps of the very first instant were done before it was kept.
        steps = [step for step in self._steps if step[0] > from_ns]
        plain = other.copied()
        plain.rig, plain._held, plain._held_initial = Rig.restore(rig.snapshot()), {}, {}
        return trace(plain, steps, instants), trace(other.copied(), steps, instants)


def trace(rig: WhatIf, steps: Sequence[tuple[int, Step]], instants: Sequence[int]) -> Trace:
    """Run a rig through changes and resets, and sample it at instants in nanoseconds."""
    samples, events = [], []
    waiting = deque(steps)
    for instant in instants:
        while waiting and waiting[0][0] <= instant:
            time_ns, step = waiting.popleft()
            events += rig.advance(time_ns)
            events += rig.carry_out(step)
        events += rig.advance(instant)
        samples.append(rig.rig.sample())
    first = samples[0].time if samples else 0.0
    return Trace(samples, [e for e in events if e.impulse > 0.0 and e.time >= first])
