# SPDX-License-Identifier: Apache-2.0
"""
The sign and slope of a function between two instants, proved from values, rates and a bound.

The bound limits the third or fourth derivative. Estimates of a root need no bound.
"""

from __future__ import annotations

from math import sqrt

from .kernels import kernel

EPSILON = 2.220446049250313e-16
#: Error of a watched function at an instant, relative to its terms.
ERROR = 1e-13
#: A sum this small compared with its terms is zero to round-off.
ROUND_OFF = 16.0 * EPSILON
#: Least ratio of the slopes at both ends for which the inverse cubic is a good estimate.
_LEAST_SLOPE_RATIO = 0.2
#: Accuracy of an estimate, in steps.
_ESTIMATE_TOLERANCE = 1e-4


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
    """Estimate where a function falls to zero between two instants."""
    change = f_b - f_a
    # A function that first rises from zero is zero at its start, too: Newton's method then begins
    # at the end.
    part = -f_a / change if f_a > 0.0 else 1.0
    if d_a < _LEAST_SLOPE_RATIO * d_b and d_b < _LEAST_SLOPE_RATIO * d_a:
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
        if abs(change) < _ESTIMATE_TOLERANCE:
            break
    return part * step


@kernel
def turned_root(f_a: float, d_a: float, e_a: float, f_b: float, step: float) -> float:
    """Estimate where a function, concave in a step, falls to zero after its maximum."""
    root = (d_a + sqrt(d_a * d_a - 2.0 * e_a * f_a)) / -e_a
    # The parabola, and the cubic that ends where the function does
    third = (f_b - f_a - step * (d_a + 0.5 * step * e_a)) / (step * step * step)
    slope = d_a + root * (e_a + 3.0 * third * root)
    if slope < 0.0:
        root -= third * root * root * root / slope
    return root
