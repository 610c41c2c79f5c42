"""
Special points of a branch: where test functions change their sign.

- fold: the parameter's share of the branch's direction;
- period doubling: the product of all (1 + multiplier), a multiplier passing -1;
- Neimark-Sacker: the product of all (1 - product of two multipliers), a pair on the unit circle;
- branch point: the product of all (1 - multiplier) where the parameter does not turn, such as the
  loss of symmetry;
- grazing: the motion ceases to be viable, or to have the same impacts, reversals and rests.

Where an impact loses its speed a multiplier has a pole. The products change sign there too; what
is found there is recognised by its multipliers and left out.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from .curve import Curve, Point
from .orbit import PeriodicOrbit

__all__ = ['SpecialKind', 'SpecialPoint', 'special_points']

_LOCATIONS = 60
_LOCATED = 1e-9
#: How far a multiplier may be from where it should be at a special point, and at a guess of one.
_NEAR = 1e-3
_GUESSED = 0.2


class SpecialKind(Enum):
    """What happens at a special point; the value says it in words."""

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
        Whether it is located to round-off of the method; otherwise it is a guess.
    reason : str
        At a grazing, what is different just beyond; else empty.
    """

    kind: SpecialKind
    value: float
    orbit: PeriodicOrbit
    bracket: tuple[float, float]
    converged: bool
    reason: str = ''


_Test = Callable[[Point], float]


def _real_product(factors: list[complex]) -> float:
    product = complex(1.0)
    for factor in factors:
        product *= factor
    return product.real


def _fold(point: Point) -> float:
    return float(point.tangent[-1])


def _doubling(point: Point) -> float:
    return _real_product([1.0 + m for m in point.orbit.multipliers])


def _branching(point: Point) -> float:
    return _real_product([1.0 - m for m in point.orbit.multipliers])


def _torus(point: Point) -> float:
    pairs = itertools.combinations(point.orbit.multipliers, 2)
    return _real_product([1.0 - a * b for a, b in pairs])


def _events(orbit: PeriodicOrbit) -> Counter[str]:
    """Count what happens in a period, in words."""
    words: Counter[str] = Counter(f'impact on stop {stop}' for stop in orbit.stops)
    words.update(
        node.kind.name.lower() + (f' on stop {node.stop}' if node.stop else '')
        for node in orbit.nodes
    )
    return words


def _likeness(start: Point) -> _Test:
    """Return a test of whether a motion is of the same kind as that at the start."""
    kind = (start.orbit.viable, _events(start.orbit))

    def alike(point: Point) -> float:
        return 1.0 if (point.orbit.viable, _events(point.orbit)) == kind else -1.0

    return alike


def _difference(here: PeriodicOrbit, there: PeriodicOrbit) -> str:
    """Say what is different beyond a grazing."""
    if there.reason:
        return there.reason
    new, old = _events(there), _events(here)
    gained = [f'{n} more {what}' for what, n in (new - old).items()]
    lost = [f'{n} less {what}' for what, n in (old - new).items()]
    return ', '.join(gained + lost)


def _genuine(kind: SpecialKind, orbit: PeriodicOrbit, near: float) -> bool:
    """Return whether the multipliers at a located point are where they should be."""
    values = orbit.multipliers
    if kind is SpecialKind.PERIOD_DOUBLING:
        return min(abs(m + 1.0) for m in values) < near
    if kind is SpecialKind.BRANCH_POINT:
        return min(abs(m - 1.0) for m in values) < near
    if kind is SpecialKind.NEIMARK_SACKER:
        return any(abs(abs(m) - 1.0) < near and m.imag != 0.0 for m in values)
    return True


def _locate(
    curve: Curve, start: Point, end: Point, step: float, kind: SpecialKind, test: _Test
) -> SpecialPoint | None:
    """Find where a test function changes sign between two points of a branch."""
    near, far = (0.0, start), (step, end)
    value_near, value_far = test(start), test(end)
    complete = True
    for count in range(_LOCATIONS):
        if far[0] - near[0] <= _LOCATED * step:
            break
        share = 0.5
        if kind is not SpecialKind.GRAZING and count % 3 != 2:
            share = min(0.999, max(0.001, value_near / (value_near - value_far)))
        there = near[0] + share * (far[0] - near[0])
        middle = curve.ahead(start, there)
        if middle is None:
            complete = False
            break
        value = test(middle)
        if (value > 0.0) == (value_near > 0.0):
            near, value_near = (there, middle), value
        else:
            far, value_far = (there, middle), value
    best, other = (near[1], far[1]) if abs(value_near) <= abs(value_far) else (far[1], near[1])
    reason = ''
    if kind is SpecialKind.GRAZING:
        best, other = (near[1], far[1]) if near[1].orbit.viable else (far[1], near[1])
        reason = _difference(best.orbit, other.orbit)
    if not _genuine(kind, best.orbit, _NEAR if complete else _GUESSED):
        return None
    return SpecialPoint(
        kind=kind,
        value=curve.value(best.place),
        orbit=best.orbit,
        bracket=(curve.value(near[1].place), curve.value(far[1].place)),
        converged=complete and far[0] - near[0] <= 1.01 * _LOCATED * step,
        reason=reason,
    )


def special_points(curve: Curve, start: Point, end: Point, step: float) -> list[SpecialPoint]:
    """
    Locate what happens between two neighbouring points of a branch.

    Parameters
    ----------
    curve : Curve
        The branch.
    start, end : Point
        The points.
    step : float
        The arclength from the one to the other along the start's tangent.

    Returns
    -------
    list of SpecialPoint
        In the order along the branch.
    """
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
        special = _locate(curve, start, end, step, kind, test)
        if special is not None:
            found.append(special)
    first = curve.value(start.place)
    return sorted(found, key=lambda special: abs(special.value - first))
