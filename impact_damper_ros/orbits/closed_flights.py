# SPDX-License-Identifier: Apache-2.0
"""
Periodic motions as one boundary-value problem, in kernels.

The events of a period are its nodes: impacts, plastic ones and those that begin the last bounces
of a chatter among them, reversals of friction, and the beginnings and ends of sticking and rest.
Between two nodes the motion is one flight of the simulator, in closed form. The unknowns are the
state just after each node, as far as it is free, and the instants; the equations are that each
flight leads to the next node, and the condition of that node [1]_:

- impact: m is at the stop. The velocities after it are those of `impact.rebound`; the relative
  velocity is zero where the impact is plastic or belongs to the last bounces before rest, which
  act as one plastic impact;
- reversal, and the beginning of sticking: the relative velocity is zero;
- release: m needs as much from its support as friction gives.

A flight carries deviations by its free vibration, Phi; a later start from the same state changes
its end by -Phi f+, a later end by f-, where f is the rate of the state just after and just before
a node. A rig is an array of numbers, so that any of them may be an unknown, too.

References
----------
.. [1] H. Dankowicz, F. Schilder, Recipes for Continuation, SIAM (2013), chapter 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, hypot, inf, sqrt
from typing import Any, NamedTuple

from impact_damper_ros.motion.event import IMPACT, RELEASE_EVENT
from impact_damper_ros.motion.flight import (
    Motion,
    accelerate,
    begin_joint,
    motion_at,
    oscillator_of,
)
from impact_damper_ros.motion.impact import bounce, rebound, rebound_slopes
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.oscillator import Free, Oscillator, free_response, set_oscillator
from impact_damper_ros.motion.state import (
    DAMPER_MASS,
    DAMPING,
    FIRST_LINE,
    FREE,
    MASS,
    RESTITUTION_1,
    RESTITUTION_2,
    STICK,
    STIFFNESS,
    Moving,
    set_contacts,
)
from impact_damper_ros.motion.waves import turn_waves


@kernel
def set_rig(constants: Any, lines: Any, rig: Sequence[float]) -> None:
    """Set the constants of a rig from its numbers."""
    set_contacts(constants, rig)
    count = constants.harmonics
    for k in range(2):
        mass = rig[MASS] + k * rig[DAMPER_MASS]
        for j in range(count):
            line = lines[k * count + j]
            line.force = rig[FIRST_LINE + 3 * j] / mass
            line.frequency = rig[FIRST_LINE + 3 * j + 1]
            line.phase = rig[FIRST_LINE + 3 * j + 2]
    stiffness, damping = rig[STIFFNESS], rig[DAMPING]
    set_oscillator(constants.free, lines[:count], rig[MASS], stiffness, damping)
    mass = rig[MASS] + rig[DAMPER_MASS]
    set_oscillator(constants.joint, lines[count:], mass, stiffness, damping)


@dataclass(slots=True)
class NodeRow:
    """
    A node, in the form for kernels.

    Attributes
    ----------
    kind, stop, mode : int
        As in `Node`.
    resting : int
        The mode `STICK`, `REST_1` or `REST_2` after it, or 0 if m moves relative to M.
    direction : int
        Direction in which m moves relative to M after the node where friction acts, +1, -1, or 0.
    last : int
        The stop hit last, after the node.
    gives : int
        Sign of the need at which the support gives way.
    returns : bool
        Whether the node ends a bounce that returns to the stop it came from.
    """

    kind: int = 0
    stop: int = 0
    mode: int = 0
    resting: int = 0
    direction: int = 0
    last: int = 0
    gives: int = 0
    returns: bool = False


#: Columns of the table of the flights after the nodes: X (m), X', the displacement of m from the
#: stop hit last, positive towards stop 1, which keeps its digits in short bounces, Y', and the
#: instant on the force's clock, s, just after the node; ...
STATE, INSTANT = 0, 4
#: ... the state at the end of the flight, the rates of the state at the start and at the end, ...
END, RATE_START, RATE_END = 5, 9, 13
#: ... X''' at the end, the duration, s, the constants of the oscillator, and the part of the end
#: that does not change if the flight starts later from the same state, and
JERK, SPAN, STIFF, DECAY = 17, 18, 19, 20
#: the derivative of the end by the state at the start, row by row; and the fault of the node, see
#: `viability`.
MATRIX = 21
FAULTS = 37
#: Entries of an impact for `impact_equations`: the way of m to the next stop, half of its
#: acceleration on the way, and the factors from the velocities of m just after and just before the
#: impact to those of M before and after it.
WAY, HALF, FROM_AFTER, SLIDE = range(42, 46)
COLUMNS = 46


class Problem(NamedTuple):
    """
    The boundary-value problem of one sequence of nodes.

    Attributes
    ----------
    moving : Moving
        The rig in flight, with constants that kernels may set.
    nodes : sequence of NodeRow
        The events of a period, in order.
    table : array, shape (n, COLUMNS)
        The flights after the nodes, and their faults.
    places : array of int, shape (4, 5 n)
        The unknowns that count, and the numbers of equations and unknowns among those that do, or
        -1. Those of a node are X, X', Y, Y' and the support that m needs, or the instant. The last
        row is space of the solver.
    sheet : array, shape (ROWS + 3 (m + 1), width)
        All other numbers, by row.
    """

    moving: Moving
    nodes: Sequence[NodeRow]
    table: Any
    places: Any
    sheet: Any


#: Rows of the sheet: units, notes of the solution (see `arclength`), the numbers of the rig, their
#: values where the parameter is zero and their slopes, the residual before each Newton step and at
#: the end, then -1; ...
UNITS, MARKS, RIG, PATH, SLOPE, HISTORY = range(6)
#: ... vectors of m + 1 numbers: the unknowns, without dimension, and the parameter along the path;
#: residuals, steps and other places; ...
PLACE, VALUE, STEP, AHEAD, BEHIND, BEST, NORMAL, GUESS, TANGENT = range(6, 15)
#: ... square matrices: two for products of deviations and ...
FRAME, SIDE = 15, 6
#: ... the derivative of the equations, space to solve them, and the derivative at the best place.
ROWS = FRAME + 2 * SIDE
DERIVATIVE, SPACE, BEST_DERIVATIVE = range(3)
#: Units of displacements, m, and velocities, m/s; the period in cycles; whether only contacts
#: depend on the parameter; and of the path, the lines that have the motion of the base in place of
#: its force, from one to another, and the derivative of its displacement that they give.
LENGTH, SPEED, CYCLES, CONTACTS, BASE, BASE_END, BASE_ORDER = range(7)
UNKNOWNS, ROW_OF, UNKNOWN_OF, LEAD = range(4)
_NEED = 4
#: rad
FULL_TURN = 6.283185307179586


@kernel(inline=True)
def begin_at(moving: Moving, node: NodeRow, row: Sequence[float]) -> None:
    """Move a rig to the state just after a node."""
    run = moving.run
    half = moving.constants.half_gap
    way = row[2]
    run.time = 0.0
    run.time_low = 0.0
    run.now = 0.0
    run.mode = node.mode
    if node.resting != 0:
        run.mode = node.resting
    elif moving.constants.grip == 0.0:
        run.mode = FREE
    run.x = row[0]
    run.velocity = row[1]
    run.relative_velocity = row[3]
    run.stop_1 = half
    run.stop_2 = -half
    run.target_1 = half
    run.target_2 = -half
    run.last_stop = node.last
    run.released = node.kind == RELEASE_EVENT
    run.chatter_left = 0.0
    run.side = 0
    # Exact near the stop hit last
    if node.resting > STICK:
        way = 0.0
    if node.last == 1:
        run.clearance_1 = max(0.0, -way)
        run.clearance_2 = max(0.0, 2.0 * half + way)
    else:
        run.clearance_1 = max(0.0, 2.0 * half - way)
        run.clearance_2 = max(0.0, way)
    if moving.constants.one_sided:
        run.clearance_2 = inf
    waves = moving.waves
    for j in range(len(waves)):
        waves[j].angle = 0.0
    turn_waves(moving.lines, waves, row[INSTANT])


@kernel
def write_flight_matrix(
    oscillator: Oscillator, span: float, moves: float, matrix: Any, place: int
) -> None:
    """
    Write the matrix that carries deviations through a flight, row by row, from an index on.

    `moves` is 1 where m moves by itself, and 0 where it moves as one with M.
    """
    free: Free = free_response(oscillator, span)
    bend = -oscillator.omega_squared * free.impulse
    for k in range(16):
        matrix[place + k] = 0.0
    matrix[place] = free.step
    matrix[place + 1] = free.impulse
    matrix[place + 4] = bend
    matrix[place + 5] = free.rate
    matrix[place + 8] = moves * (1.0 - free.step)
    matrix[place + 9] = moves * (span - free.impulse)
    matrix[place + 10] = 1.0
    matrix[place + 11] = moves * span
    matrix[place + 12] = -moves * bend
    matrix[place + 13] = moves * (1.0 - free.rate)
    matrix[place + 15] = moves


@kernel
def fly(moving: Moving, node: NodeRow, row: Any) -> None:
    """Compute the flight after a node, from the state in its row."""
    run = moving.run
    span = row[SPAN]
    begin_at(moving, node, row)
    if node.resting != 0:
        begin_joint(moving)
    else:
        run.relative_acceleration = accelerate(moving, node.direction)
    motion: Motion = motion_at(moving, span)
    oscillator = oscillator_of(moving.constants, run)
    moves = 0.0 if run.joint else 1.0
    row[STIFF] = oscillator.omega_squared
    row[DECAY] = oscillator.decay
    row[END] = motion.x
    row[END + 1] = motion.velocity
    row[END + 2] = row[2] + moves * motion.travel
    row[END + 3] = moves * motion.relative_velocity
    row[RATE_START] = row[1]
    row[RATE_START + 1] = run.acceleration
    row[RATE_START + 2] = moves * row[3]
    row[RATE_START + 3] = moves * run.relative_acceleration
    row[RATE_END] = motion.velocity
    row[RATE_END + 1] = motion.x_2
    row[RATE_END + 2] = moves * motion.relative_velocity
    row[RATE_END + 3] = moves * motion.relative_2
    row[JERK] = motion.x_3
    write_flight_matrix(oscillator, span, moves, row, MATRIX)


@kernel(inline=True)
def coordinates(problem: Problem) -> int:
    """Return the number of unknowns, and the parameter."""
    return (len(problem.sheet) - ROWS) // 3


@kernel(inline=True)
def matrix_row(problem: Problem, number: int) -> int:
    """Return the first row of a matrix by the unknowns."""
    return ROWS + number * coordinates(problem)


@kernel
def swap_rows(sheet: Any, one: int, other: int, begin: int, end: int) -> None:
    """Exchange two rows, in some columns."""
    for i in range(begin, end):
        value = sheet[one, i]
        sheet[one, i] = sheet[other, i]
        sheet[other, i] = value


@kernel
def pull_by_base(rig: Any, first: int, order: int) -> None:
    """Make the numbers of a line of the base those of its force, as `BaseMotion.force`."""
    rate = rig[first + 1]
    if rig[first] != 0.0:
        for _ in range(order):
            rig[first] /= rate
    if order == 2:
        rig[first] = -rig[first]
    elif order == 1:
        rig[first + 2] -= 0.25 * FULL_TURN
    rig[first] *= hypot(rig[STIFFNESS], rig[DAMPING] * rate)
    rig[first + 2] += atan2(rig[DAMPING] * rate, rig[STIFFNESS])


@kernel
def vary(problem: Problem, value: float) -> None:
    """Set the rig of a value of the parameter on the path."""
    sheet = problem.sheet
    for k in range(FIRST_LINE + 3 * problem.moving.constants.harmonics):
        sheet[RIG, k] = sheet[PATH, k] + value * sheet[SLOPE, k]
    for j in range(int(sheet[UNITS, BASE]), int(sheet[UNITS, BASE_END])):
        pull_by_base(sheet[RIG], FIRST_LINE + 3 * j, int(sheet[UNITS, BASE_ORDER]))
    if sheet[UNITS, CONTACTS] != 0.0:
        set_contacts(problem.moving.constants, sheet[RIG])
    else:
        set_rig(problem.moving.constants, problem.moving.lines, sheet[RIG])


@kernel
def unit_of_unknown(problem: Problem, coordinate: int) -> float:
    """Return the unit of an unknown by its coordinate; instants are angles of the force."""
    if coordinate == INSTANT:
        rate: float = problem.sheet[RIG, FIRST_LINE + 1]
        return 1.0 / rate
    unit: float = (
        problem.sheet[UNITS, SPEED] if coordinate % 2 == 1 else problem.sheet[UNITS, LENGTH]
    )
    return unit


@kernel
def period_of_motion(problem: Problem) -> float:
    """Return the period, s."""
    period: float = problem.sheet[UNITS, CYCLES] * FULL_TURN / problem.sheet[RIG, FIRST_LINE + 1]
    return period


@kernel
def natural_rate(problem: Problem) -> float:
    """Return the natural frequency of M, rad/s."""
    return sqrt(problem.sheet[RIG, STIFFNESS] / problem.sheet[RIG, MASS])


@kernel
def spread(problem: Problem) -> None:
    """Write the states and instants at the place, and the durations of the flights."""
    table, unknowns = problem.table, problem.places[UNKNOWNS]
    count = len(problem.nodes)
    for i in range(coordinates(problem) - 1):
        k = unknowns[i]
        table[k // 5, k % 5] = problem.sheet[PLACE, i] * unit_of_unknown(problem, k % 5)
    for j in range(count):
        span = table[(j + 1) % count, INSTANT] - table[j, INSTANT]
        if j == count - 1:
            span += period_of_motion(problem)
        table[j, SPAN] = span


@kernel
def fly_all(problem: Problem) -> None:
    """Compute the flights after all nodes at the place."""
    spread(problem)
    for j in range(len(problem.nodes)):
        fly(problem.moving, problem.nodes[j], problem.table[j])


@kernel(inline=True)
def restitution_at(problem: Problem, j: int) -> float:
    """Return the coefficient of restitution at a node that is an impact."""
    node = problem.nodes[j]
    if node.resting != 0:
        return 0.0
    restitution: float = problem.sheet[RIG, RESTITUTION_1 if node.stop == 1 else RESTITUTION_2]
    return restitution


@kernel
def write_equation(problem: Problem, j: int, r: int, with_derivative: bool) -> None:
    """Write one equation of a node, by number, if that counts."""
    nodes, table, places = problem.nodes, problem.table, problem.places
    row = places[ROW_OF, 5 * j + r]
    if row < 0:
        return
    last = j - 1 if j > 0 else len(nodes) - 1
    node, before = nodes[j], nodes[last]
    flight = table[last]
    constants = problem.moving.constants
    share, slide, stay = constants.share, 0.0, 1.0
    value = 0.0
    if r < _NEED:
        value = flight[END + r]
    if node.kind == IMPACT and r % 2 == 1:
        speed = abs(flight[END + 3])
        restitution, slope = bounce(constants, restitution_at(problem, j), speed)
        after, relative = rebound(share, restitution, flight[END + 1], flight[END + 3])
        slide, stay = rebound_slopes(share, slope)
        value = after if r == 1 else relative
    if r < _NEED:
        value -= table[j, r]
    scale = 1.0 / unit_of_unknown(problem, r) if r < _NEED else 1.0
    if r == 2:
        if not constants.one_sided:
            value += 2.0 * constants.half_gap * (node.last - before.last)
        if node.returns:
            # The equation of a bounce has the mean velocity, not the way: otherwise two impacts at
            # once would be a solution.
            scale /= natural_rate(problem) * flight[SPAN]
    elif r == _NEED:
        away = 1.0 if before.last == 2 else -1.0
        value = flight[RATE_END + 1] - constants.slope - away * constants.air
        value -= node.gives * constants.grip
        scale = 1.0 / (problem.sheet[UNITS, SPEED] * natural_rate(problem))
    problem.sheet[VALUE, row] = value * scale
    if not with_derivative:
        return
    sheet = problem.sheet
    line = matrix_row(problem, DERIVATIVE) + row
    # Derivatives by the state at the node before, and by the instants of both nodes
    early = 0.0
    late = flight[RATE_END + r] if r < _NEED else flight[JERK]
    for k in range(4):
        slope = 0.0
        if r == _NEED:
            slope = -flight[STIFF] * flight[MATRIX + k]
            slope -= 2.0 * flight[DECAY] * flight[MATRIX + 4 + k]
        elif node.kind == IMPACT and r == 1:
            slope = flight[MATRIX + 4 + k] + slide * flight[MATRIX + 12 + k]
        elif node.kind == IMPACT and r == 3:
            slope = stay * flight[MATRIX + 12 + k]
        else:
            slope = flight[MATRIX + 4 * r + k]
        early -= slope * flight[RATE_START + k]
        column = places[UNKNOWN_OF, 5 * last + k]
        if column >= 0:
            sheet[line, column] += slope * scale * unit_of_unknown(problem, k)
    if node.kind == IMPACT and r == 1:
        late += slide * flight[RATE_END + 3]
    elif node.kind == IMPACT and r == 3:
        late *= stay
    if r == 2 and node.returns:
        early += value / flight[SPAN]
        late -= value / flight[SPAN]
    unit = unit_of_unknown(problem, INSTANT) * scale
    sheet[line, places[UNKNOWN_OF, 5 * last + INSTANT]] += early * unit
    sheet[line, places[UNKNOWN_OF, 5 * j + INSTANT]] += late * unit
    if r < _NEED and places[UNKNOWN_OF, 5 * j + r] >= 0:
        sheet[line, places[UNKNOWN_OF, 5 * j + r]] -= scale * unit_of_unknown(problem, r)


@kernel
def write_equations(problem: Problem, with_derivative: bool) -> None:
    """Write the residual of the equations at the place, and its derivative by the unknowns."""
    fly_all(problem)
    if with_derivative:
        count = coordinates(problem)
        first = matrix_row(problem, DERIVATIVE)
        for i in range(count):
            for k in range(count):
                problem.sheet[first + i, k] = 0.0
    for j in range(len(problem.nodes)):
        for r in range(5):
            write_equation(problem, j, r, with_derivative)
