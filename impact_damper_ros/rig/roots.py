"""
Points of the grid, and the roots of the watched functions between them, to the last digit.

Half a step of the grid is short enough for a Taylor series about a point to be complete, so that a
root and the motion there need neither a sine nor the closed form.
"""

from __future__ import annotations

from math import cos, nan, sin
from typing import NamedTuple

from .flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    REVERSAL,
    Flight,
    FlightEnd,
    GridPoint,
    Motion,
    Series,
    motion_at,
    series_at,
    tail,
    unfinished,
)
from .kernels import elementwise, kernel
from .oscillator import Grid, Harmonic, Oscillator, acceleration_at

#: Error of positions, velocities and accelerations at the grid points, relative to their terms.
GRID_ERROR = 1e-13


@elementwise
def _sines_at(sine: float, cosine: float, harmonic: Harmonic, tau: float) -> float:
    """Return the sine of each harmonic's phase after a time."""
    return sine * cos(harmonic.frequency * tau) + cosine * sin(harmonic.frequency * tau)


@elementwise
def _cosines_at(sine: float, cosine: float, harmonic: Harmonic, tau: float) -> float:
    """Return the cosine of each harmonic's phase after a time."""
    return cosine * cos(harmonic.frequency * tau) - sine * sin(harmonic.frequency * tau)


@elementwise
def _next_sines(sine: float, cosine: float, harmonic: Harmonic) -> float:
    """Return the sine of each harmonic's phase a step later."""
    return sine * harmonic.turn_cosine + cosine * harmonic.turn_sine


@elementwise
def _next_cosines(sine: float, cosine: float, harmonic: Harmonic) -> float:
    """Return the cosine of each harmonic's phase a step later."""
    return cosine * harmonic.turn_cosine - sine * harmonic.turn_sine


@kernel(inline=True)
def base_point(flight: Flight, tau: float, motion: Motion) -> GridPoint:
    """Return the grid point from which the others are reached."""
    sines = flight.sines
    cosines = flight.cosines
    if tau > 0.0:
        harmonics = flight.oscillator.harmonics
        sines = _sines_at(flight.sines, flight.cosines, harmonics, tau)
        cosines = _cosines_at(flight.sines, flight.cosines, harmonics, tau)
    offset = motion.x - flight.constant / flight.oscillator.omega_squared
    return GridPoint(offset, motion.velocity, sines, cosines)


@kernel(inline=True)
def next_point(oscillator: Oscillator, point: GridPoint) -> GridPoint:
    """Return the grid point a step later."""
    grid = oscillator.grid
    # Negative zero is what adds nothing, which a compiler makes use of.
    pushed = -0.0
    speeded = -0.0
    for j in range(len(point.sines)):
        sine = point.sines[j]
        cosine = point.cosines[j]
        harmonic = oscillator.harmonics[j]
        pushed += cosine * harmonic.x_cosine + sine * harmonic.x_sine
        speeded += cosine * harmonic.v_cosine + sine * harmonic.v_sine
    # Terms that are known early come first: each point waits for the one before.
    offset = (pushed + point.offset * grid.x_x) + point.velocity * grid.x_v
    velocity = (speeded + point.offset * grid.v_x) + point.velocity * grid.v_v
    sines = _next_sines(point.sines, point.cosines, oscillator.harmonics)
    cosines = _next_cosines(point.sines, point.cosines, oscillator.harmonics)
    return GridPoint(offset, velocity, sines, cosines)


@kernel(inline=True)
def acceleration_of(oscillator: Oscillator, point: GridPoint) -> float:
    """Return X'' at a grid point."""
    return acceleration_at(oscillator, 0.0, point.sines, point.offset, point.velocity)


@kernel(inline=True)
def jerk_of(oscillator: Oscillator, point: GridPoint, x_2: float) -> float:
    """Return X''' at a grid point, from X'' there."""
    jerk = -2.0 * oscillator.decay * x_2 - oscillator.omega_squared * point.velocity
    for j in range(len(point.cosines)):
        harmonic = oscillator.harmonics[j]
        jerk += harmonic.force * harmonic.frequency * point.cosines[j]
    return jerk


#: Longest last step for which the series is complete, as a phase of the fastest of spring and
#: harmonics. A support has one derivative less.
_LAST_STEP = 1.0 / 128.0
_LAST_STEP_OF_SUPPORT = 1.0 / 512.0
#: The same as a part of the length on which the slope changes: with Newton's step, and without.
_BENT = 1.0 / 32.0
_REVERTED = 1.0 / 2048.0
_EVALUATIONS = 6
#: Where slopes differ by more than this factor, the inverse function is a poor guess.
_UNEVEN = 0.2
_GUESS = 1e-4


@kernel(inline=True)
def falling_root(f_a: float, d_a: float, f_b: float, d_b: float, step: float) -> float:
    """Return a guess of where a falling function is zero between two grid points."""
    change = f_b - f_a
    part = -f_a / change
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


