# SPDX-License-Identifier: Apache-2.0
"""
The equations of N impacts in k cycles of the force, in kernels.

Bapat (1995), equations (3)-(15), derived again. Between impacts the damper mass has constant
acceleration, so that the displacements X_i and instants t_i of the impacts give its velocities;
momentum and a constant restitution then give those of the primary mass before and after each
impact; and its closed-form flight must lead from each impact to the next. These are 2N equations.
For fixed instants they are linear in X_1 .. X_N and in the cosine and sine of the force's phase at
the first impact: an N-impact motion has only N-1 non-linear unknowns.
"""

from __future__ import annotations

from math import sqrt

from impact_damper_ros.motion.impact import rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import FIRST_LINE, MASS, STIFFNESS

from .closed_flights import (
    BEST_DERIVATIVE,
    END,
    FROM_AFTER,
    FULL_TURN,
    HALF,
    INSTANT,
    MATRIX,
    PLACE,
    RIG,
    SLIDE,
    SPAN,
    WAY,
    Problem,
    fly,
    matrix_row,
    natural_rate,
    restitution_at,
    spread,
    unit_of_unknown,
)


@kernel
def set_coefficients(problem: Problem) -> None:
    """Write the entries of each impact in the equations into its row, for a constant R."""
    nodes, table, constants = problem.nodes, problem.table, problem.moving.constants
    for j in range(len(nodes)):
        after = nodes[(j + 1) % len(nodes)].stop
        # The paper's lambda of the flight after the impact; 0 if that returns to the same stop
        direction = nodes[j].stop - after
        air = -constants.air if nodes[j].stop == 1 else constants.air
        friction = direction * constants.grip
        slide, stay = rebound_slopes(constants.share, restitution_at(problem, j))
        table[j, WAY] = 2.0 * constants.half_gap * direction if not constants.one_sided else 0.0
        table[j, HALF] = 0.5 * (constants.slope - friction + air)
        table[j, FROM_AFTER] = 1.0 / (1.0 - slide - stay)
        table[j, SLIDE] = slide


@kernel
def damper_velocities(problem: Problem, j: int) -> tuple[float, float]:
    """Return the velocities of m just after an impact and just before the next one."""
    table = problem.table
    row = table[j]
    late = (j + 1) % len(problem.nodes)
    mean = (table[late, 0] - row[0] + row[WAY]) / row[SPAN]
    return mean - row[HALF] * row[SPAN], mean + row[HALF] * row[SPAN]


@kernel
def velocity_after(problem: Problem, j: int) -> float:
    """Return the velocity of M just after an impact."""
    leaving, _ = damper_velocities(problem, j)
    _, arriving = damper_velocities(problem, j - 1 if j > 0 else len(problem.nodes) - 1)
    before = arriving + problem.table[j, FROM_AFTER] * (leaving - arriving)
    velocity: float = before + problem.table[j, SLIDE] * (arriving - before)
    return velocity


@kernel
def write_velocities(problem: Problem) -> None:
    """Set the velocities at the place that follow from displacements and instants."""
    sheet = problem.sheet
    spread(problem)
    speed = unit_of_unknown(problem, 1)
    for j in range(len(problem.nodes)):
        velocity = velocity_after(problem, j)
        leaving, _ = damper_velocities(problem, j)
        sheet[PLACE, 4 * j + 1] = velocity / speed
        sheet[PLACE, 4 * j + 2] = (leaving - velocity) / speed


@kernel
def share_of_leaving(problem: Problem, j: int, after: bool) -> float:
    """
    Return the share of m's velocity just after an impact in that of M before or after it.

    The rest is the share of m's velocity just before the impact.
    """
    share: float = problem.table[j, FROM_AFTER]
    if after:
        share *= 1.0 - problem.table[j, SLIDE]
    return share


@kernel
def add_velocity(problem: Problem, row: int, j: int, factor: float, after: bool) -> None:
    """Add the velocity of M before or after an impact to a row of the linear equations."""
    sheet, table = problem.sheet, problem.table
    count = len(problem.nodes)
    last, late = (j - 1 if j > 0 else count - 1), (j + 1) % count
    leaving = share_of_leaving(problem, j, after)
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
def begin_system(problem: Problem, columns: int) -> int:
    """Clear the matrix of the 2N equations, at the instants of the place; return its first row."""
    first = matrix_row(problem, BEST_DERIVATIVE)
    spread(problem)
    for i in range(2 * len(problem.nodes)):
        for k in range(columns):
            problem.sheet[first + i, k] = 0.0
    return first


@kernel
def add_flight(problem: Problem, first: int, j: int) -> None:
    """Add what the equations of the flight after an impact ask of the displacements."""
    sheet, row = problem.sheet, problem.table[j]
    count = len(problem.nodes)
    late = (j + 1) % count
    scale = sqrt(sheet[RIG, MASS] / sheet[RIG, STIFFNESS])
    sheet[first + j, late] += 1.0
    sheet[first + j, j] -= row[MATRIX]
    add_velocity(problem, first + j, j, -row[MATRIX + 1], True)
    add_velocity(problem, first + count + j, late, scale, False)
    sheet[first + count + j, j] -= scale * row[MATRIX + 4]
    add_velocity(problem, first + count + j, j, -scale * row[MATRIX + 5], True)


@kernel
def write_linear_system(problem: Problem) -> int:
    """
    Write the equations for the instants at the place as a matrix; return its first row.

    Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of the
    force's phase at the first impact; displacements first, then velocities over the natural
    frequency.
    """
    sheet = problem.sheet
    count = len(problem.nodes)
    first = begin_system(problem, count + 3)
    rate = natural_rate(problem)
    for j in range(count):
        ahead = fly_from_rest(problem, j, 0.0)
        aside = fly_from_rest(problem, j, 0.25 * FULL_TURN)
        back = fly_from_rest(problem, j, 0.5 * FULL_TURN)
        add_flight(problem, first, j)
        for k in range(2):
            row = first + j + k * count
            scale = 1.0 if k == 0 else 1.0 / rate
            constant = 0.5 * (ahead[k] + back[k])
            sheet[row, count] -= scale * 0.5 * (ahead[k] - back[k])
            sheet[row, count + 1] -= scale * (aside[k] - constant)
            sheet[row, count + 2] -= scale * constant
    return first
