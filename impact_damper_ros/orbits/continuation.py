# SPDX-License-Identifier: Apache-2.0
"""
Continuation of periodic motions in a parameter, by pseudo-arclength.

Special points are zeros of test functions along the branch:

- fold: the component of the tangent along the parameter; or a grazing where two events meet, as
  the beginning and the end of sticking, and the branch turns back without them (nonsmooth fold);
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
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter, itemgetter
from typing import NamedTuple

import numpy as np

from .arclength import (
    BRANCHING,
    DOUBLING,
    FOLD,
    HIGH_END,
    LEAST_STEP,
    LOST,
    LOW_END,
    NOT_VIABLE,
    SHARPEST_TURN,
    TORUS,
    VIABLE,
)
from .arguments import OrbitError
from .branch import (
    CLOSES,
    END,
    NONE_NEARBY,
    POINTS,
    Branch,
    BranchPoint,
    SpecialKind,
    SpecialPoint,
)
from .orbit import PeriodicOrbit
from .solution_curve import LOCATED, CurvePoint, Path, Piece, SolutionCurve, Steps, range_of
from .solved_orbits import performed

#: How far a multiplier may be from where it should be at a special point, and at a guess of one.
_NEAR = 1e-3
_GUESSED = 0.2
#: A multiplier that is larger is at a pole.
_POLE = 1e10


def _events(orbit: PeriodicOrbit) -> Counter[str]:
    """Describe the events of a period."""
    words: Counter[str] = Counter(f'impact on stop {stop}' for stop in orbit.stops)
    words.update(
        node.kind.name.lower() + (f' on stop {node.stop}' if node.stop else '')
        for node in sorted(orbit.events)
    )
    return words


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
    if kind not in (SpecialKind.FOLD, SpecialKind.GRAZING) and abs(values[0]) > _POLE:
        # Round-off of the largest one hides the others
        return False
    if kind is SpecialKind.PERIOD_DOUBLING:
        return min(abs(m + 1.0) for m in values) < near
    if kind is SpecialKind.BRANCH_POINT:
        return min(abs(m - 1.0) for m in values) < near
    if kind is SpecialKind.NEIMARK_SACKER:
        return any(abs(abs(m) - 1.0) < near and m.imag != 0.0 for m in values)
    return True


class _Located(NamedTuple):
    """A special point, and the place on the curve where it is, as a share of a piece."""

    share: float
    point: CurvePoint
    special: SpecialPoint


#: The test functions, by where they are among the marks of a point.
_TESTS = {
    SpecialKind.FOLD: FOLD,
    SpecialKind.PERIOD_DOUBLING: DOUBLING,
    SpecialKind.NEIMARK_SACKER: TORUS,
    SpecialKind.BRANCH_POINT: BRANCHING,
    SpecialKind.GRAZING: VIABLE,
}


def _turns(start: CurvePoint, end: CurvePoint) -> bool:
    """Return whether the parameter turns between two points."""
    return bool(start.tangent[-1] * end.tangent[-1] < 0.0)


def _locate(piece: Piece, kind: SpecialKind) -> _Located | None:
    """Find where a test function changes sign between two points of a branch."""
    from scipy.optimize import brentq

    test = _TESTS[kind]
    near, far = (0.0, piece.start), (1.0, piece.end)
    side = piece.start.marks[test] > 0.0

    def value_at(share: float) -> float:
        nonlocal near, far
        middle = piece.at(share)
        if middle is None:
            raise ArithmeticError('the corrector fails')
        value = float(middle.marks[test])
        if (value > 0.0) == side:
            near = max(near, (share, middle), key=itemgetter(0))
        else:
            far = min(far, (share, middle), key=itemgetter(0))
        return value

    try:
        brentq(value_at, 0.0, 1.0, xtol=LOCATED)
        complete = True
    except ArithmeticError:
        complete = False
    best, other = near, far
    if abs(best[1].marks[test]) > abs(other[1].marks[test]):
        best, other = other, best
    reason = ''
    if kind is SpecialKind.GRAZING:
        best, other = (near, far) if near[1].viable else (far, near)
        there = other[1].orbit
        replaced = piece.curve.performed(other[1].value)
        beyond = performed(there, there.parameters) if replaced else None
        reason = _difference(best[1].orbit, beyond or there) or piece.change
    orbit = best[1].orbit
    if not _genuine(kind, orbit, _NEAR if complete else _GUESSED):
        return None
    special = SpecialPoint(
        kind=kind,
        value=best[1].value,
        orbit=orbit,
        bracket=(near[1].value, far[1].value),
        converged=complete,
        reason=reason,
    )
    return _Located(*best, special)


def _special_points(piece: Piece) -> list[_Located]:
    """Locate the special points between two neighbouring points of a branch, in order."""
    start, end = piece.start, piece.end
    located_points: list[_Located] = []
    for kind, test in _TESTS.items():
        changes = start.marks[test] * end.marks[test] < 0.0
        if not changes or (kind is SpecialKind.BRANCH_POINT and _turns(start, end)):
            continue
        located = _locate(piece, kind)
        if located is None or (piece.change and not located.special.orbit.viable):
            continue
        if kind is SpecialKind.GRAZING and piece.turns:
            located = located._replace(special=replace(located.special, kind=SpecialKind.FOLD))
        located_points.append(located)
    return sorted(located_points, key=attrgetter('share'))


#: The first step, as a share of the largest one.
_FIRST_STEP = 0.1
#: Distance of a place that is met again.
_SAME_PLACE = 1e-6
#: Least scale of a parameter that begins near zero, as a share of its range.
_LEAST_SCALE = 0.2
#: How far from a meeting of two events the motion without them is sought, in steps.
_BEYOND = 1e-6


def _performed_beyond(
    curve: SolutionCurve, point: CurvePoint
) -> tuple[SolutionCurve, CurvePoint] | None:
    """
    Return the motion that the rig performs in place of a solution, and its curve.

    It has the same impacts; along the branch a reversal, sticking or rest has come or gone.
    """
    along = curve.along
    orbit = performed(point.orbit, point.orbit.parameters)
    if orbit is None or orbit.distance(point.orbit) > 4.0 * along.largest_step:
        return None
    value = point.value
    fresh = SolutionCurve(orbit, along, value, curve.scale)
    again = fresh.at_value(fresh.start, value, point.tangent[-1])
    return (fresh, again) if again is not None and again.viable else None


def _beyond_meeting(
    curve: SolutionCurve, here: CurvePoint, there: CurvePoint
) -> tuple[SolutionCurve, CurvePoint] | None:
    """
    Return the motion beyond a place where two events meet, as ends of sticking, and its curve.

    The curve of the motions with both turns there. That of the motions without them does not: the
    rig performs those on one side, where the branch goes on or, at a nonsmooth fold, back.
    """
    met = _locate(Piece(curve, here, there), SpecialKind.FOLD)
    guess = None if met is None else curve.without_meeting(met.point)
    if met is None or guess is None:
        return None
    along, value = curve.along, met.special.value
    fresh = SolutionCurve(met.point.orbit, along, value, curve.scale, guess=guess)
    step = _BEYOND * float(np.linalg.norm(there.place - here.place))
    for way in (here.tangent[-1], there.tangent[-1]):
        again = fresh.at_value(fresh.start, value + math.copysign(step * curve.scale, way), way)
        if again is not None and again.viable:
            return fresh, again
    return None


def _comes_to(curve: SolutionCurve, here: CurvePoint, there: CurvePoint, step: float) -> bool:
    """Return whether a curve passes another point within a step, rather than next to it."""
    chord = there.place - here.place
    if np.linalg.norm(chord) >= step or float(there.tangent @ here.tangent) < SHARPEST_TURN:
        return False
    ahead = float(chord @ here.tangent)
    met = curve.correct(here.place + ahead * here.tangent, here.tangent)
    return met is not None and bool(np.linalg.norm(met.place - there.place) < _SAME_PLACE)


def _fresh_curve(
    curve: SolutionCurve, here: CurvePoint, there: CurvePoint
) -> tuple[SolutionCurve, CurvePoint] | None:
    """Return the motion with other nodes that the rig performs beyond a point, and its curve."""
    if _turns(here, there):
        return _beyond_meeting(curve, here, there)
    return _performed_beyond(curve, there)


def _grow(curve: SolutionCurve, point: CurvePoint) -> Branch:
    """Step along a branch until it leaves the bounds, ends or closes."""
    along = curve.along
    first, begun = point, curve
    points, pieces = [BranchPoint(first)], list[Piece]()
    here, step = point, _FIRST_STEP * along.largest_step
    ended = ''
    while not ended and len(points) < along.most_points:
        ahead, why, step = curve.steps_from(here, step, along.most_points - len(points))
        beyond = ahead.pop() if why == NOT_VIABLE else None
        for there in ahead:
            pieces.append(Piece(curve, here, there))
            points.append(BranchPoint(there))
            half = 0.5 * float(np.linalg.norm(there.place - here.place))
            here = there
            if curve is begun and len(points) > 4 and _comes_to(curve, here, first, half):
                ended = CLOSES
                points[-1], pieces[-1] = points[0], pieces[-1]._replace(end=first)
                break
        if ended:
            break
        if why in (LOW_END, HIGH_END):
            ended = f'{along.name} = {along.low if why == LOW_END else along.high:g}, {END}'
        elif why == LOST:
            ended = NONE_NEARBY
        elif beyond is not None:
            fresh = _fresh_curve(curve, here, beyond)
            if fresh is None:
                step *= 0.5
                ended = NONE_NEARBY if step < LEAST_STEP * along.largest_step else ''
                continue
            change = _difference(here.orbit, fresh[1].orbit)
            pieces.append(Piece(curve, here, beyond, change, _turns(here, fresh[1])))
            curve, here = fresh
            points.append(BranchPoint(here))
            step = _FIRST_STEP * along.largest_step
            if not along.low < here.value < along.high:
                end = along.low if here.value <= along.low else along.high
                ended = f'{along.name} = {end:g}, {END}'
    branch = Branch(
        name=along.name,
        points=tuple(points),
        special=(),
        ended=ended or f'{along.most_points}{POINTS}',
    )
    return _with_special_points(branch, pieces)


def _with_special_points(branch: Branch, between: Sequence[Piece]) -> Branch:
    """Return a branch with its special points, also among its points."""
    special: list[SpecialPoint] = []
    points, pieces = [*branch.points[:1]], []
    columns = list(_TESTS.values())
    ends = [[end.marks[columns] for end in (piece.start, piece.end)] for piece in between]
    changes = (np.prod(ends, axis=1) < 0.0).any(axis=-1) if between else ()
    for piece, after, change in zip(between, branch.points[1:], changes, strict=True):
        located_points = _special_points(piece) if change else []
        special += [located.special for located in located_points]
        inside = [(located.share, located.point) for located in located_points]
        for one, other in itertools.pairwise(located_points):
            # Between two of them the motion is of another kind than on both sides
            share = 0.5 * (one.share + other.share)
            inside.append((share, piece.at(share) or other.point))
        start = piece.start
        for _, point in sorted(inside, key=itemgetter(0)):
            if point.orbit not in (start.orbit, piece.end.orbit):
                points.append(BranchPoint(point))
                pieces.append(Piece(piece.curve, start, point))
                start = point
        points.append(after)
        # Beyond a change the rig has left the curve
        if not (piece.change and located_points):
            pieces.append(Piece(piece.curve, start, piece.end))
    return replace(branch, points=tuple(points), special=tuple(special), _pieces=tuple(pieces))


def follow(
    orbit: PeriodicOrbit,
    path: Path,
    low: float | str,
    high: float | str,
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
    low, high : float or str
        Range of the parameter, in SI units or with one, as ``'20 mm'``. The branch may turn
        within it.
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
    >>> from impact_damper_ros.orbits.search import find_orbits
    >>> from impact_damper_ros.parameters.rig_parameters import RigParameters
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2)).orbits[0]
    >>> branch = follow(orbit, 'gap', 20.0, 60.0)
    >>> [point.kind.value for point in branch.special]
    ['branch point', 'Neimark-Sacker']
    >>> round(branch.best('x_max').value, 3)
    58.128
    """
    low, high = range_of(path, low, high)
    along = Steps(path, low, high, start, largest_step, most_points)
    down, up = (_one_way(orbit, along, upwards) for upwards in (False, True))
    if not down.points or down.ended == CLOSES:
        return down if down.points else up
    return down.reversed().extended(up)


