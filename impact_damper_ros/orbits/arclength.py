# SPDX-License-Identifier: Apache-2.0
"""
A curve of periodic motions, step by step, in kernels.

A point of the curve is corrected in the plane through a guess, with its tangent, and with the test
functions of special points there: the component of the tangent along the parameter, and

    det(1 + P),    det(1 - C(P)),    det(1 - P),

where P is the derivative of the state over a period and C(P) its second compound matrix, whose
eigenvalues are the products of two multipliers.

At a special point one of them changes sign, or the rig ceases to perform the motion. It is located
between two points, in planes across their chord.
"""

from __future__ import annotations

from math import copysign, inf, sqrt
from typing import Any

from impact_damper_ros.motion.kernels import kernel

from .closed_flights import (
    FRAME,
    GUESS,
    LENGTH,
    MARKS,
    NORMAL,
    PLACE,
    SIDE,
    TANGENT,
    UNITS,
    Problem,
    coordinates,
    swap_rows,
    vary,
)
from .multipliers import write_monodromy
from .newton import newton, write_tangent
from .viability import judge

#: Notes of a solution: its residual, relative to the displacements; the number of free coordinates
#: of its map of a period, 0 if that or the residual is too large; whether the rig can perform it;
#: its largest |X|; the test functions; and the map, row by row.
RESIDUAL, SIZE, VIABLE, X_MAX, FOLD, DOUBLING, TORUS, BRANCHING, MAP = range(9)
#: A row of a trace is a point of a curve: the notes; the test function that is zero there, or
#: `ORDINARY`, `BETWEEN` two such points, or `BEYOND` one where the rig no longer performs the
#: motion; the place along the chord; the parameter on both sides of the zero, and whether that is
#: located; then the unknowns with the parameter, and the unit tangent.
KIND, SHARE, NEARER, FARTHER, CONVERGED, COORDINATES = range(24, 30)
ORDINARY, BETWEEN, BEYOND = 0, 1, -1
#: Rows of a trace that are needed to find the special points between two others.
SPARE = 24
#: Residual at which the correction of a point ends, and largest residual of a point.
ENOUGH, MOST = 1e-15, 1e-11
#: Largest turn of the tangent in a step, growth of a step, and least step over the largest.
SHARPEST_TURN, GROWTH, LEAST_STEP = 0.95, 1.4, 1e-7
#: Error of a special point, as a share of the chord.
LOCATED = 1e-9
_MOST_LOOKS = 100
#: Reasons for the end of steps: no more room, the ends of the range, no motion nearby, and a
#: motion that the rig cannot perform.
ROOM, LOW_END, HIGH_END, LOST, NOT_VIABLE = range(5)


@kernel
def determinant(sheet: Any, first: int, count: int) -> float:
    """Return the determinant of a matrix that begins in a row, which is overwritten."""
    product = 1.0
    for k in range(count):
        pivot = k
        for i in range(k + 1, count):
            if abs(sheet[first + i, k]) > abs(sheet[first + pivot, k]):
                pivot = i
        if sheet[first + pivot, k] == 0.0:
            return 0.0
        if pivot != k:
            product = -product
            swap_rows(sheet, first + k, first + pivot, k, count)
        product *= sheet[first + k, k]
        for i in range(k + 1, count):
            factor = sheet[first + i, k] / sheet[first + k, k]
            for c in range(k + 1, count):
                sheet[first + i, c] -= factor * sheet[first + k, c]
    return product


@kernel
def shifted_determinant(sheet: Any, size: int, sign: float) -> float:
    """Return det(1 + sign P) of the map in the first frame."""
    for i in range(size):
        for k in range(size):
            there = sign * sheet[FRAME + i, k]
            sheet[FRAME + SIDE + i, k] = there + (1.0 if i == k else 0.0)
    return determinant(sheet, FRAME + SIDE, size)


