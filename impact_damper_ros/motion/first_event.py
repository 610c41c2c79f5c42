# SPDX-License-Identifier: Apache-2.0
"""
The certified first event of a flight.

The search goes along a grid, whose steps do not depend on how far the run is to go. As long as m
certainly approaches one stop, or turns once since Y'' keeps its sign, only the clearance of that
stop is watched, and its root is found by a Taylor series about the nearest point, which needs
neither a sine nor the closed form. Any other step is searched by `first_root`.
"""

from __future__ import annotations

from math import copysign, inf, nan, sqrt
from typing import NamedTuple

from .certificate import ERROR, falling_root, keeps_sign, turned_root
from .first_root import (
    LAST_STEP,
    bounds_of,
    end_near,
    first_of,
    leaves_support,
    root_between,
    set_end,
)
from .flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_UP,
    REVERSAL,
    Motion,
    motion_at,
    oscillator_of,
    starting_motion,
)
from .kernels import kernel
from .oscillator import POINTS, Oscillator, free_bound
from .series import Series, coarse_tail, series_at, tail
from .state import Lines, Moving, Run, Waves
from .waves import drive_at, drive_before, drive_rates, next_point, turn_back

#: The series is complete this far from its point, in steps; half a step is what it takes.
_SERIES_REACH = 0.6


@kernel(inline=True)
def root_by_series(
    series: Series,
    sign: float,
    f_0: float,
    f_1: float,
    f_2: float,
    guess: float,
    since: float,
) -> tuple[float, float, float, float, float]:
    """
    Return where a parabola with `sign` times the series falls through zero, near a point.

    Times are in steps from the point of the grid, which is `since` after the flight's origin.
    The results are the last time but one, the last step (NaN if there is no root nearby), and what
    the series adds to the function and to its first two derivatives there.
    """
    # The first step, with most of the series, comes to within a last step of the root.
    s = guess
    bend, bend_1, bend_2, bend_3 = coarse_tail(series, s)
    rate = f_1 + s * f_2 + sign * bend_1
    if rate < 0.0:
        inverse = -1.0 / rate
        u = (f_0 + s * (f_1 + 0.5 * s * f_2) + sign * bend) * inverse
        v_2 = 0.5 * (f_2 + sign * bend_2) * inverse * u
        v_3 = sign * bend_3 * inverse * (u * u) * (1.0 / 6.0)
        s += u + u * (v_2 + (2.0 * v_2 * v_2 + v_3))
    for _ in range(6):
        if not abs(s) <= _SERIES_REACH:
            break
        bend, bend_1, bend_2 = tail(series, s)
        rate = f_1 + s * f_2 + sign * bend_1
        if rate >= 0.0:
            break
        # Newton's step with the curvature of the function
        inverse = -1.0 / rate
        u = (f_0 + (s * (f_1 + 0.5 * s * f_2) + sign * bend)) * inverse
        last = abs(u) <= LAST_STEP * min(1.0, since + s)
        u += 0.5 * (f_2 + sign * bend_2) * inverse * u * u
        if last:
            return s, u, bend, bend_1, bend_2
        s += u
    return s, nan, 0.0, 0.0, 0.0


@kernel(inline=True)
def contact_by_series(
    moving: Moving, side: float, point: Point, guess: float, low: float, high: float
) -> bool:
    """End the flight by a contact near a point of the grid; return whether there is one."""
    constants, lines, run, waves, _ = moving
    oscillator: Oscillator = constants.free
    step = oscillator.step
    t, offset, x, velocity, travel, speed_here = point
    fall = run.relative_acceleration + run.acceleration
    rate_here = fall - (
        drive_at(lines, 0, waves)
        - 2.0 * oscillator.decay * velocity
        - oscillator.omega_squared * offset
    )
    if t == 0.0:
        rate_here = run.relative_acceleration
    left = (run.clearance_1 if side > 0.0 else run.clearance_2) - side * travel
    series: Series = series_at(oscillator, lines, 0, waves, offset, velocity)
    speed = speed_here * step
    scaled = rate_here * step * step
    s, u, bend, bend_1, bend_2 = root_by_series(
        series,
        side,
        left,
        -side * speed,
        -side * scaled,
        guess * oscillator.steps,
        t * oscillator.steps,
    )
    tau = t + (s + u) * step
    # False also where u is NaN
    if not low < tau <= high:
        return False
    moved = s * (speed + 0.5 * s * scaled) - bend
    closing = speed + s * scaled - bend_1
    closing_1 = scaled - bend_2
    scaled_velocity = velocity * step
    x_2 = series.x_2
    set_end(
        run,
        CONTACT_1 if side > 0.0 else CONTACT_2,
        tau,
        x
        + (
            s * (scaled_velocity + 0.5 * s * x_2)
            + bend
            + u * (scaled_velocity + s * x_2 + bend_1 + 0.5 * u * (x_2 + bend_2))
        ),
        velocity + (s * x_2 + bend_1 + u * (x_2 + bend_2)) * oscillator.steps,
        travel + (moved + u * (closing + 0.5 * u * closing_1)),
        speed_here + (s * scaled - bend_1 + u * closing_1) * oscillator.steps,
    )
    return True


