"""Turning points of a flight: every root of X' or Y', certified as the simulator's events are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from impact_damper_ros.rig.certificate import safe_step
from impact_damper_ros.rig.flight import Flight, Motion, motion_at
from impact_damper_ros.rig.oscillator import derivative_bound

__all__ = ['Extremes', 'relative_extremes', 'swing_extremes']

_TIME_TOLERANCE = 1e-13


class Extremes(NamedTuple):
    """
    Least and largest value of a displacement in a flight, and when.

    Displacements in m, times since the flight's origin in s.
    """

    low: float
    low_time: float
    high: float
    high_time: float


def _rates(motion: Motion, relative: bool) -> tuple[float, float, float]:
    """Return the first three derivatives of Y or X."""
    if relative:
        return motion.relative_velocity, motion.relative_2, -motion.x_3
    return motion.velocity, motion.x_2, motion.x_3


def _turning_times(flight: Flight, duration: float, relative: bool) -> Iterator[float]:
    """
    Yield the times at which the velocity is zero, in order.

    From node to node the velocity keeps its sign: its third derivative is bounded, and
    `safe_step` tells how far that is certain.
    """
    oscillator = flight.oscillator
    least = _TIME_TOLERANCE * duration
    tau, sign = 0.0, 0.0
    while tau < duration:
        motion = motion_at(flight, tau)
        rates = _rates(motion, relative)
        bound = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
        if sign == 0.0:
            leading = next((rate for rate in rates if rate != 0.0), 0.0)
            if leading == 0.0:
                return
            sign = 1.0 if leading > 0.0 else -1.0
        speed = max(sign * rates[0], 0.0)
        step = safe_step(speed, sign * rates[1], sign * rates[2], bound, oscillator.horizon)
        if step <= least:
            yield tau
            # Beyond the root; a velocity that only touches zero keeps its sign.
            tau += least
            beyond = _rates(motion_at(flight, tau), relative)
            sign = 0.0
            if abs(beyond[0]) <= abs(rates[1]) * least:
                sign = -1.0 if rates[1] < 0.0 else 1.0
            continue
        tau += step


def _extremes(flight: Flight, duration: float, relative: bool) -> Extremes:
    points = [0.0, duration, *_turning_times(flight, duration, relative)]
    motions = [(motion_at(flight, tau), tau) for tau in points]
    values = [(m.travel if relative else m.x, tau) for m, tau in motions]
    (low, low_time), (high, high_time) = min(values), max(values)
    return Extremes(low, low_time, high, high_time)


def swing_extremes(flight: Flight, duration: float) -> Extremes:
    """
    Return the least and largest X of a flight.

    Parameters
    ----------
    flight : Flight
        The flight.
    duration : float
        How long it lasts, s.
    """
    return _extremes(flight, duration, relative=False)


def relative_extremes(flight: Flight, duration: float) -> Extremes:
    """
    Return the least and largest Y - Y(origin) of a flight.

    Parameters
    ----------
    flight : Flight
        The flight, not joint.
    duration : float
        How long it lasts, s.
    """
    return _extremes(flight, duration, relative=True)
