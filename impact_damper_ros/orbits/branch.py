# SPDX-License-Identifier: Apache-2.0
"""A branch of periodic motions: its points, its motions at any value, and its best motion."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import groupby, pairwise
from operator import attrgetter
from typing import Any, NamedTuple, overload

from impact_damper_ros.parameters.quoting import plural, quote, similar_names

from .arclength import CONVERGED, FARTHER, NEARER
from .orbit import PeriodicOrbit, stability_of
from .search import SAME
from .solution_curve import BranchPoint as BranchPoint, Piece
from .solved_orbits import performed_near
from .varied_parameter import number_of


class SpecialKind(Enum):
    """
    Kind of a special point.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits, follow
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> special = follow(orbit, 'gap', 30.0, 60.0).special
    >>> [point.kind is SpecialKind.BRANCH_POINT for point in special]
    [True, False]
    """

    FOLD = 'fold'
    PERIOD_DOUBLING = 'period doubling'
    NEIMARK_SACKER = 'Neimark-Sacker'
    BRANCH_POINT = 'branch point'
    GRAZING = 'grazing'


class Span(NamedTuple):
    """
    The range of a parameter within which a motion is kept.

    Attributes
    ----------
    low, high : float
        The least and the largest value, SI.
    low_reason, high_reason : str
        What happens at these values; empty where the branch was not followed further.
    """

    low: float
    high: float
    low_reason: str = ''
    high_reason: str = ''

    def over(self, scale: float) -> Span:
        """Return the same range over a scale."""
        return Span(self.low / scale, self.high / scale, self.low_reason, self.high_reason)


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
        The parameter on either side of the point; at a fold both are on the same side of its
        value.
    converged : bool
        Whether the point is located to the tolerance; otherwise it is an estimate.
    reason : str
        At a grazing, and a fold where events meet, the change just beyond it; else empty.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits, follow
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> special = follow(orbit, 'gap', 30.0, 40.0).special[0]
    >>> special.kind.value, round(special.value, 4)
    ('branch point', 35.7269)
    """

    def __init__(
        self,
        kind: SpecialKind,
        point: BranchPoint,
        beyond: BranchPoint | None = None,
        change: tuple[BranchPoint, BranchPoint] | None = None,
    ) -> None:
        self.kind, self.point = kind, point
        self._beyond, self._change = beyond, change
        self.value = point.value
        scale = point.curve.scale
        self.bracket = float(point.row[NEARER] * scale), float(point.row[FARTHER] * scale)
        self.converged = bool(point.row[CONVERGED] > 0.0)

    def __repr__(self) -> str:
        """Return the point in a line."""
        return f'SpecialPoint(kind={self.kind}, value={self.value!r}, orbit={self.orbit!r})'

    @property
    def orbit(self) -> PeriodicOrbit:
        """The motion there."""
        return self.point.orbit

    @cached_property
    def reason(self) -> str:
        """The change just beyond the point."""
        if self._beyond is None:
            return ''
        there = self._beyond.orbit
        if self.point.curve.is_performed(self._beyond.value):
            replaced = performed_near(there, there.parameters)
            there = there if replaced is None else replaced[0]
        change = difference(self.orbit, there)
        if not change and self._change is not None:
            change = difference(*(point.orbit for point in self._change))
        return change


def _events(orbit: PeriodicOrbit) -> Counter[str]:
    """Describe the events of a period."""
    words: Counter[str] = Counter(f'impact on stop {stop}' for stop in orbit.stops)
    words.update(
        node.kind.name.lower() + (f' on stop {node.stop}' if node.stop else '')
        for node in sorted(orbit.events)
    )
    return words


def difference(here: PeriodicOrbit, there: PeriodicOrbit) -> str:
    """Describe the difference beyond a grazing."""
    if there.reason:
        return there.reason
    new, old = _events(there), _events(here)
    gained = [f'{n} more {what}' for what, n in (new - old).items()]
    lost = [f'{n} less {what}' for what, n in (old - new).items()]
    return ', '.join(gained + lost)


#: Numbers by which a motion may be the best.
_MEASURES = ('x_max', 'x_max_ratio', 'impacts', 'cycles', 'period', 'residual')


def _measure(measure: str | Callable[[PeriodicOrbit], float]) -> Callable[[BranchPoint], float]:
    """Return a function that measures a point; raise ValueError for an unknown name."""
    if not isinstance(measure, str):
        return lambda point: measure(point.orbit)
    if measure not in _MEASURES:
        close = similar_names(measure, _MEASURES)
        hint = f'did you mean {close}? There are {", ".join(_MEASURES)}' if close else ''
        hint = hint or f'give one of {", ".join(_MEASURES)}'
        raise ValueError(f'measure is {quote(measure)}: {hint}, or a function of the motion')
    return attrgetter(measure if measure == 'x_max' else f'orbit.{measure}')


