# SPDX-License-Identifier: Apache-2.0
"""
The solutions of the boundary-value problem as a curve, along a parameter or any path of rigs.

The coordinates of the curve are the unknowns and the parameter. A point is corrected by Newton's
method in a plane, so that the parameter may turn along the curve (Keller, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import FIRST_LINE, FRICTION, GRAVITY, NUMBERS
from impact_damper_ros.parameters.parameter_spec import (
    ParameterError,
    number_between,
    whole_number,
)
from impact_damper_ros.parameters.quoting import shown, similar_names
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

from .arclength import (
    CORRECT,
    ENOUGH,
    GO_ON,
    LEAST_STEP,
    LOST,
    NOT_VIABLE,
    ROOM,
    SHARPEST_TURN,
    VIABLE,
    Trace,
)
from .arguments import OrbitError, check_forcing, single_harmonic
from .closed_flights import BEST_DERIVATIVE, GUESS, NORMAL, TANGENT
from .orbit import PeriodicOrbit
from .periodic_problem import (
    PeriodicProblem,
    Solution,
    numbers_of,
)
from .response import Array
from .search import within_theory
from .solved_orbits import Guess, guess_on, orbit_of

#: A name for both coefficients of restitution at once.
BOTH_RESTITUTIONS = 'restitution'
# Multisine and sweep have no periodic motion.
_VARIABLE = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind in ('double', 'double_array') and not name.startswith(('multisine_', 'sweep_'))
]


def _check_name(name: str) -> None:
    known = (*_VARIABLE, BOTH_RESTITUTIONS)
    if name not in known:
        close = similar_names(name, known)
        hint = f'did you mean {close}? There are ' if close else 'give one of '
        raise OrbitError(
            f'{shown(name)} cannot be varied: {hint}{", ".join(_VARIABLE)}, or {BOTH_RESTITUTIONS}'
        )


def value_of(parameters: RigParameters, name: str) -> float:
    """Return the value of a parameter that a continuation can vary."""
    _check_name(name)
    if name == BOTH_RESTITUTIONS:
        one, other = parameters.restitution_1, parameters.restitution_2
        if one != other:
            raise OrbitError(
                f'{name} is one value for both stops, but restitution_1 is {one:.9g} and '
                f'restitution_2 {other:.9g}: vary restitution_1 or restitution_2, or in Python '
                'give a function that returns the rig with both of them'
            )
        return one
    value = getattr(parameters, name)
    return float(value[0] if isinstance(value, tuple) else value)


def number_of(name: str, value: float | str) -> float:
    """Return a value of a parameter that may be a text with a unit, in SI."""
    if not isinstance(value, str):
        return value
    spec = PARAMETER_SPECS.get('restitution_1' if name == BOTH_RESTITUTIONS else name)
    return float(value) if spec is None else spec.in_si(value)


def with_value(parameters: RigParameters, name: str, value: float) -> RigParameters:
    """Return the rig with one parameter, as `value_of` names it, changed."""
    if name == BOTH_RESTITUTIONS:
        return parameters.replace(restitution_1=value, restitution_2=value)
    if PARAMETER_SPECS[name].kind == 'double_array':
        entries = getattr(parameters, name)
        return parameters.replace(**{name: (value, *entries[1:])})
    return parameters.replace(**{name: value})


#: A parameter by its name, or the rig as a function of a number.
Path = str | Callable[[float], RigParameters]


def range_of(path: Path, low: float | str, high: float | str) -> tuple[float, float]:
    """Return the ends of a range, each of which may be a text with a unit, in SI."""
    name = path if isinstance(path, str) else ''
    if name:
        _check_name(name)
    return number_of(name, low), number_of(name, high)


@dataclass(frozen=True)
class Steps:
    """What varies along a branch, within which bounds, and in which steps; see `follow`."""

    path: Path
    low: float
    high: float
    start: float | None = None
    largest_step: float = 0.05
    most_points: int = 400

    def __post_init__(self) -> None:
        """Check the range."""
        if isinstance(self.path, str):
            _check_name(self.path)
        elif not callable(self.path):
            raise OrbitError(f'path is {shown(self.path)}: give a name, or a function of a number')
        text = f'{self.name} from {self.low:.9g} to {self.high:.9g}'
        if not -math.inf < self.low < self.high < math.inf:
            raise OrbitError(f'{text} is no range: give two numbers, the low end first')
        least, most = self.bounds[-2:]
        if self.low < least or self.high > most:
            raise OrbitError(
                f'{text} is beyond what is admissible: give a range within {least:.9g} to '
                f'{most:.9g}'
            )
        number_between('largest_step', self.largest_step, 1e-6, 1.0)
        whole_number('most_points', self.most_points, 2, 1_000_000)

    @property
    def name(self) -> str:
        """The name of the parameter; that of a function."""
        name = self.path if isinstance(self.path, str) else getattr(self.path, '__name__', '')
        return name if name.isidentifier() else 'the parameter'

    def rig(self, parameters: RigParameters, value: float) -> RigParameters:
        """Return a rig at another value."""
        path = self.path
        return with_value(parameters, path, value) if isinstance(path, str) else path(value)

    def value(self, parameters: RigParameters) -> float:
        """Return the value at which the branch begins with a rig; or raise `OrbitError`."""
        if isinstance(self.path, str):
            if self.path in ('force_frequencies', 'base_frequencies'):
                self._check_frequency(parameters)
            value = value_of(parameters, self.path)
        else:
            ends = (self.low, self.high) if self.start is None else (self.start,)
            values = [value for value in ends if self.path(value) == parameters]
            if not values:
                raise OrbitError(
                    f'the motion is of another rig than {self.name} returns at '
                    f'{" and ".join(f"{v:.9g}" for v in ends)}: give start, where it returns that'
                )
            value = values[0]
        if not self.holds(value):
            raise OrbitError(
                f'{self.name} is {value:.9g} where the branch begins: give a range around that, '
                f'not {self.low:.9g} to {self.high:.9g}'
            )
        return value

    def _check_frequency(self, parameters: RigParameters) -> None:
        """Raise `OrbitError` where one frequency is not that of the motion."""
        if not single_harmonic(parameters):
            raise OrbitError(
                f'{self.name} is the frequency of the first harmonic, and the others do not '
                'follow it: give a function that returns the rig with all of them'
            )
        if self.name != f'{parameters.swept}_frequencies':
            raise OrbitError(
                f'the {parameters.swept} shakes the rig: follow {parameters.swept}_frequencies'
            )

    @property
    def bounds(self) -> tuple[float, ...]:
        """The ends of the range, and the least and largest admissible value, if known."""
        if not isinstance(self.path, str):
            return self.low, self.high
        name = 'restitution_1' if self.path == BOTH_RESTITUTIONS else self.path
        spec = PARAMETER_SPECS[name]
        assert spec.low is not None
        assert spec.high is not None
        return self.low, self.high, spec.low, spec.high

    def holds(self, value: float) -> bool:
        """Return whether a value is within the range."""
        return self.low <= value <= self.high


#: Rows of a trace: not too many steps for Ctrl-C.
_ROWS = 64
_AT_BOUND = 1e-12
#: Error of a place between two points of a branch, as a share of their distance.
LOCATED = 1e-9
#: Change of a parameter over its scale by which numbers of a rig are differentiated, where they
#: are no parameters themselves, and the error of the parameter at which they are taken.
_CHANGE, _TAKEN = 1e-6, 1e-12
_MOST_LOOKS = 12


def _own_numbers(name: str, parameters: RigParameters) -> list[int]:
    """Return where a parameter is among the numbers of a rig; none if they depend on it."""
    if name == BOTH_RESTITUTIONS:
        return [NUMBERS.index('restitution_1'), NUMBERS.index('restitution_2')]
    if name in NUMBERS:
        # Forces that stand for a base depend on its spring and dashpot.
        on_base = name in ('stiffness', 'damping') and parameters.base_motion.moves
        return [] if on_base else [NUMBERS.index(name)]
    line = 'force_amplitudes', 'force_frequencies', 'force_phases'
    own = name in line and parameters.swept == 'force'
    return [FIRST_LINE + line.index(name)] if own else []


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A point of a branch: unknowns and scaled parameter, unit tangent, and the motion."""

    curve: SolutionCurve
    place: Array
    tangent: Array
    marks: Array

    @property
    def value(self) -> float:
        """The parameter."""
        return self.curve.value(self.place)

    @property
    def viable(self) -> bool:
        """Whether the rig can perform the motion."""
        return bool(self.marks[VIABLE] > 0.0)

    @cached_property
    def solution(self) -> Solution:
        """The solution of the boundary-value problem, computed again."""
        return self.curve.solution_at(self)

    @cached_property
    def orbit(self) -> PeriodicOrbit:
        """The motion."""
        return orbit_of(self.solution)


