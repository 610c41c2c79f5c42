# SPDX-License-Identifier: Apache-2.0
"""
All starts of motions with one or two impacts in a period, in kernels.

The linear part of the impact equations leaves, for fixed instants, vectors (X_1, .., X_N, C, S, W)
that satisfy it up to a factor; the force then requires C^2 + S^2 = W^2. For N = 1 these vectors
span a plane and the condition is a quadratic. For N = 2 they are one vector for each alpha_2, and
the condition is one equation for alpha_2: the paper's (16), in a form without poles. Where the
equations lose rank, as in the symmetric motion of a symmetric rig, it is a quadratic again. These
are all starts of one or two impacts; `variable_projection` searches for starts of more.
"""

from __future__ import annotations

from math import acos, atan2, cos, hypot, sin, sqrt
from typing import Any

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import FIRST_LINE

from .closed_flights import (
    AHEAD,
    BEHIND,
    BEST_DERIVATIVE,
    CYCLES,
    FULL_TURN,
    LEAD,
    LENGTH,
    PLACE,
    RIG,
    UNITS,
    VALUE,
    Problem,
    matrix_row,
    swap_rows,
)
from .impact_equations import write_linear_system, write_velocities

#: A smaller W, relative to the vector, counts as zero.
_VANISHING = 1e-12
#: Number of places of a scan that approach an end of the period.
_CLOSE_PLACES = 12
_BISECTIONS = 12
_NARROWINGS, _GOLDEN = 28, 0.6180339887498949


@kernel
def scale_system(problem: Problem, rows: int, columns: int) -> None:
    """Scale the rows to similar size, those of displacements to units of the length."""
    sheet = problem.sheet
    first = matrix_row(problem, BEST_DERIVATIVE)
    for i in range(first, first + rows):
        most = 0.0
        for k in range(columns):
            if k < columns - 3:
                sheet[i, k] *= sheet[UNITS, LENGTH]
            most = max(most, abs(sheet[i, k]))
        for k in range(columns):
            sheet[i, k] /= most


@kernel
def eliminate(problem: Problem, rows: int, columns: int) -> float:
    """Bring the matrix to triangular form, by the largest pivots; return their product."""
    sheet, order = problem.sheet, problem.places[LEAD]
    first = matrix_row(problem, BEST_DERIVATIVE)
    for k in range(columns):
        order[k] = k
    product: float = 1.0
    for k in range(rows):
        row, column = k, k
        for i in range(k, rows):
            for c in range(k, columns):
                most = abs(sheet[first + row, order[column]])
                if abs(sheet[first + i, order[c]]) > most:
                    row, column = i, c
        other = order[k]
        order[k] = order[column]
        order[column] = other
        swap_rows(sheet, first + k, first + row, 0, columns)
        product *= abs(sheet[first + k, order[k]])
        if product == 0.0:
            return product
        for i in range(k + 1, rows):
            factor = sheet[first + i, order[k]] / sheet[first + k, order[k]]
            for c in range(k, columns):
                sheet[first + i, order[c]] -= factor * sheet[first + k, order[c]]
    return product


@kernel
def write_null_vector(problem: Problem, rows: int, columns: int, free: int, vector: int) -> float:
    """
    Write the unit vector that solves the first rows, with one of the free entries alone.

    The result is the length of the vector where the free entry is 1.
    """
    sheet, order = problem.sheet, problem.places[LEAD]
    first = matrix_row(problem, BEST_DERIVATIVE)
    for k in range(rows, columns):
        sheet[vector, order[k]] = 1.0 if k == free else 0.0
    length = 1.0
    for b in range(rows):
        k = rows - 1 - b
        total = 0.0
        for c in range(k + 1, columns):
            total -= sheet[first + k, order[c]] * sheet[vector, order[c]]
        total /= sheet[first + k, order[k]]
        sheet[vector, order[k]] = total
        length += total * total
    length = sqrt(length)
    for k in range(columns):
        sheet[vector, k] /= length
    return length


@kernel
def add_start(problem: Problem, starts: Any, count: int, columns: int) -> int:
    """Add the start of the vector in `VALUE`, with W not zero; return the number of starts."""
    sheet = problem.sheet
    impacts = len(problem.nodes)
    size = 0.0
    for k in range(columns):
        size = max(size, abs(sheet[VALUE, k]))
    constant = sheet[VALUE, columns - 1]
    if not abs(constant) > _VANISHING * size:
        return count
    if count < len(starts):
        sine, cosine = sheet[VALUE, columns - 2] / constant, sheet[VALUE, columns - 3] / constant
        phase = atan2(sine, cosine) - sheet[RIG, FIRST_LINE + 2]
        for j in range(impacts):
            # The second half of a symmetric motion mirrors the first.
            x = sheet[VALUE, j] if j < columns - 3 else -sheet[VALUE, 0]
            sheet[PLACE, 4 * j] = x / constant
            sheet[PLACE, 4 * j + 3] += phase
        write_velocities(problem)
        for j in range(impacts):
            sheet[PLACE, 4 * j + 3] -= phase
        for i in range(4 * impacts):
            starts[count, i] = sheet[PLACE, i]
        for j in range(impacts):
            starts[count, 4 * j + 3] += phase
    return count + 1


