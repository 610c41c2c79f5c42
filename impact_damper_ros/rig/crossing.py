"""
Certified passages of X through zero; watching for them does not change the motion.

The search goes along the grid of the contacts, and by certified steps (`certificate`) where X may
touch zero, so that it cannot miss a passage. That counts once X is on the other side by more than
its round-off; a touch of zero does not. The passages of a flight are counted from its
origin, so that they do not depend on how a run is cut into pieces. A flight that begins where X is
zero to round-off takes over the side of X from the flight before (`Origin.side`).
"""

from __future__ import annotations

from math import inf, nan, nextafter

from .certificate import ROUND_OFF, keeps_sign, least_step, safe_step
from .flight import Flight, GridPoint, Motion, Series, motion_at, series_at, tail
from .kernels import kernel
from .origin import Origin, advance_time
from .oscillator import Oscillator, derivative_bound
from .roots import GRID_ERROR, SERIES_REACH, acceleration_of, base_point, falling_root, next_point

_EPSILON = 2.220446049250313e-16
# Where X is smaller than this part of its scale, its side comes from the flight before.
_NEAR_ZERO = 1e-9
# A search goes beyond its limit while X is zero to round-off, by at most this part of the
# horizon.
_OVERTIME = 1e-3
# A step of Newton's method from where X is zero to round-off, at most, in horizons
_NEAREST = 1e-9
# Below this length, m, X is zero: steps need its squares, and no float is as small as those.
_NO_LENGTH = 1e-120


@kernel
def starting_side(flight: Flight, side: int) -> int:
    """Return the sign of X just after a flight's origin: as given, or if that is 0 from X."""
    if side != 0:
        return side
    motion: Motion = motion_at(flight, 0.0)
    leading = motion.x
    for derivative in (motion.velocity, motion.x_2, motion.x_3, motion.x_4, motion.x_5):
        if leading != 0.0:
            break
        leading = derivative
    return -1 if leading < 0.0 else 1


@kernel
def _root_of_x(
    flight: Flight, side: int, low: float, high: float, guess: float, band: float
) -> float:
    """Return the root of X between two times, where `side` X becomes negative."""
    tau = guess
    nearest = _NEAREST * flight.oscillator.horizon
    for _ in range(200):
        motion: Motion = motion_at(flight, tau)
        if side * motion.x > 0.0:
            low = tau
        else:
            high = tau
        following = 0.5 * (low + high)
        if motion.velocity != 0.0:
            newton = tau - motion.x / motion.velocity
            if abs(motion.x) <= band and abs(newton - tau) <= nearest:
                # X is zero to round-off: no step after this one comes nearer.
                return max(newton, 0.0)
            if low < newton < high:
                following = newton
        if abs(following - tau) <= 0.5 * _EPSILON * tau or high - low <= _EPSILON * high:
            break
        tau = following
    return high if tau > high else tau


@kernel(inline=True)
def _round_off(flight: Flight, motion: Motion) -> float:
    """Return the round-off of X, by what X is the sum of."""
    oscillator: Oscillator = flight.oscillator
    scale = (
        abs(motion.velocity) * oscillator.horizon
        + (abs(motion.x_2) + abs(flight.constant)) / oscillator.omega_squared
    )
    return ROUND_OFF * (abs(motion.x) + scale) + _NO_LENGTH


@kernel
def _past(flight: Flight, side: int, height: float, motion: Motion, tau: float) -> float:
    """Return the time after a certified step, during which `side` X stays positive."""
    oscillator: Oscillator = flight.oscillator
    horizon = oscillator.horizon
    bound = derivative_bound(oscillator, motion.x_3, motion.x_4, oscillator.bound_3)
    step = safe_step(height, side * motion.velocity, side * motion.x_2, bound, horizon)
    return tau + max(step, least_step(horizon), _EPSILON * tau)


