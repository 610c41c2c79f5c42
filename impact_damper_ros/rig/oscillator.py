"""
The primary mass as a driven oscillator: its constants, and bounds of what its drive can do.

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w

`frequency` is the damped natural circular frequency b.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt
from typing import NamedTuple

from .grid import Grid, drive_bound, make_grid
from .kernels import kernel
from .response import make_harmonic

__all__ = ['Oscillator', 'acceleration_at', 'derivative_bound', 'make_oscillator']

#: Largest phase, of the fastest of spring and harmonics, at which the Taylor series is summed.
_TAYLOR_REACH = 0.25


class Oscillator(NamedTuple):
    """
    Mass on spring and dashpot with its harmonic drive; all per unit mass, SI units.

    Attributes
    ----------
    decay, frequency, inverse, omega_squared : float
        Constants a, b, 1/b and w^2 of the equation of motion.
    forces, frequencies : tuple of float
        Amplitude f, m/s^2, and circular frequency W, rad/s, of each harmonic.
    detunings, near_re, near_im, far_re, far_im : tuple of float
        Constants of the response to each harmonic, see `Harmonic`.
    fastest : float
        Circular frequency of the fastest of spring and harmonics.
    taylor_limit : float
        Longest time for which the Taylor series is summed.
    horizon : float
        The longest time for which `bound_3`, `bound_4` and `bound_5` hold: these bound what the
        drive adds to the third to fifth time derivative of X beyond their free vibration.
    bound_3, bound_4, bound_5 : float
        See there.
    grid : Grid
        Steps of the quick search.
    """

    decay: float
    frequency: float
    inverse: float
    omega_squared: float
    forces: tuple[float, ...]
    frequencies: tuple[float, ...]
    detunings: tuple[float, ...]
    near_re: tuple[float, ...]
    near_im: tuple[float, ...]
    far_re: tuple[float, ...]
    far_im: tuple[float, ...]
    fastest: float
    taylor_limit: float
    horizon: float
    bound_3: float
    bound_4: float
    bound_5: float
    grid: Grid


@lru_cache(maxsize=64)
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
        Constants shared by all flights of this mass; kept for the next rig with the same, since
        rigs of a sweep often differ in something else.
    """
    omega_squared = stiffness / mass
    omega = sqrt(omega_squared)
    decay = damping / (2.0 * mass)
    frequency = sqrt((omega - decay) * (omega + decay))
    forces = tuple(amplitude / mass for amplitude in amplitudes)
    drive = tuple(zip(forces, frequencies, strict=True))
    fastest = max([omega, *(w for f, w in drive if f != 0.0 and w != 0.0)])
    horizon = 2.0 / omega
    bounds = [drive_bound(omega, decay, drive, order, horizon) for order in (3, 4, 5)]
    harmonics = [make_harmonic(decay, frequency, w) for w in frequencies]
    return Oscillator(
        decay=decay,
        frequency=frequency,
        inverse=1.0 / frequency,
        omega_squared=omega_squared,
        forces=forces,
        frequencies=tuple(frequencies),
        detunings=tuple(h.detuning for h in harmonics),
        near_re=tuple(h.near_re for h in harmonics),
        near_im=tuple(h.near_im for h in harmonics),
        far_re=tuple(h.far_re for h in harmonics),
        far_im=tuple(h.far_im for h in harmonics),
        fastest=fastest,
        taylor_limit=_TAYLOR_REACH / fastest,
        horizon=horizon,
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        grid=make_grid(omega, decay, drive, harmonics, fastest),
    )


@kernel(inline=True)
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


@kernel(inline=True)
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