@kernel
def add_starts_of_plane(problem: Problem, starts: Any, count: int, columns: int) -> int:
    """Add the starts whose vectors are in the plane of `AHEAD` and `BEHIND`: none, or two."""
    sheet = problem.sheet
    one, both, other = 0.0, 0.0, 0.0
    for k in range(columns - 3, columns):
        sign = -1.0 if k == columns - 1 else 1.0
        one += sign * sheet[AHEAD, k] * sheet[AHEAD, k]
        both += sign * sheet[AHEAD, k] * sheet[BEHIND, k]
        other += sign * sheet[BEHIND, k] * sheet[BEHIND, k]
    angle = 0.5 * atan2(2.0 * both, one - other)
    mean = 0.5 * (one + other)
    reach = hypot(0.5 * (one - other), both)
    # mean + reach cos 2(t - angle) = 0; a near miss counts as touching, Newton decides.
    if reach == 0.0 or abs(mean) > 1.0001 * reach:
        return count
    opening = 0.5 * acos(min(1.0, max(-1.0, -mean / reach)))
    for side in range(2):
        turn = angle + opening if side == 0 else angle - opening
        for k in range(columns):
            sheet[VALUE, k] = cos(turn) * sheet[AHEAD, k] + sin(turn) * sheet[BEHIND, k]
        count = add_start(problem, starts, count, columns)
    return count


@kernel
def add_starts_of_two_equations(problem: Problem, starts: Any) -> int:
    """Add all starts that solve the linear system of two equations in four unknowns."""
    scale_system(problem, 2, 4)
    if eliminate(problem, 2, 4) == 0.0:
        return 0
    write_null_vector(problem, 2, 4, 2, AHEAD)
    write_null_vector(problem, 2, 4, 3, BEHIND)
    return add_starts_of_plane(problem, starts, 0, 4)


@kernel
def add_starts_of_one(problem: Problem, starts: Any) -> int:
    """Add all starts of one impact in a period."""
    problem.sheet[PLACE, 3] = 0.0
    write_linear_system(problem)
    return add_starts_of_two_equations(problem, starts)


@kernel
def may_mirror(problem: Problem) -> bool:
    """Return whether the second half of a motion of two impacts may mirror the first."""
    nodes, constants = problem.nodes, problem.moving.constants
    balanced = constants.slope == 0.0 and constants.restitution_1 == constants.restitution_2
    # The force has changed sign half a period later
    turned = problem.sheet[UNITS, CYCLES] % 2.0 == 1.0
    return bool(balanced and turned and nodes[0].stop != nodes[1].stop)


@kernel
def add_symmetric_starts(problem: Problem, starts: Any) -> int:
    """Add the starts of two impacts whose second half mirrors the first, half a period later."""
    sheet = problem.sheet
    sheet[PLACE, 3] = 0.0
    sheet[PLACE, 7] = 0.5 * FULL_TURN * sheet[UNITS, CYCLES]
    first = write_linear_system(problem)
    for i in range(2):
        row = first + 2 * i
        for k in range(5):
            sheet[first + i, k] = sheet[row, k]
        sheet[first + i, 0] -= sheet[row, 1]
        for k in range(1, 4):
            sheet[first + i, k] = sheet[row, k + 1]
    return add_starts_of_two_equations(problem, starts)


@kernel
def look(problem: Problem, share: float) -> tuple[float, float]:
    """
    Return the condition C^2 + S^2 - W^2 of two impacts, and the product of the singular values.

    Both are taken at a share of the period; the vector is in `VALUE`.
    """
    sheet = problem.sheet
    sheet[PLACE, 3] = 0.0
    sheet[PLACE, 7] = share * FULL_TURN * sheet[UNITS, CYCLES]
    write_linear_system(problem)
    scale_system(problem, 4, 5)
    product = eliminate(problem, 4, 5)
    if product == 0.0:
        return 0.0, 0.0
    product *= write_null_vector(problem, 4, 5, 4, VALUE)
    condition = sheet[VALUE, 2] * sheet[VALUE, 2] + sheet[VALUE, 3] * sheet[VALUE, 3]
    return condition - sheet[VALUE, 4] * sheet[VALUE, 4], product


