# SPDX-License-Identifier: Apache-2.0
"""
Motions with three and more impacts in a period, approached from given instants, in kernels.

The impact equations are linear in the displacements, so that those which solve them best follow
from the instants, by orthogonal projection; damped least squares (Levenberg and Marquardt) then
have the N instants alone as unknowns. This is variable projection [1]_; its derivative is that for
fixed displacements, projected [2]_, which is exact at a root.

References
----------
.. [1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10, 413-432 (1973).
.. [2] L. Kaufman, BIT 15, 49-57 (1975).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import MASS, STIFFNESS

from .closed_flights import (
    BEST,
    BEST_DERIVATIVE,
    DECAY,
    DERIVATIVE,
    END,
    HALF,
    INSTANT,
    LENGTH,
    MATRIX,
    PLACE,
    RATE_END,
    RATE_START,
    RIG,
    SPACE,
    SPAN,
    STEP,
    STIFF,
    UNITS,
    VALUE,
    WAY,
    Problem,
    coordinates,
    fly,
    matrix_row,
    natural_rate,
    spread,
    unit_of_unknown,
)
from .impact_equations import (
    add_flight,
    begin_system,
    damper_velocities,
    share_of_leaving,
    velocity_after,
    write_velocities,
)
from .newton import longest_part, solve_linear

#: Residual of a start that has converged; Newton's method does the rest.
REACHED = 1e-10
_MOST_STEPS = 40
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-11, 1e5
#: Factor to which the sum of squares must fall in some steps: most starts get stuck.
_PATIENCE, _FALL = 4, 0.95
#: Squared length, relative to the first one, below which a column depends on others.
_WITHIN = 1e-20


@kernel
def take_along(problem: Problem, first: int, column: int, other: int) -> float:
    """Subtract from a column its part along another one of unit length; return its size."""
    sheet = problem.sheet
    part = 0.0
    for i in range(first, first + 2 * len(problem.nodes)):
        part += sheet[i, column] * sheet[i, other]
    for i in range(first, first + 2 * len(problem.nodes)):
        sheet[i, other] -= part * sheet[i, column]
    return part


@kernel
def project(problem: Problem) -> tuple[float, float]:
    """
    Let displacements solve the equations best at the instants of the place.

    The matrix of the equations becomes an orthonormal one, and the column after N + 2 the
    residuals. The function returns the sum of their squares and the largest residual. In a flight
    that returns to the same stop, the equation is for the mean velocity instead of the
    displacement: otherwise two simultaneous impacts would be a solution.
    """
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    first, space = begin_system(problem, 2 * count + 3), matrix_row(problem, SPACE)
    end = first + 2 * count
    scale = sqrt(sheet[RIG, MASS] / sheet[RIG, STIFFNESS])
    for j in range(count):
        for k in range(4):
            table[j, k] = 0.0
        fly(problem.moving, problem.nodes[j], table[j])
        add_flight(problem, first, j)
        sheet[first + j, count + 2] -= table[j, END]
        sheet[first + count + j, count + 2] -= scale * table[j, END + 1]
        if table[j, WAY] == 0.0:
            for k in range(count + 3):
                sheet[first + j, k] *= scale / table[j, SPAN]
    for k in range(count):
        before, after = 0.0, 0.0
        for i in range(first, end):
            before += sheet[i, k] * sheet[i, k]
        for c in range(k):
            sheet[space + c, k] = take_along(problem, first, c, k)
        for i in range(first, end):
            after += sheet[i, k] * sheet[i, k]
        size = sqrt(after) if after > _WITHIN * before else inf
        sheet[space + k, k] = size
        for i in range(first, end):
            sheet[i, k] /= size
    for k in range(count):
        sheet[VALUE, k] = -take_along(problem, first, k, count + 2)
    for b in range(count):
        k = count - 1 - b
        x = sheet[VALUE, k]
        for c in range(k + 1, count):
            x -= sheet[space + k, c] * table[c, 0]
        table[k, 0] = x / sheet[space + k, k]
        sheet[PLACE, 4 * k] = table[k, 0] / sheet[UNITS, LENGTH]
    total, most = 0.0, 0.0
    for i in range(first, end):
        residual = sheet[i, count + 2] / sheet[UNITS, LENGTH]
        total += residual * residual
        most = max(most, abs(residual))
    return total, most


@kernel
def add_derivative(problem: Problem, line: int, j: int, factor: float, after: bool) -> None:
    """Add the derivative of the velocity of M before or after an impact by the instants."""
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    column = count + 3
    last, late = (j - 1 if j > 0 else count - 1), (j + 1) % count
    share = share_of_leaving(problem, j, after)
    leaving, _ = damper_velocities(problem, j)
    slope = -factor * share * (leaving / table[j, SPAN] + 2.0 * table[j, HALF])
    sheet[line, column + late] += slope
    sheet[line, column + j] -= slope
    _, arriving = damper_velocities(problem, last)
    slope = factor * (1.0 - share) * (2.0 * table[last, HALF] - arriving / table[last, SPAN])
    sheet[line, column + j] += slope
    sheet[line, column + last] -= slope


@kernel
def write_derivative(problem: Problem) -> None:
    """Write the projected derivative of the residuals by the instants into the last columns."""
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    column, first = count + 3, matrix_row(problem, BEST_DERIVATIVE)
    rate = natural_rate(problem)
    for j in range(count):
        row = table[j]
        late = (j + 1) % count
        x, velocity = row[0], velocity_after(problem, j)
        begins = row[RATE_START + 1] - row[STIFF] * x - 2.0 * row[DECAY] * velocity
        way = row[MATRIX] * x + row[MATRIX + 1] * velocity
        speed = row[MATRIX + 4] * x + row[MATRIX + 5] * velocity
        ends = row[RATE_END + 1] - row[STIFF] * way - 2.0 * row[DECAY] * speed
        speed += row[END + 1]
        for k in range(2):
            line = first + j + k * count
            scale = 1.0 / rate if k == 1 else 1.0
            if k == 0 and row[WAY] == 0.0:
                scale = 1.0 / (rate * row[SPAN])
                shift = sheet[line, count + 2] / row[SPAN]
                sheet[line, column + j] += shift
                sheet[line, column + late] -= shift
            stay, turn = row[MATRIX + 4 * k], row[MATRIX + 4 * k + 1]
            sheet[line, column + j] += scale * (stay * velocity + turn * begins)
            sheet[line, column + late] -= scale * (speed if k == 0 else ends)
            add_derivative(problem, line, j, -scale * turn, True)
            if k == 1:
                add_derivative(problem, line, late, scale, False)
    for j in range(count):
        for k in range(count):
            take_along(problem, first, k, column + j)


@kernel
def keep(problem: Problem) -> None:
    """Keep the place, and the normal equations of a step from it."""
    sheet = problem.sheet
    count = len(problem.nodes)
    first, kept = matrix_row(problem, BEST_DERIVATIVE), matrix_row(problem, DERIVATIVE)
    write_derivative(problem)
    unit = unit_of_unknown(problem, INSTANT) / sheet[UNITS, LENGTH]
    for i in range(4 * count):
        sheet[BEST, i] = sheet[PLACE, i]
    for k in range(count):
        for c in range(-1, count):
            total = 0.0
            for i in range(first, first + 2 * count):
                total += sheet[i, count + 3 + k] * sheet[i, count + 3 + c]
            sheet[kept + k, c + 1] = total * unit
            sheet[kept + k, c + 1] *= unit if c >= 0 else -1.0 / sheet[UNITS, LENGTH]


@kernel
def write_damped_step(problem: Problem, damping: float) -> None:
    """Write the step of damped least squares from the kept residual and derivative."""
    sheet = problem.sheet
    count = len(problem.nodes)
    kept, space = matrix_row(problem, DERIVATIVE), matrix_row(problem, SPACE)
    size = 0.0
    for k in range(count):
        size += sheet[kept + k, k + 1]
    for k in range(count):
        sheet[VALUE, k] = sheet[kept + k, 0]
        for c in range(count):
            sheet[space + k, c] = sheet[kept + k, c + 1]
        sheet[space + k, k] += damping * size / count
    solve_linear(problem, count, STEP)
    for b in range(count):
        k = count - 1 - b
        sheet[STEP, 4 * k + 3] = sheet[STEP, k]


@kernel
def approach(problem: Problem) -> float:
    """Bring the instants at the place close to those of a root; return the largest residual."""
    sheet = problem.sheet
    count = len(problem.nodes)
    cost, residual = project(problem)
    keep(problem)
    damping, awaited = _DAMPING, inf
    steps = 0
    while steps < _MOST_STEPS and REACHED * REACHED < cost < inf and damping < _MOST_DAMPING:
        if steps % _PATIENCE == 0:
            if cost > awaited:
                break
            awaited = _FALL * cost
        steps += 1
        write_damped_step(problem, damping)
        for i in range(4 * count):
            sheet[PLACE, i] = sheet[BEST, i]
        spread(problem)
        part = longest_part(problem)
        for j in range(count):
            sheet[PLACE, 4 * j + 3] += part * sheet[STEP, 4 * j + 3]
        there, most = project(problem)
        if there < cost:
            cost, residual = there, most
            keep(problem)
            damping = max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
    for i in range(4 * count):
        sheet[PLACE, i] = sheet[BEST, i]
    write_velocities(problem)
    return residual


@kernel
def approach_roots(problem: Problem, starts: Any) -> int:
    """Bring starts of given instants close to roots; the residual is the last entry of a row."""
    sheet = problem.sheet
    count = coordinates(problem) - 1
    for s in range(len(starts)):
        for i in range(count):
            sheet[PLACE, i] = starts[s, i]
        starts[s, count] = approach(problem)
        for i in range(count):
            starts[s, i] = sheet[PLACE, i]
    return len(starts)
