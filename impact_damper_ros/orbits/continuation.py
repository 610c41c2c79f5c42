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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.quoting import shown

from .equations import Array, OrbitError, checked_number, checked_whole, single_harmonic
from .orbit import PeriodicOrbit
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


@dataclass(frozen=True)
class Continuation:
    """
    Options of a continuation.

    Parameters
    ----------
    name : str
        The parameter that varies: a number of `RigParameters`, the first entry of an array, or
        'restitution' for both coefficients.
    low, high : float
        Range of the parameter. The branch may turn within it.
    largest_step : float, optional
        Longest step, relative to the displacements, phases and the parameter.
    most_points : int, optional
        Largest number of points on the branch.

    Raises
    ------
    OrbitError
        If the parameter cannot be varied, or a number is out of range.
    """

    name: str
    low: float
    high: float
    largest_step: float = 0.05
    most_points: int = 400

    def __post_init__(self) -> None:
        """Check the options."""
        _check_name(self.name)
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
        value = value_of(parameters, self.name)
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

    They solve n equations in n unknowns and one parameter, `name`.
    """

    def __init__(self, orbit: PeriodicOrbit, name: str, times: int = 1) -> None:
        value = value_of(orbit.parameters, name)
        guess = guess_on(orbit)
        if guess is None:
            raise OrbitError('the motion has too many events to be followed')
        self.parameters = orbit.parameters
        self.name = name
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
            rig = with_value(self.parameters, self.name, value)
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
        """Return the parameter, clipped to its range against round-off."""
        value = float(place[-1]) * self.scale
        low, high = _limits_of(self.family.name)
        slack = _ROUND_OFF * self.scale
        if low - slack <= value < low:
            return low
        return high if high < value <= high + slack else value

    def system(self, place: Array) -> tuple[Array, Array]:
        """Return the residual and its derivative by unknowns and parameter."""
        value = self.value(place)
        residual, by_unknowns = self.family.residual(place[:-1], value)
        if self.family.name == 'gap':
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


def _locate(between: _Between, kind: SpecialKind, test: _Test) -> SpecialPoint | None:
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
    best, other = near[1], far[1]
    if abs(test(best)) > abs(test(other)):
        best, other = other, best
    reason = ''
    if kind is SpecialKind.GRAZING:
        best, other = (near[1], far[1]) if near[1].orbit.viable else (far[1], near[1])
        beyond = performed(other.orbit, other.orbit.parameters) if curve.family.performed else None
        reason = _difference(best.orbit, beyond or other.orbit) or change
    if not _genuine(kind, best.orbit, _NEAR if complete else _GUESSED):
        return None
    return SpecialPoint(
        kind=kind,
        value=curve.value(best.place),
        orbit=best.orbit,
        bracket=(curve.value(near[1].place), curve.value(far[1].place)),
        converged=complete,
        reason=reason,
    )


def _special_points(between: _Between) -> list[SpecialPoint]:
    """Locate the special points between two neighbouring points of a branch."""
    curve, start, end, _, change = between
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
        special = _locate(between, kind, test)
        if special is not None and (special.orbit.viable or not change):
            found.append(special)
    first = curve.value(start.place)
    return sorted(found, key=lambda special: abs(special.value - first))


_SHARPEST_TURN = 0.95
_GROWTH = 1.4
#: The first step, as a share of the largest one.
_FIRST_STEP = 0.1
_LEAST_STEP = 1e-7


@dataclass(frozen=True, kw_only=True)
class Branch:
    """
    A branch of periodic motions.

    Attributes
    ----------
    name : str
        The parameter varied.
    values : tuple of float
        Its values along the branch.
    orbits : tuple of PeriodicOrbit
        The motions there.
    special : tuple of SpecialPoint
        Special points, in order along the branch.
    ended : str
        Why the branch was not followed further.
    """

    name: str
    values: tuple[float, ...]
    orbits: tuple[PeriodicOrbit, ...]
    special: tuple[SpecialPoint, ...]
    ended: str


def _performed_beyond(
    curve: _Curve, point: _Point, along: Continuation
) -> tuple[_Curve, _Point] | None:
    """
    Return the motion that the rig performs in place of a solution, and its curve.

    It has the same impacts; along the branch a reversal, sticking or rest has come or gone.
    """
    found = performed(point.orbit, point.orbit.parameters)
    if found is None or found.differs(point.orbit) > 4.0 * along.largest_step:
        return None
    fresh = _Curve(_Family(found, curve.family.name), curve.scale)
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
    points = [point]
    between: list[_Between] = []

    def branch(ended: str = '', special: tuple[SpecialPoint, ...] = ()) -> Branch:
        return Branch(
            name=name,
            values=tuple(value_of(p.orbit.parameters, name) for p in points),
            orbits=tuple(p.orbit for p in points),
            special=special,
            ended=ended,
        )

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
            ended = 'no motion nearby: the corrector fails'
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
        if edge is not None:
            value = value_of(there.orbit.parameters, name)
            bound = min(along.low, along.high, key=lambda b: abs(b - value))
            ended = f'{name} = {bound:g}, the end of the range'
            break
        if (
            not moved
            and len(points) > 4
            and np.linalg.norm(there.place - point.place) < 0.5 * step
        ):
            ended = 'the branch closes'
            break
        yield branch()
        step = min(largest_step, _GROWTH * step)
    # The special points take as long as all the rest.
    yield branch(ended)
    special = [found for pair in between for found in _special_points(pair)]
    yield branch(ended, tuple(special))


def continue_orbit(orbit: PeriodicOrbit, along: Continuation, *, upwards: bool = True) -> Branch:
    """
    Follow a periodic motion while a parameter of the rig varies.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion to begin with.
    along : Continuation
        The parameter, its range and the steps.
    upwards : bool, optional
        Whether the parameter rises at first.

    Returns
    -------
    Branch
        The motions and the special points between them.

    Raises
    ------
    OrbitError
        If the motion is outside the range.

    Examples
    --------
    >>> from impact_damper_ros.orbits import find_orbits
    >>> from impact_damper_ros.rig import RigParameters
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2)).orbits[0]
    >>> branch = continue_orbit(orbit, Continuation('gap', 20.0, 40.0))
    >>> branch.ended
    'gap = 40, the end of the range'
    """
    *_, branch = grow_branch(orbit, along, upwards=upwards)
    return branch


def grow_branch(
    orbit: PeriodicOrbit, along: Continuation, *, upwards: bool = True
) -> Iterator[Branch]:
    """
    Follow a periodic motion as `continue_orbit` does, point by point.

    Parameters
    ----------
    orbit, along, upwards
        As in `continue_orbit`.

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
    name = along.name
    value = value_of(orbit.parameters, name)
    family = _Family(orbit, name)
    curve = _Curve(family, abs(value) or max(abs(along.low), abs(along.high)) or 1.0)
    place = np.append(family.start, value / curve.scale)
    normal = np.zeros_like(place)
    normal[-1] = 1.0 if upwards else -1.0
    point = curve.correct(place, normal)
    if point is None:
        yield Branch(name=name, values=(), orbits=(), special=(), ended='no motion to begin with')
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
    orbit = special.orbit
    if special.kind not in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
        raise ValueError(f'no branch leaves at a {special.kind.value}')
    times = 2 if special.kind is SpecialKind.PERIOD_DOUBLING else 1
    family = _Family(orbit, along.name, times)
    unknowns = family.start
    curve = _Curve(family, abs(special.value) or 1.0)
    place = np.append(unknowns, special.value / curve.scale)
    by_unknowns = family.residual(unknowns, special.value)[1]
    direction = np.append(np.linalg.svd(by_unknowns)[2][-1], 0.0)
    direction = -direction if mirrored else direction
    step = _FIRST_STEP * along.largest_step
    point = curve.correct(place + step * direction, direction)
    if point is None:
        return Branch(name=along.name, values=(), orbits=(), special=(), ended='no branch found')
    *_, branch = _follow(curve, point, along)
    return branch
