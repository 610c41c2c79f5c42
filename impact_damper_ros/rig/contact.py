"""
The certified first event of a flight.

Each flight watches a few functions: clearances, the relative speed, the support that is left. A
stop that moves adds a constant to the first derivative of its clearance, and nothing else.
From node to node it steps by the least of their certified steps (`certificate`), until the step
ends on a root. So the first event is found, grazing and double roots included; a flight in which
nothing happens is known to have no event.

This module is also the only place that knows about "just left the stop": a flight that begins on
a stop has exactly zero clearance and a positive rate there, which the certified step takes as it
is. A flight that begins with a release has neither, and is led by its jerk.
"""

from __future__ import annotations

from math import inf

from .certificate import ROUND_OFF, least_step, look_ahead, look_past, safe_step
from .event_codes import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
)
from .flight import Flight, FlightEnd, Motion, end_at, motion_at, unfinished
from .grid_search import search_contact, search_release
from .kernels import kernel
from .oscillator import Oscillator, derivative_bound

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
    'chatter_end',
    'first_event',
    'flight_end',
]

_EPSILON = 2.220446049250313e-16
#: More steps than any search takes.
_ALL_STEPS = 2**62


@kernel
def _leave_support(flight: Flight, motion: Motion) -> float:
    """
    Return how long m certainly moves on after its support has given way; negative if it stays.

    Relative velocity and acceleration are zero then. With jerk j and a bound B of the next
    derivative the speed is positive for u < 3 j/B, the clearance left behind for u < 4 j/B.
    """
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    away = flight.direction
    if away == 0:
        away = -1 if flight.clearance_1 == 0.0 else 1
    jerk = -away * motion.x_3
    terms = (
        oscillator.omega_squared * abs(motion.velocity)
        + 2.0 * oscillator.decay * abs(motion.x_2)
        + oscillator.bound_3
    )
    if jerk < -ROUND_OFF * terms:
        return -1.0
    bound = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
    if jerk <= ROUND_OFF * terms:
        # Its sign says nothing yet; m does not move by a round-off of its path meanwhile.
        jerk = max(jerk, 0.0)
        step = least_step(horizon)
    elif 1.5 * jerk < bound * horizon:
        step = 1.5 * jerk / bound
    else:
        step = horizon
    # The stop ahead, or the place to which one follows, must not be reached within that step.
    jerk_bound = jerk + bound * horizon
    if flight.arrival < inf:
        step = min(step, safe_step(flight.arrival, 0.0, 0.0, jerk_bound, horizon))
    opening_1 = flight.stop_velocity_1
    opening_2 = -flight.stop_velocity_2
    ahead = flight.direction >= 0 or opening_1 < 0.0
    if ahead and (flight.clearance_1 > 0.0 or opening_1 > 0.0):
        step = min(step, safe_step(flight.clearance_1, opening_1, 0.0, jerk_bound, horizon))
    ahead = flight.direction <= 0 or opening_2 < 0.0
    if ahead and (flight.clearance_2 > 0.0 or opening_2 > 0.0):
        step = min(step, safe_step(flight.clearance_2, opening_2, 0.0, jerk_bound, horizon))
    return step


@kernel
def _approach(
    oscillator: Oscillator,
    motion: Motion,
    clearance: float,
    closing: float,
    side: int,
    bound_3: float,
    tau: float,
) -> tuple[float, bool]:
    """
    Look ahead for contact with the stop on one side, +1 for stop 1 and -1 for stop 2.

    `closing` is the rate at which m comes up to it. While m recedes from it, it cannot hit it;
    just after a release that reaches further than the clearance does, when both have hardly begun
    to grow.
    """
    horizon = oscillator.horizon
    closing_1 = side * motion.relative_2
    ahead, root = look_ahead(clearance, -closing, -closing_1, bound_3, horizon, tau)
    if ahead < horizon and closing < 0.0:
        bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
        receding = safe_step(-closing, -closing_1, side * motion.x_3, bound_4, horizon)
        if receding > ahead:
            return receding, False
    return ahead, root


