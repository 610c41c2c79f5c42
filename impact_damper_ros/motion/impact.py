# SPDX-License-Identifier: Apache-2.0
"""
An impact: the velocities after it, and the rest that ends infinitely many of them.

Bapat (1995), equations (10)-(11); for complete chatter Budd and Dux (1994), Phil. Trans. R. Soc.
Lond. A 347, and Nordmark and Piiroinen (2009), Nonlinear Dynamics 58.
"""

from __future__ import annotations

from math import copysign, inf, sqrt
from typing import Any

from .event import IMPACT, REST_EVENT, STOP_STARTED, write_event, write_quiet
from .flight import Motion, begin_next_flight, moving_mode, rest, starting_motion, support_need
from .kernels import kernel
from .oscillator import free_bound
from .state import CHATTER_1, CHATTER_2, REST_1, REST_2, Moving, RigConstants, Run

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
#: Shortest bounce that is resolved, in horizons.
SHORTEST_BOUNCE = 1e-9


@kernel(inline=True)
def common_velocity(constants: RigConstants, run: Run) -> float:
    """Return the velocity that M and m would have together."""
    return run.velocity + constants.share * run.relative_velocity


@kernel
def bounce_duration(speed: float, press: float, grip: float) -> float:
    """Return how long m stays off a stop that it leaves slowly."""
    down = press - grip
    if down <= 0.0:
        return inf
    up = press + grip
    return speed * (1.0 / up + 1.0 / sqrt(up * down))


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
    duration: float,
    speed: float,
    press: float,
    grip: float,
    jerk: float,
    omega: float,
    gap: float,
    spread: float,
) -> bool:
    """
    Return whether the closed form of a chatter is exact to the tolerances above.

    `spread` is the relative error of the duration for the change of R with the speed.
    """
    down = press - grip
    change = jerk * duration + spread * down
    return (
        change <= CHATTER_TOLERANCE * down
        and change * omega * duration <= CHATTER_INSTANT_TOLERANCE * down
        and omega * duration <= CHATTER_SPAN
        and speed * speed <= 2.0 * CHATTER_HEIGHT * gap * (press + grip)
    )


@kernel(inline=True)
def may_chatter(constants: RigConstants, run: Run) -> bool:
    """
    Return whether a chatter may be complete, or a bounce too short to be resolved.

    A bounce takes at least 2 speed/bound.
    """
    bound = constants.drive_bound + (1.0 + constants.mass_ratio) * (
        constants.joint.omega_squared * abs(run.x)
        + 2.0 * constants.joint.decay * abs(common_velocity(constants, run))
        + abs(run.force + run.recorded_force) * constants.share / constants.damper_mass
    )
    twice = 2.0 * abs(run.relative_velocity)
    return (
        constants.free.jerk_bound * twice <= CHATTER_TOLERANCE * bound * bound
        or twice <= SHORTEST_BOUNCE * constants.free.horizon * bound
    )


@kernel
def begin_chatter(moving: Moving, stop: int, coefficient: float) -> None:
    """Begin the chatter of which an impact is part, if it can be completed in closed form."""
    constants, _, run, _, _ = moving
    common = common_velocity(constants, run)
    away = 1.0 if stop == 2 else -1.0
    speed = away * run.relative_velocity
    press = (1.0 + constants.mass_ratio) * away * support_need(moving, common)
    grip = (1.0 + constants.mass_ratio) * constants.grip
    # The coefficients of all later bounces lie between these two.
    restitution, _ = bounce(constants, coefficient, 0.0)
    least, _ = bounce(constants, coefficient, speed)
    left = chatter_duration(speed, press, grip, restitution)
    single = bounce_duration(speed, press, grip)
    omega = sqrt(constants.free.omega_squared)
    if single < SHORTEST_BOUNCE * constants.free.horizon:
        # These bounces are too short to be resolved, and have no energy. On an elastic stop they
        # have no end: the chatter ends at once if its support could change during it.
        left = left if omega * left <= CHATTER_SPAN else 0.0
    elif left < inf:
        # The gap is infinite if there is one stop only; `CHATTER_SPAN` then limits the height.
        gap = run.clearance_1 + run.clearance_2
        # The smallest possible bound of the jerk already excludes most chatters.
        jerk = constants.free.jerk_bound
        spread = (restitution - least) * left / single
        if not may_complete(left, speed, press, grip, jerk, omega, gap, spread):
            return
        begin_next_flight(moving)
        motion: Motion = starting_motion(moving)
        jerk += free_bound(constants.free, motion.x_3, motion.x_4)
        if not may_complete(left, speed, press, grip, jerk, omega, gap, spread):
            return
    else:
        return
    run.mode = CHATTER_1 if stop == 1 else CHATTER_2
    run.velocity = common
    run.relative_velocity = 0.0
    run.chatter_left = left