@kernel
def compound_determinant(sheet: Any, size: int) -> float:
    """Return det(1 - C(P)) of the map in the first frame."""
    row = 0
    for i in range(size):
        for j in range(i + 1, size):
            column = 0
            for k in range(size):
                for c in range(k + 1, size):
                    minor = sheet[FRAME + i, k] * sheet[FRAME + j, c]
                    minor -= sheet[FRAME + i, c] * sheet[FRAME + j, k]
                    one = 1.0 if row == column else 0.0
                    sheet[FRAME + SIDE + row, column] = one - minor
                    column += 1
            row += 1
    return determinant(sheet, FRAME + SIDE, row)


@kernel
def note_solution(problem: Problem, least: float, most: float) -> bool:
    """Write the notes of the solution at the place; return whether it is one."""
    sheet = problem.sheet
    sheet[MARKS, RESIDUAL] = least
    sheet[MARKS, SIZE] = 0.0
    if not least <= most:
        return False
    size = write_monodromy(problem)
    total = 0.0
    for i in range(4):
        for k in range(4):
            inside = i < size and k < size
            sheet[MARKS, MAP + 4 * i + k] = sheet[FRAME + i, k] if inside else 0.0
            total += abs(sheet[MARKS, MAP + 4 * i + k])
    if not total < inf:
        return False
    viable, largest = judge(problem)
    sheet[MARKS, SIZE] = size
    sheet[MARKS, VIABLE] = 1.0 if viable else -1.0
    sheet[MARKS, X_MAX] = largest
    sheet[MARKS, DOUBLING] = shifted_determinant(sheet, size, 1.0)
    sheet[MARKS, TORUS] = compound_determinant(sheet, size)
    sheet[MARKS, BRANCHING] = shifted_determinant(sheet, size, -1.0)
    return True


@kernel
def solve_fixed(problem: Problem, enough: float, most: float) -> bool:
    """Solve the equations of a rig from the place; return whether there is a solution."""
    least = newton(problem, False, True, enough)
    length = problem.sheet[UNITS, LENGTH]
    displaced = length
    for j in range(len(problem.nodes)):
        displaced = max(displaced, abs(problem.table[j, 0]))
    return note_solution(problem, least * length / displaced, most)


@kernel
def correct(problem: Problem, in_order: bool, enough: float) -> bool:
    """Solve the equations in the plane through `GUESS`; return whether there is a solution."""
    sheet = problem.sheet
    count = coordinates(problem)
    for i in range(count):
        sheet[PLACE, i] = sheet[GUESS, i]
    vary(problem, sheet[PLACE, count - 1])
    least = newton(problem, True, in_order, enough)
    if not least <= MOST:
        sheet[MARKS, SIZE] = 0.0
        return False
    write_tangent(problem)
    sheet[MARKS, FOLD] = sheet[TANGENT, count - 1]
    return note_solution(problem, least, MOST)


@kernel
def write_point(problem: Problem, trace: Any, row: int) -> None:
    """Write the present point of a curve into a trace."""
    sheet = problem.sheet
    count = coordinates(problem)
    for i in range(KIND):
        trace[row, i] = sheet[MARKS, i]
    trace[row, KIND] = ORDINARY
    for i in range(count):
        trace[row, COORDINATES + i] = sheet[PLACE, i]
        trace[row, COORDINATES + count + i] = sheet[TANGENT, i]


@kernel
def copy_point(trace: Any, row: int, other: int) -> None:
    """Copy a row of a trace to another one."""
    for i in range(trace.shape[1]):
        trace[other, i] = trace[row, i]


@kernel
def turn_between(problem: Problem, trace: Any, row: int) -> float:
    """Return the cosine between the tangents of a row and of the present point."""
    total = 0.0
    count = coordinates(problem)
    for i in range(count):
        total += trace[row, COORDINATES + count + i] * problem.sheet[TANGENT, i]
    return total


@kernel
def aim(problem: Problem, trace: Any, row: int, step: float) -> None:
    """Set the plane across the tangent of a point, a step ahead."""
    count = coordinates(problem)
    for i in range(count):
        slope = trace[row, COORDINATES + count + i]
        problem.sheet[GUESS, i] = trace[row, COORDINATES + i] + step * slope
        problem.sheet[NORMAL, i] = slope