@kernel(inline=True)
def _first_in_motion(flight: Flight, tau: float, limit: float, most: int) -> FlightEnd:
    """Step through relative motion; see `flight_end`."""
    oscillator = flight.oscillator
    direction = flight.direction
    horizon = oscillator.horizon
    motion: Motion = motion_at(flight, tau)
    velocity_1 = flight.stop_velocity_1
    velocity_2 = flight.stop_velocity_2
    supported = (
        direction != 0
        or (flight.clearance_1 == 0.0 and velocity_1 == 0.0)
        or (flight.clearance_2 == 0.0 and velocity_2 == 0.0)
    )
    still = flight.relative_velocity == 0.0 and flight.relative_acceleration == 0.0
    if tau == 0.0 and supported and still:
        tau = _leave_support(flight, motion)
        if tau < 0.0:
            return unfinished(REVERSAL, 0.0)
        motion = motion_at(flight, tau)
    # The stop that m leaves is watched if it comes after m.
    watched_1 = direction >= 0 or velocity_1 < 0.0
    watched_2 = direction <= 0 or velocity_2 > 0.0
    quick = flight.arrival == inf and velocity_1 == 0.0 and velocity_2 == 0.0
    while tau <= limit and most > 0:
        most -= 1
        if quick:
            end: FlightEnd = search_contact(flight, tau, motion)
            if end.kind != NO_EVENT:
                return end
            if end.tau > tau:
                tau = end.tau
                motion = motion_at(flight, tau)
                continue
        bound_3 = derivative_bound(oscillator, motion.x_3, motion.x_4, oscillator.bound_3)
        speed = motion.relative_velocity
        rate = motion.relative_2
        step = horizon
        kind = NO_EVENT
        found = False
        if watched_1:
            clearance = flight.clearance_1 + velocity_1 * tau - motion.travel
            closing = speed - velocity_1
            if clearance <= 0.0:
                if closing > 0.0:
                    return unfinished(CONTACT_1, tau)
                clearance = 0.0
            ahead, root = _approach(oscillator, motion, clearance, closing, 1, bound_3, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_1
                found = root
        if watched_2:
            clearance = flight.clearance_2 - velocity_2 * tau + motion.travel
            closing = velocity_2 - speed
            if clearance <= 0.0:
                if closing > 0.0:
                    return unfinished(CONTACT_2, tau)
                clearance = 0.0
            ahead, root = _approach(oscillator, motion, clearance, closing, -1, bound_3, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_2
                found = root
        if direction != 0:
            along = direction * speed
            along_1 = direction * rate
            along_2 = -direction * motion.x_3
            if flight.arrival < inf:
                distance = flight.arrival - direction * motion.travel
                if distance <= 0.0:
                    return unfinished(ARRIVAL, tau)
                ahead, root = look_ahead(distance, -along, -along_1, bound_3, horizon, tau)
                if ahead < step:
                    step = ahead
                    kind = ARRIVAL
                    found = root
            if along <= 0.0:
                if along_1 < 0.0 or (along_1 == 0.0 and along_2 <= 0.0):
                    return unfinished(REVERSAL, tau)
                along = 0.0
            bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
            ahead, root = look_past(
                along, along_1, along_2, bound_4, horizon, tau, abs(motion.velocity)
            )
            if ahead < step:
                step = ahead
                kind = REVERSAL
                found = root
        if found:
            return unfinished(kind, tau + step)
        tau += max(step, _EPSILON * tau)
        motion = motion_at(flight, tau)
    return unfinished(NO_EVENT, tau)


@kernel
def _first_in_joint(flight: Flight, tau: float, limit: float, most: int) -> FlightEnd:
    """Step through joint motion until the support gives way; see `flight_end`."""
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    while tau <= limit and most > 0:
        most -= 1
        motion: Motion = motion_at(flight, tau)
        end: FlightEnd = search_release(flight, tau, motion)
        if end.kind != NO_EVENT:
            return end
        if end.tau > tau:
            tau = end.tau
            continue
        bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, oscillator.bound_5)
        need = motion.x_2 - flight.slope
        terms = oscillator.omega_squared * abs(motion.x) + abs(motion.x_2) + abs(flight.slope)
        step = horizon
        kind = NO_EVENT
        found = False
        if flight.support_high < inf:
            left = flight.support_high - need
            if left <= 0.0:
                if motion.x_3 > 0.0:
                    return unfinished(RELEASE_UP, tau)
                left = 0.0
            ahead, root = look_past(left, -motion.x_3, -motion.x_4, bound_5, horizon, tau, terms)
            if ahead < step:
                step = ahead
                kind = RELEASE_UP
                found = root
        if flight.support_low > -inf:
            left = need - flight.support_low
            if left <= 0.0:
                if motion.x_3 < 0.0:
                    return unfinished(RELEASE_DOWN, tau)
                left = 0.0
            ahead, root = look_past(left, motion.x_3, motion.x_4, bound_5, horizon, tau, terms)
            if ahead < step:
                step = ahead
                kind = RELEASE_DOWN
                found = root
        if found:
            return unfinished(kind, tau + step)
        tau += max(step, _EPSILON * tau)
    return unfinished(NO_EVENT, tau)


@kernel(inline=True)
def flight_end(flight: Flight, node: float, limit: float, most: int = _ALL_STEPS) -> FlightEnd:
    """
    Find the end of a flight: its first event, and the motion there.

    Parameters
    ----------
    flight, node, limit : Flight, float, float
        As for `first_event`.
    most : int, optional
        Stop searching after so many steps. The nodes do not depend on it.

    Returns
    -------
    FlightEnd
        The event, or with kind `NO_EVENT` the node reached; not beyond the limit, if that took all
        the steps.
    """
    if node > limit:
        return unfinished(NO_EVENT, node)
    until = min(limit, flight.deadline)
    if flight.joint:
        end = _first_in_joint(flight, node, until, most)
    else:
        end = _first_in_motion(flight, node, until, most)
    if end.tau > flight.deadline:
        end = unfinished(flight.deadline_kind, flight.deadline)
    if end.kind != NO_EVENT and not end.finished:
        end = end_at(flight, end.kind, end.tau)
    return end


@kernel
def chatter_end(flight: Flight, left: float) -> FlightEnd:
    """Return the end of the flight in which a chatter accumulates after the given time."""
    kind = NO_EVENT
    if flight.deadline <= left:
        kind = flight.deadline_kind
        left = flight.deadline
    return end_at(flight, kind, left)


@kernel
def first_event(flight: Flight, node: float, limit: float) -> tuple[int, float]:
    """
    Find the first event of a flight after a node that it is known to pass.

    Parameters
    ----------
    flight : Flight
        The flight, with what it watches.
    node : float
        Time since the flight's origin up to which there is no event: 0, or what an earlier call
        returned with `NO_EVENT`. The nodes do not depend on the limits asked for.
    limit : float
        Stop searching once the node is beyond this time.

    Returns
    -------
    kind : int
        `CONTACT_1`, `CONTACT_2`, `REVERSAL`, `ARRIVAL`, `RELEASE_UP`, `RELEASE_DOWN`,
        `STOP_ARRIVED_1` or `STOP_ARRIVED_2`; or `NO_EVENT`, if there is none up to the returned
        time. It may be beyond the limit.
    tau : float
        The event's time since the origin, or the node reached.
    """
    end: FlightEnd = flight_end(flight, node, limit)
    return end.kind, end.tau
