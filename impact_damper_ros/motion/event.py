# SPDX-License-Identifier: Apache-2.0
"""Events and samples: what a run of the rig consists of, and the rows that kernels write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from math import cos, sin
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .flight import Motion, motion_after, places_after, stop_rates
from .kernels import kernel
from .oscillator import Line
from .records import dtype_of
from .state import Moving, Run, Wave, carried_to, offset_of, place


class EventKind(IntEnum):
    """
    Kind of an event.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> events = Rig(RigParameters(gravity=0.0)).advance(60.0)
    >>> sum(event.kind is EventKind.IMPACT for event in events)
    7
    """

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
    #: X passed through zero; reported under control only.
    CROSSING = 7
    #: A stop met m on the way to its target: m blocks the stop, which follows m from there.
    STOP_TOUCHED = 8
    #: A stepped sine went on to its next frequency.
    FREQUENCY_STEP = 9
    #: A stop that m blocked moves by itself again.
    STOP_STARTED = 10
    #: The active force on M changed.
    FORCE_STEP = 11


#: The kinds as numbers, for the kernels.
IMPACT, REST_EVENT, STICK_EVENT, RELEASE_EVENT, REVERSAL_EVENT, *_others = map(int, EventKind)
STOP_ARRIVED, CROSSING, STOP_TOUCHED, _, STOP_STARTED, FORCE_STEP = _others


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
        Modulus of the impulse between m and the stop, N s; 0 unless an impact. For a `FORCE_STEP`:
        the new active force on M, N.
    mode : int
        The `Mode` after the event; -1 if unknown, as for a recorded event.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> event = Rig(RigParameters(gravity=0.0)).advance(45.0)[0]
    >>> event.kind.name, event.stop, round(event.damper_velocity_after, 9)
    ('IMPACT', 1, -11.513253688)
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
    mode: int = -1

    @property
    def side(self) -> int:
        """Sign of Y at its stop: +1 at stop 1, -1 at stop 2."""
        return 1 if self.stop == 1 else -1


class Sample(NamedTuple):
    """
    Motion at one instant, after any event at that instant; absolute, along the axis, SI units.

    `x` is X, so that all positions count from the present static equilibrium of M. `stop_1` and
    `stop_2` are the positions X + Y of the stops, which ride on M. The velocity of a stop is X'
    plus its velocity in M: that of its actuator, or Y' while the stop follows m. `base` is the
    displacement b of the base: the spring is stretched by x - base more than in the equilibrium.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> rig = Rig(RigParameters(gravity=0.0))
    >>> _ = rig.advance(30.0)
    >>> rig.sample().time, round(rig.sample().x, 6)
    (30.0, -2.605725)
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
    base: float = 0.0
    base_velocity: float = 0.0


@dataclass(slots=True)
class EventRow:
    """A row of the table of events: an `Event`."""

    time: float = 0.0
    x: float = 0.0
    y: float = 0.0
    primary_velocity_before: float = 0.0
    primary_velocity_after: float = 0.0
    damper_velocity_before: float = 0.0
    damper_velocity_after: float = 0.0
    impulse: float = 0.0
    kind: int = 0
    stop: int = 0
    mode: int = 0


#: The table that kernels write.
Log = Sequence[EventRow]
#: One event, as `EventRow`.
EVENT_TYPE = np.dtype(dtype_of(EventRow).descr)
#: One sample, as `Sample`.
SAMPLE_TYPE = np.dtype([(name, 'f8') for name in Sample._fields])
#: Rows that must be free for the events of one transition.
ROWS_AT_ONCE = 8

_FIELDS = attrgetter(*Event._fields[3:])
_KINDS = {int(kind): kind for kind in EventKind}


def events_of(rows: Sequence[EventRow], count: int) -> list[Event]:
    """Return the first rows of a table as events."""
    return [Event(row.time, _KINDS[row.kind], row.stop, *_FIELDS(row)) for row in rows[:count]]


def table_of_events(events: Sequence[Event]) -> NDArray[np.void]:
    """Return events as an array of EVENT_TYPE."""
    return np.array([(e.time, *e[3:-1], e.kind, e.stop, e.mode) for e in events], EVENT_TYPE)


def events_of_table(table: Any) -> list[Event]:
    """Return the rows of an array of EVENT_TYPE as events."""
    rows = table.tolist()
    return [Event._make((row[0], _KINDS[row[8]], row[9], *row[1:8], row[10])) for row in rows]


