"""
What a damped oscillator does in a time: of itself, and from rest under one harmonic.

    X'' + 2 a X' + w^2 X = sin(W tau) or cos(W tau),     l = -a + i b,  w^2 = a^2 + b^2

The response *from rest* is the divided difference of exp over the two eigenvalues and iW. Its
factor (exp(iW tau) - exp(l tau))/(iW - l) is written with expm1 and half angles, so that nothing
cancels at resonance, where the particular and the homogeneous part of the textbook form do. Far
above resonance that form is the better one, and is used.
"""

from __future__ import annotations

from math import cos, expm1, sin
from typing import NamedTuple

from .kernels import kernel

__all__ = ['Driven', 'Free', 'Harmonic', 'driven_response', 'free_response', 'make_harmonic']


class Free(NamedTuple):
    """
    Free vibration at one instant.

    `step` and `impulse` are X from unit X and from unit X' at the start, `rate` is X' from unit
    X'; `envelope` is exp(-a tau), `less` what it lacks to 1, with full relative accuracy.
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
    Constants of the response to one harmonic.

    `detuning` is W - b; the `near` factor is 1/(iW - l), and the `far` one 1/(iW - conj(l)), both
    conjugated. Far above resonance `near` holds 1/((w^2 - W^2) + 2 i a W), conjugated.
    """

    detuning: float
    near_re: float
    near_im: float
    far_re: float
    far_im: float


def make_harmonic(decay: float, frequency: float, circular: float) -> Harmonic:
    """
    Return the constants of a harmonic.

    Parameters
    ----------
    decay, frequency : float
        The oscillator's a and b.
    circular : float
        Circular frequency W of the harmonic, rad/s.
    """
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
    return Harmonic(detuning, real, imaginary, decay / far, total / far)


@kernel(inline=True)
def free_response(decay: float, frequency: float, inverse: float, tau: float) -> Free:
    """
    Return the free vibration after a time.

    Parameters
    ----------
    decay, frequency, inverse : float
        The oscillator's a, b and 1/b.
    tau : float
        The time, s.
    """
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
    circular: float,
    detuning: float,
    near_re: float,
    near_im: float,
    far_re: float,
    far_im: float,
    free: Free,
    tau: float,
) -> Driven:
    """
    Return the response from rest to one harmonic after a time.

    Parameters
    ----------
    decay, frequency, inverse, omega_squared : float
        The oscillator's a, b, 1/b and w^2.
    circular : float
        Circular frequency W of the harmonic.
    detuning, near_re, near_im, far_re, far_im : float
        Its constants, see `Harmonic`.
    free : Free
        The free vibration at that time.
    tau : float
        The time, s.
    """
    # exp(i W tau) as exp(i b tau) exp(i beta tau), the latter from the half angle.
    half = 0.5 * detuning * tau
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
