"""
The run loop as a kernel: from flight to flight through a series of instants.

It goes the way of `Simulator.advance`, writes samples and events into arrays, and stops where an
array is full or the rig has had as many events as it may. What it reaches depends on the origin
alone, so that it may stop and be called again anywhere.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from .certificate import least_step
from .contact import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
    chatter_end,
    flight_end,
)
from .crossing import sided
from .event import EventKind
from .flight import Flight, FlightEnd, Motion, motion_at
from .kernels import kernel
from .mode import CHATTER_1, CHATTER_2, REST_1, REST_2, STICK, Machine, launch
from .origin import Origin, offset_of, placed
from .phase import advance_time
from .transition import Transition, resolve

__all__ = ['DONE', 'FULL', 'MOST_ROWS', 'RUNAWAY', 'SPENT', 'Progress', 'run_through']

#: All instants were reached.
DONE = 0
#: The array of events is full.
FULL = 1
#: The rig has had as many events as it may.
SPENT = 2
#: The rig has an endless number of events at one instant.
RUNAWAY = 3
#: Rows that one transition may take.
MOST_ROWS = 3

_IMPACT = int(EventKind.IMPACT)
_REST = int(EventKind.REST)
_STICK = int(EventKind.STICK)
_RELEASE = int(EventKind.RELEASE)
_REVERSAL = int(EventKind.REVERSAL)
_STOP_ARRIVED = int(EventKind.STOP_ARRIVED)
_STOP_TOUCHED = int(EventKind.STOP_TOUCHED)

_MOST_AT_ONCE = 100_000
# The tolerance of the search, so that an event which rounds to the end of a search belongs to it
_NEXT = 4.440892098500626e-16


class Progress(NamedTuple):
    """
    How far the run loop has come.

    Attributes
    ----------
    status : int
        `DONE`, `FULL`, `SPENT` or `RUNAWAY`.
    origin : Origin
        Origin of the present flight.
    time : float
        Time reached, s; the instant of the last sample or event, or the end.
    sampled, written, happened : int
        Samples and events written, and transitions made, written or not.
    """

    status: int
    origin: Origin
    time: float
    sampled: int
    written: int
    happened: int


@kernel(inline=True)
def _write_event(
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
    impulse: float,
) -> int:
    """Write one event into a row; return the next one."""
    numbers[row, 0] = origin.time
    numbers[row, 1] = origin.x
    numbers[row, 2] = offset_of(
        origin.clearance_1, origin.clearance_2, origin.stop_1, origin.stop_2
    )
    numbers[row, 3] = before
    numbers[row, 4] = after
    numbers[row, 5] = damper_before
    numbers[row, 6] = damper_after
    numbers[row, 7] = impulse
    codes[row, 8] = kind
    codes[row, 9] = stop
    codes[row, 10] = origin.mode
    return row + 1


@kernel(inline=True)
def _stop_under(mode: int) -> int:
    """Return the stop on which m rests, or bounces for the last times; 0 for none."""
    if mode in (REST_1, CHATTER_1):
        return 1
    return 2 if mode in (REST_2, CHATTER_2) else 0


@kernel(inline=True)
def _support_code(mode_before: int, mode: int) -> int:
    """Return as what a stop's coming up to m at rest is reported; 0 for nothing."""
    if mode_before >= STICK > mode:
        return _RELEASE
    if mode in (REST_1, REST_2) and (mode_before < STICK or mode_before >= CHATTER_1):
        return _REST
    return 0


