"""
Transitions: what an event makes of the state, from before it to after it.

`resolve` takes the flight that an event ends and returns the origin of the next one.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from .certificate import least_step
from .contact import ARRIVAL, CONTACT_1, CONTACT_2, RELEASE_UP, REVERSAL
from .flight import Flight, Motion, motion_at
from .impact import bounce_duration, chatter_duration, rebound
from .kernels import kernel
from .mode import (
    CHATTER_1,
    CHATTER_2,
    FREE,
    REST_1,
    REST_2,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    Machine,
    Origin,
    launch,
    mode_at_rest,
    support_need,
)
from .oscillator import derivative_bound
from .phase import advance_time, sines_of, turned_angles

__all__ = ['Transition', 'at_rest', 'carried', 'moving_mode', 'placed', 'resolve', 'struck']


class Transition(NamedTuple):
    """
    What an event did.

    Attributes
    ----------
    origin : Origin
        State after the event.
    stop : int
        The stop hit, 1 or 2; 0 if none was.
    velocity_before, relative_velocity_before : float
        X' and Y' just before the event.
    velocity_after, relative_velocity_after : float
        X' and Y' just after it.
    """

    origin: Origin
    stop: int
    velocity_before: float
    relative_velocity_before: float
    velocity_after: float
    relative_velocity_after: float


@kernel
def moving_mode(machine: Machine, relative_velocity: float) -> int:
    """Return the mode of a relative motion that is under way."""
    if machine.grip == 0.0:
        return FREE
    return SLIDE_DOWN if relative_velocity > 0.0 else SLIDE_UP


@kernel
def placed(origin: Origin, flight: Flight, travel: float) -> tuple[float, float, float, float]:
    """
    Return where m and the stops are, once m has travelled relative to M.

    Parameters
    ----------
    origin, flight : Origin, Flight
        The flight with its origin.
    travel : float
        Y - Y(origin), m.

    Returns
    -------
    clearance_1, clearance_2, stop_1, stop_2 : float
        Distance of m from each stop, and position Y of each stop, m.
    """
    clearance_1 = origin.clearance_1
    clearance_2 = origin.clearance_2
    stop_1 = origin.stop_1
    stop_2 = origin.stop_2
    if not flight.joint:
        if flight.arrival < inf and flight.direction < 0:
            stop_1 += travel
            clearance_2 = max(0.0, clearance_2 + travel)
        elif flight.arrival < inf:
            stop_2 += travel
            clearance_1 = max(0.0, clearance_1 - travel)
        else:
            clearance_1 = max(0.0, clearance_1 - travel)
            clearance_2 = max(0.0, clearance_2 + travel)
    return clearance_1, clearance_2, stop_1, stop_2


@kernel
def carried(origin: Origin, flight: Flight, tau: float) -> Origin:
    """
    Return the state that a flight reaches, as the origin of another one.

    Parameters
    ----------
    origin, flight : Origin, Flight
        The flight with its origin.
    tau : float
        Time since the origin, s.

    Returns
    -------
    Origin
        State just *before* whatever happens at that instant, mode unchanged.
    """
    time, time_low = advance_time(origin.time, origin.time_low, tau)
    angles = turned_angles(origin.angles, flight.oscillator.frequencies, tau)
    motion: Motion = motion_at(flight, tau)
    clearance_1, clearance_2, stop_1, stop_2 = placed(origin, flight, motion.travel)
    speed = 0.0 if flight.joint else motion.relative_velocity
    return Origin(
        time,
        time_low,
        origin.mode,
        motion.x,
        motion.velocity,
        speed,
        clearance_1,
        clearance_2,
        stop_1,
        stop_2,
        angles,
        origin.last_stop,
        False,
        max(0.0, origin.chatter_left - tau),
    )


@kernel
def _with(
    origin: Origin,
    mode: int,
    velocity: float,
    relative_velocity: float,
    last_stop: int,
    released: bool,
    chatter_left: float,
) -> Origin:
    """Return an origin with another mode and other velocities."""
    return Origin(
        origin.time,
        origin.time_low,
        mode,
        origin.x,
        velocity,
        relative_velocity,
        origin.clearance_1,
        origin.clearance_2,
        origin.stop_1,
        origin.stop_2,
        origin.angles,
        last_stop,
        released,
        chatter_left,
    )


@kernel
def _on_stop(machine: Machine, origin: Origin, stop: int, stop_1: float, stop_2: float) -> Origin:
    """Return an origin with m exactly on a stop, and the stops placed."""
    across = inf if machine.one_sided else stop_1 - stop_2
    return Origin(
        origin.time,
        origin.time_low,
        origin.mode,
        origin.x,
        origin.velocity,
        origin.relative_velocity,
        0.0 if stop == 1 else across,
        across if stop == 1 else 0.0,
        stop_1,
        stop_2,
        origin.angles,
        origin.last_stop,
        False,
        0.0,
    )


@kernel
def at_rest(machine: Machine, origin: Origin) -> Origin:
    """Return the state that follows when the relative velocity has become zero."""
    still = _with(origin, origin.mode, origin.velocity, 0.0, origin.last_stop, False, 0.0)
    mode = mode_at_rest(machine, still, sines_of(machine.phases, still.angles))
    return _with(still, mode, still.velocity, 0.0, still.last_stop, False, 0.0)


@kernel
def struck(machine: Machine, origin: Origin, stop: int) -> Transition:
    """
    Resolve an impact.

    Parameters
    ----------
    machine : Machine
        The rig.
    origin : Origin
        State just *before* the impact, m on the stop.
    stop : int
        The stop it hits, 1 or 2.

    Returns
    -------
    Transition
        The state just after: moving away, or at rest, or in the last bounces of a chatter.
    """
    before = origin.velocity
    relative_before = origin.relative_velocity
    # Towards stop 1 is positive; round-off must not turn a grazing contact into a push.
    if stop == 1:
        relative_before = max(relative_before, 0.0)
        restitution = machine.restitution_1
    else:
        relative_before = min(relative_before, 0.0)
        restitution = machine.restitution_2
    after, relative_after = rebound(before, relative_before, restitution, machine.mass_ratio)
    if relative_after == 0.0:
        # -0.0 would be taken for a direction
        relative_after = 0.0
        hit = _with(origin, origin.mode, after, 0.0, stop, False, 0.0)
        return Transition(
            at_rest(machine, hit), stop, before, relative_before, after, relative_after
        )
    hit = _with(
        origin,
        moving_mode(machine, relative_after),
        after,
        relative_after,
        stop,
        False,
        0.0,
    )
    held = hit.stop_1 > machine.stop if stop == 1 else hit.stop_2 < -machine.stop
    if not held:
        share = machine.mass_ratio / (1.0 + machine.mass_ratio)
        common = after + share * relative_after
        need = support_need(machine, hit, sines_of(machine.phases, hit.angles), common)
        away = 1.0 if stop == 2 else -1.0
        speed = away * relative_after
        press = (1.0 + machine.mass_ratio) * away * need
        grip = (1.0 + machine.mass_ratio) * machine.grip
        # Few impacts belong to a chatter: the least that the bound can be rules most of them out.
        left = chatter_duration(speed, press, grip, restitution, machine.free.bound_3)
        if left < inf:
            motion: Motion = motion_at(launch(machine, hit), 0.0)
            bound = derivative_bound(machine.free, motion.x_3, motion.x_4, machine.free.bound_3)
            left = chatter_duration(speed, press, grip, restitution, bound)
        if left == inf and bounce_duration(speed, press, grip) < least_step(machine.free.horizon):
            # Elastic stops: such bounces go on for ever, and have no energy left.
            left = 0.0
        if left < inf:
            mode = CHATTER_1 if stop == 1 else CHATTER_2
            hit = _with(hit, mode, common, 0.0, stop, False, left)
    return Transition(hit, stop, before, relative_before, after, relative_after)


@kernel
def resolve(machine: Machine, origin: Origin, flight: Flight, kind: int, tau: float) -> Transition:
    """
    Resolve the event that ends a flight.

    Parameters
    ----------
    machine, origin, flight : Machine, Origin, Flight
        The rig, and the flight with its origin.
    kind : int
        The event, as `contact.first_event` names it; `NO_EVENT` ends a chatter.
    tau : float
        Time of the event since the origin, s.

    Returns
    -------
    Transition
        Velocities before and after, and the origin of the next flight.
    """
    there = carried(origin, flight, tau)
    before = there.velocity
    relative_before = there.relative_velocity
    if kind in (CONTACT_1, CONTACT_2):
        stop = 1 if kind == CONTACT_1 else 2
        there = _on_stop(machine, there, stop, there.stop_1, there.stop_2)
        return struck(machine, there, stop)
    if kind == ARRIVAL:
        if flight.direction < 0:
            there = _on_stop(machine, there, 1, machine.stop, there.stop_2)
        else:
            there = _on_stop(machine, there, 2, there.stop_1, -machine.stop)
        return Transition(there, 0, before, relative_before, before, relative_before)
    if kind == REVERSAL and tau == 0.0:
        # m was about to leave its support and does not: the support holds to round-off.
        mode = STICK
        if there.clearance_1 == 0.0:
            mode = REST_1
        elif there.clearance_2 == 0.0:
            mode = REST_2
        there = _with(there, mode, before, 0.0, there.last_stop, False, 0.0)
        return Transition(there, 0, before, relative_before, before, 0.0)
    if kind == REVERSAL or origin.mode >= CHATTER_1:
        there = at_rest(machine, there)
        return Transition(there, 0, before, relative_before, before, 0.0)
    # A support gives way; which direction it fails in was the event's kind.
    mode = FREE
    if machine.grip > 0.0:
        mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
    there = _with(there, mode, before, 0.0, there.last_stop, True, 0.0)
    return Transition(there, 0, before, 0.0, before, 0.0)
