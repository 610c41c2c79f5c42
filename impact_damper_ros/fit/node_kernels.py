# SPDX-License-Identifier: Apache-2.0
"""
Kernels of a fit: flights from node to node, their conditions, and the linear system of a step.

The flights are those of `orbits.closed_flights`: from the state at each node, in closed form, with
the matrix that carries deviations. Conditions and their derivatives are in the unknowns of the
nodes, T, X, X', Z' and Y, and in the shared ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import GAP, Moving
from impact_damper_ros.orbits.closed_flights import (
    DECAY,
    END,
    INSTANT,
    JERK,
    MATRIX,
    RATE_END,
    RATE_START,
    SPAN,
    STIFF,
    NodeRow,
    fly,
    set_rig,
)

#: Unknowns of a node: its instant, and X, X', Z' and Y just after it.
AT, PLACE_M, SPEED_M, SPEED_D, OFFSET = range(5)
#: What the end of a flight has: X, X', the way of m from the stop hit last, Y', and X''.
ARRIVALS = 5
#: What a node demands.
HIT, REVERSES, RELEASES, STAYS = range(4)
#: Columns of a row of derivatives: the unknowns of the node before, of the node, then shared ones.
PAIR = 10


@kernel
def fly_between(
    moving: Moving,
    nodes: Sequence[NodeRow],
    states: Any,
    rigs: Any,
    table: Any,
    arrivals: Any,
    demands: Sequence[int],
    begins: bool,
) -> int:
    """
    Compute the flights from node to node, with the numbers of some rigs.

    The table gets those of the first rig, `arrivals` what all arrive with. If it `begins`, the
    states of nodes that are no impact are those of the flights before them.
    """
    for done in range(len(rigs)):
        number = len(rigs) - 1 - done
        set_rig(moving.constants, moving.lines, rigs[number])
        half = 0.5 * rigs[number, GAP]
        for j in range(len(arrivals[number])):
            row = table[j]
            side = 1.0 if nodes[j].last == 1 else -1.0
            row[0] = states[j, PLACE_M]
            row[1] = states[j, SPEED_M]
            row[2] = states[j, OFFSET] - side * half
            row[3] = states[j, SPEED_D] - states[j, SPEED_M]
            row[INSTANT] = states[j, AT]
            row[SPAN] = states[j + 1, AT] - states[j, AT]
            fly(moving, nodes[j], row)
            for i in range(4):
                arrivals[number, j, i] = row[END + i]
            arrivals[number, j, 4] = row[RATE_END + 1]
            if begins and demands[j + 1] != HIT:
                states[j + 1, PLACE_M] = row[END]
                states[j + 1, SPEED_M] = row[END + 1]
                states[j + 1, SPEED_D] = row[END + 1] + row[END + 3]
                states[j + 1, OFFSET] = row[END + 2] + side * half
    return len(rigs)


@kernel(inline=True)
def end_slope(row: Any, what: int, k: int) -> float:
    """Return the derivative of what a flight arrives with by the k-th part of its start."""
    slope: float = 0.0
    if what < 4:
        slope = row[MATRIX + 4 * what + k]
    else:
        slope = -row[STIFF] * row[MATRIX + k] - 2.0 * row[DECAY] * row[MATRIX + 4 + k]
    return slope


@kernel
def write_slopes(
    row: Any, arrivals: Any, flight: int, varied: Any, steps: Any, slopes: Any
) -> None:
    """Write the derivatives of all that a flight arrives with."""
    for what in range(ARRIVALS):
        for k in range(slopes.shape[1]):
            slopes[what, k] = 0.0
        by_x = end_slope(row, what, 0)
        by_v = end_slope(row, what, 1)
        by_way = end_slope(row, what, 2)
        by_relative = end_slope(row, what, 3)
        slopes[what, AT] = -(by_x * row[RATE_START] + by_v * row[RATE_START + 1])
        slopes[what, AT] -= by_way * row[RATE_START + 2] + by_relative * row[RATE_START + 3]
        slopes[what, PLACE_M] = by_x
        slopes[what, SPEED_M] = by_v - by_relative
        slopes[what, SPEED_D] = by_relative
        slopes[what, OFFSET] = by_way
        slopes[what, 5 + AT] = row[RATE_END + what] if what < 4 else row[JERK]
        for number in range(len(varied)):
            change = arrivals[number + 1, flight, what] - arrivals[0, flight, what]
            slopes[what, PAIR + varied[number]] = change / steps[number]


@kernel
def write_conditions(
    states: Any,
    arrivals: Any,
    ends: Sequence[int],
    demands: Sequence[int],
    stops: Any,
    targets: Any,
    alphas: Any,
    ratio: float,
    gap: float,
    units: Any,
    values: Any,
) -> int:
    """
    Write the five conditions at the end of each flight that counts, in their units.

    `targets` are the accelerations of m that friction leaves at a release, or instants of nodes
    that stay.
    """
    for e in range(len(ends)):
        j = ends[e]
        x = arrivals[j - 1, 0]
        v = arrivals[j - 1, 1]
        relative = arrivals[j - 1, 3]
        side = stops[j - 1]
        values[e, 0] = x - states[j, PLACE_M]
        values[e, 3] = arrivals[j - 1, 2] + 0.5 * side * gap - states[j, OFFSET]
        if demands[j] == HIT:
            jump = states[j, SPEED_M] - v
            values[e, 1] = relative - alphas[e, 0] * jump
            values[e, 2] = states[j, SPEED_D] - v - (alphas[e, 0] - ratio) * jump
            values[e, 4] = states[j, OFFSET] - 0.5 * gap * stops[j]
        else:
            values[e, 1] = v - states[j, SPEED_M]
            values[e, 2] = v + relative - states[j, SPEED_D]
            values[e, 4] = relative
            if demands[j] == RELEASES:
                values[e, 4] = targets[j] - arrivals[j - 1, 4]
            elif demands[j] == STAYS:
                values[e, 4] = states[j, AT] - targets[j]
        for i in range(5):
            values[e, i] /= units[e, i]
    return len(ends)


@kernel
def write_condition_rates(
    table: Any,
    states: Any,
    arrivals: Any,
    ends: Sequence[int],
    demands: Sequence[int],
    stops: Any,
    directions: Any,
    alphas: Any,
    alpha_columns: Sequence[int],
    places: Sequence[int],
    ratio: float,
    varied: Any,
    steps: Any,
    units: Any,
    slopes: Any,
    rates: Any,
) -> int:
    """
    Write the derivatives of the conditions at the end of each flight that counts.

    `alphas` are alpha and its derivatives by alpha at rest, speed and slowness; `places` those of
    gap, friction and slowness among the shared unknowns, or -1.
    """
    gap_at = places[0]
    grip_at = places[1]
    slowness_at = places[2]
    width = slopes.shape[1]
    for e in range(len(ends)):
        j = ends[e]
        demand = demands[j]
        write_slopes(table[j - 1], arrivals, j - 1, varied, steps, slopes)
        for k in range(width):
            x = slopes[0, k]
            v = slopes[1, k]
            relative = slopes[3, k]
            after_v = 1.0 if k == 5 + SPEED_M else 0.0
            after_w = 1.0 if k == 5 + SPEED_D else 0.0
            after_y = 1.0 if k == 5 + OFFSET else 0.0
            rates[e, 0, k] = x - (1.0 if k == 5 + PLACE_M else 0.0)
            rates[e, 3, k] = slopes[2, k] - after_y
            if demand == HIT:
                alpha = alphas[e, 0]
                jump = states[j, SPEED_M] - arrivals[0, j - 1, 1]
                sign = 1.0 if arrivals[0, j - 1, 3] >= 0.0 else -1.0
                of_alpha = alphas[e, 2] * sign * relative
                if k == PAIR + alpha_columns[e]:
                    of_alpha += alphas[e, 1]
                if slowness_at >= 0 and k == PAIR + slowness_at:
                    of_alpha += alphas[e, 3]
                by_jump = after_v - v
                less = alpha * by_jump + jump * of_alpha
                rates[e, 1, k] = relative - less
                rates[e, 2, k] = after_w - v + ratio * by_jump - less
                rates[e, 4, k] = after_y
                if k == PAIR + gap_at:
                    rates[e, 4, k] = -0.5 * stops[j]
            else:
                rates[e, 1, k] = v - after_v
                rates[e, 2, k] = v + relative - after_w
                rates[e, 4, k] = relative
                if demand == RELEASES:
                    rates[e, 4, k] = -slopes[4, k]
                    if grip_at >= 0 and k == PAIR + grip_at:
                        rates[e, 4, k] -= directions[j]
                elif demand == STAYS:
                    rates[e, 4, k] = 1.0 if k == 5 + AT else 0.0
            for i in range(5):
                rates[e, i, k] /= units[e, i]
    return len(ends)
