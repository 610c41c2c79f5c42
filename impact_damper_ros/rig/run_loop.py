"""
The run loop: from flight to flight, as kernels; every run of a rig goes through it.

`go_on` finds the next event, moves there and resolves it, up to an instant or to the next passage
of X through zero. A flight is never begun anew to sample, watch or pause it. Hence the motion does
not depend on the sampling rate or on how a run is cut into pieces, to the last bit. Impacts
between standing stops take a shorter path, with the same kernels and digits.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from .certificate import least_step
from .changes import ARRIVED, MOVING, commanded, supports
from .contact import ALL_STEPS, chatter_end, flight_end, search_contact
from .crossing import has_side, next_crossing, sided
from .event import (
    IMPACT,
    MOST_ROWS,
    stop_under,
    write_command,
    write_crossing,
    write_event,
    write_support,
    write_transition,
)
from .flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    Flight,
    FlightEnd,
    Motion,
    end_at,
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
from .transition import (
    Transition,
    at_rest,
    impulse,
    is_no_chatter,
    moving_mode,
    rebounded,
    resolve,
    struck,
)

#: The instant was reached.
DONE = 0
#: The table of events is full.
FULL = 1
#: The rig has had its most events.
SPENT = 2
#: The rig has events without end at one instant.
RUNAWAY = 3
#: X passes through zero.
CROSSED = 4
#: The steps of a search, or an event, were made after which to pause.
PAUSED = 5

#: More events than any chatter has, at one instant to round-off.
MOST_AT_ONCE = 10_000
# The tolerance of the search, so that an event which rounds to the end of a search belongs to it
_NEXT = 4.440892098500626e-16
#: Rows that must be free where a passage of X through zero is reported with all its events.
ROWS_AT_ONCE = 16 * MOST_ROWS
#: Horizons searched for a passage in a row where the loop is to pause.
_HORIZONS = 16.0


class OpenFlight(NamedTuple):
    """
    The present flight, and what is known of its end.

    Attributes
    ----------
    origin : Origin
        Its origin.
    flight : Flight
        Its motion.
    ending : FlightEnd
        The event that ends it, or up to when there is none.
    due : float
        Instant of that event, s; infinite before it is known.
    counted : float
        Time since the origin that is in the account of the modes, s.
    side : int
        Sign of X before the next passage through zero; 0 before the first look.
    watched : float
        Time since the origin that has been searched for passages, s.
    crossing : float
        Instant of the next passage, s; infinite before it is known.
    instant : float
        When the last events happened, s, and
    at_once : int
        how many, to round-off.
    """

    origin: Origin
    flight: Flight
    ending: FlightEnd
    due: float
    counted: float
    side: int
    watched: float
    crossing: float
    instant: float
    at_once: int


@kernel(inline=True)
def _known_end(origin: Origin, flight: Flight) -> tuple[FlightEnd, float]:
    """Return the end of a flight that needs no search, and its instant; infinity for others."""
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    due = inf
    if origin.mode >= CHATTER_1:
        ending = chatter_end(flight, origin.chatter_left)
        due = advance_time(origin.time, origin.time_low, ending.tau)[0]
    return ending, due


@kernel
def open_flight(rig: RigConstants, origin: Origin, time: float) -> OpenFlight:
    """Return the flight that begins at an origin, to be counted from a time on."""
    flight: Flight = launch(rig, origin)
    ending, due = _known_end(origin, flight)
    since = (time - origin.time) - origin.time_low
    return OpenFlight(origin, flight, ending, due, since, 0, 0.0, inf, -inf, 0)


@kernel
def first_end(
    origin: Origin, flight: Flight, span: float, most: int = ALL_STEPS
) -> tuple[bool, FlightEnd]:
    """Return whether a flight ends within a time, and its end or how far it has been searched."""
    if origin.mode >= CHATTER_1:
        ending: FlightEnd = chatter_end(flight, origin.chatter_left)
        return ending.tau <= span, ending
    ending = flight_end(flight, 0.0, span, most)
    return ending.kind != NO_EVENT and ending.tau <= span, ending


@kernel
def state_at(here: OpenFlight, time: float) -> Origin:
    """Return the state at an instant of a flight, as an origin."""
    since = max(0.0, (time - here.origin.time) - here.origin.time_low)
    return carried(here.origin, here.flight, end_at(here.flight, NO_EVENT, since))


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
    counted: float,
    until: float,
    numbers: Any,
    codes: Any,
    room: int,
    written: int,
    most: int,
    in_mode: Any,
    instant: float,
    span: float,
) -> tuple[Origin, float, int, int, FlightEnd]:
    """Go from impact to impact as long as nothing else happens."""
    happened = 0
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    while happened < most and (room == 0 or written + ROWS_AT_ONCE <= room):
        flight: Flight = moving_flight(rig, origin)
        motion: Motion = starting_motion(flight)
        ending = search_contact(flight, 0.0, motion)
        if ending.kind not in (CONTACT_1, CONTACT_2):
            break
        stop = 1 if ending.kind == CONTACT_1 else 2
        there = carried(origin, flight, ending)
        if there.time > until or there.time <= instant + span:
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
        in_mode[origin.mode] += ending.tau - counted
        if room > 0:
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
        counted = 0.0
        happened += 1
        ending = unfinished(NO_EVENT, 0.0)
    return origin, instant, written, happened, ending


@kernel(inline=True)
def go_on(
    rig: RigConstants,
    damper_mass: float,
    here: OpenFlight,
    time: float,
    until: float,
    ahead: float,
    watch: bool,
    most: int,
    steps: int,
    numbers: Any,
    codes: Any,
    room: int,
    written: int,
    in_mode: Any,
) -> tuple[int, float, OpenFlight, int, int]:
    """
    Let a rig run from a time to an instant, or to the next passage of X through zero.

    Parameters
    ----------
    rig, damper_mass : RigConstants, float
        The rig, and m in kg.
    here : OpenFlight
        The present flight.
    time, until : float
        The present time and the instant, s.
    ahead : float
        Instant up to which to look for the next event and passage, not before `until`, s.
    watch : bool
        Whether to stop at a passage of X through zero.
    most : int
        Most transitions.
    steps : int
        Steps of a search after which to pause, and after each event; `ALL_STEPS` for never.
    numbers, codes, room, written : array, array, int, int
        The table of events, its rows, 0 for none, and how many of them are written.
    in_mode : array
        Account of the time in each mode, up to the last event.

    Returns
    -------
    status : int
        `DONE`, `FULL`, `SPENT`, `RUNAWAY`, `CROSSED` or `PAUSED`.
    time : float
        Time reached, s.
    here : OpenFlight
        The flight then.
    written, happened : int
        Rows written in all, and transitions.
    """
    origin = here.origin
    flight: Flight = here.flight
    ending: FlightEnd = here.ending
    due = here.due
    counted = here.counted
    side = here.side
    watched = here.watched
    crossing = here.crossing
    instant = here.instant
    at_once = here.at_once
    status = DONE
    happened = 0
    passing = False
    at_once_span = least_step(rig.joint.horizon) * 0.5
    while True:
        if due == inf:
            if not watch and ending.tau == 0.0 and flies_plainly(origin) and steps == ALL_STEPS:
                origin, instant, written, count, ending = plain_impacts(
                    rig,
                    damper_mass,
                    origin,
                    counted,
                    until,
                    numbers,
                    codes,
                    room,
                    written,
                    most - happened,
                    in_mode,
                    instant,
                    at_once_span,
                )
                if count > 0:
                    happened += count
                    flight = launch(rig, origin)
                    counted = 0.0
                    side = 0
                    at_once = 1
            if ending.kind == NO_EVENT:
                limit = (ahead - origin.time) - origin.time_low + _NEXT * abs(ahead)
                ending = flight_end(flight, ending.tau, limit, steps)
                if ending.kind == NO_EVENT and ending.tau <= limit:
                    if max(time, origin.time) < until:
                        status = PAUSED
                        break
                    continue
            if ending.kind != NO_EVENT:
                due = advance_time(origin.time, origin.time_low, ending.tau)[0]
        if watch and not passing:
            horizons = inf if steps == ALL_STEPS else _HORIZONS
            if side == 0:
                watched = 0.0
                crossing = inf
            decided, side, watched, crossing = next_crossing(
                origin, flight, side, watched, crossing, time, min(due, ahead), horizons
            )
            if not decided:
                if max(time, origin.time) < until:
                    status = PAUSED
                    break
                continue
            if crossing <= until and crossing <= due:
                # Other events of that instant come first.
                until = crossing
                passing = True
        if due > until:
            time = until
            if passing:
                status = CROSSED
                if room > 0:
                    since = max(0.0, (time - origin.time) - origin.time_low)
                    there = carried(origin, flight, end_at(flight, NO_EVENT, since))
                    written = write_crossing(there, time, numbers, codes, written)
            break
        if happened >= most and not passing:
            status = SPENT
        elif at_once > MOST_AT_ONCE:
            status = RUNAWAY
        elif room > 0 and written + (MOST_ROWS + 1 if passing else ROWS_AT_ONCE) > room:
            status = FULL
        if status != DONE:
            break
        in_mode[origin.mode] += ending.tau - counted
        ended = origin
        transition: Transition = resolve(rig, ended, flight, ending)
        origin = sided(rig.free, ended, flight, transition.origin)
        happened += 1
        if room > 0:
            written = write_transition(
                rig, damper_mass, ending.kind, ended, transition, numbers, codes, written
            )
        if origin.time > instant + at_once_span:
            instant = origin.time
            at_once = 0
        at_once += 1
        flight = launch(rig, origin)
        ending, due = _known_end(origin, flight)
        counted = 0.0
        side = 0
        if steps < ALL_STEPS and not passing and origin.time < until:
            status = PAUSED
            break
    if status not in (DONE, CROSSED):
        time = max(time, origin.time)
    if side == 0:
        watched = 0.0
        crossing = inf
    here = OpenFlight(
        origin, flight, ending, due, counted, side, watched, crossing, instant, at_once
    )
    return status, time, here, written, happened


@kernel
def clear_until(here: OpenFlight, watch: bool) -> float:
    """Return the instant before which nothing happens, as far as the flight has been searched."""
    origin: Origin = here.origin
    clear = here.due
    if clear == inf:
        reached = origin.time + here.ending.tau
        clear = reached - 4.0 * _NEXT * abs(reached)
    if watch:
        crossing = here.crossing
        if crossing == inf:
            reached = origin.time + here.watched
            crossing = reached - 4.0 * _NEXT * abs(reached)
        clear = min(clear, crossing)
    return clear


@kernel(inline=True)
def accounted(here: OpenFlight, time: float, in_mode: Any) -> float:
    """Bring the account of the modes up to a time; return the time counted since the origin."""
    since = (time - here.origin.time) - here.origin.time_low
    if since <= here.counted:
        return here.counted
    in_mode[here.origin.mode] += since - here.counted
    return since


@kernel
def started(
    rig: RigConstants,
    damper_mass: float,
    origin: Origin,
    numbers: Any,
    codes: Any,
    written: int,
) -> tuple[Origin, int]:
    """Return the origin that follows from a state of unknown mode, after the impact if any."""
    if origin.relative_velocity == 0.0:
        still = at_rest(rig, origin)
        # A chatter that its stop still bears comes to rest when it would have done.
        if origin.mode >= CHATTER_1 and stop_under(still.mode) == stop_under(origin.mode):
            return origin, written
        return still, written
    on_1, on_2 = supports(origin)
    if (on_1 and origin.relative_velocity > 0.0) or (on_2 and origin.relative_velocity < 0.0):
        stop = 1 if origin.relative_velocity > 0.0 else 2
        transition: Transition = struck(rig, origin, stop)
        standing = transition.origin._replace(stop_velocity_1=0.0, stop_velocity_2=0.0)
        kind = CONTACT_1 if stop == 1 else CONTACT_2
        written = write_transition(
            rig, damper_mass, kind, standing, transition, numbers, codes, written
        )
        return transition.origin, written
    mode = moving_mode(rig, origin.relative_velocity)
    return origin._replace(mode=mode, chatter_left=0.0), written


@kernel
def stops_moved(
    rig: RigConstants,
    damper_mass: float,
    here: OpenFlight,
    time: float,
    watched: bool,
    stop_1: float,
    stop_2: float,
    speed: float,
    numbers: Any,
    codes: Any,
    written: int,
) -> tuple[Origin, int]:
    """
    Carry out a command to the stops at an instant.

    Parameters
    ----------
    rig, damper_mass, here, time : RigConstants, float, OpenFlight, float
        The rig, its present flight and time.
    watched : bool
        Whether `go_on` has searched for passages of X through zero up to this time.
    stop_1, stop_2 : float
        Target Y of each stop, m; NaN leaves it as it is, or moving.
    speed : float
        Speed of the stops relative to M, m/s; infinite for at once.
    numbers, codes, written : array, array, int
        The table of events, with room for them, and the rows written.

    Returns
    -------
    origin, written : Origin, int
        The origin of the next flight, and the rows written.
    """
    before: Origin = state_at(here, time)
    if not watched:
        there = sided(rig.free, here.origin, here.flight, before)
    elif has_side(rig.free, before):
        there = before
    else:
        there = before._replace(side=-here.side if here.crossing == time else here.side)
    if stop_1 == stop_1:
        there, outcome = commanded(rig.one_sided, there, 1, stop_1, speed)
        first = outcome
    else:
        first = MOVING
    if stop_2 == stop_2:
        there, outcome = commanded(rig.one_sided, there, 2, stop_2, speed)
        second = outcome
    else:
        second = MOVING
    if first != MOVING:
        written = write_command(1, first == ARRIVED, there, numbers, codes, written)
    if second != MOVING:
        written = write_command(2, second == ARRIVED, there, numbers, codes, written)
    on_1, on_2 = supports(there)
    was_on_1, was_on_2 = supports(before)
    if on_1 == was_on_1 and on_2 == was_on_2:
        return there, written
    after = written
    there, written = started(rig, damper_mass, there, numbers, codes, written)
    if written == after:
        written = write_support(before.mode, there, numbers, codes, written)
    return there, written


@kernel(inline=True)
def write_sample(samples: Any, row: int, here: OpenFlight, time: float) -> None:
    """Write the motion at an instant of a flight, in the order of `Sample`."""
    origin = here.origin
    flight: Flight = here.flight
    tau = max(0.0, (time - origin.time) - origin.time_low)
    motion: Motion = motion_at(flight, tau)
    clearance_1, clearance_2, stop_1, stop_2 = placed(origin, flight, tau, motion.travel)
    speed = 0.0 if flight.joint else motion.relative_velocity
    rate_1, rate_2 = stop_rates(origin, flight, speed)
    samples[row, 0] = time
    samples[row, 1] = motion.x
    samples[row, 2] = motion.velocity
    samples[row, 3] = motion.x + offset_of(clearance_1, clearance_2, stop_1, stop_2)
    samples[row, 4] = motion.velocity + speed
    samples[row, 5] = motion.x + stop_1
    samples[row, 6] = motion.x + stop_2
    samples[row, 7] = motion.velocity + rate_1
    samples[row, 8] = motion.velocity + rate_2


class Progress(NamedTuple):
    """
    State of a run between two calls of `run_through`.

    Attributes
    ----------
    status : int
        As `go_on` returns it.
    origin : Origin
        Origin of the present flight.
    time : float
        Time reached, s; the instant of the last sample or event, or the end.
    sampled, written, happened : int
        Number of samples and rows of events written, and of transitions, written or not.
    """

    status: int
    origin: Origin
    time: float
    sampled: int
    written: int
    happened: int


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
    written: int,
    most: int,
    in_mode: Any,
) -> tuple[int, tuple[Any, ...], float, int, int, int]:
    """Let a rig run to a later time, with samples at instants, until the table is full."""
    here: OpenFlight = open_flight(rig, origin, time)
    happened = 0
    count = len(instants)
    while True:
        target = end
        if sampled < count:
            target = float(instants[sampled])
        status, time, here, written, passed = go_on(
            rig,
            damper_mass,
            here,
            time,
            target,
            end,
            False,
            most - happened,
            ALL_STEPS,
            numbers,
            codes,
            len(codes),
            written,
            in_mode,
        )
        happened += passed
        if status != DONE or sampled == count:
            break
        write_sample(samples, sampled, here, target)
        sampled += 1
        clear = clear_until(here, False)
        while sampled < count and instants[sampled] < clear:
            time = float(instants[sampled])
            write_sample(samples, sampled, here, time)
            sampled += 1
    accounted(here, time, in_mode)
    return status, here.origin[:], time, sampled, written, happened
