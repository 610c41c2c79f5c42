# SPDX-License-Identifier: Apache-2.0
"""The boundary-value problem of a rig and a sequence of nodes: its arrays, and its solutions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.compiled import (
    compiled,
    dtype_of,
    has_numba,
    packed,
    packed_rows,
)
from impact_damper_ros.motion.event import EventKind, EventRow
from impact_damper_ros.motion.oscillator import Line, Oscillator
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
    Moving,
    RigConstants,
    Run,
    Wave,
)
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arclength import MARKS, RESIDUAL, SIZE, SOLVE, VIABLE, X_MAX, Trace, compute
from .closed_flights import (
    COLUMNS,
    CONTACTS,
    END,
    INSTANT,
    LENGTH,
    NEWTON_STEPS,
    RESIDUAL_TOLERANCE,
    SPAN,
    SPEED,
    NodeRow,
    Problem,
)
from .multipliers import multipliers_of
from .viability import LEFT, why_not_viable

Array = NDArray[np.float64]
#: A residual that is as small as round-off allows.
_LEAST_RESIDUAL = 4e-16


class Node(NamedTuple):
    """An event of a periodic motion."""

    kind: EventKind  # impact, reversal, stick or release
    stop: int  # that m hits or leaves, or 0
    #: Of the motion after it; `CHATTER_1` or `CHATTER_2` stands for the last bounces and the rest
    #: after them.
    mode: int

    @property
    def resting(self) -> int:
        """The mode `STICK`, `REST_1` or `REST_2` after it, or 0 if m moves relative to M."""
        if self.mode < STICK:
            return 0
        return self.mode if self.mode < CHATTER_1 else self.mode - CHATTER_1 + REST_1


def impact_nodes(stops: Sequence[int]) -> tuple[Node, ...]:
    """
    Return the nodes of a motion of impacts only, in which friction keeps its sign.

    Without friction as well, so that they are the same when it comes.
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
    """What the nodes alone say: their rows, and which equations and unknowns count."""

    nodes: list[NodeRow]
    rows: Any  # the same for kernels
    places: NDArray[np.int64]
    unknowns: int


def _upwards(before: Node, node: Node) -> bool:
    """Return whether m leaves its support upwards at a node, if it does."""
    return before.resting == REST_1 or (before.resting == STICK and node.mode == SLIDE_UP)


def _counting(node: Node) -> tuple[list[bool], list[bool]]:
    """Return which equations and which unknowns of a node count."""
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
    count = 5 * len(nodes)
    places = np.full((4, count), -1, np.int64)
    for k in range(2):
        numbers = np.flatnonzero(counting[:, k].ravel())
        places[k, : len(numbers)] = numbers
        places[2 + k, numbers] = np.arange(len(numbers))
    packed_nodes = packed_rows(rows, NodeRow) if compiles else rows
    return _Layout(rows, packed_nodes, places, len(numbers))


def _zeros(cls: Any) -> Any:
    """Return an object of a class of constants that kernels may set."""
    if has_numba():
        return np.zeros(1, dtype_of(cls))[0]
    return SimpleNamespace(**dict.fromkeys(cls._fields, 0.0))


def _moving(harmonics: int, one_sided: bool) -> Moving:
    """Return a rig that kernels set and move."""
    constants, run = _zeros(RigConstants), Run()
    waves = [Wave() for _ in range(harmonics)]
    if has_numba():
        constants['harmonics'], constants['one_sided'] = harmonics, one_sided
        lines: Any = np.zeros(2 * harmonics, dtype_of(Line))
        log: Any = np.zeros(0, dtype_of(EventRow))
        return Moving(constants, lines, packed(run), packed_rows(waves, Wave), log)
    constants.harmonics, constants.one_sided = harmonics, one_sided
    constants.free, constants.joint = _zeros(Oscillator), _zeros(Oscillator)
    return Moving(constants, [_zeros(Line) for _ in range(2 * harmonics)], run, waves, [])


def numbers_of(parameters: RigParameters) -> Array:
    """Return the numbers of a rig, as the kernels have them."""
    numbers = [getattr(parameters, name) for name in NUMBERS]
    for line in zip(*parameters.harmonics, strict=True):
        numbers += line
    return np.array(numbers, np.float64)


def call_kernel(function: Any, *arguments: Any) -> Any:
    """Call a kernel compiled, or as it is where there is no compiler."""
    if not has_numba():
        with np.errstate(all='ignore'):
            return function(*arguments)
    return compiled(function.__name__, arguments, 'periodic solver')(*arguments)


