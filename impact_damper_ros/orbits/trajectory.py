"""Trajectories: the simulator's motion from one instant to a later one, flight by flight."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import EVENT_TYPE
from impact_damper_ros.rig.event import EventRow
from impact_damper_ros.rig.flight import NO_EVENT

from .flights import Flight
from .lyapunov import deviations, monodromy_of
from .response import Array

#: Largest number of events that are followed in one trajectory.
MOST_EVENTS = 2000


class FlightPart(NamedTuple):
    """One flight of a trajectory: its start from the beginning of that, s, and what ends it."""

    start: float
    duration: float
    flight: Flight
    ending: int

    @property
    def mode(self) -> int:
        """The mode of the motion."""
        return self.flight.run.mode


@dataclass(frozen=True)
class Trajectory:
    """Motion from one instant to a later one."""

    end: Flight
    duration: float
    #: The events as rows, their time that from the beginning.
    rows: list[EventRow]
    flights: list[FlightPart]

    @cached_property
    def matrix(self) -> Array:
        """The derivative of (X, X', Z, Z') at the end by the same at the beginning."""
        begun = self.flights[0].flight
        along = deviations(
            begun.machine,
            tuple(wave.angle for wave in begun.waves),
            np.array([astuple(row) for row in self.rows], EVENT_TYPE),
            begun.run.mode,
            begun.run.last_stop,
            0.0,
            self.duration,
        )
        product: Array = monodromy_of(along, np.array([self.duration]))[0]
        return product


def follow_trajectory(flight: Flight, duration: float) -> Trajectory | None:
    """Follow the motion for a time; return None if it has more than `MOST_EVENTS` events."""
    rows: list[EventRow] = []
    flights: list[FlightPart] = []
    elapsed = 0.0
    for _ in range(MOST_EVENTS):
        left = duration - elapsed
        kind, span = flight.first_event(left)
        flights.append(FlightPart(elapsed, span, flight, kind))
        if kind == NO_EVENT:
            return Trajectory(flight.after(left), duration, rows, flights)
        flight, fresh = flight.resolved()
        elapsed += span
        rows += [replace(row, time=elapsed) for row in fresh]
    return None
