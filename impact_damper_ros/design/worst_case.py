# SPDX-License-Identifier: Apache-2.0
"""The worst of many runs from rest, over level and uncertain parameters, and its best gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product, takewhile
from typing import NamedTuple

import numpy as np

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .damper_design import Design
from .runs_from_rest import (
    Array,
    Flags,
    bare_amplitudes,
    largest_in_long,
    largest_in_short,
)

Ranges = Mapping[str, tuple[float, float]]

#: Levels and values of R: of a whole grid, and of one that is run for all gaps. Friction is at
#: both ends, and so is any other uncertain parameter, with half as many levels and values of R.
#: Where only level or R has a range, the number of its values is multiplied by the last factor.
_WHOLE, _COARSE, _ALONE = (40, 20), (10, 5), 5
#: Cases next to the worst that are run, too: number of worst cases, levels and values of R for
#: each, steps of the grid within which they lie.
_WORST, _AROUND, _STEPS = 4, 5, (1.0, 0.3)
#: Motions that do not repeat are run longer, the largest first: number at a time, most times, and
#: factor by which they may grow.
_AT_A_TIME, _BATCHES, _GROWTH = 48, 2, 1.25
#: Gaps that are tried, over the best one: from the first factor times the lowest level, up to the
#: second; the improvement that is worth another whole grid; and gaps whose cases are run at once.
_LEAST_GAP, _WIDEST_GAP, _GAPS, _WORTH, _AT_ONCE = 0.5, 1.5, 40, 0.02, 6
#: Decimals of a ratio: round-off must not decide which of many equal ones is the worst.
_DECIMALS = 9


@dataclass(frozen=True)
class WorstCase:
    """
    The worst of many runs from rest with one gap.

    Attributes
    ----------
    gap : float
        The gap, m.
    ratio : float
        Largest |X| over that without the damper.
    case : dict
        The worst case: `level` as a factor, and uncertain parameters, SI.
    ratios : ndarray, shape (runs,)
        Largest |X| over that without the damper of all runs.
    """

    gap: float
    ratio: float
    case: dict[str, float]
    ratios: Array


@dataclass(frozen=True)
class WorstCases:
    """
    The worst cases of gaps from rest, over levels and uncertain parameters.

    Attributes
    ----------
    chosen, best : WorstCase
        The worst case of the gap to build, and that of the gap for which it is least.
    as_good : tuple of float
        Lowest and highest gap around the best one whose worst case is at most 2 % worse, m: less
        than the worst cases of two samples of the same runs differ by.
    whole : dict
        Largest |X| over that without the damper, of the gaps of which all cases were run.
    gaps : ndarray, shape (n,)
        Gaps that were compared, m.
    rig : RigParameters
        The rig of the design.
    ranges : dict
        Lowest and highest value of each uncertain parameter, SI.
    levels : tuple of float
        Lowest and highest level as factors.
    """

    chosen: WorstCase
    best: WorstCase
    as_good: tuple[float, float]
    whole: dict[float, float]
    gaps: Array
    rig: RigParameters
    ranges: dict[str, tuple[float, float]]
    levels: tuple[float, float]

    @cached_property
    def ratios(self) -> Array:
        """Largest |X| over that without the damper, by gap, in some of the cases."""
        unsure = _Uncertain(self.rig, self.ranges, self.levels)
        return unsure.ratios(self.gaps, unsure.grid(_COARSE)[0])


class _Runs(NamedTuple):
    """Cases, their places within the ranges of level and R from 0 to 1, and |X| over bare |X|."""

    cases: dict[str, Array]
    places: Array
    ratios: Array

    @property
    def worst(self) -> float:
        return float(self.ratios.max())


class _Uncertain:
    """A rig with the ranges of its level and parameters."""

    def __init__(self, rig: RigParameters, ranges: Ranges, levels: tuple[float, float]) -> None:
        self.rig, self.ranges, self.levels = rig, ranges, levels
        self.bounces = [name for name in self.ranges if name.startswith('restitution')]
        self.others = [name for name in self.ranges if name not in self.bounces]

    def cases(self, places: Array, **values: float) -> dict[str, Array]:
        """Return the cases at some places; other parameters may be given."""
        (low, high) = self.levels
        columns = {'level': low * (high / low) ** places[:, 0]}
        for name in self.bounces:
            start, end = self.ranges[name]
            columns[name] = start + places[:, 1] * (end - start)
        columns = {n: np.array([float(f'{v:.4g}') for v in c]) for n, c in columns.items()}
        others = {name: values.get(name, getattr(self.rig, name)) for name in self.others}
        return columns | {n: np.full(len(places), value) for n, value in others.items()}

    def grid(self, counts: tuple[int, int]) -> tuple[dict[str, Array], Array]:
        """Return the cases of a grid, and their places."""
        corners = [({'friction': end}, 1) for end in self.ranges.get('friction', ())] or [({}, 1)]
        corners += [({n: e}, 2) for n in self.others if n != 'friction' for e in self.ranges[n]]
        varies = self.levels[0] < self.levels[1], bool(self.bounces)
        cases, places = [], []
        for values, part in corners:
            times = 1 if all(varies) else _ALONE
            axes = (
                np.linspace(0.0, 1.0, times * count // part if several else 1)
                for count, several in zip(counts, varies, strict=True)
            )
            places.append(np.array([*product(*axes)]))
            cases.append(self.cases(places[-1], **values))
        joined = {name: np.concatenate([one[name] for one in cases]) for name in cases[0]}
        return joined, np.concatenate(places)

    def _ratios_of(self, sizes: Array, cases: dict[str, Array]) -> Array:
        """Return the ratios of cases with some largest |X|, m."""
        ratios: Array = np.round(sizes / bare_amplitudes(self.rig, cases), _DECIMALS)
        return ratios

    def short_ratios(self, gaps: Array, cases: dict[str, Array]) -> tuple[Array, Flags]:
        """Return the ratios of 30 cycles, and which motions repeat, for each gap and case."""
        count = len(cases['level'])
        every = {name: np.tile(column, len(gaps)) for name, column in cases.items()}
        sizes, repeats = largest_in_short(self.rig, {**every, 'gap': np.repeat(gaps, count)})
        shape = len(gaps), count
        return self._ratios_of(sizes.reshape(shape), cases), repeats.reshape(shape)

    def ratios(self, gaps: Array, cases: dict[str, Array], least: float = 0.0) -> Array:
        """
        Return the ratios for each gap and case.

        Irregular motions are run longer if they may become larger than all others of their gap,
        and than `least`.
        """
        ratios, repeats = self.short_ratios(gaps, cases)
        order = np.argsort(np.where(repeats, np.inf, -ratios), axis=1, kind='stable')
        growth = np.full(len(gaps), _GROWTH)
        for first in range(0, min(_BATCHES * _AT_A_TIME, order.shape[1]), _AT_A_TIME):
            some = order[:, first : first + _AT_A_TIME]
            short = np.take_along_axis(ratios, some, axis=1)
            worth = growth * short[:, 0] > np.maximum(least, ratios.max(axis=1))
            which = np.nonzero(worth[:, None] & ~np.take_along_axis(repeats, some, axis=1))
            if not len(which[0]):
                break
            rows, columns = which[0], some[which]
            values = {name: column[columns] for name, column in cases.items()}
            sizes = largest_in_long(self.rig, {**values, 'gap': gaps[rows]})
            longer = self._ratios_of(sizes, values)
            growth = np.ones(len(gaps))
            np.maximum.at(growth, rows, longer / short[which])
            ratios[rows, columns] = np.maximum(ratios[rows, columns], longer)
        return ratios

    def whole(self, gap: float) -> _Runs:
        """Return the runs of a whole grid with a gap."""
        cases, places = self.grid(_WHOLE)
        return _Runs(cases, places, self.ratios(np.array([gap]), cases)[0])

    def worst(self, gap: float, runs: _Runs) -> WorstCase:
        """Return the worst case of a gap, after runs of cases next to the worst so far."""
        varies = runs.places.max(axis=0) - runs.places.min(axis=0)
        steps = varies / (np.array(_WHOLE) * (1 if varies.all() else _ALONE) - 1.0)
        for width in _STEPS if steps.any() else ():
            offsets = np.array([*product(np.linspace(-width, width, _AROUND), repeat=2)]) * steps
            parts, cases = [], []
            for k in np.argsort(-runs.ratios, kind='stable')[:_WORST]:
                parts.append(np.unique(np.clip(runs.places[k] + offsets, 0.0, 1.0), axis=0))
                values = {name: float(runs.cases[name][k]) for name in self.others}
                cases.append(self.cases(parts[-1], **values))
            more = {name: np.concatenate([one[name] for one in cases]) for name in runs.cases}
            ratios = self.ratios(np.array([gap]), more, runs.worst)[0]
            runs = _Runs(
                {name: np.append(column, more[name]) for name, column in runs.cases.items()},
                np.concatenate([runs.places, *parts]),
                np.append(runs.ratios, ratios),
            )
        k = int(np.argmax(runs.ratios))
        case = {name: float(column[k]) for name, column in runs.cases.items()}
        return WorstCase(gap, float(runs.ratios[k]), case, runs.ratios)


def worst_cases(design: Design, ranges: Ranges, levels: Sequence[float]) -> WorstCases:
    """
    Return the worst case of the gap to build, and the gap for which it is least.

    Both restitutions go through their ranges together, the friction is at its ends, other
    parameters are at their ends one at a time.

    Parameters
    ----------
    design : Design
        The structure and its damper.
    ranges : mapping of str to tuple of float
        Lowest and highest value of each uncertain parameter, SI.
    levels : sequence of float
        Levels as factors; the lowest and the highest count.
    """
    ends = min(levels), max(levels)
    unsure = _Uncertain(design.rig, ranges, ends)
    shares = np.geomspace(_LEAST_GAP * min(ends[0], 1.0), _WIDEST_GAP, _GAPS)
    gaps = np.unique([*(float(f'{gap:.3g}') for gap in shares * design.gap), design.gap])
    cases, places = unsure.grid(_COARSE)
    at_ends = ((places == 0.0) | (places == 1.0)).all(axis=1)
    # The worst case of a gap is at least the worst of some cases: at the ends, then of the grid.
    ends_only = {name: column[at_ends] for name, column in cases.items()}
    bounds, rough = unsure.short_ratios(gaps, ends_only)[0].max(axis=1), np.ones(len(gaps), bool)
    runs = {design.gap: unsure.whole(design.gap)}
    least = runs[design.gap].worst
    while float(bounds.min()) <= (1.0 - _WORTH) * least:
        first = int(np.argmin(bounds))
        if rough[first]:
            some = [k for k in np.argsort(bounds, kind='stable') if rough[k]][:_AT_ONCE]
            bounds[some] = unsure.short_ratios(gaps[some], cases)[0].max(axis=1)
            rough[some] = False
            continue
        bounds[first], gap = np.inf, float(gaps[first])
        runs[gap] = unsure.whole(gap)
        before, least = least, min(least, runs[gap].worst)
        if least > (1.0 - _WORTH) * before:
            break
    as_good = _as_good(unsure, gaps, runs) if least < runs[design.gap].worst else (design.gap,) * 2
    whole = {gap: one.worst for gap, one in runs.items()}
    best = min(whole, key=lambda gap: whole[gap])
    chosen = unsure.worst(design.gap, runs[design.gap])
    robust = chosen if best == design.gap else unsure.worst(best, runs[best])
    found = chosen, robust, as_good, whole
    return WorstCases(*found, gaps, design.rig, dict(ranges), ends)


def _as_good(unsure: _Uncertain, gaps: Array, runs: dict[float, _Runs]) -> tuple[float, float]:
    """
    Return the lowest and the highest gap as good as the best one; all cases of these are run.

    At another level the motions are those at another gap, to scale. Gaps beside each other differ
    in the cases at the ends of the level, and a gap between two others is no worse than both.
    """
    cases, places = unsure.grid(_WHOLE)
    at_ends = (places[:, 0] == 0.0) | (places[:, 0] == 1.0)
    ends_only = {name: column[at_ends] for name, column in cases.items()}

    @cache
    def worst_at_ends(gap: float) -> float:
        return float(unsure.short_ratios(np.array([gap]), ends_only)[0].max())

    def worst(gap: float) -> float:
        if gap not in runs:
            runs[gap] = unsure.whole(gap)
        return runs[gap].worst

    def last(side: Sequence[float], most: float) -> float:
        near = [*takewhile(lambda gap: worst_at_ends(gap) <= most, side)]
        return next(gap for gap in near[::-1] if worst(gap) <= most)

    while True:
        best = min(runs, key=worst)
        most = (1.0 + _WORTH) * worst(best)
        below, above = gaps[gaps <= best][::-1].tolist(), gaps[gaps >= best].tolist()
        ends = last(below, most), last(above, most)
        if best == min(runs, key=worst):
            return ends
