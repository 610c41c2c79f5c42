"""The curve of Xmax/A over the gap: the branches of the motions that a rig can have."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from time import monotonic
from typing import Any

import numpy as np

from impact_damper_ros.orbits import (
    Branch,
    OrbitError,
    PeriodicOrbit,
    SpecialPoint,
    grow_branch,
)
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.quoting import counted

#: Factor from the present gap to the ends of the range that is followed, and how often, by which
#: factor, a branch is followed beyond an end at which M moves least.
_SPAN = 4.0
_MOST_FURTHER, _FURTHER = 4, 2.0
PREVIEW_POINTS, MOST_POINTS = 16, 150
#: Largest number of branches that are followed.
_MOST_BRANCHES = 4
#: Largest distance in Xmax/A of a motion that is on a branch.
_ON_BRANCH = 2e-3
#: Period with which a growing curve is reported, s.
_REPORT_PERIOD_S = 0.1


def name_of(orbit: PeriodicOrbit) -> str:
    """Return the number of impacts and cycles of a motion in words."""
    return f'{counted(len(orbit.stops), "impact")} in {counted(orbit.cycles, "cycle")}'


@dataclass(frozen=True)
class _Part:
    """One direction of a branch, as far as it has been followed."""

    branch: Branch
    ended: bool = False
    #: Where the best gap is if M moves least at the end and the branch goes on: 'at least' there,
    #: or 'at most'.
    bound: str = ''


def _parts(start: PeriodicOrbit, *, upwards: bool) -> Iterator[_Part]:
    """Follow a motion as `grow_branch` does, and further while M moves least at the end."""
    span, bound = _SPAN, ''
    ways: list[Iterator[Branch]] = []
    known: list[Branch] = []
    while not ways or (bound and len(ways) <= _MOST_FURTHER):
        here = known[-1].orbits[-1] if known else start
        gap = here.parameters.gap
        ends = gap / span, gap * span
        ways.append(grow_branch(here, 'gap', *ends, upwards=upwards, most_points=MOST_POINTS))
        known.append(next(ways[-1]))
        while known[-1].points and not known[-1].ended:
            yield _Part(reduce(Branch.extended, known))
            known[-1] = next(ways[-1])
        whole = reduce(Branch.extended, known)
        if len(whole.points) < 2:
            break
        last, end = whole.values[-2:]
        cut = len(known[-1].points) >= MOST_POINTS or any(math.isclose(end, e) for e in ends)
        span, upwards = _FURTHER, end > last
        best = whole.best(_ratio)
        least = best is not None and best.orbit is whole.orbits[-1]
        bound = ('at least' if upwards else 'at most') if cut and least else ''
    yield _Part(whole, True, bound)
    # The special points of each range come last.
    located = [next(way, branch) for way, branch in zip(ways, known, strict=True)]
    yield _Part(reduce(Branch.extended, located), True, bound)


def _ratio(orbit: PeriodicOrbit) -> float:
    return orbit.amplitude_ratio


class _GrowingBranch:
    """
    A branch of periodic motions, followed from the present gap in both directions.

    Parameters
    ----------
    start : PeriodicOrbit
        The motion.
    """

    def __init__(self, start: PeriodicOrbit) -> None:
        self.start = start
        self._ways = [_parts(start, upwards=up) for up in (False, True)]
        self._parts: list[_Part | None] = [None, None]
        self.branch = Branch(name='gap', points=(), special=(), ended='')
        self._marked = False

    def _grow(self, way: int) -> bool:
        """Add a point at one end; return whether that was possible."""
        try:
            self._parts[way] = next(self._ways[way])
        except (StopIteration, OrbitError, ValueError, ArithmeticError):
            self._ways[way] = iter(())
            return False
        parts = [part.branch for part in self._parts if part is not None]
        self.branch = parts[0].joined(parts[1]) if len(parts) == 2 else parts[0]
        return True

    def _far(self, points: int) -> list[bool]:
        """Return which directions have reached a number of points, or their end."""
        most = points if points < MOST_POINTS else math.inf
        return [p is not None and (p.ended or len(p.branch.points) >= most) for p in self._parts]

    def grown(self, points: int) -> Iterator[None]:
        """Follow both directions to a number of points, or their ends; yield after each step."""
        ways = [way for way, far in enumerate(self._far(points)) if not far]
        while ways:
            ways = [way for way in ways if self._grow(way) and not self._far(points)[way]]
            yield

    def marked(self) -> bool:
        """Locate the special points once both ends are reached; return whether any are new."""
        if any(part is None or not part.ended for part in self._parts):
            return False
        for way in (0, 1):
            while self._grow(way):
                pass
        fresh, self._marked = not self._marked, True
        return fresh and bool(self.special)

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Return whether a motion is on the part of the branch that has been computed."""
        if orbit is self.start:
            return True
        if name_of(self.start) != name_of(orbit):
            return False
        gap, ratio = orbit.parameters.gap, orbit.amplitude_ratio
        gaps = np.array(self.branch.values)
        ratios = np.array([one.amplitude_ratio for one in self.branch.orbits])
        crossed = (gaps[:-1] - gap) * (gaps[1:] - gap) <= 0.0
        for i in np.flatnonzero(crossed):
            width = gaps[i + 1] - gaps[i]
            share = (gap - gaps[i]) / width if width else 0.0
            there = ratios[i] + share * (ratios[i + 1] - ratios[i])
            if abs(there - ratio) < _ON_BRANCH + 0.02 * ratio:
                return True
        return False

    @property
    def best(self) -> tuple[float, float, str] | None:
        """
        Gap and Xmax/A of the lowest stable point, and its bound; None if there is none yet.

        The bound is 'at least' or 'at most' where M moves least at the end of what is followed. At
        an end from which the branch is still to be followed, a lower point may be beyond.
        """
        best = self.branch.best(_ratio)
        if best is None:
            return None
        bound = ''
        for part in self._parts:
            if part is None or part.branch.orbits[-1:] == (best.orbit,):
                if part is None or not part.ended:
                    return None
                bound = part.bound
        return best.value, best.orbit.amplitude_ratio, bound

    @property
    def special(self) -> list[SpecialPoint]:
        """The special points with viable motions."""
        return [special for special in self.branch.special if special.orbit.viable]

    def as_dict(self) -> dict[str, Any]:
        """Return the branch for JSON."""
        orbits = [o for o in self.branch.orbits if math.isfinite(o.amplitude_ratio)]
        return {
            'label': name_of(self.start),
            'gap': [o.parameters.gap for o in orbits],
            'x_max_ratio': [o.amplitude_ratio for o in orbits],
            'stable': [o.stable for o in orbits],
            'viable': [o.viable for o in orbits],
        }


