"""
The event map: the state one period later, by the simulator's own events, with its derivative.

A flight propagates deviations by its free vibration. An event propagates them by its saltation
matrix: an impact, a reversal of friction, or the beginning of sticking or rest, where the relative
deviation is lost. A release leaves deviations unchanged, since the relative acceleration is zero
there. The infinitely many impacts that end a chatter act as one plastic impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    Flight,
    Motion,
    end_at,
    motion_at,
    starting_motion,
)
from impact_damper_ros.rig.forcing import sines_of, turned_angles
from impact_damper_ros.rig.mode import (
    REST_1,
    REST_2,
    STICK,
    RigConstants,
    launch,
    mode_at_rest,
)
from impact_damper_ros.rig.origin import Origin, carried
from impact_damper_ros.rig.run_loop import first_end
from impact_damper_ros.rig.transition import moving_mode, resolve

from .equations import Array
from .multipliers import event_matrices, flight_matrices

#: Largest number of events that are followed in one trajectory.
MOST_EVENTS = 2000

_STOP_OF = {REST_1: 1, REST_2: 2}


class FlightPart(NamedTuple):
    """One flight of a trajectory, with its start from the beginning of that, s."""

    start: float
    duration: float
    origin: Origin
    flight: Flight


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

    end: Origin
    matrix: Array
    events: list[TrajectoryEvent]
    flights: list[FlightPart]


def origin_at(
    machine: RigConstants,
    instant: float,
    x: float,
    velocity: float,
    beyond: float,
    relative_velocity: float,
    resting: int,
    last_stop: int,
) -> Origin:
    """
    Return a state on the force's clock (s) as the origin of a flight.

    `beyond` is Y - d/2, the way m has gone beyond stop 1: not positive, and exact near the
    stop of a one-sided rig, whose gap is meaningless. It and Y' do not count where `resting`
    is `STICK`, `REST_1` or `REST_2`; 0 says that m moves. `last_stop` is 0 if none was hit
    yet.
    """
    half = machine.stop
    if resting == REST_1:
        beyond = 0.0
    elif resting == REST_2:
        beyond = -2.0 * half
    origin = Origin(
        time=0.0,
        time_low=0.0,
        mode=resting,
        x=x,
        velocity=velocity,
        relative_velocity=0.0 if resting else relative_velocity,
        clearance_1=max(0.0, -beyond),
        clearance_2=inf if machine.one_sided else max(0.0, 2.0 * half + beyond),
        stop_1=half,
        stop_2=-half,
        angles=turned_angles((0.0,) * len(machine.phases), machine.free.harmonics, instant),
        last_stop=last_stop,
        released=False,
        chatter_left=0.0,
        target_1=half,
        target_2=-half,
    )
    if resting:
        return origin._replace(
            mode=mode_at_rest(machine, origin, sines_of(machine.phases, origin.angles))
        )
    return origin._replace(mode=moving_mode(machine, relative_velocity))


def origin_after_impact(
    machine: RigConstants,
    instant: float,
    stop: int,
    x: float,
    velocity: float,
    damper_velocity: float,
) -> Origin:
    """Return the state just after an impact, at an instant of the force's clock, s."""
    beyond = 0.0 if stop == 1 else -2.0 * machine.stop
    return origin_at(machine, instant, x, velocity, beyond, damper_velocity - velocity, 0, stop)


def _rates(motion: Motion, flight: Flight) -> Array:
    """Return (X', X'', Z', Z'')."""
    if flight.joint:
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

    def __init__(self, machine: RigConstants) -> None:
        self.machine = machine
        self.impacts: list[bool] = []
        self.restitutions: list[float] = []
        self.crosses: list[bool] = []
        self.before: list[Array] = []
        self.after: list[Array] = []

    def add(self, kind: int, origin: Origin, before: Array, after: Array) -> None:
        """Add an event that leads to an origin, with the rates before and after it."""
        machine = self.machine
        restitution = machine.restitution_1 if kind == CONTACT_1 else machine.restitution_2
        self.impacts.append(kind in (CONTACT_1, CONTACT_2))
        self.restitutions.append(0.0 if origin.mode >= STICK else restitution)
        self.crosses.append(kind not in (RELEASE_UP, RELEASE_DOWN, NO_EVENT))
        self.before.append(before)
        self.after.append(after)

    def matrix(self, flights: list[FlightPart]) -> Array:
        """Return the derivative of the state at the end by the state at the beginning."""
        modes = np.array([part.origin.mode for part in flights], np.int64)
        spans = np.array([part.duration for part in flights])
        carried_by = flight_matrices(self.machine, modes, spans)
        events = event_matrices(
            self.machine.mass_ratio,
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


def _kind_of(kind: int, mode: int) -> EventKind:
    if kind in (CONTACT_1, CONTACT_2):
        return EventKind.IMPACT
    if kind in (RELEASE_UP, RELEASE_DOWN):
        return EventKind.RELEASE
    if mode in (REST_1, REST_2):
        return EventKind.REST
    return EventKind.STICK if mode == STICK else EventKind.REVERSAL


def follow_trajectory(
    machine: RigConstants, origin: Origin, duration: float, *, differentiate: bool = True
) -> Trajectory | None:
    """
    Follow the motion for a time; return None if it has more than `MOST_EVENTS` events.

    Without `differentiate` the matrix is the identity.
    """
    crossings = _Crossings(machine)
    events: list[TrajectoryEvent] = []
    flights: list[FlightPart] = []
    elapsed = 0.0
    flight = launch(machine, origin)
    for _ in range(MOST_EVENTS):
        left = duration - elapsed
        ended, end = first_end(origin, flight, left)
        if not ended:
            end = end_at(flight, NO_EVENT, left)
        kind, span = end.kind, end.tau
        flights.append(FlightPart(elapsed, span, origin, flight))
        if not ended:
            matrix = crossings.matrix(flights) if differentiate else np.eye(4)
            return Trajectory(carried(origin, flight, end), matrix, events, flights)
        mode = origin.mode
        transition = resolve(machine, origin, flight, end)
        origin = transition.origin
        ending, flight = flight, launch(machine, origin)
        if differentiate:
            rates = _rates(motion_at(ending, span), ending)
            crossings.add(kind, origin, rates, _rates(starting_motion(flight), flight))
        elapsed += span
        stop = _STOP_OF.get(origin.mode) or _STOP_OF.get(mode) or transition.stop
        reported = _kind_of(kind, origin.mode)
        if kind == NO_EVENT and reported is not EventKind.REST:
            continue
        before, after = transition.velocity_before, transition.velocity_after
        damper_before = before + transition.relative_velocity_before
        damper_after = after + transition.relative_velocity_after
        event = TrajectoryEvent(
            elapsed, reported, stop, origin.x, before, after, damper_before, damper_after
        )
        events.append(event)
        if kind in (CONTACT_1, CONTACT_2) and origin.mode in (REST_1, REST_2):
            events.append(TrajectoryEvent(elapsed, EventKind.REST, stop, origin.x, *(after,) * 4))
    return None
