# SPDX-License-Identifier: Apache-2.0
"""All motions of impacts alone to which starts lead, each once, in a kernel."""

from __future__ import annotations

from math import floor, inf
from typing import Any

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import FIRST_LINE

from .arclength import KIND, solve_fixed
from .closed_flights import (
    COLUMNS,
    END,
    FULL_TURN,
    HISTORY,
    LENGTH,
    MARKS,
    PLACE,
    RIG,
    UNITS,
    Problem,
    coordinates,
)
from .newton import LEAST_RESIDUAL, NEWTON_STEPS, RESIDUAL_TOLERANCE

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
    for r in range(found):
        whole = FULL_TURN * floor((sheet[PLACE, 3] - rows[r, 3]) / FULL_TURN + 0.5)
        apart = 0.0
        for i in range(0, count, 4):
            size = max(1.0, abs(sheet[PLACE, i]))
            late = sheet[PLACE, i + 3] - rows[r, i + 3] - whole
            away = abs(sheet[PLACE, i] - rows[r, i]) / size
            apart = max(apart, away, abs(late) / FULL_TURN)
        if apart < tolerance:
            return True
    return False


@kernel
def write_root(problem: Problem, row: Any) -> None:
    """Write a root into a row: the place, the notes, the residuals on the way, and the flights."""
    sheet, table = problem.sheet, problem.table
    count = coordinates(problem) - 1
    for i in range(count):
        row[i] = sheet[PLACE, i]
    for i in range(KIND):
        row[count + i] = sheet[MARKS, i]
    count += KIND
    for i in range(NEWTON_STEPS + 1):
        row[count + i] = sheet[HISTORY, i]
    count += NEWTON_STEPS + 1
    for j in range(len(problem.nodes)):
        for k in range(COLUMNS):
            row[count + j * COLUMNS + k] = table[j, k]


@kernel
def find_roots(problem: Problem, rows: Any, first: int, found: int) -> int:
    """
    Write the roots to which starts lead into the first rows; return their number.

    Some of these are `found` already. The rows from the `first` one on are starts, with their
    residuals.
    """
    sheet = problem.sheet
    count = coordinates(problem) - 1
    for s in range(first, len(rows)):
        if not rows[s, count] < _CLOSE:
            continue
        for i in range(count):
            sheet[PLACE, i] = rows[s, i]
        if is_known(problem, rows, found, _NEAR_ROOT):
            continue
        if not solve_fixed(problem, LEAST_RESIDUAL, RESIDUAL_TOLERANCE) or not has_speeds(problem):
            continue
        if not is_known(problem, rows, found, _SAME_ROOT):
            write_root(problem, rows[found])
            found += 1
    return found
