# SPDX-License-Identifier: Apache-2.0
"""
Multiple shooting in closed form: data and laws over all flights, with their derivatives.

As in `orbits.closed_flights` nodes are events, here impacts and turns, and the unknowns are their
instants and the states (X, X', Y, Z') just after them; data replace the closure, and the
parameters are unknown, too. From node to node the motion is one closed formula, so that no error
is carried over more than one flight, even in chaotic motion.

Conditions that always hold are the motion of M in each flight and its jump at each impact. The
laws of m,

- velocity: m arrives at an impact with alpha J relative to M, where J is the jump of X',
- place: m arrives at the stop,
- turn: m is as fast as M where it reverses or sticks; friction is at its limit at a release,

are imposed exactly, or at first softly, with a deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.kernels import call_kernel

from .course import Course
from .node_kernels import (
    ARRIVALS,
    HIT,
    PAIR,
    RELEASES,
    REVERSES,
    STAYS,
    write_condition_rates,
    write_conditions,
)
from .node_motion import NodeMotion
from .nodes import T, Y
from .record import Record
from .sample_kernels import SAMPLE
from .system_kernels import add_transposed
from .unknowns import Unknowns
from .vibration import Array

#: Conditions of a flight: the law of the velocities at its end, that of Y, and the last one.
_AT_V, _AT_Y, _LAST = 1, 3, 4
#: A friction that is zero, m/s^2.
_NO_GRIP = 1e-6
#: Step of derivatives by K, C and the delay, in natural units, and of those by friction, which are
#: the same for all steps, in the largest acceleration.
_STEP, _STEP_OF_GRIP = 1e-7, 1e-2
#: A speed at which restitution is that at rest, m/s; and iterations of the speed of a jump.
_LEAST_SPEED, _TURNS = 1e-9, 12


class Equations(NamedTuple):
    """
    Residuals and conditions at a guess, and their derivatives.

    Attributes
    ----------
    residual : ndarray
        Residuals of the data and of impact times, over their deviations; then soft laws.
    condition : ndarray
        Conditions that must be zero, in standard deviations of the data.
    samples : ndarray, shape (n, 3 + s)
        Derivatives of the residuals of the data by instant, X and X' of the node before, and by
        the s shared unknowns.
    sample_node : ndarray of int, shape (n,)
        The node before each sample.
    rows : ndarray, shape (r + c, 10 + s)
        Derivatives of the other r residuals and of the c conditions by the unknowns of the node
        before, of the node, and by the shared ones.
    row_node : ndarray of int, shape (r + c,)
        The node to which each of these belongs.
    size, shared : int
        Number of unknowns, and of those that belong to no node: they come first, then five of
        each node.
    """

    residual: Array
    condition: Array
    samples: Array
    sample_node: NDArray[np.int64]
    rows: Array
    row_node: NDArray[np.int64]
    size: int
    shared: int

    @property
    def others(self) -> int:
        """Number of residuals that belong to no sample."""
        return len(self.residual) - len(self.samples)

    def changes(self, step: Array) -> tuple[Array, Array]:
        """Return the changes of residuals and conditions with a step of the unknowns."""
        shared, states = step[: self.shared], step[self.shared :].reshape(-1, 5)
        both = np.concatenate([np.roll(states, 1, axis=0), states], axis=1)
        found = np.concatenate(
            [
                np.sum(self.samples[:, :3] * states[self.sample_node, :3], axis=1)
                + self.samples[:, 3:] @ shared,
                np.sum(self.rows[:, :10] * both[self.row_node], axis=1)
                + self.rows[:, 10:] @ shared,
            ]
        )
        return found[: len(self.residual)], found[len(self.residual) :]

    def transpose_times(self, right: Array) -> Array:
        """Return the products of the transposed derivatives of residuals with columns."""
        found = np.zeros((self.size, right.shape[1]))
        call_kernel(
            *(add_transposed, self.samples, self.sample_node, self.rows, self.row_node),
            *(np.ascontiguousarray(right), found),
            what='fit',
        )
        return found


class Further(NamedTuple):
    """A small further motion of M: the measured quantity at samples, X, X' and X'' at `ends`."""

    signal: Array
    x: Array
    velocity: Array
    acceleration: Array


