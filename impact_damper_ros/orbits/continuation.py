"""
Continuation of periodic motions in a parameter, by pseudo-arclength.

Special points are zeros of test functions along the branch:

- fold: the component of the tangent along the parameter;
- period doubling: the product of all (1 + multiplier); a multiplier passes -1;
- Neimark-Sacker: the product of all (1 - product of two multipliers); a pair passes the unit
  circle;
- branch point: the product of all (1 - multiplier), where the parameter does not turn back, as at
  a loss of symmetry;
- grazing: the motion ceases to be viable, or changes its sequence of impacts, reversals and rests.

Where the velocity of an impact vanishes, a multiplier has a pole. The products change sign there
too; such points are detected by their multipliers and discarded.

A branch is followed around its folds, since its arclength grows where the parameter turns. Keller
(1977), in Applications of Bifurcation Theory; Doedel, Keller and Kernevez, Int. J. Bifurcation
and Chaos 1 (1991).
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.quoting import shown

from .arguments import OrbitError, checked_number, checked_whole, single_harmonic
from .orbit import PeriodicOrbit
from .response import Array
from .search import within_theory
from .segments import Root, Segments, Solution, newton
from .solved_orbits import guess_on, orbit_of, performed

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


class _Family:
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


@dataclass(frozen=True)
class _Point:
    """A point of a branch: unknowns and scaled parameter, unit tangent, and the motion."""

    place: Array
    tangent: Array
    orbit: PeriodicOrbit


class _Curve:
    """The solutions of a family as a curve, with the scaled parameter as the last coordinate."""

    def __init__(self, family: _Family, scale: float) -> None:
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

    def correct(self, guess: Array, normal: Array) -> _Point | None:
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
            tangent = np.linalg.svd(root.jacobian[:-1])[2][-1]
            tangent = tangent if tangent @ normal >= 0.0 else -tangent
            orbit = self.family.orbit(root, self.value(root.unknowns))
        except (ArithmeticError, np.linalg.LinAlgError, ParameterError):
            return None
        return _Point(root.unknowns, tangent, orbit)

    def ahead(self, point: _Point, step: float) -> _Point | None:
        """Return the point a step further along the curve, or None."""
        return self.correct(point.place + step * point.tangent, point.tangent)


_LOCATED = 1e-9
#: How far a multiplier may be from where it should be at a special point, and at a guess of one.
_NEAR = 1e-3
_GUESSED = 0.2


class SpecialKind(Enum):
    """Kind of a special point."""

    FOLD = 'fold'
    PERIOD_DOUBLING = 'period doubling'
    NEIMARK_SACKER = 'Neimark-Sacker'
    BRANCH_POINT = 'branch point'
    GRAZING = 'grazing'


class BranchPoint(NamedTuple):
    """
    A point of a branch.

    Attributes
    ----------
    value : float
        The parameter.
    orbit : PeriodicOrbit
        The motion there.
    """

    value: float
    orbit: PeriodicOrbit


@dataclass(frozen=True, kw_only=True)
class SpecialPoint:
    """
    A special point of a branch.

    Attributes
    ----------
    kind : SpecialKind
        What happens there.
    value : float
        The parameter there.
    orbit : PeriodicOrbit
        The motion there; at a grazing, just on its viable side.
    bracket : tuple of float
        The parameter on either side of it; at a fold both are on the same side of its value.
    converged : bool
        Whether it is located to the tolerance; otherwise it is an estimate.
    reason : str
        At a grazing, the change just beyond it; else empty.
    """

    kind: SpecialKind
    value: float
    orbit: PeriodicOrbit
    bracket: tuple[float, float]
    converged: bool
    reason: str = ''


_Test = Callable[[_Point], float]


def _real_product(factors: list[complex]) -> float:
    product = complex(1.0)
    for factor in factors:
        product *= factor
    return product.real


def _fold(point: _Point) -> float:
    return float(point.tangent[-1])


def _doubling(point: _Point) -> float:
    return _real_product([1.0 + m for m in point.orbit.multipliers])


def _branching(point: _Point) -> float:
    return _real_product([1.0 - m for m in point.orbit.multipliers])


def _torus(point: _Point) -> float:
    pairs = itertools.combinations(point.orbit.multipliers, 2)
    return _real_product([1.0 - a * b for a, b in pairs])


def _events(orbit: PeriodicOrbit) -> Counter[str]:
    """Describe the events of a period."""
    words: Counter[str] = Counter(f'impact on stop {stop}' for stop in orbit.stops)
    words.update(
        node.kind.name.lower() + (f' on stop {node.stop}' if node.stop else '')
        for node in sorted(orbit.events)
    )
    return words


def _likeness(start: _Point) -> _Test:
    """Return a test that is positive where a motion is of the same kind as the first one."""
    kind = (start.orbit.viable, _events(start.orbit))

    def alike(point: _Point) -> float:
        return 1.0 if (point.orbit.viable, _events(point.orbit)) == kind else -1.0

    return alike


def _difference(here: PeriodicOrbit, there: PeriodicOrbit) -> str:
    """Describe the difference beyond a grazing."""
    if there.reason:
        return there.reason
    new, old = _events(there), _events(here)
    gained = [f'{n} more {what}' for what, n in (new - old).items()]
    lost = [f'{n} less {what}' for what, n in (old - new).items()]
    return ', '.join(gained + lost)


def _genuine(kind: SpecialKind, orbit: PeriodicOrbit, near: float) -> bool:
    """Return whether the multipliers at a located point are those of its kind."""
    values = orbit.multipliers
    if kind is SpecialKind.PERIOD_DOUBLING:
        return min(abs(m + 1.0) for m in values) < near
    if kind is SpecialKind.BRANCH_POINT:
        return min(abs(m - 1.0) for m in values) < near
    if kind is SpecialKind.NEIMARK_SACKER:
        return any(abs(abs(m) - 1.0) < near and m.imag != 0.0 for m in values)
    return True


class _Between(NamedTuple):
    """Two neighbouring points of a branch, both on a curve, and the step from one to the other."""

    curve: _Curve
    start: _Point
    end: _Point
    step: float
    #: What changes where the rig leaves the curve before the second one, if it does.
    change: str = ''


class _Located(NamedTuple):
    """A special point, and the place on the curve where it is."""

    step: float
    point: _Point
    special: SpecialPoint


def _locate(between: _Between, kind: SpecialKind, test: _Test) -> _Located | None:
    """Find where a test function changes sign between two points of a branch."""
    from scipy.optimize import brentq

    curve, start, end, step, change = between
    near, far = (0.0, start), (step, end)
    side = test(start)

    def value_at(there: float) -> float:
        nonlocal near, far
        if there in (0.0, step):
            return test(end if there else start)
        middle = curve.ahead(start, there)
        if middle is None:
            raise ArithmeticError('the corrector fails')
        value = test(middle)
        if (value > 0.0) == (side > 0.0):
            near = max(near, (there, middle), key=lambda pair: pair[0])
        else:
            far = min(far, (there, middle), key=lambda pair: pair[0])
        return value

    try:
        brentq(value_at, 0.0, step, xtol=_LOCATED * step)
        complete = True
    except ArithmeticError:
        complete = False
    best, other = near, far
    if abs(test(best[1])) > abs(test(other[1])):
        best, other = other, best
    reason = ''
    if kind is SpecialKind.GRAZING:
        best, other = (near, far) if near[1].orbit.viable else (far, near)
        there = other[1].orbit
        beyond = performed(there, there.parameters) if curve.family.performed else None
        reason = _difference(best[1].orbit, beyond or there) or change
    orbit = best[1].orbit
    if not _genuine(kind, orbit, _NEAR if complete else _GUESSED):
        return None
    special = SpecialPoint(
        kind=kind,
        value=curve.value(best[1].place),
        orbit=orbit,
        bracket=(curve.value(near[1].place), curve.value(far[1].place)),
        converged=complete,
        reason=reason,
    )
    return _Located(*best, special)


def _special_points(between: _Between) -> list[_Located]:
    """Locate the special points between two neighbouring points of a branch, in order."""
    _, start, end, _, change = between
    turns = _fold(start) * _fold(end) < 0.0
    tests: tuple[tuple[SpecialKind, _Test], ...] = (
        (SpecialKind.FOLD, _fold),
        (SpecialKind.PERIOD_DOUBLING, _doubling),
        (SpecialKind.NEIMARK_SACKER, _torus),
        (SpecialKind.BRANCH_POINT, _branching),
        (SpecialKind.GRAZING, _likeness(start)),
    )
    found = []
    for kind, test in tests:
        if test(start) * test(end) >= 0.0 or (kind is SpecialKind.BRANCH_POINT and turns):
            continue
        located = _locate(between, kind, test)
        if located is not None and (located.special.orbit.viable or not change):
            found.append(located)
    return sorted(found, key=lambda located: located.step)


_SHARPEST_TURN = 0.95
_GROWTH = 1.4
#: The first step, as a share of the largest one.
_FIRST_STEP = 0.1
_LEAST_STEP = 1e-7


class Limit(Enum):
    """What limits the best point of a branch."""

    MINIMUM = 'interior minimum'
    STABILITY = 'edge of stability'
    VIABILITY = 'edge of viability'
    FOLD = 'fold: the motion ends'
    RANGE = 'end of the searched range'


class BestPoint(NamedTuple):
    """
    The best point of a branch.

    Attributes
    ----------
    value : float
        The parameter.
    orbit : PeriodicOrbit
        The motion there; at an edge the one on it.
    limit : Limit
        Whether it is a minimum, or what ends the motion just beyond.
    beyond : str
        The change just beyond it; empty at a minimum.
    """

    value: float
    orbit: PeriodicOrbit
    limit: Limit
    beyond: str


#: Error of the place of a minimum, as a share of two steps of the branch.
_NARROW = 1e-6
_LIMITS = {SpecialKind.FOLD: Limit.FOLD, SpecialKind.GRAZING: Limit.VIABILITY}


class _Piece(NamedTuple):
    """A part of a curve between two points that the branch has."""

    curve: _Curve
    start: _Point
    end: _Point

    def at(self, share: float) -> _Point | None:
        """Return the point where the chord between both has a normal plane."""
        chord = self.end.place - self.start.place
        length = float(np.linalg.norm(chord))
        if not 0.0 < share < 1.0 or length == 0.0:
            return self.end if share >= 1.0 else self.start
        return self.curve.correct(self.start.place + share * chord, chord / length)

    def at_value(self, value: float) -> _Point | None:
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
            guess, normal = near.place.copy(), np.zeros_like(near.place)
            guess[-1], normal[-1] = there, math.copysign(1.0, end - begin)
            point = self.curve.correct(guess, normal)
            if point is not None and np.linalg.norm(point.place - near.place) <= np.linalg.norm(
                self.end.place - self.start.place
            ):
                return point
            try:
                share = brentq(missed, 0.0, 1.0, xtol=_LOCATED)
            except ArithmeticError:
                return None
        return None


@dataclass(frozen=True, kw_only=True)
class Branch:
    """
    A branch of periodic motions.

    Attributes
    ----------
    name : str
        The parameter varied.
    points : tuple of BranchPoint
        Its motions in order along the branch; the parameter may turn.
    special : tuple of SpecialPoint
        Special points, in the same order. Those that `follow` has located are among the points.
    began, ended : str
        Why the branch was not followed further at its first and last point; empty if it was not
        followed there.
    """

    name: str
    points: tuple[BranchPoint, ...]
    special: tuple[SpecialPoint, ...]
    ended: str
    began: str = ''
    _pieces: tuple[_Piece, ...] = field(default=(), repr=False, compare=False)

    @property
    def values(self) -> tuple[float, ...]:
        """The parameter at the points."""
        return tuple(point.value for point in self.points)

    @property
    def orbits(self) -> tuple[PeriodicOrbit, ...]:
        """The motions at the points."""
        return tuple(point.orbit for point in self.points)

    def at(self, values: Sequence[float]) -> list[tuple[PeriodicOrbit, ...]]:
        """
        Return the motions of the branch at some values of the parameter.

        Parameters
        ----------
        values : sequence of float
            The values.

        Returns
        -------
        list of tuple of PeriodicOrbit
            For each value the motions there, in order along the branch: none where it does not
            reach, several where it turns.
        """
        found: list[tuple[PeriodicOrbit, ...]] = []
        for value in values:
            here: list[PeriodicOrbit] = []
            for piece in self._pieces:
                ends = (piece.curve.value(piece.start.place), piece.curve.value(piece.end.place))
                if not min(ends) <= value <= max(ends) or ends[0] == ends[1]:
                    continue
                point = piece.at_value(value)
                if point is not None and point.orbit not in here:
                    here.append(point.orbit)
            found.append(tuple(here))
        return found

    def best(self, measure: str | Callable[[PeriodicOrbit], float] = 'x_max') -> BestPoint | None:
        """
        Return the stable, viable motion with the least of some measure.

        Parameters
        ----------
        measure : str or callable, optional
            A number that a `PeriodicOrbit` has, or a function of it; 'x_max' if not given.

        Returns
        -------
        BestPoint or None
            The motion and what limits it; None if no motion of the branch is stable and viable.
        """

        def size(orbit: PeriodicOrbit) -> float:
            return float(getattr(orbit, measure) if isinstance(measure, str) else measure(orbit))

        fit = [point.orbit.viable and not point.orbit.unstable for point in self.points]
        sizes = [
            size(point.orbit) if good else math.inf
            for point, good in zip(self.points, fit, strict=True)
        ]
        found: list[BestPoint] = []
        for i, point in enumerate(self.points):
            around = sizes[max(i - 1, 0) : i + 2]
            # The least of them need not be in the deepest valley
            if math.isinf(sizes[i]) or sizes[i] > min(around):
                continue
            if 0 < i < len(sizes) - 1 and not any(map(math.isinf, around)):
                found.append(self._valley(i, size))
            else:
                found.append(self._edge(i, point))
        return min(found, key=lambda best: size(best.orbit), default=None)

    def joined(self, other: Branch) -> Branch:
        """Return a branch that was followed downwards, and one upwards, from a motion, as one."""
        if not self.points or self.ended == _CLOSES:
            return self if self.points else other
        back = (_Piece(piece.curve, piece.end, piece.start) for piece in self._pieces[::-1])
        turned = replace(
            self,
            points=self.points[::-1],
            special=self.special[::-1],
            began=self.ended,
            _pieces=tuple(back),
        )
        return turned.extended(other)

    def extended(self, further: Branch) -> Branch:
        """Return the branch with one that goes on from its last point."""
        return replace(
            self,
            points=(*self.points, *further.points[1:]),
            special=(*self.special, *further.special),
            ended=further.ended,
            _pieces=(*self._pieces, *further._pieces),
        )

    def _valley(self, i: int, size: Callable[[PeriodicOrbit], float]) -> BestPoint:
        """Return the least motion next to a point that is lower than both its neighbours."""
        from scipy.optimize import minimize_scalar

        best = self.points[i]
        before = next((p for p in self._pieces if p.end.orbit == best.orbit), None)
        after = next((p for p in self._pieces if p.start.orbit == best.orbit), None)
        if before is None or after is None:
            return BestPoint(*best, Limit.MINIMUM, '')

        def size_at(share: float) -> float:
            nonlocal best
            piece = before if share < 1.0 else after
            point = piece.at(share % 1.0)
            if point is None or not point.orbit.viable or point.orbit.unstable:
                return math.inf
            if size(point.orbit) < size(best.orbit):
                best = BranchPoint(piece.curve.value(point.place), point.orbit)
            return size(point.orbit)

        minimize_scalar(size_at, bounds=(0.0, 2.0), method='bounded', options={'xatol': _NARROW})
        return BestPoint(*best, Limit.MINIMUM, '')

    def _edge(self, i: int, point: BranchPoint) -> BestPoint:
        """Return the motion at a point beyond which it ends, or changes."""
        special = next((s for s in self.special if s.orbit == point.orbit), None)
        if special is not None:
            limit = _LIMITS.get(special.kind, Limit.STABILITY)
            return BestPoint(*point, limit, special.reason or special.kind.value)
        ended = self.ended if i else self.began
        limit = Limit.FOLD if ended == _NONE_NEARBY else Limit.RANGE
        return BestPoint(*point, limit, ended)


#: Why a branch ends: at the end of its range, and elsewhere.
_END, _NONE_NEARBY = 'the end of the range', 'no motion nearby: the corrector fails'
_CLOSES = 'the branch closes'


def _performed_beyond(
    curve: _Curve, point: _Point, along: Continuation
) -> tuple[_Curve, _Point] | None:
    """
    Return the motion that the rig performs in place of a solution, and its curve.

    It has the same impacts; along the branch a reversal, sticking or rest has come or gone.
    """
    found = performed(point.orbit, point.orbit.parameters)
    if found is None or found.distance(point.orbit) > 4.0 * along.largest_step:
        return None
    value = curve.value(point.place)
    fresh = _Curve(_Family(found, curve.family.along, value), curve.scale)
    place = np.append(fresh.family.start, point.place[-1])
    normal = np.zeros_like(place)
    normal[-1] = math.copysign(1.0, point.tangent[-1])
    again = fresh.correct(place, normal)
    return (fresh, again) if again is not None and again.orbit.viable else None


def _edge(curve: _Curve, here: _Point, step: float, along: Continuation) -> _Point | None:
    """Return the point on the bound that the next step would cross, if any."""
    ahead = curve.value(here.place + step * here.tangent)
    if along.holds(ahead):
        return None
    bound = along.low if ahead < along.low else along.high
    share = (bound / curve.scale - here.place[-1]) / here.tangent[-1]
    guess = here.place + share * here.tangent
    guess[-1] = bound / curve.scale
    normal = np.zeros_like(guess)
    normal[-1] = math.copysign(1.0, here.tangent[-1])
    last = curve.correct(guess, normal)
    if last is None or float(last.tangent @ here.tangent) < _SHARPEST_TURN:
        return None
    return last


def _follow(curve: _Curve, point: _Point, along: Continuation) -> Iterator[Branch]:
    """Step along a branch until it leaves the bounds, ends or closes; see `grow_branch`."""
    name, largest_step, most_points = along.name, along.largest_step, along.most_points
    points, curves = [point], [curve]
    between: list[_Between] = []

    def branch(ended: str = '') -> Branch:
        found = (
            BranchPoint(c.value(p.place), p.orbit) for c, p in zip(curves, points, strict=True)
        )
        return Branch(name=name, points=tuple(found), special=(), ended=ended)

    yield branch()
    step = first_step = _FIRST_STEP * largest_step
    moved = False
    ended = f'{most_points} points'
    while len(points) < most_points:
        here = points[-1]
        there = edge = _edge(curve, here, step, along)
        if edge is None:
            there = curve.ahead(here, step)
        fresh = None
        if there is not None and curve.family.performed and not there.orbit.viable:
            fresh = _performed_beyond(curve, there, along)
        if (
            there is None
            or float(there.tangent @ here.tangent) < _SHARPEST_TURN
            or (edge is None and not along.holds(curve.value(there.place)))
            or (fresh is None and curve.family.performed and not there.orbit.viable)
        ):
            step *= 0.5
            if step >= _LEAST_STEP * largest_step:
                continue
            ended = _NONE_NEARBY
            break
        if edge is not None:
            step = float((edge.place - here.place) @ here.tangent)
        if fresh is None:
            between.append(_Between(curve, here, there, step))
        else:
            lost = _difference(here.orbit, fresh[1].orbit)
            between.append(_Between(curve, here, there, step, lost))
            curve, there = fresh
            step, moved = first_step, True
        points.append(there)
        curves.append(curve)
        if edge is not None:
            value = curve.value(there.place)
            bound = min(along.low, along.high, key=lambda b: abs(b - value))
            ended = f'{name} = {bound:g}, {_END}'
            break
        if (
            not moved
            and len(points) > 4
            and np.linalg.norm(there.place - point.place) < 0.5 * step
        ):
            ended = _CLOSES
            break
        yield branch()
        step = min(largest_step, _GROWTH * step)
    # The special points take as long as all the rest.
    yield branch(ended)
    yield _with_special_points(branch(ended), between)


def _with_special_points(branch: Branch, between: Sequence[_Between]) -> Branch:
    """Return a branch with its special points, also among its points."""
    special: list[SpecialPoint] = []
    points, pieces = [*branch.points[:1]], []
    for pair, after in zip(between, branch.points[1:], strict=True):
        start = pair.start
        for located in _special_points(pair):
            special.append(located.special)
            if located.point.orbit not in (pair.start.orbit, pair.end.orbit):
                points.append(BranchPoint(located.special.value, located.point.orbit))
                pieces.append(_Piece(pair.curve, start, located.point))
                start = located.point
        points.append(after)
        pieces.append(_Piece(pair.curve, start, pair.end))
    return replace(branch, points=tuple(points), special=tuple(special), _pieces=tuple(pieces))


def follow(
    orbit: PeriodicOrbit,
    path: Path,
    low: float,
    high: float,
    *,
    start: float | None = None,
    largest_step: float = 0.05,
    most_points: int = 400,
) -> Branch:
    """
    Follow a periodic motion in both directions while the rig varies.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion to begin with.
    path : str or callable
        The parameter that varies: a number of `RigParameters`, the first entry of an array, or
        'restitution' for both coefficients; or a function that returns the rig at a number.
    low, high : float
        Range of the parameter. The branch may turn within it.
    start : float, optional
        Where a function returns the rig of the motion; `low` or `high`, if not given.
    largest_step : float, optional
        Longest step, relative to the displacements, phases and the parameter.
    most_points : int, optional
        Largest number of points in each direction.

    Returns
    -------
    Branch
        The motions, first those below the first one, and the special points among them.

    Raises
    ------
    OrbitError
        If the motion is outside the range, or the parameter cannot be varied.

    Examples
    --------
    >>> from impact_damper_ros.orbits import find_orbits
    >>> from impact_damper_ros.rig import RigParameters
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2)).orbits[0]
    >>> branch = follow(orbit, 'gap', 20.0, 60.0)
    >>> [point.kind.value for point in branch.special]
    ['branch point', 'Neimark-Sacker']
    >>> round(branch.best('x_max').value, 3)
    58.128
    """
    along = Continuation(path, low, high, largest_step, most_points, start)
    down, up = (continue_orbit(orbit, along, upwards=upwards) for upwards in (False, True))
    return down.joined(up)


def continue_orbit(orbit: PeriodicOrbit, along: Continuation, *, upwards: bool = True) -> Branch:
    """Follow a periodic motion in one direction; see `follow`."""
    *_, branch = grow_branch(orbit, along, upwards=upwards)
    return branch


def grow_branch(
    orbit: PeriodicOrbit, along: Continuation, *, upwards: bool = True
) -> Iterator[Branch]:
    """
    Follow a periodic motion in one direction, point by point.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion to begin with.
    along : Continuation
        The parameter, its range and the steps.
    upwards : bool, optional
        Whether the parameter rises at first.

    Yields
    ------
    Branch
        The branch so far, after each point. The last but one is complete except for its special
        points (`ended` is why it ended); the last one includes them.

    Raises
    ------
    OrbitError
        If the motion is outside the range.
    """
    along.check_start(orbit.parameters)
    value = along.value(orbit.parameters)
    family = _Family(orbit, along, value)
    curve = _Curve(family, abs(value) or max(abs(along.low), abs(along.high)) or 1.0)
    place = np.append(family.start, value / curve.scale)
    normal = np.zeros_like(place)
    normal[-1] = 1.0 if upwards else -1.0
    point = curve.correct(place, normal)
    if point is None:
        yield Branch(name=along.name, points=(), special=(), ended='no motion to begin with')
        return
    yield from _follow(curve, point, along)


def switch_branch(special: SpecialPoint, along: Continuation, *, mirrored: bool = False) -> Branch:
    """
    Follow the branch that leaves another one at a period doubling or a branch point.

    Parameters
    ----------
    special : SpecialPoint
        Where it leaves.
    along : Continuation
        The parameter, its range and the steps.
    mirrored : bool, optional
        Whether to begin in the opposite direction.

    Returns
    -------
    Branch
        The motions that branch off: of twice the period at a period doubling.

    Raises
    ------
    ValueError
        If the point is of another kind.
    """
    if special.kind not in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
        raise ValueError(f'no branch leaves at a {special.kind.value}')
    times = 2 if special.kind is SpecialKind.PERIOD_DOUBLING else 1
    family = _Family(special.orbit, along, special.value, times)
    unknowns = family.start
    curve = _Curve(family, abs(special.value) or 1.0)
    place = np.append(unknowns, special.value / curve.scale)
    by_unknowns = family.residual(unknowns, special.value)[1]
    direction = np.append(np.linalg.svd(by_unknowns)[2][-1], 0.0)
    direction = -direction if mirrored else direction
    step = _FIRST_STEP * along.largest_step
    point = curve.correct(place + step * direction, direction)
    if point is None:
        return Branch(name=along.name, points=(), special=(), ended='no branch found')
    *_, branch = _follow(curve, point, along)
    return branch
