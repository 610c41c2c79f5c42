# SPDX-License-Identifier: Apache-2.0
"""
Newton's method for the equations of a periodic motion, in kernels.

The unknowns of `closed_flights` are sought at a value of the parameter, or with the parameter as
another unknown in a plane across the curve of solutions, whose tangent follows.
"""

from __future__ import annotations

from math import inf, sqrt

from impact_damper_ros.motion.kernels import kernel

from .closed_flights import (
    AHEAD,
    BEHIND,
    BEST,
    BEST_DERIVATIVE,
    DERIVATIVE,
    GUESS,
    HISTORY,
    INSTANT,
    LEAD,
    NORMAL,
    PLACE,
    SPACE,
    SPAN,
    STEP,
    TANGENT,
    UNKNOWN_OF,
    VALUE,
    Problem,
    coordinates,
    fly_all,
    matrix_row,
    swap_rows,
    unit_of_unknown,
    vary,
    write_equations,
)

#: Most steps of Newton's method.
NEWTON_STEPS = 40
#: A residual that is as small as round-off allows, and the largest one of a solution; just beyond
#: a fold the least residual is not zero.
LEAST_RESIDUAL, RESIDUAL_TOLERANCE = 4e-16, 1e-12
#: A residual that may fail to fall by round-off only.
_SETTLED = 1e-13
#: Least share of a duration that a step leaves.
_SHORTEST_SHARE = 0.2
#: Smaller pivots, relative to the first one, show dependent equations.
_DEPENDENT = 1e-14
#: Change of a parameter by which equations are differentiated.
_CHANGE, _LEAST_CHANGE = 1e-6, 1e-9


@kernel
def solve_linear(problem: Problem, count: int, solution: int) -> None:
    """
    Solve linear equations, of which `SPACE` and `VALUE` have copies, into a row.

    Unknowns that the equations leave open are zero. Most entries of a long motion are zero, and a
    row with zero in a column is skipped.
    """
    sheet, lead = problem.sheet, problem.places[LEAD]
    first = matrix_row(problem, SPACE)
    scale = 0.0
    row = 0
    for k in range(count):
        pivot = row
        for i in range(row + 1, count):
            if abs(sheet[first + i, k]) > abs(sheet[first + pivot, k]):
                pivot = i
        lead[k] = -1
        if row == count or not abs(sheet[first + pivot, k]) > _DEPENDENT * scale:
            continue
        scale = max(scale, abs(sheet[first + pivot, k]))
        if pivot != row:
            swap_rows(sheet, first + row, first + pivot, k, count)
            upper = sheet[VALUE, row]
            sheet[VALUE, row] = sheet[VALUE, pivot]
            sheet[VALUE, pivot] = upper
        for i in range(row + 1, count):
            if sheet[first + i, k] != 0.0:
                factor = sheet[first + i, k] / sheet[first + row, k]
                for c in range(k + 1, count):
                    sheet[first + i, c] -= factor * sheet[first + row, c]
                sheet[VALUE, i] -= factor * sheet[VALUE, row]
        lead[k] = row
        row += 1
    for b in range(count):
        k = count - 1 - b
        sheet[solution, k] = 0.0
        row = lead[k]
        if row >= 0:
            total = sheet[VALUE, row]
            for c in range(k + 1, count):
                total -= sheet[first + row, c] * sheet[solution, c]
            sheet[solution, k] = total / sheet[first + row, k]


@kernel
def longest_part(problem: Problem) -> float:
    """Return the largest part of a step, at most 1, that keeps every duration positive."""
    table, sheet = problem.table, problem.sheet
    count = len(problem.nodes)
    numbers = problem.places[UNKNOWN_OF]
    unit = unit_of_unknown(problem, INSTANT)
    part = 1.0
    for j in range(count):
        later = sheet[STEP, numbers[5 * ((j + 1) % count) + INSTANT]]
        change = (later - sheet[STEP, numbers[5 * j + INSTANT]]) * unit
        if change < 0.0:
            part = min(part, -(1.0 - _SHORTEST_SHARE) * table[j, SPAN] / change)
    return part


