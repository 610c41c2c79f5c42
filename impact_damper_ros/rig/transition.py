"""
Transitions: impacts, and what any event makes of the state, from before it to after it.

Bapat (1995), equations (10)-(11); for complete chatter Budd and Dux (1994), Phil. Trans. R. Soc.
Lond. A 347, and Nordmark and Piiroinen (2009), Nonlinear Dynamics 58.

`resolve` takes the flight that an event ends and returns the origin of the next one.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from .certificate import least_step
from .contact import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
)
from .flight import Flight, FlightEnd, Motion, starting_motion
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
    launch,
    mode_at_rest,
    support_need,
)
from .origin import Origin, carried, locked, on_stop, placed, stopped, with_motion
from .oscillator import derivative_bound
from .phase import sines_of

__all__ = [
    'CHATTER_HEIGHT',
    'CHATTER_INSTANT_TOLERANCE',
    'CHATTER_SPAN',
    'CHATTER_TOLERANCE',
    'Transition',
    'at_rest',
    'bounce_duration',
    'carried',
    'chatter_duration',
    'impulse',
    'impulse_of',
    'is_no_chatter',
    'may_chatter',
    'may_complete',
    'moving_mode',
    'placed',
    'rebound',
    'rebounded',
    'resolve',
    'struck',
]


#: A chatter is completed in closed form once the relative acceleration that drives it can change
#: by at most this fraction until its end, and
CHATTER_TOLERANCE = 1e-6
#: by this fraction times 1/(omega T), T being the time left: the instant of rest is then in error
#: by at most about this fraction of 1/omega;
CHATTER_INSTANT_TOLERANCE = 1e-12
#: once omega T is at most this, so that X moves as if m rested on the stop; and
CHATTER_SPAN = 1e-4
#: once no bounce that is left is higher than this fraction of the gap.
CHATTER_HEIGHT = 1e-9


@kernel(inline=True)
def rebound(
    velocity: float, relative_velocity: float, restitution: float, mass_ratio: float
) -> tuple[float, float]:
    """Return the velocities after an impact from those before it."""
    share = mass_ratio / (1.0 + mass_ratio)
    return (
        velocity + share * (1.0 + restitution) * relative_velocity,
        -restitution * relative_velocity,
    )


@kernel(inline=True)
def impulse(
    damper_mass: float, mass_ratio: float, restitution: float, relative_velocity: float
) -> float:
    """Return the impulse of an impact, N s, from the relative velocity just before it."""
    return damper_mass * (1.0 + restitution) / (1.0 + mass_ratio) * abs(relative_velocity)


@kernel
def bounce_duration(speed: float, press: float, grip: float) -> float:
    """Return how long m stays off a stop that it leaves slowly."""
    down = press - grip
    if down <= 0.0:
        return inf
    up = press + grip
    return speed * (1.0 / up + 1.0 / sqrt(up * down))


@kernel(inline=True)
def may_chatter(speed: float, push: float, jerk_bound: float, shortest: float) -> bool:
    """
    Return whether a chatter may be complete, or a bounce too short to be told, for all one knows.

    Notes
    -----
    A bounce takes 2 speed/push at least.
    """
    twice = 2.0 * speed
    return jerk_bound * twice <= CHATTER_TOLERANCE * push * push or twice <= shortest * push


@kernel
def chatter_duration(speed: float, press: float, grip: float, restitution: float) -> float:
    """
    Return the time until a chatter on one stop accumulates under a constant press.

    Notes
    -----
    Each flight begins with restitution sqrt(down/up) times the speed of the one before.
    """
    bounce = bounce_duration(speed, press, grip)
    if bounce == inf:
        return inf
    ratio = restitution * sqrt((press - grip) / (press + grip))
    if ratio >= 1.0:
        return inf
    return bounce / (1.0 - ratio)


@kernel
def may_complete(
    duration: float, speed: float, press: float, grip: float, jerk: float, omega: float, gap: float
) -> bool:
    """Return whether the closed form of a chatter is exact to the tolerances above."""
    down = press - grip
    change = jerk * duration
    return (
        change <= CHATTER_TOLERANCE * down
        and change * omega * duration <= CHATTER_INSTANT_TOLERANCE * down
        and omega * duration <= CHATTER_SPAN
        and speed * speed <= 2.0 * CHATTER_HEIGHT * gap * (press + grip)
    )


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


@kernel(inline=True)
def impulse_of(machine: Machine, damper_mass: float, transition: Transition) -> float:
    """Return the impulse of the impact that a transition is, N s."""
    restitution = machine.restitution_1 if transition.stop == 1 else machine.restitution_2
    if transition.relative_velocity_after == 0.0:
        restitution = 0.0
    return impulse(
        damper_mass, machine.mass_ratio, restitution, transition.relative_velocity_before
    )


@kernel(inline=True)
def moving_mode(machine: Machine, relative_velocity: float) -> int:
    """Return the mode of a relative motion that is under way."""
    if machine.grip == 0.0:
        return FREE
    return SLIDE_DOWN if relative_velocity > 0.0 else SLIDE_UP


@kernel
def at_rest(machine: Machine, origin: Origin) -> Origin:
    """Return the state that follows when the relative velocity has become zero."""
    still = with_motion(origin, origin.mode, origin.velocity, 0.0, origin.last_stop, False, 0.0)
    mode = mode_at_rest(machine, still, sines_of(machine.phases, still.angles))
    return with_motion(still, mode, still.velocity, 0.0, still.last_stop, False, 0.0)


@kernel(inline=True)
def is_no_chatter(machine: Machine, hit: Origin, stop: int) -> bool:
    """Return whether an impact belongs to no chatter, as far as one can tell without a sine."""
    push = machine.push + (1.0 + machine.mass_ratio) * (
        machine.joint.omega_squared * abs(hit.x)
        + 2.0 * machine.joint.decay * abs(_common_velocity(machine, hit))
    )
    speed = hit.relative_velocity if stop == 2 else -hit.relative_velocity
    shortest = least_step(machine.free.horizon)
    return not may_chatter(speed, push, machine.free.bound_3, shortest)


@kernel(inline=True)
def _common_velocity(machine: Machine, hit: Origin) -> float:
    """Return the velocity that M and m would have together."""
    share = machine.mass_ratio / (1.0 + machine.mass_ratio)
    return hit.velocity + share * hit.relative_velocity


@kernel
def _last_bounces(machine: Machine, hit: Origin, stop: int, restitution: float) -> Origin:
    """Return the state just after an impact, in the chatter that it belongs to if it does."""
    common = _common_velocity(machine, hit)
    away = 1.0 if stop == 2 else -1.0
    speed = away * hit.relative_velocity
    need = support_need(machine, hit, sines_of(machine.phases, hit.angles), common)
    press = (1.0 + machine.mass_ratio) * away * need
    grip = (1.0 + machine.mass_ratio) * machine.grip
    left = chatter_duration(speed, press, grip, restitution)
    bounce = bounce_duration(speed, press, grip)
    if bounce < least_step(machine.free.horizon):
        # Bounces too short to be resolved. On an elastic stop they go on for ever, without energy.
        left = left if left < inf else 0.0
    elif left < inf:
        omega = sqrt(machine.free.omega_squared)
        gap = 2.0 * machine.stop
        # The least that the bound of the jerk can be rules most of these out.
        jerk = machine.free.bound_3
        if not may_complete(left, speed, press, grip, jerk, omega, gap):
            return hit
        motion: Motion = starting_motion(launch(machine, hit))
        jerk = derivative_bound(machine.free, motion.x_3, motion.x_4, jerk)
        if not may_complete(left, speed, press, grip, jerk, omega, gap):
            return hit
    else:
        return hit
    mode = CHATTER_1 if stop == 1 else CHATTER_2
    return with_motion(hit, mode, common, 0.0, stop, False, left)


@kernel(inline=True)
def rebounded(machine: Machine, origin: Origin, stop: int) -> tuple[float, float, float, float]:
    """Return the velocities at an impact."""
    relative_before = origin.relative_velocity
    # Towards stop 1 is positive; round-off must not turn a grazing contact into a push.
    if stop == 1:
        relative_before = max(relative_before, 0.0)
        restitution = machine.restitution_1
    else:
        relative_before = min(relative_before, 0.0)
        restitution = machine.restitution_2
    if origin.clearance_1 == 0.0 and origin.clearance_2 == 0.0:
        # With no room between the stops the impacts on both have no end before m is at rest.
        restitution = 0.0
    after, relative_after = rebound(
        origin.velocity, relative_before, restitution, machine.mass_ratio
    )
    return restitution, relative_before, after, relative_after


@kernel(inline=True)
def struck(machine: Machine, origin: Origin, stop: int) -> Transition:
    """
    Resolve an impact.

    Parameters
    ----------
    machine, origin, stop : Machine, Origin, int
        As for `rebounded`.

    Returns
    -------
    Transition
        The state just after: moving away, or at rest, or in the last bounces of a chatter.
    """
    before = origin.velocity
    restitution, relative_before, after, relative_after = rebounded(machine, origin, stop)
    if relative_after == 0.0:
        # -0.0 would be taken for a direction
        relative_after = 0.0
        hit = with_motion(origin, origin.mode, after, 0.0, stop, False, 0.0)
        return Transition(
            at_rest(machine, hit), stop, before, relative_before, after, relative_after
        )
    hit = with_motion(
        origin,
        moving_mode(machine, relative_after),
        after,
        relative_after,
        stop,
        False,
        0.0,
    )
    held = hit.stop_1 > hit.target_1 if stop == 1 else hit.stop_2 < hit.target_2
    if not held and not is_no_chatter(machine, hit, stop):
        hit = _last_bounces(machine, hit, stop, restitution)
    return Transition(hit, stop, before, relative_before, after, relative_after)


@kernel
def _touched(machine: Machine, there: Origin, stop: int) -> Transition:
    """Resolve the meeting of m with a moving stop: it stays where it is, and m may hit it."""
    before = there.velocity
    relative_before = there.relative_velocity
    there = locked(machine.one_sided, there, stop)
    outward = relative_before > 0.0 if stop == 1 else relative_before < 0.0
    if outward:
        return struck(machine, there, stop)
    if relative_before == 0.0:
        there = at_rest(machine, there)
    return Transition(there, stop, before, relative_before, before, relative_before)


@kernel(inline=True)
def resolve(machine: Machine, origin: Origin, flight: Flight, end: FlightEnd) -> Transition:
    """
    Resolve the event that ends a flight.

    Parameters
    ----------
    machine, origin, flight : Machine, Origin, Flight
        The rig, and the flight with its origin.
    end : FlightEnd
        The event, as `contact.flight_end` names it; `NO_EVENT` ends a chatter.

    Returns
    -------
    Transition
        Velocities before and after, and the origin of the next flight.
    """
    kind = end.kind
    there = carried(origin, flight, end)
    before = there.velocity
    relative_before = there.relative_velocity
    if kind in (CONTACT_1, CONTACT_2):
        stop = 1 if kind == CONTACT_1 else 2
        velocity = there.stop_velocity_1 if stop == 1 else there.stop_velocity_2
        if velocity != 0.0:
            return _touched(machine, there, stop)
        there = on_stop(machine.one_sided, there, stop, there.stop_1, there.stop_2)
        return struck(machine, there, stop)
    if kind == ARRIVAL:
        if flight.direction < 0:
            there = on_stop(machine.one_sided, there, 1, there.target_1, there.stop_2)
        else:
            there = on_stop(machine.one_sided, there, 2, there.stop_1, there.target_2)
        return Transition(there, 0, before, relative_before, before, relative_before)
    if kind in (STOP_ARRIVED_1, STOP_ARRIVED_2):
        stop = 1 if kind == STOP_ARRIVED_1 else 2
        stop_1 = there.target_1 if stop == 1 else there.stop_1
        stop_2 = there.target_2 if stop == 2 else there.stop_2
        there = stopped(there, stop, stop_1, stop_2, there.target_1, there.target_2)
        return Transition(there, 0, before, relative_before, before, relative_before)
    if kind == REVERSAL and end.tau == 0.0:
        # m was about to leave its support and does not: the support holds to round-off.
        mode = STICK
        if there.clearance_1 == 0.0 and there.stop_velocity_1 == 0.0:
            mode = REST_1
        elif there.clearance_2 == 0.0 and there.stop_velocity_2 == 0.0:
            mode = REST_2
        there = with_motion(there, mode, before, 0.0, there.last_stop, False, 0.0)
        return Transition(there, 0, before, relative_before, before, 0.0)
    if kind == REVERSAL or origin.mode >= CHATTER_1:
        there = at_rest(machine, there)
        return Transition(there, 0, before, relative_before, before, 0.0)
    # A support gives way; which direction it fails in was the event's kind.
    mode = FREE
    if machine.grip > 0.0:
        mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
    there = with_motion(there, mode, before, 0.0, there.last_stop, True, 0.0)
    return Transition(there, 0, before, 0.0, before, 0.0)