@kernel
def aim_at_value(problem: Problem, trace: Any, row: int, value: float) -> None:
    """Set the plane of a value of the parameter, where the tangent meets it."""
    sheet = problem.sheet
    count = coordinates(problem)
    last = count - 1
    slope = trace[row, COORDINATES + count + last]
    share = (value - trace[row, COORDINATES + last]) / slope
    for i in range(last):
        there = trace[row, COORDINATES + i]
        sheet[GUESS, i] = there + share * trace[row, COORDINATES + count + i]
        sheet[NORMAL, i] = 0.0
    sheet[GUESS, last] = value
    sheet[NORMAL, last] = copysign(1.0, slope)


@kernel
def aim_between(problem: Problem, trace: Any, row: int, end: int, share: float) -> None:
    """Set the plane across the chord of two points, at a share of the chord."""
    sheet = problem.sheet
    count = coordinates(problem)
    length = 0.0
    for i in range(count):
        way = trace[end, COORDINATES + i] - trace[row, COORDINATES + i]
        sheet[NORMAL, i] = way
        sheet[GUESS, i] = trace[row, COORDINATES + i] + share * way
        length += way * way
    for i in range(count):
        sheet[NORMAL, i] /= sqrt(length)


@kernel
def next_share(
    x_1: float, f_1: float, x_2: float, f_2: float, x_3: float, f_3: float, least: float
) -> float:
    """
    Return the next place to look for a zero, as a share of the way to the second of three places.

    It is found by inverse quadratic interpolation where that is safe, or half-way (Chandrupatla,
    1997).
    """
    part = 0.5
    if f_3 not in (f_1, f_2):
        xi, phi = (x_1 - x_2) / (x_3 - x_2), (f_1 - f_2) / (f_3 - f_2)
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            part = f_1 / (f_2 - f_1) * f_3 / (f_2 - f_3)
            part += (x_3 - x_1) / (x_2 - x_1) * f_1 / (f_3 - f_1) * f_2 / (f_3 - f_2)
    return min(max(part, least), 1.0 - least)


@kernel
def locate(problem: Problem, trace: Any, row: int, test: int, in_order: bool, place: int) -> None:
    """
    Write the point where a test function changes sign between two points into a row.

    Two brackets begin as these points, and come closer on either side of the zero. The point
    beyond follows in the next row.
    """
    sheet = problem.sheet
    value = COORDINATES + coordinates(problem) - 1
    near, far = place, place + 1
    copy_point(trace, row, near)
    copy_point(trace, row + 1, far)
    trace[near, SHARE], trace[far, SHARE] = 0.0, 1.0
    x_1, f_1, x_2, f_2 = 0.0, trace[row, test], 1.0, trace[row + 1, test]
    side = f_1 > 0.0
    part = 0.5
    converged = 0.0
    for _ in range(_MOST_LOOKS):
        share = x_1 + part * (x_2 - x_1)
        aim_between(problem, trace, row, row + 1, share)
        if not correct(problem, in_order, ENOUGH):
            break
        there = sheet[MARKS, test]
        reached = near if (there > 0.0) == side else far
        write_point(problem, trace, reached)
        trace[reached, SHARE] = share
        x_3, f_3 = x_1, f_1
        if (there > 0.0) != (f_1 > 0.0):
            x_3, f_3, x_2, f_2 = x_2, f_2, x_1, f_1
        x_1, f_1 = share, there
        least = LOCATED / abs(x_2 - x_1)
        if there == 0.0 or least > 0.5:
            converged = 1.0
            break
        part = next_share(x_1, f_1, x_2, f_2, x_3, f_3, least)
    nearer, farther = trace[near, value], trace[far, value]
    swapped = abs(trace[far, test]) < abs(trace[near, test])
    if test == VIABLE:
        swapped = trace[far, VIABLE] > 0.0
    if swapped:
        swap_rows(trace, near, far, 0, trace.shape[1])
    trace[near, KIND], trace[far, KIND] = test, BEYOND
    trace[near, NEARER], trace[near, FARTHER] = nearer, farther
    trace[near, CONVERGED] = converged


