# SPDX-License-Identifier: Apache-2.0
"""A branch of periodic motions: its points, its motions at any value, and its best one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

from .orbit import PeriodicOrbit
from .search import SAME
from .solution_curve import Piece


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
        At a grazing, and a fold where events meet, the change just beyond it; else empty.
    """

    kind: SpecialKind
    value: float
    orbit: PeriodicOrbit
    bracket: tuple[float, float]
    converged: bool
    reason: str = ''


class Limit(Enum):
    """What limits the best point of a branch."""

    MINIMUM = 'interior minimum'
    STABILITY = 'edge of stability'
    VIABILITY = 'edge of viability'
    FOLD = 'fold: the motion ends'
    ENDS = 'the branch ends'
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
    _pieces: tuple[Piece, ...] = field(default=(), repr=False, compare=False)

    @property
    def values(self) -> tuple[float, ...]:
        """The parameter at the points."""
        return tuple(point.value for point in self.points)

    @cached_property
    def orbits(self) -> tuple[PeriodicOrbit, ...]:
        """The motions at the points."""
        return tuple(point.orbit for point in self.points)

    def parts(self) -> Iterator[tuple[str, slice]]:
        """
        Yield the parts of the branch between changes of stability or viability.

        Yields
        ------
        status : str
            'stable', 'neutral', 'unstable', or 'not viable'.
        part : slice
            The points of it; each part begins with the last point of the one before.
        """
        special = {id(point.orbit) for point in self.special}

        def status(first: int) -> str:
            both = self.orbits[first : first + 2]
            # A special point belongs to both sides
            known = [orbit for orbit in both if id(orbit) not in special] or both
            if not all(orbit.viable for orbit in known):
                return 'not viable'
            return max(known, key=lambda orbit: abs(orbit.multipliers[0])).stability

        for found, steps in groupby(range(len(self.points) - 1), key=status):
            first, *others = steps
            yield found, slice(first, first + len(others) + 2)

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
                low, high = sorted(piece.values)
                inside = low < high and low <= value <= high
                point = piece.at_value(value) if inside else None
                # Where two pieces meet, both have the motion
                if point and min(map(point.orbit.distance, here), default=1.0) > SAME:
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

    def reversed(self) -> Branch:
        """Return the branch from its last point to its first."""
        back = (Piece(piece.curve, piece.end, piece.start) for piece in self._pieces[::-1])
        return replace(
            self,
            points=self.points[::-1],
            special=self.special[::-1],
            began=self.ended,
            ended=self.began,
            _pieces=tuple(back),
        )

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
        limit = Limit.RANGE if ended.endswith((END, POINTS)) else Limit.ENDS
        return BestPoint(*point, limit, ended)


#: Why a branch ends: at the end of its range, with the points asked for, and elsewhere.
END, POINTS = 'the end of the range', ' points'
NONE_NEARBY = 'no motion nearby: the corrector fails'
CLOSES = 'the branch closes'
