"""
The quick search for a flight's end, along a grid.

Between two nodes of a grid (`grid`) a function and its first derivative are known at both ends,
and its fourth derivative is bounded. So it lies within bound step^4/384 of the Hermite cubic, and
far closer near the nodes, which tells whether m has just left a stop or comes back to it. As long
as that leaves no doubt of what happens between the nodes, the search goes on; where a function
falls to zero for the first time, it does not matter how its root is found. In doubt the search
says so, and certified steps take over (`contact`).
"""

from __future__ import annotations

from math import cos, inf, sin
from typing import NamedTuple

from .event_codes import CONTACT_1, CONTACT_2, NO_EVENT, RELEASE_DOWN, RELEASE_UP, REVERSAL
from .flight import Flight, FlightEnd, Motion, unfinished
from .kernels import elementwise, kernel
from .oscillator import Oscillator, derivative_bound
from .polish import falling_root, polished

__all__ = ['keeps_sign', 'search_contact', 'search_release']

#: What positions, velocities and accelerations at the nodes may be wrong by, as a part of their
#: terms.
_NODE_ERROR = 1e-13


class _Node(NamedTuple):
    """X from its rest, X', X'' and X''' at a node, with the phases of the harmonics."""

    offset: float
    velocity: float
    x_2: float
    x_3: float
    sines: tuple[float, ...]
    cosines: tuple[float, ...]


@elementwise
def _sines_at(sine: float, cosine: float, frequency: float, tau: float) -> float:
    """Return the sine of each harmonic's phase after a time."""
    return sine * cos(frequency * tau) + cosine * sin(frequency * tau)


@elementwise
def _cosines_at(sine: float, cosine: float, frequency: float, tau: float) -> float:
    """Return the cosine of each harmonic's phase after a time."""
    return cosine * cos(frequency * tau) - sine * sin(frequency * tau)


@elementwise
def _next_sines(sine: float, cosine: float, turn_cosine: float, turn_sine: float) -> float:
    """Return the sine of each harmonic's phase a step later."""
    return sine * turn_cosine + cosine * turn_sine


@elementwise
def _next_cosines(sine: float, cosine: float, turn_cosine: float, turn_sine: float) -> float:
    """Return the cosine of each harmonic's phase a step later."""
    return cosine * turn_cosine - sine * turn_sine


@kernel(inline=True)
def _base_node(flight: Flight, tau: float, motion: Motion) -> _Node:
    """Return the node from which the others are reached."""
    sines = flight.sines
    cosines = flight.cosines
    if tau > 0.0:
        frequencies = flight.oscillator.frequencies
        sines = _sines_at(flight.sines, flight.cosines, frequencies, tau)
        cosines = _cosines_at(flight.sines, flight.cosines, frequencies, tau)
    offset = motion.x - flight.constant / flight.oscillator.omega_squared
    return _Node(offset, motion.velocity, motion.x_2, motion.x_3, sines, cosines)


@kernel(inline=True)
def _next_node(oscillator: Oscillator, node: _Node) -> _Node:
    """Return the node a step later."""
    grid = oscillator.grid
    offset = node.offset * grid.x_x + node.velocity * grid.x_v
    velocity = node.offset * grid.v_x + node.velocity * grid.v_v
    for j in range(len(node.sines)):
        sine = node.sines[j]
        cosine = node.cosines[j]
        offset += cosine * grid.x_cosine[j] + sine * grid.x_sine[j]
        velocity += cosine * grid.v_cosine[j] + sine * grid.v_sine[j]
    sines = _next_sines(node.sines, node.cosines, grid.turn_cosine, grid.turn_sine)
    cosines = _next_cosines(node.sines, node.cosines, grid.turn_cosine, grid.turn_sine)
    drive = 0.0
    drive_1 = 0.0
    for j in range(len(sines)):
        drive += oscillator.forces[j] * sines[j]
        drive_1 += oscillator.forces[j] * oscillator.frequencies[j] * cosines[j]
    damping = 2.0 * oscillator.decay
    x_2 = drive - damping * velocity - oscillator.omega_squared * offset
    x_3 = drive_1 - damping * x_2 - oscillator.omega_squared * velocity
    return _Node(offset, velocity, x_2, x_3, sines, cosines)


