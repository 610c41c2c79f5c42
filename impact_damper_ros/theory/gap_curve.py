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
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters

#: Factor from the present gap to the ends of the range that is followed; number of times that a
#: branch is followed beyond an end at which M moves least, and the factor of each.
_SPAN = 4.0
_MOST_FURTHER, _FURTHER = 4, 2.0
#: Most points of a branch in each direction, and most branches.
_MOST_POINTS, _MOST_BRANCHES = 150, 4
#: Relative difference of the largest |X| up to which two solutions are one motion, or mirror
#: images.
_SAME = 1e-6


def name_of(orbit: PeriodicOrbit) -> str:
    """Return the number of impacts and cycles of a motion in words."""
    return f'{plural(len(orbit.stops), "impact")} in {plural(orbit.cycles, "cycle")}'


@dataclass(frozen=True)
class GapBranch:
    """Branch of a periodic motion as the gap is varied."""

    start: PeriodicOrbit  # the motion that was followed
    branch: Branch

    def contains(self, orbit: PeriodicOrbit) -> bool:
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
        return self.branch.best()

    @cached_property
    def bound(self) -> str:
        """Where M moves least at an end: 'at least' or 'at most', of the best gap."""
        best, points = self.best, self.branch.points
        if best is None or len(points) < 2:
            return ''
        if best is points[0] and self.branch.began.endswith((END, POINTS)):
            return 'at least' if best.value > points[1].value else 'at most'
        if best is points[-1] and self.branch.ended.endswith((END, POINTS)):
            return 'at least' if best.value > points[-2].value else 'at most'
        return ''

    def further(self) -> GapBranch:
        """Follow the branch beyond the end at which M moves least."""
        best = self.best
        assert best is not None
        gap = best.value
        ends = (gap, _FURTHER * gap) if self.bound == 'at least' else (gap / _FURTHER, gap)
        beyond = follow(best.orbit, 'gap', *ends, most_points=_MOST_POINTS)
        if ends[1] == gap:
            beyond = beyond.reverse()
        if best is self.branch.points[0]:
            whole = self.branch.reverse().extend(beyond).reverse()
        else:
            whole = self.branch.extend(beyond)
        return GapBranch(self.start, whole)


def follow_gap(orbit: PeriodicOrbit) -> GapBranch | None:
    """
    Follow a motion from a quarter to four times its gap; None where it cannot be followed.

    The motion is followed further while M moves least at an end.
    """
    gap = orbit.parameters.gap
    try:
        branch = follow(orbit, 'gap', gap / _SPAN, gap * _SPAN, most_points=_MOST_POINTS)
        found = GapBranch(orbit, branch)
        for _ in range(_MOST_FURTHER):
            if found.bound:
                found = found.further()
    except (OrbitError, ValueError, ArithmeticError):
        return None
    return found if found.branch.points else None


class GapCurve:
    """
    The branches of Xmax/A over the gap.

    Parameters
    ----------
    rig : RigParameters
        The rig; its gap is varied.
    """

    def __init__(self, rig: RigParameters) -> None:
        self._rig = rig
        # Factor from the largest |X| to Xmax/A; the amplitude A does not depend on the gap.
        self._ratio = rig.x_max_ratio(1.0)
        self._branches: list[GapBranch] = []

    def follow(self, start: PeriodicOrbit) -> None:
        """Follow a motion, unless it is on a known branch."""
        if len(self._branches) >= _MOST_BRANCHES or math.isnan(self._ratio):
            return
        if any(known.start is start or known.contains(start) for known in self._branches):
            return
        branch = follow_gap(start)
        if branch is not None:
            self._branches.append(branch)

    def _optimum(self) -> dict[str, Any] | None:
        """Return gap and Xmax/A of the lowest stable point; None without one."""
        lowest = [(best, one.bound) for one in self._branches if (best := one.best) is not None]
        if not lowest:
            return None
        best, bound = min(lowest, key=lambda pair: pair[0].x_max)
        return {'gap': best.value, 'x_max_ratio': best.x_max * self._ratio, 'bound': bound}

    def message(self, here: PeriodicOrbit | None = None, text: str = '') -> dict[str, Any]:
        """Return the curve as `theory.documents` describes it; `here` is the motion of the rig."""
        return {
            'type': 'gap_curve',
            'gap': self._rig.gap,
            'x_max_ratio': None if here is None else as_plain(here.x_max_ratio),
            'branches': [self._columns(one) for one in self._branches],
            'special': [
                {
                    'gap': special.value,
                    'x_max_ratio': special.point.x_max * self._ratio,
                    'kind': special.kind.value,
                    'stable': special.point.stability == 'stable',
                }
                for one in self._branches
                for special in one.branch.special
                if special.point.viable
            ],
            'optimum': self._optimum(),
            'text': text or ('' if self._branches else 'no periodic motion can be followed'),
        }

    def _columns(self, one: GapBranch) -> dict[str, Any]:
        """Return the columns of a branch for JSON."""
        points = one.branch.points
        return {
            'label': name_of(one.start),
            'gap': [point.value for point in points],
            'x_max_ratio': [point.x_max * self._ratio for point in points],
            'stable': [point.stability == 'stable' for point in points],
            'viable': [point.viable for point in points],
        }