def _one_way(orbit: PeriodicOrbit, along: Steps, upwards: bool) -> Branch:
    """Follow a motion while the parameter rises, or falls, at first."""
    value = along.value(orbit.parameters)
    scale = max(abs(value), _LEAST_SCALE * (along.high - along.low))
    if value == 0.0:
        scale = max(abs(along.low), abs(along.high))
    curve = SolutionCurve(orbit, along, value, scale)
    point = curve.at_value(curve.start, value, 1.0 if upwards else -1.0)
    if point is None:
        return Branch(name=along.name, points=(), special=(), ended='no motion to begin with')
    return _grow(curve, point)


def switch_branch(
    special: SpecialPoint,
    path: Path,
    low: float | str,
    high: float | str,
    *,
    mirrored: bool = False,
    largest_step: float = 0.05,
    most_points: int = 400,
) -> Branch:
    """
    Follow the branch that leaves another one at a period doubling or a branch point.

    Parameters
    ----------
    special : SpecialPoint
        Where it leaves.
    path, low, high, largest_step, most_points
        As of `follow`.
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
    OrbitError
        If it is outside the range, or on a branch along another parameter.
    """
    if special.kind not in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
        raise ValueError(f'no branch leaves at a {special.kind.value}')
    low, high = range_of(path, low, high)
    along = Steps(path, low, high, special.value, largest_step, most_points)
    value = along.value(special.orbit.parameters)
    if value != special.value:
        raise OrbitError(
            f'the point is at {special.value:.9g} of its own branch, where {along.name} is '
            f'{value:.9g}: give the parameter of that branch'
        )
    times = 2 if special.kind is SpecialKind.PERIOD_DOUBLING else 1
    scale = abs(special.value) or 1.0
    curve = SolutionCurve(special.orbit, along, special.value, scale, times)
    direction = curve.null_direction()
    direction = -direction if mirrored else direction
    point = curve.correct(curve.start + _FIRST_STEP * largest_step * direction, direction)
    if point is None:
        return Branch(name=along.name, points=(), special=(), ended='no branch found')
    began = f'{special.kind.value} at {along.name} = {special.value:.9g}'
    return replace(_grow(curve, point), began=began)
