"""
Closed-form flights: the motion between two events.

The primary mass is a damped oscillator under a constant and harmonic accelerations,

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w,

with time tau counted from the flight's origin; the damper mass has constant acceleration, so that
the relative acceleration is Y'' = Z'' - X''. Bapat (1995), equations (1)-(5), in a form without
cancellation:

- The response to a harmonic *from rest* is the divided difference of exp over the two
  eigenvalues and iW. Its factor (exp(iW tau) - exp(l tau))/(iW - l) is written with expm1 and
  half angles, so that nothing cancels at resonance, where the particular and the homogeneous
  part of the textbook form do. Far above resonance that form is the better one, and is used.
- For short times the displacement relative to the tangent parabola is summed from its Taylor
  series, so that flights of any smallness keep their relative accuracy.
- Relative position and velocity are carried themselves, not as a difference of absolute ones.
"""

from __future__ import annotations

from math import cos, expm1, inf, sin
from typing import NamedTuple

from .kernels import kernel
from .oscillator import Oscillator

__all__ = ['Flight', 'Motion', 'motion_at']

_TAYLOR_TERMS = 17


class Flight(NamedTuple):
    """
    One flight: everything that the motion after its origin depends on.

    Positions and velocities are those at the origin, *after* whatever event began the flight.
    `relative_acceleration` is the relative acceleration there, exactly zero for a release.
    `clearance_1` and `clearance_2` are the distances of m from stop 1 and stop 2, infinite for a
    stop that is not there. What ends the flight:

    - `joint` false: contact with a stop. With `direction` +1 (m moves down relative to M) or -1,
      also the reversal of the relative velocity, and, with `arrival` finite, m having moved that
      far (the stop that follows it is then where it should be). `direction` 0 is free flight.
    - `joint` true, M and m move as one: the acceleration m needs from its support, X'' - `slope`,
      leaves the interval from `support_low` to `support_high`.
    - In both cases, no later than after `deadline` s, what `deadline_kind` names: a moving stop
      arrives, or comes up to m that does not move relative to M.

    `stop_velocity_1` and `stop_velocity_2` are the velocities of the stops relative to M.
    """

    oscillator: Oscillator
    constant: float
    sines: tuple[float, ...]
    cosines: tuple[float, ...]
    x: float
    velocity: float
    acceleration: float
    relative_velocity: float
    relative_acceleration: float
    clearance_1: float
    clearance_2: float
    joint: bool
    direction: int
    arrival: float
    slope: float
    support_low: float
    support_high: float
    stop_velocity_1: float = 0.0
    stop_velocity_2: float = 0.0
    deadline: float = inf
    deadline_kind: int = 0


class Motion(NamedTuple):
    """
    Motion at one instant of a flight.

    `travel` is the relative displacement Y - Y(origin); `x_2` to `x_6` are the second to sixth
    time derivatives of X, `relative_2` is Y''.
    """

    x: float
    velocity: float
    travel: float
    relative_velocity: float
    relative_2: float
    x_2: float
    x_3: float
    x_4: float
    x_5: float
    x_6: float


@kernel
def _series(
    tau: float,
    decay: float,
    omega_squared: float,
    x: float,
    velocity: float,
    drive: float,
    drive_rate: float,
    frequency: float,
) -> tuple[float, float, float]:
    """
    Sum the Taylor series of the response to one sinusoidal drive from the third order on.

    Parameters
    ----------
    tau : float
        Time since the origin, within the oscillator's `taylor_limit`.
    decay, omega_squared : float
        Constants a and w^2 of the oscillator.
    x, velocity : float
        Displacement and velocity at the origin.
    drive, drive_rate, frequency : float
        Driving acceleration at the origin, its first derivative, and its circular frequency.

    Returns
    -------
    tuple of float
        What the terms of third and higher order add to X, X' and X''.
    """
    before = x
    last = velocity * tau
    even = drive * tau * tau / 2.0
    odd = drive_rate * tau * tau * tau / 6.0
    turn = -frequency * frequency * tau * tau
    spring = -omega_squared * tau * tau
    dashpot = -2.0 * decay * tau
    displacement = 0.0
    rate = 0.0
    rate_2 = 0.0
    for n in range(2, _TAYLOR_TERMS):
        term = dashpot * last / n + spring * before / (n * (n - 1)) + even
        before = last
        last = term
        if n > 2:
            displacement += term
            rate += n * term
            rate_2 += n * (n - 1) * term
        even, odd = odd, turn * even / ((n + 1) * (n + 2))
    return displacement, rate / tau, rate_2 / (tau * tau)


