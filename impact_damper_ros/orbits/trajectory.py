"""
Trajectories: the simulator's motion from one instant to a later one, with its derivative.

A flight propagates deviations by its free vibration. An event propagates them by its saltation
matrix: an impact, a reversal of friction, or the beginning of sticking or rest, where the relative
deviation is lost. A release leaves deviations unchanged, since the relative acceleration is zero
there. The infinitely many impacts that end a chatter act as one plastic impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import Event
from impact_damper_ros.rig.event import events_of
from impact_damper_ros.rig.flight import (
    CHATTER_END,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
)
from impact_damper_ros.rig.state import STICK

from .flights import Flight
from .multipliers import event_matrices, flight_matrices
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

    def rates(self, tau: float) -> tuple[float, float, float, float]:
        """Return (X', X'', Z', Z'') some time after its start, s."""
        motion = self.flight.motion(tau)
        if self.flight.run.joint:
            return motion.velocity, motion.x_2, motion.velocity, motion.x_2
        return (
            motion.velocity,
            motion.x_2,
            motion.velocity + motion.relative_velocity,
            motion.x_2 + motion.relative_2,
        )


@dataclass(frozen=True)
class Trajectory:
    """Motion from one instant to a later one."""

    end: Flight
    #: Their time is that from the beginning.
    events: list[Event]
    flights: list[FlightPart]

    @cached_property
    def matrix(self) -> Array:
        """The derivative of (X, X', Z, Z') at the end by the same at the beginning."""
        machine = self.end.machine.constants
        before, after = self.flights[:-1], self.flights[1:]
        endings = np.array([part.ending for part in before])
        modes = np.array([part.mode for part in self.flights], np.int64)
        carried = flight_matrices(
            machine, modes, np.array([part.duration for part in self.flights])
        )
        hit_1 = endings == CONTACT_1
        restitution = np.where(hit_1, machine.restitution_1, machine.restitution_2)
        events = event_matrices(
            machine.mass_ratio,
            hit_1 | (endings == CONTACT_2),
            np.where(modes[1:] >= STICK, 0.0, restitution),
            np.reshape([part.rates(part.duration) for part in before], (-1, 4)),
            np.reshape([part.rates(0.0) for part in after], (-1, 4)),
            ~np.isin(endings, (RELEASE_UP, RELEASE_DOWN, CHATTER_END)),
        )
        matrix: Array = carried[0]
        for event, flight in zip(events, carried[1:], strict=True):
            matrix = flight @ (event @ matrix)
        return matrix


def follow_trajectory(flight: Flight, duration: float) -> Trajectory | None:
    """Follow the motion for a time; return None if it has more than `MOST_EVENTS` events."""
    events: list[Event] = []
    flights: list[FlightPart] = []
    elapsed = 0.0
    for _ in range(MOST_EVENTS):
        left = duration - elapsed
        kind, span = flight.first_event(left)
        flights.append(FlightPart(elapsed, span, flight, kind))
        if kind == NO_EVENT:
            return Trajectory(flight.after(left), events, flights)
        flight, rows = flight.resolved()
        elapsed += span
        events += [event._replace(time=elapsed) for event in events_of(rows, len(rows))]
    return None
