# SPDX-License-Identifier: Apache-2.0
"""All motions of impacts alone to which starts lead, each once, in kernels."""

from __future__ import annotations

from math import floor, inf
from typing import Any

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import FIRST_LINE

from .arclength import VIABLE, solve_fixed
from .closed_flights import END, LENGTH, MARKS, PLACE, RIG, UNITS, Problem, coordinates
from .impact_equations import HALF_TURN
from .newton import LEAST_RESIDUAL, RESIDUAL_TOLERANCE
from .start_scan import find_starts
from .variable_projection import REACHED, approach_roots

#: Residual of a start that may lead to a root.
_CLOSE = 1e-6
#: Distance of a start from a root to which it leads, and of two roots that are one.
_NEAR_ROOT, _SAME_ROOT = 1e-6, 1e-7
#: Speed of an impact that is none, over the largest of M.
_NO_SPEED = 1e-7


@kernel
def has_speeds(problem: Problem) -> bool:
    """Return whether all impacts have a speed; motion without impacts is a solution, too."""
    sheet, table = problem.sheet, problem.table
    fastest, slowest = sheet[UNITS, LENGTH] * sheet[RIG, FIRST_LINE + 1], inf
    for j in range(len(problem.nodes)):
        fastest = max(fastest, abs(table[j, END + 1]))
        slowest = min(slowest, abs(table[j, END + 3]))
    return bool(slowest > _NO_SPEED * fastest)


@kernel
def is_known(problem: Problem, rows: Any, found: int, tolerance: float) -> bool:
    """Return whether the place is a root that the rows have, up to whole cycles of the force."""
    sheet = problem.sheet
    count = coordinates(problem) - 1
    turn = 2.0 * HALF_TURN
    for r in range(found):
        whole = turn * floor((sheet[PLACE, 3] - rows[r, count + 3]) / turn + 0.5)
        apart = 0.0
        for i in range(0, count, 4):
            size = max(1.0, abs(sheet[PLACE, i]))
            late = sheet[PLACE, i + 3] - rows[r, count + i + 3] - whole
            apart = max(apart, abs(sheet[PLACE, i] - rows[r, count + i]) / size, abs(late) / turn)
        if apart < tolerance:
            return True
    return False


@kernel
def find_roots(problem: Problem, rows: Any, first: int, end: int) -> tuple[int, int]:
    """
    Write the starts that lead to roots into rows: start, root, and whether the rig can perform it.

    For one and two impacts `first` and `end` are a part of the scan of `find_starts`. Where both
    are 0 the rows begin with starts of given instants. The function returns how many of these
    converged, and the number of roots; or of starts, if there are too few rows.
    """
    sheet = problem.sheet
    count = coordinates(problem) - 1
    if end == 0:
        starts = approach_roots(problem, rows)
    else:
        starts = find_starts(problem, rows, first, end)
        if starts >= len(rows):
            return 0, starts
    converged = 0
    found = 0
    for s in range(starts):
        if end == 0:
            if rows[s, count] <= REACHED:
                converged += 1
            if not rows[s, count] < _CLOSE:
                continue
        for i in range(count):
            sheet[PLACE, i] = rows[s, i]
        if is_known(problem, rows, found, _NEAR_ROOT):
            continue
        if not solve_fixed(problem, LEAST_RESIDUAL, RESIDUAL_TOLERANCE) or not has_speeds(problem):
            continue
        if is_known(problem, rows, found, _SAME_ROOT):
            continue
        for i in range(count):
            rows[found, i] = rows[s, i]
            rows[found, count + i] = sheet[PLACE, i]
        rows[found, 2 * count] = sheet[MARKS, VIABLE]
        found += 1
    return converged, found
