"""
The run loop as a kernel: from flight to flight through a series of instants.

It makes the motion of `Simulator.advance`, writes samples and events into arrays, and stops where
an array is full or the rig has had its most events. The result depends on the origin alone, so
that the loop may stop and be called again anywhere. Impacts between standing stops take a shorter
path, with the same kernels and digits; all other flights and events are left to `contact` and
`transition`.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from .certificate import least_step
from .contact import chatter_end, flight_end, search_contact
from .crossing import has_side, sided
from .event import IMPACT, MOST_ROWS, write_event, write_transition
from .flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    Flight,
    FlightEnd,
    Motion,
    motion_at,
    starting_motion,
    unfinished,
)
from .kernels import kernel
from .mode import CHATTER_1, STICK, RigConstants, launch, moving_flight
from .origin import (
    Origin,
    advance_time,
    carried,
    offset_of,
    on_stop,
    placed,
    stop_rates,
)
from .transition import Transition, impulse, is_no_chatter, moving_mode, rebounded, resolve


@kernel(inline=True)
def flies_plainly(origin: Origin) -> bool:
    """Return whether m moves between two stops that stand at their targets."""
    return (
        origin.mode < STICK
        and not origin.released
        and origin.relative_velocity != 0.0
        and origin.stop_velocity_1 == 0.0
        and origin.stop_velocity_2 == 0.0
        and origin.stop_1 <= origin.target_1
        and origin.stop_2 >= origin.target_2
    )


@kernel(inline=True)
def plain_impacts(
    rig: RigConstants,
    damper_mass: float,
    origin: Origin,
    begun: float,
    target: float,
    numbers: Any,
    codes: Any,
    written: int,
    happened: int,
    most: int,
    in_mode: Any,
    instant: float,
    span: float,
) -> tuple[Origin, float, int, int, FlightEnd]:
    """Go from impact to impact as long as nothing else happens."""
    writing = len(codes) > 0
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    while happened < most and not (writing and written + MOST_ROWS > len(codes)):
        flight: Flight = moving_flight(rig, origin)
        motion: Motion = starting_motion(flight)
        ending = search_contact(flight, 0.0, motion)
        if ending.kind not in (CONTACT_1, CONTACT_2):
            break
        stop = 1 if ending.kind == CONTACT_1 else 2
        there = carried(origin, flight, ending)
        if there.time > target or there.time <= instant + span:
            break
        there = on_stop(rig.one_sided, there, stop, there.stop_1, there.stop_2)
        restitution, relative_before, after, relative_after = rebounded(rig, there, stop)
        hit = there._replace(
            mode=moving_mode(rig, relative_after),
            velocity=after,
            relative_velocity=relative_after,
            last_stop=stop,
        )
        if (
            relative_after == 0.0
            or not is_no_chatter(rig, hit, stop)
            or not has_side(rig.free, hit)
        ):
            break
        in_mode[origin.mode] += ending.tau - begun
        if writing:
            push = impulse(damper_mass, rig.mass_ratio, restitution, relative_before)
            before = there.velocity
            written = write_event(
                numbers,
                codes,
                written,
                IMPACT,
                stop,
                hit,
                before,
                after,
                before + relative_before,
                after + relative_after,
                push,
            )
        origin = hit
        instant = origin.time
        begun = 0.0
        happened += 1
        ending = unfinished(NO_EVENT, 0.0)
    return origin, instant, written, happened, ending


#: All instants were reached.
DONE = 0
#: The array of events is full.
FULL = 1
#: The rig has had its most events.
SPENT = 2
#: The rig has events without end at one instant.
RUNAWAY = 3

_MOST_AT_ONCE = 10_000
# The tolerance of the search, so that an event which rounds to the end of a search belongs to it
_NEXT = 4.440892098500626e-16


class Progress(NamedTuple):
    """
    State of the run loop.

    Attributes
    ----------
    status : int
        `DONE`, `FULL`, `SPENT` or `RUNAWAY`.
    origin : Origin
        Origin of the present flight.
    time : float
        Time reached, s; the instant of the last sample or event, or the end.
    sampled, written, happened : int
        Number of samples and events written, and of transitions, written or not.
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
    rig: RigConstants,
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
    """Let a rig run to a later time."""
    writing = len(codes) > 0
    flight: Flight = launch(rig, origin)
    searched = 0.0
    known = False
    written = 0
    happened = 0
    instant = -inf
    at_once = 0
    count = len(instants)
    # The part of the present flight before the present time
    begun = (time - origin.time) - origin.time_low
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    at_once_span = least_step(rig.joint.horizon) * 0.5
    while True:
        target = end
        if sampled < count:
            target = float(instants[sampled])
        if not known and searched == 0.0 and flies_plainly(origin):
            before = happened
            origin, instant, written, happened, ending = plain_impacts(
                rig,
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
            searched = ending.tau
            if happened > before:
                flight = launch(rig, origin)
                begun = 0.0
                at_once = 1
        since = (target - origin.time) - origin.time_low
        if not known and origin.mode >= CHATTER_1:
            ending = chatter_end(flight, origin.chatter_left)
            known = True
        elif not known:
            ending = flight_end(flight, searched, since + _NEXT * abs(target))
            known = ending.kind != NO_EVENT
            searched = ending.tau
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
        transition: Transition = resolve(rig, ended, flight, ending)
        origin = sided(rig.free, ended, flight, transition.origin)
        happened += 1
        if writing:
            written = write_transition(
                rig, damper_mass, ending.kind, ended, transition, numbers, codes, written
            )
        if origin.time > instant + at_once_span:
            instant = origin.time
            at_once = 0
        at_once += 1
        flight = launch(rig, origin)
        searched = 0.0
        begun = 0.0
        known = False
