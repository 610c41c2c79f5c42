"""
Flights: the motion between two events in closed form.

The primary mass is a damped oscillator under a constant and harmonic accelerations,

    X'' + 2 a X' + w^2 X = c + sum_j f_j sin(phase_j + W_j tau),     a = zeta w,  b = eta w,

with time tau counted from the flight's origin; the damper mass has constant acceleration, so that
the relative acceleration is Y'' = Z'' - X''. Bapat (1995), equations (1)-(5), in a form without
cancellation: the response from rest is that of `oscillator`; short flights are summed as Taylor
series about the tangent parabola, so that they keep their relative accuracy; relative position and
velocity are variables of their own, not differences of absolute ones.
"""

from __future__ import annotations

from math import cos, inf, sin
from typing import NamedTuple

from .kernels import kernel
from .oscillator import Driven, Free, Oscillator, driven_response, free_response

#: What ends a flight.
NO_EVENT = 0
CONTACT_1 = 1
CONTACT_2 = 2
REVERSAL = 3
#: A stop that follows m is where it should be.
ARRIVAL = 4
#: The support gives way, and m moves upwards.
RELEASE_UP = 5
RELEASE_DOWN = 6
STOP_ARRIVED_1 = 7
STOP_ARRIVED_2 = 8

_TAYLOR_TERMS = 17


class Flight(NamedTuple):
    """
    One flight: all that the motion after its origin depends on.

    Positions and velocities are those at the origin, *after* the event that began the flight.
    `relative_acceleration` is the relative acceleration there, exactly zero for a release.
    `clearance_1` and `clearance_2` are the distances of m from stop 1 and stop 2, infinite for a
    stop that is not there. What ends the flight:

    - `joint` false: contact with a stop. With `direction` +1 (m moves down relative to M) or -1,
      also the reversal of the relative velocity and, with `arrival` finite, that displacement of
      m (the stop that follows it is then at its target). `direction` 0 is free flight.
    - `joint` true, M and m move as one: the acceleration m needs from its support, X'' - `slope`,
      leaves the interval from `support_low` to `support_high`.
    - In both cases, after `deadline` s at the latest, what `deadline_kind` names: a moving stop
      reaches its target, or m that does not move relative to M.

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


class FlightEnd(NamedTuple):
    """
    How a flight ends, or how far it is known to go on.

    Attributes
    ----------
    kind : int
        The event, as `contact.first_event` names it.
    tau : float
        Its time since the origin, s; without an event, the time up to which there is none.
    x, velocity, travel, relative_velocity : float
        As in `Motion`, just before the event.
    slope : float
        Rate of the function whose root it is; meaningless for an event that is no root.
    finished : bool
        Whether all of these have been evaluated.
    """

    kind: int
    tau: float
    x: float
    velocity: float
    travel: float
    relative_velocity: float
    slope: float
    finished: bool


@kernel(inline=True)
def unfinished(kind: int, tau: float) -> FlightEnd:
    """Return an end, or that there is none up to a time, without the motion there."""
    return FlightEnd(kind, tau, 0.0, 0.0, 0.0, 0.0, 0.0, False)


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
    """Sum the Taylor series of the response to one sinusoidal drive from the third order on."""
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
    square = tau * tau
    if square == 0.0:
        # After less than 1e-162 s nothing is left of the rates either.
        return displacement, 0.0, 0.0
    return displacement, rate / tau, rate_2 / square


class _Drive(NamedTuple):
    """The driving acceleration and its first four derivatives."""

    drive_0: float
    drive_1: float
    drive_2: float
    drive_3: float
    drive_4: float


@kernel(inline=True)
def _with_harmonic(drive: _Drive, sine: float, cosine: float, frequency: float) -> _Drive:
    """Add a harmonic, by its acceleration, and the same a quarter of a cycle later."""
    square = frequency * frequency
    rate = cosine * frequency
    return _Drive(
        drive.drive_0 + sine,
        drive.drive_1 + rate,
        drive.drive_2 - sine * square,
        drive.drive_3 - rate * square,
        drive.drive_4 + sine * square * square,
    )


@kernel(inline=True)
def _differentiated(
    flight: Flight,
    x: float,
    velocity: float,
    travel: float,
    relative_velocity: float,
    relative_2: float,
    x_2: float,
    drive: _Drive,
) -> Motion:
    """Return the motion with the higher derivatives, from those of the drive."""
    oscillator = flight.oscillator
    a = oscillator.decay
    omega_squared = oscillator.omega_squared
    x_3 = drive.drive_1 - 2.0 * a * x_2 - omega_squared * velocity
    x_4 = drive.drive_2 - 2.0 * a * x_3 - omega_squared * x_2
    x_5 = drive.drive_3 - 2.0 * a * x_4 - omega_squared * x_3
    x_6 = drive.drive_4 - 2.0 * a * x_5 - omega_squared * x_4
    return Motion(x, velocity, travel, relative_velocity, relative_2, x_2, x_3, x_4, x_5, x_6)


@kernel(inline=True)
def starting_motion(flight: Flight) -> Motion:
    """Return the motion at a flight's origin."""
    oscillator = flight.oscillator
    drive = _Drive(-0.0, -0.0, -0.0, -0.0, -0.0)
    for j in range(len(flight.sines)):
        force = oscillator.harmonics[j].force
        frequency = oscillator.harmonics[j].frequency
        drive = _with_harmonic(
            drive, force * flight.sines[j], force * flight.cosines[j], frequency
        )
    return _differentiated(
        flight,
        flight.x,
        flight.velocity,
        0.0,
        flight.relative_velocity,
        flight.relative_acceleration,
        flight.acceleration,
        drive,
    )


