"""
The certified first event of a flight.

Each watched function h (a clearance, the relative speed, the support left) is positive at a node
and known there with two derivatives; its third derivative is bounded by a constant B, known from
the closed form. So h(u) >= h0 + h1 u + h2 u^2/2 - B u^3/6, and up to the first root of that cubic
there is no event. Stepping from node to node by this root never passes an event, whatever lies
between the nodes, and converges on the first one from the left with order three.

This module is also the only place that knows about "just left the stop": a flight that begins on
a stop has exactly zero clearance and a positive rate there, which the cubic takes as it is.
"""

from __future__ import annotations

from math import inf, sqrt

from .flight import Flight, Motion, motion_at
from .kernels import kernel
from .oscillator import derivative_bound

__all__ = [
    'ARRIVAL',
    'CONTACT_1',
    'CONTACT_2',
    'NO_EVENT',
    'RELEASE_DOWN',
    'RELEASE_UP',
    'REVERSAL',
    'first_event',
    'safe_step',
]

NO_EVENT = 0
CONTACT_1 = 1
CONTACT_2 = 2
REVERSAL = 3
ARRIVAL = 4
RELEASE_UP = 5
RELEASE_DOWN = 6

_EPSILON = 2.220446049250313e-16
_STEP_TOLERANCE = 1e-12


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
            lowest = h_2 / bound
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
    if value_right >= 0.0:
        return horizon
    value_left = h_0 + left * (h_1 + left * (half - left * sixth))
    if value_left <= 0.0:
        return left if left > 0.0 and value_left == 0.0 else 0.0
    # Concave and falling: a chord stays left of the root, a tangent stays right of it.
    for _ in range(64):
        chord = left + (right - left) * (value_left / (value_left - value_right))
        value = h_0 + chord * (h_1 + chord * (half - chord * sixth))
        if value > 0.0 and chord > left:
            left = chord
            value_left = value
        slope = h_1 + right * (h_2 - 0.5 * right * bound)
        tangent = right - value_right / slope if slope < 0.0 else right
        if left < tangent < right:
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
def _look_ahead(
    h_0: float, h_1: float, h_2: float, bound: float, horizon: float, tau: float
) -> tuple[float, bool]:
    """
    Return the safe step of one watched function, and whether it ends on the root.

    It does if the root is then known to the last digit of the time: the cubic with +bound has
    its own root no later than that.
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
def _leave_support(flight: Flight, motion: Motion) -> float:
    """
    Return how long m certainly moves on after its support has given way.

    Relative velocity and acceleration are zero then. With jerk j and a bound B of the next
    derivative the speed is positive for u < 3 j/B, the clearance left behind for u < 4 j/B.
    """
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    jerk = abs(motion.x_3)
    bound = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
    step = horizon
    if 1.5 * jerk < bound * horizon:
        step = 1.5 * jerk / bound
    # The stop ahead, if there is one, must not be reached within that step.
    jerk_bound = jerk + bound * horizon
    if flight.direction >= 0 and flight.clearance_1 > 0.0:
        step = min(step, safe_step(flight.clearance_1, 0.0, 0.0, jerk_bound, horizon))
    if flight.direction <= 0 and flight.clearance_2 > 0.0:
        step = min(step, safe_step(flight.clearance_2, 0.0, 0.0, jerk_bound, horizon))
    return step


@kernel
def _first_in_motion(flight: Flight, tau: float, limit: float) -> tuple[int, float]:
    """Step through relative motion; see `first_event`."""
    oscillator = flight.oscillator
    direction = flight.direction
    horizon = oscillator.horizon
    motion: Motion = motion_at(flight, tau)
    held = direction != 0 or flight.clearance_1 == 0.0 or flight.clearance_2 == 0.0
    still = flight.relative_velocity == 0.0 and flight.relative_acceleration == 0.0
    if tau == 0.0 and held and still:
        if motion.x_3 == 0.0 or direction * motion.x_3 > 0.0:
            return REVERSAL, 0.0
        tau = _leave_support(flight, motion)
        motion = motion_at(flight, tau)
    while tau <= limit:
        bound_3 = derivative_bound(oscillator, motion.x_3, motion.x_4, oscillator.bound_3)
        speed = motion.relative_velocity
        rate = motion.relative_2
        step = horizon
        kind = NO_EVENT
        found = False
        if direction >= 0:
            clearance = flight.clearance_1 - motion.travel
            if clearance <= 0.0:
                if speed > 0.0:
                    return CONTACT_1, tau
                clearance = 0.0
            ahead, root = _look_ahead(clearance, -speed, -rate, bound_3, horizon, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_1
                found = root
        if direction <= 0:
            clearance = flight.clearance_2 + motion.travel
            if clearance <= 0.0:
                if speed < 0.0:
                    return CONTACT_2, tau
                clearance = 0.0
            ahead, root = _look_ahead(clearance, speed, rate, bound_3, horizon, tau)
            if ahead < step:
                step = ahead
                kind = CONTACT_2
                found = root
        if direction != 0:
            along = direction * speed
            along_1 = direction * rate
            along_2 = -direction * motion.x_3
            if flight.arrival < inf:
                distance = flight.arrival - direction * motion.travel
                if distance <= 0.0:
                    return ARRIVAL, tau
                ahead, root = _look_ahead(distance, -along, -along_1, bound_3, horizon, tau)
                if ahead < step:
                    step = ahead
                    kind = ARRIVAL
                    found = root
            if along <= 0.0:
                if along_1 < 0.0 or (along_1 == 0.0 and along_2 <= 0.0):
                    return REVERSAL, tau
                along = 0.0
            bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
            ahead, root = _look_ahead(along, along_1, along_2, bound_4, horizon, tau)
            if ahead < step:
                step = ahead
                kind = REVERSAL
                found = root
        if found:
            return kind, tau + step
        # A function that touches zero has no safe step; the least one is below round-off.
        tau += max(step, _EPSILON * tau)
        motion = motion_at(flight, tau)
    return NO_EVENT, tau


@kernel
def _first_in_joint(flight: Flight, tau: float, limit: float) -> tuple[int, float]:
    """Step through joint motion until the support gives way; see `first_event`."""
    oscillator = flight.oscillator
    horizon = oscillator.horizon
    while tau <= limit:
        motion: Motion = motion_at(flight, tau)
        bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, oscillator.bound_5)
        need = motion.x_2 - flight.slope
        step = horizon
        kind = NO_EVENT
        found = False
        if flight.support_high < inf:
            left = flight.support_high - need
            if left <= 0.0:
                if motion.x_3 > 0.0:
                    return RELEASE_UP, tau
                left = 0.0
            ahead, root = _look_ahead(left, -motion.x_3, -motion.x_4, bound_5, horizon, tau)
            if ahead < step:
                step = ahead
                kind = RELEASE_UP
                found = root
        if flight.support_low > -inf:
            left = need - flight.support_low
            if left <= 0.0:
                if motion.x_3 < 0.0:
                    return RELEASE_DOWN, tau
                left = 0.0
            ahead, root = _look_ahead(left, motion.x_3, motion.x_4, bound_5, horizon, tau)
            if ahead < step:
                step = ahead
                kind = RELEASE_DOWN
                found = root
        if found:
            return kind, tau + step
        tau += max(step, _EPSILON * (tau + horizon))
    return NO_EVENT, tau


@kernel
def first_event(flight: Flight, node: float, limit: float) -> tuple[int, float]:
    """
    Find the first event of a flight after a node that it is known to pass.

    Parameters
    ----------
    flight : Flight
        The flight, with what it watches.
    node : float
        Time since the flight's origin up to which there is no event: 0, or what an earlier call
        returned with `NO_EVENT`. The nodes do not depend on the limits asked for.
    limit : float
        Stop searching once the node is beyond this time.

    Returns
    -------
    kind : int
        `CONTACT_1`, `CONTACT_2`, `REVERSAL`, `ARRIVAL`, `RELEASE_UP` or `RELEASE_DOWN`; or
        `NO_EVENT`, if there is none up to the returned time.
    tau : float
        The event's time since the origin, or the node reached.
    """
    if flight.joint:
        return _first_in_joint(flight, node, limit)
    return _first_in_motion(flight, node, limit)
