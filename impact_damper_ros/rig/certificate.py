"""
Certified steps: how far ahead a function is certain not to reach zero.

A watched function h (a clearance, the relative speed, the support left) is known now with two
derivatives, and its third derivative is bounded by a constant B. So
h(u) >= h0 + h1 u + h2 u^2/2 - B u^3/6, and up to the first root of that cubic it has no root.
Stepping by these roots never passes a root of h, whatever lies between the steps, and converges
on the first one from the left with order three.
"""

from __future__ import annotations

from math import sqrt

from .kernels import kernel

_EPSILON = 2.220446049250313e-16
_STEP_TOLERANCE = 1e-12
_LEAST_STEP = 1e-9
_COARSE = 1.0 / 64.0

#: A sum this small compared with its terms is zero to round-off.
ROUND_OFF = 16.0 * _EPSILON


@kernel
def safe_step(h_0: float, h_1: float, h_2: float, bound: float, horizon: float) -> float:
    """
    Return how far ahead a function is certain to stay positive.

    Parameters
    ----------
    h_0, h_1, h_2 : float
        The function and its first two derivatives now; `h_0` not negative.
    bound : float
        Bound of the third derivative's modulus over the horizon; not negative.
    horizon : float
        Longest step wanted.

    Returns
    -------
    float
        A lower bound, tight to 1e-12, of the first positive root of
        h_0 + h_1 u + h_2 u^2/2 - bound u^3/6, at most the horizon.
    """
    half = 0.5 * h_2
    sixth = bound / 6.0
    left = 0.0
    discriminant = h_2 * h_2 + 2.0 * bound * h_1
    if h_2 > 0.0 and h_1 < 0.0:
        # Convex and falling at first: a root here is approached by Newton from the left.
        if discriminant > 0.0:
            lowest = -2.0 * h_1 / (h_2 + sqrt(discriminant))
        else:
            # Squares of less than 1e-162 are no floats: the bound may be lost with them.
            lowest = h_2 / bound if bound > 0.0 else horizon
        if h_0 + lowest * (h_1 + lowest * (half - lowest * sixth)) <= 0.0:
            u = 0.0
            for _ in range(64):
                value = h_0 + u * (h_1 + u * (half - u * sixth))
                slope = h_1 + u * (h_2 - 0.5 * u * bound)
                if value <= 0.0 or slope >= 0.0:
                    break
                change = -value / slope
                if u + change >= lowest:
                    break
                u += change
                if change <= _STEP_TOLERANCE * u:
                    break
            return min(u, horizon)
        left = lowest
        if discriminant > 0.0:
            if h_2 + sqrt(discriminant) >= bound * horizon:
                return horizon
            left = (h_2 + sqrt(discriminant)) / bound
    elif h_1 > 0.0 or h_2 > 0.0:
        # Rises first; beyond its maximum it is concave and falling.
        root = sqrt(max(discriminant, 0.0))
        if h_2 > 0.0:
            if h_2 + root >= bound * horizon:
                return horizon
            left = (h_2 + root) / bound
        elif 2.0 * h_1 >= horizon * (root - h_2):
            return horizon
        else:
            left = 2.0 * h_1 / (root - h_2)
    if left >= horizon:
        return horizon
    right = horizon
    value_right = h_0 + right * (h_1 + right * (half - right * sixth))
    # NaN has no root either: the search goes on and ends.
    if not value_right < 0.0:
        return horizon
    value_left = h_0 + left * (h_1 + left * (half - left * sixth))
    if value_left <= 0.0:
        return left if left > 0.0 and value_left == 0.0 else 0.0
    # First reduce the interval to the scale of the root: tangents converge slowly from far away.
    trial = _COARSE * right
    while trial > left:
        value = h_0 + trial * (h_1 + trial * (half - trial * sixth))
        if value > 0.0:
            left = trial
            value_left = value
            break
        right = trial
        value_right = value
        trial *= _COARSE
    # Concave and falling: a chord stays left of the root, a tangent stays right of it.
    for _ in range(64):
        chord = left + (right - left) * (value_left / (value_left - value_right))
        value = h_0 + chord * (h_1 + chord * (half - chord * sixth))
        if value > 0.0 and chord > left:
            left = chord
            value_left = value
        slope = h_1 + right * (h_2 - 0.5 * right * bound)
        tangent = right - value_right / slope if slope < 0.0 else right
        if tangent >= right:
            # The right end is the root to round-off: bring the left end up to it.
            left = max(left, right * (1.0 - _STEP_TOLERANCE))
            break
        if left < tangent:
            value = h_0 + tangent * (h_1 + tangent * (half - tangent * sixth))
            if value <= 0.0:
                right = tangent
                value_right = value
            else:
                left = tangent
                value_left = value
        else:
            break
        if right - left <= _STEP_TOLERANCE * right:
            break
    return left


@kernel
def look_ahead(
    h_0: float, h_1: float, h_2: float, bound: float, horizon: float, tau: float
) -> tuple[float, bool]:
    """
    Return the safe step of one watched function, and whether it ends on the root.

    It ends on the root if the cubic with +bound, which has a root no later than the function, has
    its root within the last digit of the time.
    """
    step = safe_step(h_0, h_1, h_2, bound, horizon)
    if step >= horizon:
        return horizon, False
    slope = h_1 + step * (h_2 - 0.5 * step * bound)
    if step <= 2.0 * _EPSILON * tau:
        return step, slope < 0.0 or step == 0.0
    if slope >= 0.0:
        return step, False
    uncertainty = bound * step * step * step / (-3.0 * slope) + 2.0 * _STEP_TOLERANCE * step
    return step, uncertainty <= 0.5 * _EPSILON * tau


@kernel
def least_step(horizon: float) -> float:
    """Return the step beyond a point at which a function is zero to round-off."""
    return _LEAST_STEP * horizon


@kernel
def look_past(
    h_0: float, h_1: float, h_2: float, bound: float, horizon: float, tau: float, scale: float
) -> tuple[float, bool]:
    """
    Return a step as `look_ahead` does, but do not stall where a function touches zero.

    There it is zero to the round-off of its terms, which are of size `scale`, and no step is safe.
    The least step then passes over no more than that round-off.
    """
    step, root = look_ahead(h_0, h_1, h_2, bound, horizon, tau)
    least = least_step(horizon)
    if step < least and h_0 + abs(h_1) * least <= ROUND_OFF * scale:
        return least, False
    return step, root


@kernel(inline=True)
def keeps_sign(
    f_a: float, d_a: float, f_b: float, d_b: float, step: float, bound: float, error: float
) -> bool:
    """
    Return whether a function is certain to be positive between two grid points.

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
    least = bound * (step * step) * (step * step) * (1.0 / 72.0) + error
    return f_a >= 0.0 and f_b > error and c_1 >= error and c_2 >= error and max(c_1, c_2) >= least
