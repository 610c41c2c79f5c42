# SPDX-License-Identifier: Apache-2.0
"""
The first root of a watched function between two instants.

Every watched function (a clearance, the relative speed, the remaining support, X itself) is
parabola(tau) + k X^(d)(tau) with d = 0, 1 or 2. Its values and rates at two instants, and a bound
of its third or fourth derivative between them, may prove that it is positive (`keeps_sign`), or
that it falls (`falls`) and has one root if it is not positive at the end. If they prove neither,
the step is halved. A function that only touches zero, to round-off, has no root.

A flight that begins on a stop has exactly zero clearance and a positive rate. A flight that begins
with a release has neither rate nor acceleration: the sign of its jerk decides (`leap`).
"""

from __future__ import annotations

from math import inf, sqrt

from .certificate import EPSILON, ERROR, ROUND_OFF, falling_root, falls, keeps_sign
from .flight import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    OUTRUN,
    PASSAGE,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    Motion,
    motion_at,
    oscillator_of,
    starting_motion,
)
from .kernels import kernel
from .oscillator import Oscillator, free_bound
from .state import Moving, RigConstants, Run, advance_time, on_stop_1, on_stop_2

# Lengths, speeds and accelerations below this count as zero: their products could underflow.
_NO_LENGTH = 1e-120
#: Shortest step, as a fraction of the step of the grid.
_SHORTEST = 1e-13
#: A step of Newton's method this long, in steps of the grid and relative to the time since the
#: flight's origin, is the last one.
LAST_STEP = 1e-8


@kernel
def watched_function(
    constants: RigConstants, run: Run, kind: int, tau: float, motion: Motion
) -> tuple[float, float, float, float]:
    """Return a watched function and its first two derivatives, and the size of its terms."""
    oscillator = oscillator_of(constants, run)
    if kind in (CONTACT_1, CONTACT_2, ARRIVAL):
        side = 1.0
        left = run.clearance_1
        opening = run.stop_velocity_1
        if kind == CONTACT_2:
            side = -1.0
            left = run.clearance_2
            opening = -run.stop_velocity_2
        elif kind == ARRIVAL:
            side = 1.0 * run.direction
            left = run.arrival
            opening = 0.0
        terms = left + abs(opening) * tau
        if tau <= oscillator.taylor_limit:
            rate = run.relative_acceleration
            terms += abs(run.relative_velocity) * tau + 0.5 * abs(rate) * tau * tau
            terms += abs(motion.travel)
        else:
            fall = run.relative_acceleration + run.acceleration
            terms += abs(run.relative_velocity + run.velocity) * tau + 0.5 * abs(fall) * tau * tau
            terms += abs(motion.x) + abs(run.x)
            terms += abs(run.velocity) * min(tau, oscillator.horizon)
        return (
            left + opening * tau - side * motion.travel,
            opening - side * motion.relative_velocity,
            -side * motion.relative_2,
            terms,
        )
    if kind in (REVERSAL, OUTRUN):
        side = 1.0 * run.direction
        left = 0.0
        rate = abs(run.relative_acceleration) * tau
        terms = abs(motion.relative_velocity) + abs(run.relative_velocity) + rate
        if tau > oscillator.taylor_limit:
            terms += abs(motion.velocity) + abs(run.velocity) + abs(run.acceleration) * tau
        if kind == OUTRUN:
            left = run.speed_1 if run.direction < 0 else run.speed_2
            terms += left
            side = -side
        return (
            left + side * motion.relative_velocity,
            side * motion.relative_2,
            -side * motion.x_3,
            terms,
        )
    if kind == PASSAGE:
        side = 1.0 * run.crossing_side
        terms = abs(motion.x) + abs(run.x) + abs(motion.velocity) * oscillator.horizon
        terms += (abs(motion.x_2) + abs(run.constant)) / oscillator.omega_squared
        return side * motion.x, side * motion.velocity, side * motion.x_2, terms
    side = 1.0 if kind == RELEASE_UP else -1.0
    most = run.support_high if kind == RELEASE_UP else -run.support_low
    terms = oscillator.omega_squared * (abs(motion.x) + abs(motion.velocity) * oscillator.horizon)
    terms += abs(motion.x_2) + abs(most)
    return most - side * motion.x_2, -side * motion.x_3, -side * motion.x_4, terms


@kernel(inline=True)
def set_end(
    run: Run,
    kind: int,
    tau: float,
    x: float,
    velocity: float,
    travel: float,
    relative_velocity: float,
) -> None:
    """Set the event that ends the flight, and the motion just before it."""
    run.kind = kind
    run.tau = tau
    run.end_x = x
    run.end_velocity = velocity
    run.end_travel = travel
    run.end_relative_velocity = relative_velocity
    instant, _ = advance_time(run.time, run.time_low, tau)
    run.due = instant