@kernel
def _near_motion(flight: Flight, tau: float) -> Motion:
    """Sum the Taylor series: what bends the path away from its tangent parabola."""
    oscillator = flight.oscillator
    a = oscillator.decay
    omega_squared = oscillator.omega_squared
    bend, bend_1, bend_2 = _series(
        tau, a, omega_squared, flight.x, flight.velocity, flight.constant, 0.0, 0.0
    )
    drive = _Drive(-0.0, -0.0, -0.0, -0.0, -0.0)
    for j in range(len(flight.sines)):
        force = oscillator.harmonics[j].force
        frequency = oscillator.harmonics[j].frequency
        sin_0 = flight.sines[j]
        cos_0 = flight.cosines[j]
        part, part_1, part_2 = _series(
            tau, a, omega_squared, 0.0, 0.0, force * sin_0, force * frequency * cos_0, frequency
        )
        bend += part
        bend_1 += part_1
        bend_2 += part_2
        turned = frequency * tau
        sin_w = sin(turned)
        cos_w = cos(turned)
        sine = force * (sin_0 * cos_w + cos_0 * sin_w)
        cosine = force * (cos_0 * cos_w - sin_0 * sin_w)
        drive = _with_harmonic(drive, sine, cosine, frequency)
    rate = flight.relative_acceleration
    return _differentiated(
        flight,
        flight.x + (flight.velocity * tau + 0.5 * flight.acceleration * tau * tau + bend),
        flight.velocity + (flight.acceleration * tau + bend_1),
        flight.relative_velocity * tau + 0.5 * rate * tau * tau - bend,
        flight.relative_velocity + rate * tau - bend_1,
        rate - bend_2,
        flight.acceleration + bend_2,
        drive,
    )


@kernel(inline=True)
def _far_motion(flight: Flight, tau: float) -> Motion:
    """Evaluate the closed form itself."""
    oscillator = flight.oscillator
    a = oscillator.decay
    b = oscillator.frequency
    omega_squared = oscillator.omega_squared
    constant = flight.constant
    free: Free = free_response(a, b, oscillator.inverse, tau)
    x = flight.x * free.step + flight.velocity * free.impulse
    x += constant / omega_squared * (1.0 - free.step)
    velocity = flight.velocity * free.rate
    velocity += (constant - omega_squared * flight.x) * free.impulse
    drive = _Drive(-0.0, -0.0, -0.0, -0.0, -0.0)
    for j in range(len(flight.sines)):
        harmonic = oscillator.harmonics[j]
        force = harmonic.force
        sin_0 = flight.sines[j]
        cos_0 = flight.cosines[j]
        driven: Driven = driven_response(
            a, b, oscillator.inverse, omega_squared, harmonic, free, tau
        )
        x += force * (cos_0 * driven.sine + sin_0 * driven.cosine)
        velocity += force * (cos_0 * driven.rate_sine + sin_0 * driven.rate_cosine)
        sine = force * (sin_0 * driven.turned_cosine + cos_0 * driven.turned_sine)
        cosine = force * (cos_0 * driven.turned_cosine - sin_0 * driven.turned_sine)
        drive = _with_harmonic(drive, sine, cosine, harmonic.frequency)
    x_2 = drive.drive_0 + constant - 2.0 * a * velocity - omega_squared * x
    damper_acceleration = flight.relative_acceleration + flight.acceleration
    return _differentiated(
        flight,
        x,
        velocity,
        (flight.relative_velocity + flight.velocity) * tau
        + 0.5 * damper_acceleration * tau * tau
        - (x - flight.x),
        flight.relative_velocity + (damper_acceleration * tau - (velocity - flight.velocity)),
        damper_acceleration - x_2,
        x_2,
        drive,
    )


@kernel(inline=True)
def motion_at(flight: Flight, tau: float) -> Motion:
    """
    Evaluate the closed form.

    Notes
    -----
    Bapat (1995), equations (3)-(5), in the form that the module describes.
    """
    if tau == 0.0:
        return starting_motion(flight)
    if tau <= flight.oscillator.taylor_limit:
        return _near_motion(flight, tau)
    return _far_motion(flight, tau)


@kernel
def end_at(flight: Flight, kind: int, tau: float) -> FlightEnd:
    """Return the end of a flight at a given time."""
    motion: Motion = motion_at(flight, tau)
    return FlightEnd(
        kind, tau, motion.x, motion.velocity, motion.travel, motion.relative_velocity, 0.0, True
    )
