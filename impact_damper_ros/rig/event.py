"""Events and samples: what a run of the rig consists of, and the rows that kernels write."""

from __future__ import annotations

from enum import IntEnum
from operator import itemgetter
from typing import Any, NamedTuple

from .flight import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
)
from .kernels import kernel
from .mode import CHATTER_1, CHATTER_2, REST_1, REST_2, STICK, RigConstants
from .origin import Origin, offset_of
from .transition import Transition, impulse_of


class EventKind(IntEnum):
    """Kind of an event."""

    #: m hit a stop.
    IMPACT = 1
    #: m came to rest on a stop: a chatter accumulated, or the last impact was plastic.
    REST = 2
    #: m came to rest in the gap, held by friction.
    STICK = 3
    #: m left its rest or sticking.
    RELEASE = 4
    #: The relative velocity changed sign within the gap, and with it friction.
    REVERSAL = 5
    #: A stop reached its target.
    STOP_ARRIVED = 6
    #: X passed through zero; reported by `advance_to_crossing` only.
    CROSSING = 7
    #: A moving stop and m met: the stop stays there until its next command.
    STOP_TOUCHED = 8
    #: A stepped sine went on to its next frequency.
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


#: Rows that one transition may take.
MOST_ROWS = 3
#: Rows that plain kernels write at once, at most.
MOST_TOGETHER = 512
IMPACT = int(EventKind.IMPACT)
_REST = int(EventKind.REST)
_STICK = int(EventKind.STICK)
_RELEASE = int(EventKind.RELEASE)
_REVERSAL = int(EventKind.REVERSAL)
_STOP_ARRIVED = int(EventKind.STOP_ARRIVED)
_STOP_TOUCHED = int(EventKind.STOP_TOUCHED)
_CROSSING = int(EventKind.CROSSING)


@kernel(inline=True)
def write_event(
    numbers: Any,
    codes: Any,
    row: int,
    kind: int,
    stop: int,
    origin: Origin,
    before: float,
    after: float,
    damper_before: float,
    damper_after: float,
    push: float,
) -> int:
    """Write one event into a row of the table; return the next row."""
    numbers[row, 0] = origin.time
    numbers[row, 1] = origin.x
    numbers[row, 2] = offset_of(
        origin.clearance_1, origin.clearance_2, origin.stop_1, origin.stop_2
    )
    numbers[row, 3] = before
    numbers[row, 4] = after
    numbers[row, 5] = damper_before
    numbers[row, 6] = damper_after
    numbers[row, 7] = push
    codes[row, 8] = kind
    codes[row, 9] = stop
    codes[row, 10] = origin.mode
    return row + 1


@kernel(inline=True)
def stop_under(mode: int) -> int:
    """Return the stop on which m rests or ends its chatter; 0 for none."""
    if mode in (REST_1, CHATTER_1):
        return 1
    return 2 if mode in (REST_2, CHATTER_2) else 0


@kernel(inline=True)
def support_code(mode_before: int, mode: int) -> int:
    """Return the kind of event as which a change of support is reported; 0 for none."""
    if mode_before >= STICK > mode:
        return _RELEASE
    if mode in (REST_1, REST_2) and (mode_before < STICK or mode_before >= CHATTER_1):
        return _REST
    return 0