@kernel(inline=True)
def acceleration_now(
    oscillator: Oscillator, lines: Lines, run: Run, waves: Waves, x: float, velocity: float
) -> float:
    """Return X'' at the instant of the waves."""
    x_2 = run.constant + drive_at(lines, run.first, waves)
    return x_2 - (2.0 * oscillator.decay * velocity + oscillator.omega_squared * x)


class Point(NamedTuple):
    """Motion at a point of the grid; `offset` is X less its constant part, `speed` is Y'."""

    time: float
    offset: float
    x: float
    velocity: float
    travel: float
    speed: float


#: What is certain of m in a step: nothing, ...
UNKNOWN = 0
#: ... that it touches no stop, ...
CLEAR = 1
#: ... that it approaches one stop throughout, or ...
APPROACH = 2
#: ... that it turns once, far from one stop and perhaps into the other.
TURN = 3


@kernel
def way_between(
    moving: Moving, free: float, a: Point, b: Point
) -> tuple[int, float, float, float]:
    """
    Return what m does in a step by the sign of Y'', towards which side, and Y'' at both ends.

    Notes
    -----
    Between two instants Y'' is off its chord by an eighth of step^2 times the bound of its second
    derivative, at most. The waves are at `b`.

    Let Y'' point towards one stop throughout, and h be the clearance of this stop, with h_a > 0,
    or h_a = 0 < h'_a as just after an impact. Towards this stop Y' rises. If Y'_a points towards
    it or is zero, or Y'_b points away from it, Y' keeps its sign: m approaches one stop. Otherwise
    m turns once. Before the turn h grows; without friction h is concave, so that it is positive if
    h_b > 0, as its chord is, and has one root if not. The other stop needs its own certificate.
    With friction the turn ends the step. Where the sign of Y'' is open, that of the third
    derivative may prove the turn the only one: for w = direction Y' with w_b < 0, w has one root
    if w'' < 0 throughout and w_a > 0 or w_a = 0 < w'_a, since w >= 0 on an interval that begins at
    a, and if w'' > 0 throughout and w_a > 0, since w <= 0 on one that ends at b.
    """
    _, lines, run, waves, _ = moving
    oscillator: Oscillator = moving.constants.free
    omega_squared = oscillator.omega_squared
    step = oscillator.step
    fall = run.relative_acceleration + run.acceleration
    error = ERROR * (abs(b.velocity) + abs(b.speed) + abs(a.speed))
    rate_b = fall - acceleration_now(oscillator, lines, run, waves, b.x, b.velocity)
    # What is given at the origin is exact.
    rate_a = run.relative_acceleration
    error_a = 0.0
    if a.time > 0.0:
        drag = 2.0 * oscillator.decay * a.velocity + omega_squared * a.x
        rate_a = fall - (run.constant + drive_before(lines, waves) - drag)
        error_a = error
    side = copysign(1.0, rate_a)
    omega = sqrt(omega_squared)
    least = 0.125 * step * step * (omega * free + oscillator.rate_3)
    terms = abs(fall) + abs(run.constant) + omega_squared * (abs(a.x) + abs(b.x))
    if min(side * rate_a, side * rate_b) > least + ERROR * (terms + abs(rate_b)):
        # The speed is monotonic. With friction m moves in one direction up to the turn.
        along = side * run.direction
        if side * a.speed >= error_a and along >= 0.0:
            return APPROACH, side, rate_a, rate_b
        if side * b.speed < -error and along <= 0.0:
            return APPROACH, -side, rate_a, rate_b
        if (
            side * a.speed < -error_a
            and side * b.speed > error
            and along <= 0.0
            and stays_off(moving, free, -side, a, b)
        ):
            return TURN, side, rate_a, rate_b
    else:
        side = 1.0 * run.direction if run.direction != 0 else copysign(1.0, a.speed + b.speed)
        bound = (omega + 2.0 * oscillator.decay) * omega * free + oscillator.rate_4
        f_a, f_b = side * a.speed - error_a, side * b.speed - error
        if keeps_sign(f_a, side * rate_a, f_b, side * rate_b, step, bound):
            return APPROACH, side, rate_a, rate_b
        moves = f_a > 0.0 or (f_a == 0.0 and side * rate_a > 0.0)
        if run.direction != 0 and moves and side * b.speed < -error:
            # The speed has changed its sign. If Y''' does not, it did so once.
            drag_a = 2.0 * oscillator.decay * (fall - rate_a) + omega_squared * a.velocity
            drag_b = 2.0 * oscillator.decay * (fall - rate_b) + omega_squared * b.velocity
            drive_a, drive_b = drive_rates(lines, waves)
            jerk_a, jerk_b = side * (drag_a - drive_a), side * (drag_b - drive_b)
            least = 0.125 * step * step * bound
            least += ERROR * (abs(drag_a) + abs(drag_b) + oscillator.jerk_bound)
            bends = max(jerk_a, jerk_b) < -least or (f_a > 0.0 and min(jerk_a, jerk_b) > least)
            if bends and stays_off(moving, free, side, a, b):
                return TURN, -side, rate_a, rate_b
    if (
        run.direction == 0
        and stays_off(moving, free, 1.0, a, b)
        and stays_off(moving, free, -1.0, a, b)
    ):
        return CLEAR, side, rate_a, rate_b
    return UNKNOWN, side, rate_a, rate_b