@kernel(inline=True)
def last_step(
    f_0: float,
    f_1: float,
    f_2: float,
    f_3: float,
    f_4: float,
    f_5: float,
    fastest: float,
    longest: float,
) -> tuple[float, bool]:
    """
    Return the step to the root of a falling function, and whether it is exact to round-off.

    Notes
    -----
    The Taylor series, reverted to the fifth order, and a step of Newton's where it bends.
    """
    inverse = -1.0 / f_1
    u = f_0 * inverse
    v_2 = 0.5 * f_2 * inverse * u
    v_3 = f_3 * inverse * (u * u) * (1.0 / 6.0)
    v_4 = f_4 * inverse * (u * u * u) * (1.0 / 24.0)
    v_5 = f_5 * inverse * (u * u * u * u) * (1.0 / 120.0)
    square = v_2 * v_2
    r_3 = 2.0 * square + v_3
    r_4 = v_2 * (5.0 * square + 5.0 * v_3) + v_4
    r_5 = square * (14.0 * square + 21.0 * v_3) + 6.0 * v_2 * v_4 + 3.0 * v_3 * v_3 + v_5
    step = u + u * (v_2 + (r_3 + (r_4 + r_5)))
    if abs(v_2) > _REVERTED or abs(v_3) > _REVERTED * _REVERTED:
        half = 0.5 * f_2
        third = f_3 * (1.0 / 6.0)
        fourth = f_4 * (1.0 / 24.0)
        fifth = f_5 * (1.0 / 120.0)
        value = f_0 + step * (
            f_1 + step * (half + step * (third + step * (fourth + step * fifth)))
        )
        slope = f_1 + step * (
            f_2 + step * (3.0 * third + step * (4.0 * fourth + step * (5.0 * fifth)))
        )
        step -= value / slope
    exact = abs(step) * fastest <= longest and abs(v_2) <= _BENT and abs(v_3) <= _BENT * _BENT
    return step, exact


@kernel(inline=True)
def _shifted(motion: Motion, kind: int, tau: float, step: float, slope: float) -> FlightEnd:
    """Return the end of a flight a last step away from where its motion is known."""
    x_3 = motion.x_3 * (1.0 / 6.0)
    x_4 = motion.x_4 * (1.0 / 24.0)
    x_5 = motion.x_5 * (1.0 / 120.0)
    x_6 = motion.x_6 * (1.0 / 720.0)
    bend = step * step * step * (x_3 + step * (x_4 + step * (x_5 + step * x_6)))
    bend_1 = step * step * (3.0 * x_3 + step * (4.0 * x_4 + step * (5.0 * x_5 + step * 6.0 * x_6)))
    return FlightEnd(
        kind,
        tau + step,
        motion.x + (step * (motion.velocity + 0.5 * step * motion.x_2) + bend),
        motion.velocity + (step * motion.x_2 + bend_1),
        motion.travel
        + (step * (motion.relative_velocity + 0.5 * step * motion.relative_2) - bend),
        motion.relative_velocity + (step * motion.relative_2 - bend_1),
        slope,
        True,
    )


@kernel(inline=True)
def polished(
    flight: Flight, kind: int, side: int, tau: float, low: float, high: float
) -> FlightEnd:
    """Return the end of a flight by a reversal or a release near a guess."""
    for _ in range(_EVALUATIONS):
        motion: Motion = motion_at(flight, tau)
        longest = _LAST_STEP
        x_3 = side * motion.x_3
        x_4 = side * motion.x_4
        x_5 = side * motion.x_5
        if kind == REVERSAL:
            f_0 = side * motion.relative_velocity
            f_1 = side * motion.relative_2
            f_2 = -x_3
            f_3 = -x_4
            f_4 = -x_5
            f_5 = -side * motion.x_6
        else:
            most = flight.support_high if side > 0 else -flight.support_low
            f_0 = most - side * (motion.x_2 - flight.slope)
            f_1 = -x_3
            f_2 = -x_4
            f_3 = -x_5
            f_4 = -side * motion.x_6
            f_5 = 0.0
            longest = _LAST_STEP_OF_SUPPORT
        if f_1 >= 0.0:
            break
        step, exact = last_step(f_0, f_1, f_2, f_3, f_4, f_5, flight.oscillator.fastest, longest)
        if exact:
            return _shifted(motion, kind, tau, step, f_1)
        tau += step
        if not low < tau <= high:
            break
    return unfinished(NO_EVENT, low)


#: The series is complete this far from its point, in steps; half a step is what it takes.
SERIES_REACH = 0.6
#: A last step this long, in steps of the grid and relative to the time since the flight's origin,
#: leaves nothing behind.
_LEAST_LEFT = 1e-8
_MORE_STEPS = 5


class Relative(NamedTuple):
    """
    Where and when a grid point is, and the motion of m relative to M there.

    Attributes
    ----------
    tau : float
        Time since the flight's origin, s.
    x : float
        X, m.
    travel, speed : float
        Y - Y(origin), m, and Y', m/s.
    """

    tau: float
    x: float
    travel: float
    speed: float