@kernel
def motion_at(flight: Flight, tau: float) -> Motion:
    """
    Evaluate the closed form.

    Parameters
    ----------
    flight : Flight
        The flight.
    tau : float
        Time since its origin, s; not negative.

    Returns
    -------
    Motion
        Positions, velocities and higher derivatives at that instant.

    Notes
    -----
    Bapat (1995), equations (3)-(5), rewritten as the module says.
    """
    oscillator = flight.oscillator
    a = oscillator.decay
    b = oscillator.frequency
    omega_squared = oscillator.omega_squared
    constant = flight.constant
    small = tau <= oscillator.taylor_limit

    phase = b * tau
    sin_b = sin(phase)
    cos_b = cos(phase)
    envelope_1 = expm1(-a * tau)
    envelope = 1.0 + envelope_1
    impulse = envelope * sin_b / b
    step = envelope * cos_b + a * impulse
    x = flight.x * step + flight.velocity * impulse
    x += constant / omega_squared * (1.0 - step)
    free_rate = envelope * cos_b - a * impulse
    velocity = flight.velocity * free_rate
    velocity += (constant - omega_squared * flight.x) * impulse
    drive_0 = 0.0
    drive_1 = 0.0
    drive_2 = 0.0
    drive_3 = 0.0
    drive_4 = 0.0
    for j in range(len(flight.sines)):
        force = oscillator.forces[j]
        frequency = oscillator.frequencies[j]
        sin_0 = flight.sines[j]
        cos_0 = flight.cosines[j]
        # exp(i W tau) as exp(i b tau) exp(i beta tau), the latter from the half angle.
        beta = frequency - b
        half = 0.5 * beta * tau
        sin_half = sin(half)
        cos_half = cos(half)
        sin_beta = 2.0 * sin_half * cos_half
        versine = 2.0 * sin_half * sin_half
        cos_beta = 1.0 - versine
        cos_w = cos_b * cos_beta - sin_b * sin_beta
        sin_w = sin_b * cos_beta + cos_b * sin_beta
        if frequency > 2.0 * b:
            # Far above resonance: steady vibration and the free one that starts it from rest
            gain = omega_squared - frequency * frequency
            lag = 2.0 * a * frequency
            modulus = gain * gain + lag * lag
            top_re = cos_w - step
            top_im = sin_w - frequency * impulse
            response_re = (top_re * gain + top_im * lag) / modulus
            response_im = (top_im * gain - top_re * lag) / modulus
            top_re = omega_squared * impulse - frequency * sin_w
            top_im = frequency * (cos_w - free_rate)
            rate_re = (top_re * gain + top_im * lag) / modulus
            rate_im = (top_im * gain - top_re * lag) / modulus
        else:
            # first = (exp(iW tau) - exp(l tau)) / (iW - l), l = -a + ib, without cancellation
            modulus = a * a + beta * beta
            if modulus > 0.0:
                top_re = envelope * versine - envelope_1
                top_im = envelope * sin_beta
                ratio_re = (top_re * a + top_im * beta) / modulus
                ratio_im = (top_im * a - top_re * beta) / modulus
            else:
                ratio_re = tau
                ratio_im = 0.0
            first_re = cos_w * ratio_re - sin_w * ratio_im
            first_im = sin_w * ratio_re + cos_w * ratio_im
            # second = (exp(iW tau) - exp(conj(l) tau)) / (iW - conj(l))
            total = frequency + b
            modulus = a * a + total * total
            top_re = cos_w - envelope * cos_b
            top_im = sin_w + envelope * sin_b
            second_re = (top_re * a + top_im * total) / modulus
            second_im = (top_im * a - top_re * total) / modulus
            # Divided difference over l, conj(l), iW, and its time derivative
            scale = 0.5 / b
            response_re = (first_im - second_im) * scale
            response_im = (second_re - first_re) * scale
            sum_re = first_re + second_re
            sum_im = first_im + second_im
            rate_re = 0.5 * sum_re - a * response_re
            rate_im = 0.5 * sum_im - a * response_im
        x += force * (cos_0 * response_im + sin_0 * response_re)
        velocity += force * (cos_0 * rate_im + sin_0 * rate_re)
        sine = force * (sin_0 * cos_w + cos_0 * sin_w)
        cosine = force * (cos_0 * cos_w - sin_0 * sin_w) * frequency
        drive_0 += sine
        drive_1 += cosine
        drive_2 -= sine * frequency * frequency
        drive_3 -= cosine * frequency * frequency
        drive_4 += sine * frequency * frequency * frequency * frequency

    if small and tau > 0.0:
        # What bends the path away from its tangent parabola, with full relative accuracy
        bend, bend_1, bend_2 = _series(
            tau, a, omega_squared, flight.x, flight.velocity, constant, 0.0, 0.0
        )
        for j in range(len(flight.sines)):
            force = oscillator.forces[j]
            frequency = oscillator.frequencies[j]
            part, part_1, part_2 = _series(
                tau,
                a,
                omega_squared,
                0.0,
                0.0,
                force * flight.sines[j],
                force * frequency * flight.cosines[j],
                frequency,
            )
            bend += part
            bend_1 += part_1
            bend_2 += part_2
        relative_2 = flight.relative_acceleration - bend_2
        relative_velocity = flight.relative_velocity + flight.relative_acceleration * tau - bend_1
        travel = (
            flight.relative_velocity * tau + 0.5 * flight.relative_acceleration * tau * tau - bend
        )
        x = flight.x + (flight.velocity * tau + 0.5 * flight.acceleration * tau * tau + bend)
        velocity = flight.velocity + (flight.acceleration * tau + bend_1)
        x_2 = flight.acceleration + bend_2
    else:
        x_2 = drive_0 + constant - 2.0 * a * velocity - omega_squared * x
        damper_acceleration = flight.relative_acceleration + flight.acceleration
        relative_2 = damper_acceleration - x_2
        relative_velocity = flight.relative_velocity + (
            damper_acceleration * tau - (velocity - flight.velocity)
        )
        travel = (
            (flight.relative_velocity + flight.velocity) * tau
            + 0.5 * damper_acceleration * tau * tau
            - (x - flight.x)
        )
    if tau == 0.0:
        x = flight.x
        velocity = flight.velocity
        relative_velocity = flight.relative_velocity
        relative_2 = flight.relative_acceleration
        travel = 0.0
        x_2 = flight.acceleration
    x_3 = drive_1 - 2.0 * a * x_2 - omega_squared * velocity
    x_4 = drive_2 - 2.0 * a * x_3 - omega_squared * x_2
    x_5 = drive_3 - 2.0 * a * x_4 - omega_squared * x_3
    x_6 = drive_4 - 2.0 * a * x_5 - omega_squared * x_4
    return Motion(x, velocity, travel, relative_velocity, relative_2, x_2, x_3, x_4, x_5, x_6)
