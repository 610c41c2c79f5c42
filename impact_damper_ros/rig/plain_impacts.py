"""
Plain impacts, as most are: m flies from stop to stop, and nothing else happens.

What `contact`, `transition` and `mode` do with any flight and event comes down to little here. The
kernels are theirs and so are all the digits; it only takes a fraction of the time. Whatever is not
plain, or might not be, is left to them.
"""

from __future__ import annotations

from typing import Any

from .crossing import has_side
from .event_codes import CONTACT_1, CONTACT_2, NO_EVENT
from .event_rows import IMPACT, MOST_ROWS, write_event
from .flight import Flight, FlightEnd, Motion, starting_motion, unfinished
from .grid_search import search_contact
from .impact import impulse
from .kernels import kernel
from .mode import STICK, Machine, moving_flight
from .origin import Origin, carried, on_stop, with_motion
from .transition import is_no_chatter, moving_mode, rebounded

__all__ = ['flies_plainly', 'plain_impacts']


@kernel(inline=True)
def flies_plainly(origin: Origin) -> bool:
    """Return whether m moves between two stops that stand where they should be."""
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
    machine: Machine,
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
    """
    Go from impact to impact as long as they are plain.

    Parameters
    ----------
    machine, damper_mass, origin : Machine, float, Origin
        As for `run_loop.run_through`; m flies plainly.
    begun : float
        How much of the present flight belongs to the time before, s.
    target : float
        Time not to pass, s.
    numbers, codes, most, in_mode : array, array, int, array
        As for `run_loop.run_through`.
    written, happened : int
        Rows written, and transitions made so far.
    instant, span : float
        Instant of the last event, and how long after an event the next one must be, s.

    Returns
    -------
    origin, instant, written, happened : Origin, float, int, int
        The same after the last plain impact.
    ending : FlightEnd
        How the present flight ends, or how far it is known to go on.
    """
    writing = len(codes) > 0
    ending: FlightEnd = unfinished(NO_EVENT, 0.0)
    while happened < most and not (writing and written + MOST_ROWS > len(codes)):
        flight: Flight = moving_flight(machine, origin)
        motion: Motion = starting_motion(flight)
        ending = search_contact(flight, 0.0, motion)
        if ending.kind not in (CONTACT_1, CONTACT_2):
            break
        stop = 1 if ending.kind == CONTACT_1 else 2
        there = carried(origin, flight, ending)
        if there.time > target or there.time <= instant + span:
            break
        there = on_stop(machine.one_sided, there, stop, there.stop_1, there.stop_2)
        restitution, relative_before, after, relative_after = rebounded(machine, there, stop)
        hit = with_motion(
            there, moving_mode(machine, relative_after), after, relative_after, stop, False, 0.0
        )
        if (
            relative_after == 0.0
            or not is_no_chatter(machine, hit, stop)
            or not has_side(machine.free, hit)
        ):
            break
        in_mode[origin.mode] += ending.tau - begun
        if writing:
            push = impulse(damper_mass, machine.mass_ratio, restitution, relative_before)
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
