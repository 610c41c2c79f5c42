"""
Whether a log obeys the equations of motion of the rig that it names.

The formulas are those of `rig.flight`, vectorised: the response to a harmonic from rest is the
divided difference of exp over the eigenvalues and i W, so that nothing cancels at resonance.

Every joint state and every impact is a knot. From each knot the closed form of the logged rig
leads to the next one; what is recorded there must agree, up to the nanosecond to which the stamps
of impacts are rounded. So a wrong number shows where it stands, in any motion whatsoever, and does
not disturb what comes after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, Rows
from .run_curves import Array

__all__ = [
    'Flights',
    'FreeMotion',
    'Intervals',
    'Knots',
    'check_intervals',
    'knots_of',
    'largest_size',
]


_Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Flights:
    """
    States at the beginning of flights, one per row, and how long these last.

    Attributes
    ----------
    time, duration : ndarray of shape (n,)
        Beginning, rig time, and length, s.
    x, velocity, z, damper_velocity : ndarray of shape (n,)
        X, X', Z and Z' at the beginning, m and m/s.
    direction : ndarray of shape (n,)
        How m slides relative to M, +1 or -1; 0 without friction.
    air : ndarray of shape (n,)
        Direction of the air force on m, +1, -1 or 0.
    joint : ndarray of bool, shape (n,)
        Whether M and m move as one.
    """

    time: Array
    duration: Array
    x: Array
    velocity: Array
    z: Array
    damper_velocity: Array
    direction: Array
    air: Array
    joint: NDArray[np.bool_]


class FreeMotion:
    """
    The motion between two events, for many flights at once.

    Parameters
    ----------
    clock : ForceClock
        The force, and the rig.
    """

    def __init__(self, clock: ForceClock) -> None:
        self._clock = clock

    def ends(self, flights: Flights) -> tuple[Array, Array, Array, Array]:
        """Return X, X', Z and Z' at the end of each flight."""
        rig = self._clock.parameters
        x = np.empty_like(flights.x)
        velocity = np.empty_like(x)
        for joint in (False, True):
            rows = flights.joint == joint
            if rows.any():
                x[rows], velocity[rows] = self._primary(rig, flights, rows, joint)
        tau = flights.duration
        slope = rig.gravity * math.sin(rig.angle)
        grip = rig.friction * rig.gravity * math.cos(rig.angle)
        push = rig.air_force / rig.damper_mass
        acceleration = slope - grip * flights.direction + push * flights.air
        damper_velocity = flights.damper_velocity + acceleration * tau
        z = flights.z + tau * (flights.damper_velocity + 0.5 * acceleration * tau)
        z = np.where(flights.joint, flights.z + (x - flights.x), z)
        damper_velocity = np.where(flights.joint, velocity, damper_velocity)
        return x, velocity, z, damper_velocity

    def _primary(
        self, rig: RigParameters, flights: Flights, rows: NDArray[np.bool_], joint: bool
    ) -> tuple[Array, Array]:
        """Return X and X' of M, alone or with m, at the end of some flights."""
        mass = rig.primary_mass + (rig.damper_mass if joint else 0.0)
        tau = flights.duration[rows]
        if joint:
            constant: Array | float = (
                rig.damper_mass * rig.gravity * math.sin(rig.angle) / rig.stiffness
            )
        else:
            grip = rig.damper_mass * rig.friction * rig.gravity * math.cos(rig.angle)
            support = grip * flights.direction[rows] - rig.air_force * flights.air[rows]
            constant = support / rig.stiffness
        decay = 0.5 * rig.damping / mass
        frequency = math.sqrt(rig.stiffness / mass - decay * decay)
        root = complex(-decay, frequency)
        free: _Complex = np.exp(root * tau)
        impulse = free.imag / frequency
        step = free.real + decay * impulse
        rate = free.real - decay * impulse
        x, velocity = flights.x[rows] - constant, flights.velocity[rows]
        end = constant + x * step + velocity * impulse
        end_velocity = velocity * rate - rig.stiffness / mass * x * impulse
        angles = self._clock.angles_at(flights.time[rows])
        amplitudes, frequencies, _ = rig.harmonics
        for j, (force, drive) in enumerate(zip(amplitudes, frequencies, strict=True)):
            if force == 0.0:
                continue
            response, response_rate = _from_rest(root, free, tau, drive)
            turned = force / mass * np.exp(1j * angles[j])
            end = end + (turned * response).imag
            end_velocity = end_velocity + (turned * response_rate).imag
        return end, end_velocity


