# SPDX-License-Identifier: Apache-2.0
"""
The primary mass as a driven damped oscillator: its constants, its response, its grid of steps.

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w

`frequency` is the damped natural circular frequency b. The response *from rest* to exp(iW tau) is
the divided difference of exp over the eigenvalues l = -a + ib and conj(l), and iW. Its factor
(exp(iW tau) - exp(l tau))/(iW - l) is computed with expm1 and half angles, so that nothing cancels
at resonance, where the particular and the homogeneous part of the textbook form do. Far above
resonance the textbook form is more accurate and is used.

From one point of the grid to the next, X, X' and the drive are multiplied by constants. Errors of
these have the same sign at each step, and would grow with their number; they are therefore summed
with the digits of `numpy.longdouble`, for many oscillators at once.
"""

from __future__ import annotations

from math import cos, expm1, factorial, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .kernels import kernel
from .records import rows_of

Array = npt.NDArray[Any]


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


class Line(NamedTuple):
    """
    One harmonic of the drive, and the constants of the response to it.

    Attributes
    ----------
    force, frequency, phase : float
        Amplitude f, m/s^2, circular frequency W, rad/s, and phase, rad.
    detuning : float
        W - b, rad/s.
    near_re, near_im, far_re, far_im : float
        The factors 1/(iW - l) and 1/(iW - conj(l)), both conjugated. Far above resonance `near`
        holds 1/((w^2 - W^2) + 2 i a W), conjugated.
    scaled_force, turn : float
        With the time in steps of the grid: amplitude f step^2, and angle W step turned in a step.
    turn_cosine, turn_sine : float
        Cosine and sine of that angle.
    x_cosine, x_sine, v_cosine, v_sine : float
        X and X' a step after rest, for unit cosine and for unit sine of the phase at the start.
    base_sine, base_cosine : float
        Displacement of the base for unit sine and for unit cosine of the phase, m; 0 if it is not
        a line of the base.
    """

    force: float
    frequency: float
    phase: float
    detuning: float
    near_re: float
    near_im: float
    far_re: float
    far_im: float
    scaled_force: float
    turn: float
    turn_cosine: float
    turn_sine: float
    x_cosine: float
    x_sine: float
    v_cosine: float
    v_sine: float
    base_sine: float
    base_cosine: float


class Oscillator(NamedTuple):
    """
    Mass on spring and dashpot; all per unit mass, SI units.

    Attributes
    ----------
    decay, frequency, inverse, omega_squared, inverse_square : float
        Constants a, b, 1/b, w^2 and 1/w^2 of the equation of motion.
    frequency_upper, frequency_low : float
        The upper half of the digits of `frequency`, and b - frequency.
    fastest : float
        Circular frequency of the fastest of spring and harmonics.
    taylor_limit : float
        Longest time for which the Taylor series is summed, s.
    horizon, jerk_bound : float
        A time, s, and the largest jerk that the drive adds to that of the free vibration in it.
    step, steps : float
        Time from point to point of the grid, s, and its inverse.
    x_x, v_x, x_v, v_v : float
        X and X' after a step from unit X, and from unit X', without drive.
    spring, dashpot : float
        Constants w^2 step^2 and 2 a step of the equation of motion with the time in steps.
    bound_3, bound_4, bound_5 : float
        Bounds of what the drive adds to the third to fifth time derivative of X, beyond the free
        vibration, over `POINTS` steps.
    rate_3, rate_4, rate_5 : float
        Bounds of the rates of these.
    """

    decay: float
    frequency: float
    inverse: float
    omega_squared: float
    inverse_square: float
    frequency_upper: float
    frequency_low: float
    fastest: float
    taylor_limit: float
    horizon: float
    jerk_bound: float
    step: float
    steps: float
    x_x: float
    v_x: float
    x_v: float
    v_v: float
    spring: float
    dashpot: float
    bound_3: float
    bound_4: float
    bound_5: float
    rate_3: float
    rate_4: float
    rate_5: float


#: Points reached from one base. The bounds grow with their number, round-off with its square root.
POINTS = 5
#: Length of a step, as a phase of the fastest of spring and harmonics, rad.
_STEP = 1.2
#: Binary digits of a step: so few that the times of the points are exact.
_STEP_DIGITS = 20
#: Largest phase, of the fastest of spring and harmonics, at which the Taylor series is summed.
_TAYLOR_REACH = 0.25
#: 1/n! for each n: the last term of the series of a step is below 1e-24.
_TERMS = 26
_INVERSES = [1 / np.longdouble(factorial(n)) for n in range(_TERMS)]
_LAST_INVERSE = float(_INVERSES[-1])
# Splits a number in two halves, whose products are exact (Dekker 1971)
_SPLIT = 134217729.0


