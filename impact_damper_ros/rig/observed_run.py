# SPDX-License-Identifier: Apache-2.0
"""A run of a rig with timed changes of its parameters and orders, which observers follow."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, groupby, repeat, takewhile
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import SAMPLE_TYPE, Event, events_of_table
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import ParameterError, check_kind
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .order import Order
from .rig import Rig
from .run_result import Outcome
from .runaway import MOST_IN_PERIOD, RunawayError
from .waiting_change import made_at_once, waiting_values

Samples = NDArray[np.void]

#: Most samples of one call of the rig: what is handed on at once.
_BLOCK = 4096


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

    def instants(self) -> Iterator[float]:
        """Yield the instants at which the rig is sampled, s, in order; it need not stop there."""
        return iter(())

    def take_events(self, events: Sequence[Event]) -> None:
        """Take the events of the rig's last call; `Rig.acts` holds the acts of its control."""

    def take_samples(self, samples: Samples) -> None:
        """Take samples at the next of the `instants`, an array of SAMPLE_TYPE."""

    def take_motion(self, events: Sequence[Event], samples: Samples) -> None:
        """Take the events of the rig's last call as `take_events`, and samples on the way."""
        self.take_events(events)
        self.take_samples(samples)

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

    The motion does not depend on the observers: stopping a rig changes no bit of it. Between two
    stops the rig is sampled in blocks, which compiled code computes fast; a law of the user's own
    stops at each instant. A sample at the instant of a change is taken after the change.

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
    sampling = _Sampling(rig, observers)
    ticks = [observer.ticks() for observer in observers]
    if rig.own_law is not None:
        # After an error in the law the samples before it are not lost.
        ticks += [observer.instants() for observer in observers]
    stops = heapq.merge(*ticks, [change.time for change in changes])
    before_end = takewhile(lambda instant: instant < until, stops)
    waiting: TimedChange | None = None
    for stop, _ in groupby(chain([rig.time], before_end, [until])):
        instant = rig.time
        while instant < stop or instant == rig.time == stop:
            instant = stop if waiting is None else min(stop, waiting.time)
            if instant > rig.time or not begun:
                _advance(rig, instant, observers, most_in_period, sampling)
            if waiting is not None and waiting.time == instant:
                _change_all(rig, waiting, observers)
                waiting = None
            while coming and coming[0].time == instant:
                due = coming.popleft()
                if isinstance(due, TimedOrder):
                    _order(rig, due, observers)
                else:
                    waiting = _change(rig, due, observers)
            sampling.sample_now()
            if instant == stop:
                break
        for observer in observers:
            observer.look_at(stop)


class _Sampling:
    """The samples that the observers of a rig still await."""

    def __init__(self, rig: Rig, observers: Sequence[Observer]) -> None:
        self._rig, self._observers = rig, observers
        # Each instant, and the place of the observer that awaits it
        self._coming = heapq.merge(
            *(zip(one.instants(), repeat(k)) for k, one in enumerate(observers))
        )
        self._next = next(self._coming, (inf, 0))

    def _take(self, least: float, most: int) -> tuple[list[float], NDArray[np.int64]]:
        """Take instants before another one, with their observers."""
        found: list[tuple[float, int]] = []
        while self._next[0] < least and len(found) < most:
            found.append(self._next)
            self._next = next(self._coming, (inf, 0))
        return [instant for instant, _ in found], np.array([k for _, k in found], np.int64)

    def sample_now(self) -> None:
        """Sample the rig where it is, for the instants up to the present one."""
        if self._next[0] <= self._rig.time:
            _, owners = self._take(np.nextafter(self._rig.time, inf), 2**31)
            samples = np.array([tuple(self._rig.sample())] * len(owners), SAMPLE_TYPE)
            for k, observer in enumerate(self._observers):
                if len(own := samples[owners == k]):
                    observer.take_samples(own)

    def run_before(self, end: float, most_in_period: float) -> bool:
        """Run through the next block of instants before another one; return whether there are."""
        instants, owners = self._take(end, _BLOCK)
        if not instants:
            return False
        result = self._rig.run(
            instants[-1], instants, most_events=inf, most_in_period=most_in_period
        )
        events, owners = events_of_table(result.events), owners[: len(result.samples)]
        for k, observer in enumerate(self._observers):
            observer.take_motion(events, result.samples[owners == k])
        if result.outcome is not Outcome.COMPLETE:
            raise RunawayError(result.reason, events)
        return True


def _advance(
    rig: Rig,
    instant: float,
    observers: Sequence[Observer],
    most_in_period: float,
    sampling: _Sampling,
) -> None:
    """Run a rig to an instant, s, with the samples before it."""
    while sampling.run_before(instant, most_in_period):
        pass
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
