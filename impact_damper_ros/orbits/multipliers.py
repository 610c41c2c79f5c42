# SPDX-License-Identifier: Apache-2.0
"""
Rates of the state in flights and at events, and the matrices that carry deviations.

The state is (X, X', Y, Y'). A flight carries deviations at a fixed instant by its free vibration.
An event at a surface h = 0 carries them by its saltation matrix

    S = D + (f+ - D f-) grad h / (grad h . f-),

with D the derivative of the jump and f the rate of the state before and after [1]_ [2]_.

References
----------
.. [1] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
.. [2] M. H. Fredriksson, A. B. Nordmark, Proc. R. Soc. Lond. A 456, 315-331 (2000).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import IMPACT, REST_EVENT, REVERSAL_EVENT, STICK_EVENT
from impact_damper_ros.motion.impact import bounce, rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import RigConstants
from impact_damper_ros.rig.run_result import Events

from .flight_integrals import (
    EQUATION_DECAY,
    EQUATION_MOVES,
    EQUATION_PUSH,
    EQUATION_SHARE,
    EQUATION_SLIDE,
    EQUATION_SQUARE,
)
from .response import Array

Mask = NDArray[np.bool_]
X, V, Y, U = range(4)


def velocities_of(events: Events, side: str, joint: Mask, share: float) -> tuple[Array, Array]:
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
def write_rates(
    equation: Any, side: Any, force: float, x: float, velocity: float, relative: float
) -> None:
    """Write the rates of a state in a flight, given its equation and the force on M, N."""
    acceleration = equation[EQUATION_PUSH] + equation[EQUATION_SHARE] * force
    acceleration -= 2.0 * equation[EQUATION_DECAY] * velocity + equation[EQUATION_SQUARE] * x
    side[X] = velocity
    side[V] = acceleration
    side[Y] = equation[EQUATION_MOVES] * relative
    side[U] = equation[EQUATION_MOVES] * (equation[EQUATION_SLIDE] - acceleration)


@kernel
def write_event_matrix(
    constants: RigConstants,
    rows: Any,
    k: int,
    equations: Any,
    force_before: float,
    force_after: float,
    matrix: Any,
) -> None:
    """
    Write the matrix that carries deviations through the event of a row.

    The forces act on M (N), and the equations are those of all flights. Rows of the matrix beyond
    the fourth are room for the rates before and after. At an event that is no impact, the relative
    velocity becomes zero. A deviation does not move an event whose time does not depend on the
    state, nor one where m stuck or rested: its relative acceleration is zero there.
    """
    kind = rows['kind'][k]
    impact = kind == IMPACT
    slide = 0.0
    stay = 1.0
    if impact:
        restitution = constants.restitution_1 if rows['stop'][k] == 1 else constants.restitution_2
        if equations[k, EQUATION_MOVES] == 0.0:
            # A plastic impact, or the cut of a chatter, where all further impacts count as one.
            restitution = 0.0
        approach = rows['damper_velocity_before'][k] - rows['primary_velocity_before'][k]
        _, slope = bounce(constants, restitution, abs(approach))
        slide, stay = rebound_slopes(constants.share, slope)
    for side in range(2):
        if side == 0:
            force = force_before
            velocity = rows['primary_velocity_before'][k]
            relative = rows['damper_velocity_before'][k] - velocity
        else:
            force = force_after
            velocity = rows['primary_velocity_after'][k]
            relative = rows['damper_velocity_after'][k] - velocity
        equation = equations[k - 1 + side]
        if equation[EQUATION_MOVES] == 0.0:
            # In the rest of a chatter, whose impacts are not resolved, both have one velocity.
            velocity += constants.share * relative
        write_rates(equation, matrix[4 + side], force, rows['x'][k], velocity, relative)
    before = matrix[4]
    after = matrix[5]
    normal = Y if impact else U
    crosses = impact or kind in (REVERSAL_EVENT, STICK_EVENT, REST_EVENT)
    for i in range(4):
        for j in range(4):
            matrix[i, j] = 1.0 if i == j else 0.0
    matrix[V, U] = slide
    matrix[U, U] = stay
    if crosses and before[normal] != 0.0:
        across = before[normal]
        drop = before[U]
        for i in range(4):
            rate = before[i]
            if i == V:
                rate += slide * drop
            elif i == U:
                rate = stay * drop
            matrix[i, normal] += (after[i] - rate) / across


def multipliers_of(matrix: Array) -> tuple[complex, ...]:
    """Return the eigenvalues, largest modulus first; of a pair, positive imaginary part first."""
    values = [complex(value) for value in np.linalg.eigvals(matrix)]
    return tuple(sorted(values, key=lambda v: (-round(abs(v), 12), -v.real, -v.imag)))
