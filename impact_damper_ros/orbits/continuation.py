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
from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

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

_Test = Callable[[CurvePoint], float]


def _fold(point: CurvePoint) -> float:
    return float(point.tangent[-1])


def _doubling(point: CurvePoint) -> float:
    return math.prod(1.0 + m for m in point.orbit.multipliers).real


def _branching(point: CurvePoint) -> float:
    return math.prod(1.0 - m for m in point.orbit.multipliers).real


def _torus(point: CurvePoint) -> float:
    pairs = itertools.combinations(point.orbit.multipliers, 2)
    return math.prod(1.0 - a * b for a, b in pairs).real


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


def _locate(piece: Piece, kind: SpecialKind, test: _Test) -> _Located | None:
    """Find where a test function changes sign between two points of a branch."""
    from scipy.optimize import brentq

    near, far = (0.0, piece.start), (1.0, piece.end)
    side = test(piece.start)

    def value_at(share: float) -> float:
        nonlocal near, far
        middle = piece.at(share)
        if middle is None:
            raise ArithmeticError('the corrector fails')
        value = test(middle)
        if (value > 0.0) == (side > 0.0):
            near = max(near, (share, middle), key=lambda pair: pair[0])
        else:
            far = min(far, (share, middle), key=lambda pair: pair[0])
        return value

    try:
        brentq(value_at, 0.0, 1.0, xtol=LOCATED)
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
        replaced = piece.curve.performed(piece.curve.value(other[1].place))
        beyond = performed(there, there.parameters) if replaced else None
        reason = _difference(best[1].orbit, beyond or there) or piece.change
    orbit = best[1].orbit
    if not _genuine(kind, orbit, _NEAR if complete else _GUESSED):
        return None
    special = SpecialPoint(
        kind=kind,
        value=piece.curve.value(best[1].place),
        orbit=orbit,
        bracket=(piece.curve.value(near[1].place), piece.curve.value(far[1].place)),
        converged=complete,
        reason=reason,
    )
    return _Located(*best, special)


def _special_points(piece: Piece) -> list[_Located]:
    """Locate the special points between two neighbouring points of a branch, in order."""
    start, end = piece.start, piece.end
    turns = _fold(start) * _fold(end) < 0.0
    tests: tuple[tuple[SpecialKind, _Test], ...] = (
        (SpecialKind.FOLD, _fold),
        (SpecialKind.PERIOD_DOUBLING, _doubling),
        (SpecialKind.NEIMARK_SACKER, _torus),
        (SpecialKind.BRANCH_POINT, _branching),
        (SpecialKind.GRAZING, _likeness(start)),
    )
    located_points = []
    for kind, test in tests:
        if test(start) * test(end) >= 0.0 or (kind is SpecialKind.BRANCH_POINT and turns):
            continue
        located = _locate(piece, kind, test)
        if located is None or (piece.change and not located.special.orbit.viable):
            continue
        if kind is SpecialKind.GRAZING and piece.turns:
            located = located._replace(special=replace(located.special, kind=SpecialKind.FOLD))
        located_points.append(located)
    return sorted(located_points, key=lambda located: located.share)


_SHARPEST_TURN = 0.95
_GROWTH = 1.4
#: The first step, as a share of the largest one.
_FIRST_STEP = 0.1
_LEAST_STEP = 1e-7
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
    value = curve.value(point.place)
    fresh = SolutionCurve(orbit, along, value, curve.scale)
    again = fresh.at_value(fresh.start, value, point.tangent[-1])
    return (fresh, again) if again is not None and again.orbit.viable else None


def _beyond_meeting(
    curve: SolutionCurve, here: CurvePoint, there: CurvePoint
) -> tuple[SolutionCurve, CurvePoint] | None:
    """
    Return the motion beyond a place where two events meet, as ends of sticking, and its curve.

    The curve of the motions with both turns there. That of the motions without them does not: the
    rig performs those on one side, where the branch goes on or, at a nonsmooth fold, back.
    """
    met = _locate(Piece(curve, here, there), SpecialKind.FOLD, _fold)
    guess = None if met is None else curve.without_meeting(met.point)
    if met is None or guess is None:
        return None
    along, value = curve.along, met.special.value
    fresh = SolutionCurve(met.point.orbit, along, value, curve.scale, guess=guess)
    step = _BEYOND * float(np.linalg.norm(there.place - here.place))
    for way in (here.tangent[-1], there.tangent[-1]):
        again = fresh.at_value(fresh.start, value + math.copysign(step * curve.scale, way), way)
        if again is not None and again.orbit.viable:
            return fresh, again
    return None