_NEWTON_STEPS = 6
#: The step of Newton's method after one this long, in steps of the grid, is less than round-off.
_LAST_CHANGE = 1e-9


@kernel
def _root_between(
    flight: Flight, side: int, point: GridPoint, at: float, guess: float, low: float, high: float
) -> float:
    """Return the root of X between two points of the grid by the series about one; or NaN."""
    grid = flight.oscillator.grid
    series: Series = series_at(flight.oscillator, point)
    height = side * (flight.constant / flight.oscillator.omega_squared + point.offset)
    rate = side * point.velocity * grid.step
    s = guess
    for _ in range(_NEWTON_STEPS):
        if not abs(s) <= SERIES_REACH:
            break
        bend, bend_1, _ = tail(series, s)
        falling = rate + side * (s * series.x_2 + bend_1)
        if not falling < 0.0:
            break
        change = -(height + (s * (rate + 0.5 * s * side * series.x_2) + side * bend)) / falling
        s += change
        if abs(change) <= _LAST_CHANGE * min(1.0, at * grid.inverse + s):
            tau = at + s * grid.step
            return tau if low < tau <= high else nan
    return nan


@kernel
def _along_grid(flight: Flight, side: int, tau: float, motion: Motion) -> tuple[float, float]:
    """
    Look for a passage along the grid.

    Returns the passage, or NaN if none was found, and the time up to which the search is complete;
    the given time, if X may touch zero in the first step.
    """
    oscillator: Oscillator = flight.oscillator
    grid = oscillator.grid
    step = grid.step
    rest = flight.constant / oscillator.omega_squared
    bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, grid.bound_4)
    bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, grid.bound_5)
    point: GridPoint = base_point(flight, tau, motion)
    height = side * motion.x
    rate = side * motion.velocity
    scale = abs(motion.x) + abs(motion.velocity) * step
    for k in range(grid.points):
        following: GridPoint = next_point(oscillator, point)
        height_b = side * (rest + following.offset)
        rate_b = side * following.velocity
        scale = max(scale, abs(height_b) + abs(rate_b) * step)
        error = GRID_ERROR * (scale + abs(rest))
        low = tau + step * k
        high = tau + step * (k + 1)
        if height_b > 0.0:
            if not keeps_sign(height, rate, height_b, rate_b, step, bound_4, error):
                return nan, low
        elif (
            height > error
            and height_b < -error
            and keeps_sign(
                -rate,
                -side * acceleration_of(oscillator, point),
                -rate_b,
                -side * acceleration_of(oscillator, following),
                step,
                bound_5,
                error * grid.inverse,
            )
        ):
            guess = falling_root(height, rate, height_b, rate_b, step) * grid.inverse
            if guess > 0.5:
                root = _root_between(flight, side, following, high, guess - 1.0, low, high)
            else:
                root = _root_between(flight, side, point, low, guess, low, high)
            return root, low if root != root else high
        else:
            return nan, low
        point = following
        height = height_b
        rate = rate_b
    return nan, tau + step * grid.points


@kernel
def first_crossing(
    flight: Flight, side: int, searched: float, limit: float
) -> tuple[bool, float, float]:
    """
    Find the first passage of X through zero after a time searched.

    The search goes along a grid; where X may touch zero, by certified steps. What it finds does
    not depend on the limit: the grid is searched as far as it goes.
    """
    oscillator: Oscillator = flight.oscillator
    horizon = oscillator.horizon
    above = searched
    tau = searched
    # A flight that begins at a passage may have its rest before it, by the round-off of its time.
    arriving = searched == 0.0
    while True:
        motion: Motion = motion_at(flight, tau)
        band = _round_off(flight, motion)
        height = side * motion.x
        if height < -band:
            rate = side * motion.velocity
            if not arriving or rate <= 0.0:
                return True, _root_of_x(flight, side, above, tau, tau, band), tau
            if tau > limit + _OVERTIME * horizon:
                return False, tau, tau
            tau = _past(flight, -side, -height, motion, tau)
            continue
        arriving = False
        if height > band:
            above = tau
            if tau > limit:
                return False, tau, tau
        elif tau > limit + _OVERTIME * horizon:
            return False, tau, tau
        root, reached = _along_grid(flight, side, tau, motion)
        if root == root:
            return True, root, reached
        if reached > tau:
            tau = reached
        else:
            tau = _past(flight, side, max(0.0, height + band), motion, tau)


