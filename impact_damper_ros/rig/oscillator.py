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
from decimal import Context, Decimal, localcontext
from functools import lru_cache
from math import cos, expm1, factorial, frexp, ldexp, sin, sqrt
from typing import Any, NamedTuple

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
    push: float
    turn: float
    turn_cosine: float
    turn_sine: float
    x_cosine: float
    x_sine: float
    v_cosine: float
    v_sine: float


_EXACT = Context(prec=30)
#: 1/n! for each n: the last term of the series of a step is below 1e-24.
_INVERSES = tuple(_EXACT.divide(Decimal(1), Decimal(factorial(n))) for n in range(26))
#: From this number of harmonics on, extended precision of numpy takes the place of decimals.
_MANY_HARMONICS = 8


def _series(factors: Sequence[Any], variable: Any) -> Any:
    """Return the sum of factors times powers of a variable."""
    total = factors[-1]
    for factor in reversed(factors[:-1]):
        total = total * variable + factor
    return total


class ExactStep(NamedTuple):
    """
    A step of the grid with more digits than a float has, for constants right to the last digit.

    Errors of these constants have the same sign at each step, and would grow with their number.

    Attributes
    ----------
    span : Decimal
        The step, s.
    spring, dashpot : Decimal
        Constants w^2 step^2 and 2 a step of the equation of motion with the time in steps.
    responses : tuple of Decimal
        G_n: X after a step from rest if the drive is s^(n - 2)/(n - 2)!, with the time s in steps.
    turning : tuple of Decimal
        The same without spring and dashpot.
    """

    span: Any
    spring: Any
    dashpot: Any
    responses: tuple[Any, ...]
    turning: tuple[Any, ...] = _INVERSES

    @classmethod
    def of(cls, span: Decimal, spring: Decimal, dashpot: Decimal) -> ExactStep:
        """
        Return a step, given the constants of its equation of motion.

        Notes
        -----
        G_n + dashpot G_{n+1} + spring G_{n+2} = 1/n!, the equation of motion integrated n times.
        X' after the step is G_{n-1}; from unit X' and no drive, X is G_1 and X' is G_0.
        """
        found = [Decimal(0), Decimal(0)]
        for inverse in reversed(_INVERSES):
            found.append(inverse - dashpot * found[-1] - spring * found[-2])
        return cls(span, spring, dashpot, tuple(reversed(found)))

    def driven(self, force: Any, circular: Any, moving: Any) -> tuple[Any, ...]:
        """
        Return the fields of a `Harmonic` from `push` on.

        `moving` is its frequency, or 0 without a force: the step may be a long one for it then.
        """
        push, turn, angle = self.span * self.span * force, self.span * circular, self.span * moving
        square = -angle * angle
        even, odd = (_series(self.responses[n::2], square) for n in (2, 3))
        return (
            push,
            turn,
            _series(self.turning[::2], square),
            angle * _series(self.turning[1::2], square),
            push * turn * odd,
            push * even,
            push * turn * even / self.span,
            push * (self.responses[1] + square * odd) / self.span,
        )

    def driven_by(self, drive: Sequence[tuple[float, float]]) -> list[list[float]]:
        """Return these fields for each force and frequency."""
        if len(drive) < _MANY_HARMONICS:
            exact = [(Decimal(force), Decimal(circular)) for force, circular in drive]
            return [[*map(float, self.driven(f, w, w if f else f))] for f, w in exact]
        import numpy as np

        span, *numbers = (np.longdouble(str(number)) for number in (self.span, *self.responses))
        turning = tuple(np.longdouble(str(number)) for number in self.turning)
        step = self._replace(span=span, responses=tuple(numbers), turning=turning)
        force, circular = np.array(drive, np.longdouble).T
        columns = step.driven(force, circular, np.where(force, circular, 0.0))
        return np.array(columns, float).T.tolist()  # type: ignore[no-any-return]


def make_harmonic(
    decay: float, damped: Decimal, force: float, circular: float, driven: Sequence[float]
) -> Harmonic:
    """Return a harmonic, given what it does in a step of the grid."""
    frequency = float(damped)
    detuning = float(Decimal(circular) - damped)
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
    return Harmonic(force, circular, detuning, real, imaginary, decay / far, total / far, *driven)


# Splits a number in two halves, whose products are exact (Dekker 1971)
_SPLIT = 134217729.0