class GapCurve:
    """
    The branches of Xmax/A over the gap found so far.

    Parameters
    ----------
    rig : RigParameters
        The rig; its gap is varied.

    Attributes
    ----------
    here : PeriodicOrbit or None
        The motion of the rig.
    """

    def __init__(self, rig: RigParameters) -> None:
        self._rig = rig
        self.here: PeriodicOrbit | None = None
        self._motions: list[_GrowingBranch] = []

    @property
    def starts(self) -> list[PeriodicOrbit]:
        """The motions from which branches have been followed so far."""
        return [motion.start for motion in self._motions]

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Return whether a motion is on one of the branches."""
        return any(motion.holds(orbit) for motion in self._motions)

    def follow(self, start: PeriodicOrbit, points: int = MOST_POINTS) -> Iterator[None]:
        """
        Follow a motion by up to `points` points in each direction, or extend its branch.

        Yields now and then while the curve grows, and at the end.
        """
        motion = next((motion for motion in self._motions if motion.holds(start)), None)
        if motion is None:
            if len(self._motions) >= _MOST_BRANCHES:
                return
            motion = _GrowingBranch(start)
            self._motions.append(motion)
        due = monotonic() + _REPORT_PERIOD_S
        news = False
        for _ in motion.grown(points):
            news = monotonic() < due
            if not news:
                yield
                due = monotonic() + _REPORT_PERIOD_S
        if news:
            yield

    def mark(self) -> Iterator[None]:
        """Locate the special points, branch by branch; yields after each that has any."""
        for motion in self._motions:
            if motion.marked():
                yield

    def _best(self) -> tuple[float, float, str] | None:
        """Return the gap with the least Xmax/A of a stable motion, that ratio, the gap's bound."""
        lowest = (motion.best for motion in self._motions)
        return min(filter(None, lowest), key=lambda found: found[1], default=None)

    def message(self, *, done: bool = False, text: str = '') -> dict[str, Any]:
        """Return the curve as `theory.documents` describes it."""
        names = ('gap', 'x_max_ratio', 'bound')
        best = self._best()
        return {
            'type': 'gap_curve',
            'gap': self._rig.gap,
            'x_max_ratio': self.here.amplitude_ratio if self.here is not None else None,
            'branches': [motion.as_dict() for motion in self._motions],
            'special': [
                {
                    'gap': special.value,
                    'x_max_ratio': special.orbit.amplitude_ratio,
                    'kind': special.kind.value,
                    'stable': special.orbit.stable,
                }
                for motion in self._motions
                for special in motion.special
            ],
            'optimum': dict(zip(names, best, strict=True)) if best else None,
            'done': done,
            'text': text,
        }