@kernel
def _stands_at_zero(flight: Flight) -> bool:
    """Return whether M stands still at X = 0 and nothing moves it."""
    still = flight.x == 0.0 and flight.velocity == 0.0 and flight.constant == 0.0
    for j in range(len(flight.sines)):
        still = still and flight.oscillator.harmonics[j].force == 0.0
    return still


@kernel
def _side_at(origin: Origin, flight: Flight, instant: float) -> int:
    """Return the sign of X just after an instant of a flight; as `next_crossing` counts."""
    side = starting_side(flight, origin.side)
    if instant <= origin.time or _stands_at_zero(flight):
        return side
    # At least one float more than the instant
    limit = (instant - origin.time) - origin.time_low + 2.0 * _EPSILON * abs(instant)
    searched = 0.0
    while searched <= limit + _OVERTIME * flight.oscillator.horizon:
        found, tau, searched = first_crossing(flight, side, searched, limit)
        if not found or advance_time(origin.time, origin.time_low, tau)[0] > instant:
            break
        side = -side
    return side


@kernel(inline=True)
def has_side(oscillator: Oscillator, origin: Origin) -> bool:
    """Return whether X is large enough to have a side of its own."""
    scale = abs(origin.velocity) * oscillator.horizon
    for j in range(len(origin.angles)):
        scale += abs(oscillator.harmonics[j].force) / oscillator.omega_squared
    return abs(origin.x) > _NEAR_ZERO * scale


@kernel
def sided(oscillator: Oscillator, before: Origin, flight: Flight, origin: Origin) -> Origin:
    """Return the origin of the next flight, with the side of X if X is zero to round-off."""
    if has_side(oscillator, origin):
        return origin
    return origin._replace(side=_side_at(before, flight, origin.time))


@kernel
def next_crossing(
    origin: Origin,
    flight: Flight,
    side: int,
    searched: float,
    crossing: float,
    now: float,
    until: float,
    most: float,
) -> tuple[bool, int, float, float]:
    """
    Look for the next passage of a flight after one instant, up to another.

    Neither instant may be earlier than at the call before.

    Parameters
    ----------
    origin, flight : Origin, Flight
        The flight.
    side, searched, crossing : int, float, float
        What the call before returned; 0, 0 and infinity at the first one.
    now, until : float
        The two instants, s.
    most : float
        Most time to search at once, in horizons.

    Returns
    -------
    decided : bool
        Whether the search has come to its end.
    side : int
        Sign of X before the next passage.
    searched : float
        Time since the origin that has been searched, s.
    crossing : float
        Instant of the next passage, s, if it has been found; else infinity.
    """
    horizon = flight.oscillator.horizon
    if side == 0:
        side = starting_side(flight, origin.side)
    while True:
        if crossing == inf:
            limit = (nextafter(until, inf) - origin.time) - origin.time_low
            if searched > limit + _OVERTIME * horizon:
                return True, side, searched, crossing
            ahead = min(limit, searched + most * horizon)
            found, tau, searched = first_crossing(flight, side, searched, ahead)
            if not found:
                return ahead == limit, side, searched, crossing
            instant = advance_time(origin.time, origin.time_low, tau)[0]
            # A passage at the origin belongs to this flight and comes after it.
            crossing = max(nextafter(origin.time, inf), instant)
        if crossing > until or crossing > now:
            return True, side, searched, crossing
        side = -side
        crossing = inf
