"""Origins: the state of the rig at the beginning of a flight, and how one comes from another."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from .flight import Flight, FlightEnd
from .forcing import turned_angles
from .kernels import kernel, record


@record
class Origin(NamedTuple):
    """
    State at the origin of a flight, *after* the event that began it.

    Attributes
    ----------
    time, time_low : float
        The instant, s, as an unevaluated sum: a long run loses no digits.
    mode : int
        The mode that begins.
    x, velocity, relative_velocity : float
        X, X' and Y'.
    clearance_1, clearance_2 : float
        Distance of m from each stop, m; infinite for a stop that is not there.
    stop_1, stop_2 : float
        Position Y of each stop, m; beyond its target where m holds back a stop that is to
        close.
    angles : tuple of float
        Angle turned by each harmonic since it was switched on, without its phase, mod 2 pi.
    last_stop : int
        Stop hit last, 0 before the first impact; the air force points away from it.
    released : bool
        The support has just given way: the relative acceleration is exactly zero.
    chatter_left : float
        Time until a chatter accumulates, s; 0 in other modes.
    target_1, target_2 : float
        Position Y at which each stop is to be, m.
    stop_velocity_1, stop_velocity_2 : float
        Velocity relative to M of each stop that moves to its target, m/s. A stop at rest away
        from its target follows m inwards.
    side : int
        Sign of X just after the instant, +1 or -1, where X is zero to round-off; else 0.
    """

    time: float
    time_low: float
    mode: int
    x: float
    velocity: float
    relative_velocity: float
    clearance_1: float
    clearance_2: float
    stop_1: float
    stop_2: float
    angles: tuple[float, ...]
    last_stop: int
    released: bool
    chatter_left: float
    target_1: float
    target_2: float
    stop_velocity_1: float = 0.0
    stop_velocity_2: float = 0.0
    side: int = 0


@kernel(inline=True)
def advance_time(time: float, time_low: float, tau: float) -> tuple[float, float]:
    """Add a duration to an instant held as an unevaluated sum."""
    total = time + tau
    back = total - time
    low = time_low + ((time - (total - back)) + (tau - back))
    rounded = total + low
    return rounded, low - (rounded - total)


@kernel(inline=True)
def offset_of(clearance_1: float, clearance_2: float, stop_1: float, stop_2: float) -> float:
    """Return Y from the clearances and positions of the stops, by the nearer one, m."""
    return stop_1 - clearance_1 if clearance_1 <= clearance_2 else stop_2 + clearance_2


@kernel(inline=True)
def placed(
    origin: Origin, flight: Flight, tau: float, travel: float
) -> tuple[float, float, float, float]:
    """Return clearances and stops after a time and a displacement of m relative to M."""
    clearance_1 = origin.clearance_1
    clearance_2 = origin.clearance_2
    stop_1 = origin.stop_1
    stop_2 = origin.stop_2
    if flight.deadline < inf:
        # The velocity of a standing stop is zero.
        stop_1 += origin.stop_velocity_1 * tau
        clearance_1 += origin.stop_velocity_1 * tau
        stop_2 += origin.stop_velocity_2 * tau
        clearance_2 -= origin.stop_velocity_2 * tau
    if not flight.joint:
        if flight.arrival < inf and flight.direction < 0:
            stop_1 += travel
            clearance_2 += travel
        elif flight.arrival < inf:
            stop_2 += travel
            clearance_1 -= travel
        else:
            clearance_1 -= travel
            clearance_2 += travel
    return max(0.0, clearance_1), max(0.0, clearance_2), stop_1, stop_2


@kernel(inline=True)
def stop_rates(origin: Origin, flight: Flight, relative_velocity: float) -> tuple[float, float]:
    """Return how fast the stops move in M during a flight."""
    stop_rate_1 = origin.stop_velocity_1
    stop_rate_2 = origin.stop_velocity_2
    if not flight.joint and flight.arrival < inf:
        if flight.direction < 0:
            stop_rate_1 = relative_velocity
        else:
            stop_rate_2 = relative_velocity
    return stop_rate_1, stop_rate_2


@kernel(inline=True)
def carried(origin: Origin, flight: Flight, end: FlightEnd) -> Origin:
    """Return the state that a flight reaches, as the origin of another one."""
    tau = end.tau
    time, time_low = advance_time(origin.time, origin.time_low, tau)
    angles = turned_angles(origin.angles, flight.oscillator.harmonics, tau)
    clearance_1, clearance_2, stop_1, stop_2 = placed(origin, flight, tau, end.travel)
    speed = 0.0 if flight.joint else end.relative_velocity
    return Origin(
        time,
        time_low,
        origin.mode,
        end.x,
        end.velocity,
        speed,
        clearance_1,
        clearance_2,
        stop_1,
        stop_2,
        angles,
        origin.last_stop,
        origin.released and tau == 0.0,
        max(0.0, origin.chatter_left - tau),
        origin.target_1,
        origin.target_2,
        origin.stop_velocity_1,
        origin.stop_velocity_2,
        0,
    )


@kernel(inline=True)
def on_stop(one_sided: bool, origin: Origin, stop: int, stop_1: float, stop_2: float) -> Origin:
    """Return an origin with m exactly on a stop, and the stops placed."""
    across = inf if one_sided else max(0.0, stop_1 - stop_2)
    return origin._replace(
        clearance_1=0.0 if stop == 1 else across,
        clearance_2=across if stop == 1 else 0.0,
        stop_1=stop_1,
        stop_2=stop_2,
        released=False,
        chatter_left=0.0,
    )


@kernel
def locked(one_sided: bool, origin: Origin, stop: int) -> Origin:
    """Return the state after a moving stop has met m and stays there."""
    stop_1 = origin.stop_1
    stop_2 = origin.stop_2
    target_1 = origin.target_1
    target_2 = origin.target_2
    if stop == 1:
        # The stops never cross; with m on both there is no room between them.
        if origin.clearance_2 == 0.0 or (not one_sided and stop_1 < stop_2):
            stop_1 = stop_2
        target_1 = stop_1
    else:
        if origin.clearance_1 == 0.0 or stop_2 > stop_1:
            stop_2 = stop_1
        target_2 = stop_2
    there = origin._replace(
        target_1=target_1,
        target_2=target_2,
        stop_velocity_1=0.0 if stop == 1 else origin.stop_velocity_1,
        stop_velocity_2=0.0 if stop == 2 else origin.stop_velocity_2,
    )
    there = on_stop(one_sided, there, stop, stop_1, stop_2)
    return there._replace(chatter_left=origin.chatter_left)
