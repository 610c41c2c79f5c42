"""
The event map: the state one period later, by the simulator's own events, with its derivative.

A flight propagates deviations by its free vibration. An event propagates them by its saltation
matrix: an impact, a reversal of friction, or the beginning of sticking or rest, where the relative
deviation is lost. A release leaves deviations unchanged, since the relative acceleration is zero
there. The infinitely many impacts that end a chatter act as one plastic impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.flight import (
    CHATTER_END,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    Motion,
)
from impact_damper_ros.rig.state import STICK

from .equations import Array
from .flights import Flight, Machine
from .multipliers import event_matrices, flight_matrices

#: Largest number of events that are followed in one trajectory.
MOST_EVENTS = 2000


class FlightPart(NamedTuple):
    """One flight of a trajectory, with its start from the beginning of that, s."""

    start: float
    duration: float
    flight: Flight

    @property
    def mode(self) -> int:
        """The mode of the motion."""
        return self.flight.run.mode


class TrajectoryEvent(NamedTuple):
    """An event as in `Event`, with its time from the beginning of the trajectory, s."""

    time: float
    kind: EventKind
    stop: int
    x: float
    primary_velocity_before: float
    primary_velocity_after: float
    damper_velocity_before: float
    damper_velocity_after: float


@dataclass(frozen=True)
class Trajectory:
    """
    Motion from one instant to a later one.

    The matrix is the derivative of (X, X', Z, Z') at the end by the same at the beginning.
    """

    end: Flight
    matrix: Array
    events: list[TrajectoryEvent]
    flights: list[FlightPart]


def _rates(motion: Motion, flight: Flight) -> Array:
    """Return (X', X'', Z', Z'')."""
    if flight.run.joint:
        return np.array([motion.velocity, motion.x_2, motion.velocity, motion.x_2])
    return np.array(
        [
            motion.velocity,
            motion.x_2,
            motion.velocity + motion.relative_velocity,
            motion.x_2 + motion.relative_2,
        ]
    )


class _Crossings:
    """The effect of the events of a trajectory on deviations."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.impacts: list[bool] = []
        self.restitutions: list[float] = []
        self.crosses: list[bool] = []
        self.before: list[Array] = []
        self.after: list[Array] = []

    def add(self, kind: int, mode: int, before: Array, after: Array) -> None:
        """Add an event that leads to a mode, with the rates before and after it."""
        machine = self.machine.constants
        restitution = machine.restitution_1 if kind == CONTACT_1 else machine.restitution_2
        self.impacts.append(kind in (CONTACT_1, CONTACT_2))
        self.restitutions.append(0.0 if mode >= STICK else restitution)
        self.crosses.append(kind not in (RELEASE_UP, RELEASE_DOWN, CHATTER_END))
        self.before.append(before)
        self.after.append(after)

    def matrix(self, flights: list[FlightPart]) -> Array:
        """Return the derivative of the state at the end by the state at the beginning."""
        modes = np.array([part.mode for part in flights], np.int64)
        spans = np.array([part.duration for part in flights])
        carried_by = flight_matrices(self.machine.constants, modes, spans)
        events = event_matrices(
            self.machine.constants.mass_ratio,
            np.array(self.impacts, dtype=bool),
            np.array(self.restitutions),
            np.reshape(self.before, (-1, 4)),
            np.reshape(self.after, (-1, 4)),
            np.array(self.crosses, dtype=bool),
        )
        matrix: Array = carried_by[0]
        for event, flight in zip(events, carried_by[1:], strict=True):
            matrix = flight @ (event @ matrix)
        return matrix


#: Events that change the motion of the masses.
_REPORTED = (
    EventKind.IMPACT,
    EventKind.REST,
    EventKind.STICK,
    EventKind.RELEASE,
    EventKind.REVERSAL,
)


def follow_trajectory(
    flight: Flight, duration: float, *, differentiate: bool = True
) -> Trajectory | None:
    """
    Follow the motion for a time; return None if it has more than `MOST_EVENTS` events.

    Without `differentiate` the matrix is the identity.
    """
    crossings = _Crossings(flight.machine)
    events: list[TrajectoryEvent] = []
    flights: list[FlightPart] = []
    elapsed = 0.0
    for _ in range(MOST_EVENTS):
        left = duration - elapsed
        kind, span = flight.first_event(left)
        flights.append(FlightPart(elapsed, span, flight))
        if kind == NO_EVENT:
            matrix = crossings.matrix(flights) if differentiate else np.eye(4)
            return Trajectory(flight.after(left), matrix, events, flights)
        ending = flight
        flight, rows = flight.resolved()
        if differentiate:
            before = _rates(ending.motion(span), ending)
            crossings.add(kind, flight.run.mode, before, _rates(flight.motion(0.0), flight))
        elapsed += span
        events += [
            TrajectoryEvent(
                elapsed,
                EventKind(row.kind),
                row.stop,
                row.x,
                row.primary_velocity_before,
                row.primary_velocity_after,
                row.damper_velocity_before,
                row.damper_velocity_after,
            )
            for row in rows
            if row.kind in _REPORTED
        ]
    return None