@kernel
def share_of(number: int, points: int) -> float:
    """Return a place of the scan as a share of the period; closer to each other at both ends."""
    inside = number - _CLOSE_PLACES
    if 0 <= inside < points:
        return (inside + 0.5) / points
    share = 0.5 / points
    for _ in range(-inside if inside < 0 else inside - points + 1):
        share *= 0.5
    return share if inside < 0 else 1.0 - share


@kernel
def add_between(problem: Problem, starts: Any, count: int, left: float, right: float) -> int:
    """Add the start at a change of sign of the condition."""
    positive = look(problem, left)[0] > 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (left + right)
        if (look(problem, middle)[0] > 0.0) == positive:
            left = middle
        else:
            right = middle
    look(problem, 0.5 * (left + right))
    return add_start(problem, starts, count, 5)


@kernel
def closeness(problem: Problem, share: float, rank: bool, positive: bool) -> float:
    """Return the product, or |condition|; a negative number where the condition changes sign."""
    condition, product = look(problem, share)
    if rank:
        return product
    return abs(condition) if (condition > 0.0) == positive else -1.0


@kernel
def add_closest(
    problem: Problem, starts: Any, count: int, left: float, right: float, rank: bool
) -> int:
    """
    Add the starts where |condition| is least, or the product: there the vectors are a plane.

    Where the condition changes sign on the way, there are two starts next to each other.
    """
    begin, end = left, right
    positive = look(problem, left)[0] > 0.0
    one, other = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
    size_one = closeness(problem, one, rank, positive)
    size_other = closeness(problem, other, rank, positive)
    for _ in range(_NARROWINGS):
        if size_one < 0.0 or size_other < 0.0:
            place = one if size_one < 0.0 else other
            count = add_between(problem, starts, count, begin, place)
            return add_between(problem, starts, count, place, end)
        if size_one < size_other:
            right, other, size_other = other, one, size_one
            one = right - _GOLDEN * (right - left)
            size_one = closeness(problem, one, rank, positive)
        else:
            left, one, size_one = one, other, size_other
            other = left + _GOLDEN * (right - left)
            size_other = closeness(problem, other, rank, positive)
    if not rank:
        look(problem, 0.5 * (left + right))
        return add_start(problem, starts, count, 5)
    look(problem, 0.5 * (left + right))
    write_null_vector(problem, 3, 5, 3, AHEAD)
    write_null_vector(problem, 3, 5, 4, BEHIND)
    return add_starts_of_plane(problem, starts, count, 5)


@kernel
def scan(problem: Problem, starts: Any, count: int, first: int, end: int, points: int) -> int:
    """
    Add the starts of two impacts in a part of the period; return the number of starts.

    The condition is scanned for changes of sign, and for minima of its modulus, which may hide two
    roots side by side or a double one. Where the linear equations nearly lose rank, the plane that
    they nearly leave is searched, too.
    """
    before, here = share_of(first, points), share_of(first + 1, points)
    one, rank_one = look(problem, before)
    two, rank_two = look(problem, here)
    for number in range(first + 2, end):
        ahead = share_of(number, points)
        three, rank_three = look(problem, ahead)
        if (number == first + 2 and (one > 0.0) != (two > 0.0)) and first == 0:
            count = add_between(problem, starts, count, before, here)
        if (two > 0.0) != (three > 0.0):
            count = add_between(problem, starts, count, here, ahead)
        elif (one > 0.0) == (two > 0.0) and abs(one) >= abs(two) and abs(two) <= abs(three):
            count = add_closest(problem, starts, count, before, ahead, False)
        if rank_one >= rank_two and rank_two <= rank_three:
            count = add_closest(problem, starts, count, before, ahead, True)
        before, one, rank_one = here, two, rank_two
        here, two, rank_two = ahead, three, rank_three
    return count


@kernel
def find_starts(problem: Problem, starts: Any, first: int, end: int) -> int:
    """
    Write starts into rows; return the number of starts, also if there are fewer rows.

    For one impact these are all starts; for two they are those in a part of a scan, whose number
    of points is in the last row, and those of symmetric motions, with the first part.
    """
    if len(problem.nodes) == 1:
        return add_starts_of_one(problem, starts)
    points = int(starts[len(starts) - 1, 0])
    count = 0
    if first == 0 and may_mirror(problem):
        count = add_symmetric_starts(problem, starts)
    return scan(problem, starts, count, first, end, points)