def _from_rest(
    root: complex, free: _Complex, tau: Array, drive: float
) -> tuple[_Complex, _Complex]:
    """Return the response from rest to exp(i W tau), and its rate."""
    beat = 1j * drive - root
    if abs(beat) * float(tau.max(initial=0.0)) > 0.0:
        first = free * np.expm1(beat * tau) / beat
    else:
        first = free * tau
    other = root.conjugate()
    second = free.conj() * np.expm1((1j * drive - other) * tau) / (1j * drive - other)
    response = (first - second) / (root - other)
    rate = (root * first - other * second) / (root - other)
    return response, rate


_STAMP_S = 0.5e-9
_MARGIN = 4.0
_ROUND_OFF = 1e-11
_TIME_EPSILON = 4.5e-16
_AT_STOP = 1e-9
_BEYOND = 1e3


@dataclass(frozen=True)
class Knots(Rows):
    """
    Joint states and impacts in the order of time.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Rig time, s.
    stop : ndarray of shape (n,)
        The stop hit, 1 or 2; 0 for joint states.
    last_stop : ndarray of shape (n,)
        The stop hit last, this impact included; 0 before the first one.
    x, z : ndarray of shape (n,)
        X and Z, m.
    velocity_before, velocity : ndarray of shape (n,)
        X' just before and just after, m/s; the same for joint states.
    damper_velocity_before, damper_velocity : ndarray of shape (n,)
        Z' just before and just after, m/s.
    touched : ndarray of shape (n,)
        1 where a stop that follows m may be at it, as far as is recorded; 0 elsewhere.
    """

    time: Array
    stop: Array
    last_stop: Array
    x: Array
    z: Array
    velocity_before: Array
    velocity: Array
    damper_velocity_before: Array
    damper_velocity: Array
    touched: Array


@dataclass(frozen=True)
class Intervals:
    """
    From each knot to the next.

    Attributes
    ----------
    residuals : ndarray of shape (n - 1, 4)
        Recorded less expected X, X', Z, Z' just before the next knot, m and m/s.
    tolerances : ndarray of shape (4,)
        What the rounding of a stamp makes of them.
    plain : ndarray of bool, shape (n - 1,)
        Whether the interval could be checked so: no reversal, beginning or end of rest in it.
    sound : ndarray of bool, shape (n - 1,)
        Whether it could be, and agrees.
    """

    residuals: Array
    tolerances: Array
    plain: NDArray[np.bool_]
    sound: NDArray[np.bool_]


def knots_of(
    parameters: RigParameters, states: RecordedStates, impacts: RecordedImpacts, last_stop: int
) -> Knots:
    """Put joint states and impacts in order."""
    zeros = np.zeros(len(states))
    columns = [
        (states.time, impacts.time),
        (zeros, impacts.stop),
        (states.x, impacts.x),
        (states.z, impacts.z),
        (states.velocity, impacts.velocity_before(parameters)),
        (states.velocity, impacts.velocity_after),
        (states.damper_velocity, impacts.damper_velocity_before(parameters)),
        (states.damper_velocity, impacts.damper_velocity_after),
        _touched(states, impacts),
    ]
    time, stop, *others = (np.concatenate(pair) for pair in columns)
    # A joint state shows the motion after an impact at the same instant.
    order = np.lexsort((stop == 0.0, time))
    stop = stop[order]
    latest = np.maximum.accumulate(np.where(stop > 0.0, np.arange(len(stop)), -1))
    last = np.where(latest >= 0, stop[latest], float(last_stop))
    return Knots(time[order], stop, last, *(column[order] for column in others))


def _touched(states: RecordedStates, impacts: RecordedImpacts) -> tuple[Array, Array]:
    """Return 1 for joint states and impacts at which a stop may be where m is, else 0."""
    with np.errstate(over='ignore', invalid='ignore'):
        near = [
            np.abs(stop - states.z) <= _AT_STOP * (np.abs(stop) + np.abs(states.z))
            for stop in (states.stop_1, states.stop_2)
        ]
        touched = near[0] | near[1]
        # A stop that follows m comes inwards from where the joint states show it first.
        farthest = np.abs((states.z - states.x)[touched]).max(initial=0.0)
        within = np.abs(impacts.z - impacts.x) <= (1.0 + _AT_STOP) * farthest
    return touched.astype(float), within.astype(float)