#: Error of the place of the best motion, as a share of a step of the branch.
_NARROW = 1e-4
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
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

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits, follow
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> branch = follow(orbit, 'gap', 30.0, 40.0)
    >>> branch.name, branch.special[0].kind.value, round(branch.special[0].value, 3)
    ('gap', 'branch point', 35.727)
    """

    name: str
    points: tuple[BranchPoint, ...]
    special: tuple[SpecialPoint, ...]
    ended: str
    began: str = ''
    #: Consecutive points of one curve; where two curves meet, both have the point.
    _polylines: tuple[tuple[BranchPoint, ...], ...] = field(default=(), repr=False, compare=False)

    @property
    def _pieces(self) -> Iterator[Piece]:
        """The parts between neighbouring points of one curve."""
        for polyline in self._polylines:
            for start, end in pairwise(polyline):
                yield Piece(start.curve, start, end)

    def __repr__(self) -> str:
        """Return the branch in a line."""
        if not self.points:
            return f'<Branch: no motions, {self.name} varied; {self.ended}>'
        low, high = min(self.values), max(self.values)
        special = ', '.join(f'{p.kind.value} at {p.value:.6g}' for p in self.special[:4])
        more = f' and {len(self.special) - 4} more' if len(self.special) > 4 else ''
        return (
            f'<Branch: {plural(len(self.points), "motion")}, {self.name} from {low:.6g} to '
            f'{high:.6g}; {special or "no special points"}{more}>'
        )

    @cached_property
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
        special = {id(special.point) for special in self.special}

        def status_of(first: int) -> str:
            both = self.points[first : first + 2]
            # A special point belongs to both sides..
            ordinary = [point for point in both if id(point) not in special] or both
            if not all(point.viable for point in ordinary):
                return 'not viable'
            return stability_of(max(point.modulus for point in ordinary))

        for status, steps in groupby(range(len(self.points) - 1), key=status_of):
            first, *others = steps
            yield status, slice(first, first + len(others) + 2)

    @overload
    def at(  # type: ignore[overload-overlap]
        self, values: float | str
    ) -> tuple[PeriodicOrbit, ...]: ...

    @overload
    def at(self, values: Sequence[float | str]) -> list[tuple[PeriodicOrbit, ...]]: ...

    def at(
        self, values: float | str | Sequence[float | str]
    ) -> tuple[PeriodicOrbit, ...] | list[tuple[PeriodicOrbit, ...]]:
        """
        Return the motions of the branch at a value of the parameter, or at several.

        Parameters
        ----------
        values : float or str, or sequence of them
            The values, in SI units or with one, as ``'20 mm'``.

        Returns
        -------
        tuple of PeriodicOrbit, or list of them
            For each value the motions there, in order along the branch: none where it does not
            reach, several where it turns.

        Examples
        --------
        >>> from impact_damper_ros import RigParameters, find_orbits, follow
        >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
        >>> (there,) = follow(orbit, 'gap', 30.0, 40.0).at(37.0)
        >>> round(there.x_max, 4) == round(orbit.x_max, 4)
        True
        """
        if isinstance(values, float | int | str):
            return self.at([values])[0]
        motions: list[tuple[PeriodicOrbit, ...]] = []
        pieces = list(self._pieces)
        for value in (number_of(self.name, value) for value in values):
            at_value: list[PeriodicOrbit] = []
            for piece in pieces:
                low, high = sorted(piece.values)
                inside = low < high and low <= value <= high
                point = piece.at_value(value) if inside else None
                # Where two pieces meet, both have the motion..
                if point and min(map(point.orbit.distance, at_value), default=1.0) > SAME:
                    at_value.append(point.orbit)
            motions.append(tuple(at_value))
        return motions

    def to_frame(self) -> Any:
        """
        Return the points of the branch as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            A row for each point: the parameter, largest |X| (m), stability, viability, the
            largest modulus of the multipliers, and the kind of a special point, or an empty text.

        Raises
        ------
        ImportError
            Without pandas (extra ``sweep``).

        Examples
        --------
        >>> from impact_damper_ros import RigParameters, find_orbits, follow
        >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
        >>> table = follow(orbit, 'gap', 30.0, 40.0).to_frame()
        >>> list(table)
        ['gap', 'x_max', 'stability', 'viable', 'modulus', 'special']
        """
        import pandas as pd

        special = {one.value: one.kind.value for one in self.special}
        return pd.DataFrame(
            {
                self.name: self.values,
                **{
                    name: [getattr(orbit, name) for orbit in self.orbits]
                    for name in ('x_max', 'stability', 'viable')
                },
                'modulus': [abs(orbit.multipliers[0]) for orbit in self.orbits],
                'special': [special.get(value, '') for value in self.values],
            }
        )

    def best(
        self, measure: str | Callable[[PeriodicOrbit], float] = 'x_max'
    ) -> BranchPoint | None:
        """
        Return the stable, viable motion with the least of some measure.

        Parameters
        ----------
        measure : str or callable, optional
            A number that a `PeriodicOrbit` has, or a function of it; 'x_max' if not given.

        Returns
        -------
        BranchPoint or None
            The best of the points, refined between its neighbours; None if no motion of the
            branch is stable and viable. `change_at` says what limits it.

        Raises
        ------
        ValueError
            If motions have no such number.
        """
        size = _measure(measure)
        fit = [point for point in self.points if point.performed]
        if not fit:
            return None
        best = min(fit, key=size)
        sides = [
            piece
            for piece in self._pieces
            if best in piece[1:] and piece.start.performed and piece.end.performed
        ]

        def size_at(share: float) -> float:
            nonlocal best
            piece = sides[int(share)]
            point = piece.at(share % 1.0)
            if point is None or not point.performed:
                return math.inf
            if size(point) < size(best):
                best = point
            return size(point)

        # Golden sections: scipy.optimize would take longer to load than a hundred such searches.
        low, high = 0.0, float(len(sides))
        one, other = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        sizes = [size_at(one), size_at(other)] if sides else []
        while high - low > _NARROW:
            if sizes[0] < sizes[1]:
                high, other, one = other, one, other - _GOLDEN * (other - low)
                sizes = [size_at(one), sizes[0]]
            else:
                low, one, other = one, other, one + _GOLDEN * (high - one)
                sizes = [sizes[1], size_at(other)]
        return best

    def change_at(self, orbit: PeriodicOrbit) -> str:
        """Return what changes at a motion of the branch, or ends it; empty if nothing does."""
        place = next((k for k, point in enumerate(self.points) if point.orbit == orbit), None)
        return '' if place is None else self._change(place)

    def _change(self, place: int) -> str:
        for special in self.special:
            if special.point is self.points[place]:
                return special.kind.value + (f': {special.reason}' if special.reason else '')
        if place == 0:
            return self.began
        return self.ended if place == len(self.points) - 1 else ''

    def span(self, value: float, orbit: PeriodicOrbit) -> Span:
        """
        Return the range in which a motion of the branch stays stable and viable.

        Parameters
        ----------
        value : float
            The parameter at the motion.
        orbit : PeriodicOrbit
            The motion there; the branch may pass the same value again with another motion.
        """
        count = len(self.points)
        scale = max(map(abs, self.values))
        distances = [
            abs(point.value - value) / scale + abs(point.x_max / orbit.x_max - 1.0)
            for point in self.points
        ]
        here = distances.index(min(distances))

        def end(step: int) -> tuple[float, str, float]:
            last, beyond, way = here, here + step, 0.0
            for _ in range(count):
                # A branch that closes continues at its other end.
                beyond = beyond % count if self.ended == CLOSES else beyond
                if not 0 <= beyond < count or not self.points[beyond].performed:
                    break
                ahead = self.values[beyond] - self.values[last]
                if way * ahead < 0.0:
                    # The branch turns back, stable on both sides, as where two mirror images meet.
                    return self.values[last], SpecialKind.FOLD.value, way
                last, beyond, way = beyond, beyond + step, way or ahead
            near = [k for k in (last, beyond) if 0 <= k < count]
            texts = [self._change(k) for k in near]
            reason = next((t for t in texts if t and t != CLOSES), '')
            if reason.endswith((END, POINTS)):
                reason = ''
            elif not reason and len(near) > 1:
                reason = self.orbits[beyond].reason or 'stability is lost'
            return self.values[last], reason, way

        ends = [end(-1), end(1)]
        if ends[0][2] * ends[1][2] > 0.0:
            # At a turning point of the branch the motion is kept on one side only, as far as on
            # both ways.
            nearer = min(ends, key=lambda found: abs(found[0] - self.values[here]))
            ends = [nearer, (self.values[here], SpecialKind.FOLD.value, 0.0)]
        (low, low_reason, _), (high, high_reason, _) = sorted(ends)
        return Span(low, high, low_reason, high_reason)

    def reverse(self) -> Branch:
        """Return the branch from its last point to its first."""
        return replace(
            self,
            points=self.points[::-1],
            special=self.special[::-1],
            began=self.ended,
            ended=self.began,
            _polylines=tuple(polyline[::-1] for polyline in self._polylines[::-1]),
        )

    def extend(self, further: Branch) -> Branch:
        """Return the branch joined with one that continues from its last point."""
        return replace(
            self,
            points=(*self.points, *further.points[1:]),
            special=(*self.special, *further.special),
            ended=further.ended,
            _polylines=(*self._polylines, *further._polylines),
        )


#: Reasons for the end of a branch.
END, POINTS = 'the end of the range', ' points'
NONE_NEARBY = 'no motion nearby: the corrector fails'
CLOSES = 'the branch closes'
