# SPDX-License-Identifier: Apache-2.0
"""The curve of Xmax/A over the gap: the branches of the motions that a rig can have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from impact_damper_ros.orbits.arguments import OrbitError
from impact_damper_ros.orbits.branch import END, POINTS, Branch, BranchPoint
from impact_damper_ros.orbits.continuation import follow
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.parameters.quoting import counted
from impact_damper_ros.parameters.rig_parameters import RigParameters

#: Factor from the present gap to the ends of the range that is followed, and how often, by which
#: factor, a branch is followed beyond an end at which M moves least.
_SPAN = 4.0
_MOST_FURTHER, _FURTHER = 4, 2.0
#: Points in each direction of a first look, and of a whole branch.
PREVIEW_POINTS, MOST_POINTS = 16, 150
#: Largest number of branches that are followed.
_MOST_BRANCHES = 4
#: Relative difference of the largest |X| of two solutions for one motion, or its mirror image.
_SAME = 1e-6


def name_of(orbit: PeriodicOrbit) -> str:
    """Return the number of impacts and cycles of a motion in words."""
    return f'{counted(len(orbit.stops), "impact")} in {counted(orbit.cycles, "cycle")}'


@dataclass(frozen=True)
class GapBranch:
    """Branch of a periodic motion as the gap is varied."""

    start: PeriodicOrbit  # the motion that was followed
    branch: Branch
    points: int  # most of them in each direction

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Return whether a motion of any rig, or its mirror image, is on the branch."""
        gap = orbit.parameters.gap
        if self.start.parameters.replace(gap=gap) != orbit.parameters:
            return False
        return name_of(self.start) == name_of(orbit) and any(
            math.isclose(there.x_max, orbit.x_max, rel_tol=_SAME)
            for there in self.branch.at([gap])[0]
        )

    @cached_property
    def best(self) -> BranchPoint | None:
        """The stable motion with the least Xmax/A; None if there is none."""
        return self.branch.best('x_max_ratio')

    @cached_property
    def bound(self) -> str:
        """Where the best gap is if M moves least at an end: 'at least' there, or 'at most'."""
        best, branch = self.best, self.branch
        if best is None or len(branch.points) < 2:
            return ''
        if not branch.change_at(best.orbit).endswith((END, POINTS)):
            return ''
        near = branch.values[1 if best.orbit is branch.orbits[0] else -2]
        return 'at least' if best.value > near else 'at most'

    def further(self) -> GapBranch:
        """Follow the branch beyond the end at which M moves least."""
        best = self.best
        assert best is not None
        gap = best.value
        ends = (gap, _FURTHER * gap) if self.bound == 'at least' else (gap / _FURTHER, gap)
        beyond = follow(best.orbit, 'gap', *ends, most_points=self.points)
        if ends[1] == gap:
            beyond = beyond.reversed()
        if best.orbit is self.branch.orbits[0]:
            whole = self.branch.reversed().extended(beyond).reversed()
        else:
            whole = self.branch.extended(beyond)
        return GapBranch(self.start, whole, self.points)


def follow_gap(orbit: PeriodicOrbit, points: int = MOST_POINTS) -> GapBranch | None:
    """
    Follow a motion from a quarter to four times its gap; None where it cannot be followed.

    With all points it is followed further while M moves least at an end.
    """
    gap = orbit.parameters.gap
    try:
        branch = follow(orbit, 'gap', gap / _SPAN, gap * _SPAN, most_points=points)
        found = GapBranch(orbit, branch, points)
        for _ in range(_MOST_FURTHER if points == MOST_POINTS else 0):
            if found.bound:
                found = found.further()
    except (OrbitError, ValueError, ArithmeticError):
        return None
    return found if found.branch.points else None


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
        self._branches: list[GapBranch] = []

    @property
    def starts(self) -> list[PeriodicOrbit]:
        """The motions from which branches have been followed so far."""
        return [branch.start for branch in self._branches]

    def follow(self, start: PeriodicOrbit, points: int = MOST_POINTS) -> bool:
        """Follow a motion, unless its branch is known as closely; return whether it was."""
        place = 0
        for known in self._branches:
            if known.start is start or known.holds(start):
                if known.points >= points:
                    return False
                break
            place += 1
        found = follow_gap(start, points) if place < _MOST_BRANCHES else None
        if found is None:
            return False
        self._branches[place : place + 1] = [found]
        return True

    def _optimum(self) -> dict[str, Any] | None:
        """Return gap and Xmax/A of the lowest stable point; None where a branch goes on."""
        found = [
            (best.orbit.x_max_ratio, best.value, one.bound)
            for one in self._branches
            if (best := one.best) is not None and (one.points == MOST_POINTS or not one.bound)
        ]
        if not found:
            return None
        ratio, gap, bound = min(found)
        return {'gap': gap, 'x_max_ratio': ratio, 'bound': bound}

    def message(self, *, done: bool = False, text: str = '') -> dict[str, Any]:
        """Return the curve as `theory.documents` describes it."""
        return {
            'type': 'gap_curve',
            'gap': self._rig.gap,
            'x_max_ratio': self.here.x_max_ratio if self.here is not None else None,
            'branches': [_columns(one) for one in self._branches],
            'special': [
                {
                    'gap': special.value,
                    'x_max_ratio': special.orbit.x_max_ratio,
                    'kind': special.kind.value,
                    'stable': special.orbit.stable,
                }
                for one in self._branches
                for special in one.branch.special
                if special.orbit.viable
            ],
            'optimum': self._optimum(),
            'done': done,
            'text': text,
        }


def _columns(one: GapBranch) -> dict[str, Any]:
    """Return a branch for JSON."""
    orbits = [o for o in one.branch.orbits if math.isfinite(o.x_max_ratio)]
    return {
        'label': name_of(one.start),
        'gap': [o.parameters.gap for o in orbits],
        'x_max_ratio': [o.x_max_ratio for o in orbits],
        'stable': [o.stable for o in orbits],
        'viable': [o.viable for o in orbits],
    }
