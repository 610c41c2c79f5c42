# SPDX-License-Identifier: Apache-2.0
"""Motion between the nodes of a course, from the states at the nodes and the shared unknowns."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .course import Course
from .nodes import Nodes, T, V, W, X, Y
from .partition import Record
from .unknowns import Unknowns
from .vibration import Array, Phasors, Vibration


class NodeMotion(Nodes):
    """
    The motion of one course as a function of the unknowns.

    Parameters
    ----------
    record : Record
        The measured motion.
    unknowns : Unknowns
        The shared unknowns.
    course : Course
        The course; its numbers are the first guess.
    impact_times : ndarray
        Measured instants of impacts.
    weight : ndarray
        Weight of each sample, 0 where it is not used.
    """

    def __init__(
        self,
        record: Record,
        unknowns: Unknowns,
        course: Course,
        impact_times: Array,
        weight: Array,
    ) -> None:
        super().__init__(course)
        self.record, self.unknowns, self.impact_times = record, unknowns, impact_times
        self.weight = weight
        self.count = len(unknowns.names)
        self.size = self.count + 5 * self.count_of_nodes
        self._hold_values = np.zeros(len(self.holds))

    @property
    def alpha_column(self) -> NDArray[np.int64]:
        """Place of the alpha of the stop hit at each node."""
        first, second = self.unknowns.alpha_columns()
        return np.where(self.kind == -1, second, first)

    def start(self) -> Array:
        """Return the unknowns of the course; states at turns are those of the flights."""
        course, n = self.course, self.count_of_nodes
        states = np.zeros((n, 5))
        at = self.impacts
        states[at, T], states[at, X] = course.time, course.x
        states[at, V], states[at, W] = course.velocity, course.damper_velocity
        gap = self.unknowns.value(course.shared, 'gap')
        states[at, Y] = 0.5 * gap * course.stop
        states[self.kind == 0, T] = np.concatenate([*course.turns, np.zeros(0)])
        for i in np.flatnonzero(self.kind == 0):
            before, node = states[i - 1 : i], np.array([i - 1])
            ends = self._flown(course.shared, before, states[i : i + 1, T], node)
            states[i, X:] = np.concatenate(ends)
        self._hold_values = states[self.holds[:, 0], self.holds[:, 1]]
        return np.concatenate([course.shared, states.ravel()])

    def course_of(self, u: Array) -> Course:
        """Return the course with the numbers of unknowns."""
        shared, states = self.parts(u)
        course = self.course.copy()
        course.shared = shared.copy()
        at = states[self.impacts]
        course.time, course.x = at[:, T].copy(), at[:, X].copy()
        course.velocity, course.damper_velocity = at[:, V].copy(), at[:, W].copy()
        ends = np.cumsum([len(times) for times in course.turns])
        course.turns = np.split(states[self.kind == 0, T], ends)[:-1]
        return course

    def parts(self, u: Array) -> tuple[Array, Array]:
        """Return the shared unknowns and the states (n, 5)."""
        return u[: self.count], u[self.count :].reshape(-1, 5)

    def vibration(self, shared: Array, *, joint: bool = False) -> Vibration:
        """Return the vibration of M of shared unknowns, or that of M and m."""
        unknowns = self.unknowns
        delay = unknowns.value(shared, 'force_delay')
        known = unknowns.rig, float(shared[0]), float(shared[1]), delay
        return Vibration.of(*known, joint=joint)

    def _by_vibration(
        self, shared: Array, sticks: NDArray[np.bool_], compute: Callable[[Vibration], Array]
    ) -> Array:
        """Return what a vibration gives, shape (..., n): that of M and m where m sticks."""
        found = compute(self.vibration(shared))
        if sticks.any():
            found = np.where(sticks, compute(self.vibration(shared, joint=True)), found)
        return found

    def push_of(self, grip: float, direction: Array, last_stop: Array) -> Array:
        """Return the constant acceleration of M while m slides, or sticks (direction 0)."""
        unknowns = self.unknowns
        ratio = unknowns.rig.damper_mass / unknowns.rig.primary_mass
        own = direction * grip + last_stop * unknowns.air
        return np.where(direction == 0.0, unknowns.share * unknowns.slope, ratio * own)

    def _pushes(self, grip: float, node: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the constant accelerations of M and, while it slides, of m after nodes."""
        direction, last_stop = self.direction[node], self.last_stop[node]
        own = direction * grip + last_stop * self.unknowns.air
        return self.push_of(grip, direction, last_stop), self.unknowns.slope - own

    def _flown(
        self, shared: Array, before: Array, time: Array, node: NDArray[np.int64]
    ) -> tuple[Array, Array, Array, Array]:
        """Return X, X', Z' and Y at times in the flights after nodes, from the states there."""
        span = time - before[:, T]
        push, pull = self._pushes(self.unknowns.value(shared, 'grip'), node)
        sticks = self.sticks[node]
        x, v = self._by_vibration(
            shared,
            sticks,
            lambda one: np.array(one.later(before[:, T], before[:, X], before[:, V], push, span)),
        )
        w = np.where(sticks, v - before[:, V], pull * span) + before[:, W]
        moved = (before[:, W] + 0.5 * pull * span) * span
        return x, v, w, before[:, Y] + np.where(sticks, 0.0, before[:, X] + moved - x)

    @cached_property
    def _turning(self) -> Phasors:
        """The harmonics at the samples, with phasors 1 at time 0."""
        frequencies = self.vibration(self.course.shared).frequencies
        turning: Phasors = np.exp(1j * frequencies * self.record.time[:, None])
        return turning

    def signal(
        self,
        shared: Array,
        states: Array,
        push: Array,
        sticks: NDArray[np.bool_],
        node: NDArray[np.int64],
        samples: slice = slice(None),
    ) -> Array:
        """Return the measured quantity at samples, by the states and pushes at nodes."""
        order = self.record.order
        since = self.record.time[samples] - states[node, T]

        def signal(vibration: Vibration) -> Array:
            free = vibration.free_phasors(states[:, T], states[:, X], states[:, V], push)
            vibrating = (vibration.root**order * free)[node] * np.exp(vibration.root * since)
            steady = self._turning[samples] @ vibration.steady_phasors(order)
            constant = 0.0 if order else (push / vibration.stiffness)[node]
            found: Array = vibrating.real + steady.imag + constant
            return found

        return self._by_vibration(shared, sticks[node], signal)

    def _signal(self, shared: Array, states: Array, node: NDArray[np.int64]) -> Array:
        """Return the measured quantity at all samples, in the flights after nodes."""
        grip = self.unknowns.value(shared, 'grip')
        push, _ = self._pushes(grip, np.arange(self.count_of_nodes))
        return self.signal(shared, states, push, self.sticks, node)

    def motion(self, u: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the fitted signal (NaN where there is none), and whether each sample counts."""
        shared, states = self.parts(u)
        node, inside = self._node_of_samples(states)
        signal = self.sense(shared, self._signal(shared, states, node))
        return np.where(inside, signal, np.nan), inside & (self.weight > 0.0)

    def sense(self, shared: Array, signal: Array) -> Array:
        """Return a signal as the sensor shows it."""
        return signal + self.unknowns.value(shared, 'bias')

    def _node_of_samples(self, states: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the node before each sample, and whether its flight counts."""
        found = np.searchsorted(states[:, T], self.record.time, side='right') - 1
        node = np.clip(found, 0, self.count_of_nodes - 1)
        return node, (found >= 0) & self.counts_after[node]

    def before_nodes(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Return X, X', Z' and Y just before all nodes but the first."""
        shared, states = self.parts(u)
        node = np.arange(self.count_of_nodes - 1)
        return self._flown(shared, states[:-1], states[1:, T], node)

    def place(self, u: Array, times: Array, node: NDArray[np.int64]) -> Array:
        """Return X at times in the flights after nodes."""
        shared, states = self.parts(u)
        return self._flown(shared, states[node], times, node)[0]

    def likely_jumps(self, u: Array) -> Array:
        """
        Return the jumps of X', also those where a part begins, from the motion of M before them.

        One that is larger than all others is taken for none: an impact before it was missed.
        """
        jump = np.zeros(len(self.course))
        at = self.impacts[1:]
        jump[1:] = self.parts(u)[1][at, V] - self.before_nodes(u)[1][at - 1]
        return np.where(np.abs(jump) <= np.abs(self.jumps(u)).max(), jump, 0.0)

    def jumps(self, u: Array) -> Array:
        """Return the jump of X' at each impact; 0 where a part begins."""
        jump = np.zeros(len(self.course))
        inner = self.impacts[~self.course.begins]
        jump[~self.course.begins] = self.parts(u)[1][inner, V] - self.before_nodes(u)[1][inner - 1]
        return jump
