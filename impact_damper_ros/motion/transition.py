# SPDX-License-Identifier: Apache-2.0
"""
Transitions: impacts and all other events, from the state before to the state after.

Bapat (1995), equations (10)-(11); for complete chatter Budd and Dux (1994), Phil. Trans. R. Soc.
Lond. A 347, and Nordmark and Piiroinen (2009), Nonlinear Dynamics 58.

A stop away from its target moves there at its speed, as far as m lets it, and never does work:
where it meets m it stands, at rest relative to M, before m may hit it. Its velocity therefore
enters no impact. It follows an m that moves inwards more slowly than itself, touching it, and goes
on by itself once m is faster, or is out of the way.
"""

from __future__ import annotations

from math import copysign, inf, sqrt
from typing import Any

from .compiled import kernel
from .event import (
    IMPACT,
    RELEASE_EVENT,
    REST_EVENT,
    REVERSAL_EVENT,
    STICK_EVENT,
    STOP_ARRIVED,
    STOP_STARTED,
    STOP_TOUCHED,
    Log,
    write_event,
    write_quiet,
)
from .flight import (
    ARRIVAL,
    CHATTER_END,
    CONTACT_1,
    CONTACT_2,
    OUTRUN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
    Motion,
    begin_next_flight,
    move_origin,
    move_to,
    moving_mode,
    rest,
    set_waves,
    starting_motion,
    support_need,
)
from .oscillator import free_bound
from .state import (
    CHATTER_1,
    CHATTER_2,
    FREE,
    REST_1,
    REST_2,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    Moving,
    RigConstants,
    Run,
    on_stop_1,
    on_stop_2,
    place,
    stop_under,
)
from .zero_passage import set_side

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

    A bounce takes 2 speed/push at least. No sine is evaluated.
    """
    push = constants.push + (1.0 + constants.mass_ratio) * (
        constants.joint.omega_squared * abs(run.x)
        + 2.0 * constants.joint.decay * abs(common_velocity(constants, run))
        + abs(run.force + run.recorded_force) * constants.share / constants.damper_mass
    )
    twice = 2.0 * abs(run.relative_velocity)
    return (
        constants.free.jerk_bound * twice <= CHATTER_TOLERANCE * push * push
        or twice <= SHORTEST_BOUNCE * constants.free.horizon * push
    )


@kernel
def end_bounces(moving: Moving, stop: int, coefficient: float) -> None:
    """Go over to the chatter that an impact belongs to, if it does and can be completed."""
    constants, _, run, _, _ = moving
    common = common_velocity(constants, run)
    away = 1.0 if stop == 2 else -1.0
    speed = away * run.relative_velocity
    press = (1.0 + constants.mass_ratio) * away * support_need(moving, common)
    grip = (1.0 + constants.mass_ratio) * constants.grip
    # Those of the bounces to come lie between these two.
    restitution, _ = bounce(constants, coefficient, 0.0)
    least, _ = bounce(constants, coefficient, speed)
    left = chatter_duration(speed, press, grip, restitution)
    single = bounce_duration(speed, press, grip)
    omega = sqrt(constants.free.omega_squared)
    if single < SHORTEST_BOUNCE * constants.free.horizon:
        # Bounces too short to be resolved, and without energy. On an elastic stop they have no
        # end; no chatter may last so long that its support has to be watched.
        left = left if omega * left <= CHATTER_SPAN else 0.0
    elif left < inf:
        # Infinite with one stop only; there `CHATTER_SPAN` bounds the height.
        gap = run.clearance_1 + run.clearance_2
        # The smallest possible bound of the jerk excludes most of the others.
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
def bounce(constants: Any, coefficient: Any, speed: Any) -> tuple[Any, Any]:  # noqa: ARG001
    """
    Return R at an approach speed v, and R + v dR/dv: the law of restitution, a constant R.

    R falls with v, from the coefficient of the stop at 0. Of one impact, or in plain Python of
    many as arrays.
    """
    return coefficient, coefficient


@kernel(inline=True)
def rebound(
    share: float, restitution: float, velocity: float, relative_velocity: float
) -> tuple[float, float]:
    """Return X' and Y' after an impact from those before it: momentum and restitution."""
    return (
        velocity + share * (1.0 + restitution) * relative_velocity,
        -restitution * relative_velocity,
    )


@kernel(inline=True)
def rebound_slopes(share: float, slope: Any) -> tuple[Any, Any]:
    """
    Return the derivatives of what `rebound` returns by the relative velocity before it.

    The slope is the second result of `bounce`. Of one impact, or in plain Python of many as
    arrays.
    """
    return share * (1.0 + slope), -slope


@kernel
def starts_again(run: Run, stop: int) -> bool:
    """Let a stop that m touches go on to its target, unless m holds it up; return if it does."""
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
    """Resolve and report an impact."""
    constants, _, run, _, log = moving
    before = run.velocity
    relative_before = run.relative_velocity
    # Towards stop 1 is positive; round-off must not give a grazing contact a negative speed.
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
        # -0.0 would be taken for a direction.
        relative_after = 0.0
    run.relative_velocity = relative_after
    starts = away and starts_again(run, stop)
    if relative_after == 0.0:
        rest(moving)
    else:
        run.mode = moving_mode(constants, relative_after)
        if not away and may_chatter(constants, run):
            end_bounces(moving, stop, most)
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


@kernel(inline=True)
def put_on_stop(constants: RigConstants, run: Run, stop: int) -> None:
    """Put m exactly on a stop."""
    across = inf if constants.one_sided else max(0.0, run.stop_1 - run.stop_2)
    run.clearance_1 = 0.0 if stop == 1 else across
    run.clearance_2 = across if stop == 1 else 0.0


@kernel
def put_between_stops(run: Run, stop: int) -> bool:
    """Put m on a stop if the other one, which follows it, touches it still; return whether."""
    if stop == 1:
        if not (on_stop_2(run) and run.stop_2 != run.target_2):
            return False
        run.stop_2 = run.stop_1
    else:
        if not (on_stop_1(run) and run.stop_1 != run.target_1):
            return False
        run.stop_1 = run.stop_2
    run.clearance_1 = 0.0
    run.clearance_2 = 0.0
    return True


@kernel
def hold_stop(constants: RigConstants, run: Run, stop: int) -> None:
    """Let a stop stand where it has met m."""
    if stop == 1:
        # The stops never cross; with m on both there is no room between them.
        if run.clearance_2 == 0.0 or (not constants.one_sided and run.stop_1 < run.stop_2):
            run.stop_1 = run.stop_2
        run.stop_velocity_1 = 0.0
    else:
        if run.clearance_1 == 0.0 or run.stop_2 > run.stop_1:
            run.stop_2 = run.stop_1
        run.stop_velocity_2 = 0.0
    run.released = False
    put_on_stop(constants, run, stop)


@kernel
def report_support(run: Run, log: Log, mode_before: int) -> None:
    """Report the rest or the release that a change of support causes, if any."""
    if mode_before >= STICK > run.mode:
        write_quiet(run, log, RELEASE_EVENT, stop_under(mode_before))
    elif run.mode in (REST_1, REST_2) and (mode_before < STICK or mode_before >= CHATTER_1):
        write_quiet(run, log, REST_EVENT, stop_under(run.mode))


@kernel(inline=True)
def touch(moving: Moving, stop: int) -> bool:
    """Put m on a stop, which stands there if it moves; return whether m hits it."""
    constants, _, run, _, log = moving
    if (run.stop_velocity_1 if stop == 1 else run.stop_velocity_2) == 0.0:
        if not put_between_stops(run, stop):
            put_on_stop(constants, run, stop)
        return True
    mode_before = run.mode
    relative = run.relative_velocity
    hold_stop(constants, run, stop)
    write_quiet(run, log, STOP_TOUCHED, stop)
    if relative == 0.0:
        rest(moving)
        report_support(run, log, mode_before)
    return relative > 0.0 if stop == 1 else relative < 0.0


@kernel
def resolve_rest(moving: Moving, kind: int) -> None:
    """Resolve the end of a chatter, a reversal, or a support that gives way."""
    constants, _, run, _, log = moving
    mode_before = run.mode
    before = run.velocity
    relative_before = run.relative_velocity
    if kind == REVERSAL and run.tau == 0.0:
        # m does not leave its support after all: the forces balance to round-off.
        run.mode = STICK
        if on_stop_1(run):
            run.mode = REST_1
        elif on_stop_2(run):
            run.mode = REST_2
        run.relative_velocity = 0.0
        run.released = False
        run.chatter_left = 0.0
    elif kind in (REVERSAL, CHATTER_END) or mode_before >= CHATTER_1:
        rest(moving)
    else:
        # A support gives way, in the direction that the event names.
        run.mode = FREE
        if constants.grip > 0.0:
            run.mode = SLIDE_UP if kind == RELEASE_UP else SLIDE_DOWN
        run.relative_velocity = 0.0
        run.released = True
        run.chatter_left = 0.0
    code = 0
    stop = 0
    if run.released:
        code = RELEASE_EVENT
        stop = stop_under(mode_before)
    elif run.mode == REST_1 or run.mode == REST_2:
        code = REST_EVENT
        stop = stop_under(run.mode)
    elif run.mode == STICK:
        code = STICK_EVENT
    elif mode_before >= CHATTER_1:
        # The stop no longer bears m where its bounces have accumulated.
        code = RELEASE_EVENT
        stop = stop_under(mode_before)
    elif kind == REVERSAL:
        code = REVERSAL_EVENT
    if code != 0:
        write_event(run, log, code, stop, before, before, before + relative_before, before, 0.0)


@kernel(inline=True)
def resolve(moving: Moving) -> None:
    """Go to the event that ends the flight, resolve and report it, and begin the next flight."""
    constants, lines, run, waves, log = moving
    kind = run.kind
    direction = run.direction
    side = run.crossing_side
    move_origin(
        lines,
        run,
        waves,
        run.tau,
        run.end_x,
        run.end_velocity,
        run.end_travel,
        run.end_relative_velocity,
    )
    if kind in (CONTACT_1, CONTACT_2):
        stop = 1 if kind == CONTACT_1 else 2
        if touch(moving, stop):
            strike(moving, stop)
    elif kind == ARRIVAL:
        stop = 1 if direction < 0 else 2
        if stop == 1:
            run.stop_1 = run.target_1
        else:
            run.stop_2 = run.target_2
        put_on_stop(constants, run, stop)
        write_quiet(run, log, STOP_ARRIVED, stop)
    elif kind == OUTRUN:
        # Exactly as fast as m, so that they come apart from here
        if direction < 0:
            run.stop_velocity_1 = run.relative_velocity = -run.speed_1
        else:
            run.stop_velocity_2 = run.relative_velocity = run.speed_2
        write_quiet(run, log, STOP_STARTED, 1 if direction < 0 else 2)
    elif kind == STOP_ARRIVED_1:
        run.stop_1 = run.target_1
        run.stop_velocity_1 = 0.0
        write_quiet(run, log, STOP_ARRIVED, 1)
    elif kind == STOP_ARRIVED_2:
        run.stop_2 = run.target_2
        run.stop_velocity_2 = 0.0
        write_quiet(run, log, STOP_ARRIVED, 2)
    else:
        resolve_rest(moving, kind)
    if side != 0:
        set_side(moving, side)
    begin_next_flight(moving)


@kernel
def begin_from(moving: Moving) -> None:
    """Begin from a state of unknown mode, with the impact of m that moves into its stop."""
    constants, lines, run, waves, _ = moving
    set_waves(lines, waves)
    relative = run.relative_velocity
    if relative == 0.0:
        mode = run.mode
        left = run.chatter_left
        rest(moving)
        # A chatter that its stop still bears comes to rest when it would have done.
        if mode >= CHATTER_1 and stop_under(run.mode) == stop_under(mode):
            run.mode = mode
            run.chatter_left = left
    elif on_stop_1(run) and relative > 0.0:
        strike(moving, 1)
    elif on_stop_2(run) and relative < 0.0:
        strike(moving, 2)
    else:
        run.mode = moving_mode(constants, relative)
        run.chatter_left = 0.0
    begin_next_flight(moving)


#: A stop just after a command: it moves, is at its target, or is held up by m.
MOVING = 0
ARRIVED = 1
TOUCHED = 2


@kernel
def send_stop(constants: RigConstants, run: Run, stop: int, target: float, speed: float) -> int:
    """Send a stop to a target, at once or at a speed; velocities and mode stay."""
    outwards = 1.0 if stop == 1 else -1.0
    here = run.stop_1 if stop == 1 else run.stop_2
    clearance = run.clearance_1 if stop == 1 else run.clearance_2
    way = target - here
    velocity = 0.0
    if way != 0.0 and speed < inf:
        velocity = speed if way > 0.0 else -speed
    offset = place(run)
    if stop == 1:
        run.target_1 = target
        run.speed_1 = speed
        run.stop_velocity_1 = velocity
    else:
        run.target_2 = target
        run.speed_2 = speed
        run.stop_velocity_2 = velocity
    if velocity != 0.0:
        closing = outwards * (run.relative_velocity - velocity)
        if clearance == 0.0 and outwards * velocity < 0.0 and closing >= 0.0:
            hold_stop(constants, run, stop)
            return TOUCHED
        return MOVING
    if way == 0.0:
        return ARRIVED
    touches = outwards * way < 0.0 and outwards * (target - offset) <= 0.0
    if touches:
        target = offset
    # The clearance changes by what the stop moves, so that a small one keeps its digits.
    clearance = max(0.0, clearance + outwards * way)
    if stop == 1:
        run.stop_1 = target
        run.clearance_1 = clearance
    else:
        run.stop_2 = target
        run.clearance_2 = clearance
    if touches:
        hold_stop(constants, run, stop)
        return TOUCHED
    return ARRIVED


@kernel
def move_stops(
    moving: Moving,
    stop_1: float,
    stop_2: float,
    speed: float,
) -> None:
    """Send stops to targets, Y in m, at the present time; NaN leaves a stop alone, or moving."""
    run = moving.run
    side = run.crossing_side
    move_to(moving, run.now)
    if side != 0:
        set_side(moving, side)
    send_stops(moving, stop_1, stop_2, speed)


@kernel
def send_stops(
    moving: Moving,
    stop_1: float,
    stop_2: float,
    speed: float,
) -> None:
    """Send stops to targets at the origin of a flight, and begin the next flight there."""
    constants, _, run, _, log = moving
    mode = run.mode
    was_on_1 = on_stop_1(run)
    was_on_2 = on_stop_2(run)
    first = MOVING
    second = MOVING
    if stop_1 == stop_1:
        first = send_stop(constants, run, 1, stop_1, speed)
    if stop_2 == stop_2:
        second = send_stop(constants, run, 2, stop_2, speed)
    if first != MOVING:
        write_quiet(run, log, STOP_ARRIVED if first == ARRIVED else STOP_TOUCHED, 1)
    if second != MOVING:
        write_quiet(run, log, STOP_ARRIVED if second == ARRIVED else STOP_TOUCHED, 2)
    if on_stop_1(run) == was_on_1 and on_stop_2(run) == was_on_2:
        begin_next_flight(moving)
        return
    written = run.written
    begin_from(moving)
    if run.written == written:
        report_support(run, log, mode)


@kernel
def place_stops_at_gap(constants: RigConstants, run: Run) -> None:
    """Send both stops to half the gap of the rig, at once."""
    half = constants.half_gap
    if constants.one_sided:
        run.clearance_2 = inf
        run.stop_2 = -half
        run.target_2 = -half
        run.stop_velocity_2 = 0.0
    elif run.clearance_2 == inf:
        # Stop 2 comes to the constants.
        offset = place(run)
        run.stop_2 = min(-half, offset)
        run.clearance_2 = max(0.0, offset - run.stop_2)
    send_stop(constants, run, 1, half, inf)
    if not constants.one_sided:
        send_stop(constants, run, 2, -half, inf)
