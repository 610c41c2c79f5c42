# SPDX-License-Identifier: Apache-2.0
"""
The largest Lyapunov exponent of a run.

`multipliers` gives a matrix for every flight and event of a run [1]_, and the exponent is the mean
growth of a deviation that is normalised again and again [2]_. The matrices do not include the
response of a gap control to a deviation: under control no exponent is measured.

References
----------
.. [1] P. C. Müller, Chaos Solitons Fractals 5, 1671-1681 (1995).
.. [2] T. S. Parker, L. O. Chua, Practical Numerical Algorithms for Chaotic Systems (1989).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import cos, expm1, inf, log, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.impact import bounce
from impact_damper_ros.motion.kernels import call_kernel, kernel
from impact_damper_ros.motion.state import STICK

from .flight_arrays import Flights
from .multipliers import FlightLaws, U, V, X, Y, event_matrices, jumps, velocities_of

Array = NDArray[np.float64]

#: Parts of a run whose mean growths are compared, for the uncertainty of the exponent.
BATCHES = 20
#: 97.5 % point of Student's distribution with BATCHES - 1 degrees of freedom.
_STUDENT = 2.093


@kernel
def carry_by_flight(law: Any, span: float, columns: Any) -> None:
    """Carry deviations, a column each, through a flight; its law is a row of `Deviations`."""
    decay, damped, stiffness, moves, holds = law
    less = expm1(-decay * span)
    half = 0.5 * damped * span
    envelope = 1.0 + less
    sine = sin(half)
    impulse = 2.0 * envelope * sine * cos(half) / damped
    fall = 2.0 * envelope * sine * sine
    slope = envelope - fall - decay * impulse
    less += decay * impulse - fall
    for c in range(columns.shape[1]):
        x = columns[X, c]
        v = columns[V, c]
        columns[X, c] = x + (less * x + impulse * v)
        columns[V, c] = slope * v - stiffness * impulse * x
        if moves != 0.0:
            rise = (span - impulse) * v - less * x
            columns[Y, c] += span * columns[U, c] + rise
            columns[U, c] += stiffness * impulse * x + (1.0 - slope) * v
        else:
            columns[U, c] = 0.0
        if holds != 0.0:
            # A stop leaves m no deviation
            columns[Y, c] = 0.0


@kernel
def carry_by_event(matrix: Any, columns: Any) -> None:
    """Multiply deviations by the matrix of an event."""
    for c in range(columns.shape[1]):
        x = columns[X, c]
        v = columns[V, c]
        y = columns[Y, c]
        u = columns[U, c]
        for i in range(4):
            columns[i, c] = (
                matrix[i, X] * x + matrix[i, V] * v + matrix[i, Y] * y + matrix[i, U] * u
            )


@kernel
def scaled_down(columns: Any, rate: float) -> float:
    """
    Divide deviations by their size, and return its logarithm; -inf if there is none left.

    It is that of (X, X', Z, Z'); `rate` (rad/s) makes displacements comparable with velocities.
    """
    size = 0.0
    for c in range(columns.shape[1]):
        x = columns[X, c]
        v = columns[V, c]
        z = x + columns[Y, c]
        w = v + columns[U, c]
        size += rate * rate * (x * x + z * z) + (v * v + w * w)
    if size == 0.0:
        return -inf
    size = sqrt(size)
    for i in range(4):
        for c in range(columns.shape[1]):
            columns[i, c] /= size
    return log(size)


@kernel
def carry_deviations(
    laws: Any,
    instants: Any,
    events: Any,
    start: float,
    ends: Any,
    anew: bool,
    rate: float,
    columns: Any,
    growth: Any,
    products: Any,
) -> int:
    """
    Carry deviations through parts of a stretch, given their ends; write each, and its growth.

    They are scaled to the size 1 (`scaled_down`), and `growth` is the logarithm of what they would
    be. They begin each part `anew` as unit vectors, or go on from the one before.
    """
    now = start
    k = 0
    for part in range(len(ends)):
        growth[part] = 0.0
        if anew:
            for i in range(4):
                for c in range(4):
                    columns[i, c] = 1.0 if i == c else 0.0
        while k < len(instants) and instants[k] <= ends[part]:
            carry_by_flight(laws[k], instants[k] - now, columns)
            carry_by_event(events[k], columns)
            growth[part] += scaled_down(columns, rate)
            now = instants[k]
            k += 1
        carry_by_flight(laws[k], ends[part] - now, columns)
        growth[part] += scaled_down(columns, rate)
        now = ends[part]
        for i in range(4):
            for c in range(columns.shape[1]):
                products[part, i, c] = columns[i, c]
    return k


@dataclass(frozen=True)
class Deviations:
    """What carries deviations of (X, X', Y, Y') through a part of a run."""

    start: float  # s
    end: float
    instants: Array  # of the events in it, s, shape (n,)
    events: Array  # their saltation matrices, shape (n, 4, 4)
    #: Of the flights before each event, and after the last: decay, frequency and stiffness of M,
    #: whether m moves by itself, and whether a stop holds it; shape (n + 1, 5).
    laws: Array

    def carry(
        self, ends: Array, columns: Array, rate: float, *, anew: bool = False
    ) -> tuple[Array, Array]:
        """Return deviations at the ends of parts, scaled to 1, and the logarithms of growths."""
        growth, products = np.zeros(len(ends)), np.zeros((len(ends), *columns.shape))
        arguments = self.start, ends, anew, rate, columns.copy(), growth, products
        call_kernel(carry_deviations, self.laws, self.instants, self.events, *arguments)
        return products, growth


@dataclass(frozen=True)
class Exponent:
    """A largest Lyapunov exponent."""

    value: float  # mean rate of growth, 1/s
    uncertainty: float  # half of a 95 % interval, 1/s

    @property
    def standard_error(self) -> float:
        """Standard error of the mean growth of the parts, 1/s."""
        return self.uncertainty / _STUDENT


def deviations(flights: Flights, start: float, end: float) -> Deviations:
    """
    Return the matrices of a stretch of a run from `start` to `end`, s.

    The run, whose rows have modes, may begin before the stretch and reach beyond it.
    """
    constants, laws, rows = flights.machine.constants, flights.laws, flights.rows
    events = rows[1:-1]
    time, kind, stop = events['time'], events['kind'], events['stop']
    impact = kind == EventKind.IMPACT
    modes, joint = rows['mode'][:-1], flights.together[:-1]
    push, force = flights.active[:-1] / flights.rig.primary_mass, flights.force(time)

    def rates(flight: slice, side: str) -> Array:
        """Return the rates of the state at the events, in the flights before or after them."""
        velocity, relative = velocities_of(events, side, joint[flight], constants.share)
        drive = (force + push[flight]) * np.where(joint[flight], 1.0 - constants.share, 1.0)
        along = FlightLaws(*(part[flight] for part in laws))
        return along.rates(events['x'], velocity, relative, drive)

    restitution = np.where(stop == 1, constants.restitution_1, constants.restitution_2)
    halts = np.isin(kind, (EventKind.REVERSAL, EventKind.STICK, EventKind.REST))
    # Plastic, or the cut of a chatter: all the impacts to come are one
    restitution = np.where(joint[1:], 0.0, restitution)
    approach = events['damper_velocity_before'] - events['primary_velocity_before']
    _, slope = bounce(constants, restitution, np.abs(approach))
    matrices = event_matrices(
        jumps(constants.share, impact, slope),
        impact,
        rates(slice(0, -1), 'before'),
        rates(slice(1, None), 'after'),
        impact | halts,
    )
    inside = (time > start) & (time <= end)
    first = int(np.count_nonzero(time <= start))
    part = slice(first, first + int(inside.sum()) + 1)
    return Deviations(
        start=start,
        end=end,
        instants=time[inside],
        events=matrices[inside],
        laws=np.column_stack([*laws[:3], laws.moves, modes > STICK])[part],
    )


def monodromy_of(along: Deviations, ends: Array) -> Array:
    """Return the product of the matrices over each part of a stretch, given the parts' ends, s."""
    products, growth = along.carry(ends, np.eye(4), 1.0, anew=True)
    return products * np.exp(growth)[:, None, None]


def growth_exponent(along: Deviations, omega: float) -> Exponent:
    """
    Return the largest Lyapunov exponent from the growth of one deviation.

    The mean growth of its logarithm over the last 20 of 21 parts of the stretch; in the first
    part the deviation turns into the direction that grows most. The uncertainty is half of the
    95 % interval of the mean of these parts. `omega` (rad/s) makes velocities comparable with
    displacements.
    """
    ends = np.linspace(along.start, along.end, BATCHES + 2)[1:]
    ends[-1] = along.end
    # Neither symmetric nor along an axis, so that it has a part in every direction
    vector = np.array([0.6 / omega, 0.3, -0.5 / omega, 0.55])
    # Y and Y' are relative to X and X'
    vector[[Y, U]] -= vector[[X, V]]
    _, growth = along.carry(ends, vector[:, None], omega)
    if growth.min() == -math.inf:
        return Exponent(-math.inf, 0.0)
    rates = growth[1:] / np.diff(ends)
    error = float(rates.std(ddof=1)) / math.sqrt(BATCHES)
    return Exponent(float(rates.mean()), _STUDENT * error)