@kernel
def add_special_points(problem: Problem, trace: Any, row: int, in_order: bool) -> int:
    """
    Insert the special points between a point and the next one; return the new row of the latter.

    A further point is inserted between two of them, where the motion is of another kind than on
    both sides, and one beyond an end of viability.
    """
    last = len(trace) - SPARE
    fold = trace[row, FOLD] * trace[row + 1, FOLD] < 0.0
    count = 0
    for test in range(VIABLE, BRANCHING + 1):
        if test == X_MAX or not trace[row, test] * trace[row + 1, test] < 0.0:
            continue
        if test == BRANCHING and fold:
            continue
        locate(problem, trace, row, test, in_order, last + 2 * count)
        count += 1
    end = last + 2 * count
    copy_point(trace, row + 1, end)
    write = row + 1
    before = -1.0
    for _ in range(count):
        first = last
        for k in range(count):
            if trace[last + 2 * k, SHARE] < trace[first, SHARE]:
                first = last + 2 * k
        share = trace[first, SHARE]
        if before >= 0.0:
            aim_between(problem, trace, row, end, 0.5 * (before + share))
            if correct(problem, in_order, ENOUGH):
                write_point(problem, trace, write)
                trace[write, KIND] = BETWEEN
                write += 1
        before = share
        copy_point(trace, first, write)
        write += 1
        if trace[first, KIND] == VIABLE:
            copy_point(trace, first + 1, write)
            write += 1
        trace[first, SHARE] = inf
    copy_point(trace, end, write)
    return write


@kernel
def step_along(
    problem: Problem, trace: Any, in_order: bool, low: float, high: float
) -> tuple[int, int]:
    """
    Step along a curve from the first row of a trace; return why steps end, and the last row.

    Where the curve is not kept in order, a motion that the rig cannot perform ends it, in the last
    row. The present and the largest step are in the last row of the trace, and whether special
    points are added.
    """
    sheet = problem.sheet
    count = coordinates(problem)
    last = len(trace) - 1
    step, largest = trace[last, 0], trace[last, 1]
    adds = trace[last, 2] > 0.0
    value = COORDINATES + count - 1
    row = 0
    ended = ROOM
    while row + SPARE < len(trace) - SPARE:
        ahead = trace[row, value] + step * trace[row, value + count]
        edge = ROOM
        found = False
        if ahead < low or ahead > high:
            edge = LOW_END if ahead < low else HIGH_END
            aim_at_value(problem, trace, row, low if ahead < low else high)
            found = correct(problem, in_order, ENOUGH)
            found = found and turn_between(problem, trace, row) >= SHARPEST_TURN
        if not found:
            edge = ROOM
            aim(problem, trace, row, step)
            found = correct(problem, in_order, ENOUGH)
            found = found and turn_between(problem, trace, row) >= SHARPEST_TURN
            found = found and low <= sheet[PLACE, count - 1] <= high
        if not found:
            step *= 0.5
            if step < LEAST_STEP * largest:
                ended = LOST
                break
            continue
        ahead = 0.0
        for i in range(count):
            way = sheet[PLACE, i] - trace[row, COORDINATES + i]
            ahead += way * trace[row, COORDINATES + count + i]
        if edge != ROOM and ahead < LEAST_STEP * largest:
            # The curve begins at that end of the range.
            ended = edge
            break
        write_point(problem, trace, row + 1)
        if not in_order and sheet[MARKS, VIABLE] < 0.0:
            row += 1
            ended = NOT_VIABLE
            break
        row = add_special_points(problem, trace, row, in_order) if adds else row + 1
        if edge != ROOM:
            ended = edge
            break
        step = min(largest, GROWTH * step)
        if not adds:
            break
    trace[last, 0] = step
    return ended, row
