# SPDX-License-Identifier: Apache-2.0
"""A run of a rig with timed changes of its parameters, which observers follow."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, groupby, takewhile
from typing import Any, NamedTuple

from impact_damper_ros.motion.event import Event
from impact_damper_ros.parameters.rig_parameters import GapControlParameters, RigParameters

from .rig import Rig
from .runaway import MOST_IN_PERIOD, RunawayError


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
    """

    time_ns: int
    values: dict[str, Any]
    parameters: RigParameters
    control: GapControlParameters


class Observer:
    """What observes a run of a rig; a class derived from it defines the methods that it needs."""

    def ticks(self) -> Iterator[float]:
        """Yield the instants at which the rig is to stop, s, in order."""
        return iter(())

    def happened(self, events: Sequence[Event]) -> None:
        """Take the events of the rig's last call; `Rig.records` holds the acts of its control."""

    def changed(
        self,
        time_ns: int,  # noqa: ARG002
        values: Mapping[str, Any],  # noqa: ARG002
        events: Sequence[Event],
    ) -> None:
        """Take a change of the rig, which has been made, and its immediate events."""
        self.happened(events)

    def reached(self, instant: float) -> None:
        """Look at the rig, which has stopped at an instant; one of `ticks` or another one."""


def run(
    rig: Rig,
    until: float,
    observers: Sequence[Observer] = (),
    changes: Sequence[TimedChange] = (),
    most_in_period: float = MOST_IN_PERIOD,
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
    changes : sequence of TimedChange, optional
        Changes of the parameters, in the order of their instants, not later than `until`. Those of
        one instant are made one after the other.
    most_in_period : float, optional
        Most events of the rig within a period, see `Rig.advance`.

    Raises
    ------
    RunawayError
        If the rig has more events than that; the observers have seen all of them.

    Examples
    --------
    >>> rig = Rig(RigParameters())
    >>> class Count(Observer):
    ...     total = 0
    ...     def happened(self, events):
    ...         self.total += len(events)
    >>> count = Count()
    >>> run(rig, 50.0, [count])
    >>> count.total
    3
    """
    waiting = deque(changes)
    stops = heapq.merge(
        *(observer.ticks() for observer in observers), [c.time_ns / 1e9 for c in changes]
    )
    before_end = takewhile(lambda instant: instant < until, stops)
    for instant, _ in groupby(chain([rig.time], before_end, [until])):
        try:
            events = rig.advance(instant, most_in_period)
        except RunawayError as error:
            for observer in observers:
                observer.happened(error.events)
            raise
        for observer in observers:
            observer.happened(events)
        while waiting and waiting[0].time_ns / 1e9 == instant:
            change = waiting.popleft()
            caused = rig.change(change.parameters, change.control)
            for observer in observers:
                observer.changed(change.time_ns, change.values, caused)
        for observer in observers:
            observer.reached(instant)