def _flights(parameters: RigParameters, knots: Knots) -> tuple[Flights, NDArray[np.bool_]]:
    """Return the flights between the knots, and which of them are plain."""
    begin, end = knots[:-1], knots[1:]
    relative = begin.damper_velocity - begin.velocity
    later = end.damper_velocity_before - end.velocity_before
    rest, later_rest = relative == 0.0, later == 0.0
    plain = rest == later_rest
    direction = np.zeros(len(relative))
    if parameters.friction * parameters.gravity > 0.0:
        plain &= relative * later >= 0.0
        direction = np.sign(relative)
    air = np.zeros(len(relative))
    if parameters.air_force > 0.0:
        air = np.where(begin.last_stop == 1.0, -1.0, np.where(begin.last_stop == 2.0, 1.0, 0.0))
    flights = Flights(
        time=begin.time,
        duration=end.time - begin.time,
        x=begin.x,
        velocity=begin.velocity,
        z=begin.z,
        damper_velocity=begin.damper_velocity,
        direction=direction,
        air=air,
        joint=rest & later_rest,
    )
    return flights, plain


def largest_size(*columns: Array) -> float:
    """
    Return the largest modulus in some columns, 0 of none.

    A number a thousand times beyond nine tenths of the others is taken for a wrong one, which must
    not decide how well the others are known.
    """
    sizes = np.abs(np.concatenate(columns))
    sizes = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(sizes):
        return 0.0
    most = float(np.quantile(sizes, 0.9, method='lower'))
    return float(sizes[sizes <= _BEYOND * most].max())


def tolerances_of(parameters: RigParameters, knots: Knots) -> Array:
    """Return what the rounding of stamps, and of numbers, makes of X, X', Z and Z'."""
    length = largest_size(knots.x, knots.z)
    speed = largest_size(knots.velocity, knots.damper_velocity)
    force = sum(abs(amplitude) for amplitude in parameters.harmonics[0])
    length += force / parameters.stiffness
    # It has been taken off the positions, to their last digit.
    length += 1e-4 * abs(parameters.static_deflection)
    own = parameters.gravity + parameters.air_force / parameters.damper_mass
    push = force + parameters.stiffness * length + parameters.damping * speed
    acceleration = (push + parameters.damper_mass * own) / parameters.primary_mass
    stamp = 2.0 * _STAMP_S + _TIME_EPSILON * float(np.abs(knots.time).max(initial=0.0))
    return _MARGIN * np.array(
        [
            stamp * speed + _ROUND_OFF * length,
            stamp * acceleration + _ROUND_OFF * speed,
            stamp * speed + _ROUND_OFF * length,
            stamp * max(own, acceleration) + _ROUND_OFF * speed,
        ]
    )


def check_intervals(clock: ForceClock, knots: Knots) -> Intervals:
    """Hold what is recorded at each knot against what the one before it leads to."""
    # Wrong numbers may be as large as numbers are.
    with np.errstate(over='ignore', invalid='ignore'):
        flights, plain = _flights(clock.parameters, knots)
        ends = FreeMotion(clock).ends(flights)
        later = knots[1:]
        recorded = (later.x, later.velocity_before, later.z, later.damper_velocity_before)
        residuals = np.column_stack([a - b for a, b in zip(recorded, ends, strict=True)])
    tolerances = tolerances_of(clock.parameters, knots)
    # NaN is not sound.
    within = (np.abs(residuals) <= tolerances).all(axis=1)
    return Intervals(residuals, tolerances, plain, plain & within)


def resting_place(parameters: RigParameters, y: float) -> int:
    """Return the stop that m is at, 0 for none, by Y in m."""
    half = 0.5 * parameters.gap
    if math.isclose(y, half, rel_tol=1e-9):
        return 1
    if math.isclose(y, -half, rel_tol=1e-9) and not parameters.one_sided:
        return 2
    return 0
