# SPDX-License-Identifier: Apache-2.0
"""
The solutions of the boundary-value problem as a curve, along a parameter or any path of rigs.

The coordinates of the curve are the unknowns and the parameter. A point is corrected by Newton's
method in a plane, so that the parameter may turn along the curve (Keller, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import FIRST_LINE, FRICTION, GRAVITY, NUMBERS
from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arclength import (
    BRANCHING,
    COORDINATES,
    DOUBLING,
    ENOUGH,
    FOLD,
    KIND,
    LEAST_STEP,
    LOCATED,
    LOST,
    MAP,
    NOT_VIABLE,
    ROOM,
    SHARPEST_TURN,
    SIZE,
    TORUS,
    VIABLE,
    X_MAX,
)
from .arguments import OrbitError, check_forcing
from .closed_flights import (
    BEST_DERIVATIVE,
    GUESS,
    MARKS,
    NORMAL,
    PATH,
    PLACE,
    SLOPE,
    SPAN,
    TANGENT,
)
from .kernel_tasks import CORRECT, GO_ON, LOCATE
from .orbit import PeriodicOrbit, stability_of
from .periodic_problem import PeriodicProblem, Solution, multipliers_of_map, parameter_numbers
from .response import Array
from .search import within_theory
from .solved_orbits import Guess, guess_on, orbit_of
from .varied_parameter import BOTH_RESTITUTIONS, Steps

#: Rows of a trace: few enough steps for Ctrl-C.
_ROWS = 64
_AT_BOUND = 1e-12
#: Change of a parameter, over its scale, by which numbers of a rig are differentiated that are no
#: parameters themselves, and error of the parameter at which they are taken.
_CHANGE, _TAKEN = 1e-6, 1e-12
_MOST_LOOKS = 12
#: Number of times that special points are located anew on a curved path of rigs.
_AGAIN = 3


def _own_numbers(name: str, parameters: RigParameters) -> list[int]:
    """Return the places of a parameter among a rig's numbers; none if it acts otherwise."""
    if name == BOTH_RESTITUTIONS:
        return [NUMBERS.index('restitution_1'), NUMBERS.index('restitution_2')]
    if name in NUMBERS:
        return [NUMBERS.index(name)]
    shaker = parameters.swept
    line = f'{shaker}_amplitudes', f'{shaker}_frequencies', f'{shaker}_phases'
    return [FIRST_LINE + line.index(name)] if name in line else []


class BranchPoint:
    """
    A point of a branch; it can be unpacked to the parameter and the motion.

    Attributes
    ----------
    value : float
        The parameter.
    orbit : PeriodicOrbit
        The motion there.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits, follow
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> point = follow(orbit, 'gap', 37.0, 38.0).points[-1]
    >>> point.value, round(point.orbit.x_max, 6), point.performed
    (38.0, 10.002572, True)
    """

    def __init__(self, curve: SolutionCurve, row: Array) -> None:
        count = len(curve.start)
        self.curve, self.row = curve, row
        self.place, self.tangent = row[COORDINATES:][:count], row[COORDINATES:][count:]
        self.value = curve.value(self.place)
        self.viable = bool(row[VIABLE] > 0.0)
        self.x_max = float(row[X_MAX])

    def __repr__(self) -> str:
        """Return the point in a line."""
        return f'BranchPoint(value={self.value!r}, orbit={self.orbit!r})'

    def __iter__(self) -> Iterator[Any]:
        """Yield the parameter and the motion."""
        return iter((self.value, self.orbit))

    @cached_property
    def multipliers(self) -> tuple[complex, ...]:
        """The multipliers, as those of an orbit."""
        return multipliers_of_map(self.row[MAP : MAP + 16], int(self.row[SIZE]))

    @cached_property
    def modulus(self) -> float:
        """The largest modulus of a multiplier."""
        return abs(self.multipliers[0])

    @property
    def stability(self) -> str:
        """Stable, neutral or unstable, as that of an orbit."""
        return stability_of(self.modulus)

    @property
    def performed(self) -> bool:
        """Whether the motion is viable and not unstable."""
        return self.viable and self.stability != 'unstable'

    @cached_property
    def solution(self) -> Solution:
        """The solution of the boundary-value problem, computed again."""
        return self.curve.solution_at(self)

    @cached_property
    def orbit(self) -> PeriodicOrbit:
        """The motion there."""
        return orbit_of(self.solution)


