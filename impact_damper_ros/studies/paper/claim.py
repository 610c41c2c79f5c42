"""A claim of Bapat (1995) and its verdict, and the measures that several verdicts use."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise, takewhile

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig import RigParameters

from .curves import Curve, CurvePoint, Status
from .series import Series

#: Relative change of the displacement that counts as small in practice.
SMALL = 0.1


class Judgement(Enum):
    """Whether the numbers confirm a claim."""

    REPRODUCED = 'reproduced'
    #: It holds for some of the rigs, motions or measures that it is about; the remark says which.
    IN_PART = 'reproduced in part'
    OTHER_NUMBER = 'reproduced with a different number'
    NOT_REPRODUCED = 'not reproduced'


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, and what was computed."""

    #: The figure it is about, or 'text'.
    figure: str
    claim: str
    computed: str
    judgement: Judgement
    remark: str = ''  # explains the judgement where the numbers do not

    @property
    def verdict(self) -> str:
        """The judgement, with the remark."""
        return self.judgement.value + (f': {self.remark}' if self.remark else '')


def judged(holds: bool, otherwise: Judgement = Judgement.NOT_REPRODUCED) -> Judgement:
    """Return 'reproduced' if the numbers confirm a claim."""
    return Judgement.REPRODUCED if holds else otherwise


def stable_width(curves: Sequence[Curve]) -> float:
    """Return the length of the parameter range in which some motion is stable and viable."""
    pieces = sorted(
        (min(a.value, b.value), max(a.value, b.value))
        for curve in curves
        for a, b in pairwise(curve.points)
        if a.status == b.status == Status.STABLE
    )
    width, reached = 0.0, -math.inf
    for low, high in pieces:
        width += max(0.0, high - max(low, reached))
        reached = max(reached, high)
    return width


def branch_of(series: Series, impacts: int = 2) -> dict[float, CurvePoint]:
    """Return the viable motion with the smallest displacement at each value, stable first."""
    best: dict[float, CurvePoint] = {}
    points = [point for curve in series.of(impacts) for point in curve.points]
    for point in sorted(points, key=lambda point: (point.value, point.status, point.ratio)):
        if point.status != Status.NOT_VIABLE:
            best.setdefault(point.value, point)
    return best


def stable_ratios(series: Series) -> dict[float, float]:
    """Return Xmax/A of the branch at each value at which it is stable."""
    branch = branch_of(series)
    return {v: point.ratio for v, point in branch.items() if point.status == Status.STABLE}


def excess_over(
    series: Series, reference: Series, *, above: float = -math.inf
) -> dict[float, float]:
    """Return the relative excess of the displacement wherever both series are stable."""
    base = stable_ratios(reference)
    return {
        value: ratio / base[value] - 1.0
        for value, ratio in stable_ratios(series).items()
        if value in base and value >= above
    }


def stability_end(series: Series) -> float:
    """Return the value up to which the motion that is stable at the lowest value is stable."""
    stable = takewhile(lambda point: point.status == Status.STABLE, branch_of(series).values())
    return max((point.value for point in stable), default=math.nan)


def range_text(values: Collection[float], digits: int = 2) -> str:
    """Return least and greatest of relative changes."""
    if not values:
        return 'not stable'
    return f'{min(values):+.{digits}%} to {max(values):+.{digits}%}'


def least_ratio(rig: RigParameters) -> float:
    """Return the least Xmax/A of stable motions with two impacts per cycle; NaN without any."""
    orbits = find_orbits(rig, (1, 2), simulate=False).orbits
    fit = [orbit.amplitude_ratio for orbit in orbits if orbit.stable and orbit.viable]
    return min(fit, default=math.nan)