class Shooting(NodeMotion):
    """
    The equations of one course.

    Parameters
    ----------
    record : Record
        The measured motion.
    deviation : float
        Standard deviation of the noise.
    unknowns : Unknowns
        The shared unknowns.
    course : Course
        The course; its numbers are the first guess.
    impact_times : ndarray
        Measured instants of impacts.
    impact_deviation : float
        Standard deviation of these instants.
    masked : float
        Samples closer to an impact than this are not used, s.
    """

    def __init__(
        self,
        record: Record,
        deviation: float,
        unknowns: Unknowns,
        course: Course,
        impact_times: Array,
        impact_deviation: float,
        masked: float = 0.0,
    ) -> None:
        self.deviation, self.impact_deviation = deviation, impact_deviation
        #: Whether friction is fixed at zero, since the best value is negative.
        self.frictionless = False
        self.further: Further | None = None
        self.rate = float(np.sqrt(course.shared[0] / unknowns.rig.primary_mass))
        # Displacement that corresponds to the noise of the measured quantity
        self.length = deviation / self.rate**record.order
        weight = record.weight / deviation
        if masked:
            nearest = np.searchsorted(course.time, record.time)
            before = course.time[np.maximum(nearest - 1, 0)]
            after = course.time[np.minimum(nearest, len(course) - 1)]
            near = np.minimum(np.abs(record.time - before), np.abs(record.time - after))
            weight = weight * (near > masked)
        super().__init__(record, unknowns, course, impact_times, weight)

    @property
    def freedom(self) -> int:
        """Number of unknowns less number of conditions."""
        conditions = 5 * len(self.ends) + len(self.firsts) + len(self.holds)
        return self.size - conditions

    @cached_property
    def _varied(self) -> dict[int, float]:
        """Shared unknowns by which derivatives are taken by differences, friction last; steps."""
        mass = self.unknowns.rig.primary_mass
        column, fastest = self.unknowns.column, float(np.abs(self.course.velocity).max())
        steps = {
            0: _STEP * mass * self.rate**2,
            1: _STEP * mass * self.rate,
            column('force_delay'): _STEP / self.rate,
            column('grip'): _STEP_OF_GRIP * self.rate * fastest,
        }
        return {place: step for place, step in steps.items() if place >= 0}

    def residual(self, u: Array, soft: float = 0.0) -> tuple[Array, Array]:
        """Return residuals and conditions, as in `Equations`."""
        shared, states = self.parts(u)
        arrivals = self._fly([shared], states)[0]
        conditions = self._conditions(u, arrivals, self._alphas(u, arrivals))
        return self._split(soft, u, self._data(u), conditions)

    def equations(self, u: Array, soft: float = 0.0) -> Equations:
        """Return residuals and conditions with their derivatives."""
        rigs = self._varied_rigs(u)
        arrivals, alphas, rates = self._flown_rates(u, rigs)
        data, samples, node = self._data_rates(u, rigs)
        conditions = self._conditions(u, arrivals, alphas)
        residual, condition = self._split(soft, u, data, conditions)
        laws = self._law_rows if soft else np.zeros(len(rates), bool)
        timed = self.impacts[self._timed]
        others = np.zeros((len(timed) + self.frictionless, PAIR + self.count))
        others[: len(timed), 5 + T] = 1.0 / max(self.impact_deviation, 1e-12)
        if self.frictionless:
            others[-1, PAIR + self.unknowns.column('grip')] = 1.0 / _NO_GRIP
        nodes = self._row_nodes
        return Equations(
            residual,
            condition,
            samples,
            node,
            np.concatenate([others, rates[laws] / (soft or 1.0), rates[~laws]]),
            np.concatenate([timed, self.firsts[: self.frictionless], nodes[laws], nodes[~laws]]),
            self.size,
            self.count,
        )

    def _split(self, soft: float, u: Array, data: Array, conditions: Array) -> tuple[Array, Array]:
        """Return residuals and conditions, with soft laws among the residuals."""
        grip = [u[self.unknowns.column('grip')] / _NO_GRIP] if self.frictionless else []
        parts = [data, self._times(u), np.array(grip)]
        if not soft:
            return np.concatenate(parts), conditions
        laws = self._law_rows
        return np.concatenate([*parts, conditions[laws] / soft]), conditions[~laws]

    def _data(self, u: Array) -> Array:
        shared, states = self.parts(u)
        signal, _, inside = self._signal([shared], states)
        left = signal - self.record.motion
        if self.further is not None:
            left = left + self.further.signal
        return np.where(inside, left, 0.0) * self.weight

    def _data_rates(
        self, u: Array, rigs: Sequence[Array]
    ) -> tuple[Array, Array, NDArray[np.int64]]:
        """Return the residuals of the samples, their derivatives, and the nodes before them."""
        column = self.unknowns.column
        varied = {k: step for k, step in self._varied.items() if k != column('grip')}
        rates = np.zeros((len(self.record.time), SAMPLE + self.count))
        more = rates, [column('grip'), *varied], [1.0, *varied.values()]
        signal, node, inside = self._signal(rigs[: 1 + len(varied)], self.parts(u)[1], *more)
        if (place := column('bias')) >= 0:
            rates[:, SAMPLE + place] = 1.0
        weight = np.where(inside, self.weight, 0.0)
        rates *= weight[:, None]
        return (signal - self.record.motion) * weight, rates, node

    @cached_property
    def _timed(self) -> NDArray[np.int64]:
        """Impacts whose instants were measured and that belong to a flight."""
        lone = np.isin(self.impacts, self.lone)
        return np.flatnonzero((self.course.measured >= 0) & ~lone)

    def _times(self, u: Array) -> Array:
        fitted = self.parts(u)[1][self.impacts[self._timed], T]
        measured = self.impact_times[self.course.measured[self._timed]]
        left: Array = (fitted - measured) / max(self.impact_deviation, 1e-12)
        return left

    @cached_property
    def _law_rows(self) -> NDArray[np.bool_]:
        """Which conditions are laws of m, not of M."""
        demands = self.demands[self.ends]
        rows = np.zeros((len(self.ends), 5), bool)
        rows[:, _AT_V] = rows[:, _AT_Y] = demands == HIT
        rows[:, _LAST] = (demands == REVERSES) | (demands == RELEASES)
        others = np.zeros(len(self.firsts) + len(self.holds), bool)
        return np.concatenate([rows.ravel(), others])

    @cached_property
    def law_flights(self) -> NDArray[np.int64]:
        """The flight to which each condition belongs if it is a law, else -1."""
        flights = np.repeat(self.flight[self.ends - 1], 5)
        others = np.full(len(self.firsts) + len(self.holds), -1)
        return np.where(self._law_rows, np.concatenate([flights, others]), -1)

    @cached_property
    def _row_nodes(self) -> NDArray[np.int64]:
        """The node of each condition."""
        return np.concatenate([np.repeat(self.ends, 5), self.firsts, self.holds[:, 0]])

    @cached_property
    def _units(self) -> Array:
        """Size of each condition of a flight, per standard deviation of the data."""
        length, speed = self.length, self.length * self.rate
        units = np.array([length, speed, speed, length, length])
        table = np.broadcast_to(units, (len(self.ends), 5)).copy()
        last = np.array([length, speed, speed * self.rate, 1e-3 / self.rate])
        table[:, _LAST] = last[self.demands[self.ends]]
        return table

    @cached_property
    def released(self) -> NDArray[np.int64]:
        """Those of `ends` at which friction lets m go, unless their instant is held."""
        return np.flatnonzero(self.demands[self.ends] == RELEASES)

    def in_units(self, rows: Array) -> Array:
        """Return conditions of flights in their units."""
        return np.asarray(rows / self._units)

    def _alphas(self, u: Array, arrivals: Array) -> Array:
        """Return `Unknowns.alpha_at` at the ends of flights, shape (ends, 4)."""
        shared = self.parts(u)[0]
        alpha, approach = shared[self.alpha_column[self.ends]], arrivals[self.ends - 1, 3]
        speed = np.maximum(np.abs(approach), _LEAST_SPEED)
        return np.stack(self.unknowns.alpha_at(shared, alpha, speed), axis=1)

    def _conditions(self, u: Array, arrivals: Array, alphas: Array) -> Array:
        """Return the conditions, from the states at the ends of flights."""
        shared, states = self.parts(u)
        ends, unknowns = self.ends, self.unknowns
        gap = unknowns.value(shared, 'gap')
        if self.further is not None:
            arrivals, sticks = arrivals.copy(), self.sticks[ends - 1]
            arrivals[ends - 1, 0] += self.further.x
            arrivals[ends - 1, 1] += self.further.velocity
            arrivals[ends - 1, 2] -= np.where(sticks, 0.0, self.further.x)
            arrivals[ends - 1, 3] -= np.where(sticks, 0.0, self.further.velocity)
            arrivals[ends - 1, 4] += self.further.acceleration
        own = self.direction * unknowns.value(shared, 'grip') + self.last_stop * unknowns.air
        targets = np.where(self.demands == STAYS, self.held_at, unknowns.slope - own)
        values = np.empty((len(ends), 5))
        ratio = unknowns.rig.primary_mass / unknowns.rig.damper_mass
        call_kernel(
            *(write_conditions, states, arrivals, ends, self.demands, self.last_stop, targets),
            *(alphas, ratio, gap, self._units, values),
            what='fit',
        )
        firsts = states[self.firsts, Y] - 0.5 * gap * self.kind[self.firsts]
        held = states[self.holds[:, 0], self.holds[:, 1]] - self._hold_values
        return np.concatenate([values.ravel(), firsts / self.length, held / self._hold_units])

    def speeds(self, u: Array) -> Array:
        """Return the speeds at which m approaches the stops, by the jumps of X'."""
        shared, jump = self.parts(u)[0], np.abs(self.jumps(u))
        alpha = shared[self.alpha_column[self.impacts]]
        speed = alpha * jump
        for _ in range(_TURNS):
            there, *_ = self.unknowns.alpha_at(shared, alpha, np.maximum(speed, _LEAST_SPEED))
            speed = there * jump
        return np.asarray(speed)

    @cached_property
    def _hold_units(self) -> Array:
        speed = self.length * self.rate
        units = np.array([1.0 / self.rate, self.length, speed, speed, self.length])
        return units[self.holds[:, 1]]

    def _varied_rigs(self, u: Array) -> list[Array]:
        """Return the shared unknowns, and those with each of `_varied` changed by its step."""
        shared = self.parts(u)[0]
        rigs = [shared.copy() for _ in range(1 + len(self._varied))]
        for rig, (place, step) in zip(rigs[1:], self._varied.items(), strict=True):
            rig[place] += step
        return rigs

    def _flown_rates(self, u: Array, rigs: Sequence[Array]) -> tuple[Array, Array, Array]:
        """
        Return the states at the ends of flights, alphas, and derivatives of the conditions.

        The derivatives are rows of `Equations`.
        """
        states = self.parts(u)[1]
        ends, unknowns, count = self.ends, self.unknowns, self.count
        arrivals = self._fly(rigs, states)
        alphas = self._alphas(u, arrivals[0])
        places = [unknowns.column(name) for name in ('gap', 'grip', 'slowness')]
        rates = np.empty((len(ends), 5, PAIR + count))
        call_kernel(
            *(write_condition_rates, self._flights, states, arrivals, ends, self.demands),
            *(self.last_stop, self.direction, alphas, self.alpha_column[ends], np.array(places)),
            unknowns.rig.primary_mass / unknowns.rig.damper_mass,
            *(np.array([*self._varied]), np.array([*self._varied.values()]), self._units),
            *(np.empty((ARRIVALS, PAIR + count)), rates),
            what='fit',
        )
        m, k = len(self.firsts), len(self.holds)
        more = np.zeros((m + k, PAIR + count))
        more[:m, 5 + Y] = 1.0 / self.length
        more[:m, PAIR + places[0]] = -0.5 * self.kind[self.firsts] / self.length
        more[m + np.arange(k), 5 + self.holds[:, 1]] = 1.0 / self._hold_units
        both = np.concatenate([rates.reshape(-1, PAIR + count), more])
        return arrivals[0], alphas, both
