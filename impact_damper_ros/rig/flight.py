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


class GridPoint(NamedTuple):
    """
    Motion of M at one point of the grid.

    Attributes
    ----------
    offset : float
        X from where it would rest under the constant force, m.
    velocity : float
        X', m/s.
    sines, cosines : tuple of float
        Sine and cosine of each harmonic's phase.
    """

    offset: float
    velocity: float
    sines: tuple[float, ...]
    cosines: tuple[float, ...]


class Series(NamedTuple):
    """X'' at a point, and the coefficients of the second to fifteenth power in that of X'."""

    x_2: float
    b_3: float
    b_4: float
    b_5: float
    b_6: float
    b_7: float
    b_8: float
    b_9: float
    b_10: float
    b_11: float
    b_12: float
    b_13: float
    b_14: float
    b_15: float
    b_16: float


@kernel(inline=True)
def series_at(oscillator: Oscillator, point: GridPoint) -> Series:
    """Return the series around a point: each derivative from the two before it and the drive."""
    grid = oscillator.grid
    # Negative zero is what adds nothing, which a compiler makes use of.
    f_0 = -0.0
    f_1 = -0.0
    f_2 = -0.0
    f_3 = -0.0
    f_4 = -0.0
    f_5 = -0.0
    f_6 = -0.0
    f_7 = -0.0
    f_8 = -0.0
    f_9 = -0.0
    f_10 = -0.0
    f_11 = -0.0
    f_12 = -0.0
    f_13 = -0.0
    f_14 = -0.0
    for j in range(len(point.sines)):
        push = oscillator.harmonics[j].push
        turn = oscillator.harmonics[j].turn
        even = push * point.sines[j]
        odd = push * turn * point.cosines[j]
        turned = -turn * turn
        f_0 += even
        f_1 += odd
        even *= turned
        odd *= turned
        f_2 += even
        f_3 += odd
        even *= turned
        odd *= turned
        f_4 += even
        f_5 += odd
        even *= turned
        odd *= turned
        f_6 += even
        f_7 += odd
        even *= turned
        odd *= turned
        f_8 += even
        f_9 += odd
        even *= turned
        odd *= turned
        f_10 += even
        f_11 += odd
        even *= turned
        odd *= turned
        f_12 += even
        f_13 += odd
        even *= turned
        f_14 += even
    spring = grid.spring
    dashpot = grid.dashpot
    d_0 = point.offset
    d_1 = point.velocity * grid.step
    d_2 = (f_0 - spring * d_0) - dashpot * d_1
    d_3 = (f_1 - spring * d_1) - dashpot * d_2
    d_4 = (f_2 - spring * d_2) - dashpot * d_3
    d_5 = (f_3 - spring * d_3) - dashpot * d_4
    d_6 = (f_4 - spring * d_4) - dashpot * d_5
    d_7 = (f_5 - spring * d_5) - dashpot * d_6
    d_8 = (f_6 - spring * d_6) - dashpot * d_7
    d_9 = (f_7 - spring * d_7) - dashpot * d_8
    d_10 = (f_8 - spring * d_8) - dashpot * d_9
    d_11 = (f_9 - spring * d_9) - dashpot * d_10
    d_12 = (f_10 - spring * d_10) - dashpot * d_11
    d_13 = (f_11 - spring * d_11) - dashpot * d_12
    d_14 = (f_12 - spring * d_12) - dashpot * d_13
    d_15 = (f_13 - spring * d_13) - dashpot * d_14
    d_16 = (f_14 - spring * d_14) - dashpot * d_15
    return Series(
        d_2,
        d_3 * (1.0 / 2.0),
        d_4 * (1.0 / 6.0),
        d_5 * (1.0 / 24.0),
        d_6 * (1.0 / 120.0),
        d_7 * (1.0 / 720.0),
        d_8 * (1.0 / 5040.0),
        d_9 * (1.0 / 40320.0),
        d_10 * (1.0 / 362880.0),
        d_11 * (1.0 / 3628800.0),
        d_12 * (1.0 / 39916800.0),
        d_13 * (1.0 / 479001600.0),
        d_14 * (1.0 / 6227020800.0),
        d_15 * (1.0 / 87178291200.0),
        d_16 * (1.0 / 1307674368000.0),
    )


@kernel(inline=True)
def tail(series: Series, s: float) -> tuple[float, float, float]:
    """
    Return what the third and higher powers add to X and its first two derivatives.

    The last one is that of a last step, and needs half of the digits. Products are taken in pairs,
    so that few of them wait for one another.
    """
    s_2 = s * s
    s_4 = s_2 * s_2
    s_8 = s_4 * s_4
    _, b_3, b_4, b_5, b_6, b_7, b_8, b_9, b_10, b_11, b_12, b_13, b_14, b_15, b_16 = series
    value = (
        ((b_3 * (1.0 / 3.0) + 0.25 * b_4 * s) + (0.2 * b_5 + b_6 * (1.0 / 6.0) * s) * s_2)
        + ((b_7 * (1.0 / 7.0) + 0.125 * b_8 * s) + (b_9 * (1.0 / 9.0) + 0.1 * b_10 * s) * s_2)
        * s_4
        + (
            (b_11 * (1.0 / 11.0) + b_12 * (1.0 / 12.0) * s)
            + (b_13 * (1.0 / 13.0) + b_14 * (1.0 / 14.0) * s) * s_2
            + (b_15 * (1.0 / 15.0) + 0.0625 * b_16 * s) * s_4
        )
        * s_8
    )
    slope = (
        ((b_3 + b_4 * s) + (b_5 + b_6 * s) * s_2)
        + ((b_7 + b_8 * s) + (b_9 + b_10 * s) * s_2) * s_4
        + ((b_11 + b_12 * s) + (b_13 + b_14 * s) * s_2 + (b_15 + b_16 * s) * s_4) * s_8
    )
    bend = (
        ((2.0 * b_3 + 3.0 * b_4 * s) + (4.0 * b_5 + 5.0 * b_6 * s) * s_2)
        + ((6.0 * b_7 + 7.0 * b_8 * s) + (8.0 * b_9 + 9.0 * b_10 * s) * s_2) * s_4
        + (10.0 * b_11 + 11.0 * b_12 * s) * s_8
    )
    return s * s_2 * value, s_2 * slope, s * bend


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
    grid = oscillator.grid
    rest = flight.constant / oscillator.omega_squared
    start = GridPoint(flight.x - rest, flight.velocity, flight.sines, flight.cosines)
    series: Series = series_at(oscillator, start)
    s = tau * grid.inverse
    bend, bend_1, bend_2 = tail(series, s)
    # The last digits of the second derivative
    s_4 = s * s * s * s
    bend_2 += s_4 * s_4 * s * s * s * (12.0 * series.b_13 + 13.0 * series.b_14 * s)
    bend_1 *= grid.inverse
    bend_2 *= grid.inverse * grid.inverse
    drive = _Drive(-0.0, -0.0, -0.0, -0.0, -0.0)
    for j in range(len(flight.sines)):
        force = oscillator.harmonics[j].force
        frequency = oscillator.harmonics[j].frequency
        sin_0 = flight.sines[j]
        cos_0 = flight.cosines[j]
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
    free: Free = free_response(oscillator, tau)
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
