"""
Stability of periodic motion: the section map's derivative and its eigenvalues.

Deviations of (X, X', Z, Z') at a fixed instant are carried through a flight by its free
vibration, and through an event at a surface h = 0 by the saltation matrix

    S = D + (f+ - D f-) grad h / (grad h . f-),

with D the derivative of the jump and f the rate of the state before and after. Bapat (1995) gives
the product for impacts entry by entry; Nordmark, J. Sound Vib. 145 (1991), and Fredriksson and
Nordmark, Proc. R. Soc. Lond. A 456 (2000), the general form. Derived, not transcribed.

The section of the paper is (X, X', Z', t) just after an impact. Its derivative is similar to the
one at a fixed instant, so that both have the same multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.mode import rig_constants
from impact_damper_ros.rig.oscillator import Oscillator

from .equations import Array, ImpactEquations

__all__ = [
    'expected_determinant',
    'flight_matrix',
    'impact_matrix',
    'joint_matrix',
    'monodromy',
    'multipliers_of',
    'saltation',
    'section_matrix',
    'section_monodromy',
]


_RELATIVE_PLACE = np.array([-1.0, 0.0, 1.0, 0.0])


def _vibration(oscillator: Oscillator, duration: float) -> Array:
    """Return the 2 x 2 matrix of free vibration."""
    envelope = math.exp(-oscillator.decay * duration)
    impulse = envelope * math.sin(oscillator.frequency * duration) / oscillator.frequency
    cosine = envelope * math.cos(oscillator.frequency * duration)
    return np.array(
        [
            [cosine + oscillator.decay * impulse, impulse],
            [-oscillator.omega_squared * impulse, cosine - oscillator.decay * impulse],
        ]
    )


def flight_matrix(oscillator: Oscillator, duration: float) -> Array:
    """
    Carry deviations through a flight of m between two events.

    Parameters
    ----------
    oscillator : Oscillator
        The primary mass alone.
    duration : float
        Duration of the flight, s.

    Returns
    -------
    ndarray, shape (4, 4)
        Maps deviations of (X, X', Z, Z') at its start to those at its end.
    """
    matrix = np.eye(4)
    matrix[:2, :2] = _vibration(oscillator, duration)
    matrix[2, 3] = duration
    return matrix


def joint_matrix(oscillator: Oscillator, duration: float) -> Array:
    """Carry deviations through a phase in which M and m move as one."""
    matrix = np.zeros((4, 4))
    matrix[:2, :2] = _vibration(oscillator, duration)
    matrix[2] = matrix[0] + _RELATIVE_PLACE
    matrix[3] = matrix[1]
    return matrix


def saltation(jump: Array, before: Array, after: Array, normal: Array) -> Array:
    """Carry deviations at a fixed instant through an event."""
    return jump + np.outer(after - jump @ before, normal) / (normal @ before)


def impact_matrix(mass_ratio: float, restitution: float, before: Array, after: Array) -> Array:
    """
    Carry deviations through an impact.

    Parameters
    ----------
    mass_ratio, restitution : float
        m/M and the coefficient of restitution R.
    before, after : ndarray, shape (4,)
        (X', X'', Z', Z'') just before and just after the impact.
    """
    total = 1.0 + mass_ratio
    jump = np.eye(4)
    jump[1, 1] = (1.0 - mass_ratio * restitution) / total
    jump[1, 3] = mass_ratio * (1.0 + restitution) / total
    jump[3, 1] = (1.0 + restitution) / total
    jump[3, 3] = (mass_ratio - restitution) / total
    return saltation(jump, before, after, _RELATIVE_PLACE)


def _rates_at_impacts(
    equations: ImpactEquations, x: Array, instants: Array
) -> tuple[Array, Array]:
    """Return (X', X'', Z', Z'') just before and just after each impact, shape (N, 4)."""
    at = equations.velocities(x, instants)
    free = rig_constants(equations.parameters).free
    drive = free.forces[0] * np.sin(equations.frequency * instants + equations.phase)

    def rates(velocity: Array, damper: Array, push: Array, acceleration: Array) -> Array:
        primary = push + drive - 2.0 * free.decay * velocity - free.omega_squared * x
        return np.stack([velocity, primary, damper, acceleration], axis=-1)

    return (
        rates(
            at.primary_before,
            at.damper_before,
            np.roll(equations.pushes, 1),
            np.roll(equations.accelerations, 1),
        ),
        rates(at.primary_after, at.damper_after, equations.pushes, equations.accelerations),
    )


def monodromy(equations: ImpactEquations, x: Array, instants: Array) -> Array:
    """Return the derivative of the state one period later by the state."""
    machine = rig_constants(equations.parameters)
    before, after = _rates_at_impacts(equations, x, instants)
    lasts = equations.durations(instants)
    matrix = np.eye(4)
    for i in range(equations.impacts):
        j = (i + 1) % equations.impacts
        restitution = machine.restitution_1 if equations.stops[j] == 1 else machine.restitution_2
        matrix = flight_matrix(machine.free, float(lasts[i])) @ matrix
        matrix = impact_matrix(machine.mass_ratio, restitution, before[j], after[j]) @ matrix
    return matrix


def section_matrix(matrix: Array, rates: Array) -> Array:
    """Return the derivative of the section map from that at a fixed instant."""
    # A section deviation, seen at the instant of the undisturbed impact
    into = np.array(
        [
            [1.0, 0.0, 0.0, -rates[0]],
            [0.0, 1.0, 0.0, -rates[1]],
            [1.0, 0.0, 0.0, -rates[2]],
            [0.0, 0.0, 1.0, -rates[3]],
        ]
    )
    section: Array = np.linalg.solve(into, matrix @ into)
    return section


def section_monodromy(equations: ImpactEquations, x: Array, instants: Array) -> Array:
    """Return the derivative of the paper's section map at the first impact."""
    after = _rates_at_impacts(equations, x, instants)[1]
    return section_matrix(monodromy(equations, x, instants), after[0])


def multipliers_of(matrix: Array) -> tuple[complex, ...]:
    """Return the eigenvalues, largest modulus first, of a pair the one with positive part."""
    values = [complex(value) for value in np.linalg.eigvals(matrix)]
    return tuple(sorted(values, key=lambda v: (-round(abs(v), 12), -v.real, -v.imag)))


def expected_determinant(parameters: RigParameters, stops: Sequence[int], period: float) -> float:
    """
    Return the product of all multipliers of a motion without reversals, sticking and rest.

    It is exp(-2 zeta omega T) times the product of all R^2, whatever the motion.
    """
    product = math.exp(-2.0 * parameters.zeta * parameters.omega * period)
    for stop in stops:
        product *= (parameters.restitution_1 if stop == 1 else parameters.restitution_2) ** 2
    return product
