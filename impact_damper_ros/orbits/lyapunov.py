# SPDX-License-Identifier: Apache-2.0
"""
The largest Lyapunov exponent of a run.

Each flight and event of a run has a matrix, as in `multipliers` [1]_, and the exponent is the mean
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
from math import inf, log, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import IMPACT, REST_EVENT, REVERSAL_EVENT, STICK_EVENT
from impact_damper_ros.motion.kernels import call_kernel, kernel
from impact_damper_ros.motion.state import STICK, RigConstants

from .closed_flights import write_flight_matrix
from .flight_arrays import Flights
from .flight_integrals import (
    EQUATION_DECAY,
    EQUATION_MOVES,
    EQUATION_PUSH,
    EQUATION_SHARE,
    EQUATION_SLIDE,
    EQUATION_SQUARE,
    FLIGHT_ACTIVE,
    harmonic_at,
)
from .flights import packed_constants
from .multipliers import U, V, X, Y, multiply_columns, write_saltation

Array = NDArray[np.float64]

#: Parts of a run whose mean growths are compared, for the uncertainty of the exponent.
BATCHES = 20
#: 97.5 % point of Student's distribution with BATCHES - 1 degrees of freedom.
_STUDENT = 2.093


@kernel
def carry_by_flight(
    constants: RigConstants, equation: Any, mode: int, span: float, matrix: Any, columns: Any
) -> None:
    """Carry deviations, a column each, through a flight."""
    moves = equation[EQUATION_MOVES]
    oscillator = constants.free if moves != 0.0 else constants.joint
    write_flight_matrix(oscillator, span, moves, matrix, 0)
    multiply_columns(matrix, 0, columns, 0, columns.shape[1])
    if mode > STICK:
        # m resting on a stop has no deviation.
        for c in range(columns.shape[1]):
            columns[Y, c] = 0.0


@kernel
def write_rates(
    equation: Any, share: float, force: float, x: float, velocity: float, damper: float, rates: Any
) -> None:
    """
    Write the rates of a state in a flight, given its equation and the force on M, N.

    In the rest of a chatter, whose impacts are not resolved, both have their common velocity.
    """
    moves = equation[EQUATION_MOVES]
    relative = damper - velocity
    if moves == 0.0:
        velocity += share * relative
    acceleration = equation[EQUATION_PUSH] + equation[EQUATION_SHARE] * force
    acceleration -= 2.0 * equation[EQUATION_DECAY] * velocity + equation[EQUATION_SQUARE] * x
    rates[X] = velocity
    rates[V] = acceleration
    rates[Y] = moves * relative
    rates[U] = moves * (equation[EQUATION_SLIDE] - acceleration)


@kernel
def scaled_down(columns: Any, rate: float) -> float:
    """
    Divide deviations by their size, and return its logarithm; -inf for the size 0.

    The size is that of (X, X', Z, Z'); `rate` (rad/s) makes displacements comparable with
    velocities.
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
    constants: RigConstants,
    rows: Any,
    equations: Any,
    flights: Any,
    lines: Any,
    start: float,
    ends: Any,
    rate: float,
    columns: Any,
    rates: Any,
    matrix: Any,
    growth: Any,
    products: Any,
) -> int:
    """
    Carry deviations through parts of a stretch, given their ends; write each, and its growth.

    The deviations are scaled to the size 1 (`scaled_down`), and `growth` is the logarithm of the
    factor.
    """
    now = start
    times, modes = rows['time'], rows['mode']
    k = 1
    while k < len(equations) and times[k] <= start:
        k += 1
    for part in range(len(ends)):
        growth[part] = 0.0
        while k < len(equations) and times[k] <= ends[part]:
            span = times[k] - now
            carry_by_flight(constants, equations[k - 1], modes[k - 1], span, matrix, columns)
            kind = rows['kind'][k]
            if kind in (IMPACT, REVERSAL_EVENT, STICK_EVENT, REST_EVENT):
                force = 0.0
                for j in range(len(lines)):
                    size, _, phase = harmonic_at(flights[k], lines, j, 0.0)
                    force += size * sin(phase)
                write_rates(
                    equations[k - 1],
                    constants.share,
                    force + flights[k - 1, FLIGHT_ACTIVE],
                    rows['x'][k],
                    rows['primary_velocity_before'][k],
                    rows['damper_velocity_before'][k],
                    rates[0],
                )
                write_rates(
                    equations[k],
                    constants.share,
                    force + flights[k, FLIGHT_ACTIVE],
                    rows['x'][k],
                    rows['primary_velocity_after'][k],
                    rows['damper_velocity_after'][k],
                    rates[1],
                )
                restitution = -1.0
                if kind == IMPACT:
                    restitution = (
                        constants.restitution_1
                        if rows['stop'][k] == 1
                        else constants.restitution_2
                    )
                    # A plastic impact, or the cut of a chatter, where all further impacts are one
                    restitution *= equations[k, EQUATION_MOVES]
                write_saltation(constants, restitution, rates[0], 0, rates[1], 0, matrix, 0)
                multiply_columns(matrix, 0, columns, 0, columns.shape[1])
            growth[part] += scaled_down(columns, rate)
            now = times[k]
            k += 1
        span = ends[part] - now
        carry_by_flight(constants, equations[k - 1], modes[k - 1], span, matrix, columns)
        growth[part] += scaled_down(columns, rate)
        now = ends[part]
        for i in range(4):
            for c in range(columns.shape[1]):
                products[part, i, c] = columns[i, c]
    return k


