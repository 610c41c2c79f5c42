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
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.parameters.parameter_spec import (
    ParameterError,
    number_between,
    whole_number,
)
from impact_damper_ros.parameters.quoting import shown, similar_names
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters

from .arguments import OrbitError, check_forcing, single_harmonic
from .orbit import PeriodicOrbit
from .response import Array
from .search import within_theory
from .segments import Segments, Solution, newton
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


#: Largest residual of a point on a branch, and one that is small enough.
RESIDUAL_TOLERANCE, _ENOUGH = 1e-11, 1e-15

_AT_BOUND = 1e-12
#: Error of a place between two points of a branch, as a share of their distance.
LOCATED = 1e-9
#: Most equations of which the tangent is a singular vector, as it is for dependent ones.
_FEW = 16


def _tangent(matrix: Array) -> Array:
    """Return the unit tangent of a curve, along its normal in the last row of a derivative."""
    if len(matrix) <= _FEW:
        tangent: Array = np.linalg.svd(matrix[:-1])[2][-1]
        return tangent if tangent @ matrix[-1] >= 0.0 else -tangent
    along = np.zeros(len(matrix))
    along[-1] = 1.0
    tangent = np.asarray(np.linalg.solve(matrix, along), np.float64)
    return tangent / float(np.linalg.norm(tangent))


@dataclass(frozen=True)
class CurvePoint:
    """A point of a branch: unknowns and scaled parameter, unit tangent, and the motion."""

    place: Array
    tangent: Array
    orbit: PeriodicOrbit


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
        self._nodes = guess.nodes * times
        self._cycles = orbit.cycles * times
        self._of_impacts = len(guess.nodes) == orbit.impacts
        segments = Segments(self.parameters, self._nodes, self._cycles)
        self._units = segments.length, segments.length * segments.rate
        # Cache of the last value, which is needed up to three times in a row
        self._last = value, segments
        self._set_units(segments)
        later = orbit.period * np.arange(times)[:, None]
        unknowns = segments.unknowns(
            np.tile(guess.states, (times, 1)), (guess.instants + later).ravel()
        )
        self.start: Array = np.append(unknowns, value / scale)

    def _set_units(self, segments: Segments) -> None:
        # With angles of the force as unknowns, they do not depend on its frequency.
        segments.set_units(*self._units, segments.parameters.first_harmonic[1])

    def _segments(self, value: float) -> Segments:
        """Return the boundary-value problem at a value of the parameter."""
        if self._last[0] != value:
            rig = self.along.rig(self.parameters, value)
            check_forcing(rig, self._cycles)
            segments = Segments(rig, self._nodes, self._cycles)
            self._set_units(segments)
            self._last = value, segments
        return self._last[1]

    def performed(self, value: float) -> bool:
        """
        Return whether motions that the rig cannot perform are left for those that it can.

        The theory of impacts follows its solutions through, where it holds.
        """
        problem = self._segments(value)
        rig = problem.parameters
        theory = single_harmonic(rig) and within_theory(problem.constants.grip, problem.stops)
        return not (self._of_impacts and theory)

    def value(self, place: Array) -> float:
        """Return the parameter, that of a bound where only round-off is between."""
        value = float(place[-1]) * self.scale
        bounds = self.along.bounds
        return next((b for b in bounds if abs(value - b) <= _AT_BOUND * self.scale), value)

    def without_meeting(self, point: CurvePoint) -> Guess | None:
        """Return a guess without the two closest events of a point; None if it needs them."""
        segments, nodes = self._segments(self.value(point.place)), self._nodes
        states, instants = segments.motion(point.place[:-1])
        first = int(segments.durations(instants).argmin())
        pair = [first, (first + 1) % len(nodes)]
        kinds = {nodes[j].kind for j in pair}
        if EventKind.IMPACT in kinds or nodes[first - 1].mode != nodes[pair[1]].mode:
            return None
        left = tuple(node for j, node in enumerate(nodes) if j not in pair)
        return Guess(left, np.delete(states, pair, 0), np.delete(instants, pair))

    def residual(self, unknowns: Array, value: float) -> tuple[Array, Array]:
        """Return the equations' residual, and its derivative by the unknowns."""
        segments = self._segments(value)
        lasts = segments.durations(segments.motion(unknowns)[1])
        if float(lasts.min()) <= 0.0 and not self.performed(value):
            raise ArithmeticError('impacts out of order')
        return segments.residual(unknowns)

    def _system(self, place: Array) -> tuple[Array, Array]:
        """Return the residual and its derivative by unknowns and parameter."""
        value = self.value(place)
        residual, by_unknowns = self.residual(place[:-1], value)
        if self.along.path == 'gap':
            by_gap = self._segments(value).by_gap()
            return residual, np.column_stack([by_unknowns, by_gap * self.scale])
        step = 1e-6 * max(abs(float(place[-1])), 1e-3)
        sides = []
        for move in (step, -step):
            try:
                there = self.residual(place[:-1], (place[-1] + move) * self.scale)[0]
                sides.append((move, there))
            except ParameterError:
                # At the edge of the admissible range, from within
                sides.append((0.0, residual))
        (ahead, value_ahead), (behind, value_behind) = sides
        by_value = (value_ahead - value_behind) / (ahead - behind)
        return residual, np.column_stack([by_unknowns, by_value])

    def correct(self, guess: Array, normal: Array) -> CurvePoint | None:
        """Return the point of the curve in the plane through a guess, or None."""

        def in_plane(place: Array) -> tuple[Array, Array]:
            residual, matrix = self._system(place)
            return np.append(residual, normal @ (place - guess)), np.vstack([matrix, normal])

        def longest_part(place: Array, step: Array) -> float:
            """Keep impacts in order; other events may pass."""
            value = self.value(place)
            if self.performed(value):
                return 1.0
            segments = self._segments(value)
            return float(segments.longest_part(place[:-1], step[:-1]))

        try:
            root = newton(in_plane, guess, longest_part, _ENOUGH)
            if not root.residual < RESIDUAL_TOLERANCE:
                return None
            tangent = _tangent(root.jacobian)
            segments = self._segments(self.value(root.unknowns))
            motion = segments.motion(root.unknowns[:-1])
            orbit = orbit_of(Solution(segments, *motion, root.residual, root.history))
        except (ArithmeticError, np.linalg.LinAlgError, ParameterError):
            return None
        return CurvePoint(root.unknowns, tangent, orbit)

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
