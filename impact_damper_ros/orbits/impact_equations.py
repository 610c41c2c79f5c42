# SPDX-License-Identifier: Apache-2.0
"""
Starts of the boundary-value problem, from the equations of N impacts in k cycles of the force.

Bapat (1995), equations (3)-(15), derived again. Between impacts the damper mass has constant
acceleration, so that the displacements X_i and instants t_i of the impacts give its velocities;
momentum and a constant restitution then give those of the primary mass before and after each
impact; and its closed-form flight must lead from each impact to the next. These are 2N equations.
For fixed instants they are linear in X_1 .. X_N and in the cosine and sine of the force's phase at
the first impact: an N-impact motion has only N-1 non-linear unknowns.

The linear part leaves, for fixed instants, vectors (X_1, .., X_N, C, S, W) that satisfy it up to a
factor; the force then asks for C^2 + S^2 = W^2. For N = 1 these vectors span a plane and the
condition is a quadratic. For N = 2 they are one vector for each alpha_2, and the condition is one
equation for alpha_2: the paper's (16), in a form without poles. Where the equations lose rank, as
in the symmetric motion of a symmetric rig, it is a quadratic again. These are all starts that
there are; for more impacts there are many systematic ones.
"""

from __future__ import annotations

from math import acos, atan2, cos, hypot, inf, sin, sqrt
from typing import Any

from impact_damper_ros.motion.impact import rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import FIRST_LINE, MASS, STIFFNESS

from .closed_flights import (
    AHEAD,
    BEHIND,
    BEST,
    BEST_DERIVATIVE,
    CYCLES,
    DERIVATIVE,
    END,
    FROM_AFTER,
    HALF,
    INSTANT,
    LEAD,
    LENGTH,
    MATRIX,
    PLACE,
    RIG,
    SLIDE,
    SPACE,
    SPAN,
    STEP,
    UNITS,
    VALUE,
    WAY,
    Problem,
    coordinates,
    fly,
    longest_part,
    matrix_row,
    restitution_at,
    solve_linear,
    spread,
    unit_of_unknown,
    write_equations,
)

#: Residual of a start that has converged; Newton's method does the rest.
REACHED = 1e-10
_MOST_STEPS = 40
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-11, 1e5
_DIVERGED = 1e12
_HALF_TURN = 3.141592653589793
#: A W that is smaller, relative to the vector, is none.
_VANISHING = 1e-12
#: Places of a scan that come ever closer to an end of the period.
_CLOSE_PLACES = 12
_BISECTIONS = 12
_NARROWINGS, _GOLDEN = 28, 0.6180339887498949


@kernel
def set_laws(problem: Problem) -> None:
    """Write what the equations ask for of each impact into its row, for a constant R."""
    nodes, table, constants = problem.nodes, problem.table, problem.moving.constants
    for j in range(len(nodes)):
        after = nodes[(j + 1) % len(nodes)].stop
        # The paper's lambda of the flight after it; 0 if that returns to the same stop
        direction = nodes[j].stop - after
        air = -constants.air if nodes[j].stop == 1 else constants.air
        friction = direction * constants.grip
        slide, stay = rebound_slopes(constants.share, restitution_at(problem, j))
        table[j, WAY] = 2.0 * constants.half_gap * direction if not constants.one_sided else 0.0
        table[j, HALF] = 0.5 * (constants.slope - friction + air)
        table[j, FROM_AFTER] = 1.0 / (1.0 - slide - stay)
        table[j, SLIDE] = slide


@kernel
def write_velocities(problem: Problem) -> None:
    """Let the velocities at the place be those that displacements and instants ask for."""
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    spread(problem)
    speed = unit_of_unknown(problem, 1)
    for j in range(count):
        last, after = (j - 1 if j > 0 else count - 1), (j + 1) % count
        span = table[j, SPAN]
        damper = (table[after, 0] - table[j, 0] + table[j, WAY]) / span - table[j, HALF] * span
        span = table[last, SPAN]
        arriving = (table[j, 0] - table[last, 0] + table[last, WAY]) / span
        arriving += table[last, HALF] * span
        before = arriving + table[j, FROM_AFTER] * (damper - arriving)
        velocity = before + table[j, SLIDE] * (arriving - before)
        sheet[PLACE, 4 * j + 1] = velocity / speed
        sheet[PLACE, 4 * j + 2] = (damper - velocity) / speed


