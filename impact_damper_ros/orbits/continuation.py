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
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from impact_damper_ros.parameters.parameter_spec import check_kind

from .arclength import (
    BETWEEN,
    BEYOND,
    BRANCHING,
    DOUBLING,
    FOLD,
    HIGH_END,
    KIND,
    LEAST_STEP,
    LOST,
    LOW_END,
    NOT_VIABLE,
    ORDINARY,
    SHARPEST_TURN,
    TORUS,
    VIABLE,
)
from .arguments import OrbitError
from .branch import CLOSES, END, NONE_NEARBY, POINTS, Branch, SpecialKind, SpecialPoint
from .orbit import PeriodicOrbit
from .solution_curve import BranchPoint, SolutionCurve
from .solved_orbits import performed_near
from .varied_parameter import Path, Steps, range_of

#: Largest error of a multiplier at a special point, and at a guess of one.
_NEAR = 1e-3
_GUESSED = 0.2
#: A larger multiplier is at a pole.
_POLE = 1e10


def _genuine(special: SpecialPoint) -> bool:
    """Return whether the multipliers at a located point are those of its kind."""
    values, kind = special.point.multipliers, special.kind
    near = _NEAR if special.converged else _GUESSED
    if kind not in (SpecialKind.FOLD, SpecialKind.GRAZING) and abs(values[0]) > _POLE:
        # Round-off of the largest multiplier hides the others.
        return False
    if kind is SpecialKind.PERIOD_DOUBLING:
        return min(abs(m + 1.0) for m in values) < near
    if kind is SpecialKind.BRANCH_POINT:
        return min(abs(m - 1.0) for m in values) < near
    if kind is SpecialKind.NEIMARK_SACKER:
        return any(abs(abs(m) - 1.0) < near and m.imag != 0.0 for m in values)
    return True


#: Kind of special point at a zero of a test function, by its place among the notes of a point.
_KINDS = {
    FOLD: SpecialKind.FOLD,
    DOUBLING: SpecialKind.PERIOD_DOUBLING,
    TORUS: SpecialKind.NEIMARK_SACKER,
    BRANCHING: SpecialKind.BRANCH_POINT,
    VIABLE: SpecialKind.GRAZING,
}


def _turns(start: BranchPoint, end: BranchPoint) -> bool:
    """Return whether the parameter turns between two points."""
    return bool(start.tangent[-1] * end.tangent[-1] < 0.0)


def _with_special(
    points: Sequence[BranchPoint], change: tuple[BranchPoint, BranchPoint] | None = None
) -> tuple[list[BranchPoint], list[SpecialPoint]]:
    """
    Return the points of a curve that are part of the branch, and the special points among them.

    There is no special point where a test function changes sign at a pole, or where a rig that
    leaves the curve no longer performs the motion.
    """
    kept: list[BranchPoint] = []
    special: list[SpecialPoint] = []
    for k, point in enumerate(points):
        kind = int(point.row[KIND])
        if kind in _KINDS:
            beyond = points[k + 1] if kind == VIABLE else None
            found = SpecialPoint(_KINDS[kind], point, beyond, change)
            turns = change is not None and _turns(*change)
            if turns and kind == VIABLE:
                found.kind = SpecialKind.FOLD
            if not _genuine(found) or (change is not None and not point.viable):
                continue
            if turns and kind == FOLD:
                continue
            special.append(found)
        if kind == BETWEEN and not (kept and special and kept[-1] is special[-1].point):
            continue
        if kind != BEYOND:
            kept.append(point)
    return kept, special


#: The first step, as a share of the largest one.
_FIRST_STEP = 0.1
#: Fewest steps in which a branch closes, and distance within which it has come back.
_FEWEST = 4
_SAME_PLACE = 1e-6
#: Least scale of a parameter that begins near zero, as a share of its range.
_LEAST_SCALE = 0.2
#: Distance from a meeting of two events at which the motion without them is sought, in steps.
_BEYOND = 1e-6


def _performed_beyond(
    curve: SolutionCurve, point: BranchPoint
) -> tuple[SolutionCurve, BranchPoint] | None:
    """
    Return the motion that the rig performs in place of a solution, and its curve.

    The motion has the same impacts; along the branch a reversal, sticking or rest has come or
    gone.
    """
    along = curve.along
    there = performed_near(point.orbit, point.orbit.parameters)
    if there is None or there[0].distance(point.orbit) > 4.0 * along.largest_step:
        return None
    value = point.value
    fresh = SolutionCurve(there[0], along, value, curve.scale, guess=there[1])
    again = fresh.at_value(fresh.start, value, point.tangent[-1])
    return (fresh, again) if again is not None and again.viable else None


def _beyond_meeting(
    curve: SolutionCurve, here: BranchPoint, there: BranchPoint
) -> tuple[SolutionCurve, BranchPoint] | None:
    """
    Return the motion beyond a place where two events meet, as ends of sticking, and its curve.

    The curve of the motions with both events turns there. The curve of the motions without them
    does not: the rig performs these on one side, where the branch goes on or, at a nonsmooth fold,
    back.
    """
    between = curve.between(here, there)
    met = next((point for point in between if point.row[KIND] == FOLD), None)
    guess = None if met is None else curve.without_meeting(met)
    if met is None or guess is None:
        return None
    along, value = curve.along, met.value
    fresh = SolutionCurve(met.orbit, along, value, curve.scale, guess=guess)
    step = _BEYOND * float(np.linalg.norm(there.place - here.place))
    for way in (here.tangent[-1], there.tangent[-1]):
        again = fresh.at_value(fresh.start, value + math.copysign(step * curve.scale, way), way)
        if again is not None and again.viable:
            return fresh, again
    return None


