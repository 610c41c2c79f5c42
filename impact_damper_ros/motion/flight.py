# SPDX-License-Identifier: Apache-2.0
"""
Flights: the motion between two events in closed form.

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w,

with time tau counted from the flight's origin; the damper mass has constant acceleration, so that
the relative acceleration is Y'' = Z'' - X''. Bapat (1995), equations (1)-(5), in a form without
cancellation: the response from rest is that of `oscillator`; short flights are summed as Taylor
series about the tangent parabola, so that they keep their relative accuracy; relative position and
velocity are variables of their own, not differences of absolute ones.

Friction, air force and supports are constant within a mode, so that a mode is one closed-form
flight: equations (1)-(2) for sliding; joint motion of both masses for sticking in the gap and for
rest on a stop.
"""

from __future__ import annotations

from math import cos, inf, sin
from typing import NamedTuple

from .kernels import kernel
from .oscillator import Driven, Free, Oscillator, driven_response, free_response
from .series import Series, series_at, tail
from .state import (
    CHATTER_1,
    FREE,
    REST_1,
    REST_2,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    Lines,
    Moving,
    RigConstants,
    Run,
    Waves,
    advance_time,
    on_stop_1,
    on_stop_2,
)
from .waves import set_waves, turn_waves, waves_to_origin

#: Horizons after which the search tests whether joint motion lasts without end.
_LOOK = 64.0

#: What ends a flight.
NO_EVENT = 0
CONTACT_1 = 1
CONTACT_2 = 2
REVERSAL = 3
#: A stop that follows m reaches its target.
ARRIVAL = 4
#: The support gives way, and m moves upwards.
RELEASE_UP = 5
RELEASE_DOWN = 6
STOP_ARRIVED_1 = 7
STOP_ARRIVED_2 = 8
#: The bounces of a chatter have accumulated.
CHATTER_END = 9
#: X passes through zero, which ends no flight.
PASSAGE = 10
#: m becomes faster than the stop that follows it.
OUTRUN = 11


class Motion(NamedTuple):
    """
    Motion at one instant of a flight.

    `travel` is the relative displacement Y - Y(origin); `x_2` to `x_6` are the second to sixth
    time derivatives of X, `relative_2` is Y''.
    """

    x: float
    velocity: float
    travel: float
    relative_velocity: float
    relative_2: float
    x_2: float
    x_3: float
    x_4: float
    x_5: float
    x_6: float


@kernel(inline=True)
def oscillator_of(constants: RigConstants, run: Run) -> Oscillator:
    """Return the oscillator that moves: M alone, or M and m as one."""
    return constants.joint if run.joint else constants.free


@kernel(inline=True)
def air_acceleration(constants: RigConstants, run: Run) -> float:
    """Return the acceleration of m by the air force, away from the stop hit last."""
    if run.last_stop == 1:
        return -constants.air
    if run.last_stop == 2:
        return constants.air
    return 0.0


@kernel(inline=True)
def with_constant_forces(
    constants: RigConstants, run: Run, constant: float, share: float
) -> float:
    """Add forces of orders and records, and a base's inertia; `share` is m over what moves."""
    force = run.force + run.recorded_force
    # Without a force a negative zero keeps its sign.
    if force != 0.0:
        constant += force * share / constants.damper_mass
    if run.carried:
        constant -= run.base_acceleration
    return constant


@kernel(inline=True)
def acceleration_at(
    oscillator: Oscillator,
    lines: Lines,
    first: int,
    waves: Waves,
    constant: float,
    x: float,
    velocity: float,
) -> float:
    """Return X'' at the origin from the equation of motion."""
    acceleration = constant - 2.0 * oscillator.decay * velocity - oscillator.omega_squared * x
    for j in range(len(waves)):
        acceleration += lines[first + j].force * waves[j].sine_0
    return acceleration


