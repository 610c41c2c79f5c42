"""
The primary mass as a driven damped oscillator: its response, its constants, its grid of steps.

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w

`frequency` is the damped natural circular frequency b. The response *from rest* to exp(iW tau) is
the divided difference of exp over the eigenvalues l = -a + ib and conj(l), and iW. Its factor
(exp(iW tau) - exp(l tau))/(iW - l) is computed with expm1 and half angles, so that nothing cancels
at resonance, where the particular and the homogeneous part of the textbook form do. Far above
resonance the textbook form is more accurate and is used.

From one point of the grid to the next, X, X' and the drive are multiplied by constants.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import cos, expm1, inf, sin, sqrt
from typing import NamedTuple

from .kernels import kernel


class Free(NamedTuple):
    """
    Free vibration at one instant.

    `step` and `impulse` are X from unit X and from unit X' at the start, `rate` is X' from unit
    X'; `envelope` is exp(-a tau), `less` is exp(-a tau) - 1 with full relative accuracy.
    """

    sine: float
    cosine: float
    envelope: float
    less: float
    impulse: float
    step: float
    rate: float


class Driven(NamedTuple):
    """
    Response from rest to a harmonic of unit amplitude at one instant.

    X and X' as driven by its cosine and by its sine; and the cosine and sine of the angle that
    the harmonic has turned.
    """

    cosine: float
    sine: float
    rate_cosine: float
    rate_sine: float
    turned_cosine: float
    turned_sine: float


class Harmonic(NamedTuple):
    """
    One harmonic of the drive, and the constants of the response to it.

    Attributes
    ----------
    force, frequency : float
        Amplitude f, m/s^2, and circular frequency W, rad/s.
    detuning : float
        W - b, rad/s.
    near_re, near_im, far_re, far_im : float
        The factors 1/(iW - l) and 1/(iW - conj(l)), both conjugated. Far above resonance `near`
        holds 1/((w^2 - W^2) + 2 i a W), conjugated.
    push, turn : float
        With the time in steps of the grid: amplitude f step^2, and angle W step turned in a step.
    turn_cosine, turn_sine : float
        Cosine and sine of that angle.
    x_cosine, x_sine, v_cosine, v_sine : float
        X and X' a step after rest, for unit cosine and for unit sine of the phase at the start.
    """

    force: float
    frequency: float
    detuning: float
    near_re: float
    near_im: float
    far_re: float
    far_im: float
    push: float = 0.0
    turn: float = 0.0
    turn_cosine: float = 1.0
    turn_sine: float = 0.0
    x_cosine: float = 0.0
    x_sine: float = 0.0
    v_cosine: float = 0.0
    v_sine: float = 0.0

    def stepped(
        self, decay: float, frequency: float, omega_squared: float, free: Free, step: float
    ) -> Harmonic:
        """Return the harmonic with the constants for one step of the grid."""
        inverse = 1.0 / frequency
        response = driven_response(decay, frequency, inverse, omega_squared, self, free, step)
        return self._replace(
            push=self.force * step * step,
            turn=self.frequency * step,
            turn_cosine=response.turned_cosine,
            turn_sine=response.turned_sine,
            x_cosine=self.force * response.sine,
            x_sine=self.force * response.cosine,
            v_cosine=self.force * response.rate_sine,
            v_sine=self.force * response.rate_cosine,
        )


def make_harmonic(decay: float, frequency: float, force: float, circular: float) -> Harmonic:
    """Return a harmonic without what it does in a step."""
    detuning = circular - frequency
    total = circular + frequency
    if circular > 2.0 * frequency:
        real = decay * decay + frequency * frequency - circular * circular
        imaginary = 2.0 * decay * circular
    else:
        real, imaginary = decay, detuning
    near = real * real + imaginary * imaginary
    if near > 0.0:
        real, imaginary = real / near, imaginary / near
    far = decay * decay + total * total
    return Harmonic(force, circular, detuning, real, imaginary, decay / far, total / far)


@kernel(inline=True)
def free_response(decay: float, frequency: float, inverse: float, tau: float) -> Free:
    """Return the free vibration after a time."""
    phase = frequency * tau
    sine = sin(phase)
    cosine = cos(phase)
    less = expm1(-decay * tau)
    envelope = 1.0 + less
    impulse = envelope * sine * inverse
    damped = decay * impulse
    return Free(
        sine,
        cosine,
        envelope,
        less,
        impulse,
        envelope * cosine + damped,
        envelope * cosine - damped,
    )


@kernel(inline=True)
def driven_response(
    decay: float,
    frequency: float,
    inverse: float,
    omega_squared: float,
    harmonic: Harmonic,
    free: Free,
    tau: float,
) -> Driven:
    """Return the response from rest to one harmonic after a time."""
    circular = harmonic.frequency
    near_re = harmonic.near_re
    near_im = harmonic.near_im
    far_re = harmonic.far_re
    far_im = harmonic.far_im
    # exp(i W tau) as exp(i b tau) exp(i beta tau), the latter from the half angle.
    half = 0.5 * harmonic.detuning * tau
    sin_half = sin(half)
    cos_half = cos(half)
    sin_beta = 2.0 * sin_half * cos_half
    versine = 2.0 * sin_half * sin_half
    cos_beta = 1.0 - versine
    cos_w = free.cosine * cos_beta - free.sine * sin_beta
    sin_w = free.sine * cos_beta + free.cosine * sin_beta
    if circular > 2.0 * frequency:
        # Steady vibration and the free one that starts it from rest
        top_re = cos_w - free.step
        top_im = sin_w - circular * free.impulse
        response_re = top_re * near_re + top_im * near_im
        response_im = top_im * near_re - top_re * near_im
        top_re = omega_squared * free.impulse - circular * sin_w
        top_im = circular * (cos_w - free.rate)
        rate_re = top_re * near_re + top_im * near_im
        rate_im = top_im * near_re - top_re * near_im
        return Driven(response_re, response_im, rate_re, rate_im, cos_w, sin_w)
    # first = (exp(iW tau) - exp(l tau)) / (iW - l)
    ratio_re = tau
    ratio_im = 0.0
    if near_re != 0.0 or near_im != 0.0:
        top_re = free.envelope * versine - free.less
        top_im = free.envelope * sin_beta
        ratio_re = top_re * near_re + top_im * near_im
        ratio_im = top_im * near_re - top_re * near_im
    first_re = cos_w * ratio_re - sin_w * ratio_im
    first_im = sin_w * ratio_re + cos_w * ratio_im
    # second = (exp(iW tau) - exp(conj(l) tau)) / (iW - conj(l))
    top_re = cos_w - free.envelope * free.cosine
    top_im = sin_w + free.envelope * free.sine
    second_re = top_re * far_re + top_im * far_im
    second_im = top_im * far_re - top_re * far_im
    # Divided difference over l, conj(l), iW, and its time derivative
    scale = 0.5 * inverse
    response_re = (first_im - second_im) * scale
    response_im = (second_re - first_re) * scale
    rate_re = 0.5 * (first_re + second_re) - decay * response_re
    rate_im = 0.5 * (first_im + second_im) - decay * response_im
    return Driven(response_re, response_im, rate_re, rate_im, cos_w, sin_w)


#: Length of a step, as a phase of the fastest of spring and harmonics, rad.
_STEP = 1.2
#: Points reached from one base. The bounds grow with their number, round-off with its square root.
_POINTS = 5


class Grid(NamedTuple):
    """
    Constants of one step.

    Attributes
    ----------
    step, inverse : float
        Time from point to point, s, and its inverse.
    points : int
        Number of points for which the bounds hold.
    x_x, v_x, x_v, v_v : float
        X and X' after a step from unit X, and from unit X', without drive.
    bound_3, bound_4, bound_5, bound_6 : float
        As the oscillator's bounds, over all points.
    spring, dashpot : float
        Constants w^2 step^2 and 2 a step of the equation of motion with the time in steps.
    """

    step: float
    inverse: float
    points: int
    x_x: float
    v_x: float
    x_v: float
    v_v: float
    bound_3: float
    bound_4: float
    bound_5: float
    bound_6: float
    spring: float
    dashpot: float


def drive_bound(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    order: int,
    horizon: float,
) -> float:
    """Bound what the drive adds to a derivative of X beyond its free vibration."""
    total = 0.0
    for force, frequency in drive:
        push = abs(force) * frequency**order
        if push == 0.0:
            continue
        # Response from rest, by Duhamel's integral with |impulse response| <= min(1/w, t) ...
        from_rest = push * horizon * min(1.0 / omega, horizon / 2.0)
        # ... or the steady response and the free vibration that starts it from rest.
        gain = sqrt((omega**2 - frequency**2) ** 2 + (2.0 * decay * frequency) ** 2)
        steady = inf
        if gain > 0.0:
            steady = push / gain * (1.0 + sqrt(1.0 + frequency**2 / omega**2))
        total += min(from_rest, steady)
    return total


def make_grid(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    free: Free,
    step: float,
) -> Grid:
    """Return the grid of an oscillator, from its free vibration after a step."""
    bounds = [drive_bound(omega, decay, drive, order, _POINTS * step) for order in (3, 4, 5, 6)]
    return Grid(
        step=step,
        inverse=1.0 / step,
        points=_POINTS,
        x_x=free.step,
        v_x=-(omega * omega) * free.impulse,
        x_v=free.impulse,
        v_v=free.rate,
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        bound_6=bounds[3],
        spring=(omega * step) * (omega * step),
        dashpot=2.0 * decay * step,
    )


#: Largest phase, of the fastest of spring and harmonics, at which the Taylor series is summed.
_TAYLOR_REACH = 0.25


class Oscillator(NamedTuple):
    """
    Mass on spring and dashpot with its harmonic drive; all per unit mass, SI units.

    Attributes
    ----------
    decay, frequency, inverse, omega_squared : float
        Constants a, b, 1/b and w^2 of the equation of motion.
    harmonics : tuple of Harmonic
        The drive.
    fastest : float
        Circular frequency of the fastest of spring and harmonics.
    taylor_limit : float
        Longest time for which the Taylor series is summed.
    horizon : float
        Longest time for which the bounds hold, s.
    bound_3, bound_4, bound_5 : float
        Bounds of what the drive adds to the third to fifth time derivative of X, beyond the free
        vibration, over the horizon.
    grid : Grid
        Steps of the quick search.
    """

    decay: float
    frequency: float
    inverse: float
    omega_squared: float
    harmonics: tuple[Harmonic, ...]
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
    """Return the oscillator of one mass with the bounds of its drive."""
    omega_squared = stiffness / mass
    omega = sqrt(omega_squared)
    decay = damping / (2.0 * mass)
    frequency = sqrt((omega - decay) * (omega + decay))
    drive = [(a / mass, w) for a, w in zip(amplitudes, frequencies, strict=True)]
    fastest = max([omega, *(w for f, w in drive if f != 0.0 and w != 0.0)])
    horizon = 2.0 / omega
    bounds = [drive_bound(omega, decay, drive, order, horizon) for order in (3, 4, 5)]
    step = _STEP / fastest
    free = free_response(decay, frequency, 1.0 / frequency, step)
    harmonics = [make_harmonic(decay, frequency, *one) for one in drive]
    return Oscillator(
        decay=decay,
        frequency=frequency,
        inverse=1.0 / frequency,
        omega_squared=omega_squared,
        harmonics=tuple(one.stepped(decay, frequency, omega**2, free, step) for one in harmonics),
        fastest=fastest,
        taylor_limit=_TAYLOR_REACH / fastest,
        horizon=horizon,
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        grid=make_grid(omega, decay, drive, free, step),
    )


@kernel(inline=True)
def acceleration_at(
    oscillator: Oscillator, constant: float, sines: tuple[float, ...], x: float, velocity: float
) -> float:
    """Return X'' from the equation of motion."""
    acceleration = constant - 2.0 * oscillator.decay * velocity - oscillator.omega_squared * x
    for j in range(len(sines)):
        acceleration += oscillator.harmonics[j].force * sines[j]
    return acceleration


@kernel(inline=True)
def derivative_bound(
    oscillator: Oscillator, derivative: float, next_derivative: float, drive_bound: float
) -> float:
    """
    Return a bound of a derivative of X over the oscillator's horizon.

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