@dataclass(frozen=True)
class Exponent:
    """A largest Lyapunov exponent."""

    value: float  # mean rate of growth, 1/s
    uncertainty: float  # half of a 95 % interval, 1/s

    @property
    def standard_error(self) -> float:
        """Standard error of the mean growth of the parts, 1/s."""
        return self.uncertainty / _STUDENT


def _carry(
    flights: Flights, start: float, ends: Array, columns: Array, rate: float
) -> tuple[Array, Array]:
    """Return deviations at the ends of parts, scaled to 1, and the logarithms of growths."""
    growth, products = np.zeros(len(ends)), np.zeros((len(ends), *columns.shape))
    call_kernel(
        *(carry_deviations, packed_constants(flights.rig), flights.rows, flights.equations),
        *(flights.columns, flights.lines, start, ends, rate, columns, np.empty((2, 4))),
        *(np.empty(16), growth, products),
    )
    return products, growth


def monodromy_of(flights: Flights, start: float, end: float) -> Array:
    """
    Return the product of the matrices from one instant to another, s.

    The run, whose rows have modes and whose stops do not move, may begin before and end later.
    """
    products, growth = _carry(flights, start, np.array([end]), np.eye(4), 1.0)
    matrix: Array = products[0] * np.exp(growth[0])
    return matrix


def growth_exponent(flights: Flights, start: float, end: float) -> Exponent:
    """
    Return the largest Lyapunov exponent from the growth of one deviation in a stretch.

    The exponent is the mean growth of the logarithm over the last 20 of 21 parts of the stretch;
    in the first part the deviation turns into the direction that grows most. The uncertainty is
    half of the 95 % interval of the mean of these parts.
    """
    ends = np.linspace(start, end, BATCHES + 2)[1:]
    ends[-1] = end
    # Makes velocities comparable with displacements
    omega = flights.rig.omega
    # The deviation is neither symmetric nor along an axis, so that it has a part in every
    # direction.
    vector = np.array([0.6 / omega, 0.3, -0.5 / omega, 0.55])
    # Y and Y' are relative to X and X'..
    vector[[Y, U]] -= vector[[X, V]]
    _, growth = _carry(flights, start, ends, vector[:, None], omega)
    if growth.min() == -math.inf:
        return Exponent(-math.inf, 0.0)
    rates = growth[1:] / np.diff(ends)
    error = float(rates.std(ddof=1)) / math.sqrt(BATCHES)
    return Exponent(float(rates.mean()), _STUDENT * error)