@kernel(inline=True)
def _coarse_tail(series: Series, s: float) -> tuple[float, float, float, float]:
    """Return what the third to tenth power add to X and its first three derivatives."""
    _, b_3, b_4, b_5, b_6, b_7, b_8, b_9, b_10 = series[:9]
    s_2 = s * s
    s_4 = s_2 * s_2
    value = ((b_3 * (1.0 / 3.0) + 0.25 * b_4 * s) + (0.2 * b_5 + b_6 * (1.0 / 6.0) * s) * s_2) + (
        (b_7 * (1.0 / 7.0) + 0.125 * b_8 * s) + (b_9 * (1.0 / 9.0) + 0.1 * b_10 * s) * s_2
    ) * s_4
    slope = ((b_3 + b_4 * s) + (b_5 + b_6 * s) * s_2) + (
        (b_7 + b_8 * s) + (b_9 + b_10 * s) * s_2
    ) * s_4
    bend = (2.0 * b_3 + 3.0 * b_4 * s) + (4.0 * b_5 + 5.0 * b_6 * s) * s_2
    third = (2.0 * b_3 + 6.0 * b_4 * s) + (12.0 * b_5 + 20.0 * b_6 * s) * s_2
    return s * s_2 * value, s_2 * slope, s * bend, third


@kernel(inline=True)
def _step(
    side: float,
    point: GridPoint,
    there: Relative,
    rate: float,
    left: float,
    series: Series,
    grid: Grid,
    s: float,
    low: float,
    high: float,
) -> tuple[float, FlightEnd]:
    """Return a step to a contact close by, and the end of the flight if it leads there."""
    step = grid.step
    speed = there.speed * step
    scaled = rate * step * step
    velocity = point.velocity * step
    x_2 = series.x_2
    bend, bend_1, bend_2 = tail(series, s)
    travel = s * (speed + 0.5 * s * scaled) - bend
    closing = speed + s * scaled - bend_1
    closing_1 = scaled - bend_2
    f_1 = -side * closing
    if f_1 >= 0.0:
        return nan, unfinished(NO_EVENT, low)
    # Newton's step, bent as the function is
    inverse = -1.0 / f_1
    u = (left - side * travel) * inverse
    u -= 0.5 * side * closing_1 * inverse * u * u
    tau = there.tau + (s + u) * step
    if abs(u) > _LEAST_LEFT * min(1.0, there.tau * grid.inverse + s) or not low < tau <= high:
        return u, unfinished(NO_EVENT, low)
    return u, FlightEnd(
        CONTACT_1 if side > 0.0 else CONTACT_2,
        tau,
        there.x
        + (
            s * (velocity + 0.5 * s * x_2)
            + bend
            + u * (velocity + s * x_2 + bend_1 + 0.5 * u * (x_2 + bend_2))
        ),
        point.velocity + (s * x_2 + bend_1 + u * (x_2 + bend_2)) * grid.inverse,
        there.travel + (travel + u * (closing + 0.5 * u * closing_1)),
        there.speed + (s * scaled - bend_1 + u * closing_1) * grid.inverse,
        f_1 * grid.inverse,
        True,
    )


@kernel
def _by_steps(
    flight: Flight,
    side: float,
    point: GridPoint,
    there: Relative,
    rate: float,
    left: float,
    s: float,
    low: float,
    high: float,
) -> FlightEnd:
    """Go on step by step where the first one is too long; the parameters are those of `_step`."""
    grid = flight.oscillator.grid
    series: Series = series_at(flight.oscillator, point)
    end: FlightEnd = unfinished(NO_EVENT, low)
    for _ in range(_MORE_STEPS):
        if not abs(s) <= SERIES_REACH:
            break
        u, end = _step(side, point, there, rate, left, series, grid, s, low, high)
        if end.finished:
            break
        s += u
    return end


@kernel(inline=True)
def contact_root(
    flight: Flight,
    side: float,
    point: GridPoint,
    there: Relative,
    rate: float,
    guess: float,
    low: float,
    high: float,
) -> FlightEnd:
    """Return the end of a flight by a contact near a guess."""
    grid = flight.oscillator.grid
    step = grid.step
    clearance = flight.clearance_1 if side > 0.0 else flight.clearance_2
    left = clearance - side * there.travel
    speed = there.speed * step
    scaled = rate * step * step
    series: Series = series_at(flight.oscillator, point)
    s = guess * grid.inverse
    # First to within a last step of the root, by most of the series
    bend, bend_1, bend_2, bend_3 = _coarse_tail(series, s)
    f_1 = -side * (speed + s * scaled - bend_1)
    if f_1 >= 0.0:
        return unfinished(NO_EVENT, low)
    inverse = -1.0 / f_1
    u = (left - side * (s * (speed + 0.5 * s * scaled) - bend)) * inverse
    v_2 = -0.5 * side * (scaled - bend_2) * inverse * u
    v_3 = side * bend_3 * inverse * (u * u) * (1.0 / 6.0)
    s += u + u * (v_2 + (2.0 * v_2 * v_2 + v_3))
    if not abs(s) <= SERIES_REACH:
        return unfinished(NO_EVENT, low)
    u, end = _step(side, point, there, rate, left, series, grid, s, low, high)
    if not end.finished:
        return _by_steps(flight, side, point, there, rate, left, s + u, low, high)
    return end
