# SPDX-License-Identifier: Apache-2.0
"""
A curve of periodic motions, step by step, in kernels.

A point of the curve is corrected in the plane through a guess, with its tangent, and with the test
functions of special points there: the component of the tangent along the parameter, and

    det(1 + P),    det(1 - C(P)),    det(1 - P),

where P is the derivative of the state over a period and C(P) its second compound matrix, whose
eigenvalues are the products of two multipliers.
"""

from __future__ import annotations

from math import copysign, inf
from typing import Any, NamedTuple

from impact_damper_ros.motion.compiled import kernel

from .closed_flights import (
    GUESS,
    LENGTH,
    NORMAL,
    TANGENT,
    Problem,
    newton,
    set_rig,
    vary,
    write_monodromy,
    write_tangent,
)
from .viability import judge

#: What is noted of a solution: its residual, relative to the displacements; the number of free
#: coordinates of its map of a period, 0 if that or the residual is too large; whether the rig can
#: perform it; its largest |X|; and the test functions.
RESIDUAL, SIZE, VIABLE, X_MAX, FOLD, DOUBLING, TORUS, BRANCHING = range(8)
MARKS = 8
#: Residual of a point of a curve that is small enough, and the largest one.
ENOUGH, MOST = 1e-15, 1e-11
#: How far the tangent may turn in a step, how a step grows, and the least one over the largest.
SHARPEST_TURN, GROWTH, LEAST_STEP = 0.95, 1.4, 1e-7
#: Why steps end: there is no more room, the ends of the range, no motion nearby, and a motion that
#: the rig cannot perform.
ROOM, LOW_END, HIGH_END, LOST, NOT_VIABLE = range(5)
#: What `compute` does.
SOLVE, CORRECT, GO_ON = range(3)


class Trace(NamedTuple):
    """
    Points of a curve, row by row.

    Attributes
    ----------
    places, tangents : array, shape (rows, m + 1)
        Their places, and the unit tangents there.
    marks : array, shape (rows, MARKS)
        What is known of them.
    step : array, shape (2,)
        The present step, and the largest one.
    """

    places: Any
    tangents: Any
    marks: Any
    step: Any


@kernel
def determinant(frame: Any, count: int) -> float:
    """Return the determinant of a matrix, which is overwritten."""
    product = 1.0
    for k in range(count):
        pivot = k
        for i in range(k + 1, count):
            if abs(frame[i, k]) > abs(frame[pivot, k]):
                pivot = i
        if frame[pivot, k] == 0.0:
            return 0.0
        if pivot != k:
            product = -product
            for c in range(k, count):
                frame[k, c], frame[pivot, c] = frame[pivot, c], frame[k, c]
        product *= frame[k, k]
        for i in range(k + 1, count):
            factor = frame[i, k] / frame[k, k]
            for c in range(k + 1, count):
                frame[i, c] -= factor * frame[k, c]
    return product


@kernel
def shifted_determinant(frames: Any, size: int, sign: float) -> float:
    """Return det(1 + sign P) of the map in the first frame."""
    for i in range(size):
        for k in range(size):
            frames[1, i, k] = sign * frames[0, i, k] + (1.0 if i == k else 0.0)
    return determinant(frames[1], size)


@kernel
def compound_determinant(frames: Any, size: int) -> float:
    """Return det(1 - C(P)) of the map in the first frame."""
    row = 0
    for i in range(size):
        for j in range(i + 1, size):
            column = 0
            for k in range(size):
                for c in range(k + 1, size):
                    minor = frames[0, i, k] * frames[0, j, c] - frames[0, i, c] * frames[0, j, k]
                    frames[1, row, column] = (1.0 if row == column else 0.0) - minor
                    column += 1
            row += 1
    return determinant(frames[1], row)


@kernel
def note_solution(problem: Problem, least: float, most: float) -> bool:
    """Note what is known of the solution at the place; return whether it is one."""
    marks, frames = problem.marks, problem.frames
    marks[RESIDUAL] = least
    marks[SIZE] = 0.0
    if not least <= most:
        return False
    size = write_monodromy(problem)
    total = 0.0
    for i in range(size):
        for k in range(size):
            total += abs(frames[0, i, k])
    if not total < inf:
        return False
    viable, largest = judge(problem)
    marks[SIZE] = size
    marks[VIABLE] = 1.0 if viable else -1.0
    marks[X_MAX] = largest
    marks[DOUBLING] = shifted_determinant(frames, size, 1.0)
    marks[TORUS] = compound_determinant(frames, size)
    marks[BRANCHING] = shifted_determinant(frames, size, -1.0)
    return True


