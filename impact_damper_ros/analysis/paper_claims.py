"""What section 3 and the conclusions of Bapat (1995) claim, held against the numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from .paper_plan import Series
from .paper_sweep import Curve, Point, Status

__all__ = ['Claim', 'Verdict', 'at_value', 'branch', 'claims_table', 'stable_width']


class Verdict(Enum):
    """The outcome for a claim."""

    REPRODUCED = 'reproduced'
    OTHER_NUMBER = 'reproduced with a different number'
    NOT_REPRODUCED = 'not reproduced'


@dataclass(frozen=True)
class Claim:
    """
    One claim.

    Attributes
    ----------
    figure : str
        The figure it is about, or 'text'.
    claim : str
        What the paper says.
    computed : str
        What was computed, with numbers.
    verdict : Verdict
        The outcome.
    remark : str
        Why, where that is not plain from the numbers.
    """

    figure: str
    claim: str
    computed: str
    verdict: Verdict
    remark: str = ''


def judged(holds: bool, otherwise: Verdict = Verdict.NOT_REPRODUCED) -> Verdict:
    """Return 'reproduced' if the numbers bear a claim out."""
    return Verdict.REPRODUCED if holds else otherwise


def stable_width(curves: Sequence[Curve]) -> float:
    """
    Return over how much of the parameter some motion of these curves is stable and viable.

    Parameters
    ----------
    curves : sequence of Curve
        Curves of one number of impacts.
    """
    pieces = sorted(
        (min(a.value, b.value), max(a.value, b.value))
        for curve in curves
        for a, b in zip(curve.points, curve.points[1:], strict=False)
        if a.status == b.status == Status.STABLE
    )
    width, reached = 0.0, -np.inf
    for low, high in pieces:
        width += max(0.0, high - max(low, reached))
        reached = max(reached, high)
    return float(width)


def branch(series: Series, impacts: int = 2) -> list[Point]:
    """Return the viable motion with the smallest displacement at each value, stable first."""
    best: dict[float, Point] = {}
    for curve in series.of(impacts):
        for point in curve.points:
            if point.status == Status.NOT_VIABLE:
                continue
            other = best.get(point.value)
            if other is None or (point.status, point.ratio) < (other.status, other.ratio):
                best[point.value] = point
    return [best[value] for value in sorted(best)]


def at_value(series: Series, value: float) -> Point:
    """
    Return the viable motion with two impacts per cycle at a value, stable if there is one.

    Raises
    ------
    KeyError
        If there is none at this value.
    """
    for point in branch(series):
        if abs(point.value - value) < 1e-9:
            return point
    raise KeyError(f'{series.sweep.name} has no motion at {value:g}')


def stable_excess(
    series: Series, reference: Series, above: float = -np.inf
) -> tuple[float, float, int]:
    """
    Compare displacements where both series are stable.

    Parameters
    ----------
    series, reference : Series
        With two impacts per cycle.
    above : float, optional
        Least value compared.

    Returns
    -------
    least, largest : float
        Relative excess of the first over the second.
    count : int
        Number of values compared.
    """
    base = {p.value: p.ratio for p in branch(reference) if p.status == Status.STABLE}
    excess = [
        p.ratio / base[p.value] - 1.0
        for p in branch(series)
        if p.status == Status.STABLE and p.value in base and p.value >= above
    ]
    return (min(excess), max(excess), len(excess)) if excess else (np.nan, np.nan, 0)


def stability_end(series: Series) -> float:
    """Return the value at which the motion that is stable at the lowest value ceases to be."""
    last = np.nan
    for point in branch(series):
        if point.status != Status.STABLE:
            break
        last = point.value
    return float(last)


def series_claims(results: Mapping[str, Series]) -> tuple[int, float, float]:
    """Return the number of settled motions with theory, and the largest two differences."""
    motions = [m for s in results.values() for m in s.marks if m.stops and m.orbit is not None]
    times = max((m.difference for m in motions if np.isfinite(m.difference)), default=0.0)
    ratios = max(
        (abs(m.ratio / m.orbit.amplitude_ratio - 1.0) for m in motions if m.orbit is not None),
        default=0.0,
    )
    return len(motions), times, ratios


def claims_table(claims: Sequence[Claim]) -> str:
    """Return the claims as a Markdown table."""
    lines = ['| no. | about | claim | computed | verdict |', '| --- | --- | --- | --- | --- |']
    for number, claim in enumerate(claims, 1):
        verdict = f'**{claim.verdict.value}**' + (f': {claim.remark}' if claim.remark else '')
        lines.append(
            f'| {number} | {claim.figure} | {claim.claim} | {claim.computed} | {verdict} |'
        )
    return '\n'.join(lines) + '\n'
