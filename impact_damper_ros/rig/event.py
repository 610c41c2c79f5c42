"""Events and samples: what a run of the rig consists of."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

__all__ = [
    'ARRIVAL',
    'CONTACT_1',
    'CONTACT_2',
    'NO_EVENT',
    'RELEASE_DOWN',
    'RELEASE_UP',
    'REVERSAL',
    'STOP_ARRIVED_1',
    'STOP_ARRIVED_2',
    'Event',
    'EventKind',
    'Sample',
]


NO_EVENT = 0
CONTACT_1 = 1
CONTACT_2 = 2
REVERSAL = 3
#: A stop that follows m is where it should be.
ARRIVAL = 4
#: The support gives way, and m moves upwards.
RELEASE_UP = 5
RELEASE_DOWN = 6
STOP_ARRIVED_1 = 7
STOP_ARRIVED_2 = 8


class EventKind(IntEnum):
    """What happened."""

    #: m hit a stop.
    IMPACT = 1
    #: m has come to rest on a stop: a chatter accumulated, or the last impact was plastic.
    REST = 2
    #: m has come to rest in the gap, held by friction.
    STICK = 3
    #: m left its rest or sticking.
    RELEASE = 4
    #: The relative velocity changed sign within the gap, and with it friction.
    REVERSAL = 5
    #: A stop that moved, or had to follow m, has reached the position asked for.
    STOP_ARRIVED = 6
    #: X passed through zero; only reported where it is asked for.
    CROSSING = 7
    #: A moving stop and m have met: the stop stays there until it is moved again.
    STOP_TOUCHED = 8
    #: A sweep went on to its next frequency.
    FREQUENCY_STEP = 9


class Event(NamedTuple):
    """
    One event, with the velocities just before and just after it.

    Attributes
    ----------
    time : float
        The instant, s.
    kind : EventKind
        What happened.
    stop : int
        The stop concerned, 1 or 2, or 0.
    x, y : float
        X, and Y = Z - X, m.
    primary_velocity_before, primary_velocity_after : float
        Velocity of M, m/s.
    damper_velocity_before, damper_velocity_after : float
        Absolute velocity of m, m/s.
    impulse : float
        Modulus of the impulse between m and the stop, N s; 0 unless an impact.
    """

    time: float
    kind: EventKind
    stop: int
    x: float
    y: float
    primary_velocity_before: float
    primary_velocity_after: float
    damper_velocity_before: float
    damper_velocity_after: float
    impulse: float


class Sample(NamedTuple):
    """
    Motion at one instant, after any event at that instant; absolute, along the axis, SI units.

    `x` is X, so that all positions count from the present static equilibrium of M. `stop_1` and
    `stop_2` are the positions X + Y of the stops, which ride on M, and their velocities are X'
    plus what they have in M: their own one while they move, that of m while they follow it.
    """

    time: float
    x: float
    primary_velocity: float
    z: float
    damper_velocity: float
    stop_1: float
    stop_2: float
    stop_1_velocity: float
    stop_2_velocity: float