def _series(factors: Any, variable: Array) -> Array:
    """Return the sum of factors times powers of a variable."""
    total: Array = np.zeros_like(variable) + factors[-1]
    for factor in reversed(factors[:-1]):
        total = total * variable + factor
    return total


def _power(base: Array, order: int) -> Array:
    """Return a power by products: numpy's own has other last bits on other processors."""
    power = base
    for _ in range(order - 1):
        power = power * base
    return power


def _bound_on_drive(
    omega: Array, decay: Array, force: Array, circular: Array, order: int, horizon: Array
) -> Array:
    """Bound what the drive adds to a derivative of X beyond its free vibration."""
    # Response from rest, by Duhamel's integral with |impulse response| <= min(1/w, t) ...
    from_rest = horizon * np.minimum(1.0 / omega, horizon / 2.0)
    # ... or the steady response and the free vibration that starts it from rest.
    gain = np.hypot(omega**2 - circular**2, 2.0 * decay * circular)
    with np.errstate(divide='ignore', over='ignore'):
        steady = (1.0 + np.hypot(1.0, circular / omega)) / gain
    bound: Array = np.abs(force) * _power(circular, order) * np.minimum(from_rest, steady)
    return np.asarray(bound.sum(-1))


def _bound_on_rate(
    omega: Array, decay: Array, force: Array, circular: Array, order: int, horizon: Array
) -> Array:
    """Bound the rate of the quantity that `_bound_on_drive` bounds."""
    gain = np.hypot(omega**2 - circular**2, 2.0 * decay * circular)
    with np.errstate(divide='ignore', over='ignore'):
        steady = (circular + np.hypot(omega, circular)) / gain
    bound: Array = np.abs(force) * _power(circular, order) * np.minimum(horizon, steady)
    return np.asarray(bound.sum(-1))


def oscillators(
    mass: Array,
    stiffness: Array,
    damping: Array,
    amplitudes: Array,
    frequencies: Array,
    phases: Array,
) -> tuple[Array, Array]:
    """
    Return the constants of oscillators and of their harmonics.

    Parameters
    ----------
    mass, stiffness, damping : ndarray, shape (n,)
        In kg, N/m and N s/m.
    amplitudes, frequencies, phases : ndarray, shape (n, h)
        Of the forces, N, rad/s and rad.

    Returns
    -------
    oscillators : ndarray, shape (n,)
        Records of `Oscillator`.
    lines : ndarray, shape (n, h)
        Records of `Line`.
    """
    omega_squared = stiffness / mass
    omega = np.sqrt(omega_squared)
    decay = damping / (2.0 * mass)
    force = amplitudes / mass[:, None]
    acting = np.where((force != 0.0) & (frequencies != 0.0), frequencies, 0.0)
    fastest = np.maximum(omega, acting.max(-1, initial=0.0))
    digits, exponent = np.frexp(_STEP / fastest)
    step = np.ldexp(np.round(digits * 2.0**_STEP_DIGITS), exponent - _STEP_DIGITS)
    exact = [value.astype(np.longdouble) for value in (mass, stiffness, damping, step)]
    spring, dashpot, span = exact[1] / exact[0], exact[2] / exact[0], exact[3]
    damped = np.sqrt(spring - dashpot * dashpot / 4)
    in_steps = spring * span * span, dashpot * span
    # G_n: X after a step from rest if the drive is s^(n - 2)/(n - 2)!, with the time s in steps.
    # G_n + dashpot G_{n+1} + spring G_{n+2} = 1/n!, the equation of motion integrated n times.
    # X' after the step is G_{n-1}; from unit X' and no drive, X is G_1 and X' is G_0.
    integrals = [np.zeros_like(span), np.zeros_like(span)]
    for inverse in reversed(_INVERSES):
        integrals.append(inverse - in_steps[1] * integrals[-1] - in_steps[0] * integrals[-2])
    responses = integrals[::-1]
    frequency = damped.astype(float)
    large = frequency * _SPLIT
    far_grid = POINTS * step[:, None]
    bounds = omega[:, None], decay[:, None], force, acting
    constants = {
        'decay': decay,
        'frequency': frequency,
        'inverse': 1 / damped,
        'omega_squared': omega_squared,
        'inverse_square': 1.0 / omega_squared,
        'frequency_upper': large - (large - frequency),
        'frequency_low': damped - frequency,
        'fastest': fastest,
        'taylor_limit': _TAYLOR_REACH / fastest,
        'horizon': 2.0 / omega,
        'jerk_bound': _bound_on_drive(*bounds, 3, 2.0 / omega[:, None]),
        'step': step,
        'steps': 1.0 / step,
        'x_x': 1 - in_steps[0] * responses[2],
        'v_x': -in_steps[0] * responses[1] / span,
        'x_v': span * responses[1],
        'v_v': responses[0],
        'spring': in_steps[0],
        'dashpot': in_steps[1],
        'bound_3': _bound_on_drive(*bounds, 3, far_grid),
        'bound_4': _bound_on_drive(*bounds, 4, far_grid),
        'bound_5': _bound_on_drive(*bounds, 5, far_grid),
        'rate_3': _bound_on_rate(*bounds, 3, far_grid),
        'rate_4': _bound_on_rate(*bounds, 4, far_grid),
        'rate_5': _bound_on_rate(*bounds, 5, far_grid),
    }
    circular, wide = frequencies.astype(np.longdouble), span[:, None]
    scaled, turn = wide * wide * force, wide * circular
    # Without a force the step may be a long one for a harmonic.
    angle = wide * acting
    square = -angle * angle
    columns = [response[:, None] for response in responses]
    even, odd = _series(columns[2::2], square), _series(columns[3::2], square)
    detuning, wide_b = (circular - damped[:, None]).astype(float), frequency[:, None]
    above = frequencies > 2.0 * wide_b
    wide_a = np.broadcast_to(decay[:, None], frequencies.shape)
    real = np.where(above, wide_a**2 + wide_b**2 - frequencies**2, wide_a)
    imaginary = np.where(above, 2.0 * wide_a * frequencies, detuning)
    near = real * real + imaginary * imaginary
    near = np.where(near > 0.0, near, 1.0)
    far = wide_a**2 + (frequencies + wide_b) ** 2
    lines = {
        'force': force,
        'frequency': frequencies,
        'phase': phases,
        'detuning': detuning,
        'near_re': real / near,
        'near_im': imaginary / near,
        'far_re': wide_a / far,
        'far_im': (frequencies + wide_b) / far,
        'scaled_force': scaled,
        'turn': turn,
        'turn_cosine': _series(_INVERSES[::2], square),
        'turn_sine': angle * _series(_INVERSES[1::2], square),
        'x_cosine': scaled * turn * odd,
        'x_sine': scaled * even,
        'v_cosine': scaled * turn * even / wide,
        'v_sine': scaled * (columns[1] + square * odd) / wide,
    }
    return (
        rows_of(Oscillator, len(mass), **constants),
        rows_of(Line, frequencies.shape, **lines),
    )


