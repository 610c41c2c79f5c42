# SPDX-License-Identifier: Apache-2.0
"""A fitted flight computed again by the exact engine, from the state just after its impact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import (
    ROWS_AT_ONCE,
    Event,
    EventKind,
    events_of,
    events_of_table,
)
from impact_damper_ros.motion.flight import NO_EVENT
from impact_damper_ros.motion.kernels import call_kernel, kernel
from impact_damper_ros.motion.next_event import ALL_STEPS, next_event
from impact_damper_ros.motion.state import Moving
from impact_damper_ros.motion.transition import resolve
from impact_damper_ros.orbits.flights import machine_of, moving_at_impact, packed_rig
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .vibration import Array

#: Most events of a flight; a chatter has more, and cannot be fitted.
_ROOM = 48
#: Number of first impacts of a replay that may be the end of the flight.
_MOST_IMPACTS = 6
#: Largest error of the end of a flight, as a part of its duration.
_PART = 0.06
#: Events at which friction changes.
TURNS = (EventKind.REVERSAL, EventKind.STICK, EventKind.RELEASE)


class Passage(NamedTuple):
    """
    Events of the engine up to an impact of the course.

    Attributes
    ----------
    ahead : int
        Number of impacts ahead; 0 if the engine reaches none.
    events : list of Event
        Events up to that impact, with times since the start of the flight.
    rests : bool
        Whether m rests on a stop before that impact.
    """

    ahead: int
    events: list[Event]
    rests: bool

    @property
    def impacts(self) -> list[Event]:
        """The impacts, including that at the end of the flight."""
        return [event for event in self.events if event.kind is EventKind.IMPACT]

    @property
    def missed(self) -> int:
        """Number of impacts before that at the end."""
        return max(len(self.impacts) - 1, 0)


@kernel
def fly_on(moving: Moving, until: float) -> int:
    """Let a rig that moves run until an instant, or for as many events as fit in its table."""
    run = moving.run
    while run.written + ROWS_AT_ONCE <= run.room:
        run.steps = ALL_STEPS
        next_event(moving, until)
        if run.kind == NO_EVENT or run.tau + run.time > until:
            break
        resolve(moving)
    written: int = run.written
    return written


class FlightReplay:
    """Flights of one rig, computed by the engine."""

    def __init__(self, rig: RigParameters) -> None:
        self._machine = machine_of(rig)

    def events(
        self, instant: float, stop: int, x: float, velocity: float, damper: float, span: float
    ) -> list[Event]:
        """Return the events in a span after an impact on a stop (+1 or -1)."""
        number = 1 if stop > 0 else 2
        begin = moving_at_impact(self._machine, instant, number, x, velocity, damper)
        begin.run.room = _ROOM
        moving = packed_rig(begin, _ROOM)
        written = call_kernel(fly_on, moving, float(span), what='fit')
        if isinstance(moving.log, list):
            return events_of(moving.log, written)
        return events_of_table(moving.log[:written])


def passage(
    events: list[Event], spans: Array, stops: NDArray[np.int64], tolerance: float
) -> Passage:
    """Return the events up to one of the next impacts of a course, given as spans and stops."""
    rests = False
    hits = 0
    for k, event in enumerate(events):
        if event.time > spans[-1] * (1.0 + _PART) + tolerance or hits > _MOST_IMPACTS:
            break
        rests |= event.kind is EventKind.REST
        if event.kind is not EventKind.IMPACT:
            continue
        hits += 1
        apart = np.where(stops == event.side, np.abs(spans - event.time), np.inf)
        nearest = int(apart.argmin())
        if apart[nearest] < max(tolerance, _PART * spans[nearest]):
            return Passage(nearest + 1, events[: k + 1], rests)
    rests = any(event.kind is EventKind.REST for event in events if event.time < spans[0])
    return Passage(0, [], rests)