class SolutionCurve:
    """
    Motions with the nodes of a given one, or of a guess, or of some periods of it, as a curve.

    They solve n equations in n unknowns and one parameter, which is the last coordinate, divided
    by a scale.
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
            start, slope = numbers_of(self.parameters), np.zeros(len(self.problem.arrays.rig))
            start[self._own], slope[self._own] = 0.0, scale
            self.problem.set_path(start, slope)
        later = orbit.period * np.arange(times)[:, None]
        unknowns = self.problem.unknowns(
            np.tile(guess.states, (times, 1)), (guess.instants + later).ravel()
        )
        self.start: Array = np.append(unknowns, value / scale)
        self._traces: dict[int, Trace] = {}

    def _rig(self, value: float) -> RigParameters:
        rig = self.along.rig(self.parameters, value)
        if not self._own:
            check_forcing(rig, self.problem.cycles)
        return rig

    def _numbers(self, value: float) -> Array:
        """Return the numbers of the rig at a value of the parameter."""
        if not self._own:
            return numbers_of(self._rig(value))
        start, slope = self.problem.arrays.path
        numbers: Array = start + value / self.scale * slope
        return numbers

    def performed(self, value: float) -> bool:
        """
        Return whether motions that the rig cannot perform are left for those that it can.

        The theory of impacts follows its solutions through, where it holds.
        """
        numbers = self._numbers(value)
        grip = abs(numbers[FRICTION] * numbers[GRAVITY])
        single = not numbers[FIRST_LINE + 3 :: 3].any()
        return not (self._of_impacts and single and within_theory(grip, self.problem.stops))

    def value(self, place: Array) -> float:
        """Return the parameter, that of a bound where only round-off is between."""
        value = float(place[-1]) * self.scale
        bounds = self.along.bounds
        return next((b for b in bounds if abs(value - b) <= _AT_BOUND * self.scale), value)

    def without_meeting(self, point: CurvePoint) -> Guess | None:
        """Return a guess without the two closest events of a point; None if it needs them."""
        solution, nodes = point.solution, self.problem.nodes
        first = int(np.argmin(solution.spans))
        pair = [first, (first + 1) % len(nodes)]
        kinds = {nodes[j].kind for j in pair}
        if EventKind.IMPACT in kinds or nodes[first - 1].mode != nodes[pair[1]].mode:
            return None
        left = tuple(node for j, node in enumerate(nodes) if j not in pair)
        return Guess(left, np.delete(solution.states, pair, 0), np.delete(solution.instants, pair))

    def null_direction(self) -> Array:
        """Return the unknowns' direction in which the equations change least at the start."""
        self._solve(self.start, np.append(np.zeros(len(self.start) - 1), 1.0), math.inf)
        by_unknowns = self.problem.arrays.matrices[BEST_DERIVATIVE, :-1, :-1]
        return np.append(np.linalg.svd(by_unknowns)[2][-1], 0.0)

    def solution_at(self, point: CurvePoint) -> Solution:
        """Return the solution at a point of the curve, with its residuals on the way there."""
        self._solve(point.place, point.tangent, ENOUGH)
        return self.problem.solution(self._rig(point.value))

    def _lay_path(self, value: float) -> None:
        """Let the path be the tangent to that of the rigs at a value."""
        here, sides = numbers_of(self._rig(value)), []
        for move in (_CHANGE * self.scale, -_CHANGE * self.scale):
            try:
                sides.append((move, numbers_of(self._rig(value + move))))
            except ParameterError:
                # At the edge of the admissible range, from within
                sides.append((0.0, here))
        (ahead, one), (behind, other) = sides
        if len(here) != len(self.problem.arrays.rig):
            raise OrbitError(
                f'the number of harmonics changes along {self.along.name}: give a range in which '
                'it does not'
            )
        slope = (one - other) / (ahead - behind) * self.scale
        self.problem.set_path(here - value / self.scale * slope, slope)

    def _solve(self, guess: Array, normal: Array, enough: float) -> bool:
        """Solve in the plane through a guess; return whether there is a solution."""
        problem, arrays = self.problem, self.problem.arrays
        in_order = not self.performed(float(guess[-1]) * self.scale)
        arrays.vectors[NORMAL], arrays.vectors[GUESS] = normal, guess
        for _ in range(_MOST_LOOKS):
            taken = float(arrays.vectors[GUESS, -1])
            if not self._own:
                self._lay_path(taken * self.scale)
            if not problem.compute(CORRECT, in_order, enough, 0.0)[0]:
                return False
            if self._own or abs(float(arrays.place[-1]) - taken) <= _TAKEN:
                return True
            # In the same plane, nearer
            arrays.vectors[GUESS] = arrays.place
        return False

    def correct(self, guess: Array, normal: Array) -> CurvePoint | None:
        """Return the point of the curve in the plane through a guess, or None."""
        try:
            if not self._solve(guess, normal, ENOUGH):
                return None
        except ParameterError:
            return None
        least, most = self.along.bounds[-2:]
        if self._own and not least <= self.value(self.problem.arrays.place) <= most:
            return None
        arrays = self.problem.arrays
        tangent, marks = arrays.vectors[TANGENT].copy(), arrays.marks.copy()
        return CurvePoint(self, arrays.place.copy(), tangent, marks)

    def _point(self, trace: Trace, row: int) -> CurvePoint:
        rows = trace.places[row], trace.tangents[row], trace.marks[row]
        return CurvePoint(self, *(part.copy() for part in rows))

    def steps_from(
        self, here: CurvePoint, step: float, most: int
    ) -> tuple[list[CurvePoint], int, float]:
        """
        Step along the curve from a point on.

        Returns the points, why the steps end, as `arclength.step_along`, and the next step.
        """
        along, problem = self.along, self.problem
        rows = min(_ROWS, most + 1) if self._own else 2
        trace = self._traces.setdefault(rows, problem.trace_of(rows))
        trace.places[0], trace.tangents[0] = here.place, here.tangent
        trace.step[:] = step, along.largest_step
        ahead = float(here.place[-1] + step * here.tangent[-1]) * self.scale
        in_order = not self.performed(min(max(ahead, along.low), along.high))
        if not self._own:
            self._lay_path(here.value)
        low, high = along.low / self.scale, along.high / self.scale
        ended, last = problem.compute(GO_ON, in_order, low, high, trace)
        points = [self._point(trace, row) for row in range(1, last + 1)]
        if self._own or not points:
            return points, ended, float(trace.step[0])
        # From the tangent to the path of rigs to that itself
        point = self.correct(points[0].place, problem.arrays.vectors[NORMAL].copy())
        if point is None or float(point.tangent @ here.tangent) < SHARPEST_TURN:
            return [], LOST if step < LEAST_STEP * along.largest_step else ROOM, 0.5 * step
        if ended in (ROOM, NOT_VIABLE):
            ended = ROOM if point.viable or in_order else NOT_VIABLE
        return [point], ended, float(trace.step[0])

    def at_value(self, guess: Array, value: float, upwards: float) -> CurvePoint | None:
        """Return the point at a value of the parameter near a guess, or None."""
        guess, normal = guess.copy(), np.zeros_like(guess)
        guess[-1], normal[-1] = value / self.scale, math.copysign(1.0, upwards)
        return self.correct(guess, normal)


