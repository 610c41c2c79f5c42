# SPDX-License-Identifier: Apache-2.0
"""What Python asks of the kernels of periodic motions: one entry, and its tasks."""

from __future__ import annotations

from typing import Any

from impact_damper_ros.motion.kernels import kernel

from .arclength import add_special_points, correct, solve_fixed, step_along
from .closed_flights import RIG, Problem, set_rig
from .impact_equations import set_coefficients, write_linear_system
from .root_search import find_roots
from .start_scan import find_starts
from .variable_projection import approach_roots

#: Tasks of `compute`.
SOLVE, CORRECT, GO_ON, LOCATE, FIND_STARTS, APPROACH_ROOTS, FIND_ROOTS, LINEAR_SYSTEM = range(8)


@kernel
def compute(
    problem: Problem, trace: Any, task: int, in_order: bool, one: float, other: float
) -> tuple[int, int]:
    """
    Carry out a task of Python, with all constants of the rig set anew.

    `SOLVE` and `CORRECT` take the residual that is enough, and the largest one, and return whether
    there is a solution. `GO_ON` takes a range, and returns why the steps end, and the last row.
    `LOCATE` adds the special points between the first two rows, and returns the last row.
    `FIND_STARTS` takes a part of a scan, and returns the number of starts in the trace;
    `APPROACH_ROOTS` brings starts of given instants near roots. `FIND_ROOTS` takes the first row
    with a start and the number of roots before, and returns that after. `LINEAR_SYSTEM` writes the
    linear equations of the instants at the place.
    """
    set_rig(problem.moving.constants, problem.moving.lines, problem.sheet[RIG])
    if task == GO_ON:
        return step_along(problem, trace, in_order, one, other)
    if task == LOCATE:
        return 0, add_special_points(problem, trace, 0, in_order)
    if task == FIND_ROOTS:
        return 0, find_roots(problem, trace, int(one), int(other))
    if task >= FIND_STARTS:
        set_coefficients(problem)
    if task == FIND_STARTS:
        return 0, find_starts(problem, trace, int(one), int(other))
    if task == APPROACH_ROOTS:
        return 0, approach_roots(problem, trace)
    if task == LINEAR_SYSTEM:
        return 0, write_linear_system(problem)
    if task == CORRECT:
        return 1 if correct(problem, in_order, one) else 0, 0
    return 1 if solve_fixed(problem, one, other) else 0, 0
