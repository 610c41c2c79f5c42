# SPDX-License-Identifier: Apache-2.0
"""
The matrices that carry deviations through events and over a period, and the multipliers.

The state is (X, X', Y, Y'). A flight carries deviations at a fixed instant by its free vibration,
Phi. An event at a surface h = 0 carries them by its saltation matrix

    S = D + (f+ - D f-) grad h / (grad h . f-),

with D the derivative of the jump and f the rate of the state before and after [1]_ [2]_. The
monodromy matrix of a periodic motion is the product of these matrices over a period, and the
multipliers are its eigenvalues.

References
----------
.. [1] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
.. [2] M. H. Fredriksson, A. B. Nordmark, Proc. R. Soc. Lond. A 456, 315-331 (2000).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import IMPACT
from impact_damper_ros.motion.impact import bounce, rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import STICK, RigConstants
from impact_damper_ros.rig.run_result import Events

from .closed_flights import (
    FRAME,
    MATRIX,
    RATE_END,
    RATE_START,
    SIDE,
    Problem,
    restitution_at,
)
from .response import Array

X, V, Y, U = range(4)


def velocities_of(
    events: Events, side: str, joint: NDArray[np.bool_], share: float
) -> tuple[Array, Array]:
    """
    Return X' and Y' on one side of events, in flights that may be joint ones.

    In the rest of a chatter, whose impacts are not resolved, both move at their common velocity.
    """
    velocity = events[f'primary_velocity_{side}']
    relative = events[f'damper_velocity_{side}'] - velocity
    return (
        velocity + np.where(joint, share * relative, 0.0),
        np.where(joint, 0.0, relative),
    )


@kernel
def write_saltation(
    constants: RigConstants,
    restitution: float,
    before: Any,
    end: int,
    after: Any,
    start: int,
    matrix: Any,
    place: int,
) -> None:
    """
    Write the matrix that carries deviations through an event, row by row, from an index on.

    The rates of the state are those before, from the index `end` on, and after the event, from the
    index `start` on. `restitution` is the coefficient of an impact, and negative at other events,
    where the relative velocity becomes zero. A deviation does not move an event where m stuck or
    rested: its relative rates are zero there.
    """
    impact = restitution >= 0.0
    slide = 0.0
    stay = 1.0
    if impact:
        _, slope = bounce(constants, restitution, abs(before[end + Y]))
        slide, stay = rebound_slopes(constants.share, slope)
    normal = Y if impact else U
    across = before[end + normal]
    drop = before[end + U]
    for k in range(16):
        matrix[place + k] = 1.0 if k % 5 == 0 else 0.0
    matrix[place + 4 * V + U] = slide
    matrix[place + 4 * U + U] = stay
    for i in range(4):
        rate = before[end + i]
        if i == V:
            rate += slide * drop
        elif i == U:
            rate = stay * drop
        if across != 0.0:
            matrix[place + 4 * i + normal] += (after[start + i] - rate) / across


@kernel
def multiply_columns(matrix: Any, place: int, columns: Any, first: int, count: int) -> None:
    """Multiply columns of deviations, which begin in a row, by a matrix from an index on."""
    for c in range(count):
        x = columns[first, c]
        v = columns[first + 1, c]
        y = columns[first + 2, c]
        u = columns[first + 3, c]
        for i in range(4):
            k = place + 4 * i
            columns[first + i, c] = (
                matrix[k] * x + matrix[k + 1] * v + matrix[k + 2] * y + matrix[k + 3] * u
            )


@kernel
def write_monodromy(problem: Problem) -> int:
    """
    Write the derivative of the state after a node by itself, a period later, into the first frame.

    The node is that after which the state has the fewest free coordinates; the result is their
    number. They are the first coordinates: a state of sticking has no relative velocity, one of
    rest no displacement of m either.
    """
    nodes, table, sheet = problem.nodes, problem.table, problem.sheet
    count = len(nodes)
    first = 0
    size = 5
    for j in range(count):
        free = 4 if nodes[j].resting == 0 else 3 if nodes[j].resting == STICK else 2
        if free < size:
            size = free
            first = j
    jump = sheet[FRAME + SIDE]
    for i in range(4):
        for k in range(4):
            sheet[FRAME + i, k] = 1.0 if i == k else 0.0
    for b in range(count):
        j = (first + b) % count
        after = (j + 1) % count
        multiply_columns(table[j], MATRIX, sheet, FRAME, 4)
        restitution = restitution_at(problem, after) if nodes[after].kind == IMPACT else -1.0
        write_saltation(
            problem.moving.constants,
            restitution,
            table[j],
            RATE_END,
            table[after],
            RATE_START,
            jump,
            0,
        )
        multiply_columns(jump, 0, sheet, FRAME, 4)
    return size


def multipliers_of(matrix: Array) -> tuple[complex, ...]:
    """Return the eigenvalues, largest modulus first; of a pair, positive imaginary part first."""
    values = [complex(value) for value in np.linalg.eigvals(matrix)]
    return tuple(sorted(values, key=lambda v: (-round(abs(v), 12), -v.real, -v.imag)))