def _points(curve: SolutionCurve, rows: Array) -> list[BranchPoint]:
    """Return the points of rows, and their moduli, at once for all."""
    points = [BranchPoint(curve, row) for row in rows]
    maps = np.zeros((len(rows), 4, 4))
    for free, row in zip(maps, rows, strict=True):
        size = int(row[SIZE])
        free[:size, :size] = row[MAP : MAP + 16].reshape(4, 4)[:size, :size]
    moduli = np.abs(np.linalg.eigvals(maps)).max(axis=-1)
    for point, modulus in zip(points, moduli.tolist(), strict=True):
        point.modulus = modulus
    return points


class SolutionCurve:
    """
    Solution branch for a fixed sequence of nodes: of an orbit, a guess, or several periods.

    Its points solve n equations in n unknowns and one parameter, which is the last coordinate,
    divided by a scale.
    """

    def __init__(
        self,
        orbit: PeriodicOrbit,
        along: Steps,
        value: float,
        scale: float,
        times: int = 1,
        guess: Guess | None = None,
    ) -> None:
        guess = guess or guess_on(orbit)
        if guess is None:
            raise OrbitError('the motion has too many events to be followed')
        self.parameters = orbit.parameters
        self.along = along
        self.scale = scale
        self._of_impacts = len(guess.nodes) == orbit.impacts
        self.problem = PeriodicProblem(self.parameters, guess.nodes * times, orbit.cycles * times)
        name = along.path if isinstance(along.path, str) else ''
        self._own = _own_numbers(name, self.parameters)
        if self._own:
            start, slope = parameter_numbers(self.parameters), np.zeros(len(self.problem.rig))
            rig = self.parameters
            base = rig.base_amplitudes, rig.base_frequencies, rig.base_phases
            if rig.base_motion.moves:
                start[FIRST_LINE:].reshape(-1, 3)[rig.base_rows] = np.transpose(base)
            start[self._own], slope[self._own] = 0.0, scale
            self.problem.set_path(start, slope, ORDERS[rig.base_quantity])
        later = orbit.period * np.arange(times)[:, None]
        unknowns = self.problem.unknowns(
            np.tile(guess.states, (times, 1)), (guess.instants + later).ravel()
        )
        self.start: Array = np.append(unknowns, value / scale)
        self._traces: dict[int, Array] = {}

    def _rig(self, value: float) -> RigParameters:
        rig = self.along.rig(self.parameters, value)
        if not self._own:
            check_forcing(rig, self.problem.cycles)
        return rig

    def _numbers(self, value: float) -> Array:
        """Return the numbers of the rig at a value of the parameter."""
        if not self._own:
            return parameter_numbers(self._rig(value))
        start, slope = self.problem.arrays.sheet[[PATH, SLOPE], : len(self.problem.rig)]
        numbers: Array = start + value / self.scale * slope
        return numbers

    def is_performed(self, value: float) -> bool:
        """
        Return whether the branch leaves motions that the rig cannot perform for those that it can.

        Where the theory of impacts holds, the branch follows its solutions instead.
        """
        numbers = self._numbers(value)
        grip = abs(numbers[FRICTION] * numbers[GRAVITY])
        single = not numbers[FIRST_LINE + 3 :: 3].any()
        return not (self._of_impacts and single and within_theory(grip, self.problem.stops))

    def value(self, place: Array) -> float:
        """Return the parameter; the bound itself where only round-off is between."""
        value = float(place[-1]) * self.scale
        bounds = self.along.bounds
        return next((b for b in bounds if abs(value - b) <= _AT_BOUND * self.scale), value)

    def without_meeting(self, point: BranchPoint) -> Guess | None:
        """Return a guess without the two closest events of a point; None if it needs them."""
        solution, nodes = point.solution, self.problem.nodes
        first = int(np.argmin(solution.table[:, SPAN]))
        pair = [first, (first + 1) % len(nodes)]
        kinds = {nodes[j].kind for j in pair}
        if EventKind.IMPACT in kinds or nodes[first - 1].mode != nodes[pair[1]].mode:
            return None
        left = tuple(node for j, node in enumerate(nodes) if j not in pair)
        return Guess(left, np.delete(solution.states, pair, 0), np.delete(solution.instants, pair))

    def null_direction(self) -> Array:
        """Return the direction of unknowns in which the equations change least at the start."""
        self._solve(self.start, np.append(np.zeros(len(self.start) - 1), 1.0), math.inf)
        by_unknowns = self.problem.matrix(BEST_DERIVATIVE)[:-1, :-1]
        return np.append(np.linalg.svd(by_unknowns)[2][-1], 0.0)

    def solution_at(self, point: BranchPoint) -> Solution:
        """Return the solution at a point of the curve, with the residuals of its Newton steps."""
        self._solve(point.place, point.tangent, ENOUGH)
        return self.problem.solution(self._rig(point.value))

    def _lay_path(self, value: float) -> None:
        """Set the path as the tangent of the path of rigs at a value."""
        here, sides = parameter_numbers(self._rig(value)), []
        for move in (_CHANGE * self.scale, -_CHANGE * self.scale):
            try:
                sides.append((move, parameter_numbers(self._rig(value + move))))
            except ParameterError:
                # At the edge of the admissible range, from within
                sides.append((0.0, here))
        (ahead, one), (behind, other) = sides
        if len(here) != len(self.problem.rig):
            raise OrbitError(
                f'the number of harmonics changes along {self.along.name}: give a range in which '
                'it does not'
            )
        slope = (one - other) / (ahead - behind) * self.scale
        self.problem.set_path(here - value / self.scale * slope, slope)

    def _solve(self, guess: Array, normal: Array, enough: float) -> bool:
        """Solve in the plane through a guess; return whether there is a solution."""
        problem, sheet = self.problem, self.problem.arrays.sheet
        in_order = not self.is_performed(float(guess[-1]) * self.scale)
        aim = sheet[GUESS, : len(guess)]
        sheet[NORMAL, : len(guess)], aim[:] = normal, guess
        for _ in range(_MOST_LOOKS):
            taken = float(aim[-1])
            if not self._own:
                self._lay_path(taken * self.scale)
            if not problem.compute(CORRECT, in_order, enough, 0.0)[0]:
                return False
            if self._own or abs(float(problem.place[-1]) - taken) <= _TAKEN:
                return True
            # In the same plane, with a nearer guess
            aim[:] = problem.place
        return False

    def correct(self, guess: Array, normal: Array) -> BranchPoint | None:
        """Return the point of the curve in the plane through a guess, or None."""
        try:
            if not self._solve(guess, normal, ENOUGH):
                return None
        except ParameterError:
            return None
        least, most = self.along.bounds[-2:]
        if self._own and not least <= self.value(self.problem.place) <= most:
            return None
        sheet, count = self.problem.arrays.sheet, len(guess)
        noted = sheet[MARKS, :KIND], np.zeros(COORDINATES - KIND)
        return BranchPoint(
            self, np.concatenate([*noted, sheet[PLACE, :count], sheet[TANGENT, :count]])
        )

    def _in_order(self, value: float) -> bool:
        """Return whether the instants are kept in order at the nearest value of the range."""
        return not self.is_performed(min(max(value, self.along.low), self.along.high))

    def steps_from(
        self, here: BranchPoint, step: float, most: int
    ) -> tuple[list[BranchPoint], int, float]:
        """
        Step along the curve from a point on.

        The results are the points, special ones among them, the reason for the end as in
        `arclength.step_along`, and the next step.
        """
        along, problem = self.along, self.problem
        rows = min(_ROWS, most) if self._own else 1
        trace = self._traces.setdefault(rows, problem.trace_of(rows))
        trace[0], trace[-1, :3] = here.row, (step, along.largest_step, len(self._own))
        in_order = self._in_order(float(here.place[-1] + step * here.tangent[-1]) * self.scale)
        if not self._own:
            self._lay_path(here.value)
        low, high = along.low / self.scale, along.high / self.scale
        ended, last = problem.compute(GO_ON, in_order, low, high, trace)
        points = _points(self, trace[1 : last + 1].copy())
        step_after = float(trace[-1, 0])
        if self._own or not points:
            return points, ended, step_after
        # From the tangent of the path of rigs to the path itself
        normal = problem.arrays.sheet[NORMAL, : len(here.place)].copy()
        point = self.correct(points[0].place, normal)
        if point is None or float(point.tangent @ here.tangent) < SHARPEST_TURN:
            return [], LOST if step < LEAST_STEP * along.largest_step else ROOM, 0.5 * step
        if ended in (ROOM, NOT_VIABLE):
            ended = ROOM if point.viable or in_order else NOT_VIABLE
        between = [] if ended == NOT_VIABLE else self.between(here, point)
        return [*between, point], ended, step_after

    def between(self, here: BranchPoint, there: BranchPoint) -> list[BranchPoint]:
        """Return the special points between two points, as `arclength.add_special_points`."""
        if self._own:
            return self._locate(here, there)
        tests = [VIABLE, FOLD, DOUBLING, TORUS, BRANCHING]
        if not (here.row[tests] * there.row[tests] < 0.0).any():
            return []
        self._lay_path(0.5 * (here.value + there.value))
        points = self._locate(here, there)
        # Each point is located again, with the tangent of the path of rigs there.
        for _ in range(_AGAIN):
            for k, point in enumerate(points):
                self._lay_path(point.value)
                closer = self._locate(here, there)
                alike = (p for p in closer if p.row[KIND] == point.row[KIND])
                points[k] = min(alike, key=partial(_apart, point), default=point)
        return points

    def _locate(self, here: BranchPoint, there: BranchPoint) -> list[BranchPoint]:
        trace = self._traces.setdefault(1, self.problem.trace_of(1))
        trace[0], trace[1] = here.row, there.row
        in_order = self._in_order(there.value)
        _, last = self.problem.compute(LOCATE, in_order, 0.0, 0.0, trace)
        return [BranchPoint(self, row) for row in trace[1:last].copy()]

    def at_value(self, guess: Array, value: float, upwards: float) -> BranchPoint | None:
        """Return the point at a value of the parameter near a guess, or None."""
        guess, normal = guess.copy(), np.zeros_like(guess)
        guess[-1], normal[-1] = value / self.scale, math.copysign(1.0, upwards)
        return self.correct(guess, normal)