@kernel
def stays_off(moving: Moving, free: float, side: float, a: Point, b: Point) -> bool:
    """Return whether m certainly touches a stop nowhere in a step."""
    run = moving.run
    oscillator: Oscillator = moving.constants.free
    clearance = run.clearance_1 if side > 0.0 else run.clearance_2
    if clearance == inf:
        return True
    bound = sqrt(oscillator.omega_squared) * free + oscillator.rate_3
    error = ERROR * (abs(b.x) + abs(run.x) + abs(a.travel) + abs(b.travel))
    # What is given at the origin is exact.
    f_a = clearance - side * a.travel - (error if a.time > 0.0 else 0.0)
    f_b = clearance - side * b.travel - error
    return keeps_sign(f_a, -side * a.speed, f_b, -side * b.speed, oscillator.step, bound)


@kernel(inline=True)
def search_moving(moving: Moving) -> None:
    """Search the next steps of the grid while m moves between standing stops."""
    _, lines, run, waves, _ = moving
    oscillator: Oscillator = moving.constants.free
    tau = run.searched
    # m alone
    fall = run.relative_acceleration + run.acceleration
    launched = run.relative_velocity + run.velocity
    resting = run.constant * oscillator.inverse_square
    if tau == 0.0:
        motion: Motion = starting_motion(moving)
    else:
        motion = motion_at(moving, tau)
    step = oscillator.step
    # How far the speed may fall below its values at both points
    free = free_bound(oscillator, motion.x_3, motion.x_4)
    sag = 0.125 * step * step * (free + oscillator.bound_3)
    leading = 1.0 * run.direction
    x_x = oscillator.x_x
    x_v = oscillator.x_v
    v_x = oscillator.v_x
    v_v = oscillator.v_v
    start_x = run.x
    clearance_1 = run.clearance_1
    clearance_2 = run.clearance_2
    x, velocity = motion.x, motion.velocity
    a = Point(tau, x - resting, x, velocity, motion.travel, motion.relative_velocity)
    for k in range(POINTS):
        offset, velocity = next_point(lines, 0, waves, a.offset, a.velocity, x_x, x_v, v_x, v_v)
        t = tau + step * (k + 1)
        x = resting + offset
        travel = t * (launched + 0.5 * fall * t) - (x - start_x)
        b = Point(t, offset, x, velocity, travel, launched + fall * t - velocity)
        # The stop that m approaches, as long as the speeds are clear
        side = leading if leading != 0.0 else copysign(1.0, a.speed)
        error = ERROR * (abs(velocity) + abs(b.speed) + abs(a.speed))
        way = APPROACH
        rate = 0.0
        if not min(side * a.speed, side * b.speed) > sag + error:
            way, side, rate, rate_b = way_between(moving, free, a, b)
            if way == TURN and leading != 0.0:
                d_a, d_b = leading * a.speed, leading * b.speed
                e_a, e_b = leading * rate, leading * rate_b
                root_between(moving, REVERSAL, a.time, d_a, e_a, t, d_b, e_b)
                return
        left = (clearance_1 if side > 0.0 else clearance_2) - side * travel
        hits = way >= APPROACH and left <= 0.0
        if hits:
            before = max(0.0, left + side * (travel - a.travel))
            guess = 0.0
            if way == TURN:
                guess = turned_root(before, -side * a.speed, -side * rate, left, step)
            elif before > 0.0:
                guess = falling_root(before, -side * a.speed, left, -side * b.speed, step)
            # The series about the nearer point
            point = b
            if guess > 0.5 * step:
                guess -= step
            else:
                point = a
                turn_back(lines, 0, waves)
            if contact_by_series(moving, side, point, guess, a.time, t):
                return
        if hits or way == UNKNOWN:
            # The waves are at another instant now: the search begins again from here.
            first_of(moving, a.time, t)
            return
        a = b
    run.searched = a.time


