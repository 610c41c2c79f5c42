# SPDX-License-Identifier: Apache-2.0
"""
Flights from row to row: their equations of motion, integrals over them, and their largest |X|.

Each flight is cut into pieces. In a piece X is the Taylor series of the equation of motion about
the beginning of the piece: its terms follow one from the other, and nothing cancels at resonance.
Integrals are those of Gauss, exact to round-off; the largest |X| is at a turning point.
"""

from __future__ import annotations

from math import ceil, cos, inf, sin
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.event import (
    CROSSING,
    FORCE_STEP,
    IMPACT,
    RELEASE_EVENT,
    REST_EVENT,
    REVERSAL_EVENT,
    STICK_EVENT,
    STOP_ARRIVED,
)
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import CHATTER_1, STICK, RigConstants

from .response import Array
from .transmissibility import Moments, Transmissibility

#: Terms of a series, and the longest piece as an angle of the fastest oscillation, rad: the
#: truncation errors of the series and of the integral of a square are below round-off.
TERMS, _PIECE_ANGLE = 20, 1.2
_GAUSS, _NUMBERS_AT = 8, 5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_GAUSS)
#: Numbers of the Gauss points in a piece, which follow one another: X, its derivative by the
#: place, the force, the places and their weights.
AT_X, AT_SLOPE, AT_FORCE, AT_PLACE, AT_WEIGHT = range(0, _NUMBERS_AT * _GAUSS, _GAUSS)
#: To be written, but for places and weights.
NO_POINTS: Array = np.zeros(_NUMBERS_AT * _GAUSS)
NO_POINTS[AT_PLACE:] = [*0.5 * (_NODES + 1.0), *0.5 * _WEIGHTS]
#: Angle of a cycle, rad.
_WHOLE_TURN = 6.283185307179586
#: A turning point is sought next to points above this share of the largest |X|, in this number of
#: steps.
_NEAR_LARGEST, _NEWTON_STEPS = 0.98, 6

#: Columns of the equations of motion in flights, X'' = push + share F - 2 decay X' - square X with
#: the force F: also the frequency of the free vibration (rad/s), Z'' = slide where m moves by
#: itself, and 1 where it does, 0 where it moves as one with M.
(
    EQUATION_DECAY,
    EQUATION_DAMPED,
    EQUATION_SQUARE,
    EQUATION_PUSH,
    EQUATION_SHARE,
    EQUATION_SLIDE,
    EQUATION_MOVES,
) = range(7)
EQUATION_COLUMNS = 7
#: Columns of flights: the active force (N), when they begin, and amplitude (N), frequency (rad/s)
#: and phase (rad) of the first harmonic, including the angle that it has turned until then.
(FLIGHT_ACTIVE, FLIGHT_BEGIN, FLIGHT_LINE) = range(3)
FLIGHT_COLUMNS = 5
#: Columns of harmonics: amplitude, frequency, phase with the angle turned at time 0; and 1 where
#: the force is that of a moving base.
(LINE_SIZE, LINE_RATE, LINE_PHASE, LINE_OF_BASE) = range(4)
#: Rows of the series: X, the force, and what a second integral divides by, inverted.
_SERIES_X, _SERIES_FORCE, _SERIES_SHARE = range(3)
#: A series to be written.
NO_SERIES: Array = np.zeros((3, TERMS))
NO_SERIES[_SERIES_SHARE] = [1.0 / ((n + 1) * (n + 2)) for n in range(TERMS)]
#: Sums over flights: time, X, X^2, works of the force, of the active force and of the dashpot, J;
#: b, b^2, X b, X''^2 and b''^2; and the largest |X|.
(SUM_TIME, SUM_X, SUM_SQUARES, SUM_FORCE, SUM_ACTIVE, SUM_DASHPOT, SUM_BASE) = range(7)
SUM_LARGEST = 11


class Integrals(NamedTuple):
    """Sums over flights; energies in J."""

    covered: float  # time, s
    total: float  # integral of X, m s
    squares: float  # integral of X^2, m^2 s
    force: float  # work of force and base; NaN if their phase is not known, as the next two
    active: float  # the part that is work of the active force
    dashpot: float
    friction: float
    air: float
    both: float  # kinetic energy that M and m together lost in the events that end flights
    impact_energy: float  # energy that M lost in impacts; m receives part of it
    impact_loss: float  # energy that both lost in impacts
    # Sums of a moving base, as in `Moments`; 0 for one at rest
    base: float = 0.0
    base_squares: float = 0.0
    base_product: float = 0.0
    acceleration: float = 0.0
    base_acceleration: float = 0.0

    @property
    def x_rms(self) -> float:
        """Root mean square of X, m; NaN if it is not known between the rows."""
        return float(np.sqrt(self.squares / self.covered)) if self.covered else np.nan

    @property
    def transmissibility(self) -> Transmissibility:
        """Transmissibility from the base to M, over whole periods."""
        return Transmissibility.of_moments(
            Moments(self.covered, self.total, self.squares, *self[-5:])
        )