def _comes_to(here: BranchPoint, there: BranchPoint) -> bool:
    """Return whether the curve of a point reaches another one."""
    if float(there.tangent @ here.tangent) < SHARPEST_TURN:
        return False
    ahead = float((there.place - here.place) @ here.tangent)
    met = here.curve.correct(here.place + ahead * here.tangent, here.tangent)
    return met is not None and bool(np.linalg.norm(met.place - there.place) < _SAME_PLACE)


def _closes(points: Sequence[BranchPoint], since: int) -> int | None:
    """Return which of the points of a curve from a place on comes back to the first one."""
    ordinary = [k for k, point in enumerate(points) if point.row[KIND] == ORDINARY]
    places = np.array([points[k].place for k in ordinary])
    half = 0.5 * np.linalg.norm(np.diff(places, axis=0), axis=1)
    near = np.linalg.norm(places[1:] - places[0], axis=1) < half
    for number in np.flatnonzero(near) + 1:
        k = ordinary[number]
        if k >= since and number >= _FEWEST and _comes_to(points[k], points[0]):
            return k
    return None


def _grow(curve: SolutionCurve, point: BranchPoint) -> Branch:
    """Step along a branch until it leaves the bounds, ends or closes."""
    along = curve.along
    polylines, special = [[point]], list[SpecialPoint]()
    here, step = point, _FIRST_STEP * along.largest_step
    count, ended = 1, ''
    while not ended and count < along.most_points:
        ahead, why, step = curve.steps_from(here, step, along.most_points - count)
        beyond = ahead.pop() if why == NOT_VIABLE else None
        here = ahead[-1] if ahead else here
        count += sum(one.row[KIND] == ORDINARY for one in ahead)
        polyline, since = polylines[-1], len(polylines[-1])
        kept, located = _with_special(ahead)
        polyline += kept
        closes = _closes(polyline, since) if len(polylines) == 1 else None
        if closes is not None:
            ended = CLOSES
            polyline[closes:] = [point]
            located = [one for one in located if one.point in polyline]
        special += located
        if ended:
            break
        if why in (LOW_END, HIGH_END):
            ended = f'{along.name} = {along.low if why == LOW_END else along.high:g}, {END}'
        elif why == LOST:
            ended = NONE_NEARBY
        elif beyond is not None:
            fresh = (
                _beyond_meeting(curve, here, beyond)
                if _turns(here, beyond)
                else _performed_beyond(curve, beyond)
            )
            if fresh is None:
                step *= 0.5
                ended = NONE_NEARBY if step < LEAST_STEP * along.largest_step else ''
                continue
            kept, located = _with_special(curve.between(here, beyond), (here, fresh[1]))
            polyline += kept
            special += located
            curve, here = fresh
            polylines.append([here])
            count += 1
            step = _FIRST_STEP * along.largest_step
            if not along.low < here.value < along.high:
                end = along.low if here.value <= along.low else along.high
                ended = f'{along.name} = {end:g}, {END}'
    return Branch(
        name=along.name,
        points=tuple(itertools.chain.from_iterable(polylines)),
        special=tuple(special),
        ended=ended or f'{along.most_points}{POINTS}',
        _polylines=tuple(map(tuple, polylines)),
    )


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
        The motions, from below the first one on, and the special points among them.

    Raises
    ------
    TypeError
        If the motion is no `PeriodicOrbit`.
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
    check_kind(
        'orbit',
        orbit,
        PeriodicOrbit,
        'a PeriodicOrbit, such as find_orbits(parameters, (1, 2))[0]',
    )
    low, high = range_of(path, low, high)
    along = Steps(path, low, high, start, largest_step, most_points)
    value = along.value(orbit.parameters)
    scale = max(abs(value), _LEAST_SCALE * (along.high - along.low))
    if value == 0.0:
        scale = max(abs(along.low), abs(along.high))
    curve = SolutionCurve(orbit, along, value, scale)
    points = [curve.at_value(curve.start, value, way) for way in (-1.0, 1.0)]
    down, up = (None if point is None else _grow(curve, point) for point in points)
    if down is None or down.ended == CLOSES:
        return down or up or Branch(along.name, (), (), 'no motion to begin with')
    return down if up is None else down.reverse().extend(up)


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
        The point where the branch leaves.
    path, low, high, largest_step, most_points
        As in `follow`.
    mirrored : bool, optional
        Whether to begin in the opposite direction.

    Returns
    -------
    Branch
        The motions that branch off: of twice the period at a period doubling.

    Raises
    ------
    TypeError
        If `special` is no `SpecialPoint`.
    ValueError
        If the point is of another kind.
    OrbitError
        If the point is outside the range, or on a branch along another parameter.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> special = follow(orbit, 'gap', 30.0, 40.0).special[0]
    >>> switch_branch(special, 'gap', 33.0, 40.0).ended
    'gap = 33, the end of the range'
    """
    check_kind('special', special, SpecialPoint, 'a SpecialPoint, one of branch.special')
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
        return Branch(along.name, (), (), 'no branch found')
    began = f'{special.kind.value} at {along.name} = {special.value:.9g}'
    return replace(_grow(curve, point), began=began)