@kernel
def end_near(run: Run, kind: int, tau: float, motion: Motion, step: float) -> float:
    """Return the instant a tiny step later; the flight ends there, unless X only passes zero."""
    if kind != PASSAGE:
        set_end(
            run,
            kind,
            tau + step,
            motion.x + step * (motion.velocity + 0.5 * step * motion.x_2),
            motion.velocity + step * motion.x_2,
            motion.travel + step * (motion.relative_velocity + 0.5 * step * motion.relative_2),
            motion.relative_velocity + step * motion.relative_2,
        )
    return tau + step


@kernel
def first_root(
    moving: Moving, kind: int, start: float, motion: Motion, end: float, step: float
) -> float:
    """
    Return the first root of a watched function between two times of at most `POINTS` steps.

    `motion` is the motion at the start, `step` the first step. If there is no root, the result is
    infinite. A root ends the flight, unless it is a passage of X.
    """
    constants, _, run, _, _ = moving
    oscillator = oscillator_of(constants, run)
    f_a, d_a, e_a, size = watched_function(constants, run, kind, start, motion)
    bound_3, bound_4 = bounds_of(oscillator, kind, motion)
    t_a = start
    if f_a <= 0.0:
        falling = d_a < 0.0 or (d_a == 0.0 and (e_a < 0.0 or (kind == REVERSAL and e_a == 0.0)))
        if falling and (kind != PASSAGE or f_a < -ERROR * size - _NO_LENGTH or start > 0.0):
            return end_near(run, kind, start, motion, 0.0)
    square = d_a * d_a - 2.0 * e_a * max(f_a, 0.0)
    if e_a < 0.0 < d_a:
        # The step ends before the root of the parabola, after which the function falls.
        step = min(step, max(0.75 * (d_a + sqrt(square)) / -e_a, _SHORTEST * step))
    elif d_a < 0.0 < f_a and square > 0.0:
        # The step ends beyond the root of the parabola.
        step = min(step, 2.5 * f_a / (sqrt(square) - d_a))
    # A shorter step would not advance the time.
    shortest = max(_SHORTEST * oscillator.step, 2.0 * EPSILON * end)
    step = max(step, shortest)
    while t_a < end:
        t_b = min(t_a + step, end)
        span = t_b - t_a
        motion = motion_at(moving, t_b)
        f_b, d_b, _, size = watched_function(constants, run, kind, t_b, motion)
        error = ERROR * size + _NO_LENGTH + 2.0 * max(0.0, -f_a)
        if falls(d_a, d_b, span, bound_3):
            if f_b <= 0.0:
                return root_between(moving, kind, t_a, f_a, d_a, t_b, f_b, d_b)
        elif not keeps_sign(f_a + error, d_a, f_b + error, d_b, span, bound_4):
            if span > shortest:
                step = 0.5 * span
                continue
            if f_b < -error:
                return end_near(run, kind, t_b, motion, 0.0)
        t_a = t_b
        f_a = f_b
        d_a = d_b
        step = 2.0 * span
    return inf


@kernel
def bounds_of(oscillator: Oscillator, kind: int, motion: Motion) -> tuple[float, float]:
    """Return bounds of the third and fourth derivative of a watched function."""
    omega = sqrt(oscillator.omega_squared)
    if kind in (RELEASE_UP, RELEASE_DOWN):
        free = free_bound(oscillator, motion.x_5, motion.x_6)
        return free + oscillator.bound_5, omega * free + oscillator.rate_5
    if kind in (REVERSAL, OUTRUN):
        free = free_bound(oscillator, motion.x_4, motion.x_5)
        return free + oscillator.bound_4, omega * free + oscillator.rate_4
    free = free_bound(oscillator, motion.x_3, motion.x_4)
    return free + oscillator.bound_3, omega * free + oscillator.rate_3


@kernel
def root_between(
    moving: Moving,
    kind: int,
    low: float,
    f_low: float,
    d_low: float,
    high: float,
    f_high: float,
    d_high: float,
) -> float:
    """
    Return where a watched function falls to zero between two times.

    The flight ends there, unless X only passes zero, as in `first_root`.
    """
    constants, _, run, _, _ = moving
    oscillator = oscillator_of(constants, run)
    if f_low < 0.0 or (f_low == 0.0 and d_low <= 0.0):
        return end_near(run, kind, low, motion_at(moving, low), 0.0)
    tau = low + falling_root(f_low, d_low, f_high, d_high, high - low)
    if not low <= tau <= high:
        tau = 0.5 * (low + high)
    motion: Motion = motion_at(moving, tau)
    for _ in range(60):
        value, rate, bend, _ = watched_function(constants, run, kind, tau, motion)
        if value > 0.0:
            low = tau
        else:
            high = tau
        change = 0.5 * (low + high) - tau
        if rate < 0.0:
            newton = -value / rate
            last = abs(newton) <= LAST_STEP * min(oscillator.step, tau)
            newton -= 0.5 * bend / rate * newton * newton
            if last:
                return end_near(run, kind, tau, motion, newton)
            if low < tau + newton < high:
                change = newton
        if tau + change == tau:
            break
        tau += change
        motion = motion_at(moving, tau)
    return end_near(run, kind, tau, motion, 0.0)