@kernel
def trace_flights(rows: Any, together: Any, stops: Any, force: Any) -> int:
    """
    Write whether M and m move as one, the stop hit last and the active force (N) after each row.

    The force after the first row is given; the stop hit last and the mode there are in the row.
    The last bounces of a chatter, which are not resolved, count as rest. An unknown mode after an
    event is negative.
    """
    joint = False
    # The last row that decides, and whether it is an impact after which the mode is unknown
    latest = 0
    doubtful = False
    for k in range(len(rows)):
        kind = rows['kind'][k]
        mode = rows['mode'][k]
        known = kind > 0 and mode >= 0
        joins = mode >= STICK or (not known and kind in (REST_EVENT, STICK_EVENT))
        if k > 0:
            stops[k] = rows['stop'][k] if kind == IMPACT else stops[k - 1]
            force[k] = rows['impulse'][k] if kind == FORCE_STEP else force[k - 1]
        else:
            stops[k] = rows['stop'][k]
        if k == 0 or known or joins or kind in (IMPACT, RELEASE_EVENT, REVERSAL_EVENT):
            if doubtful and kind == REST_EVENT:
                for i in range(latest, k):
                    together[i] = True
            latest = k
            joint = joins
            doubtful = kind == IMPACT and not known
        together[k] = joint
    return len(rows)


@kernel
def write_flights(
    rows: Any,
    together: Any,
    stops: Any,
    force: Any,
    first: Any,
    angle: Any,
    start: float,
    constants: RigConstants,
    equations: Any,
    flights: Any,
) -> int:
    """
    Write equations of motion and columns of the flights between rows; return their number.

    Given are what `trace_flights` writes, the first harmonic and its angle after each row, and the
    time from which all harmonics count, s. The active force is no part of the equations.
    """
    share = constants.share
    mass = constants.damper_mass / constants.mass_ratio
    for k in range(len(equations)):
        flights[k, FLIGHT_ACTIVE] = force[k]
        flights[k, FLIGHT_BEGIN] = rows['time'][k] - start
        flights[k, FLIGHT_LINE] = first[k, 0]
        flights[k, FLIGHT_LINE + 1] = first[k, 1]
        flights[k, FLIGHT_LINE + 2] = angle[k] % _WHOLE_TURN + first[k, 2]
        if together[k]:
            equations[k, EQUATION_DECAY] = constants.joint.decay
            equations[k, EQUATION_DAMPED] = constants.joint.frequency
            equations[k, EQUATION_SQUARE] = constants.joint.omega_squared
            equations[k, EQUATION_PUSH] = share * constants.slope
            equations[k, EQUATION_SHARE] = (1.0 - share) / mass
            equations[k, EQUATION_SLIDE] = 0.0
            equations[k, EQUATION_MOVES] = 0.0
            continue
        relative = rows['damper_velocity_after'][k] - rows['primary_velocity_after'][k]
        if relative == 0.0:
            # Friction turns at rows alone; a release begins without velocity.
            relative = rows['y'][k + 1] - rows['y'][k]
        friction = 0.0
        if relative != 0.0:
            friction = constants.grip if relative > 0.0 else -constants.grip
        air = 0.0
        if stops[k] != 0:
            air = constants.air if stops[k] == 2 else -constants.air
        equations[k, EQUATION_DECAY] = constants.free.decay
        equations[k, EQUATION_DAMPED] = constants.free.frequency
        equations[k, EQUATION_SQUARE] = constants.free.omega_squared
        equations[k, EQUATION_PUSH] = constants.mass_ratio * (friction - air)
        equations[k, EQUATION_SHARE] = 1.0 / mass
        equations[k, EQUATION_SLIDE] = constants.slope - friction + air
        equations[k, EQUATION_MOVES] = 1.0
    return len(equations)


