# SPDX-License-Identifier: Apache-2.0
"""The boundary-value problem of a rig and a sequence of nodes: its arrays, and its solutions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.kernels import call_kernel, has_numba
from impact_damper_ros.motion.records import pack_rows
from impact_damper_ros.motion.state import (
    CHATTER_1,
    DAMPER_MASS,
    FIRST_LINE,
    FREE,
    NUMBERS,
    REST_1,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
)
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arclength import (
    COORDINATES,
    KIND,
    MAP,
    RESIDUAL,
    SIZE,
    SPARE,
    VIABLE,
    X_MAX,
)
from .closed_flights import (
    BASE_ORDER,
    COLUMNS,
    CONTACTS,
    END,
    HISTORY,
    INSTANT,
    LENGTH,
    MARKS,
    PATH,
    PLACE,
    RIG,
    ROW_OF,
    ROWS,
    SLOPE,
    SPEED,
    UNITS,
    UNKNOWN_OF,
    UNKNOWNS,
    NodeRow,
    Problem,
)
from .flights import settable_rig
from .kernel_tasks import SOLVE, compute
from .multipliers import multipliers_of
from .newton import LEAST_RESIDUAL, NEWTON_STEPS, RESIDUAL_TOLERANCE
from .viability import why_not_viable

Array = NDArray[np.float64]


class Node(NamedTuple):
    """An event of a periodic motion."""

    kind: EventKind  # impact, reversal, stick or release
    stop: int  # the stop that m hits or leaves, or 0
    #: Mode of the motion after the node; `CHATTER_1` or `CHATTER_2` stands for the last bounces
    #: and the rest after them.
    mode: int

    @property
    def resting(self) -> int:
        """The mode `STICK`, `REST_1` or `REST_2` after the node, or 0 if m moves relative to M."""
        if self.mode < STICK:
            return 0
        return self.mode if self.mode < CHATTER_1 else self.mode - CHATTER_1 + REST_1


def impact_nodes(stops: Sequence[int]) -> tuple[Node, ...]:
    """
    Return the nodes of a motion of impacts only, in which friction keeps its sign.

    The nodes are the same without friction, so that a motion can be followed into friction.
    """
    modes = {0: FREE, 1: SLIDE_DOWN, -1: SLIDE_UP}
    later = [*stops[1:], stops[0]]
    return tuple(
        Node(EventKind.IMPACT, stop, modes[stop - end])
        for stop, end in zip(stops, later, strict=True)
    )


def last_stops(nodes: Sequence[Node]) -> NDArray[np.int64]:
    """Return the stop hit last in the flight after each node."""
    last, stops = 0, []
    for node in (*nodes, *nodes):
        last = node.stop if node.kind is EventKind.IMPACT else last
        stops.append(last)
    return np.array(stops[len(nodes) :], np.int64)


class _Layout(NamedTuple):
    """The layout by the nodes alone: their rows, and the equations and unknowns that count."""

    nodes: list[NodeRow]
    rows: Any  # the rows for kernels
    places: NDArray[np.int64]
    unknowns: int


def _upwards(before: Node, node: Node) -> bool:
    """Return whether m leaves its support upwards at a node, if it does."""
    return before.resting == REST_1 or (before.resting == STICK and node.mode == SLIDE_UP)


def _counting(node: Node) -> tuple[list[bool], list[bool]]:
    """Return masks of the equations and of the unknowns of a node that count."""
    impact, release = node.kind is EventKind.IMPACT, node.kind is EventKind.RELEASE
    moving = impact and not node.resting
    way = not (release and node.stop)
    return (
        [True, True, way, moving if impact else not release, release],
        [True, True, not node.stop, moving, True],
    )


@lru_cache(maxsize=64)
def _layout(nodes: tuple[Node, ...], compiles: bool) -> _Layout:
    rows, last = [], nodes[-1]
    for node, stop in zip(nodes, last_stops(nodes), strict=True):
        rows.append(
            NodeRow(
                kind=int(node.kind),
                stop=node.stop,
                mode=node.mode,
                resting=node.resting,
                direction=(node.mode == SLIDE_DOWN) - (node.mode == SLIDE_UP),
                last=int(stop),
                gives=1 if _upwards(last, node) else -1,
                returns=node.stop != 0 and node.stop == last.stop and len(nodes) > 1,
            )
        )
        last = node
    counting = np.array([_counting(node) for node in nodes])
    equations, unknowns = (np.flatnonzero(counting[:, k].ravel()) for k in range(2))
    places = np.full((4, 5 * len(nodes)), -1, np.int64)
    places[UNKNOWNS, : len(unknowns)] = unknowns
    for row, numbers in ((ROW_OF, equations), (UNKNOWN_OF, unknowns)):
        places[row, numbers] = np.arange(len(numbers))
    packed_nodes = pack_rows(rows, NodeRow) if compiles else rows
    return _Layout(rows, packed_nodes, places, len(unknowns))


def parameter_numbers(parameters: RigParameters) -> Array:
    """Return the numbers of a rig in the order of the kernels."""
    numbers = [getattr(parameters, name) for name in NUMBERS]
    for line in zip(*parameters.harmonics, strict=True):
        numbers += line
    return np.array(numbers, np.float64)


_NO_TRACE: Array = np.zeros((0, 0))


class PeriodicProblem:
    """
    The boundary-value problem of a rig and a sequence of nodes.

    Parameters
    ----------
    parameters : RigParameters
        The rig; all harmonics of its force repeat within the period.
    nodes : sequence of Node
        The events of a period, in order; one of them at least is an impact.
    cycles : int
        Period in cycles of the force's first harmonic.
    """

    def __init__(self, parameters: RigParameters, nodes: Sequence[Node], cycles: int) -> None:
        self.parameters = parameters
        self.nodes = tuple(nodes)
        self.cycles = cycles
        self.layout = layout = _layout(self.nodes, has_numba())
        count, size = len(self.nodes), layout.unknowns + 1
        rig = parameter_numbers(parameters)
        frequency = float(rig[FIRST_LINE + 1])
        self.cycle = math.tau / frequency
        self.period = cycles * self.cycle
        gravity = abs(parameters.gravity) * (1.0 + abs(parameters.friction))
        fall = (gravity + parameters.air_force / parameters.damper_mass) / frequency**2
        swing = abs(float(rig[FIRST_LINE])) / parameters.stiffness
        both = len({node.stop for node in self.nodes} - {0}) > 1
        self.length = max(swing, fall, parameters.gap if both else 0.0)
        self.arrays = Problem(
            moving=settable_rig((len(rig) - FIRST_LINE) // 3, parameters.one_sided),
            nodes=layout.rows,
            table=np.zeros((count, COLUMNS)),
            places=layout.places.copy(),
            sheet=np.zeros((ROWS + 3 * size, max(size, len(rig), NEWTON_STEPS + 1))),
        )
        self._sizes = len(rig), size
        self.rig[:] = rig
        self.units[:CONTACTS] = self.length, self.length * parameters.omega, cycles

    # The views are made at each call: in an object from another process they would be copies.
    @property
    def rig(self) -> Array:
        """The numbers of the rig."""
        row: Array = self.arrays.sheet[RIG, : self._sizes[0]]
        return row

    @property
    def place(self) -> Array:
        """The unknowns, and the parameter along the path."""
        row: Array = self.arrays.sheet[PLACE, : self._sizes[1]]
        return row

    @property
    def units(self) -> Array:
        """The units of the unknowns, the cycles, and a mark of the path."""
        row: Array = self.arrays.sheet[UNITS]
        return row

    def matrix(self, number: int) -> Array:
        """Return a matrix by the unknowns and the parameter, as a view of the sheet."""
        size = len(self.place)
        first = ROWS + number * size
        matrix: Array = self.arrays.sheet[first : first + size, :size]
        return matrix

    def trace_of(self, rows: int) -> Array:
        """Return room for points of a curve, as `arclength` has them, and for special points."""
        return np.zeros((rows + 2 * SPARE, COORDINATES + 2 * len(self.place)))

    def compute(
        self, task: int, in_order: bool, one: float, other: float, trace: Array = _NO_TRACE
    ) -> tuple[int, int]:
        """Let the kernels compute, as `kernel_tasks.compute`."""
        answer: tuple[int, int] = call_kernel(
            *(compute, self.arrays, trace, task, in_order, float(one), float(other)),
            what='periodic solver',
        )
        return answer

    def set_path(self, start: Array, slope: Array, order: int | None = None) -> None:
        """
        Set the path of rigs along the last unknown: numbers where that is 0, and slopes.

        Where the numbers have the motion of the base in place of its force, `order` is the
        derivative of its displacement that they give.
        """
        self.arrays.sheet[PATH, : len(start)], self.arrays.sheet[SLOPE, : len(slope)] = (
            start,
            slope,
        )
        others = np.concatenate([slope[: DAMPER_MASS + 1], slope[FIRST_LINE:]])
        rows = slice(0, 0) if order is None else self.parameters.base_rows
        self.units[CONTACTS : BASE_ORDER + 1] = not others.any(), rows.start, rows.stop, order or 0

    @cached_property
    def stops(self) -> tuple[int, ...]:
        """The stop hit at each impact."""
        return tuple(node.stop for node in self.nodes if node.kind is EventKind.IMPACT)

    def unknowns(self, states: Array, instants: Array) -> Array:
        """Return the unknowns of a guess, or of several."""
        length, speed = self.units[[LENGTH, SPEED]]
        units = length, speed, length, speed, 1.0 / self.rig[FIRST_LINE + 1]
        full = np.concatenate([states, instants[..., None]], axis=-1) / units
        counting = self.layout.places[UNKNOWNS, : self.layout.unknowns]
        values: Array = full.reshape(*instants.shape[:-1], -1)[..., counting]
        return values

    def solve(self, states: Array, instants: Array) -> Solution | None:
        """Return the solution to which Newton's method converges from a guess, or None."""
        self.place[:-1] = self.unknowns(states, instants)
        if not self.compute(SOLVE, True, LEAST_RESIDUAL, RESIDUAL_TOLERANCE)[0]:
            return None
        return self.solution(self.parameters)

    def solution(self, rig: RigParameters) -> Solution:
        """Return the solution that the kernels have reached, of a rig."""
        sheet = self.arrays.sheet
        return self._solution(rig, sheet[MARKS], sheet[HISTORY], self.arrays.table.copy())

    def rows_of_roots(self, count: int) -> Array:
        """Return room for roots in rows, as `root_search.write_root` has them."""
        width = self.layout.unknowns + KIND + NEWTON_STEPS + 1 + self.arrays.table.size
        return np.zeros((count, width))

    def solution_of(self, row: Array) -> Solution:
        """Return the solution in a row of roots."""
        marks, rest = row[self.layout.unknowns :][:KIND], row[self.layout.unknowns + KIND :]
        history, table = np.split(rest, [NEWTON_STEPS + 1])
        return self._solution(self.parameters, marks, history, table.reshape(-1, COLUMNS))

    def _solution(self, rig: RigParameters, notes: Array, past: Array, table: Array) -> Solution:
        marks, history = notes.tolist(), past.tolist()
        return Solution(
            problem=self,
            parameters=rig,
            cycle=math.tau / float(self.rig[FIRST_LINE + 1]),
            table=table,
            residual=marks[RESIDUAL],
            history=tuple(history[: history.index(-1.0)]),
            multipliers=multipliers_of_map(notes[MAP : MAP + 16], int(marks[SIZE])),
            viable=marks[VIABLE] > 0.0,
            x_max=marks[X_MAX],
        )


