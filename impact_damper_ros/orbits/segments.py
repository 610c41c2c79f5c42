# SPDX-License-Identifier: Apache-2.0
"""
Periodic motions as one boundary-value problem.

The events of a period are its nodes: impacts, plastic ones and those that begin the last bounces
of a chatter among them, reversals of friction, and the beginnings and ends of sticking and rest.
Between two nodes the motion is one flight in closed form. The unknowns are the state just after
each node, as far as it is free, and the instants; the equations are that each flight leads to
the next node, and the condition of that node [1]_:

- impact: m is at the stop. The relative velocity after it is -R times the one before, or zero
  where the impact is plastic or belongs to the last bounces before rest, which act as one plastic
  impact;
- reversal, and the beginning of sticking: the relative velocity is zero;
- release: m needs as much from its support as friction gives.

All derivatives are analytic. A flight carries deviations by its free vibration, Phi; a later start
from the same state changes its end by -Phi f+, a later end by f-, where f is the rate of the
state just after and just before a node. The multipliers are those of the product of the Phi and of
the saltation matrices

    S = D + (f+ - D f-) grad h / (grad h . f-),

where h is the condition and D the derivative of the jump [2]_.

References
----------
.. [1] H. Dankowicz, F. Schilder, Recipes for Continuation, SIAM (2013), chapter 9.
.. [2] A. B. Nordmark, J. Sound Vib. 145, 279-297 (1991).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import CHATTER_1, FREE, REST_1, SLIDE_DOWN, SLIDE_UP, STICK
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .flights import Flight, flight_at, machine_of
from .multipliers import AWAY, FlightConstants, FlightLaws, event_matrices, jumps, multipliers_of
from .response import Array, forced_response, free_response

#: Largest relative residual of a solution; just beyond a fold the least residual is not zero.
RESIDUAL_TOLERANCE = 1e-12

_NEWTON_STEPS = 40
_LEAST_RESIDUAL = 4e-16
#: A residual that only round-off can keep from falling.
_SETTLED = 1e-13
_SHORTEST_SHARE = 0.2
#: Most equations that are solved by least squares, which takes long for many.
_MOST_BY_SQUARES = 16

# Coordinates of the state: X, X', the way of m from the stop hit last, positive towards stop 1, so
# that it keeps its digits in short bounces, and Y'; then the instant.
_X, _V, _Y, _U, _T = range(5)
#: The fifth equation of a node: what m needs from its support.
_NEED = 4


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


_Complex = NDArray[np.complex128]


def _total(turning: _Complex) -> Array:
    """Return the sum of the imaginary parts over the harmonics."""
    parts = turning.imag
    total: Array = parts[..., 0] if parts.shape[-1] == 1 else parts.sum(axis=-1)
    return total


class FlightEnds(NamedTuple):
    """
    Where the flights after all nodes lead, shapes (..., n, 4) and (..., n, 4, 4).

    State at the end, its derivative by the state at the start, rates of the state at both, and
    X''' at the end.
    """

    end: Array
    matrix: Array
    rate_start: Array
    rate_end: Array
    jerk: Array


def last_stops(nodes: Sequence[Node]) -> NDArray[np.int64]:
    """Return the stop hit last in the flight after each node."""
    last, stops = 0, []
    for node in (*nodes, *nodes):
        last = node.stop if node.kind is EventKind.IMPACT else last
        stops.append(last)
    return np.array(stops[len(nodes) :], np.int64)


class _Layout:
    """What the nodes alone say: which equations and unknowns count, and where they are."""

    def __init__(self, nodes: tuple[Node, ...]) -> None:
        n = len(nodes)
        self.last, self.next = np.roll(np.arange(n), 1), np.roll(np.arange(n), -1)
        #: Stop hit last in the flight after each node, and what that is like
        self.last_stops = last_stops(nodes)
        #: The way from the stop hit last before each node to the one hit last after it, in gaps
        self.across = self.last_stops * 1.0 - self.last_stops[self.last]
        modes = np.array([node.mode for node in nodes], np.int64)
        self.joint, self.away = modes >= STICK, AWAY[self.last_stops]
        self.direction = (modes == SLIDE_DOWN) * 1.0 - (modes == SLIDE_UP)
        stop = np.array([node.stop for node in nodes])
        self.both_hit = len(set(stop) - {0}) > 1
        #: Impacts, and those after which m moves, on each stop
        self.impact = np.array([node.kind is EventKind.IMPACT for node in nodes])
        self.bounce_1 = self.impact & ~self.joint & (stop == 1)
        self.bounce_2 = self.impact & ~self.joint & (stop == 2)
        #: Whether a node ends a bounce that returns to the stop it came from
        self.returns = (stop != 0) & (stop == stop[self.last]) & (n > 1)
        self.any_returns = bool(self.returns.any())
        release = np.array([node.kind is EventKind.RELEASE for node in nodes])
        #: The equation that is the condition of each node
        self.conditions = np.where(self.impact, _Y, np.where(release, _NEED, _U))
        #: Sign of the need at which the support gives way
        self.gives_way = np.array(
            [1.0 if self._upwards(nodes[j - 1], nodes[j]) else -1.0 for j in range(n)]
        )
        moving = self.impact & ~self.joint
        rows, columns = np.ones((n, 5), bool), np.ones((n, 5), bool)
        rows[:, _Y] = ~(release & (stop != 0))
        rows[:, _U] = np.where(self.impact, moving, ~release)
        rows[:, _NEED] = release
        columns[:, _Y] = stop == 0
        columns[:, _U] = moving
        self._place_blocks(rows, columns)

    @staticmethod
    def _upwards(before: Node, node: Node) -> bool:
        """Return whether m leaves its support upwards at a node, if it does."""
        resting = before.resting
        return resting == REST_1 or (resting == STICK and node.mode == SLIDE_UP)

    def _place_blocks(self, rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> None:
        """Find where the derivatives of each node are in the matrix of those that count."""
        n = len(rows)
        self.rows, self.columns = np.flatnonzero(rows), np.flatnonzero(columns)
        m = len(self.rows)
        row, column = np.full(5 * n, -1), np.full(5 * n, -1)
        row[self.rows] = column[self.columns] = np.arange(m)
        #: Derivatives by the state and the instant at the node before, in rows of seven
        j, r, c = (index.ravel() for index in np.indices((n, 5, 5)))
        to_row, to_column = row[5 * j + r], column[5 * self.last[j] + c]
        counts = (to_row >= 0) & (to_column >= 0)
        self.block_from = (35 * j + 7 * r + c)[counts]
        self.block_to = (m * to_row + to_column)[counts]
        #: Those by the state of the node itself, which are constant, and by its instant
        own = np.zeros((m, m))
        both = np.flatnonzero((row >= 0) & (column >= 0) & (np.arange(5 * n) % 5 != _T))
        own[row[both], column[both]] = -1.0
        self.own = own.ravel()
        self.late_from, self.value_from = 7 * self.rows + 5, 7 * self.rows + 6
        self.late_to = m * np.arange(m) + column[5 * (self.rows // 5) + _T]


_layout = lru_cache(maxsize=64)(_Layout)


class Segments:
    """
    The boundary-value problem of one sequence of nodes.

    Arrays of states have the shape (..., n, 4), those of instants on the force's clock (s) the
    shape (..., n): many guesses are solved at once. The unknowns (..., m) are without dimension.

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
        self.constants = constants = FlightConstants.of(parameters)
        amplitudes, frequencies, phases = map(np.array, parameters.harmonics)
        self.cycle = math.tau / float(frequencies[0])
        self.period = cycles * self.cycle
        self.rate = math.sqrt(constants.free.omega_squared)
        self.layout = layout = _layout(self.nodes)
        joint = layout.joint
        self.laws = FlightLaws.of(constants, joint, layout.direction, layout.away)
        acting = amplitudes != 0.0
        self._frequencies, self._phases = frequencies[acting], phases[acting]
        mass = parameters.primary_mass + np.where(joint, parameters.damper_mass, 0.0)
        self._forces: Array = amplitudes[acting] / mass[:, None]
        # The jump at each node, and the derivative of what m needs from its support
        restitution = (
            layout.bounce_1 * constants.restitution_1 + layout.bounce_2 * constants.restitution_2
        )
        self._jump = np.zeros((len(joint), 5, 4))
        self._jump[:, :4] = jumps(constants.share, layout.impact, restitution)
        self._jump[:, _NEED, _X] = -self.laws.stiffness[layout.last]
        self._jump[:, _NEED, _V] = -2.0 * self.laws.decay[layout.last]
        air = constants.air * layout.away[layout.last]
        self._need: Array = constants.slope + air + layout.gives_way * constants.grip
        across = 0.0 if constants.one_sided else 2.0 * constants.half_gap
        self._across = np.multiply(across, layout.across)
        swing = abs(float(amplitudes[0])) / parameters.stiffness
        fall = float(np.abs(self.laws.slide).max()) / float(frequencies[0]) ** 2
        length = max(swing, fall, across if layout.both_hit else 0.0)
        self.set_units(length, length * self.rate, self.rate)

    def set_units(self, length: float, speed: float, rate: float) -> None:
        """Set the units of displacements (m), velocities (m/s) and, as its inverse, time."""
        self.length = length
        self._units = np.array([length, speed, length, speed, 1.0 / rate])
        row_units = np.array([length, speed, length, speed, speed * self.rate])
        self._column_scale = self._units[self.layout.columns % 5]
        self._row_scale = row_units[self.layout.rows % 5]
        self._scale = (self._column_scale / self._row_scale[:, None]).ravel()

    @property
    def stops(self) -> tuple[int, ...]:
        """The stop hit at each impact."""
        return tuple(node.stop for node in self.nodes if node.kind is EventKind.IMPACT)

    def unknowns(self, states: Array, instants: Array) -> Array:
        """Return the unknowns of a guess."""
        full = np.concatenate([states, instants[..., None]], axis=-1) / self._units
        shape = (*instants.shape[:-1], 5 * len(self.nodes))
        values: Array = full.reshape(shape)[..., self.layout.columns]
        return values

    def motion(self, unknowns: Array) -> tuple[Array, Array]:
        """Return the states and instants of unknowns."""
        n = len(self.nodes)
        full = np.zeros((*unknowns.shape[:-1], 5 * n))
        full[..., self.layout.columns] = unknowns * self._column_scale
        full = full.reshape(*unknowns.shape[:-1], n, 5)
        return full[..., :4], full[..., _T]

    def durations(self, instants: Array) -> Array:
        """Return the durations of the flights after the nodes, s."""
        lasts: Array = instants[..., self.layout.next] - instants
        lasts[..., -1] += self.period
        return lasts

    def _force(self, instants: Array) -> _Complex:
        """Return the harmonics of the force over the mass that moves, as phasors."""
        phasors: _Complex = np.exp(1j * (self._frequencies * instants[..., None] + self._phases))
        phasors *= self._forces
        return phasors

    def flights(self, states: Array, instants: Array) -> FlightEnds:
        """Return the flights after all nodes, from the states just after these."""
        lasts = self.durations(instants)
        x, v, y, u = (states[..., i] for i in range(4))
        decay, damped, stiffness, push, slide, moves = self.laws
        response = free_response(decay, damped, lasts)
        less, impulse, slope = response
        x_forced, v_forced = forced_response(
            decay[:, None], damped[:, None], self._frequencies, lasts[..., None]
        )
        turn = self._force(instants)
        turn_end = self._force(instants + lasts)
        offset = x - push / stiffness
        move = offset * less + v * impulse + _total(turn * x_forced)
        gain = v * (slope - 1.0) - stiffness * offset * impulse + _total(turn * v_forced)
        end = np.empty((*lasts.shape, 4))
        end[..., _X] = x + move
        end[..., _V] = v + gain
        end[..., _Y] = y + moves * ((v + u + 0.5 * slide * lasts) * lasts - move)
        end[..., _U] = moves * (u + slide * lasts - gain)
        rate_start = self.laws.rates(x, v, u, _total(turn))
        rate_end = self.laws.rates(end[..., _X], end[..., _V], end[..., _U], _total(turn_end))
        jerk = (
            _total(turn_end * self._frequencies * 1j)
            - 2.0 * decay * rate_end[..., _V]
            - stiffness * end[..., _V]
        )
        matrix = self.laws.matrices(lasts, response)
        return FlightEnds(end, matrix, rate_start, rate_end, jerk)

    def residual(self, unknowns: Array) -> tuple[Array, Array]:
        """Return the residual (..., m) of the equations and its derivative by the unknowns."""
        states, instants = self.motion(unknowns)
        after = self.flights(states, instants)
        last = self.layout.last
        # By the state at the node before, and by the instants of that and of the node; the state
        ends = np.empty((*states.shape, 7))
        ends[..., :4] = after.matrix[..., last, :, :]
        ends[..., 4] = -(ends[..., :4] @ after.rate_start[..., last, :, None])[..., 0]
        ends[..., 5] = after.rate_end[..., last, :]
        ends[..., 6] = after.end[..., last, :]
        there = self._jump @ ends
        blocks, later, value = there[..., :5], there[..., 5], there[..., 6]
        value[..., :4] -= states
        value[..., _Y] += self._across
        value[..., _NEED] = after.rate_end[..., last, _V] - self._need
        later[..., _NEED] = after.jerk[..., last]
        if self.layout.any_returns:
            # The mean velocity of a bounce is zero, rather than the way: or else two impacts at
            # once would be a solution.
            lasts = self.durations(instants)[..., last]
            part = np.where(self.layout.returns, 1.0 / (self.rate * lasts), 1.0)
            value[..., _Y] *= part
            blocks[..., _Y, :] *= part[..., None]
            later[..., _Y] *= part
            late = np.where(self.layout.returns, value[..., _Y] / lasts, 0.0)
            blocks[..., _Y, _T] += late
            later[..., _Y] -= late
        m, shape = len(self.layout.rows), instants.shape[:-1]
        jacobian = np.empty((*shape, m * m))
        jacobian[...] = self.layout.own
        flat = there.reshape(*shape, -1)
        jacobian[..., self.layout.block_to] += flat[..., self.layout.block_from]
        jacobian[..., self.layout.late_to] += flat[..., self.layout.late_from]
        jacobian *= self._scale
        return flat[..., self.layout.value_from] / self._row_scale, jacobian.reshape(*shape, m, m)

    def by_gap(self) -> Array:
        """Return the derivative of the residual by the gap, 1/m, at any unknowns."""
        value = np.zeros((len(self.nodes), 5))
        value[:, _Y] = self.layout.across
        rows: Array = value.ravel()[self.layout.rows] / self._row_scale
        return rows

    def longest_part(self, unknowns: Array, step: Array) -> Array:
        """Return the largest part of a step, at most 1, that keeps every duration positive."""
        instants = self.motion(unknowns)[1]
        times = self.motion(step)[1]
        changes = times[..., self.layout.next] - times
        with np.errstate(divide='ignore', invalid='ignore'):
            parts = np.where(
                changes < 0.0, -(1.0 - _SHORTEST_SHARE) * self.durations(instants) / changes, 1.0
            )
        smallest: Array = np.minimum(parts.min(axis=-1), 1.0)
        return smallest

    def begins_with(self) -> int:
        """Return the node after which the state has the fewest free coordinates."""
        sizes = {0: 4, STICK: 3}
        return min(range(len(self.nodes)), key=lambda j: sizes.get(self.nodes[j].resting, 2))

    def monodromy(self, after: FlightEnds) -> Array:
        """Return the derivative of the state after a node by itself, a period later."""
        layout = self.layout
        before = after.rate_end[layout.last]
        through = event_matrices(self._jump[:, :4], layout.impact, before, after.rate_start)
        first = self.begins_with()
        product = np.eye(4)
        for k in range(len(self.nodes)):
            i = (first + k) % len(self.nodes)
            product = through[(i + 1) % len(self.nodes)] @ (after.matrix[i] @ product)
        return product

    def multipliers(self, after: FlightEnds) -> tuple[complex, ...]:
        """Return the four multipliers; those that belong to sticking or rest are zero."""
        with np.errstate(over='ignore', invalid='ignore'):
            matrix = self.monodromy(after)
        size = {0: 4, STICK: 3}.get(self.nodes[self.begins_with()].resting, 2)
        if not np.isfinite(matrix).all():
            raise ArithmeticError('the derivative grows beyond all numbers')
        return multipliers_of(matrix[:size, :size]) + (0j,) * (4 - size)

    def flight(self, node: int, state: Array, instant: float) -> Flight:
        """Return the simulator's flight from just after a node, in the mode of that."""
        kind, _, mode = self.nodes[node]
        x, velocity, way, relative = (float(value) for value in state)
        resting, last = self.nodes[node].resting, int(self.layout.last_stops[node])
        across = 2.0 * self.constants.half_gap
        beyond = way if last == 1 else way - across
        machine = machine_of(self.parameters)
        flight = flight_at(machine, float(instant), x, velocity, beyond, relative, resting, last)
        if last == 2:
            flight.run.clearance_2 = max(0.0, way)
        if mode < STICK and self.constants.grip == 0.0:
            mode = FREE
        flight.run.mode = resting or mode
        flight.run.released = kind is EventKind.RELEASE
        return flight.begun()


@dataclass(frozen=True)
class Solution:
    """A solution of the boundary-value problem."""

    segments: Segments
    #: X (m), X' (m/s), Y from the stop hit last (m) and Y' (m/s) just after each node, (n, 4)
    states: Array
    instants: Array  # of the nodes on the force's clock, s
    residual: float  # the largest, relative to the displacements
    history: tuple[float, ...]  # the residual before each Newton step and at the end

    @cached_property
    def flights(self) -> FlightEnds:
        """The flights after all nodes."""
        return self.segments.flights(self.states, self.instants)


System = Callable[[Array], tuple[Array, Array]]


def _newton_step(value: Array, jacobian: Array) -> Array:
    """Return the step of Newton's method, the shortest one if the equations are dependent."""
    if len(value) > _MOST_BY_SQUARES:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(-np.linalg.solve(jacobian, value), np.float64)
    return np.asarray(np.linalg.lstsq(jacobian, -value, rcond=1e-14)[0], np.float64)


class Root(NamedTuple):
    """The best unknowns that Newton's method has reached."""

    unknowns: Array
    #: The derivative of the equations there
    jacobian: Array
    #: Largest residual, and what it was before each step and at the end
    residual: float
    history: tuple[float, ...]


# A guess may have two impacts at once: it is dropped.
@np.errstate(divide='ignore', invalid='ignore', over='ignore')
def newton(
    system: System,
    unknowns: Array,
    longest_part: Callable[[Array, Array], Array | float],
    enough: float = _LEAST_RESIDUAL,
) -> Root:
    """
    Run Newton's method on a system of equations until the residual no longer falls.

    The system is a residual and its derivative by the unknowns; steps of least squares suit a
    derivative without full rank. A residual below `enough` ends it.
    """
    history: list[float] = []
    best, least = (unknowns, np.empty(0)), math.inf
    stalled = 0
    for _ in range(_NEWTON_STEPS):
        value, jacobian = system(unknowns)
        size = float(np.abs(value).max())
        if not np.isfinite(size) or not np.isfinite(jacobian).all():
            break
        history.append(size)
        stalled = 0 if size < 0.5 * least else stalled + 1
        if size < least:
            best, least = (unknowns, jacobian), size
        if size < enough or stalled >= (3 if least > _SETTLED else 1):
            break
        step = _newton_step(value, jacobian)
        part = float(longest_part(unknowns, step))
        unknowns = unknowns + part * step
    return Root(*best, least, tuple(history))


def solve(segments: Segments, states: Array, instants: Array) -> Solution | None:
    """
    Return the solution that Newton's method leads to from a guess, if it does.

    Most candidates of a scan are not roots. This method rejects them sooner than
    `scipy.optimize.root`, with which a scan takes twice as long.
    """
    guess = segments.unknowns(states, instants)
    root = newton(segments.residual, guess, segments.longest_part)
    states, instants = segments.motion(root.unknowns)
    residual = root.residual / max(1.0, float(np.abs(states[:, _X]).max()) / segments.length)
    if residual > RESIDUAL_TOLERANCE:
        return None
    return Solution(segments, states, instants, residual, root.history)