@kernel(inline=True)
def free_response(oscillator: Oscillator, tau: float) -> Free:
    """Return the free vibration after a time."""
    phase = oscillator.frequency * tau
    # Add the round-off of the phase, which grows with the number of cycles.
    large = _SPLIT * tau
    large -= large - tau
    small = tau - large
    upper = oscillator.frequency_upper
    lower = oscillator.frequency - upper
    left = ((upper * large - phase) + upper * small + lower * large) + lower * small
    left += oscillator.frequency_low * tau
    sine = sin(phase)
    cosine = cos(phase)
    sine, cosine = sine + left * cosine, cosine - left * sine
    less = expm1(-oscillator.decay * tau)
    envelope = 1.0 + less
    impulse = envelope * sine * oscillator.inverse
    damped = oscillator.decay * impulse
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
#: Binary digits of this length.
_STEP_DIGITS = 20
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


def drive_bounds(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    orders: Sequence[int],
    horizon: float,
) -> list[float]:
    """Bound what the drive adds to derivatives of X beyond its free vibration."""
    totals = [0.0] * len(orders)
    # Response from rest, by Duhamel's integral with |impulse response| <= min(1/w, t) ...
    from_rest = horizon * min(1.0 / omega, horizon / 2.0)
    for force, frequency in drive:
        # ... or the steady response and the free vibration that starts it from rest.
        gain = sqrt((omega**2 - frequency**2) ** 2 + (2.0 * decay * frequency) ** 2)
        response = from_rest
        if gain > 0.0:
            response = min(from_rest, (1.0 + sqrt(1.0 + frequency**2 / omega**2)) / gain)
        for k, order in enumerate(orders):
            totals[k] += abs(force) * frequency**order * response
    return totals


def make_grid(
    omega: float,
    decay: float,
    drive: Sequence[tuple[float, float]],
    step: float,
    exact: ExactStep,
) -> Grid:
    """Return the grid of an oscillator."""
    rate, x, x_held = exact.responses[:3]
    bounds = drive_bounds(omega, decay, drive, (3, 4, 5, 6), _POINTS * step)
    return Grid(
        step=step,
        inverse=1.0 / step,
        points=_POINTS,
        x_x=float(1 - exact.spring * x_held),
        v_x=float(-exact.spring * x / exact.span),
        x_v=float(exact.span * x),
        v_v=float(rate),
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        bound_6=bounds[3],
        spring=float(exact.spring),
        dashpot=float(exact.dashpot),
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
    frequency_upper, frequency_low : float
        The upper half of the digits of `frequency`, and what it lacks to b.
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
    frequency_upper: float
    frequency_low: float
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
    drive = [(a / mass, w) for a, w in zip(amplitudes, frequencies, strict=True)]
    fastest = max([omega, *(w for f, w in drive if f != 0.0 and w != 0.0)])
    horizon = 2.0 / omega
    bounds = drive_bounds(omega, decay, drive, (3, 4, 5), horizon)
    digits, exponent = frexp(_STEP / fastest)
    # So few digits that the times of the points of the grid are exact
    step = ldexp(round(digits * 2.0**_STEP_DIGITS), exponent - _STEP_DIGITS)
    with localcontext(_EXACT):
        span = Decimal(step)
        spring, dashpot = Decimal(stiffness) / Decimal(mass), Decimal(damping) / Decimal(mass)
        exact = ExactStep.of(span, spring * span * span, dashpot * span)
        damped = (spring - dashpot * dashpot / 4).sqrt()
        frequency = float(damped)
        low = float(damped - Decimal(frequency))
        harmonics = tuple(
            make_harmonic(decay, damped, *one, driven)
            for one, driven in zip(drive, exact.driven_by(drive), strict=True)
        )
        grid = make_grid(omega, decay, drive, step, exact)
    return Oscillator(
        decay=decay,
        frequency=frequency,
        frequency_upper=frequency * _SPLIT - (frequency * _SPLIT - frequency),
        frequency_low=low,
        inverse=float(1 / damped),
        omega_squared=omega_squared,
        harmonics=harmonics,
        fastest=fastest,
        taylor_limit=_TAYLOR_REACH / fastest,
        horizon=horizon,
        bound_3=bounds[0],
        bound_4=bounds[1],
        bound_5=bounds[2],
        grid=grid,
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
