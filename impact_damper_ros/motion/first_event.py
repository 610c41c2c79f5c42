# SPDX-License-Identifier: Apache-2.0
"""
The certified first event of a flight.

Every function that is watched (a clearance, the relative speed, the support left, X itself) is
parabola(tau) + k X^(d)(tau) with d = 0, 1 or 2. Where it and its rate are known at two instants,
and the third and fourth derivatives of its X^(d) are bounded between them, it is certain to be
positive (`keeps_sign`), or to fall (`falls`) and to have one root if it is not positive at the
end. Where neither is certain, the step is halved. A function that comes to zero within its
round-off and goes away again has no root.

Most steps need less: along the grid, as long as m certainly approaches one stop, or turns once
since Y'' keeps its sign, only the clearance there is looked at, and the root is found by a Taylor
series about the nearest point, which needs neither a sine nor the closed form.

"Just left the stop" is handled here only. A flight that begins on a stop has exactly zero
clearance and a positive rate there. A flight that begins with a release has neither; its jerk
leads it away.
"""

from __future__ import annotations

from math import copysign, inf, nan, sqrt
from typing import NamedTuple

from .compiled import kernel
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
    Series,
    coarse_tail,
    motion_at,
    oscillator_of,
    series_at,
    starting_motion,
    tail,
)
from .oscillator import POINTS, Oscillator, free_bound
from .state import Lines, Moving, RigConstants, Run, Waves, advance_time, on_stop_1, on_stop_2

_EPSILON = 2.220446049250313e-16
#: Error of a watched function at an instant, relative to its terms.
ERROR = 1e-13
#: A sum this small compared with its terms is zero to round-off.
ROUND_OFF = 16.0 * _EPSILON
# Below this, lengths, speeds and accelerations are zero: bounds need squares, and no float is as
# small as those.
_NO_LENGTH = 1e-120
#: Shortest step, over that of the grid.
_SHORTEST = 1e-13
#: The series is complete this far from its point, in steps; half a step is what it takes.
_SERIES_REACH = 0.6
#: A last step this long, in steps of the grid and relative to the time since the flight's origin,
#: leaves nothing behind.
_LAST_STEP = 1e-8
#: Where slopes differ by more than this factor, the inverse function is a poor guess.
_UNEVEN = 0.2
_GUESS = 1e-4


@kernel(inline=True)
def keeps_sign(f_a: float, d_a: float, f_b: float, d_b: float, step: float, bound: float) -> bool:
    """
    Return whether a function is certain to be positive between two instants.

    Notes
    -----
    With s = (t - t_a)/step the function is no less than

        f_a (1-s)^3 + 3 c_1 s (1-s)^2 + 3 c_2 s^2 (1-s) + f_b s^3 - bound step^4/24 s^2 (1-s)^2

    where c_1 and c_2 are the inner Bernstein coefficients of the Hermite cubic; either inner term
    outweighs the last one, if its coefficient is at least bound step^4/72.
    """
    third = step * (1.0 / 3.0)
    c_1 = f_a + third * d_a
    c_2 = f_b - third * d_b
    least = bound * (step * step) * (step * step) * (1.0 / 72.0)
    return f_a >= 0.0 and f_b > 0.0 and c_1 >= 0.0 and c_2 >= 0.0 and max(c_1, c_2) >= least


@kernel(inline=True)
def falls(d_a: float, d_b: float, step: float, bound: float) -> bool:
    """Return whether a function is certain to fall between two instants, by its rates there."""
    return max(d_a, d_b) + 0.125 * step * step * bound < 0.0


@kernel(inline=True)
def falling_root(f_a: float, d_a: float, f_b: float, d_b: float, step: float) -> float:
    """Return a guess of where a function falls to zero between two instants."""
    change = f_b - f_a
    # One that rises from zero first is zero at its start as well: from the other end then
    part = -f_a / change if f_a > 0.0 else 1.0
    if d_a < _UNEVEN * d_b and d_b < _UNEVEN * d_a:
        # The inverse function as a Hermite cubic
        m_a = change / d_a
        m_b = change / d_b
        c_2 = 3.0 * step - 2.0 * m_a - m_b
        c_3 = m_a + m_b - 2.0 * step
        return part * (m_a + part * (c_2 + part * c_3))
    m_a = d_a * step
    m_b = d_b * step
    c_2 = 3.0 * change - 2.0 * m_a - m_b
    c_3 = m_a + m_b - 2.0 * change
    low = 0.0
    high = 1.0
    for _ in range(16):
        value = f_a + part * (m_a + part * (c_2 + part * c_3))
        slope = m_a + part * (2.0 * c_2 + 3.0 * part * c_3)
        if value > 0.0:
            low = part
        else:
            high = part
        following = 0.5 * (low + high)
        if slope < 0.0 and low < part - value / slope < high:
            following = part - value / slope
        change = following - part
        part = following
        if abs(change) < _GUESS:
            break
    return part * step


