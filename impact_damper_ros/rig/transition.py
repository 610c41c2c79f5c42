"""
Transitions: impacts and all other events, from the state before to the state after.

Bapat (1995), equations (10)-(11); for complete chatter Budd and Dux (1994), Phil. Trans. R. Soc.
Lond. A 347, and Nordmark and Piiroinen (2009), Nonlinear Dynamics 58.

`resolve` takes the flight that an event ends and returns the origin of the next one.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from .certificate import least_step
from .flight import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
    Flight,
    FlightEnd,
    Motion,
    starting_motion,
)
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
from .origin import Origin, carried, locked, on_stop
from .oscillator import derivative_bound

#: A chatter is completed in closed form once the relative acceleration that drives it can change
#: by at most this fraction until its end, and
CHATTER_TOLERANCE = 1e-6
#: by this fraction times 1/(omega T), T being the time left: the instant of rest is then in error
#: by at most about this fraction of 1/omega;
CHATTER_INSTANT_TOLERANCE = 1e-12
#: once omega T is at most this, so that X moves as if m rested on the stop; and
CHATTER_SPAN = 1e-4
#: once no bounce that is left is higher than this fraction of the present gap.
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
    Return whether a chatter may be complete, or a bounce too short to be resolved.

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
    State and velocities before and after an event.

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
    """Return the impulse of an impact, N s, from its transition."""
    restitution = rig.restitution_1 if transition.stop == 1 else rig.restitution_2
    if transition.relative_velocity_after == 0.0:
        restitution = 0.0
    return impulse(damper_mass, rig.mass_ratio, restitution, transition.relative_velocity_before)


@kernel(inline=True)
def moving_mode(rig: RigConstants, relative_velocity: float) -> int:
    """Return the mode of m that moves relative to M."""
    if rig.grip == 0.0:
        return FREE
    return SLIDE_DOWN if relative_velocity > 0.0 else SLIDE_UP


@kernel
def at_rest(rig: RigConstants, origin: Origin) -> Origin:
    """Return the state that follows when the relative velocity has become zero."""
    still = origin._replace(relative_velocity=0.0, released=False, chatter_left=0.0)
    return still._replace(mode=mode_at_rest(rig, still, sines_of(rig.phases, still.angles)))


@kernel(inline=True)
def is_no_chatter(rig: RigConstants, hit: Origin, stop: int) -> bool:
    """Return whether an impact certainly belongs to no chatter; evaluates no sine."""
    push = rig.push + (1.0 + rig.mass_ratio) * (
        rig.joint.omega_squared * abs(hit.x)
        + 2.0 * rig.joint.decay * abs(common_velocity(rig, hit))
    )
    speed = hit.relative_velocity if stop == 2 else -hit.relative_velocity
    shortest = least_step(rig.free.horizon)
    return not may_chatter(speed, push, rig.free.bound_3, shortest)


@kernel(inline=True)
def common_velocity(rig: RigConstants, origin: Origin) -> float:
    """Return the velocity that M and m would have together."""
    share = rig.mass_ratio / (1.0 + rig.mass_ratio)
    return origin.velocity + share * origin.relative_velocity


@kernel
def _last_bounces(rig: RigConstants, hit: Origin, stop: int, restitution: float) -> Origin:
    """Return the state just after an impact, in the chatter that it belongs to if it does."""
    common = common_velocity(rig, hit)
    away = 1.0 if stop == 2 else -1.0
    speed = away * hit.relative_velocity
    need = support_need(rig, hit, sines_of(rig.phases, hit.angles), common)
    press = (1.0 + rig.mass_ratio) * away * need
    grip = (1.0 + rig.mass_ratio) * rig.grip
    left = chatter_duration(speed, press, grip, restitution)
    bounce = bounce_duration(speed, press, grip)
    if bounce < least_step(rig.free.horizon):
        # Bounces too short to be resolved. On an elastic stop they have no end, and no energy.
        left = left if left < inf else 0.0
    elif left < inf:
        omega = sqrt(rig.free.omega_squared)
        # Infinite with one stop only; there `CHATTER_SPAN` bounds the height.
        gap = hit.clearance_1 + hit.clearance_2
        # The smallest possible bound of the jerk excludes most of the others.
        jerk = rig.free.bound_3
        if not may_complete(left, speed, press, grip, jerk, omega, gap):
            return hit
        motion: Motion = starting_motion(launch(rig, hit))
        jerk = derivative_bound(rig.free, motion.x_3, motion.x_4, jerk)
        if not may_complete(left, speed, press, grip, jerk, omega, gap):
            return hit
    else:
        return hit
    mode = CHATTER_1 if stop == 1 else CHATTER_2
    return hit._replace(mode=mode, velocity=common, relative_velocity=0.0, chatter_left=left)


@kernel(inline=True)
def rebounded(rig: RigConstants, origin: Origin, stop: int) -> tuple[float, float, float, float]:
    """Return the velocities at an impact."""
    relative_before = origin.relative_velocity
    # Towards stop 1 is positive; round-off must not give a grazing contact a negative speed.
    if stop == 1:
        relative_before = max(relative_before, 0.0)
        restitution = rig.restitution_1
    else:
        relative_before = min(relative_before, 0.0)
        restitution = rig.restitution_2
    if origin.clearance_1 == 0.0 and origin.clearance_2 == 0.0:
        # With no room between the stops, impacts on both follow without end until m is at rest.
        restitution = 0.0
    after, relative_after = rebound(origin.velocity, relative_before, restitution, rig.mass_ratio)
    return restitution, relative_before, after, relative_after


@kernel(inline=True)
def struck(rig: RigConstants, origin: Origin, stop: int) -> Transition:
    """Resolve an impact."""
    before = origin.velocity
    restitution, relative_before, after, relative_after = rebounded(rig, origin, stop)
    if relative_after == 0.0:
        # -0.0 would be taken for a direction
        relative_after = 0.0
        hit = origin._replace(velocity=after, relative_velocity=0.0, last_stop=stop)
        return Transition(at_rest(rig, hit), stop, before, relative_before, after, relative_after)
    hit = origin._replace(
        mode=moving_mode(rig, relative_after),
        velocity=after,
        relative_velocity=relative_after,
        last_stop=stop,
        released=False,
        chatter_left=0.0,
    )
    held = hit.stop_1 > hit.target_1 if stop == 1 else hit.stop_2 < hit.target_2
    if not held and not is_no_chatter(rig, hit, stop):
        hit = _last_bounces(rig, hit, stop, restitution)
    return Transition(hit, stop, before, relative_before, after, relative_after)


@kernel
def _touched(rig: RigConstants, there: Origin, stop: int) -> Transition:
    """Resolve the contact of m with a moving stop, which stays there; m may hit it."""
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
    """Resolve the event that ends a flight."""
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
        there = there._replace(
            stop_1=there.target_1 if stop == 1 else there.stop_1,
            stop_2=there.target_2 if stop == 2 else there.stop_2,
            stop_velocity_1=0.0 if stop == 1 else there.stop_velocity_1,
            stop_velocity_2=0.0 if stop == 2 else there.stop_velocity_2,
        )
        return Transition(there, 0, before, relative_before, before, relative_before)
    if kind == REVERSAL and end.tau == 0.0:
        # m does not leave its support after all: the forces balance to round-off.
        mode = STICK
        if there.clearance_1 == 0.0 and there.stop_velocity_1 == 0.0:
            mode = REST_1
        elif there.clearance_2 == 0.0 and there.stop_velocity_2 == 0.0:
            mode = REST_2
        there = there._replace(mode=mode, relative_velocity=0.0, released=False, chatter_left=0.0)
        return Transition(there, 0, before, relative_before, before, 0.0)
    if kind == REVERSAL or origin.mode >= CHATTER_1:
        there = at_rest(rig, there)
        return Transition(there, 0, before, relative_before, before, 0.0)
    # A support gives way, in the direction that the event names.
    mode = FREE
    if rig.grip > 0.0:
        mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
    there = there._replace(mode=mode, relative_velocity=0.0, released=True, chatter_left=0.0)
    return Transition(there, 0, before, 0.0, before, 0.0)