@kernel(inline=True)
def _write_transition(
    machine: Machine,
    damper_mass: float,
    kind: int,
    ended: Origin,
    transition: Transition,
    numbers: Any,
    codes: Any,
    row: int,
) -> int:
    """Write what an event is reported as, none to three rows; return the next free row."""
    origin = transition.origin
    mode = origin.mode
    before = transition.velocity_before
    after = transition.velocity_after
    damper_before = before + transition.relative_velocity_before
    damper_after = after + transition.relative_velocity_after
    code = 0
    stop = 0
    impulse = 0.0
    if kind in (CONTACT_1, CONTACT_2):
        stop = transition.stop
        outward = transition.relative_velocity_before * (1.0 if stop == 1 else -1.0) > 0.0
        code = _IMPACT
        if (ended.stop_velocity_1 if stop == 1 else ended.stop_velocity_2) != 0.0:
            row = _write_event(
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
                code = _support_code(ended.mode, mode)
                if code == 0:
                    return row
                stop = _stop_under(mode if code == _REST else ended.mode)
        restitution = machine.restitution_1 if stop == 1 else machine.restitution_2
        if transition.relative_velocity_after == 0.0:
            restitution = 0.0
        impulse = (
            damper_mass
            * (1.0 + restitution)
            / (1.0 + machine.mass_ratio)
            * abs(transition.relative_velocity_before)
        )
    elif kind == ARRIVAL:
        code = _STOP_ARRIVED
        stop = 1 if origin.clearance_1 == 0.0 else 2
    elif kind in (STOP_ARRIVED_1, STOP_ARRIVED_2):
        code = _STOP_ARRIVED
        stop = 1 if kind == STOP_ARRIVED_1 else 2
    elif kind in (RELEASE_UP, RELEASE_DOWN):
        code = _RELEASE
        stop = _stop_under(ended.mode)
    elif mode in (REST_1, REST_2):
        code = _REST
        stop = 1 if mode == REST_1 else 2
    elif mode == STICK:
        code = _STICK
    elif kind == REVERSAL:
        code = _REVERSAL
    if code == 0:
        return row
    row = _write_event(
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
        impulse,
    )
    if code == _IMPACT and mode in (REST_1, REST_2):
        row = _write_event(
            numbers, codes, row, _REST, stop, origin, after, after, after, damper_after, 0.0
        )
    return row


@kernel(inline=True)
def _write_sample(
    samples: Any, row: int, time: float, origin: Origin, flight: Flight, tau: float
) -> None:
    """Write the motion at one instant."""
    motion: Motion = motion_at(flight, tau)
    clearance_1, clearance_2, stop_1, stop_2 = placed(origin, flight, tau, motion.travel)
    speed = 0.0 if flight.joint else motion.relative_velocity
    samples[row, 0] = time
    samples[row, 1] = motion.x
    samples[row, 2] = motion.velocity
    samples[row, 3] = motion.x + offset_of(clearance_1, clearance_2, stop_1, stop_2)
    samples[row, 4] = motion.velocity + speed
    samples[row, 5] = motion.x + stop_1
    samples[row, 6] = motion.x + stop_2


@kernel
def run_through(
    machine: Machine,
    damper_mass: float,
    origin: Origin,
    time: float,
    end: float,
    instants: Any,
    sampled: int,
    samples: Any,
    numbers: Any,
    codes: Any,
    most: int,
    in_mode: Any,
) -> tuple[int, tuple[Any, ...], float, int, int, int]:
    """
    Let a rig run to a later time.

    Parameters
    ----------
    machine : Machine
        The rig.
    damper_mass : float
        Mass m, kg, for the impulses.
    origin : Origin
        Origin of the present flight.
    time : float
        Time reached so far, s; not before the origin.
    end : float
        Time to reach, s.
    instants : array of float, shape (n,)
        Instants at which to sample, ascending, from `time` to `end`.
    sampled : int
        How many of them are done already.
    samples : array of float, shape (n, 7)
        Takes the samples, in the order of `Sample`.
    numbers, codes : array of float and of int, shape (rows, 11)
        The same memory. Takes of each event time, X, Y, velocities of M and m before and after,
        and impulse as floats, then kind, stop and mode after it as integers. Without a row, events
        are counted only.
    most : int
        How many transitions may be made.
    in_mode : array of float, shape (8,)
        Time spent in each mode is added to it, s.

    Returns
    -------
    tuple
        The fields of a `Progress`, with those of its origin. They are plain tuples, since making
        named ones runs Python code: a signal that came in meanwhile would raise its exception
        there, where compiled code cannot take one.
    """
    writing = len(codes) > 0
    flight: Flight = launch(machine, origin)
    node = 0.0
    known = False
    written = 0
    happened = 0
    instant = -inf
    at_once = 0
    count = len(instants)
    # Of the present flight, what belongs to the time before
    begun = (time - origin.time) - origin.time_low
    at_once_span = least_step(machine.joint.horizon) * 0.5
    while True:
        target = end
        if sampled < count:
            target = float(instants[sampled])
        since = (target - origin.time) - origin.time_low
        if not known and origin.mode >= CHATTER_1:
            ending: FlightEnd = chatter_end(flight, origin.chatter_left)
            known = True
        elif not known:
            ending = flight_end(flight, node, since + _NEXT * abs(target))
            known = ending.kind != NO_EVENT
            node = ending.tau
        if not known or advance_time(origin.time, origin.time_low, ending.tau)[0] > target:
            time = target
            if sampled == count:
                in_mode[origin.mode] += since - begun
                return DONE, origin[:], time, sampled, written, happened
            _write_sample(samples, sampled, target, origin, flight, max(0.0, since))
            sampled += 1
            continue
        status = DONE
        if happened >= most:
            status = SPENT
        elif at_once > _MOST_AT_ONCE:
            status = RUNAWAY
        elif writing and written + MOST_ROWS > len(codes):
            status = FULL
        if status != DONE:
            time = max(time, origin.time)
            in_mode[origin.mode] += max(0.0, ((time - origin.time) - origin.time_low) - begun)
            return status, origin[:], time, sampled, written, happened
        in_mode[origin.mode] += ending.tau - begun
        ended = origin
        transition: Transition = resolve(machine, ended, flight, ending)
        origin = sided(machine.free, ended, flight, transition.origin)
        happened += 1
        if writing:
            written = _write_transition(
                machine, damper_mass, ending.kind, ended, transition, numbers, codes, written
            )
        if origin.time > instant + at_once_span:
            instant = origin.time
            at_once = 0
        at_once += 1
        flight = launch(machine, origin)
        node = 0.0
        begun = 0.0
        known = False
