"""
The solutions of the boundary-value problem as a curve, along a parameter or any path of rigs.

The coordinates of the curve are the unknowns and the parameter. A point is corrected by Newton's
method in a plane, so that the parameter may turn along the curve (Keller, 1977).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.quoting import shown

from .arguments import OrbitError, checked_number, checked_whole, single_harmonic
from .orbit import PeriodicOrbit
from .response import Array
from .search import within_theory
from .segments import Root, Segments, Solution, newton
from .solved_orbits import guess_on, orbit_of

#: A name for both coefficients of restitution at once.
BOTH_RESTITUTIONS = 'restitution'
# Multisine and sweep have no periodic motion.
_VARIABLE = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind in ('double', 'double_array') and not name.startswith(('multisine_', 'sweep_'))
]


def _check_name(name: str) -> None:
    if not isinstance(name, str) or name not in (*_VARIABLE, BOTH_RESTITUTIONS):
        raise OrbitError(
            f'{shown(name)} cannot be varied: give one of {", ".join(_VARIABLE)}, or '
            f'{BOTH_RESTITUTIONS}'
        )


def value_of(parameters: RigParameters, name: str) -> float:
    """Return the value of a parameter that a continuation can vary."""
    _check_name(name)
    if name == BOTH_RESTITUTIONS:
        return parameters.restitution_1
    value = getattr(parameters, name)
    return float(value[0] if isinstance(value, tuple) else value)


def with_value(parameters: RigParameters, name: str, value: float) -> RigParameters:
    """Return the rig with one parameter, as `value_of` names it, changed."""
    if name == BOTH_RESTITUTIONS:
        return parameters.replace(restitution_1=value, restitution_2=value)
    if PARAMETER_SPECS[name].kind == 'double_array':
        entries = getattr(parameters, name)
        return parameters.replace(**{name: (value, *entries[1:])})
    return parameters.replace(**{name: value})


def _limits_of(name: str) -> tuple[float, float]:
    """Return the least and largest value of a parameter, as `value_of` names it."""
    spec = PARAMETER_SPECS['restitution_1' if name == BOTH_RESTITUTIONS else name]
    assert spec.low is not None
    assert spec.high is not None
    return spec.low, spec.high


#: Widest range of a parameter, and most points of a branch.
_FARTHEST = 1e15
_MOST_POINTS = 1_000_000

#: A parameter by its name, or the rig as a function of a number.
Path = str | Callable[[float], RigParameters]


@dataclass(frozen=True)
class Continuation:
    """
    Options of a continuation.

    Parameters
    ----------
    path : str or callable
        The parameter that varies: a number of `RigParameters`, the first entry of an array, or
        'restitution' for both coefficients; or a function that returns the rig at a number.
    low, high : float
        Range of the parameter. The branch may turn within it.
    largest_step : float, optional
        Longest step, relative to the displacements, phases and the parameter.
    most_points : int, optional
        Largest number of points on the branch.
    start : float, optional
        Where a function returns the rig that the branch begins with; `low` or `high`, if not
        given.

    Raises
    ------
    OrbitError
        If the parameter cannot be varied, or a number is out of range.
    """

    path: Path
    low: float
    high: float
    largest_step: float = 0.05
    most_points: int = 400
    start: float | None = None

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
        """Return the value at which the branch begins with a rig."""
        if isinstance(self.path, str):
            return value_of(parameters, self.path)
        tried = (self.low, self.high) if self.start is None else (self.start,)
        found = (value for value in tried if self.path(value) == parameters)
        value = next(found, None)
        if value is None:
            raise OrbitError(
                f'the motion is of another rig than {self.name} returns at '
                f'{" and ".join(f"{v:.9g}" for v in tried)}: give start, where it returns that'
            )
        return value

    @property
    def limits(self) -> tuple[float, float]:
        """The least and largest admissible value."""
        return _limits_of(self.path) if isinstance(self.path, str) else (-math.inf, math.inf)

    def __post_init__(self) -> None:
        """Check the options."""
        if not callable(self.path):
            _check_name(self.path)
        low = checked_number(f'the low end of {self.name}', self.low, -_FARTHEST, _FARTHEST)
        high = checked_number(f'the high end of {self.name}', self.high, -_FARTHEST, _FARTHEST)
        if not low < high:
            raise OrbitError(
                f'{self.name} from {low:.9g} to {high:.9g} is no range: give the low end first'
            )
        checked_number('largest_step', self.largest_step, 1e-9, 1.0)
        checked_whole('most_points', self.most_points, 1, _MOST_POINTS)

    def check_start(self, parameters: RigParameters) -> None:
        """Raise OrbitError if the rig is outside the range."""
        value = self.value(parameters)
        if not self.low <= value <= self.high:
            raise OrbitError(
                f'{self.name} is {value:.9g} where the branch begins: give a range around that, '
                f'not {self.low:.9g} to {self.high:.9g}'
            )

    def holds(self, value: float) -> bool:
        """Return whether a value is within the range."""
        return self.low <= value <= self.high


class Family:
    """
    Motions with the nodes of a given one, or of some periods of it.

    They solve n equations in n unknowns and one parameter.
    """

    def __init__(
        self, orbit: PeriodicOrbit, along: Continuation, value: float, times: int = 1
    ) -> None:
        guess = guess_on(orbit)
        if guess is None:
            raise OrbitError('the motion has too many events to be followed')
        self.parameters = orbit.parameters
        self.along = along
        self._nodes = guess.nodes * times
        self._cycles = orbit.cycles * times
        #: Whether motions that the rig cannot perform are left for those that it can: the theory
        #: of impacts follows its solutions through.
        self.performed = bool(orbit.events) or not (
            single_harmonic(orbit.parameters) and within_theory(orbit.parameters, orbit.stops)
        )
        segments = Segments(self.parameters, self._nodes, self._cycles)
        self._units = segments.length, segments.length * segments.rate
        # Cache of the last value, which is needed up to three times in a row
        self._last = value, segments
        self._set_units(segments)
        later = orbit.period * np.arange(times)[:, None]
        self.start = segments.unknowns(
            np.tile(guess.states, (times, 1)), (guess.instants + later).ravel()
        )

    def _set_units(self, segments: Segments) -> None:
        # With angles of the force as unknowns, they do not depend on its frequency.
        segments.set_units(*self._units, segments.parameters.force_frequencies[0])

    def segments(self, value: float) -> Segments:
        """Return the boundary-value problem at a value of the parameter."""
        if self._last[0] != value:
            rig = self.along.rig(self.parameters, value)
            segments = Segments(rig, self._nodes, self._cycles)
            self._set_units(segments)
            self._last = value, segments
        return self._last[1]

    def longest_part(self, unknowns: Array, step: Array, value: float) -> float:
        """Return the largest part of a step that keeps impacts in order; other events may pass."""
        if self.performed:
            return 1.0
        return float(self.segments(value).longest_part(unknowns, step))

    def residual(self, unknowns: Array, value: float) -> tuple[Array, Array]:
        """Return the equations' residual, and its derivative by the unknowns."""
        segments = self.segments(value)
        lasts = segments.durations(segments.motion(unknowns)[1])
        if not self.performed and float(lasts.min()) <= 0.0:
            raise ArithmeticError('impacts out of order')
        return segments.residual(unknowns)

    def orbit(self, root: Root, value: float) -> PeriodicOrbit:
        """Return the motion at a root, whose last unknown is the parameter."""
        segments = self.segments(value)
        states, instants = segments.motion(root.unknowns[:-1])
        return orbit_of(Solution(segments, states, instants, root.residual, root.history))


