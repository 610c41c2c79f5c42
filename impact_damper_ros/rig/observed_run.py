# SPDX-License-Identifier: Apache-2.0
"""A run of a rig with timed changes of its parameters and orders, which observers follow."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, groupby, takewhile
from typing import Any, NamedTuple

from impact_damper_ros.motion.event import Event
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import ParameterError, check_kind
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .order import Order
from .rig import Rig
from .runaway import MOST_IN_PERIOD, RunawayError
from .waiting_change import made_at_once, waiting_values


class TimedChange(NamedTuple):
    """
    A change of parameters at an instant.

    Attributes
    ----------
    time_ns : int
        The instant, in nanoseconds.
    values : dict
        The new values by name.
    parameters : RigParameters
        The rig from then on.
    control : GapControlParameters
        Its gap control from then on.

    Examples
    --------
    >>> rig = Rig(RigParameters(gravity=0.0))
    >>> narrow = rig.parameters.replace(gap=30.0)
    >>> change = TimedChange(30_000_000_000, {'gap': 30.0}, narrow, rig.control)
    >>> _ = run(rig, 60.0, changes=[change])
    >>> change.time, rig.parameters.gap
    (30.0, 30.0)
    """

    time_ns: int
    values: dict[str, Any]
    parameters: RigParameters
    control: GapControlParameters

    @property
    def time(self) -> float:
        """The instant, s."""
        return self.time_ns / 1e9


class TimedOrder(NamedTuple):
    """An order of a controller outside the rig, and its instant, s."""

    time: float
    order: Order


class Observer:
    """
    What observes a run of a rig; a class derived from it defines the methods that it needs.

    Examples
    --------
    >>> class Count(Observer):
    ...     impacts = 0
    ...
    ...     def take_events(self, events):
    ...         self.impacts += len(events)
    >>> count = Count()
    >>> _ = run(Rig(RigParameters(gravity=0.0)), 60.0, [count])
    >>> count.impacts
    7
    """

    def ticks(self) -> Iterator[float]:
        """Yield the instants at which the rig is to stop, s, in order."""
        return iter(())

    def take_events(self, events: Sequence[Event]) -> None:
        """Take the events of the rig's last call; `Rig.acts` holds the acts of its control."""

    def take_change(
        self,
        time_ns: int,  # noqa: ARG002
        values: Mapping[str, Any],  # noqa: ARG002
        events: Sequence[Event],
    ) -> None:
        """Take a change of the rig, which has been made, and its immediate events."""
        self.take_events(events)

    def take_refusal(self, order: TimedOrder, error: ParameterError) -> None:
        """Take an order that the rig cannot carry out, and the reason."""

    def look_at(self, instant: float) -> None:
        """Look at the rig, which has stopped at an instant of `ticks` or at another one."""


def run(
    rig: Rig,
    until: float,
    observers: Sequence[Observer] = (),
    changes: Sequence[TimedChange | TimedOrder] = (),
    most_in_period: float = MOST_IN_PERIOD,
    *,
    begun: bool = False,
) -> None:
    """
    Run a rig to an instant, and call observers on the way.

    The motion does not depend on the observers: stopping a rig changes no bit of it.

    Parameters
    ----------
    rig : Rig
        The rig, which is moved on.
    until : float
        Time at which the run ends, s.
    observers : sequence of Observer, optional
        They are called in this order.
    changes : sequence of TimedChange or TimedOrder, optional
        Changes of the parameters, and orders, in the order of their instants, not later than
        `until`. Those of one instant are made one after the other. A change of the base is made at
        its next upward zero; see `Rig.wait_for_change`.
    most_in_period : float, optional
        Most events of the rig within a period, see `Rig.advance`.
    begun : bool, optional
        Whether the run continues another one, and so begins with the events that are due at once.

    Raises
    ------
    TypeError
        If the rig is no `Rig`.
    RunawayError
        If the rig has more events than `most_in_period`; the observers have seen all of them.

    Examples
    --------
    >>> rig = Rig(RigParameters())
    >>> class Count(Observer):
    ...     total = 0
    ...     def take_events(self, events):
    ...         self.total += len(events)
    >>> count = Count()
    >>> run(rig, 50.0, [count])
    >>> count.total
    3
    """
    check_kind('rig', rig, Rig, 'a Rig, such as Rig(parameters)')
    coming = deque(changes)
    stops = heapq.merge(
        *(observer.ticks() for observer in observers), [change.time for change in changes]
    )
    before_end = takewhile(lambda instant: instant < until, stops)
    waiting: TimedChange | None = None
    for stop, _ in groupby(chain([rig.time], before_end, [until])):
        instant = rig.time
        while instant < stop or instant == rig.time == stop:
            instant = stop if waiting is None else min(stop, waiting.time)
            if instant > rig.time or not begun:
                _advance(rig, instant, observers, most_in_period)
            if waiting is not None and waiting.time == instant:
                _change_all(rig, waiting, observers)
                waiting = None
            while coming and coming[0].time == instant:
                due = coming.popleft()
                if isinstance(due, TimedOrder):
                    _order(rig, due, observers)
                else:
                    waiting = _change(rig, due, observers)
            if instant == stop:
                break
        for observer in observers:
            observer.look_at(stop)


def _advance(
    rig: Rig, instant: float, observers: Sequence[Observer], most_in_period: float
) -> None:
    """Run a rig to an instant, s."""
    try:
        events = rig.advance(instant, most_in_period)
    except RunawayError as error:
        for observer in observers:
            observer.take_events(error.events)
        raise
    for observer in observers:
        observer.take_events(events)


def _change(rig: Rig, change: TimedChange, observers: Sequence[Observer]) -> TimedChange | None:
    """Change a rig; return the part of the change that waits for the base, if any."""
    now, due_ns = made_at_once(rig, change.parameters)
    rest = waiting_values(now, change.parameters)
    values = {name: value for name, value in change.values.items() if name not in rest}
    if values or due_ns is None:
        _change_all(rig, change._replace(values=values, parameters=now), observers)
    return None if due_ns is None else change._replace(time_ns=due_ns, values=rest)


def _change_all(rig: Rig, change: TimedChange, observers: Sequence[Observer]) -> None:
    caused = rig.change(change.parameters, change.control)
    for observer in observers:
        observer.take_change(change.time_ns, change.values, caused)


def _order(rig: Rig, due: TimedOrder, observers: Sequence[Observer]) -> None:
    """Carry out an order, or report to the observers why the rig cannot."""
    try:
        events = rig.order(due.order)
    except ParameterError as error:
        for observer in observers:
            observer.take_refusal(due, error)
        return
    for observer in observers:
        observer.take_events(events)