@kernel
def add_parameter(problem: Problem) -> None:
    """Add the derivative by the parameter, and the plane of the place, to the equations."""
    sheet = problem.sheet
    first = matrix_row(problem, DERIVATIVE)
    last = coordinates(problem) - 1
    here = sheet[PLACE, last]
    change = max(_CHANGE * abs(here), _LEAST_CHANGE)
    for side in range(2):
        vary(problem, here + change if side == 0 else here - change)
        write_equations(problem, False)
        for i in range(last):
            sheet[AHEAD + side, i] = sheet[VALUE, i]
    vary(problem, here)
    write_equations(problem, True)
    missed = 0.0
    for i in range(last + 1):
        sheet[first + last, i] = sheet[NORMAL, i]
        missed += sheet[NORMAL, i] * (sheet[PLACE, i] - sheet[GUESS, i])
        if i < last:
            sheet[first + i, last] = (sheet[AHEAD, i] - sheet[BEHIND, i]) / (2.0 * change)
    sheet[VALUE, last] = missed


@kernel
def newton(problem: Problem, in_plane: bool, in_order: bool, enough: float) -> float:
    """
    Run Newton's method from the place until the residual no longer falls; return the least.

    The place becomes that of the least residual, with its flights, and its derivative in
    `BEST_DERIVATIVE`. `in_plane` has the parameter as another unknown, and the plane through
    `GUESS` as another equation; `in_order` keeps every duration positive. A residual below
    `enough` ends it.
    """
    sheet = problem.sheet
    size = coordinates(problem)
    jacobian, space = matrix_row(problem, DERIVATIVE), matrix_row(problem, SPACE)
    best = matrix_row(problem, BEST_DERIVATIVE)
    count = size if in_plane else size - 1
    least = inf
    stalled = 0
    steps = 0
    while steps < NEWTON_STEPS:
        if in_plane:
            add_parameter(problem)
        else:
            write_equations(problem, True)
        residual = 0.0
        total = 0.0
        for i in range(count):
            residual = max(residual, abs(sheet[VALUE, i]))
            total += sheet[VALUE, i]
            for k in range(count):
                sheet[space + i, k] = sheet[jacobian + i, k]
                total += sheet[jacobian + i, k]
        shortest = inf
        for j in range(len(problem.nodes)):
            shortest = min(shortest, problem.table[j, SPAN])
        if not abs(total) < inf or (in_order and shortest <= 0.0):
            break
        sheet[HISTORY, steps] = residual
        steps += 1
        stalled = 0 if residual < 0.5 * least else stalled + 1
        if residual < least:
            least = residual
            for i in range(size):
                sheet[BEST, i] = sheet[PLACE, i]
                for k in range(count):
                    sheet[best + i, k] = sheet[jacobian + i, k]
        if residual < enough or stalled >= (3 if least > _SETTLED else 1):
            break
        solve_linear(problem, count, STEP)
        for i in range(count):
            sheet[STEP, i] = -sheet[STEP, i]
        part = longest_part(problem) if in_order else 1.0
        for i in range(count):
            sheet[PLACE, i] += part * sheet[STEP, i]
    sheet[HISTORY, steps] = -1.0
    if least < inf:
        for i in range(size):
            sheet[PLACE, i] = sheet[BEST, i]
        if in_plane:
            vary(problem, sheet[PLACE, size - 1])
        fly_all(problem)
    return least


@kernel
def write_tangent(problem: Problem) -> None:
    """Write the unit tangent of the curve at the best place, along the normal of its plane."""
    sheet = problem.sheet
    count = coordinates(problem)
    space, best = matrix_row(problem, SPACE), matrix_row(problem, BEST_DERIVATIVE)
    for i in range(count):
        sheet[VALUE, i] = 0.0
        for k in range(count):
            sheet[space + i, k] = sheet[best + i, k]
    sheet[VALUE, count - 1] = 1.0
    solve_linear(problem, count, TANGENT)
    length = 0.0
    for i in range(count):
        length += sheet[TANGENT, i] * sheet[TANGENT, i]
    for i in range(count):
        sheet[TANGENT, i] /= sqrt(length)
