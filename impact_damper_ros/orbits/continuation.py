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
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .branch import (
    CLOSES,
    END,
    LOCATED,
    NONE_NEARBY,
    Branch,
    BranchPoint,
    Piece,
    SpecialKind,
    SpecialPoint,
)
from .orbit import PeriodicOrbit
from .solution_curve import Continuation, CurvePoint, Family, Path, SolutionCurve
from .solved_orbits import performed

#: How far a multiplier may be from where it should be at a special point, and at a guess of one.
_NEAR = 1e-3
_GUESSED = 0.2

_Test = Callable[[CurvePoint], float]


def _real_product(factors: list[complex]) -> float:
    product = complex(1.0)
    for factor in factors:
        product *= factor
    return product.real


def _fold(point: CurvePoint) -> float:
    return float(point.tangent[-1])


def _doubling(point: CurvePoint) -> float:
    return _real_product([1.0 + m for m in point.orbit.multipliers])


def _branching(point: CurvePoint) -> float:
    return _real_product([1.0 - m for m in point.orbit.multipliers])


def _torus(point: CurvePoint) -> float:
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


def _likeness(start: CurvePoint) -> _Test:
    """Return a test that is positive where a motion is of the same kind as the first one."""
    kind = (start.orbit.viable, _events(start.orbit))

    def alike(point: CurvePoint) -> float:
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

    curve: SolutionCurve
    start: CurvePoint
    end: CurvePoint
    step: float
    #: What changes where the rig leaves the curve before the second one, if it does.
    change: str = ''


class _Located(NamedTuple):
    """A special point, and the place on the curve where it is."""

    step: float
    point: CurvePoint
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
        brentq(value_at, 0.0, step, xtol=LOCATED * step)
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


def _performed_beyond(
    curve: SolutionCurve, point: CurvePoint, along: Continuation
) -> tuple[SolutionCurve, CurvePoint] | None:
    """
    Return the motion that the rig performs in place of a solution, and its curve.

    It has the same impacts; along the branch a reversal, sticking or rest has come or gone.
    """
    found = performed(point.orbit, point.orbit.parameters)
    if found is None or found.distance(point.orbit) > 4.0 * along.largest_step:
        return None
    value = curve.value(point.place)
    fresh = SolutionCurve(Family(found, curve.family.along, value), curve.scale)
    place = np.append(fresh.family.start, point.place[-1])
    normal = np.zeros_like(place)
    normal[-1] = math.copysign(1.0, point.tangent[-1])
    again = fresh.correct(place, normal)
    return (fresh, again) if again is not None and again.orbit.viable else None


def _edge(
    curve: SolutionCurve, here: CurvePoint, step: float, along: Continuation
) -> CurvePoint | None:
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


def _follow(curve: SolutionCurve, point: CurvePoint, along: Continuation) -> Iterator[Branch]:
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
            ended = NONE_NEARBY
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
            ended = f'{name} = {bound:g}, {END}'
            break
        if (
            not moved
            and len(points) > 4
            and np.linalg.norm(there.place - point.place) < 0.5 * step
        ):
            ended = CLOSES
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
                pieces.append(Piece(pair.curve, start, located.point))
                start = located.point
        points.append(after)
        pieces.append(Piece(pair.curve, start, pair.end))
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
    family = Family(orbit, along, value)
    curve = SolutionCurve(family, abs(value) or max(abs(along.low), abs(along.high)) or 1.0)
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
    family = Family(special.orbit, along, special.value, times)
    unknowns = family.start
    curve = SolutionCurve(family, abs(special.value) or 1.0)
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
