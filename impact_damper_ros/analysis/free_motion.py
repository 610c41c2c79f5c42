"""
Closed-form motion over many short flights at once, from recorded states.

The formulas are those of `rig.flight`, vectorised: the response to a harmonic from rest is the
divided difference of exp over the eigenvalues and i W, so that nothing cancels at resonance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters

from .force_clock import ForceClock
from .run_curves import Array

__all__ = ['Flights', 'FreeMotion']

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