@kernel(inline=True)
def leaves_support(run: Run) -> bool:
    """Return whether m begins to move as its support gives way, without speed and acceleration."""
    still = run.relative_velocity == 0.0 and run.relative_acceleration == 0.0
    return still and (run.direction != 0 or on_stop_1(run) or on_stop_2(run))


@kernel
def leap(moving: Moving, longest: float) -> float:
    """
    Return how long m certainly moves on after its support has given way; negative if it stays.

    Relative velocity and acceleration are zero then. With jerk j and a bound B of the next
    derivative the speed is positive for u < 3 j/B, the clearance left behind for u < 4 j/B.
    """
    constants, _, run, _, _ = moving
    oscillator: Oscillator = constants.free
    motion: Motion = starting_motion(moving)
    away = run.direction
    if away == 0:
        away = -1 if run.clearance_1 == 0.0 else 1
    jerk = -away * motion.x_3
    terms = (
        oscillator.omega_squared * abs(motion.velocity)
        + 2.0 * oscillator.decay * abs(motion.x_2)
        + oscillator.jerk_bound
    )
    if jerk < -ROUND_OFF * terms:
        return -1.0
    if jerk <= ROUND_OFF * terms:
        # The sign of the jerk is round-off, and m moves by less than round-off in this step.
        return 1e-9 * oscillator.horizon
    bound = free_bound(oscillator, motion.x_4, motion.x_5) + oscillator.bound_4
    return min(1.5 * jerk / bound, longest) if bound > 0.0 else longest


@kernel
def look_for(
    moving: Moving, kind: int, start: float, motion: Motion, end: float, motion_end: Motion
) -> None:
    """End the flight at the first root of a function, unless an earlier event is known."""
    constants, _, run, _, _ = moving
    f_a, d_a, _, _ = watched_function(constants, run, kind, start, motion)
    f_b, d_b, _, size = watched_function(constants, run, kind, end, motion_end)
    bound_3, bound_4 = bounds_of(oscillator_of(constants, run), kind, motion)
    span = end - start
    error = ERROR * size
    if keeps_sign(f_a - error, d_a, f_b - error, d_b, span, bound_4):
        return
    if f_a > error and falls(d_a, d_b, span, bound_3):
        if f_b <= 0.0 and end <= run.tau:
            root_between(moving, kind, start, f_a, d_a, end, f_b, d_b)
            return
        if f_b > 0.0:
            return
    first_root(moving, kind, start, motion, min(end, run.tau), 0.5 * span)


@kernel
def first_of(moving: Moving, start: float, end: float) -> None:
    """End the flight at the first event between two times, if there is one."""
    run = moving.run
    run.tau = inf
    motion_a: Motion = motion_at(moving, start)
    motion_b: Motion = motion_at(moving, end)
    look_for_all(moving, start, motion_a, end, motion_b)
    if run.kind == NO_EVENT:
        run.searched = end


@kernel
def look_for_all(
    moving: Moving, start: float, motion_a: Motion, end: float, motion_b: Motion
) -> None:
    """End the flight at the first of all possible events in a step, if there is one."""
    run = moving.run
    if run.joint:
        if run.support_high < inf:
            look_for(moving, RELEASE_UP, start, motion_a, end, motion_b)
        if run.support_low > -inf:
            look_for(moving, RELEASE_DOWN, start, motion_a, end, motion_b)
        return
    after = start
    motion_c = motion_a
    if start == 0.0 and leaves_support(run):
        after = leap(moving, end)
        if after < 0.0:
            end_near(run, REVERSAL, 0.0, motion_a, 0.0)
            return
        motion_c = motion_at(moving, after)
    if run.direction != 0:
        if run.arrival < inf:
            look_for(moving, ARRIVAL, start, motion_a, end, motion_b)
            if (run.speed_1 if run.direction < 0 else run.speed_2) < inf:
                look_for(moving, OUTRUN, start, motion_a, end, motion_b)
        look_for(moving, REVERSAL, after, motion_c, end, motion_b)
    # The stop that m leaves is watched only if it moves after m.
    if run.direction >= 0 or run.stop_velocity_1 < 0.0:
        if on_stop_1(run):
            look_for(moving, CONTACT_1, after, motion_c, end, motion_b)
        else:
            look_for(moving, CONTACT_1, start, motion_a, end, motion_b)
    if (run.direction <= 0 or run.stop_velocity_2 > 0.0) and run.clearance_2 < inf:
        if on_stop_2(run):
            look_for(moving, CONTACT_2, after, motion_c, end, motion_b)
        else:
            look_for(moving, CONTACT_2, start, motion_a, end, motion_b)