@kernel(inline=True)
def bounce(constants: Any, coefficient: Any, speed: Any) -> tuple[Any, Any]:
    """
    Return R at an approach speed v, and R + v dR/dv: the law of restitution.

    R falls as v rises: R(v) = R(0) (1 + v/v_c)^-p, where R(0) is the coefficient of the stop. It
    is constant if 1/v_c, the slowness, is 0. In plain Python the arguments may be arrays, of many
    impacts.
    """
    if constants.restitution_slowness == 0.0:
        return coefficient, coefficient
    exponent = constants.restitution_exponent
    rise = 1.0 + constants.restitution_slowness * speed
    restitution = coefficient * rise**-exponent
    return restitution, restitution * (1.0 - exponent + exponent / rise)


@kernel(inline=True)
def rebound(
    share: float, restitution: float, velocity: float, relative_velocity: float
) -> tuple[float, float]:
    """Return X' and Y' after an impact from those before it, by momentum and restitution."""
    return (
        velocity + share * (1.0 + restitution) * relative_velocity,
        -restitution * relative_velocity,
    )


@kernel(inline=True)
def rebound_slopes(share: float, slope: Any) -> tuple[Any, Any]:
    """
    Return the derivatives of X' and Y' after an impact by the relative velocity before it.

    `slope` is the second result of `bounce`; in plain Python it may be an array of many impacts.
    """
    return share * (1.0 + slope), -slope


@kernel
def restart_stop(run: Run, stop: int) -> bool:
    """Start a stop that m touches towards its target, unless m blocks it; return if it starts."""
    if stop == 1:
        ahead = run.target_1 - run.stop_1
        inwards = -run.relative_velocity
        speed = run.speed_1
    else:
        ahead = run.stop_2 - run.target_2
        inwards = run.relative_velocity
        speed = run.speed_2
    if ahead < 0.0 and inwards <= speed:
        return False
    if stop == 1:
        run.stop_velocity_1 = copysign(speed, ahead)
    else:
        run.stop_velocity_2 = -copysign(speed, ahead)
    return True


@kernel(inline=True)
def strike(moving: Moving, stop: int) -> None:
    """Resolve an impact of m on a stop: set the velocities after it, and report it."""
    constants, _, run, _, log = moving
    before = run.velocity
    relative_before = run.relative_velocity
    # Velocities towards stop 1 are positive. The speed of a grazing contact is not negative.
    if stop == 1:
        relative_before = max(relative_before, 0.0)
        restitution = constants.restitution_1
        away = run.stop_1 != run.target_1
    else:
        relative_before = min(relative_before, 0.0)
        restitution = constants.restitution_2
        away = run.stop_2 != run.target_2
    if run.clearance_1 == 0.0 and run.clearance_2 == 0.0:
        # With no room between the stops, impacts on both follow without end until m is at rest.
        restitution = 0.0
    most = restitution
    restitution, _ = bounce(constants, most, abs(relative_before))
    after, relative_after = rebound(constants.share, restitution, before, relative_before)
    run.velocity = after
    run.last_stop = stop
    run.released = False
    run.chatter_left = 0.0
    if relative_after == 0.0:
        restitution = 0.0
        # The sign of -0.0 would count as a direction.
        relative_after = 0.0
    run.relative_velocity = relative_after
    starts = away and restart_stop(run, stop)
    if relative_after == 0.0:
        rest(moving)
    else:
        run.mode = moving_mode(constants, relative_after)
        if not away and may_chatter(constants, run):
            begin_chatter(moving, stop, most)
    impulse = (
        constants.damper_mass
        * (1.0 + restitution)
        / (1.0 + constants.mass_ratio)
        * abs(relative_before)
    )
    damper_after = after + relative_after
    write_event(
        run, log, IMPACT, stop, before, after, before + relative_before, damper_after, impulse
    )
    if run.mode == REST_1 or run.mode == REST_2:
        write_event(run, log, REST_EVENT, stop, after, after, after, damper_after, 0.0)
    if starts:
        write_quiet(run, log, STOP_STARTED, stop)