_NO_TRACE = Trace(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))


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
        rig = numbers_of(parameters)
        frequency = float(rig[FIRST_LINE + 1])
        self.cycle = math.tau / frequency
        self.period = cycles * self.cycle
        gravity = abs(parameters.gravity) * (1.0 + abs(parameters.friction))
        fall = (gravity + parameters.air_force / parameters.damper_mass) / frequency**2
        swing = abs(float(rig[FIRST_LINE])) / parameters.stiffness
        both = len({node.stop for node in self.nodes} - {0}) > 1
        self.length = max(swing, fall, parameters.gap if both else 0.0)
        units = np.array([self.length, self.length * parameters.omega, cycles, 0.0])
        self.arrays = Problem(
            moving=_moving((len(rig) - FIRST_LINE) // 3, parameters.one_sided),
            nodes=layout.rows,
            rig=rig,
            path=np.zeros((2, len(rig))),
            table=np.zeros((count, COLUMNS)),
            places=layout.places,
            units=units,
            place=np.zeros(size),
            vectors=np.zeros((8, size)),
            matrices=np.zeros((3, size, size)),
            lead=np.zeros(size, np.int64),
            history=np.zeros(NEWTON_STEPS + 1),
            frames=np.zeros((5, 6, 6)),
            faults=np.zeros((count, 5)),
            marks=np.zeros(MARKS),
        )

    def trace_of(self, rows: int) -> Trace:
        """Return room for points of a curve."""
        size = self.layout.unknowns + 1
        places, tangents = np.zeros((2, rows, size))
        return Trace(places, tangents, np.zeros((rows, MARKS)), np.zeros(2))

    def compute(
        self, task: int, in_order: bool, one: float, other: float, trace: Trace = _NO_TRACE
    ) -> tuple[int, int]:
        """Let the kernels compute, as `arclength.compute`."""
        answer: tuple[int, int] = call_kernel(
            compute, self.arrays, trace, task, in_order, float(one), float(other)
        )
        return answer

    def set_path(self, start: Array, slope: Array) -> None:
        """Let a path of rigs be given by the last unknown: numbers where it is 0, and slopes."""
        self.arrays.path[0], self.arrays.path[1] = start, slope
        others = np.concatenate([slope[: DAMPER_MASS + 1], slope[FIRST_LINE:]])
        self.arrays.units[CONTACTS] = not others.any()

    @cached_property
    def stops(self) -> tuple[int, ...]:
        """The stop hit at each impact."""
        return tuple(node.stop for node in self.nodes if node.kind is EventKind.IMPACT)

    @property
    def units(self) -> Array:
        """Units of the unknowns of a node."""
        length, speed = self.arrays.units[[LENGTH, SPEED]]
        rate = 1.0 / self.arrays.rig[FIRST_LINE + 1]
        return np.array([length, speed, length, speed, rate])

    def unknowns(self, states: Array, instants: Array) -> Array:
        """Return the unknowns of a guess, or of several."""
        full = np.concatenate([states, instants[..., None]], axis=-1) / self.units
        counting = self.layout.places[1, : self.layout.unknowns]
        values: Array = full.reshape(*instants.shape[:-1], -1)[..., counting]
        return values

    def solve(self, states: Array, instants: Array) -> Solution | None:
        """Return the solution that Newton's method leads to from a guess, if it does."""
        self.arrays.place[:-1] = self.unknowns(states, instants)
        if not self.compute(SOLVE, True, _LEAST_RESIDUAL, RESIDUAL_TOLERANCE)[0]:
            return None
        return self.solution(self.parameters)

    def solution(self, rig: RigParameters) -> Solution:
        """Return the solution that the kernels have reached, of a rig."""
        table, marks = self.arrays.table, self.arrays.marks.tolist()
        history, size = self.arrays.history.tolist(), int(marks[SIZE])
        return Solution(
            problem=self,
            parameters=rig,
            cycle=math.tau / float(self.arrays.rig[FIRST_LINE + 1]),
            states=table[:, :4].copy(),
            instants=table[:, INSTANT].copy(),
            before=np.roll(table[:, END : END + 4], 1, axis=0),
            spans=table[:, SPAN].tolist(),
            residual=marks[RESIDUAL],
            history=tuple(history[: history.index(-1.0)]),
            monodromy=self.arrays.frames[0, :size, :size].copy(),
            faults=self.arrays.faults.copy(),
            viable=marks[VIABLE] > 0.0,
            x_max=marks[X_MAX],
        )


@dataclass(frozen=True)
class Solution:
    """A solution of the boundary-value problem."""

    problem: PeriodicProblem
    parameters: RigParameters
    cycle: float  # of the force, s
    #: X (m), X' (m/s), Y from the stop hit last (m) and Y' (m/s) just after each node, (n, 4)
    states: Array
    instants: Array  # of the nodes on the force's clock, s
    before: Array  # the states just before the nodes, (n, 4)
    spans: list[float]  # durations of the flights after the nodes, s
    residual: float  # the largest, relative to the displacements
    history: tuple[float, ...]  # the residual before each Newton step and at the end
    monodromy: Array
    faults: Array
    viable: bool
    x_max: float

    @property
    def reason(self) -> str:
        """Why the rig cannot perform it; empty if it can."""
        if self.viable:
            return ''
        return why_not_viable(self.problem.layout.nodes, self.faults, self.spans)

    @property
    def chatter_left(self) -> Array:
        """How long the chatter after each node lasts, s."""
        left: Array = self.faults[:, LEFT]
        return left

    @cached_property
    def multipliers(self) -> tuple[complex, ...]:
        """The four multipliers; those that belong to sticking or rest are zero."""
        return multipliers_of(self.monodromy) + (0j,) * (4 - len(self.monodromy))
