"""
Certified passages of X through zero; watching for them does not change the motion.

Certified steps (`certificate`) cannot miss a passage. It counts once X is on the other side by
more than its round-off; a touch of zero does not. The passages of a flight are counted from its
origin, so that they do not depend on how a run is cut into pieces. A flight that begins where X is
zero to round-off takes over the side of X from the flight before (`Origin.side`).
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nextafter

from .certificate import ROUND_OFF, least_step, safe_step
from .flight import Flight, Motion, motion_at
from .kernels import kernel
from .origin import Origin, advance_time
from .oscillator import Oscillator, derivative_bound

_EPSILON = 2.220446049250313e-16
# Where X is smaller than this part of its scale, its side comes from the flight before.
_NEAR_ZERO = 1e-9
# A search goes beyond its limit while X is zero to round-off, by at most this part of the
# horizon.
_OVERTIME = 1e-3
#: Time that is searched between two calls of `interrupted`, in horizons.
_STRETCH = 16.0


class SearchInterruptedError(Exception):
    """A search was interrupted; the next call continues it."""


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
def _root_of_x(flight: Flight, side: int, low: float, high: float) -> float:
    """Return the root of X between two times, where `side` X becomes negative."""
    tau = high
    for _ in range(200):
        motion: Motion = motion_at(flight, tau)
        if side * motion.x > 0.0:
            low = tau
        else:
            high = tau
        following = 0.5 * (low + high)
        if motion.velocity != 0.0:
            newton = tau - motion.x / motion.velocity
            if low < newton < high:
                following = newton
        if abs(following - tau) <= 0.5 * _EPSILON * tau or high - low <= _EPSILON * high:
            break
        tau = following
    return high if tau > high else tau


@kernel
def first_crossing(
    flight: Flight, side: int, searched: float, limit: float
) -> tuple[bool, float, float]:
    """Find the first passage of X through zero after a time searched."""
    oscillator: Oscillator = flight.oscillator
    horizon = oscillator.horizon
    above = searched
    tau = searched
    # A flight that begins at a passage may have its rest before it, by the round-off of its time.
    arriving = searched == 0.0
    while True:
        motion: Motion = motion_at(flight, tau)
        height = side * motion.x
        # What X is the sum of, and with it its round-off
        scale = (
            abs(motion.velocity) * horizon
            + (abs(motion.x_2) + abs(flight.constant)) / oscillator.omega_squared
        )
        band = ROUND_OFF * (abs(motion.x) + scale)
        bound_3 = derivative_bound(oscillator, motion.x_3, motion.x_4, oscillator.bound_3)
        if height < -band:
            rate = side * motion.velocity
            if not arriving or rate <= 0.0:
                return True, _root_of_x(flight, side, above, tau), tau
            step = safe_step(-height, -rate, -side * motion.x_2, bound_3, horizon)
            tau += max(step, least_step(horizon), _EPSILON * tau)
            continue
        arriving = False
        if height > band:
            above = tau
            if tau > limit:
                return False, tau, tau
        elif tau > limit + _OVERTIME * horizon:
            return False, tau, tau
        step = safe_step(
            max(0.0, height + band),
            side * motion.velocity,
            side * motion.x_2,
            bound_3,
            horizon,
        )
        tau += max(step, least_step(horizon), _EPSILON * tau)


@kernel
def _stands_at_zero(flight: Flight) -> bool:
    """Return whether M stands still at X = 0 and nothing moves it."""
    still = flight.x == 0.0 and flight.velocity == 0.0 and flight.constant == 0.0
    for j in range(len(flight.oscillator.forces)):
        still = still and flight.oscillator.forces[j] == 0.0
    return still


@kernel
def _side_at(origin: Origin, flight: Flight, instant: float) -> int:
    """Return the sign of X just after an instant of a flight; as `CrossingWatch` counts."""
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
    for j in range(len(oscillator.forces)):
        scale += abs(oscillator.forces[j]) / oscillator.omega_squared
    return abs(origin.x) > _NEAR_ZERO * scale


@kernel
def sided(oscillator: Oscillator, before: Origin, flight: Flight, origin: Origin) -> Origin:
    """Return the origin of the next flight, with the side of X if X is zero to round-off."""
    if has_side(oscillator, origin):
        return origin
    return origin._replace(side=_side_at(before, flight, origin.time))


class CrossingWatch:
    """The passages of one flight through X = 0, in order."""

    def __init__(self, origin: Origin, flight: Flight) -> None:
        """Begin at the origin."""
        self._origin = origin
        self._flight = flight
        self._side = starting_side(flight, origin.side)
        self._searched = 0.0
        # A passage at the origin belongs to this flight and comes after it.
        self._earliest = nextafter(origin.time, inf)
        self._next: float | None = None

    def _seek(self, until: float, interrupted: Callable[[], bool] | None) -> None:
        """Look for the next passage, if none is known, up to an instant at least."""
        if self._next is not None:
            return
        origin = self._origin
        limit = (nextafter(until, inf) - origin.time) - origin.time_low
        horizon = self._flight.oscillator.horizon
        if self._searched > limit + _OVERTIME * horizon:
            return
        while True:
            ahead = limit
            if interrupted is not None:
                ahead = min(limit, self._searched + _STRETCH * horizon)
            found, tau, self._searched = first_crossing(
                self._flight, self._side, self._searched, ahead
            )
            if found or ahead == limit:
                break
            if interrupted is not None and interrupted():
                raise SearchInterruptedError
        if found:
            instant = advance_time(origin.time, origin.time_low, tau)[0]
            self._next = max(self._earliest, instant)

    def after(
        self, now: float, until: float, interrupted: Callable[[], bool] | None = None
    ) -> float | None:
        """
        Return the first passage after one instant and not after another.

        Neither instant may be earlier than at the call before.
        """
        while True:
            self._seek(until, interrupted)
            if self._next is None or self._next > until:
                return None
            if self._next > now:
                return self._next
            self._side, self._next = -self._side, None
            if interrupted is not None and interrupted():
                raise SearchInterruptedError