@kernel(inline=True)
def support_need(moving: Moving, velocity: float) -> float:
    """Return n = X'' - g sin(angle) - p/m, the acceleration m needs from friction and stops."""
    constants, lines, run, waves, _ = moving
    constant = with_constant_forces(
        constants, run, constants.share * constants.slope, constants.share
    )
    together = acceleration_at(
        constants.joint, lines, constants.harmonics, waves, constant, run.x, velocity
    )
    need = together - constants.slope - air_acceleration(constants, run)
    return need + run.base_acceleration if run.carried else need


@kernel
def rest(moving: Moving) -> None:
    """
    Set the mode that follows when the relative velocity has become zero.

    m rests on stop 1 while n <= grip, on stop 2 while n >= -grip, sticks in the gap while
    |n| <= grip, and otherwise leaves in the direction in which its support fails. A stop that
    moves is no support.
    """
    constants, _, run, _, _ = moving
    run.relative_velocity = 0.0
    run.released = False
    run.chatter_left = 0.0
    need = support_need(moving, run.velocity)
    grip = constants.grip
    if on_stop_1(run) and need <= grip:
        run.mode = REST_1
    elif on_stop_2(run) and need >= -grip:
        run.mode = REST_2
    elif grip == 0.0:
        run.mode = FREE
    elif need > grip:
        run.mode = SLIDE_UP
    elif need < -grip:
        run.mode = SLIDE_DOWN
    else:
        run.mode = STICK


@kernel(inline=True)
def moving_mode(constants: RigConstants, relative_velocity: float) -> int:
    """Return the mode of m that moves relative to M."""
    if constants.grip == 0.0:
        return FREE
    return SLIDE_DOWN if relative_velocity > 0.0 else SLIDE_UP


@kernel
def set_deadline(run: Run) -> None:
    """
    Set the event of a moving stop whose time is known beforehand.

    The stop arrives at its target, or at m if m does not move relative to M; at m if both happen
    at once.
    """
    velocity_1 = run.stop_velocity_1
    velocity_2 = run.stop_velocity_2
    kind = NO_EVENT
    first = inf
    if run.mode >= STICK:
        if velocity_1 < 0.0:
            kind = CONTACT_1
            first = run.clearance_1 / -velocity_1
        if velocity_2 > 0.0 and run.clearance_2 / velocity_2 < first:
            kind = CONTACT_2
            first = run.clearance_2 / velocity_2
    if velocity_1 != 0.0:
        arrival = max(0.0, (run.target_1 - run.stop_1) / velocity_1)
        if arrival < first:
            kind = STOP_ARRIVED_1
            first = arrival
    if velocity_2 != 0.0:
        arrival = max(0.0, (run.target_2 - run.stop_2) / velocity_2)
        if arrival < first:
            kind = STOP_ARRIVED_2
            first = arrival
    run.deadline_kind = kind
    run.deadline = first


@kernel(inline=True)
def begin_joint(moving: Moving) -> None:
    """Begin a flight of both masses as one."""
    constants, lines, run, waves, _ = moving
    run.joint = True
    run.look = _LOOK * constants.joint.horizon
    run.first = constants.harmonics
    run.constant = with_constant_forces(
        constants, run, constants.share * constants.slope, constants.share
    )
    run.acceleration = acceleration_at(
        constants.joint, lines, constants.harmonics, waves, run.constant, run.x, run.velocity
    )
    run.relative_velocity = 0.0
    run.relative_acceleration = 0.0
    run.direction = 0
    need = constants.slope + air_acceleration(constants, run)
    if run.carried:
        need -= run.base_acceleration
    run.support_low = need - constants.grip
    run.support_high = need + constants.grip
    # Between two stops that both touch it, m cannot move at all; a chatter ends by itself.
    if run.mode == REST_1 or run.mode >= CHATTER_1 or on_stop_1(run):
        run.support_low = -inf
    if run.mode == REST_2 or run.mode >= CHATTER_1 or on_stop_2(run):
        run.support_high = inf