@kernel
def harmonic_at(flight: Any, lines: Any, j: int, since: float) -> tuple[float, float, float]:
    """Return size (N), frequency (rad/s) and phase of a harmonic some time into a flight, s."""
    if j == 0:
        rate = flight[FLIGHT_LINE + 1]
        return flight[FLIGHT_LINE], rate, flight[FLIGHT_LINE + 2] + rate * since
    rate = lines[j, LINE_RATE]
    phase = lines[j, LINE_PHASE] + rate * (flight[FLIGHT_BEGIN] + since)
    return lines[j, LINE_SIZE], rate, phase


@kernel
def write_series(
    equation: Any, flight: Any, lines: Any, series: Any, span: float, since: float
) -> None:
    """
    Write the terms of X and of the force in a piece, whose first two of X are known.

    The unit of time in the series is the duration of the piece, `span`, s. The piece begins
    `since` seconds after its flight.
    """
    for n in range(TERMS):
        series[_SERIES_FORCE, n] = 0.0
    for j in range(len(lines)):
        size, rate, phase = harmonic_at(flight, lines, j, since)
        turn = rate * span
        even = size * sin(phase)
        odd = size * cos(phase) * turn
        turn *= -turn
        for n in range(0, TERMS, 2):
            series[_SERIES_FORCE, n] += even
            series[_SERIES_FORCE, n + 1] += odd
            even *= turn * series[_SERIES_SHARE, n]
            odd *= turn * series[_SERIES_SHARE, n + 1]
    dashpot = 2.0 * equation[EQUATION_DECAY] * span
    spring = equation[EQUATION_SQUARE] * span * span
    push = equation[EQUATION_SHARE] * span * span
    constant = (
        (equation[EQUATION_PUSH] + equation[EQUATION_SHARE] * flight[FLIGHT_ACTIVE]) * span * span
    )
    before = series[_SERIES_X, 0]
    last = series[_SERIES_X, 1]
    for n in range(TERMS - 2):
        # Products that do not wait for the term before
        share = series[_SERIES_SHARE, n]
        rise = (push * series[_SERIES_FORCE, n] + constant) * share - spring * share * before
        constant = 0.0
        before = last
        last = rise - dashpot * (n + 1) * share * last
        series[_SERIES_X, n + 2] = last


@kernel
def sums_at(series: Any, place: float) -> tuple[float, float, float]:
    """Return X at a place in its piece, its derivative by the place, and the force."""
    x = 0.0
    slope = 0.0
    force = 0.0
    for k in range(TERMS):
        slope = slope * place + x
        x = x * place + series[_SERIES_X, TERMS - 1 - k]
        force = force * place + series[_SERIES_FORCE, TERMS - 1 - k]
    return x, slope, force


@kernel
def write_points(series: Any, at: Any) -> None:
    """Write what `sums_at` returns, at all Gauss points of a piece at once."""
    # The compiler takes several points at once: their numbers are parts of one array, so that it
    # knows them to be apart, and it does not know their count, so that it keeps the loop.
    count = len(at) // _NUMBERS_AT
    for k in range(AT_PLACE):
        at[k] = 0.0
    for n in range(TERMS):
        x = series[_SERIES_X, TERMS - 1 - n]
        force = series[_SERIES_FORCE, TERMS - 1 - n]
        for k in range(count):
            place = at[AT_PLACE + k]
            at[AT_SLOPE + k] = at[AT_SLOPE + k] * place + at[AT_X + k]
            at[AT_X + k] = at[AT_X + k] * place + x
            at[AT_FORCE + k] = at[AT_FORCE + k] * place + force


@kernel
def turning_size(series: Any, place: float) -> float:
    """Return the largest |X| at the turning point of a piece next to a place, and on the way."""
    largest = 0.0
    for _ in range(_NEWTON_STEPS):
        x, slope, _ = sums_at(series, place)
        largest = max(largest, abs(x))
        bend = 0.0
        for k in range(TERMS - 2):
            n = TERMS - 1 - k
            bend = bend * place + n * (n - 1) * series[_SERIES_X, n]
        if bend == 0.0:
            return largest
        before = place
        place = min(max(place - slope / bend, 0.0), 1.0)
        if place == before:
            return largest
    return largest


@kernel
def base_of_flight(
    flight: Any, lines: Any, since: float, stiffness: float, damping: float
) -> tuple[float, float, float]:
    """Return b, b' and b'' some time after a flight began (s), by the force K b + C b'."""
    base = 0.0
    speed = 0.0
    rate = 0.0
    for j in range(len(lines)):
        size, turn, phase = harmonic_at(flight, lines, j, since)
        dashpot = damping * turn
        size *= lines[j, LINE_OF_BASE] / (stiffness * stiffness + dashpot * dashpot)
        sine = size * sin(phase)
        cosine = size * cos(phase)
        here = stiffness * sine - dashpot * cosine
        base += here
        speed += turn * (stiffness * cosine + dashpot * sine)
        rate -= turn * turn * here
    return base, speed, rate