def _edge(curve: SolutionCurve, here: CurvePoint, step: float) -> tuple[float, CurvePoint] | None:
    """Return the bound that the next step would cross, if any, and the point there."""
    along = curve.along
    ahead = curve.value(here.place + step * here.tangent)
    if along.holds(ahead):
        return None
    bound = along.low if ahead < along.low else along.high
    share = (bound / curve.scale - here.place[-1]) / here.tangent[-1]
    last = curve.at_value(here.place + share * here.tangent, bound, here.tangent[-1])
    if last is None or float(last.tangent @ here.tangent) < _SHARPEST_TURN:
        return None
    return bound, last


def _comes_to(curve: SolutionCurve, here: CurvePoint, there: CurvePoint, step: float) -> bool:
    """Return whether a curve passes another point within a step, rather than next to it."""
    chord = there.place - here.place
    if np.linalg.norm(chord) >= step or float(there.tangent @ here.tangent) < _SHARPEST_TURN:
        return False
    ahead = float(chord @ here.tangent)
    met = curve.correct(here.place + ahead * here.tangent, here.tangent)
    return met is not None and bool(np.linalg.norm(met.place - there.place) < _SAME_PLACE)


def _grow(curve: SolutionCurve, point: CurvePoint) -> Branch:
    """Step along a branch until it leaves the bounds, ends or closes."""
    along = curve.along
    points = [BranchPoint(curve.value(point.place), point.orbit)]
    pieces: list[Piece] = []
    here, step = point, _FIRST_STEP * along.largest_step
    least = _LEAST_STEP * along.largest_step
    ended = f'{along.most_points}{POINTS}'
    while len(points) < along.most_points:
        edge = _edge(curve, here, step)
        ahead = here.place + step * here.tangent
        there = edge[1] if edge else curve.correct(ahead, here.tangent)
        fresh, lost = None, False
        if (
            there is not None
            and not there.orbit.viable
            and curve.performed(curve.value(there.place))
        ):
            if _fold(here) * _fold(there) < 0.0:
                fresh = _beyond_meeting(curve, here, there)
            else:
                fresh = _performed_beyond(curve, there)
            lost = fresh is None
        if (
            there is None
            or lost
            or float(there.tangent @ here.tangent) < _SHARPEST_TURN
            or (edge is None and not along.holds(curve.value(there.place)))
        ):
            step *= 0.5
            if step >= least:
                continue
            ended = NONE_NEARBY
            break
        if edge is not None:
            ended = f'{along.name} = {edge[0]:g}, {END}'
            step = float((there.place - here.place) @ here.tangent)
            if step < least:
                # It begins there
                break
        if fresh is None:
            pieces.append(Piece(curve, here, there))
        else:
            change = _difference(here.orbit, fresh[1].orbit)
            turns = _fold(here) * _fold(fresh[1]) < 0.0
            pieces.append(Piece(curve, here, there, change, turns))
            curve, there = fresh
            step = _FIRST_STEP * along.largest_step
        here = there
        points.append(BranchPoint(curve.value(here.place), here.orbit))
        if edge is not None:
            break
        round_again = len(points) > 4 and all(piece.curve is curve for piece in pieces)
        if round_again and _comes_to(curve, here, point, 0.5 * step):
            ended = CLOSES
            points[-1], pieces[-1] = points[0], pieces[-1]._replace(end=point)
            break
        step = min(along.largest_step, _GROWTH * step)
    branch = Branch(name=along.name, points=tuple(points), special=(), ended=ended)
    return _with_special_points(branch, pieces)


def _with_special_points(branch: Branch, between: Sequence[Piece]) -> Branch:
    """Return a branch with its special points, also among its points."""
    special: list[SpecialPoint] = []
    points, pieces = [*branch.points[:1]], []
    for piece, after in zip(between, branch.points[1:], strict=True):
        located_points = _special_points(piece)
        special += [located.special for located in located_points]
        inside = [(located.share, located.point) for located in located_points]
        for one, other in itertools.pairwise(located_points):
            # Between two of them the motion is of another kind than on both sides
            share = 0.5 * (one.share + other.share)
            inside.append((share, piece.at(share) or other.point))
        start = piece.start
        for _, point in sorted(inside, key=itemgetter(0)):
            if point.orbit not in (start.orbit, piece.end.orbit):
                points.append(BranchPoint(piece.curve.value(point.place), point.orbit))
                pieces.append(Piece(piece.curve, start, point))
                start = point
        points.append(after)
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
    by_unknowns = curve.residual(curve.start[:-1], special.value)[1]
    direction = np.append(np.linalg.svd(by_unknowns)[2][-1], 0.0)
    direction = -direction if mirrored else direction
    point = curve.correct(curve.start + _FIRST_STEP * largest_step * direction, direction)
    if point is None:
        return Branch(name=along.name, points=(), special=(), ended='no branch found')
    began = f'{special.kind.value} at {along.name} = {special.value:.9g}'
    return replace(_grow(curve, point), began=began)
