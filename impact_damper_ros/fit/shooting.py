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

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from impact_damper_ros.orbits.response import unit_response

from .course import Course
from .node_motion import NodeMotion
from .nodes import T, V, W, X, Y
from .partition import Record
from .unknowns import Unknowns
from .vibration import Array, Vibration

#: Conditions of a flight: X, X', Z', Y at its end, and the last law.
_AT_X, _AT_V, _AT_W, _AT_Y, _LAST = range(5)
#: A friction that is zero, m/s^2.
_NO_GRIP = 1e-6
#: Step of derivatives by K, C and the delay, in natural units.
_STEP = 1e-6
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
    residual_rates, condition_rates : sparse matrix
        Derivatives by the unknowns; the columns of a row rise.
    shared : int
        Number of unknowns that belong to no node; they come first, then five of each node.
    """

    residual: Array
    condition: Array
    residual_rates: sparse.csr_array
    condition_rates: sparse.csr_array
    shared: int


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

    def jump_rates(self, u: Array) -> sparse.csr_array:
        """Return derivatives of the jumps; 0 where a part begins."""
        end, columns, _ = self._end_rates(u)
        hit = np.flatnonzero(self.kind[self.ends])
        rates = -end[hit, 1]
        rates[:, 5 + V] += 1.0
        inner = _sparse(rates, columns[hit], self.size)
        place = sparse.csr_array(
            (np.ones(len(hit)), (self.impact_of[self.ends[hit]], np.arange(len(hit)))),
            shape=(len(self.course), len(hit)),
        )
        return sparse.csr_array(place @ inner)

    @property
    def freedom(self) -> int:
        """Number of unknowns less number of conditions."""
        conditions = 5 * len(self.ends) + len(self.firsts) + len(self.holds)
        return self.size - conditions + len(self._void_rows)

    @cached_property
    def _varied(self) -> dict[int, float]:
        """Shared unknowns by which derivatives are taken by differences, and the steps."""
        mass = self.unknowns.rig.primary_mass
        steps = {0: _STEP * mass * self.rate**2, 1: _STEP * mass * self.rate}
        delay = self.unknowns.column('force_delay')
        return steps | ({delay: _STEP / self.rate} if delay >= 0 else {})

    def residual(self, u: Array, soft: float = 0.0) -> tuple[Array, Array]:
        """Return residuals and conditions, as in `Equations`."""
        return self._split(soft, self._data(u), self._others(u), self._conditions(u))

    def equations(self, u: Array, soft: float = 0.0) -> Equations:
        """Return residuals and conditions with their derivatives."""
        conditions = self._conditions(u)
        residual, condition = self._split(soft, self._data(u), self._others(u), conditions)
        blocks, columns = self._condition_rates(u)
        laws = self._law_rows if soft else np.zeros(len(conditions), bool)
        all_rates = _sparse(blocks, columns, self.size)
        rates = [self._data_rates(u), self._time_rates()]
        if self.frictionless:
            rates.append(_sparse(np.ones((1, 1)) / _NO_GRIP, self._grip_at, self.size))
        if soft:
            rates.append(all_rates[laws] / soft)
        return Equations(
            residual,
            condition,
            sparse.csr_array(sparse.vstack(rates)),
            sparse.csr_array(all_rates[~laws]),
            self.count,
        )

    def _split(
        self, soft: float, data: Array, others: Array, conditions: Array
    ) -> tuple[Array, Array]:
        if not soft:
            return np.concatenate([data, others]), conditions
        laws = self._law_rows
        return np.concatenate([data, others, conditions[laws] / soft]), conditions[~laws]

    @property
    def _grip_at(self) -> NDArray[np.int64]:
        return np.array([[self.unknowns.column('grip')]])

    def _others(self, u: Array) -> Array:
        """Return residuals of impact times, and of a friction that is fixed at zero."""
        grip = [u[self.unknowns.column('grip')] / _NO_GRIP] if self.frictionless else []
        return np.concatenate([self._times(u), np.array(grip)])

    def _data(self, u: Array) -> Array:
        shared, states = self.parts(u)
        node, inside = self._node_of_samples(states)
        left = self.sense(shared, self._signal(shared, states, node)) - self.record.motion
        if self.further is not None:
            left = left + self.further.signal
        return np.where(inside, left, 0.0) * self.weight

    def _data_rates(self, u: Array) -> sparse.csr_array:
        """Return derivatives of the residuals of the samples."""
        shared, states = self.parts(u)
        record, value = self.record, self.unknowns.value
        node, inside = self._node_of_samples(states)
        time, nodes = record.time, np.arange(self.count_of_nodes)
        push, _ = self._pushes(value(shared, 'grip'), nodes)
        span = time - states[node, T]
        start = self._acceleration(shared, states, push, nodes)
        x_rate, v_rate, by_push = self._rates_of(shared, span, record.order, node)
        signal = self._signal(shared, states, node)
        weight = np.where(inside, self.weight, 0.0)
        rates = np.zeros((len(time), 3 + self.count))
        rates[:, 0] = -(x_rate * states[node, V] + v_rate * start[node]) * weight
        rates[:, 1], rates[:, 2] = x_rate * weight, v_rate * weight
        ratio = self.unknowns.rig.damper_mass / self.unknowns.rig.primary_mass
        own = rates[:, 3:]
        if (column := self.unknowns.column('grip')) >= 0:
            own[:, column] = by_push * ratio * self.direction[node] * weight
        for column, step in self._varied.items():
            other = shared.copy()
            other[column] += step
            own[:, column] = (self._signal(other, states, node) - signal) / step * weight
        if (column := self.unknowns.column('bias')) >= 0:
            own[:, column] = weight
        columns = np.empty((len(time), 3 + self.count), np.int64)
        columns[:, :3] = self.count + 5 * node[:, None] + np.array([T, X, V])
        columns[:, 3:] = np.arange(self.count)
        return _sparse(rates, columns, self.size)

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

    def _time_rates(self) -> sparse.csr_array:
        nodes = self.impacts[self._timed]
        rates = np.full((len(nodes), 1), 1.0 / max(self.impact_deviation, 1e-12))
        return _sparse(rates, (self.count + 5 * nodes + T)[:, None], self.size)

    @cached_property
    def _law_rows(self) -> NDArray[np.bool_]:
        """Which conditions are laws of m, not of M."""
        impact = self.kind[self.ends] != 0
        rows = np.zeros((len(self.ends), 5), bool)
        rows[impact, _AT_V] = rows[impact, _AT_Y] = True
        rows[~impact & ~self._held, _LAST] = True
        rows.ravel()[self._void_rows] = False
        others = np.zeros(len(self.firsts) + len(self.holds), bool)
        return np.concatenate([rows.ravel(), others])

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        held: NDArray[np.bool_] = np.isfinite(self.held_at[self.ends])
        return held

    @cached_property
    def law_flights(self) -> NDArray[np.int64]:
        """The flight to which each condition belongs if it is a law, else -1."""
        flights = np.repeat(self.flight[self.ends - 1], 5)
        others = np.full(len(self.firsts) + len(self.holds), -1)
        return np.where(self._law_rows, np.concatenate([flights, others]), -1)

    @cached_property
    def _units(self) -> Array:
        """Size of each condition of a flight, per standard deviation of the data."""
        length, speed = self.length, self.length * self.rate
        units = np.array([length, speed, speed, length, length])
        table = np.broadcast_to(units, (len(self.ends), 5)).copy()
        impact = self.kind[self.ends] != 0
        table[~impact & ~self._held, _LAST] = speed
        table[~impact & self._held, _LAST] = 1e-3 / self.rate
        table[self.released, _LAST] = speed * self.rate
        return table

    @cached_property
    def released(self) -> NDArray[np.int64]:
        """Those of `ends` at which friction lets m go, unless their instant is held."""
        return np.flatnonzero(self.sticks[self.ends - 1] & ~self._held)

    def _excess(self, shared: Array, arrival: Array) -> Array:
        """Return how far friction is beyond its limit at releases, per mass of m, m/s^2."""
        ends = self.ends[self.released]
        _, pull = self._pushes(self.unknowns.value(shared, 'grip'), ends)
        push, _ = self._pushes(0.0, ends - 1)
        return pull - self._acceleration(shared, arrival[self.released], push, ends - 1)

    def _acceleration(
        self, shared: Array, states: Array, push: Array, node: NDArray[np.int64]
    ) -> Array:
        """Return X'' in states of the flights after nodes."""
        return self._by_vibration(
            shared,
            self.sticks[node],
            lambda one: one.acceleration(states[:, T], states[:, X], states[:, V], push),
        )

    def _rates_of(self, shared: Array, span: Array, order: int, node: NDArray[np.int64]) -> Array:
        """Return `_rates_of` of the vibrations after nodes, shape (3, n)."""
        return self._by_vibration(
            shared, self.sticks[node], lambda one: np.array(_rates_of(one, span, order))
        )

    def in_units(self, rows: Array) -> Array:
        """Return conditions of flights in their units; those that demand nothing are zero."""
        scaled = rows / self._units
        scaled.ravel()[self._void_rows] = 0.0
        return scaled

    def _conditions(self, u: Array) -> Array:
        shared, states = self.parts(u)
        ends = self.ends
        gap = self.unknowns.value(shared, 'gap')
        after, impact = states[ends], self.kind[ends] != 0
        before = states[ends - 1], after[:, T], ends - 1
        x, v, w, y = self._flown(shared, *before)
        excess = self._excess(shared, np.stack([after[:, T], x, v], axis=1))
        if self.further is not None:
            sticks = self.sticks[ends - 1]
            x, y = x + self.further.x, y - np.where(sticks, 0.0, self.further.x)
            w = w + np.where(sticks, self.further.velocity, 0.0)
            v = v + self.further.velocity
            excess = excess - self.further.acceleration[self.released]
        jump = after[:, V] - v
        alpha, *_ = self._alphas(shared, w - v)
        ratio = self.unknowns.rig.primary_mass / self.unknowns.rig.damper_mass
        values = np.empty((len(ends), 5))
        values[:, _AT_X] = x - after[:, X]
        values[:, _AT_V] = np.where(impact, w - v - alpha * jump, v - after[:, V])
        thrown = after[:, W] - v - (alpha - ratio) * jump
        values[:, _AT_W] = np.where(impact, thrown, w - after[:, W])
        values[:, _AT_Y] = y - after[:, Y]
        values[:, _LAST] = np.where(
            impact,
            after[:, Y] - 0.5 * gap * self.kind[ends],
            np.where(self._held, after[:, T] - self.held_at[ends], w - v),
        )
        values[self.released, _LAST] = excess
        firsts = states[self.firsts, Y] - 0.5 * gap * self.kind[self.firsts]
        held = states[self.holds[:, 0], self.holds[:, 1]] - self._hold_values
        rows = self.in_units(values).ravel()
        return np.concatenate([rows, firsts / self.length, held / self._hold_units])

    def _alphas(self, shared: Array, approach: Array) -> tuple[Array, Array, Array, Array]:
        """Return `Unknowns.alpha_at` at the ends of flights."""
        alpha = shared[self.alpha_column[self.ends]]
        return self.unknowns.alpha_at(shared, alpha, np.maximum(np.abs(approach), _LEAST_SPEED))

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
    def _void_rows(self) -> NDArray[np.int64]:
        """Conditions of flights without laws, which are set to zero."""
        rows = np.zeros((len(self.ends), 5), bool)
        void = self.lawless_ends & (self.kind[self.ends] != 0)
        rows[void, _AT_V] = rows[void, _AT_Y] = True
        return np.flatnonzero(rows.ravel())

    @cached_property
    def _hold_units(self) -> Array:
        speed = self.length * self.rate
        units = np.array([1.0 / self.rate, self.length, speed, speed, self.length])
        return units[self.holds[:, 1]]

    def _end_rates(self, u: Array) -> tuple[Array, NDArray[np.int64], tuple[Array, Array]]:
        """
        Return derivatives of X, X', Z', Y and X'' just before the nodes that end a flight.

        Derivatives are by the five unknowns of the node before, those of the node, and the shared
        ones; their columns, and X' and Z', are returned, too.
        """
        shared, states = self.parts(u)
        ends, count = self.ends, self.count
        before, after = states[ends - 1], states[ends]
        n = len(ends)
        grip, sticks = self.unknowns.value(shared, 'grip'), self.sticks[ends - 1]
        flown = before, after[:, T], ends - 1
        x, v, w, _ = self._flown(shared, *flown)
        push, pull = self._pushes(grip, ends - 1)
        span = after[:, T] - before[:, T]
        end = np.zeros((n, 5, 10 + count))
        arrival = np.stack([after[:, T], x, v], axis=1)
        start, last = (self._acceleration(shared, at, push, ends - 1) for at in (before, arrival))
        ratio = self.unknowns.rig.damper_mass / self.unknowns.rig.primary_mass
        direction, column = self.direction[ends - 1], self.unknowns.column('grip')
        grip_at = [10 + column] if column >= 0 else []
        for order in range(2 + bool(len(self.released))):
            by_x, by_v, by_push = self._rates_of(shared, span, order, ends - 1)
            row = end[:, 4 if order == 2 else order]
            row[:, T] = -(by_x * before[:, V] + by_v * start)
            row[:, X], row[:, V] = by_x, by_v
            row[:, grip_at] = (by_push * ratio * direction)[:, None]
        end[:, 0, 5 + T], end[:, 1, 5 + T] = v, last
        end[:, 4, 5 + T] = self._by_vibration(
            shared, sticks, lambda one: one.jerk(after[:, T], v, last)
        )
        for column, step in self._varied.items():
            other = shared.copy()
            other[column] += step
            varied = self._flown(other, *flown)
            there = np.stack([after[:, T], *varied[:2]], axis=1)
            rates = (
                varied[0] - x,
                varied[1] - v,
                self._acceleration(other, there, push, ends - 1) - last,
            )
            end[:, [0, 1, 4], 10 + column] = np.transpose(rates) / step
        slides = ~sticks
        end[slides, 2, T], end[slides, 2, 5 + T] = -pull[slides], pull[slides]
        end[:, 2, grip_at] = -(direction * span)[:, None]
        end[sticks, 2] = end[sticks, 1]
        end[sticks, 2, V] -= 1.0
        end[:, 2, W] = 1.0
        end[slides, 3] = -end[slides, 0]
        end[slides, 3, T] -= w[slides]
        end[slides, 3, 5 + T] += w[slides]
        end[slides, 3, W] += span[slides]
        end[slides, 3, X] += 1.0
        end[:, 3, Y] += 1.0
        end[:, 3, grip_at] -= (0.5 * direction * span**2)[:, None]
        columns = np.empty((n, 10 + count), np.int64)
        columns[:, :5] = count + 5 * (ends - 1)[:, None] + np.arange(5)
        columns[:, 5:10] = count + 5 * ends[:, None] + np.arange(5)
        columns[:, 10:] = np.arange(count)
        return end, columns, (v, w)

    def _condition_rates(self, u: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return derivatives of the conditions, rows of (10 + shared), and their columns."""
        shared, states = self.parts(u)
        ends, count = self.ends, self.count
        end, at, (v, w) = self._end_rates(u)
        after, n, impact = states[ends], len(ends), self.kind[ends] != 0
        ratio = self.unknowns.rig.damper_mass / self.unknowns.rig.primary_mass
        rates = np.zeros((n, 5, 10 + count))
        rates[:, _AT_X] = end[:, 0]
        rates[:, _AT_X, 5 + X] -= 1.0
        jump = after[:, V] - v
        by_jump = -end[:, 1]
        by_jump[:, 5 + V] += 1.0
        by_approach = end[:, 2] - end[:, 1]
        alpha, by_alpha, by_speed, by_slowness = self._alphas(shared, w - v)
        hit = np.flatnonzero(impact)
        of_alpha = by_approach * (by_speed * np.sign(w - v))[:, None]
        of_alpha[np.arange(n), 10 + self.alpha_column[ends]] += by_alpha
        if (column := self.unknowns.column('slowness')) >= 0:
            of_alpha[:, 10 + column] += by_slowness
        rates[:, _AT_V] = end[:, 1]
        rates[:, _AT_V, 5 + V] -= 1.0
        less = alpha[:, None] * by_jump + jump[:, None] * of_alpha
        rates[hit, _AT_V] = (by_approach - less)[hit]
        rates[:, _AT_W] = end[:, 2]
        rates[:, _AT_W, 5 + W] -= 1.0
        rates[hit, _AT_W] = (by_jump / ratio - end[:, 1] - less)[hit]
        rates[hit, _AT_W, 5 + W] += 1.0
        rates[:, _AT_Y] = end[:, 3]
        rates[:, _AT_Y, 5 + Y] -= 1.0
        free = np.flatnonzero(~impact & ~self._held)
        held = np.flatnonzero(~impact & self._held)
        gap_at = 10 + self.unknowns.column('gap')
        rates[hit, _LAST, 5 + Y] = 1.0
        rates[hit, _LAST, gap_at] = -0.5 * self.kind[ends][hit]
        rates[free, _LAST] = (end[:, 2] - end[:, 1])[free]
        rates[held, _LAST, 5 + T] = 1.0
        released = self.released
        rates[released, _LAST] = -end[released, 4]
        if (column := self.unknowns.column('grip')) >= 0:
            rates[released, _LAST, 10 + column] -= self.direction[ends[released]]
        rates /= self._units[:, :, None]
        width = 10 + count
        columns = np.broadcast_to(at[:, None], (n, 5, width)).reshape(-1, width)
        more, there = self._other_rates()
        flat = rates.reshape(-1, width)
        flat[self._void_rows] = 0.0
        return (
            np.concatenate([flat, more]),
            np.concatenate([columns, there]),
        )

    def _other_rates(self) -> tuple[Array, NDArray[np.int64]]:
        """Return derivatives of the conditions of nodes that begin a part, or stay."""
        count, width = self.count, 10 + self.count
        m, k = len(self.firsts), len(self.holds)
        rates, columns = np.zeros((m + k, width)), np.zeros((m + k, width), np.int64)
        node = np.concatenate([self.firsts, self.holds[:, 0]])
        columns[:, 5:10] = count + 5 * node[:, None] + np.arange(5)
        columns[:, :5] = columns[:, 5:10]
        columns[:, 10:] = np.arange(count)
        rates[:m, 5 + Y] = 1.0 / self.length
        rates[:m, 10 + self.unknowns.column('gap')] = -0.5 * self.kind[self.firsts] / self.length
        rates[m + np.arange(k), 5 + self.holds[:, 1]] = 1.0 / self._hold_units
        return rates, columns


def _rates_of(vibration: Vibration, span: Array, order: int) -> tuple[Array, Array, Array]:
    """Return derivatives of X, X' or X'' after spans by X and X' before, and by a push."""
    less, impulse, slope = unit_response(vibration.decay, vibration.damped, span)
    square, twice = vibration.stiffness, 2.0 * vibration.decay
    if order == 0:
        return 1.0 + less, impulse, -less / square
    if order == 1:
        return -square * impulse, slope, impulse
    by_x = -twice * (-square * impulse) - square * (1.0 + less)
    by_v = -twice * slope - square * impulse
    return by_x, by_v, 1.0 - twice * impulse + less


def _sparse(rates: Array, columns: NDArray[np.int64], size: int) -> sparse.csr_array:
    """Return rows of entries and their columns as a sparse matrix; entries add up."""
    n, width = rates.shape
    starts = np.arange(0, n * width + 1, width)
    matrix = sparse.csr_array((rates.ravel(), columns.ravel(), starts), shape=(n, size))
    matrix.sum_duplicates()
    return matrix