@kernel
def watched(
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
    """Let the flight end a tiny step after an instant, unless that is a passage; return when."""
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

    `motion` is that at the start, and `step` the first one tried. The time is infinite if there is
    no root; else, unless it is a passage of X, the flight ends there.
    """
    constants, _, run, _, _ = moving
    oscillator = oscillator_of(constants, run)
    f_a, d_a, e_a, size = watched(constants, run, kind, start, motion)
    bound_3, bound_4 = bounds_of(oscillator, kind, motion)
    t_a = start
    if f_a <= 0.0:
        falling = d_a < 0.0 or (d_a == 0.0 and (e_a < 0.0 or (kind == REVERSAL and e_a == 0.0)))
        if falling and (kind != PASSAGE or f_a < -ERROR * size - _NO_LENGTH or start > 0.0):
            return end_near(run, kind, start, motion, 0.0)
    square = d_a * d_a - 2.0 * e_a * max(f_a, 0.0)
    if e_a < 0.0 < d_a:
        # Up to before the root of the parabola; after that the function falls.
        step = min(step, max(0.75 * (d_a + sqrt(square)) / -e_a, _SHORTEST * step))
    elif d_a < 0.0 < f_a and square > 0.0:
        # Beyond that root
        step = min(step, 2.5 * f_a / (sqrt(square) - d_a))
    # No step is shorter, so that each gets on.
    shortest = max(_SHORTEST * oscillator.step, 2.0 * _EPSILON * end)
    step = max(step, shortest)
    while t_a < end:
        t_b = min(t_a + step, end)
        span = t_b - t_a
        motion = motion_at(moving, t_b)
        f_b, d_b, _, size = watched(constants, run, kind, t_b, motion)
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
    """Return where a watched function falls to zero between two times; as `first_root`."""
    constants, _, run, _, _ = moving
    oscillator = oscillator_of(constants, run)
    if f_low < 0.0 or (f_low == 0.0 and d_low <= 0.0):
        return end_near(run, kind, low, motion_at(moving, low), 0.0)
    tau = low + falling_root(f_low, d_low, f_high, d_high, high - low)
    if not low <= tau <= high:
        tau = 0.5 * (low + high)
    motion: Motion = motion_at(moving, tau)
    for _ in range(60):
        value, rate, bend, _ = watched(constants, run, kind, tau, motion)
        if value > 0.0:
            low = tau
        else:
            high = tau
        change = 0.5 * (low + high) - tau
        if rate < 0.0:
            newton = -value / rate
            last = abs(newton) <= _LAST_STEP * min(oscillator.step, tau)
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
        # The sign of the jerk is round-off; within this step m moves by less than round-off.
        return 1e-9 * oscillator.horizon
    bound = free_bound(oscillator, motion.x_4, motion.x_5) + oscillator.bound_4
    return min(1.5 * jerk / bound, longest) if bound > 0.0 else longest


@kernel
def look_for(
    moving: Moving, kind: int, start: float, motion: Motion, end: float, motion_end: Motion
) -> None:
    """Let the flight end at the first root of a function, if it is earlier than what is found."""
    constants, _, run, _, _ = moving
    f_a, d_a, _, _ = watched(constants, run, kind, start, motion)
    f_b, d_b, _, size = watched(constants, run, kind, end, motion_end)
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
    """Let the flight end at the first event between two times, if there is one."""
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
    """Let the flight end at the first of its possible events in a step, if there is one."""
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


@kernel(inline=True)
def next_point(
    lines: Lines,
    first: int,
    waves: Waves,
    offset: float,
    velocity: float,
    x_x: float,
    x_v: float,
    v_x: float,
    v_v: float,
) -> tuple[float, float]:
    """Return X from rest and X' at the next point of the grid, and go on to the waves there."""
    # Negative zero is what adds nothing, which a compiler makes use of.
    pushed = -0.0
    speeded = -0.0
    for j in range(len(waves)):
        line = lines[first + j]
        wave = waves[j]
        sine = wave.sine
        cosine = wave.cosine
        pushed += cosine * line.x_cosine + sine * line.x_sine
        speeded += cosine * line.v_cosine + sine * line.v_sine
        turn_cosine = line.turn_cosine
        turn_sine = line.turn_sine
        wave.sine = sine * turn_cosine + cosine * turn_sine
        wave.cosine = cosine * turn_cosine - sine * turn_sine
    # Terms that are known early come first: each point waits for the one before.
    return (
        (pushed + offset * x_x) + velocity * x_v,
        (speeded + offset * v_x) + velocity * v_v,
    )


@kernel(inline=True)
def turn_back(lines: Lines, first: int, waves: Waves) -> None:
    """Go back to the waves at the point of the grid before."""
    for j in range(len(waves)):
        line = lines[first + j]
        wave = waves[j]
        sine = wave.sine
        cosine = wave.cosine
        wave.sine = sine * line.turn_cosine - cosine * line.turn_sine
        wave.cosine = cosine * line.turn_cosine + sine * line.turn_sine


@kernel(inline=True)
def drive_at(lines: Lines, first: int, waves: Waves) -> float:
    """Return the acceleration by the harmonics where the waves are."""
    drive = -0.0
    for j in range(len(waves)):
        drive += lines[first + j].force * waves[j].sine
    return drive


@kernel(inline=True)
def drive_before(lines: Lines, waves: Waves) -> float:
    """Return the acceleration of M by the harmonics at the point of the grid before."""
    drive = -0.0
    for j in range(len(waves)):
        line = lines[j]
        wave = waves[j]
        drive += line.force * (wave.sine * line.turn_cosine - wave.cosine * line.turn_sine)
    return drive


@kernel(inline=True)
def drive_rates(lines: Lines, waves: Waves) -> tuple[float, float]:
    """Return the rates of that acceleration at the point before, and where the waves are."""
    before = now = -0.0
    for j in range(len(waves)):
        line = lines[j]
        wave = waves[j]
        push = line.force * line.frequency
        before += push * (wave.cosine * line.turn_cosine + wave.sine * line.turn_sine)
        now += push * wave.cosine
    return before, now


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
    Returned are the last time but one, the last step (NaN if there is no root nearby), and what
    the series adds to the function and to its first two derivatives there.
    """
    # First to within a last step of the root, by most of the series
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
        # Newton's step, bent as the function is
        inverse = -1.0 / rate
        u = (f_0 + (s * (f_1 + 0.5 * s * f_2) + sign * bend)) * inverse
        last = abs(u) <= _LAST_STEP * min(1.0, since + s)
        u += 0.5 * (f_2 + sign * bend_2) * inverse * u * u
        if last:
            return s, u, bend, bend_1, bend_2
        s += u
    return s, nan, 0.0, 0.0, 0.0


@kernel(inline=True)
def contact_by_series(
    moving: Moving, side: float, point: Point, guess: float, low: float, high: float
) -> bool:
    """Set the end of the flight by a contact near a point of the grid; or return that it fails."""
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
    # Also if u is NaN
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
    """Return X'' where the waves are."""
    x_2 = run.constant + drive_at(lines, run.first, waves)
    return x_2 - (2.0 * oscillator.decay * velocity + oscillator.omega_squared * x)


@kernel
def turned_root(f_a: float, d_a: float, e_a: float, f_b: float, step: float) -> float:
    """Return a guess of where a function, concave in a step, falls to zero after its crest."""
    root = (d_a + sqrt(d_a * d_a - 2.0 * e_a * f_a)) / -e_a
    # The parabola, and the cubic that ends where the function does
    third = (f_b - f_a - step * (d_a + 0.5 * step * e_a)) / (step * step * step)
    slope = d_a + root * (e_a + 3.0 * third * root)
    if slope < 0.0:
        root -= third * root * root * root / slope
    return root


class Point(NamedTuple):
    """Motion at a point of the grid; `offset` is X less its constant part, `speed` is Y'."""

    time: float
    offset: float
    x: float
    velocity: float
    travel: float
    speed: float


#: What m does in a step: nothing that is certain, ...
UNKNOWN = 0
#: ... no more than to move between the stops, ...
CLEAR = 1
#: ... approach one stop throughout, or ...
APPROACH = 2
#: ... turn once, far from the one and perhaps into the other.
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
        # The speed changes one way. With friction m moves in its direction, up to the turn.
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
            # By the nearer point
            point = b
            if guess > 0.5 * step:
                guess -= step
            else:
                point = a
                turn_back(lines, 0, waves)
            if contact_by_series(moving, side, point, guess, a.time, t):
                return
        if hits or way == UNKNOWN:
            # The waves are elsewhere now: the search begins again from here.
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


#: Later than any motion lasts, s.
FOR_EVER = 1e300
#: Part of a bound by which the support must exceed it.
_MARGIN = 1e-6


@kernel
def holds_for_ever(moving: Moving, tau: float) -> bool:
    """
    Return whether sticking certainly lasts from a time on.

    X'' is the sum of the steady vibration, whose amplitude is known, and of a free one, which
    never grows.
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
        push = square * line.force / gain
        free += push * (stiff * sine - dashpot * cosine)
        rate += push * frequency * (stiff * cosine + dashpot * sine)
        most += abs(push) * sqrt(gain)
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
            if holds_for_ever(moving, run.searched):
                run.searched = FOR_EVER
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
