"""
Roots of watched functions to the last digit, from a guess between two nodes.

A last step by the Taylor series, short enough for it to be complete, spares an evaluation: it
leads to the root and carries the motion there.
"""

from __future__ import annotations

from .event_codes import NO_EVENT, REVERSAL
from .flight import Flight, FlightEnd, Motion, motion_at, unfinished
from .kernels import kernel

__all__ = ['falling_root', 'last_step', 'polished']

#: A last step this long, as a phase of what is fastest, leaves the series complete. For a support
#: there is a derivative less.
_LAST_STEP = 1.0 / 128.0
_LAST_STEP_OF_SUPPORT = 1.0 / 512.0
#: The same as a part of the length on which the slope changes: with Newton's step, and without.
_BENT = 1.0 / 32.0
_REVERTED = 1.0 / 2048.0
_EVALUATIONS = 6
#: Where slopes differ by more than this factor, the inverse function is no good guess.
_UNEVEN = 0.2
_GUESS = 1e-4


@kernel(inline=True)
def falling_root(f_a: float, d_a: float, f_b: float, d_b: float, step: float) -> float:
    """
    Return about where a falling function is zero between two nodes.

    Parameters
    ----------
    f_a, d_a, f_b, d_b : float
        The function and its derivative at the nodes; `f_a` is not negative, `f_b` not positive,
        nor both zero.
    step : float
        Time between the nodes.

    Returns
    -------
    float
        Time since the first node.
    """
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
    Return the way to the root of a falling function, and whether it is as exact as can be.

    Parameters
    ----------
    f_0, f_1, f_2, f_3, f_4, f_5 : float
        The function and its derivatives here; `f_1` is negative.
    fastest : float
        Circular frequency by which the derivatives grow.
    longest : float
        Longest step for which these derivatives are enough, as a phase of that.

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
    """
    Return the end of a flight by a reversal or a release near a guess.

    Parameters
    ----------
    flight : Flight
        The flight.
    kind : int
        The event.
    side : int
        +1 for motion down or a support that gives way upwards, else -1.
    tau : float
        The guess.
    low, high : float
        The nodes between which it is.

    Returns
    -------
    FlightEnd
        The end; without event if that does not succeed.
    """
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
