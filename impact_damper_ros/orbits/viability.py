# SPDX-License-Identifier: Apache-2.0
"""
Viability: whether the rig can perform a solution of the boundary-value problem.

Its equations hold at the nodes only. Here the flights between them are checked in closed form:
by the certified first event of the simulator and, to quantify a violation, by the exact extremes,
which are turning points.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

from impact_damper_ros.motion.event import IMPACT, RELEASE_EVENT, EventKind
from impact_damper_ros.motion.first_root import first_root
from impact_damper_ros.motion.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    Motion,
    begin_next_flight,
    motion_at,
    oscillator_of,
    rest,
    starting_motion,
)
from impact_damper_ros.motion.impact import strike
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.next_event import ALL_STEPS, next_event
from impact_damper_ros.motion.oscillator import POINTS
from impact_damper_ros.motion.state import FREE, STICK, Moving

from .closed_flights import END, FAULTS, SPAN, NodeRow, Problem, begin_at, period_of_motion

#: An impact that is earlier than assumed by this share of the period is another one.
_TIME_TOLERANCE = 1e-7
#: Distance at which the search goes on after a turning point, in steps of the grid: closer turning
#: points have equal displacements.
_BEYOND = 1e-5
#: Columns of the faults: the fault, the kind of event or the mode, the instant, s, and the amount;
#: and the duration of a chatter, s.
FAULT, THERE, WHEN, MUCH, LEFT = range(FAULTS, FAULTS + 5)
#: Faults: none; events in another order; an impact from beyond the stop; another motion after an
#: impact, and after m has stopped; and an event in a flight.
RIGHT, ORDER, FROM_BEYOND, AFTER_IMPACT, AFTER_STOP, IN_FLIGHT = range(6)


@kernel
def extremes(moving: Moving, duration: float, relative: bool) -> tuple[float, float]:
    """
    Return the least and largest X of a flight or, if `relative`, of Y - Y(origin), m.

    They are found by the certified search for turning points, which leaves the flight's end
    unknown.
    """
    run = moving.run
    end: Motion = motion_at(moving, duration)
    motion: Motion = starting_motion(moving)
    low = min(motion.travel, end.travel) if relative else min(motion.x, end.x)
    high = max(motion.travel, end.travel) if relative else max(motion.x, end.x)
    if not relative:
        # Relative to M, an m that hangs still moves by -X.
        run.relative_velocity = -run.velocity
        run.relative_acceleration = -run.acceleration
        motion = starting_motion(moving)
    step = oscillator_of(moving.constants, run).step
    run.direction = 0
    tau = 0.0
    while tau < duration:
        if run.direction == 0:
            leading = motion.relative_velocity
            if leading == 0.0:
                leading = motion.relative_2
            if leading == 0.0:
                leading = -motion.x_3
            if leading == 0.0:
                break
            run.direction = 1 if leading > 0.0 else -1
        ahead = min(tau + POINTS * step, duration)
        root = first_root(moving, REVERSAL, tau, motion, ahead, step)
        tau = ahead
        if root < inf:
            motion = motion_at(moving, root)
            value = motion.travel if relative else motion.x
            low = min(low, value)
            high = max(high, value)
            run.direction = 0
            tau = root + _BEYOND * step
        motion = motion_at(moving, tau)
    return low, high


@kernel
def is_expected(kind: int, node: NodeRow) -> bool:
    """Return whether a kind of event is that of a node."""
    if node.kind == IMPACT:
        return kind == (CONTACT_1 if node.stop == 1 else CONTACT_2)
    if node.kind == RELEASE_EVENT:
        return kind in (RELEASE_UP, RELEASE_DOWN)
    return kind == REVERSAL


@kernel
def judge_node(problem: Problem, j: int) -> bool:
    """Judge the motion of m just after a node, and return whether it is as assumed."""
    moving, node, fault = problem.moving, problem.nodes[j], problem.table[j]
    run = moving.run
    begin_at(moving, node, problem.table[j])
    if node.kind == IMPACT:
        before = problem.table[j - 1 if j > 0 else len(problem.nodes) - 1]
        incoming = before[END + 3]
        if incoming * (1.0 if node.stop == 1 else -1.0) <= 0.0:
            fault[FAULT] = FROM_BEYOND
            fault[MUCH] = incoming
            return False
        run.velocity = before[END + 1]
        run.relative_velocity = incoming
        strike(moving, node.stop)
        fault[LEFT] = run.chatter_left
        if run.mode != node.mode and run.mode != FREE:
            fault[FAULT] = AFTER_IMPACT
            fault[THERE] = run.mode
            fault[MUCH] = incoming
            return False
    elif node.kind != RELEASE_EVENT:
        # m is within the gap, however short the bounce is.
        run.clearance_1 = inf
        run.clearance_2 = inf
        rest(moving)
        if run.mode != node.mode:
            fault[FAULT] = AFTER_STOP
            return False
    return True


@kernel
def judge_flight(problem: Problem, j: int, tolerance: float) -> None:
    """Judge the flight after a node by its first event."""
    moving, node, fault = problem.moving, problem.nodes[j], problem.table[j]
    run = moving.run
    span = problem.table[j, SPAN]
    begin_at(moving, node, problem.table[j])
    begin_next_flight(moving)
    run.steps = ALL_STEPS
    next_event(moving, span + tolerance)
    kind, tau = run.kind, run.tau
    if kind == NO_EVENT or tau > span + tolerance:
        return
    if is_expected(kind, problem.nodes[(j + 1) % len(problem.nodes)]) and tau >= span - tolerance:
        return
    fault[FAULT] = IN_FLIGHT
    fault[THERE] = kind
    fault[WHEN] = tau
    if kind == REVERSAL:
        away = run.clearance_1 if node.last == 1 else -run.clearance_2
        motion: Motion = motion_at(moving, tau)
        fault[MUCH] = abs(motion.travel - away)
    elif kind in (CONTACT_1, CONTACT_2):
        begin_at(moving, node, problem.table[j])
        begin_next_flight(moving)
        low, high = extremes(moving, span, True)
        beyond = high - run.clearance_1 if kind == CONTACT_1 else -low - run.clearance_2
        fault[MUCH] = max(beyond, 0.0)


@kernel
def judge(problem: Problem) -> tuple[bool, float]:
    """Write the faults of known flights; return whether there are none, and the largest |X|."""
    moving, table = problem.moving, problem.table
    count = len(problem.nodes)
    tolerance = _TIME_TOLERANCE * period_of_motion(problem)
    viable = True
    ordered = True
    for j in range(count):
        for k in range(FAULTS, FAULTS + 5):
            table[j, k] = 0.0
        ordered = ordered and table[j, SPAN] > 0.0
    if not ordered:
        table[0, FAULT] = ORDER
    largest = 0.0
    for j in range(count):
        if ordered and judge_node(problem, j):
            judge_flight(problem, j, tolerance)
        viable = viable and table[j, FAULT] == RIGHT
        begin_at(moving, problem.nodes[j], table[j])
        begin_next_flight(moving)
        low, high = extremes(moving, max(0.0, table[j, SPAN]), False)
        largest = max(largest, -low, high)
    return viable, largest


def _fault_at(nodes: Sequence[NodeRow], j: int, table: Any) -> str:
    """Return a fault of a node, or of the flight after it, in words."""
    fault = table[j]
    node, what, much = nodes[j], int(fault[FAULT]), float(fault[MUCH])
    if what == ORDER:
        return 'events would come in another order'
    if what == FROM_BEYOND:
        return (
            f'm would reach stop {node.stop} from beyond it, with a relative velocity of '
            f'{much:.4g} m/s (it must be {"positive" if node.stop == 1 else "negative"})'
        )
    if what == AFTER_IMPACT:
        if node.mode >= STICK:
            return f'm does not stay on stop {node.stop} after the impact'
        if fault[THERE] >= STICK:
            return (
                f'm stays on stop {node.stop} after the impact, its speed {abs(much):.4g} m/s '
                'there'
            )
        return f'm leaves stop {node.stop} against the friction assumed'
    if what == AFTER_STOP:
        sticks = node.kind == EventKind.STICK
        return f'm does not {"stick" if sticks else "turn back"} where it has stopped'
    # The impact before the flight, and that after it
    since, before = float(fault[WHEN]), j
    while nodes[before].kind != IMPACT:
        before -= 1
        since += float(table[before, SPAN])
    to = next(n.stop for n in (*nodes[j + 1 :], *nodes[: j + 1]) if n.kind == IMPACT)
    route = f'between the impacts on stop {node.last} and stop {to}'
    when = f'{since:.6g} s after the former'
    kind = int(fault[THERE])
    if kind in (RELEASE_UP, RELEASE_DOWN):
        return f'm leaves its support {route}, {when}'
    if kind == REVERSAL:
        return (
            f'm turns back {route}, {when} and {much:.4g} m from stop {node.last}: friction '
            'changes sign there'
        )
    hit = 1 if kind == CONTACT_1 else 2
    return f'm would pass stop {hit} by {much:.4g} m {route}, first {when}: another impact'


def why_not_viable(nodes: Sequence[NodeRow], table: Any) -> str:
    """Return why the rig cannot perform a motion; empty if it can."""
    wrong = (j for j, fault in enumerate(table[:, FAULT]) if fault != RIGHT)
    return '; '.join(_fault_at(nodes, j, table) for j in wrong)
