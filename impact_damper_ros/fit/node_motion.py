# SPDX-License-Identifier: Apache-2.0
"""Motion between the nodes of a course, from the states at the nodes and the shared unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import IMPACT, REVERSAL_EVENT
from impact_damper_ros.motion.kernels import call_kernel, has_numba
from impact_damper_ros.motion.records import rows_of
from impact_damper_ros.motion.state import (
    DAMPING,
    FRICTION,
    GAP,
    MASS,
    NUMBERS,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    STIFFNESS,
)
from impact_damper_ros.orbits.closed_flights import COLUMNS, RATE_START, NodeRow
from impact_damper_ros.orbits.flights import settable_rig
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .course import Course
from .node_kernels import ARRIVALS, fly_between
from .nodes import Nodes, T, V, W, X, Y
from .record import Record
from .sample_kernels import write_samples
from .unknowns import Unknowns
from .vibration import Array, Vibration, wave_of

#: Least width of the space of `write_samples`, and no derivatives.
_SPACE, _NO_RATES = 5, np.empty((0, 0))


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
        self._moving = settable_rig(len(self.vibration(course.shared).forces), False)
        # The flights after the nodes, of the unknowns for which they were computed last.
        self._flights = np.zeros((self.count_of_nodes, COLUMNS))

    @cached_property
    def _node_rows(self) -> Any:
        """The nodes in the form for kernels."""
        columns = {
            'kind': np.where(self.kind != 0, IMPACT, REVERSAL_EVENT),
            'mode': np.where(self.direction > 0.0, SLIDE_DOWN, SLIDE_UP),
            'resting': np.where(self.sticks, STICK, 0),
            'direction': self.direction.astype(int),
            'last': np.where(self.last_stop > 0.0, 1, 2),
        }
        if has_numba():
            return rows_of(NodeRow, self.count_of_nodes, **columns)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        return [NodeRow(**dict(zip(columns, row, strict=True))) for row in rows]

    @property
    def alpha_column(self) -> NDArray[np.int64]:
        """Place of the alpha of the stop hit at each node."""
        first, second = self.unknowns.alpha_columns()
        return np.where(self.kind == -1, second, first)

    def _numbers(self, shared: Array) -> Array:
        """Return the numbers of the rig in the order of the kernels."""
        unknowns, vibration = self.unknowns, self.vibration(shared)
        rig = [getattr(unknowns.rig, name) for name in NUMBERS]
        rig[STIFFNESS : DAMPING + 1] = shared[:2].tolist()
        rig[GAP] = unknowns.value(shared, 'gap')
        if unknowns.normal > 0.0:
            rig[FRICTION] = unknowns.value(shared, 'grip') / unknowns.normal
        lines = np.stack(
            [vibration.forces * rig[MASS], vibration.frequencies, vibration.phases], axis=1
        )
        return np.concatenate([rig, lines.ravel()])

    def _fly(self, rigs: Sequence[Array], states: Array, *, begins: bool = False) -> Array:
        """
        Compute the flights of some shared unknowns, and return the states at their ends.

        The result has the shape (rigs, nodes - 1, 5), see `node_kernels`.
        """
        numbers = np.array([self._numbers(shared) for shared in rigs])
        arrivals = np.zeros((len(rigs), self.count_of_nodes - 1, ARRIVALS))
        call_kernel(
            *(fly_between, self._moving, self._node_rows, states, numbers),
            *(self._flights, arrivals, self.demands, begins),
            what='fit',
        )
        return arrivals

    def start(self) -> Array:
        """Return the unknowns of the course; states at turns are those of the flights."""
        course, n = self.course, self.count_of_nodes
        states = np.zeros((n, 5))
        at = self.impacts
        states[at, T], states[at, X] = course.time, course.x
        states[at, V], states[at, W] = course.velocity, course.damper_velocity
        gap = self.unknowns.value(course.shared, 'gap')
        states[at, Y] = 0.5 * gap * course.stop
        if n > len(at):
            states[self.kind == 0, T] = np.concatenate(course.turns)
            self._fly([course.shared], states, begins=True)
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

    def vibration(self, shared: Array) -> Vibration:
        """Return the vibration of M of shared unknowns."""
        return Vibration.of(*self._vibration_of(shared))

    def _vibration_of(self, shared: Array) -> tuple[RigParameters, float, float, float]:
        delay = self.unknowns.value(shared, 'force_delay')
        return self.unknowns.rig, float(shared[0]), float(shared[1]), delay

    def push_of(self, grip: float, direction: Array, last_stop: Array) -> Array:
        """Return the constant acceleration of M while m slides, or sticks (direction 0)."""
        unknowns = self.unknowns
        ratio = unknowns.rig.damper_mass / unknowns.rig.primary_mass
        own = direction * grip + last_stop * unknowns.air
        return np.where(direction == 0.0, unknowns.share * unknowns.slope, ratio * own)

    @cached_property
    def _frequencies(self) -> Array:
        return self.vibration(self.course.shared).frequencies

    def _turning_at(self, times: Array) -> Array:
        """Return cosine and sine of each harmonic at times, with phase 0 at time 0."""
        turning = np.exp(1j * self._frequencies * times[:, None])
        turned: Array = turning.view(float)
        return turned

    @cached_property
    def _turning(self) -> Array:
        return self._turning_at(self.record.time)

    def signal(
        self,
        rigs: Sequence[Array],
        states: Array,
        pushes: Array,
        sticks: NDArray[np.bool_],
        times: Array,
        order: int,
        rates: Array = _NO_RATES,
        columns: Sequence[int] = (-1,),
        steps: Sequence[float] = (1.0,),
    ) -> tuple[Array, NDArray[np.int64]]:
        """
        Return a derivative of X at times by states and pushes at nodes, and the nodes before them.

        Of several shared unknowns the first count; the others are for derivatives, see
        `sample_kernels`.
        """
        known = [self._vibration_of(shared) for shared in rigs]
        joint = bool(sticks.any())
        both = [[wave_of(*one, either, order) for either in (False, joint)] for one in known]
        turning = self._turning if times is self.record.time else self._turning_at(times)
        nodes, signal = np.empty(len(times), np.int64), np.empty(len(times))
        width = max(_SPACE, 2 * len(self._frequencies))
        call_kernel(
            *(write_samples, np.ascontiguousarray(times), turning, order, states, pushes, sticks),
            *(
                self._frequencies,
                np.array(both),
                nodes,
                signal,
                self._flights[:, RATE_START + 1].copy(),
            ),
            *(self._by_push, np.array(columns), np.array(steps), np.empty((len(rigs), width))),
            rates,
            what='fit',
        )
        return signal, nodes

    @cached_property
    def _by_push(self) -> Array:
        """Changes of the push of M with friction on m."""
        return self.unknowns.rig.damper_mass / self.unknowns.rig.primary_mass * self.direction

    def _motion_at(
        self, rigs: Sequence[Array], states: Array, times: Array, order: int, *more: Any
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return a derivative of X at times, and the nodes before them."""
        grip = self.unknowns.value(rigs[0], 'grip')
        pushes = self.push_of(grip, self.direction, self.last_stop)
        return self.signal(rigs, states, pushes, self.sticks, times, order, *more)

    def _signal(
        self, rigs: Sequence[Array], states: Array, *more: Any
    ) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
        """Return the measured quantity at the samples, the nodes before, and which are inside."""
        record = self.record
        signal, node = self._motion_at(rigs, states, record.time, record.order, *more)
        inside = (record.time >= states[0, T]) & self.counts_after[node]
        return self.sense(rigs[0], signal), node, inside

    def motion(self, u: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the fitted signal (NaN where there is none), and whether each sample counts."""
        shared, states = self.parts(u)
        signal, _, inside = self._signal([shared], states)
        return np.where(inside, signal, np.nan), inside & (self.weight > 0.0)

    def place(self, u: Array, times: Array) -> Array:
        """Return X at times, which rise."""
        shared, states = self.parts(u)
        return self._motion_at([shared], states, times, 0)[0]

    def sense(self, shared: Array, signal: Array) -> Array:
        """Return a signal as the sensor shows it."""
        return signal + self.unknowns.value(shared, 'bias')

    def speeds_before(self, u: Array) -> Array:
        """Return X' just before all nodes but the first."""
        shared, states = self.parts(u)
        return self._fly([shared], states)[0, :, 1]

    def likely_jumps(self, u: Array) -> Array:
        """
        Return the jumps of X', also those where a part begins, from the motion of M before them.

        One that is larger than all others is taken for none: an impact before it was missed.
        """
        jump = np.zeros(len(self.course))
        at = self.impacts[1:]
        jump[1:] = self.parts(u)[1][at, V] - self.speeds_before(u)[at - 1]
        return np.where(np.abs(jump) <= np.abs(self.jumps(u)).max(), jump, 0.0)

    def jumps(self, u: Array) -> Array:
        """Return the jump of X' at each impact; 0 where a part begins."""
        jump = np.zeros(len(self.course))
        inner = self.impacts[~self.course.begins]
        jump[~self.course.begins] = self.parts(u)[1][inner, V] - self.speeds_before(u)[inner - 1]
        return jump