@kernel
def most_driven(omega: float, decay: float, circular: float, span: float) -> tuple[float, float]:
    """Bound the response from rest to a harmonic of unit acceleration in a span, and its rate."""
    most = span * min(1.0 / omega, 0.5 * span)
    rate = span
    stiff = omega * omega - circular * circular
    dashpot = 2.0 * decay * circular
    gain = sqrt(stiff * stiff + dashpot * dashpot)
    if gain > 0.0:
        ratio = circular / omega
        most = min(most, (1.0 + sqrt(1.0 + ratio * ratio)) / gain)
        rate = min(rate, (circular + sqrt(omega * omega + circular * circular)) / gain)
    return most, rate


@kernel
def set_line(oscillator: Any, line: Any) -> None:
    """Set the constants of the response to a harmonic by its force, frequency and phase."""
    decay = oscillator.decay
    circular = line.frequency
    step = oscillator.step
    wide_b = oscillator.frequency
    line.detuning = circular - wide_b
    real = decay
    imaginary = line.detuning
    if circular > 2.0 * wide_b:
        real = decay * decay + wide_b * wide_b - circular * circular
        imaginary = 2.0 * decay * circular
    near = real * real + imaginary * imaginary
    line.near_re = real / near if near > 0.0 else 0.0
    line.near_im = imaginary / near if near > 0.0 else 0.0
    far = decay * decay + (circular + wide_b) * (circular + wide_b)
    line.far_re = decay / far
    line.far_im = (circular + wide_b) / far
    line.scaled_force = step * step * line.force
    line.turn = step * circular
    # Without a force the step may be a long one for a harmonic.
    angle = line.turn if line.force != 0.0 else 0.0
    line.turn_cosine = cos(angle)
    line.turn_sine = sin(angle)
    square = -angle * angle
    # As in `oscillators`
    inverse = _LAST_INVERSE
    ahead = beyond = even = odd = 0.0
    for k in range(_TERMS):
        n = _TERMS - 1 - k
        here = inverse - oscillator.dashpot * ahead - oscillator.spring * beyond
        if n >= 2 and n % 2 == 0:
            even = even * square + here
        elif n >= 2:
            odd = odd * square + here
        beyond = ahead
        ahead = here
        inverse *= n
    line.x_cosine = line.scaled_force * line.turn * odd
    line.x_sine = line.scaled_force * even
    line.v_cosine = line.scaled_force * line.turn * even / step
    # `beyond` is that of unit X' at the start.
    line.v_sine = line.scaled_force * (beyond + square * odd) / step


