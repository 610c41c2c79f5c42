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
from .contact import NO_EVENT, chatter_end, flight_end
from .crossing import sided
from .event_rows import MOST_ROWS, write_transition
from .flight import Flight, FlightEnd, Motion, motion_at, unfinished
from .kernels import kernel
from .mode import CHATTER_1, Machine, launch
from .origin import Origin, offset_of, placed, stop_rates
from .phase import advance_time
from .plain_impacts import flies_plainly, plain_impacts
from .transition import Transition, resolve

__all__ = ['DONE', 'FULL', 'RUNAWAY', 'SPENT', 'Progress', 'run_through']

#: All instants were reached.
DONE = 0
#: The array of events is full.
FULL = 1
#: The rig has had as many events as it may.
SPENT = 2
#: The rig has an endless number of events at one instant.
RUNAWAY = 3

_MOST_AT_ONCE = 10_000
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
    rate_1, rate_2 = stop_rates(origin, flight, speed)
    samples[row, 7] = motion.velocity + rate_1
    samples[row, 8] = motion.velocity + rate_2


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
    samples : array of float, shape (n, 9)
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
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    at_once_span = least_step(machine.joint.horizon) * 0.5
    while True:
        target = end
        if sampled < count:
            target = float(instants[sampled])
        if not known and node == 0.0 and flies_plainly(origin):
            before = happened
            origin, instant, written, happened, ending = plain_impacts(
                machine,
                damper_mass,
                origin,
                begun,
                target,
                numbers,
                codes,
                written,
                happened,
                most,
                in_mode,
                instant,
                at_once_span,
            )
            known = ending.kind != NO_EVENT
            node = ending.tau
            if happened > before:
                flight = launch(machine, origin)
                begun = 0.0
                at_once = 1
        since = (target - origin.time) - origin.time_low
        if not known and origin.mode >= CHATTER_1:
            ending = chatter_end(flight, origin.chatter_left)
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
            written = write_transition(
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