@kernel(inline=True)
def write_transition(
    rig: RigConstants,
    damper_mass: float,
    kind: int,
    ended: Origin,
    transition: Transition,
    numbers: Any,
    codes: Any,
    row: int,
) -> int:
    """Write the events that a transition is reported as, up to three; return the next row."""
    origin = transition.origin
    mode = origin.mode
    before = transition.velocity_before
    after = transition.velocity_after
    damper_before = before + transition.relative_velocity_before
    damper_after = after + transition.relative_velocity_after
    code = 0
    stop = 0
    push = 0.0
    if kind in (CONTACT_1, CONTACT_2):
        stop = transition.stop
        outward = transition.relative_velocity_before * (1.0 if stop == 1 else -1.0) > 0.0
        code = IMPACT
        if (ended.stop_velocity_1 if stop == 1 else ended.stop_velocity_2) != 0.0:
            row = write_event(
                numbers,
                codes,
                row,
                _STOP_TOUCHED,
                stop,
                origin,
                before,
                before,
                damper_before,
                damper_before,
                0.0,
            )
            if not outward:
                code = support_code(ended.mode, mode)
                if code == 0:
                    return row
                stop = stop_under(mode if code == _REST else ended.mode)
        push = impulse_of(rig, damper_mass, transition)
    elif kind == ARRIVAL:
        code = _STOP_ARRIVED
        stop = 1 if origin.clearance_1 == 0.0 else 2
    elif kind in (STOP_ARRIVED_1, STOP_ARRIVED_2):
        code = _STOP_ARRIVED
        stop = 1 if kind == STOP_ARRIVED_1 else 2
    elif kind in (RELEASE_UP, RELEASE_DOWN):
        code = _RELEASE
        stop = stop_under(ended.mode)
    elif mode in (REST_1, REST_2):
        code = _REST
        stop = 1 if mode == REST_1 else 2
    elif mode == STICK:
        code = _STICK
    elif kind == REVERSAL:
        code = _REVERSAL
    if code == 0:
        return row
    row = write_event(
        numbers,
        codes,
        row,
        code,
        stop,
        origin,
        before,
        after,
        damper_before,
        damper_after,
        push,
    )
    if code == IMPACT and mode in (REST_1, REST_2):
        row = write_event(
            numbers, codes, row, _REST, stop, origin, after, after, after, damper_after, 0.0
        )
    return row


@kernel
def write_quiet(
    kind: int, stop: int, origin: Origin, time: float, numbers: Any, codes: Any, row: int
) -> int:
    """Write an event that leaves all velocities as they are; return the next row."""
    velocity = origin.velocity
    damper = velocity + origin.relative_velocity
    there = origin._replace(time=time)
    return write_event(
        numbers, codes, row, kind, stop, there, velocity, velocity, damper, damper, 0.0
    )


@kernel
def write_crossing(origin: Origin, time: float, numbers: Any, codes: Any, row: int) -> int:
    """Write a passage of X through zero; return the next row."""
    return write_quiet(_CROSSING, 0, origin, time, numbers, codes, row)


@kernel
def write_command(
    stop: int, arrived: bool, origin: Origin, numbers: Any, codes: Any, row: int
) -> int:
    """Write that a stop is at its target, or at m, just after a command; return the next row."""
    kind = _STOP_ARRIVED if arrived else _STOP_TOUCHED
    return write_quiet(kind, stop, origin, origin.time, numbers, codes, row)


@kernel
def write_support(mode_before: int, origin: Origin, numbers: Any, codes: Any, row: int) -> int:
    """Write the rest or release that a command to a stop causes, if any; return the next row."""
    code = support_code(mode_before, origin.mode)
    if code == 0:
        return row
    stop = stop_under(origin.mode if code == _REST else mode_before)
    return write_quiet(code, stop, origin, origin.time, numbers, codes, row)


# The fields of `Event` in a row
_FIELDS = [
    itemgetter(*[(row, column) for column in (0, 8, 9, 1, 2, 3, 4, 5, 6, 7)])
    for row in range(MOST_TOGETHER)
]
_KINDS = {int(kind): kind for kind in EventKind}


class EventRows(dict[tuple[int, int], Any]):
    """The table that plain kernels write into, by row and column: floats and codes together."""

    def events(self, count: int) -> list[Event]:
        """Return the first rows, up to `MOST_TOGETHER`, as events."""
        events = []
        for fields in _FIELDS[:count]:
            time, kind, *others = fields(self)
            events.append(Event(time, _KINDS[kind], *others))
        return events


def make_event(kind: EventKind, stop: int, origin: Origin) -> Event:
    """Return an event that leaves all velocities as they are."""
    rows = EventRows()
    write_quiet(kind, stop, origin, origin.time, rows, rows, 0)
    return rows.events(1)[0]