def _apart(one: BranchPoint, other: BranchPoint) -> float:
    return float(np.linalg.norm(one.place - other.place))


class Piece(NamedTuple):
    """A part of a curve between two neighbouring points of a branch."""

    curve: SolutionCurve
    start: BranchPoint
    end: BranchPoint

    @property
    def values(self) -> tuple[float, float]:
        """The parameter at both ends."""
        return self.start.value, self.end.value

    def at(self, share: float) -> BranchPoint | None:
        """Return the point of the curve in the plane across the chord, at a share of it."""
        chord = self.end.place - self.start.place
        length = float(np.linalg.norm(chord))
        if not 0.0 < share < 1.0 or length == 0.0:
            return self.end if share >= 1.0 else self.start
        return self.curve.correct(self.start.place + share * chord, chord / length)

    def at_value(self, value: float) -> BranchPoint | None:
        """Return the point at a value of the parameter between those of both ends."""
        begin, end = self.start.place[-1], self.end.place[-1]
        there = value / self.curve.scale
        share = (there - begin) / (end - begin)

        def miss(share: float) -> float:
            point = self.at(share)
            if point is None:
                raise ArithmeticError('the corrector fails')
            return float(point.place[-1]) - there

        # Towards a fold the curve leaves its chord: nearer planes are then tried first.
        for _ in range(2):
            near = self.at(share)
            if near is None:
                return None
            point = self.curve.at_value(near.place, value, end - begin)
            if point is not None and np.linalg.norm(point.place - near.place) <= np.linalg.norm(
                self.end.place - self.start.place
            ):
                return point
            from scipy.optimize import brentq

            try:
                share = brentq(miss, 0.0, 1.0, xtol=LOCATED)
            except ArithmeticError:
                return None
        return None