@kernel(inline=True)
def accelerate(moving: Moving, direction: int) -> float:
    """Set the acceleration of M where m moves by itself in a direction, and return that of Y."""
    constants, lines, run, waves, _ = moving
    air = air_acceleration(constants, run)
    run.joint = False
    run.first = 0
    run.constant = with_constant_forces(
        constants,
        run,
        constants.mass_ratio * (direction * constants.grip - air),
        constants.mass_ratio,
    )
    acceleration = acceleration_at(
        constants.free, lines, 0, waves, run.constant, run.x, run.velocity
    )
    run.acceleration = acceleration
    relative = (constants.slope - direction * constants.grip + air) - acceleration
    if run.carried:
        relative -= run.base_acceleration
    return relative


@kernel(inline=True)
def begin_moving(moving: Moving) -> None:
    """Begin a flight in which m moves relative to M."""
    run = moving.run
    direction = 0
    if run.mode == SLIDE_DOWN:
        direction = 1
    elif run.mode == SLIDE_UP:
        direction = -1
    relative = accelerate(moving, direction)
    if run.released:
        relative = 0.0
    elif run.relative_velocity == 0.0 and (
        direction * relative < 0.0
        or (run.mode == FREE and on_stop_1(run) and relative > 0.0)
        or (run.mode == FREE and on_stop_2(run) and relative < 0.0)
    ):
        # `rest` found m to leave the other way: the forces balance to round-off.
        relative = 0.0
    run.relative_acceleration = relative
    # A stop held up by m follows it inwards until it is at its target.
    inwards = run.relative_velocity
    if inwards == 0.0:
        inwards = relative
    if on_stop_1(run) and run.stop_1 > run.target_1 and inwards <= 0.0:
        run.arrival = run.stop_1 - run.target_1
        direction = -1
    elif on_stop_2(run) and run.stop_2 < run.target_2 and inwards >= 0.0:
        run.arrival = run.target_2 - run.stop_2
        direction = 1
    run.direction = direction


@kernel(inline=True)
def begin_flight(moving: Moving) -> None:
    """Begin the flight from the present origin: all that follows from the stored state."""
    _, lines, _, waves, _ = moving
    set_waves(lines, waves)
    begin_next_flight(moving)


@kernel(inline=True)
def begin_next_flight(moving: Moving) -> None:
    """Begin the flight as `begin_flight` does, from an origin for which the waves are set."""
    run = moving.run
    run.kind = NO_EVENT
    run.due = inf
    run.searched = 0.0
    run.crossing_side = 0
    run.watched = 0.0
    run.crossing = inf
    run.counted = 0.0
    run.arrival = inf
    run.deadline = inf
    run.deadline_kind = NO_EVENT
    if run.stop_velocity_1 != 0.0 or run.stop_velocity_2 != 0.0:
        set_deadline(run)
    if run.mode >= STICK:
        begin_joint(moving)
        if run.mode >= CHATTER_1 and run.chatter_left < run.deadline:
            run.deadline = run.chatter_left
            run.deadline_kind = CHATTER_END
    else:
        begin_moving(moving)


@kernel(inline=True)
def with_derivatives(
    oscillator: Oscillator,
    lines: Lines,
    first: int,
    waves: Waves,
    x: float,
    velocity: float,
    travel: float,
    relative_velocity: float,
    relative_2: float,
    x_2: float,
) -> Motion:
    """Return the motion at the instant of the waves, with the higher derivatives of X."""
    drive_1 = drive_2 = drive_3 = drive_4 = -0.0
    for j in range(len(waves)):
        frequency = lines[first + j].frequency
        square = frequency * frequency
        sine = lines[first + j].force * waves[j].sine
        rate = lines[first + j].force * waves[j].cosine * frequency
        drive_1 += rate
        drive_2 -= sine * square
        drive_3 -= rate * square
        drive_4 += sine * square * square
    twice = 2.0 * oscillator.decay
    omega_squared = oscillator.omega_squared
    x_3 = drive_1 - twice * x_2 - omega_squared * velocity
    x_4 = drive_2 - twice * x_3 - omega_squared * x_2
    x_5 = drive_3 - twice * x_4 - omega_squared * x_3
    x_6 = drive_4 - twice * x_5 - omega_squared * x_4
    return Motion(x, velocity, travel, relative_velocity, relative_2, x_2, x_3, x_4, x_5, x_6)


