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
from .forcing import sines_of
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
    RigConstants,
    launch,
    mode_at_rest,
    support_need,
)
from .origin import Origin, carried, locked, on_stop, placed, stopped, with_motion
from .oscillator import derivative_bound

__all__ = [
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
    'moving_mode',
    'placed',
    'rebound',
    'rebounded',
    'resolve',
    'struck',
]


#: A chatter is completed in closed form once the relative acceleration that drives it can change
#: by at most this fraction until its end. The accumulation instant then is in error by at most
#: this fraction of the time left, which is itself this small in units of acceleration per jerk:
#: the square, 1e-12, of the time scale of the motion.
CHATTER_TOLERANCE = 1e-6


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
def chatter_duration(
    speed: float, press: float, grip: float, restitution: float, jerk_bound: float
) -> float:
    """
    Return the time until a chatter on one stop accumulates.

    Notes
    -----
    Each flight begins with restitution sqrt(down/up) times the speed of the one before.
    """
    bounce = bounce_duration(speed, press, grip)
    if bounce == inf:
        return inf
    down = press - grip
    ratio = restitution * sqrt(down / (press + grip))
    if ratio >= 1.0:
        return inf
    duration = bounce / (1.0 - ratio)
    if jerk_bound * duration > CHATTER_TOLERANCE * down:
        return inf
    return duration


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
def impulse_of(rig: RigConstants, damper_mass: float, transition: Transition) -> float:
    """Return the impulse of the impact that a transition is, N s."""
    restitution = rig.restitution_1 if transition.stop == 1 else rig.restitution_2
    if transition.relative_velocity_after == 0.0:
        restitution = 0.0
    return impulse(damper_mass, rig.mass_ratio, restitution, transition.relative_velocity_before)


@kernel(inline=True)
def moving_mode(rig: RigConstants, relative_velocity: float) -> int:
    """Return the mode of a relative motion that is under way."""
    if rig.grip == 0.0:
        return FREE
    return SLIDE_DOWN if relative_velocity > 0.0 else SLIDE_UP


@kernel
def at_rest(rig: RigConstants, origin: Origin) -> Origin:
    """Return the state that follows when the relative velocity has become zero."""
    still = with_motion(origin, origin.mode, origin.velocity, 0.0, origin.last_stop, False, 0.0)
    mode = mode_at_rest(rig, still, sines_of(rig.phases, still.angles))
    return with_motion(still, mode, still.velocity, 0.0, still.last_stop, False, 0.0)


@kernel(inline=True)
def is_no_chatter(rig: RigConstants, hit: Origin, stop: int) -> bool:
    """Return whether an impact belongs to no chatter, as far as one can tell without a sine."""
    push = rig.push + (1.0 + rig.mass_ratio) * (
        rig.joint.omega_squared * abs(hit.x)
        + 2.0 * rig.joint.decay * abs(_common_velocity(rig, hit))
    )
    speed = hit.relative_velocity if stop == 2 else -hit.relative_velocity
    shortest = least_step(rig.free.horizon)
    return not may_chatter(speed, push, rig.free.bound_3, shortest)


@kernel(inline=True)
def _common_velocity(rig: RigConstants, hit: Origin) -> float:
    """Return the velocity that M and m would have together."""
    share = rig.mass_ratio / (1.0 + rig.mass_ratio)
    return hit.velocity + share * hit.relative_velocity


@kernel
def _last_bounces(rig: RigConstants, hit: Origin, stop: int, restitution: float) -> Origin:
    """Return the state just after an impact, in the chatter that it belongs to if it does."""
    common = _common_velocity(rig, hit)
    away = 1.0 if stop == 2 else -1.0
    speed = away * hit.relative_velocity
    need = support_need(rig, hit, sines_of(rig.phases, hit.angles), common)
    press = (1.0 + rig.mass_ratio) * away * need
    grip = (1.0 + rig.mass_ratio) * rig.grip
    # The least that the bound of the jerk can be rules most of these out too.
    left = chatter_duration(speed, press, grip, restitution, rig.free.bound_3)
    if left < inf:
        motion: Motion = starting_motion(launch(rig, hit))
        bound = derivative_bound(rig.free, motion.x_3, motion.x_4, rig.free.bound_3)
        left = chatter_duration(speed, press, grip, restitution, bound)
    if left == inf and bounce_duration(speed, press, grip) < least_step(rig.free.horizon):
        # Elastic stops: such bounces go on for ever, and have no energy left.
        left = 0.0
    if left == inf:
        return hit
    mode = CHATTER_1 if stop == 1 else CHATTER_2
    return with_motion(hit, mode, common, 0.0, stop, False, left)