@kernel
def add_velocity(problem: Problem, row: int, j: int, factor: float, after: bool) -> None:
    """Add the velocity of M before or after an impact to a row of the linear equations."""
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    last, late = (j - 1 if j > 0 else count - 1), (j + 1) % count
    leaving, arriving = table[j, FROM_AFTER], 1.0 - table[j, FROM_AFTER]
    if after:
        leaving *= 1.0 - table[j, SLIDE]
        arriving = 1.0 - leaving
    span = table[j, SPAN]
    part = factor * leaving
    sheet[row, late] += part / span
    sheet[row, j] -= part / span
    sheet[row, count + 2] += part * (table[j, WAY] / span - table[j, HALF] * span)
    span = table[last, SPAN]
    part = factor * arriving
    sheet[row, j] += part / span
    sheet[row, last] -= part / span
    sheet[row, count + 2] += part * (table[last, WAY] / span + table[last, HALF] * span)


@kernel
def fly_from_rest(problem: Problem, j: int, turned: float) -> tuple[float, float]:
    """Return X and X' at the end of a flight from rest, the force turned at the first impact."""
    row = problem.table[j]
    instant = row[INSTANT]
    for k in range(4):
        row[k] = 0.0
    sheet = problem.sheet
    row[INSTANT] = instant - problem.table[0, INSTANT] if j > 0 else 0.0
    row[INSTANT] += (turned - sheet[RIG, FIRST_LINE + 2]) / sheet[RIG, FIRST_LINE + 1]
    fly(problem.moving, problem.nodes[j], row)
    row[INSTANT] = instant
    return float(row[END]), float(row[END + 1])


@kernel
def write_linear_system(problem: Problem) -> int:
    """
    Write the equations for the instants at the place as a matrix; return its first row.

    Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of the
    force's phase at the first impact; displacements first, then velocities over the natural
    frequency.
    """
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    first = matrix_row(problem, BEST_DERIVATIVE)
    spread(problem)
    rate = sqrt(sheet[RIG, STIFFNESS] / sheet[RIG, MASS])
    for i in range(2 * count):
        for k in range(count + 3):
            sheet[first + i, k] = 0.0
    for j in range(count):
        ahead_x, ahead_v = fly_from_rest(problem, j, 0.0)
        aside_x, aside_v = fly_from_rest(problem, j, 0.5 * _HALF_TURN)
        back_x, back_v = fly_from_rest(problem, j, _HALF_TURN)
        late = (j + 1) % count
        for k in range(2):
            row = first + j + k * count
            scale = 1.0 if k == 0 else 1.0 / rate
            ahead, aside, back = ahead_x, aside_x, back_x
            if k == 0:
                sheet[row, late] += 1.0
            else:
                ahead, aside, back = ahead_v, aside_v, back_v
                add_velocity(problem, row, late, scale, False)
            constant = 0.5 * (ahead + back)
            sheet[row, j] -= scale * table[j, MATRIX + 4 * k]
            sheet[row, count] -= scale * 0.5 * (ahead - back)
            sheet[row, count + 1] -= scale * (aside - constant)
            sheet[row, count + 2] -= scale * constant
            add_velocity(problem, row, j, -scale * table[j, MATRIX + 4 * k + 1], True)
    return first