@kernel(inline=True)
def starting_motion(moving: Moving) -> Motion:
    """Return the motion at the origin."""
    constants, lines, run, waves, _ = moving
    waves_to_origin(waves)
    return with_derivatives(
        oscillator_of(constants, run),
        lines,
        run.first,
        waves,
        run.x,
        run.velocity,
        0.0,
        run.relative_velocity,
        run.relative_acceleration,
        run.acceleration,
    )


@kernel(inline=True)
def motion_near(moving: Moving, tau: float) -> Motion:
    """Sum the Taylor series of the path beyond its tangent parabola."""
    constants, lines, run, waves, _ = moving
    oscillator = oscillator_of(constants, run)
    first = run.first
    waves_to_origin(waves)
    offset = run.x - run.constant / oscillator.omega_squared
    series: Series = series_at(oscillator, lines, first, waves, offset, run.velocity)
    s = tau * oscillator.steps
    bend, bend_1, bend_2 = tail(series, s)
    # The last digits of the second derivative
    s_4 = s * s * s * s
    bend_2 += s_4 * s_4 * s * s * s * (12.0 * series.b_13 + 13.0 * series.b_14 * s)
    bend_1 *= oscillator.steps
    bend_2 *= oscillator.steps * oscillator.steps
    for j in range(len(waves)):
        wave = waves[j]
        turned = lines[first + j].frequency * tau
        sin_w = sin(turned)
        cos_w = cos(turned)
        wave.sine = wave.sine_0 * cos_w + wave.cosine_0 * sin_w
        wave.cosine = wave.cosine_0 * cos_w - wave.sine_0 * sin_w
    rate = run.relative_acceleration
    return with_derivatives(
        oscillator,
        lines,
        first,
        waves,
        run.x + (run.velocity * tau + 0.5 * run.acceleration * tau * tau + bend),
        run.velocity + (run.acceleration * tau + bend_1),
        run.relative_velocity * tau + 0.5 * rate * tau * tau - bend,
        run.relative_velocity + rate * tau - bend_1,
        rate - bend_2,
        run.acceleration + bend_2,
    )


@kernel(inline=True)
def motion_far(moving: Moving, tau: float) -> Motion:
    """Evaluate the closed form itself."""
    constants, lines, run, waves, _ = moving
    oscillator = oscillator_of(constants, run)
    first = run.first
    omega_squared = oscillator.omega_squared
    constant = run.constant
    free: Free = free_response(oscillator, tau)
    x = run.x * free.step + run.velocity * free.impulse
    x += constant / omega_squared * (1.0 - free.step)
    velocity = run.velocity * free.rate
    velocity += (constant - omega_squared * run.x) * free.impulse
    drive = -0.0
    for j in range(len(waves)):
        line = lines[first + j]
        wave = waves[j]
        force = line.force
        sin_0 = wave.sine_0
        cos_0 = wave.cosine_0
        driven: Driven = driven_response(oscillator, line, free, tau)
        x += force * (cos_0 * driven.sine + sin_0 * driven.cosine)
        velocity += force * (cos_0 * driven.rate_sine + sin_0 * driven.rate_cosine)
        wave.sine = sin_0 * driven.turned_cosine + cos_0 * driven.turned_sine
        wave.cosine = cos_0 * driven.turned_cosine - sin_0 * driven.turned_sine
        drive += force * wave.sine
    x_2 = drive + constant - 2.0 * oscillator.decay * velocity - omega_squared * x
    fall = run.relative_acceleration + run.acceleration
    return with_derivatives(
        oscillator,
        lines,
        first,
        waves,
        x,
        velocity,
        (run.relative_velocity + run.velocity) * tau + 0.5 * fall * tau * tau - (x - run.x),
        run.relative_velocity + (fall * tau - (velocity - run.velocity)),
        fall - x_2,
        x_2,
    )