@kernel
def carry(run: Run, row: EventRow) -> None:
    """Make an event absolute: add the motion that a record gives to the base."""
    base, speed = carried_to(run, row.time)
    row.x += base
    row.primary_velocity_before += speed
    row.primary_velocity_after += speed
    row.damper_velocity_before += speed
    row.damper_velocity_after += speed


@kernel(inline=True)
def write_event(
    run: Run,
    log: Log,
    kind: int,
    stop: int,
    before: float,
    after: float,
    damper_before: float,
    damper_after: float,
    impulse: float,
) -> None:
    """Write an event at the origin into the table, if there is one."""
    if run.room == 0:
        return
    row = log[run.written]
    run.written += 1
    row.time = run.time
    row.x = run.x
    row.y = place(run)
    row.primary_velocity_before = before
    row.primary_velocity_after = after
    row.damper_velocity_before = damper_before
    row.damper_velocity_after = damper_after
    row.impulse = impulse
    row.kind = kind
    row.stop = stop
    row.mode = run.mode
    if run.carried:
        carry(run, row)


@kernel
def write_quiet(run: Run, log: Log, kind: int, stop: int) -> None:
    """Write an event at the origin that leaves all velocities as they are."""
    velocity = run.velocity
    damper = velocity + run.relative_velocity
    write_event(run, log, kind, stop, velocity, velocity, damper, damper, 0.0)


class View(NamedTuple):
    """Positions and velocities of M, m and the stops at an instant: X, then Y relative to M."""

    x: float
    velocity: float
    y: float
    y_rate: float
    stop_1: float
    stop_2: float
    stop_rate_1: float
    stop_rate_2: float


@kernel(inline=True)
def view_at(moving: Moving, time: float) -> View:
    """Return the positions and velocities at an instant of the flight."""
    run = moving.run
    tau = max(0.0, (time - run.time) - run.time_low)
    motion: Motion = motion_after(moving, tau)
    clearance_1, clearance_2, stop_1, stop_2 = places_after(run, tau, motion.travel)
    y = offset_of(clearance_1, clearance_2, stop_1, stop_2)
    speed = 0.0 if run.joint else motion.relative_velocity
    rate_1, rate_2 = stop_rates(run, speed)
    return View(motion.x, motion.velocity, y, speed, stop_1, stop_2, rate_1, rate_2)


@kernel
def write_passage(moving: Moving) -> None:
    """Write the passage of X through zero at the present time."""
    _, _, run, _, log = moving
    if run.room == 0:
        return
    view: View = view_at(moving, run.now)
    row = log[run.written]
    run.written += 1
    row.time = run.now
    row.x = view.x
    row.y = view.y
    row.primary_velocity_before = view.velocity
    row.primary_velocity_after = view.velocity
    row.damper_velocity_before = view.velocity + view.y_rate
    row.damper_velocity_after = view.velocity + view.y_rate
    row.impulse = 0.0
    row.kind = CROSSING
    row.stop = 0
    row.mode = run.mode
    if run.carried:
        carry(run, row)


@kernel
def base_at(moving: Moving, time: float) -> tuple[float, float]:
    """Return displacement and velocity of the base at an instant of the flight, m and m/s."""
    constants, lines, run, waves, _ = moving
    tau = max(0.0, (time - run.time) - run.time_low)
    base = 0.0
    velocity = 0.0
    for j in range(constants.base_first, constants.base_end):
        line: Line = lines[j]
        wave: Wave = waves[j]
        turn = line.frequency * tau
        sine = sin(turn)
        cosine = cos(turn)
        here = wave.sine_0 * cosine + wave.cosine_0 * sine
        ahead = wave.cosine_0 * cosine - wave.sine_0 * sine
        base += line.base_sine * here + line.base_cosine * ahead
        velocity += line.frequency * (line.base_sine * ahead - line.base_cosine * here)
    return base, velocity


@kernel
def sample_at(
    moving: Moving, time: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """Return the motion at an instant of the flight, in the order of `Sample`."""
    view: View = view_at(moving, time)
    base, base_velocity = base_at(moving, time)
    x = view.x
    velocity = view.velocity
    if moving.run.carried:
        place_of_base, speed = carried_to(moving.run, time)
        x += place_of_base
        velocity += speed
        base += place_of_base
        base_velocity += speed
    return (
        time,
        x,
        velocity,
        x + view.y,
        velocity + view.y_rate,
        x + view.stop_1,
        x + view.stop_2,
        velocity + view.stop_rate_1,
        velocity + view.stop_rate_2,
        base,
        base_velocity,
    )