class Piece(NamedTuple):
    """A part of a curve between two neighbouring points of a branch."""

    curve: SolutionCurve
    start: CurvePoint
    end: CurvePoint
    #: What changes where the rig leaves the curve before the second one, if it does; and whether
    #: the branch turns back there.
    change: str = ''
    turns: bool = False

    @property
    def values(self) -> tuple[float, float]:
        """The parameter at both ends."""
        return self.curve.value(self.start.place), self.curve.value(self.end.place)

    def at(self, share: float) -> CurvePoint | None:
        """Return the point where the chord between both has a normal plane."""
        chord = self.end.place - self.start.place
        length = float(np.linalg.norm(chord))
        if not 0.0 < share < 1.0 or length == 0.0:
            return self.end if share >= 1.0 else self.start
        return self.curve.correct(self.start.place + share * chord, chord / length)

    def at_value(self, value: float) -> CurvePoint | None:
        """Return the point at a value of the parameter between those of both points."""
        from scipy.optimize import brentq

        begin, end = self.start.place[-1], self.end.place[-1]
        there = value / self.curve.scale
        share = (there - begin) / (end - begin)

        def missed(share: float) -> float:
            point = self.at(share)
            if point is None:
                raise ArithmeticError('the corrector fails')
            return float(point.place[-1]) - there

        # Towards a fold the curve leaves its chord: nearer then first
        for _ in range(2):
            near = self.at(share)
            if near is None:
                return None
            point = self.curve.at_value(near.place, value, end - begin)
            if point is not None and np.linalg.norm(point.place - near.place) <= np.linalg.norm(
                self.end.place - self.start.place
            ):
                return point
            try:
                share = brentq(missed, 0.0, 1.0, xtol=LOCATED)
            except ArithmeticError:
                return None
        return None