@kernel
def integrate_flights(
    rows: Any,
    equations: Any,
    flights: Any,
    lines: Any,
    at: Any,
    fastest: float,
    stiffness: float,
    damping: float,
    shaken: bool,
    series: Any,
    sums: Any,
) -> int:
    """
    Add the integrals over flights to the `sums`; return the number of flights.

    `fastest` is the circular frequency of the fastest oscillation, rad/s; the constants of spring
    and dashpot are in N/m and N s/m, and `shaken` is whether a base moves.
    """
    for i in range(len(flights)):
        equation = equations[i]
        flight = flights[i]
        length = rows['time'][i + 1] - rows['time'][i]
        pieces = max(1.0, ceil(length * fastest / _PIECE_ANGLE))
        span = length / pieces
        x = rows['x'][i]
        velocity = rows['primary_velocity_after'][i]
        if not length > 0.0:
            pieces = 0.0
        for piece in range(int(pieces)):
            since = piece * span
            series[_SERIES_X, 0] = x
            series[_SERIES_X, 1] = velocity * span
            write_series(equation, flight, lines, series, span, since)
            best = abs(x)
            place = 0.0
            sums[SUM_TIME] += span
            write_points(series, at)
            for k in range(_GAUSS):
                weight = at[AT_WEIGHT + k] * span
                here = at[AT_X + k]
                if abs(here) > best:
                    best = abs(here)
                    place = at[AT_PLACE + k]
                speed = at[AT_SLOPE + k] / span
                force = at[AT_FORCE + k] + flight[FLIGHT_ACTIVE]
                sums[SUM_X] += weight * here
                sums[SUM_SQUARES] += weight * here * here
                sums[SUM_FORCE] += weight * force * speed
                sums[SUM_ACTIVE] += weight * flight[FLIGHT_ACTIVE] * speed
                slip = speed
                if shaken:
                    base, base_speed, base_rate = base_of_flight(
                        flight, lines, since + at[AT_PLACE + k] * span, stiffness, damping
                    )
                    slip = speed - base_speed
                    # The motion of the base also changes the rate of the dashpot.
                    sums[SUM_FORCE] += weight * damping * (slip * slip - speed * speed)
                    rate = equation[EQUATION_PUSH] + equation[EQUATION_SHARE] * force
                    rate -= (
                        2.0 * equation[EQUATION_DECAY] * speed + equation[EQUATION_SQUARE] * here
                    )
                    sums[SUM_BASE] += weight * base
                    sums[SUM_BASE + 1] += weight * base * base
                    sums[SUM_BASE + 2] += weight * here * base
                    sums[SUM_BASE + 3] += weight * rate * rate
                    sums[SUM_BASE + 4] += weight * base_rate * base_rate
                sums[SUM_DASHPOT] += weight * damping * slip * slip
            x, slope, _ = sums_at(series, 1.0)
            velocity = slope / span
            if abs(x) > best:
                best = abs(x)
                place = 1.0
            sums[SUM_LARGEST] = max(sums[SUM_LARGEST], best)
            if best >= _NEAR_LARGEST * sums[SUM_LARGEST]:
                sums[SUM_LARGEST] = max(sums[SUM_LARGEST], turning_size(series, place))
    return len(flights)


@kernel
def chatter_time(rows: Any, start: float, end: float) -> float:
    """Add up the time from start to end that m spends in complete chatters."""
    total = 0.0
    # Impacts on one stop that follow one another ever faster: when the first and the last was
    first = last = 0.0
    apart = inf
    stop = 0
    cut = False
    for k in range(len(rows)):
        kind = rows['kind'][k]
        time = rows['time'][k]
        if kind in (REVERSAL_EVENT, CROSSING, STOP_ARRIVED):
            # They may fall within a chatter without ending it
            continue
        if kind != IMPACT:
            # A single impact is none, unless further ones are not resolved
            if kind == REST_EVENT and stop != 0 and (cut or first < last):
                total += max(0.0, min(time, end) - max(first, start))
            stop = 0
            continue
        if rows['stop'][k] != stop:
            first = time
            apart = inf
        else:
            if not time - last < apart:
                first = last
            apart = time - last
        last = time
        stop = rows['stop'][k]
        cut = rows['mode'][k] >= CHATTER_1
    return min(max(total, 0.0), end - start)
