# SPDX-License-Identifier: Apache-2.0
"""
What-if: another rig in place of the recorded one.

The other rig starts as the recorded one did, with the same force and the same changes and resets,
but some parameters are held at other values all the time. What a controller outside the rig
ordered is ordered again, at the same instants.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from impact_damper_ros.bag.snapshots import motion_of
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.motion.event import Sample, table_of_events
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import InitialConditions
from impact_damper_ros.rig.order import Order
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD

from .command import Command, Setting
from .replay import Part, Step
from .rows import (
    NO_EVENTS,
    NO_SAMPLES,
    Events,
    Samples,
    impacts_of,
    samples_as_rows,
)

#: Values of a parameter that are listed in JSON.
_MOST_VALUES = 100


class WhatIf:
    """
    A rig with some parameters held, in a recorded run.

    Parameters
    ----------
    start : Command
        Where the run begins.
    held : mapping
        Parameters of the rig and of its gap control, and their values.
    held_initial : mapping, optional
        Initial conditions and their values.
    most_in_period : float, optional
        Most events of the rig within a period, see `Rig.advance`.

    Attributes
    ----------
    rig : Rig
        The rig.
    from_initial : bool
        Whether it started from the initial conditions. Otherwise it took over the recorded state,
        and the held values came as a change at that instant: a gap that is too narrow closes on m
        as it does on a live rig.
    reached : tuple of ndarray
        What `follow` returned last; what there was of it, if it failed.

    Raises
    ------
    ParameterError
        If the values are not admissible.
    ValueError
        If initial conditions are held and the run does not begin with them.
    """

    def __init__(
        self,
        start: Command,
        held: Mapping[str, Any],
        held_initial: Mapping[str, Any] | None = None,
        most_in_period: float = MOST_IN_PERIOD,
    ) -> None:
        self._most_in_period = most_in_period
        self._held = dict(held)
        self.reached: tuple[Samples, Events] = NO_SAMPLES, NO_EVENTS
        self._held_initial = dict(held_initial or {})
        self._logged = Setting.of(start.state)
        setting = self._logged.replaced(held)
        rig = _from_initial(start, self._logged, setting, self._held_initial)
        self._early: list[Events] = []
        self.from_initial = rig is not None
        if rig is None:
            if self._held_initial:
                raise ValueError(
                    f'{", ".join(self._held_initial)} cannot be set: the bag begins in the middle '
                    'of the run, at a recorded state; set rig parameters only'
                )
            rig = Rig.restore(start.state, start.law)
            self._early.append(table_of_events(rig.change(*setting)))
        self.rig = rig

    @classmethod
    def again(cls, state: Mapping[str, Any], law: OwnLaw | None, like: WhatIf | None) -> WhatIf:
        """Return a rig in a state, held as another what-if is, or not at all."""
        other = cls.__new__(cls)
        other.rig, other._early, other.from_initial = Rig.restore(dict(state), law), [], False
        other._logged, other._most_in_period = Setting.of(state), MOST_IN_PERIOD
        other._held = {} if like is None else like._held
        other._held_initial = {} if like is None else like._held_initial
        return other

    def follow(self, part: Part) -> tuple[Samples, Events]:
        """
        Go on to the end of a part of the recorded run.

        Returns
        -------
        samples : ndarray of SAMPLE_TYPE
            The motion at the instants of the recorded samples.
        events : ndarray of EVENT_TYPE
            The events on the way, and those of the command at the end.

        Raises
        ------
        ParameterError
            If a change or reset of the recorded rig is not admissible here.
        RunawayError
            If the rig has more events than it may.
        """
        events, self._early = self._early, []
        samples: list[Sample] = []
        try:
            orders = deque(part.orders)
            for time in part.samples['time'].tolist():
                events += self._ordered(orders, time) + self._moved(time)
                samples.append(self.rig.sample())
            events += self._ordered(orders, math.inf)
            for time_ns, step in part.steps:
                events += self._moved(time_ns / 1e9)
                events.append(self.carry_out(step))
        finally:
            self.reached = samples_as_rows(samples), np.concatenate([NO_EVENTS, *events])
        return self.reached

    def _ordered(self, orders: deque[tuple[float, Order]], until: float) -> list[Events]:
        """Carry out the orders up to an instant, s, but for those that this rig cannot take."""
        events = []
        while orders and orders[0][0] <= until:
            time, order = orders.popleft()
            events += self._moved(time)
            with suppress(ParameterError):
                events.append(table_of_events(self.rig.order(order)))
        return events

    def _moved(self, time: float) -> list[Events]:
        """Go on to an instant, s, in one call as the node does."""
        if time <= self.rig.time:
            return []
        events = self.rig.advance(time, self._most_in_period)
        return [table_of_events(events)] if events else []

    def carry_out(self, step: Step) -> Events:
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
            return table_of_events(rig.change(*step.replaced(self._held)))
        initial = InitialConditions(**{**step.as_dict(), **self._held_initial})
        try:
            rig.reset(initial)
        except ParameterError:
            # m would be outside a narrower gap, which then closes on it, as at the start.
            held = rig.parameters
            rig.change(self._logged.rig)
            rig.reset(initial)
            return table_of_events(rig.change(held))
        return table_of_events([])


def _from_initial(
    start: Command,
    logged: Setting,
    setting: Setting,
    held_initial: Mapping[str, Any],
) -> Rig | None:
    """Return a rig at its initial conditions, if the run begins at those of the logged one."""
    if start.time_ns != 0:
        return None
    initial = start.initial
    try:
        fresh = Rig(logged.rig, initial, control=logged.control, law=start.law).snapshot()
        if motion_of(fresh) != motion_of(start.state):
            return None
        held = InitialConditions(**{**initial.as_dict(), **held_initial})
        return Rig(setting.rig, held, control=setting.control, law=start.law)
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
        self.value = value
        #: The others in order, each with the rig time of its change, s
        self.changes: list[tuple[float, Any]] = []

    def take(self, time: float, value: Any) -> None:
        """Take the value from an instant on, s, if it differs from the last one."""
        if value != (self.changes[-1][1] if self.changes else self.value):
            self.changes.append((time, value))

    @property
    def range(self) -> tuple[float, float] | None:
        """The smallest and the largest value; None if they are no numbers."""
        if not isinstance(self.value, int | float) or isinstance(self.value, bool):
            return None
        values = [self.value, *(value for _, value in self.changes)]
        return min(values), max(values)

    def described(self, shown: Callable[[Any], str], most: int) -> str:
        """
        Return the values as text, each as `shown` gives it.

        At most `most` are listed with their times, the others by number and range.
        """
        listed = self.changes[:most]
        parts = [shown(self.value), *(f'{shown(v)} from {t:.9g} s' for t, v in listed)]
        if more := len(self.changes) - len(listed):
            parts.append(f'and {more} more until {self.changes[-1][0]:.9g} s')
            if self.range is not None:
                parts.append('all within {} to {}'.format(*map(shown, self.range)))
        return ', '.join(parts)

    def as_json(self) -> dict[str, Any]:
        """Return the values for JSON; times in s."""
        return {
            'at_first': self.value,
            'changes': [list(entry) for entry in self.changes[:_MOST_VALUES]],
            'change_count': len(self.changes),
            'range': self.range,
        }


class Ending:
    """
    The last parts of a run, kept to be sampled closely afterwards; they cover `span` s.

    `start` is the state of a rig at the beginning of the run.
    """

    def __init__(self, span: float) -> None:
        self._span = span
        self._kept: list[tuple[float, Mapping[str, Any], list[tuple[int, Step]]]] = []
        self._end = 0.0
        self._law: OwnLaw | None = None

    def look(self, rig: Rig, part: Part) -> None:
        """Take the state of a rig before a part, and that part."""
        if not len(part.samples) and not part.steps:
            return
        self._law = rig.own_law
        self._kept.append((rig.time, rig.snapshot(), part.steps))
        self._end = max([self._end, *part.samples['time'][-1:]])
        while len(self._kept) > 1 and self._kept[1][0] <= self._end - self._span:
            self._kept.pop(0)

    def trace(self, other: WhatIf | None, points: int) -> tuple[Samples, Events]:
        """Return the motion at a number of instants, and the impacts; of a what-if, if given."""
        if not self._kept:
            return NO_SAMPLES, table_of_events([])
        start, state, _ = self._kept[0]
        rig = WhatIf.again(state, self._law, other)
        instants = np.linspace(max(start, self._end - self._span), self._end, points)
        steps = [step for _, _, found in self._kept for step in found]
        cuts = [time_ns / 1e9 for time_ns, _ in steps]
        found = []
        for i, step in enumerate([*steps, None]):
            low = cuts[i - 1] if i else -math.inf
            high = cuts[i] if step is not None else math.inf
            within = instants[(instants >= low) & (instants < high)]
            samples = np.zeros(len(within), NO_SAMPLES.dtype)
            samples['time'] = within
            part = Part(samples, table_of_events([]), steps=[] if step is None else [step])
            found.append(rig.follow(part))
        samples, events = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return samples, impacts_of(events[events['time'] >= instants[0]])
