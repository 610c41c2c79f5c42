"""
The primary mass as a driven oscillator: its constants, and bounds of what its drive can do.

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w

`frequency` is the damped natural circular frequency b.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from .kernels import kernel

__all__ = ['Oscillator', 'acceleration_at', 'derivative_bound', 'make_oscillator']

#: Largest phase, of the fastest of spring and harmonics, at which the Taylor series is summed.
_TAYLOR_REACH = 0.25


class Oscillator(NamedTuple):
    """
    Mass on spring and dashpot with its harmonic drive; all per unit mass, SI units.

    `horizon` is the longest time for which `bound_3`, `bound_4` and `bound_5` hold: these bound
    what the drive adds to the third to fifth time derivative of X beyond their free vibration.
    """

    decay: float
    frequency: float
    omega_squared: float
    forces: tuple[float, ...]
    frequencies: tuple[float, ...]
    horizon: float
    taylor_limit: float
    bound_3: float
    bound_4: float
    bound_5: float


def make_oscillator(
    mass: float,
    stiffness: float,
    damping: float,
    amplitudes: tuple[float, ...],
    frequencies: tuple[float, ...],
) -> Oscillator:
    """
    Return the oscillator of one mass with the bounds of its drive.

    Parameters
    ----------
    mass, stiffness, damping : float
        Moving mass (kg), spring (N/m) and dashpot (N s/m); underdamped.
    amplitudes, frequencies : tuple of float
        Force harmonics, N and rad/s.

    Returns
    -------
    Oscillator
        Constants shared by all flights of this mass.
    """
    omega_squared = stiffness / mass
    omega = sqrt(omega_squared)
    decay = damping / (2.0 * mass)
    forces = tuple(amplitude / mass for amplitude in amplitudes)
    active = [w for f, w in zip(forces, frequencies, strict=True) if f != 0.0 and w != 0.0]
    fastest = max([omega, *active])
    horizon = 2.0 / omega
    bounds = []
    for order in (3, 4, 5):
        total = 0.0
        for force, frequency in zip(forces, frequencies, strict=True):
            drive = abs(force) * frequency**order
            if drive == 0.0:
                continue
            # Response from rest, by Duhamel's integral with |impulse response| <= min(1/w, t) ...
            from_rest = drive * horizon * min(1.0 / omega, horizon / 2.0)
            # ... or the steady response and the free vibration that starts it from rest.
            gain = sqrt((omega_squared - frequency**2) ** 2 + (2.0 * decay * frequency) ** 2)
            steady = inf
            if gain > 0.0:
                steady = drive / gain * (1.0 + sqrt(1.0 + frequency**2 / omega_squared))
            total += min(from_rest, steady)
        bounds.append(total)
    return Oscillator(
        decay=decay,
        frequency=sqrt((omega - decay) * (omega + decay)),
        omega_squared=omega_squared,
        forces=forces,
        frequencies=tuple(frequencies),
        horizon=horizon,
        taylor_limit=_TAYLOR_REACH / fastest,
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
    )


@kernel
def acceleration_at(
    oscillator: Oscillator, constant: float, sines: tuple[float, ...], x: float, velocity: float
) -> float:
    """
    Return X'' from the equation of motion.

    Parameters
    ----------
    oscillator : Oscillator
        The moving mass.
    constant : float
        Constant acceleration c, m/s^2.
    sines : tuple of float
        Sine of each harmonic's phase at the instant.
    x, velocity : float
        Displacement and velocity at the instant.
    """
    acceleration = constant - 2.0 * oscillator.decay * velocity - oscillator.omega_squared * x
    for j in range(len(sines)):
        acceleration += oscillator.forces[j] * sines[j]
    return acceleration


@kernel
def derivative_bound(
    oscillator: Oscillator, derivative: float, next_derivative: float, drive_bound: float
) -> float:
    """
    Return a bound of a derivative of X over the oscillator's horizon.

    Parameters
    ----------
    oscillator : Oscillator
        The moving mass.
    derivative, next_derivative : float
        The n-th and (n+1)-th time derivative of X now.
    drive_bound : float
        The oscillator's bound of order n.

    Notes
    -----
    The n-th derivative y obeys the same equation of motion. Its free vibration has
    w^2 y^2 + y'^2 never growing; the drive adds at most `drive_bound`.
    """
    return (
        sqrt(
            derivative * derivative + next_derivative * next_derivative / oscillator.omega_squared
        )
        + drive_bound
    )