@kernel(inline=True)
def motion_after(moving: Moving, tau: float) -> Motion:
    """
    Evaluate the closed form; the waves then have the sines and cosines of that instant.

    Notes
    -----
    Bapat (1995), equations (3)-(5), in the form that the module describes.
    """
    constants, _, run, _, _ = moving
    if abs(tau) <= oscillator_of(constants, run).taylor_limit:
        return motion_near(moving, tau)
    return motion_far(moving, tau)


@kernel
def motion_at(moving: Moving, tau: float) -> Motion:
    """Return the motion as `motion_after` does; compiled once, not inlined."""
    return motion_after(moving, tau)


@kernel(inline=True)
def places_after(run: Run, tau: float, travel: float) -> tuple[float, float, float, float]:
    """Return clearances and stops after a time and a displacement of m relative to M."""
    clearance_1 = run.clearance_1
    clearance_2 = run.clearance_2
    stop_1 = run.stop_1
    stop_2 = run.stop_2
    if run.stop_velocity_1 != 0.0:
        stop_1 += run.stop_velocity_1 * tau
        clearance_1 += run.stop_velocity_1 * tau
    if run.stop_velocity_2 != 0.0:
        stop_2 += run.stop_velocity_2 * tau
        clearance_2 -= run.stop_velocity_2 * tau
    if not run.joint:
        if run.arrival == inf:
            clearance_1 -= travel
            clearance_2 += travel
        elif run.direction < 0:
            stop_1 += travel
            clearance_2 += travel
        else:
            stop_2 += travel
            clearance_1 -= travel
    return max(0.0, clearance_1), max(0.0, clearance_2), stop_1, stop_2


@kernel(inline=True)
def stop_rates(run: Run, relative_velocity: float) -> tuple[float, float]:
    """Return how fast the stops move in M."""
    rate_1 = run.stop_velocity_1
    rate_2 = run.stop_velocity_2
    if not run.joint and run.arrival < inf:
        if run.direction < 0:
            rate_1 = relative_velocity
        else:
            rate_2 = relative_velocity
    return rate_1, rate_2


@kernel(inline=True)
def move_origin(
    lines: Lines,
    run: Run,
    waves: Waves,
    tau: float,
    x: float,
    velocity: float,
    travel: float,
    relative_velocity: float,
) -> None:
    """Move the origin to a later instant of the flight; mode and commands stay."""
    clearance_1, clearance_2, stop_1, stop_2 = places_after(run, tau, travel)
    time, low = advance_time(run.time, run.time_low, tau)
    run.time = time
    run.time_low = low
    turn_waves(lines, waves, tau)
    run.x = x
    run.velocity = velocity
    run.relative_velocity = 0.0 if run.joint else relative_velocity
    run.clearance_1 = clearance_1
    run.clearance_2 = clearance_2
    run.stop_1 = stop_1
    run.stop_2 = stop_2
    run.released = run.released and tau == 0.0
    run.chatter_left = max(0.0, run.chatter_left - tau)
    run.side = 0


@kernel
def move_to(moving: Moving, time: float) -> None:
    """Move the origin to an instant of the flight, s."""
    _, lines, run, waves, _ = moving
    tau = max(0.0, (time - run.time) - run.time_low)
    motion: Motion = motion_at(moving, tau)
    move_origin(
        lines, run, waves, tau, motion.x, motion.velocity, motion.travel, motion.relative_velocity
    )
    # Exactly this instant: round-off could put it before what happens there.
    run.time = time
    run.time_low = 0.0