@dataclass(frozen=True)
class Solution:
    """A solution of the boundary-value problem."""

    problem: PeriodicProblem
    parameters: RigParameters
    cycle: float  # of the force, s
    table: Array  # the flights, as `closed_flights` has them
    residual: float  # the largest residual, relative to the displacements
    history: tuple[float, ...]  # the residual before each Newton step and at the end
    multipliers: tuple[complex, ...]  # four; sticking and rest make some of them zero
    viable: bool
    x_max: float

    @property
    def states(self) -> Array:
        """X (m), X' (m/s), Y from the stop hit last (m) and Y' (m/s) after each node, (n, 4)."""
        states: Array = self.table[:, :4]
        return states

    @property
    def instants(self) -> Array:
        """Instants of the nodes on the force's clock, s."""
        instants: Array = self.table[:, INSTANT]
        return instants

    @property
    def before(self) -> Array:
        """The states just before the nodes, (n, 4)."""
        return np.roll(self.table[:, END : END + 4], 1, axis=0)

    @property
    def reason(self) -> str:
        """Why the rig cannot perform the motion; empty if it can."""
        return '' if self.viable else why_not_viable(self.problem.layout.nodes, self.table)


def multipliers_of_map(entries: Array, size: int) -> tuple[complex, ...]:
    """Return the four multipliers of a map with some free coordinates, row by row."""
    free = entries.reshape(4, 4)[:size, :size]
    return multipliers_of(free) + (0j,) * (4 - size)