@kernel
def search_joint(moving: Moving) -> None:
    """Search the next steps of the grid for the support to give way."""
    constants, lines, run, waves, _ = moving
    oscillator: Oscillator = constants.joint
    first = run.first
    tau = run.searched
    motion: Motion = motion_at(moving, tau)
    _, bound = bounds_of(oscillator, RELEASE_UP, motion)
    offset = motion.x - run.constant / oscillator.omega_squared
    velocity = motion.velocity
    x_2 = motion.x_2
    x_3 = motion.x_3
    x_x, x_v = oscillator.x_x, oscillator.x_v
    v_x, v_v = oscillator.v_x, oscillator.v_v
    t_a = tau
    for k in range(POINTS):
        offset, velocity = next_point(lines, first, waves, offset, velocity, x_x, x_v, v_x, v_v)
        t_b = tau + oscillator.step * (k + 1)
        x_2_b = drive_at(lines, first, waves)
        x_2_b -= 2.0 * oscillator.decay * velocity + oscillator.omega_squared * offset
        x_3_b = -2.0 * oscillator.decay * x_2_b - oscillator.omega_squared * velocity
        for j in range(len(waves)):
            x_3_b += lines[first + j].force * lines[first + j].frequency * waves[j].cosine
        error = ERROR * (
            oscillator.omega_squared * (abs(offset) + abs(velocity) * oscillator.horizon)
            + abs(x_2_b)
            + abs(run.constant)
        )
        high = run.support_high - error
        low = run.support_low + error
        if not (
            (high == inf or keeps_sign(high - x_2, -x_3, high - x_2_b, -x_3_b, t_b - t_a, bound))
            and (low == -inf or keeps_sign(x_2 - low, x_3, x_2_b - low, x_3_b, t_b - t_a, bound))
        ):
            first_of(moving, t_a, t_b)
            return
        t_a = t_b
        x_2 = x_2_b
        x_3 = x_3_b
    run.searched = t_a


#: A time that no motion reaches, s.
UNREACHED = 1e300
#: Fraction of a bound by which the support must exceed the bound.
_MARGIN = 1e-6


@kernel
def joint_motion_lasts(moving: Moving, tau: float) -> bool:
    """
    Return whether sticking certainly lasts from a time on.

    X'' is the sum of the steady vibration, whose amplitude is known, and of a free vibration,
    which never grows.
    """
    constants, lines, run, waves, _ = moving
    oscillator: Oscillator = constants.joint
    omega_squared = oscillator.omega_squared
    motion: Motion = motion_at(moving, tau)
    free = motion.x_2
    rate = motion.x_3
    most = 0.0
    for j in range(len(waves)):
        line = lines[run.first + j]
        frequency = line.frequency
        square = frequency * frequency
        stiff = omega_squared - square
        dashpot = 2.0 * oscillator.decay * frequency
        gain = stiff * stiff + dashpot * dashpot
        if gain == 0.0:
            return False
        sine = waves[j].sine
        cosine = waves[j].cosine
        response = square * line.force / gain
        free += response * (stiff * sine - dashpot * cosine)
        rate += response * frequency * (stiff * cosine + dashpot * sine)
        most += abs(response) * sqrt(gain)
    most += sqrt(free * free + rate * rate / omega_squared)
    most += _MARGIN * (most + abs(run.constant) + abs(constants.slope))
    return most < run.support_high and -most > run.support_low


@kernel(inline=True)
def search_on(moving: Moving) -> None:
    """
    Search the flight a few steps of the grid further, up to its first event.

    The steps do not depend on how far the run is to go.
    """
    run = moving.run
    if run.joint:
        search_joint(moving)
        if run.kind == NO_EVENT and run.searched >= run.look:
            # m may stick for days.
            run.look = 2.0 * run.searched
            if joint_motion_lasts(moving, run.searched):
                run.searched = UNREACHED
    elif run.arrival == inf and run.stop_velocity_1 == 0.0 and run.stop_velocity_2 == 0.0:
        # Only `first_of` knows of a support that m leaves.
        if run.searched == 0.0 and leaves_support(run):
            search_all(moving)
        else:
            search_moving(moving)
    else:
        search_all(moving)
    if run.tau > run.deadline if run.kind != NO_EVENT else run.searched >= run.deadline:
        # A snapshot keeps what is searched, not what was found.
        run.searched = min(run.searched, run.deadline)
        motion: Motion = motion_at(moving, run.deadline)
        end_near(run, run.deadline_kind, run.deadline, motion, 0.0)


@kernel
def search_all(moving: Moving) -> None:
    """Search the next step of the grid for all that may end the flight."""
    start = moving.run.searched
    first_of(moving, start, start + oscillator_of(moving.constants, moving.run).step)
