# SPDX-License-Identifier: Apache-2.0
"""
The monodromy matrix of a periodic motion, in kernels.

Its eigenvalues are the multipliers. The matrix is the product of the matrices Phi of the flights,
which carry deviations by their free vibration, and of the saltation matrices of the nodes,

    S = D + (f+ - D f-) grad h / (grad h . f-),

where h is the condition of a node, D the derivative of the jump, and f the rate of the state just
before and just after the node [1]_.

References
----------
.. [1] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
"""

from __future__ import annotations

from impact_damper_ros.motion.event import IMPACT
from impact_damper_ros.motion.impact import bounce, rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import STICK

from .closed_flights import (
    FRAME,
    MATRIX,
    RATE_END,
    RATE_START,
    SIDE,
    Problem,
    restitution_at,
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
    jump, spare = FRAME + SIDE, FRAME + 2 * SIDE
    for i in range(4):
        for k in range(4):
            sheet[FRAME + i, k] = 1.0 if i == k else 0.0
    for b in range(count):
        j = (first + b) % count
        carry_through(problem, j, (j + 1) % count)
        for i in range(4):
            for k in range(4):
                total = 0.0
                for c in range(4):
                    total += table[j, MATRIX + 4 * i + c] * sheet[FRAME + c, k]
                sheet[spare + i, k] = total
        for i in range(4):
            for k in range(4):
                total = 0.0
                for c in range(4):
                    total += sheet[jump + i, c] * sheet[spare + c, k]
                sheet[FRAME + i, k] = total
    return size


@kernel
def carry_through(problem: Problem, j: int, after: int) -> None:
    """Write the matrix that carries deviations through the node after a flight, as a frame."""
    nodes, table, sheet = problem.nodes, problem.table, problem.sheet
    jump = FRAME + SIDE
    impact = nodes[after].kind == IMPACT
    for i in range(4):
        for k in range(4):
            sheet[jump + i, k] = 1.0 if i == k else 0.0
    if impact:
        constants = problem.moving.constants
        speed = abs(table[j, RATE_END + 2])
        _, slope = bounce(constants, restitution_at(problem, after), speed)
        slide, stay = rebound_slopes(constants.share, slope)
        sheet[jump + 1, 3] = slide
        sheet[jump + 3, 3] = stay
    normal = 2 if impact else 3
    across = table[j, RATE_END + normal]
    if across == 0.0:
        # Where m stuck or rested, a deviation does not move the instant.
        return
    for i in range(4):
        rise = table[after, RATE_START + i]
        for k in range(4):
            if k != normal:
                rise -= sheet[jump + i, k] * table[j, RATE_END + k]
        rise -= sheet[jump + i, normal] * across
        sheet[jump + i, normal] += rise / across