@kernel
def solve_fixed(problem: Problem, enough: float, most: float) -> bool:
    """Solve the equations of a rig from the place; return whether that is a solution."""
    set_rig(problem.moving.constants, problem.moving.lines, problem.rig)
    least = newton(problem, False, True, enough)
    displaced = problem.units[LENGTH]
    for j in range(len(problem.nodes)):
        displaced = max(displaced, abs(problem.table[j, 0]))
    return note_solution(problem, least * problem.units[LENGTH] / displaced, most)


@kernel
def correct(problem: Problem, in_order: bool, enough: float) -> bool:
    """Solve the equations in the plane through `GUESS`; return whether that is a solution."""
    for i in range(len(problem.place)):
        problem.place[i] = problem.vectors[GUESS, i]
    vary(problem, problem.place[len(problem.place) - 1])
    least = newton(problem, True, in_order, enough)
    if not least <= MOST:
        problem.marks[SIZE] = 0.0
        return False
    write_tangent(problem)
    problem.marks[FOLD] = problem.vectors[TANGENT, len(problem.place) - 1]
    return note_solution(problem, least, MOST)


@kernel
def product_of(one: Any, other: Any) -> float:
    """Return the scalar product."""
    total = 0.0
    for i in range(len(one)):
        total += one[i] * other[i]
    return total


@kernel
def aim(problem: Problem, here: Any, tangent: Any, step: float) -> None:
    """Let the plane be that across a tangent, a step ahead."""
    for i in range(len(here)):
        problem.vectors[GUESS, i] = here[i] + step * tangent[i]
        problem.vectors[NORMAL, i] = tangent[i]


@kernel
def aim_at_value(problem: Problem, here: Any, tangent: Any, value: float) -> None:
    """Let the plane be that of a value of the parameter, where the tangent meets it."""
    last = len(here) - 1
    share = (value - here[last]) / tangent[last]
    for i in range(last):
        problem.vectors[GUESS, i] = here[i] + share * tangent[i]
        problem.vectors[NORMAL, i] = 0.0
    problem.vectors[GUESS, last] = value
    problem.vectors[NORMAL, last] = copysign(1.0, tangent[last])


@kernel
def step_along(
    problem: Problem, trace: Trace, in_order: bool, low: float, high: float
) -> tuple[int, int]:
    """
    Step along a curve from the first row of a trace on; return why it ends, and the last row.

    Where the curve is not kept in order, a motion that the rig cannot perform ends it, in the last
    row.
    """
    step, largest = trace.step[0], trace.step[1]
    last = len(problem.place) - 1
    row = 0
    ended = ROOM
    while row + 1 < len(trace.places):
        here, tangent = trace.places[row], trace.tangents[row]
        ahead = here[last] + step * tangent[last]
        edge = ROOM
        found = False
        if ahead < low or ahead > high:
            edge = LOW_END if ahead < low else HIGH_END
            aim_at_value(problem, here, tangent, low if ahead < low else high)
            found = correct(problem, in_order, ENOUGH)
            found = found and product_of(problem.vectors[TANGENT], tangent) >= SHARPEST_TURN
        if not found:
            edge = ROOM
            aim(problem, here, tangent, step)
            found = correct(problem, in_order, ENOUGH)
            found = found and product_of(problem.vectors[TANGENT], tangent) >= SHARPEST_TURN
            found = found and low <= problem.place[last] <= high
        if not found:
            step *= 0.5
            if step < LEAST_STEP * largest:
                ended = LOST
                break
            continue
        ahead = 0.0
        for i in range(last + 1):
            ahead += (problem.place[i] - here[i]) * tangent[i]
        if edge != ROOM and ahead < LEAST_STEP * largest:
            # It begins there
            ended = edge
            break
        row += 1
        for i in range(last + 1):
            trace.places[row, i] = problem.place[i]
            trace.tangents[row, i] = problem.vectors[TANGENT, i]
        for i in range(MARKS):
            trace.marks[row, i] = problem.marks[i]
        if not in_order and problem.marks[VIABLE] < 0.0:
            ended = NOT_VIABLE
            break
        if edge != ROOM:
            ended = edge
            break
        step = min(largest, GROWTH * step)
    trace.step[0] = step
    return ended, row


@kernel
def compute(
    problem: Problem, trace: Trace, task: int, in_order: bool, one: float, other: float
) -> tuple[int, int]:
    """
    Do what Python asks for, with all constants of the rig set anew.

    `SOLVE` and `CORRECT` take the residual that is enough, and the largest one: whether there is a
    solution. `GO_ON` takes a range: why it ends, and the last row.
    """
    set_rig(problem.moving.constants, problem.moving.lines, problem.rig)
    if task == GO_ON:
        return step_along(problem, trace, in_order, one, other)
    if task == CORRECT:
        return 1 if correct(problem, in_order, one) else 0, 0
    return 1 if solve_fixed(problem, one, other) else 0, 0