@kernel(inline=True)
def keeps_sign(
    f_a: float, d_a: float, f_b: float, d_b: float, step: float, bound: float, error: float
) -> bool:
    """
    Return whether a function is certain to be positive between two nodes.

    Parameters
    ----------
    f_a, d_a, f_b, d_b : float
        The function and its first derivative at the nodes; `f_a` may be zero.
    step : float
        Time between the nodes.
    bound : float
        Bound of the fourth derivative's modulus between them.
    error : float
        Bound of the round-off in the values.

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


@kernel
def _turn(
    flight: Flight,
    side: int,
    t_a: float,
    travel_a: float,
    speed_a: float,
    rate_a: float,
    t_b: float,
    speed_b: float,
    rate_b: float,
    bound_5: float,
    error: float,
) -> FlightEnd:
    """
    Return the reversal between two nodes, or the contact that comes before it.

    Parameters
    ----------
    flight : Flight
        The flight.
    side : int
        Direction of the motion, +1 or -1.
    t_a, travel_a, speed_a, rate_a, t_b, speed_b, rate_b : float
        Time, travel, speed and acceleration at the nodes, the latter three in that direction.
    bound_5 : float
        Bound of the fourth derivative of the speed.
    error : float
        Bound of the round-off in the speeds.
    """
    if not (speed_a > error and speed_b < -error):
        return unfinished(NO_EVENT, t_a)
    guess = falling_root(speed_a, rate_a, speed_b, rate_b, t_b - t_a)
    end: FlightEnd = polished(flight, REVERSAL, side, t_a + guess, t_a, t_b)
    if end.kind == NO_EVENT:
        return end
    # Backwards from there the speed only grows from zero: it is the first reversal.
    span = end.tau - t_a
    if not keeps_sign(0.0, -end.slope, speed_a, -rate_a, span, bound_5, error):
        return unfinished(NO_EVENT, t_a)
    clearance = flight.clearance_1 if side > 0 else flight.clearance_2
    left = clearance - side * end.travel
    if left > _NODE_ERROR * (abs(end.x) + abs(flight.x) + abs(end.travel)):
        return end
    if left >= 0.0:
        return unfinished(NO_EVENT, t_a)
    guess = falling_root(clearance - travel_a, -speed_a, left, 0.0, span)
    kind = CONTACT_1 if side > 0 else CONTACT_2
    return polished(flight, kind, side, t_a + guess, t_a, end.tau)


@kernel(inline=True)
def search_contact(flight: Flight, tau: float, motion: Motion) -> FlightEnd:
    """
    Search relative motion along the grid.

    Parameters
    ----------
    flight : Flight
        A flight with relative motion, its stops at rest where they should be.
    tau : float
        Time since the flight's origin up to which there is no event, s.
    motion : Motion
        The motion then.

    Returns
    -------
    FlightEnd
        The first event; or without one the time up to which there is none, which is `tau` if what
        comes then is already in doubt.
    """
    oscillator = flight.oscillator
    step = oscillator.grid.step
    rest = flight.constant / oscillator.omega_squared
    # The damper mass alone
    fall = flight.relative_acceleration + flight.acceleration
    launched = flight.relative_velocity + flight.velocity
    bound_4 = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.grid.bound_4)
    bound_5 = derivative_bound(oscillator, motion.x_5, motion.x_6, oscillator.grid.bound_5)
    node = _base_node(flight, tau, motion)
    t_a = tau
    travel_a = motion.travel
    speed_a = motion.relative_velocity
    rate_a = motion.relative_2
    for k in range(oscillator.grid.nodes):
        node = _next_node(oscillator, node)
        t_b = tau + step * (k + 1)
        x_b = rest + node.offset
        travel_b = launched * t_b + 0.5 * fall * t_b * t_b - (x_b - flight.x)
        speed_b = launched + fall * t_b - node.velocity
        rate_b = fall - node.x_2
        error = _NODE_ERROR * (abs(node.velocity) + abs(speed_b) + abs(speed_a))
        side = flight.direction
        if side == 0:
            side = 1 if speed_a > 0.0 or (speed_a == 0.0 and rate_a > 0.0) else -1
        if keeps_sign(
            side * speed_a, side * rate_a, side * speed_b, side * rate_b, step, bound_5, error
        ):
            # m closes in on one stop all the way
            clearance = flight.clearance_1 if side > 0 else flight.clearance_2
            left = clearance - side * travel_b
            if left <= 0.0:
                guess = falling_root(
                    clearance - side * travel_a, -side * speed_a, left, -side * speed_b, step
                )
                kind = CONTACT_1 if side > 0 else CONTACT_2
                return polished(flight, kind, side, t_a + guess, t_a, t_b)
        elif flight.direction != 0:
            return _turn(
                flight,
                side,
                t_a,
                side * travel_a,
                side * speed_a,
                side * rate_a,
                t_b,
                side * speed_b,
                side * rate_b,
                bound_5,
                error,
            )
        else:
            error = _NODE_ERROR * (abs(x_b) + abs(flight.x) + abs(travel_a) + abs(travel_b))
            for side in (1, -1):
                clearance = flight.clearance_1 if side > 0 else flight.clearance_2
                if clearance < inf and not keeps_sign(
                    clearance - side * travel_a,
                    -side * speed_a,
                    clearance - side * travel_b,
                    -side * speed_b,
                    step,
                    bound_4,
                    error,
                ):
                    return unfinished(NO_EVENT, t_a)
        t_a = t_b
        travel_a = travel_b
        speed_a = speed_b
        rate_a = rate_b
    return unfinished(NO_EVENT, t_a)


@kernel
def search_release(flight: Flight, tau: float, motion: Motion) -> FlightEnd:
    """
    Search joint motion along the grid for the support to give way.

    Parameters
    ----------
    flight : Flight
        A flight of both masses as one.
    tau, motion : float, Motion
        As for `search_contact`.

    Returns
    -------
    FlightEnd
        As of `search_contact`.
    """
    oscillator = flight.oscillator
    grid = oscillator.grid
    node = _base_node(flight, tau, motion)
    drive_5 = 0.0
    for j in range(len(node.sines)):
        drive_5 += oscillator.forces[j] * oscillator.frequencies[j] ** 5 * node.cosines[j]
    x_7 = drive_5 - 2.0 * oscillator.decay * motion.x_6 - oscillator.omega_squared * motion.x_5
    bound_6 = derivative_bound(oscillator, motion.x_6, x_7, grid.bound_6)
    t_a = tau
    x_2 = motion.x_2
    x_3 = motion.x_3
    for k in range(grid.nodes):
        node = _next_node(oscillator, node)
        t_b = tau + grid.step * (k + 1)
        error = _NODE_ERROR * (
            oscillator.omega_squared * abs(node.offset)
            + abs(node.velocity * oscillator.decay)
            + abs(node.x_2)
            + abs(flight.constant)
            + abs(flight.slope)
        )
        failing = 0
        for side in (1, -1):
            most = flight.support_high if side > 0 else -flight.support_low
            if most < inf and not keeps_sign(
                most - side * (x_2 - flight.slope),
                -side * x_3,
                most - side * (node.x_2 - flight.slope),
                -side * node.x_3,
                grid.step,
                bound_6,
                error,
            ):
                if failing != 0:
                    return unfinished(NO_EVENT, t_a)
                failing = side
        if failing != 0:
            most = flight.support_high if failing > 0 else -flight.support_low
            left_a = most - failing * (x_2 - flight.slope)
            left_b = most - failing * (node.x_2 - flight.slope)
            if not (left_a > error and left_b < -error):
                return unfinished(NO_EVENT, t_a)
            guess = falling_root(left_a, -failing * x_3, left_b, -failing * node.x_3, grid.step)
            kind = RELEASE_UP if failing > 0 else RELEASE_DOWN
            end: FlightEnd = polished(flight, kind, failing, t_a + guess, t_a, t_b)
            # Backwards from there what is left only grows from zero: it is the first release.
            if end.kind != NO_EVENT and keeps_sign(
                0.0, -end.slope, left_a, failing * x_3, end.tau - t_a, bound_6, error
            ):
                return end
            return unfinished(NO_EVENT, t_a)
        t_a = t_b
        x_2 = node.x_2
        x_3 = node.x_3
    return unfinished(NO_EVENT, t_a)