#: Largest residual of a point on a branch, and one that is small enough.
RESIDUAL_TOLERANCE, _ENOUGH = 1e-11, 1e-15

_ROUND_OFF = 1e-12


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
    """The solutions of a family as a curve, with the scaled parameter as the last coordinate."""

    def __init__(self, family: Family, scale: float) -> None:
        self.family = family
        self.scale = scale

    def value(self, place: Array) -> float:
        """Return the parameter, that of a bound where only round-off is between."""
        value = float(place[-1]) * self.scale
        along, slack = self.family.along, _ROUND_OFF * self.scale
        for bound in (along.low, along.high, *along.limits):
            if abs(value - bound) <= slack:
                return bound
        return value

    def system(self, place: Array) -> tuple[Array, Array]:
        """Return the residual and its derivative by unknowns and parameter."""
        value = self.value(place)
        residual, by_unknowns = self.family.residual(place[:-1], value)
        if self.family.along.path == 'gap':
            by_gap = self.family.segments(value).by_gap()
            return residual, np.column_stack([by_unknowns, by_gap * self.scale])
        step = 1e-6 * max(abs(float(place[-1])), 1e-3)
        sides = []
        for move in (step, -step):
            try:
                there = self.family.residual(place[:-1], (place[-1] + move) * self.scale)[0]
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
            residual, matrix = self.system(place)
            return np.append(residual, normal @ (place - guess)), np.vstack([matrix, normal])

        def longest_part(place: Array, step: Array) -> float:
            return self.family.longest_part(place[:-1], step[:-1], self.value(place))

        try:
            root = newton(in_plane, guess, longest_part, _ENOUGH)
            if not root.residual < RESIDUAL_TOLERANCE:
                return None
            tangent = _tangent(root.jacobian)
            orbit = self.family.orbit(root, self.value(root.unknowns))
        except (ArithmeticError, np.linalg.LinAlgError, ParameterError):
            return None
        return CurvePoint(root.unknowns, tangent, orbit)

    def ahead(self, point: CurvePoint, step: float) -> CurvePoint | None:
        """Return the point a step further along the curve, or None."""
        return self.correct(point.place + step * point.tangent, point.tangent)