@kernel
def scale_system(problem: Problem, rows: int, columns: int) -> None:
    """Let the rows be of similar size, and those of displacements in units of the length."""
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
        for c in range(columns):
            upper = sheet[first + k, c]
            sheet[first + k, c] = sheet[first + row, c]
            sheet[first + row, c] = upper
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
    Write the unit vector that the first rows leave, without all free entries but one.

    Returned is its length where the free entry is 1.
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
    """Add the start of the vector in `VALUE`, with W not zero; return how many there are."""
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
            # The second half of a symmetric motion mirrors the first
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
def add_symmetric_starts(problem: Problem, starts: Any) -> int:
    """
    Add the starts of two impacts whose second half mirrors the first, half a period later.

    The rig must be symmetric, and the force have changed sign by then.
    """
    sheet = problem.sheet
    sheet[PLACE, 3] = 0.0
    sheet[PLACE, 7] = 0.5 * _HALF_TURN * 2.0 * sheet[UNITS, CYCLES]
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

    At a share of the period; the vector is in `VALUE`.
    """
    sheet = problem.sheet
    sheet[PLACE, 3] = 0.0
    sheet[PLACE, 7] = share * 2.0 * _HALF_TURN * sheet[UNITS, CYCLES]
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
    """Return the product, or |condition|; a negative number where that has another sign."""
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

    Where the condition changes sign on the way, there are two next to each other.
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
def scan(problem: Problem, starts: Any, first: int, end: int, points: int) -> int:
    """
    Add the starts of two impacts in a part of the period; return how many there are.

    The condition is scanned for changes of sign, and for minima of its modulus, which may hide two
    roots side by side or a double one. Where the linear equations come close to losing rank, the
    plane they nearly leave is searched too.
    """
    count = 0
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
def complete_start(problem: Problem) -> None:
    """Let the displacements at the place solve the equations at its instants best."""
    sheet = problem.sheet
    count = len(problem.nodes)
    first, space = write_linear_system(problem), matrix_row(problem, SPACE)
    phase = sheet[PLACE, 3] + sheet[RIG, FIRST_LINE + 2]
    for i in range(count):
        sheet[VALUE, i] = 0.0
        for k in range(count):
            sheet[space + i, k] = 1e-12 if i == k else 0.0
    for row in range(first, first + 2 * count):
        target = -sheet[row, count] * cos(phase) - sheet[row, count + 1] * sin(phase)
        target -= sheet[row, count + 2]
        for i in range(count):
            sheet[VALUE, i] += sheet[row, i] * target
            for k in range(count):
                sheet[space + i, k] += sheet[row, i] * sheet[row, k]
    solve_linear(problem, count, STEP)
    for j in range(count):
        sheet[PLACE, 4 * j] = sheet[STEP, j] / sheet[UNITS, LENGTH]
    write_velocities(problem)


@kernel
def keep(problem: Problem, count: int) -> float:
    """Keep the place, its residual and its derivative; return the sum of the squares."""
    sheet = problem.sheet
    best, jacobian = matrix_row(problem, BEST_DERIVATIVE), matrix_row(problem, DERIVATIVE)
    cost = 0.0
    for i in range(count):
        sheet[BEST, i] = sheet[PLACE, i]
        sheet[AHEAD, i] = sheet[VALUE, i]
        cost += sheet[VALUE, i] * sheet[VALUE, i]
        for k in range(count):
            sheet[best + i, k] = sheet[jacobian + i, k]
    return cost


@kernel
def write_damped_step(problem: Problem, damping: float, count: int) -> None:
    """Write the step of damped least squares from what is kept."""
    sheet = problem.sheet
    best, space = matrix_row(problem, BEST_DERIVATIVE), matrix_row(problem, SPACE)
    size = 0.0
    for i in range(count):
        sheet[VALUE, i] = 0.0
        for k in range(count):
            sheet[VALUE, i] -= sheet[best + k, i] * sheet[AHEAD, k]
            sheet[space + i, k] = 0.0
    # Row by row, as most entries of a long motion are zero
    for row in range(best, best + count):
        for i in range(count):
            entry = sheet[row, i]
            if entry != 0.0:
                size += entry * entry
                for k in range(count):
                    sheet[space + i, k] += entry * sheet[row, k]
    for i in range(count):
        sheet[space + i, i] += damping * size / count
    solve_linear(problem, count, STEP)


@kernel
def approach(problem: Problem) -> float:
    """
    Bring a start close to a root by damped least squares (Levenberg and Marquardt).

    After each step the velocities are those that the impact equations have at its displacements
    and instants, which saves a third of the steps. Returned is the largest residual.
    """
    sheet = problem.sheet
    count = coordinates(problem) - 1
    write_equations(problem, True)
    cost = keep(problem, count)
    damping = _DAMPING
    steps = 0
    # A start that has diverged, to two impacts at once, or is stuck is dropped.
    while steps < _MOST_STEPS and REACHED * REACHED < cost < _DIVERGED and damping < _MOST_DAMPING:
        steps += 1
        write_damped_step(problem, damping, count)
        for i in range(count):
            sheet[PLACE, i] = sheet[BEST, i]
        spread(problem)
        part = longest_part(problem)
        for i in range(count):
            sheet[PLACE, i] += part * sheet[STEP, i]
        write_velocities(problem)
        write_equations(problem, True)
        there = 0.0
        for i in range(count):
            there += sheet[VALUE, i] * sheet[VALUE, i]
        if there < cost:
            cost = keep(problem, count)
            damping = max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
    residual = 0.0
    for i in range(count):
        sheet[PLACE, i] = sheet[BEST, i]
        residual = max(residual, abs(sheet[AHEAD, i]))
    return residual if cost < _DIVERGED else inf


@kernel
def approach_roots(problem: Problem, starts: Any) -> int:
    """Bring starts of given instants close to roots; the residual is the last entry of a row."""
    sheet = problem.sheet
    count = coordinates(problem) - 1
    for s in range(len(starts)):
        for i in range(count):
            sheet[PLACE, i] = starts[s, i]
        complete_start(problem)
        starts[s, count] = approach(problem)
        for i in range(count):
            starts[s, i] = sheet[PLACE, i]
    return len(starts)


@kernel
def find_starts(problem: Problem, starts: Any, first: int, end: int) -> int:
    """
    Write starts into rows; return how many there are, or would be with more rows.

    For one impact and two all of them, for two from a part of a scan, the number of whose points
    is in the last row; for more those of given instants come closer to roots.
    """
    set_laws(problem)
    if len(problem.nodes) > 2:
        return approach_roots(problem, starts)
    if len(problem.nodes) == 1:
        return add_starts_of_one(problem, starts)
    if end < 0:
        return add_symmetric_starts(problem, starts)
    return scan(problem, starts, first, end, int(starts[len(starts) - 1, 0]))