@kernel
def set_oscillator(
    oscillator: Any, lines: Any, mass: float, stiffness: float, damping: float
) -> None:
    """
    Set the constants of an oscillator and of its harmonics, whose force, frequency and phase are.

    Solvers, which vary a rig, use these constants: those of `oscillators` without the digits
    beyond a float's, which a run of many steps needs.
    """
    omega_squared = stiffness / mass
    omega = sqrt(omega_squared)
    decay = damping / (2.0 * mass)
    frequency = sqrt(omega_squared - decay * decay)
    fastest = omega
    for j in range(len(lines)):
        if lines[j].force != 0.0:
            fastest = max(fastest, lines[j].frequency)
    step = _STEP / fastest
    large = frequency * _SPLIT
    oscillator.decay = decay
    oscillator.frequency = frequency
    oscillator.inverse = 1.0 / frequency
    oscillator.omega_squared = omega_squared
    oscillator.inverse_square = 1.0 / omega_squared
    oscillator.frequency_upper = large - (large - frequency)
    oscillator.frequency_low = 0.0
    oscillator.fastest = fastest
    oscillator.taylor_limit = _TAYLOR_REACH / fastest
    oscillator.horizon = 2.0 / omega
    oscillator.step = step
    oscillator.steps = 1.0 / step
    oscillator.spring = omega_squared * step * step
    oscillator.dashpot = 2.0 * decay * step
    free: Free = free_response(oscillator, step)
    oscillator.x_x = free.step
    oscillator.v_x = -omega_squared * free.impulse
    oscillator.x_v = free.impulse
    oscillator.v_v = free.rate
    jerk = 0.0
    bound_3 = bound_4 = bound_5 = rate_3 = rate_4 = rate_5 = 0.0
    for j in range(len(lines)):
        line = lines[j]
        set_line(oscillator, line)
        if line.force != 0.0:
            circular = line.frequency
            most, _ = most_driven(omega, decay, circular, oscillator.horizon)
            cube = abs(line.force) * circular * circular * circular
            jerk += cube * most
            most, rate = most_driven(omega, decay, circular, POINTS * step)
            bound_3 += cube * most
            rate_3 += cube * rate
            bound_4 += cube * circular * most
            rate_4 += cube * circular * rate
            bound_5 += cube * circular * circular * most
            rate_5 += cube * circular * circular * rate
    oscillator.jerk_bound = jerk
    oscillator.bound_3 = bound_3
    oscillator.bound_4 = bound_4
    oscillator.bound_5 = bound_5
    oscillator.rate_3 = rate_3
    oscillator.rate_4 = rate_4
    oscillator.rate_5 = rate_5


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
def driven_response(oscillator: Oscillator, line: Line, free: Free, tau: float) -> Driven:
    """Return the response from rest to one harmonic after a time."""
    circular = line.frequency
    near_re = line.near_re
    near_im = line.near_im
    # exp(i W tau) as exp(i b tau) exp(i beta tau), the latter from the half angle.
    half = 0.5 * line.detuning * tau
    sin_half = sin(half)
    cos_half = cos(half)
    sin_beta = 2.0 * sin_half * cos_half
    versine = 2.0 * sin_half * sin_half
    cos_beta = 1.0 - versine
    cos_w = free.cosine * cos_beta - free.sine * sin_beta
    sin_w = free.sine * cos_beta + free.cosine * sin_beta
    if circular > 2.0 * oscillator.frequency:
        # Steady vibration and the free one that starts it from rest
        top_re = cos_w - free.step
        top_im = sin_w - circular * free.impulse
        response_re = top_re * near_re + top_im * near_im
        response_im = top_im * near_re - top_re * near_im
        top_re = oscillator.omega_squared * free.impulse - circular * sin_w
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
    second_re = top_re * line.far_re + top_im * line.far_im
    second_im = top_im * line.far_re - top_re * line.far_im
    # Divided difference over l, conj(l), iW, and its time derivative
    scale = 0.5 * oscillator.inverse
    response_re = (first_im - second_im) * scale
    response_im = (second_re - first_re) * scale
    rate_re = 0.5 * (first_re + second_re) - oscillator.decay * response_re
    rate_im = 0.5 * (first_im + second_im) - oscillator.decay * response_im
    return Driven(response_re, response_im, rate_re, rate_im, cos_w, sin_w)


@kernel(inline=True)
def free_bound(oscillator: Oscillator, derivative: float, next_derivative: float) -> float:
    """
    Return a bound of a derivative of the free vibration from an instant on.

    Notes
    -----
    The n-th derivative y obeys the same equation of motion, in which w^2 y^2 + y'^2 never grows;
    w times this is a bound of y'.
    """
    rate = next_derivative * next_derivative * oscillator.inverse_square
    return sqrt(derivative * derivative + rate)
