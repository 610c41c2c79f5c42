# SPDX-License-Identifier: Apache-2.0
"""What Python asks of the kernels of periodic motions: one entry, and its tasks."""

from __future__ import annotations

from typing import Any

from impact_damper_ros.motion.kernels import kernel

from .arclength import add_special_points, correct, solve_fixed, step_along
from .closed_flights import RIG, Problem, set_rig
from .impact_equations import set_coefficients, write_linear_system, write_velocities
from .root_search import find_roots

#: Tasks of `compute`.
SOLVE, CORRECT, GO_ON, LOCATE, FIND_ROOTS, LINEAR_SYSTEM = range(6)


@kernel
def compute(
    problem: Problem, trace: Any, task: int, in_order: bool, one: float, other: float
) -> tuple[int, int]:
    """
    Carry out a task of Python, with all constants of the rig set anew.

    `SOLVE` and `CORRECT` take the residual that is enough, and the largest one, and return whether
    there is a solution. `GO_ON` takes a range, and returns why the steps end, and the last row.
    `LOCATE` adds the special points between the first two rows, and returns the last row.
    `FIND_ROOTS` takes a part of a scan, or zeros where the trace has the starts, and returns how
    many of these converged, and the number of roots. `LINEAR_SYSTEM` writes the linear equations
    of the instants at the place, or the velocities there.
    """
    set_rig(problem.moving.constants, problem.moving.lines, problem.sheet[RIG])
    if task == GO_ON:
        return step_along(problem, trace, in_order, one, other)
    if task == LOCATE:
        return 0, add_special_points(problem, trace, 0, in_order)
    if task == FIND_ROOTS:
        return find_roots(problem, trace, int(one), int(other))
    if task == LINEAR_SYSTEM:
        set_coefficients(problem)
        if one > 0.0:
            write_velocities(problem)
        else:
            write_linear_system(problem)
        return 0, 0
    if task == CORRECT:
        return 1 if correct(problem, in_order, one) else 0, 0
    return 1 if solve_fixed(problem, one, other) else 0, 0