@kernel(inline=True)
def rebounded(rig: RigConstants, origin: Origin, stop: int) -> tuple[float, float, float, float]:
    """Return the velocities at an impact."""
    relative_before = origin.relative_velocity
    # Towards stop 1 is positive; round-off must not turn a grazing contact into a push.
    if stop == 1:
        relative_before = max(relative_before, 0.0)
        restitution = rig.restitution_1
    else:
        relative_before = min(relative_before, 0.0)
        restitution = rig.restitution_2
    if origin.clearance_1 == 0.0 and origin.clearance_2 == 0.0:
        # With no room between the stops the impacts on both have no end before m is at rest.
        restitution = 0.0
    after, relative_after = rebound(origin.velocity, relative_before, restitution, rig.mass_ratio)
    return restitution, relative_before, after, relative_after


@kernel(inline=True)
def struck(rig: RigConstants, origin: Origin, stop: int) -> Transition:
    """
    Resolve an impact.

    Parameters
    ----------
    rig, origin, stop : RigConstants, Origin, int
        As for `rebounded`.

    Returns
    -------
    Transition
        The state just after: moving away, or at rest, or in the last bounces of a chatter.
    """
    before = origin.velocity
    restitution, relative_before, after, relative_after = rebounded(rig, origin, stop)
    if relative_after == 0.0:
        # -0.0 would be taken for a direction
        relative_after = 0.0
        hit = with_motion(origin, origin.mode, after, 0.0, stop, False, 0.0)
        return Transition(at_rest(rig, hit), stop, before, relative_before, after, relative_after)
    hit = with_motion(
        origin,
        moving_mode(rig, relative_after),
        after,
        relative_after,
        stop,
        False,
        0.0,
    )
    held = hit.stop_1 > hit.target_1 if stop == 1 else hit.stop_2 < hit.target_2
    if not held and not is_no_chatter(rig, hit, stop):
        hit = _last_bounces(rig, hit, stop, restitution)
    return Transition(hit, stop, before, relative_before, after, relative_after)


@kernel
def _touched(rig: RigConstants, there: Origin, stop: int) -> Transition:
    """Resolve the meeting of m with a moving stop: it stays where it is, and m may hit it."""
    before = there.velocity
    relative_before = there.relative_velocity
    there = locked(rig.one_sided, there, stop)
    outward = relative_before > 0.0 if stop == 1 else relative_before < 0.0
    if outward:
        return struck(rig, there, stop)
    if relative_before == 0.0:
        there = at_rest(rig, there)
    return Transition(there, stop, before, relative_before, before, relative_before)


@kernel(inline=True)
def resolve(rig: RigConstants, origin: Origin, flight: Flight, end: FlightEnd) -> Transition:
    """
    Resolve the event that ends a flight.

    Parameters
    ----------
    rig, origin, flight : RigConstants, Origin, Flight
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
            return _touched(rig, there, stop)
        there = on_stop(rig.one_sided, there, stop, there.stop_1, there.stop_2)
        return struck(rig, there, stop)
    if kind == ARRIVAL:
        if flight.direction < 0:
            there = on_stop(rig.one_sided, there, 1, there.target_1, there.stop_2)
        else:
            there = on_stop(rig.one_sided, there, 2, there.stop_1, there.target_2)
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
        there = at_rest(rig, there)
        return Transition(there, 0, before, relative_before, before, 0.0)
    # A support gives way; which direction it fails in was the event's kind.
    mode = FREE
    if rig.grip > 0.0:
        mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
    there = with_motion(there, mode, before, 0.0, there.last_stop, True, 0.0)
    return Transition(there, 0, before, 0.0, before, 0.0)
