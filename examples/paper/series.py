# SPDX-License-Identifier: Apache-2.0
"""
A series of a figure: branches of periodic motions along one parameter, and settled runs.

The branches start from every motion that `find_orbits` has at some values, and are followed
through their folds. No branch with three or four impacts starts from a simulation.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.lines import Line2D

from impact_damper_ros import (
    Branch,
    InitialConditions,
    PeriodicOrbit,
    Rig,
    RigParameters,
    SettledMotion,
    find_orbits,
    follow,
    settle,
)

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import BLUE, GREEN, MARKS, ORANGE, PURPLE, say, show, write_rows

#: Motions closer than this are the same: solutions, and a settled run and a solution.
SAME, REACHED = 1e-7, 1e-5
#: Cycles in which a run from rest settles, and at most near a motion that is stable by little.
CYCLES, MOST_CYCLES = 600, 30_000
#: Colours and marks of the series of a figure.
LOOKS = ((BLUE, 'o'), (ORANGE, 's'), (GREEN, '^'), (PURPLE, 'D'))
STABLE: dict[str, Any] = {'linestyle': '-', 'linewidth': 1.7}
UNSTABLE: dict[str, Any] = {'linestyle': (0, (4, 2.2)), 'linewidth': 0.9}

Ordinate = Callable[[PeriodicOrbit | SettledMotion], Sequence[float]]


@dataclass(frozen=True)
class Series:
    """
    Branches and settled runs along one parameter.

    `rig` returns the rig at a value; `runs` are values and the motions that runs settle into.
    """

    rig: Callable[[float], RigParameters]
    low: float
    high: float
    branches: tuple[Branch, ...]
    runs: tuple[tuple[float, SettledMotion], ...] = ()
    _known: dict[tuple[int, float], tuple[PeriodicOrbit, ...]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def at(self, value: float, *stops: tuple[int, ...]) -> list[PeriodicOrbit]:
        """Return the viable motions at a value, with one of some sequences, if given."""
        found: list[PeriodicOrbit] = []
        for number, branch in enumerate(self.branches):
            if not stops or branch.orbits[0].stops in stops:
                if (number, value) not in self._known:
                    self._known[number, value] = branch.at([value])[0]
                for orbit in self._known[number, value]:
                    # Two branches may meet at a nonsmooth fold, and go on as one
                    if orbit.viable and min(map(orbit.distance, found), default=1.0) > SAME:
                        found.append(orbit)
        return found

    def least(self, value: float, *stops: tuple[int, ...]) -> float:
        """Return the least stable Xmax/A of some stop sequences at a value; NaN without any."""
        stable = [orbit.x_max_ratio for orbit in self.at(value, *stops) if orbit.stable]
        return min(stable, default=math.nan)

    def stable_ranges(self, *stops: tuple[int, ...]) -> list[tuple[float, float]]:
        """Return the ranges over which a motion with one of the sequences is stable."""
        pieces = sorted(
            (min(a.value, b.value), max(a.value, b.value))
            for branch in self.branches
            if not stops or branch.orbits[0].stops in stops
            for status, part in branch.parts()
            if status == 'stable'
            for a, b in pairwise(branch.points[part])
        )
        joined: list[tuple[float, float]] = []
        for low, high in pieces:
            if joined and low <= joined[-1][1] + 1e-9 * abs(low):
                joined[-1] = joined[-1][0], max(high, joined[-1][1])
            else:
                joined.append((low, high))
        return joined

    def stable_width(self, *stops: tuple[int, ...]) -> float:
        """Return the length of these ranges."""
        return sum(high - low for low, high in self.stable_ranges(*stops))


def branches_along(
    rig: Callable[[float], RigParameters],
    low: float,
    high: float,
    starts: Iterable[float],
    sequences: Sequence[tuple[int, ...]] = ((1, 2),),
    *,
    name: str = '',
    simulate: bool = False,
) -> Iterator[Branch]:
    """
    Follow every viable motion found at some values, each branch once.

    Along `name`, if the rigs differ in a parameter of this name only; `simulate` is that of
    `find_orbits`, which then also has motions in which m reverses between two stops.
    """
    known: list[Branch] = []
    for value in starts:
        for stops in sequences:
            alike = [branch for branch in known if branch.orbits[0].shifts(stops)]
            there = [orbit for branch in alike for orbit in branch.at([value])[0]]
            for orbit in find_orbits(rig(value), stops, simulate=simulate).orbits:
                if orbit.viable and min(map(orbit.distance, there), default=1.0) > SAME:
                    start = None if name else value
                    known.append(follow(orbit, name or rig, low, high, start=start))
                    there += known[-1].at([value])[0]
                    yield known[-1]


def series_along(
    rig: Callable[[float], RigParameters],
    starts: Sequence[float],
    marks: Sequence[float],
    *,
    name: str = '',
    carried: bool = True,
) -> Series:
    """Return the motions with two impacts per cycle between the ends of some values."""
    low, high = float(min(starts)), float(max(starts))
    branches = list(branches_along(rig, low, high, map(float, starts), name=name))
    runs = settled_runs(rig, [float(mark) for mark in marks], branches, carried)
    return Series(rig, low, high, tuple(branches), tuple(runs))


class Best(NamedTuple):
    """The stable motion with the least |X|, its parameter, and what limits it, if anything."""

    value: float
    orbit: PeriodicOrbit
    limit: str


def best_of(branches: Iterable[Branch]) -> Best | None:
    """Return the stable motion with the least |X| on some branches."""
    found = (
        Best(*best, branch.change_at(best.orbit))
        for branch in branches
        if (best := branch.best()) is not None
    )
    return min(found, key=lambda best: best.orbit.x_max, default=None)


def computed(work: Mapping[str, Callable[[], Series]]) -> dict[str, Series]:
    """Compute some series, each in a process; say when each is done."""
    begun = time.perf_counter()
    say(f'computing {len(work)} series')
    # The matrices are tiny: threads of a linear algebra library would only disturb
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    with ProcessPoolExecutor(mp_context=get_context('spawn')) as pool:
        found = {name: pool.submit(one) for name, one in work.items()}
        for name, future in found.items():
            future.result()
            say(f'  {name}: done after {time.perf_counter() - begun:.0f} s')
        return {name: future.result() for name, future in found.items()}


def near(orbit: PeriodicOrbit, share: float = 0.001) -> Rig:
    """
    Return a rig that is near a periodic motion, in the flight after its first impact.

    It started just before that impact, with the velocity of M off by a share of its amplitude.
    Just after the impact would be another motion where air drives m: no air acts before the first
    impact of a run. The phase of the force is that of the impact.
    """
    rig = orbit.parameters
    rate = rig.force_frequencies[0]
    phase = rig.force_phases[0] + rate * orbit.instants[0]
    half = 0.5 * rig.gap
    initial = InitialConditions(
        initial_primary_position=orbit.x[0],
        initial_primary_velocity=orbit.primary_velocity_before[0] + share * orbit.x_max * rate,
        initial_damper_offset=half if orbit.stops[0] == 1 else -half,
        initial_damper_velocity=orbit.damper_velocity_before[0],
    )
    rig = rig.replace(force_phases=(math.remainder(phase, math.tau),))
    run = Rig(rig, initial, compiled=None)
    run.advance(0.5 * orbit.durations[0])
    return run


def settled(rig: Rig, cycles: int = CYCLES) -> SettledMotion:
    """Run a rig until its motion repeats after at most four cycles."""
    return settle(rig, cycles=cycles, watch=50, longest=4)


def cycles_near(orbit: PeriodicOrbit) -> int:
    """Return for how many cycles a run near a stable motion may take to settle."""
    needed = 2.0 * math.log(1e-8) / math.log(max(abs(orbit.multipliers[0]), 0.5))
    return round(min(max(needed, 5.0 * CYCLES), MOST_CYCLES))


def same(one: SettledMotion, other: SettledMotion | PeriodicOrbit) -> bool:
    """Return whether a settled motion is another one; of irregular ones all count as the same."""
    pair = [motion.rhythm if isinstance(motion, SettledMotion) else motion
            for motion in (one, other)]  # fmt: skip
    if None in pair:
        return pair == [None, None]
    # Phases count from the start of a run: here from where the force is zero
    first, second = (
        replace(rhythm, phases=tuple(phase + late for phase in rhythm.phases))
        for rhythm, motion in zip(pair, (one, other), strict=True)
        for late in [motion.parameters.force_phases[0] / math.tau]
    )
    return first.distance(second) < REACHED


def settled_runs(
    rig: Callable[[float], RigParameters],
    values: Sequence[float],
    branches: Iterable[Branch],
    carried: bool = True,
) -> Iterator[tuple[float, SettledMotion]]:
    """
    Settle a rig at some values: from rest, and near each stable motion of the theory.

    If `carried`, also from the motions at the neighbouring values, up and down: this finds
    attractors that are not reached from rest.
    """
    found: dict[float, list[tuple[SettledMotion, Rig]]] = {value: [] for value in values}

    def take(value: float, run: Rig, cycles: int = CYCLES) -> None:
        motion = settled(run, cycles)
        if not any(same(motion, other) for other, _ in found[value]):
            found[value].append((motion, run))

    at_values = [branch.at(values) for branch in branches]
    for i, value in enumerate(values):
        take(value, Rig(rig(value), compiled=None))
        for orbit in (orbit for row in at_values for orbit in row[i]):
            if orbit.viable and orbit.stable:
                take(value, near(orbit), cycles_near(orbit))
    for order in (values, values[::-1]) if carried else ():
        for here, there in pairwise(order):
            for motion, run in list(found[here]):
                if motion.rhythm is not None:
                    copy = Rig.resume(run.state(), compiled=None)
                    phases = run.parameters.force_phases
                    copy.change(rig(there).replace(force_phases=phases))
                    take(there, copy)
    return ((value, motion) for value, row in found.items() for motion, _ in row)


def ratio(motion: PeriodicOrbit | SettledMotion) -> tuple[float, ...]:
    """Return the largest |X| over the displacement A without impacts."""
    return (motion.x_max / motion.parameters.response_amplitude,)


def durations(motion: PeriodicOrbit | SettledMotion) -> tuple[float, ...]:
    """Return the durations from impact to impact, in half-cycles of the force."""
    rhythm = motion.rhythm if isinstance(motion, SettledMotion) else motion
    if rhythm is None:
        return ()
    first = rhythm.phases[0]
    late = [(phase - first) % rhythm.cycles for phase in rhythm.phases]
    return tuple(2.0 * (b - a) for a, b in pairwise([*late, float(rhythm.cycles)]))


def performed(branch: Branch) -> bool:
    """Return whether a motion of a branch is stable and viable."""
    return any(status == 'stable' for status, _ in branch.parts())


def mirrored(stops: tuple[int, ...]) -> bool:
    """Return whether a stop sequence is the mirror image of one that is drawn."""

    def first(stops: tuple[int, ...]) -> tuple[int, ...]:
        return min(stops[i:] + stops[:i] for i in range(len(stops)))

    return first(stops) > first(tuple(3 - stop for stop in stops))


def draw(
    axes: Any,
    series: Series,
    look: tuple[str, str],
    impacts: int = 2,
    ordinate: Ordinate = ratio,
    width: float = 1.0,
) -> None:
    """
    Draw motions with some impacts in a cycle: solid where stable, dashed where unstable.

    On the level the curves of mirror images coincide, and are drawn once.
    """
    color, marker = look
    level = series.rig(series.low).angle == series.rig(series.high).angle == 0.0
    for branch in series.branches:
        stops = branch.orbits[0].stops
        if len(stops) != impacts or (level and mirrored(stops)):
            continue
        for status, part in branch.parts():
            if status != 'not viable':
                style = dict(STABLE if status == 'stable' else UNSTABLE)
                style['linewidth'] *= width
                rows = zip(*map(ordinate, branch.orbits[part]), strict=True)
                for row in rows:
                    axes.plot(branch.values[part], row, color=color, zorder=2, **style)
    marks = [
        (value, y)
        for value, motion in series.runs
        if motion.rhythm and motion.rhythm.cycles == 1 and motion.rhythm.impacts == impacts
        for y in ordinate(motion)
    ]
    if marks:
        look = MARKS | {'marker': marker, 'color': color, 'linestyle': 'none', 'zorder': 3}
        axes.plot(*zip(*marks, strict=True), **look)


def legend(place: Any, entries: Sequence[tuple[str, tuple[str, str]]], **where: Any) -> None:
    """Put a legend of series on a panel, or with the line styles below those of a figure."""
    lines = [
        Line2D([], [], color=color, marker=marker, label=label, linewidth=1.7, **MARKS)
        for label, (color, marker) in entries
    ]
    if 'loc' not in where:
        where = {'loc': 'outside lower center', **where}
        grey = {'color': '0.3'}
        lines += [
            Line2D([], [], label='theory, stable', **STABLE, **grey),
            Line2D([], [], label='theory, unstable', **UNSTABLE, **grey),
            Line2D([], [], label='simulation', marker='o', linestyle='none', **MARKS, **grey),
        ]
    place.legend(handles=lines, frameon='outside' not in where['loc'], edgecolor='none', **where)


def write_series(path: Path, series: Mapping[str, Series]) -> None:
    """Write the viable motions on all branches, their special points, and the settled runs."""

    def rows() -> Iterator[list[object]]:
        for name, one in series.items():
            for number, branch in enumerate(one.branches, 1):
                kinds = {id(special.orbit): special.kind.value for special in branch.special}
                for value, orbit in branch.points:
                    if orbit.viable:
                        kind = kinds.get(id(orbit), orbit.stability)
                        yield [name, number, *row_of(value, orbit, orbit.cycles, orbit.stops),
                               kind, abs(orbit.multipliers[0])]  # fmt: skip
            for value, motion in one.runs:
                rhythm = motion.rhythm
                if rhythm is not None and rhythm.impacts <= 8:
                    yield [name, '', *row_of(value, motion, rhythm.cycles, rhythm.stops),
                           'settled run', motion.multiplier]  # fmt: skip

    def row_of(value: float, motion: Any, cycles: int, stops: tuple[int, ...]) -> list[object]:
        lasts = ' '.join(f'{last:.6f}' for last in durations(motion))
        return [value, ''.join(map(str, stops)), cycles, *ratio(motion), lasts]

    head = ('series', 'branch', 'value', 'stops', 'cycles', 'xmax_over_a', 'durations', 'kind',
            'largest_multiplier')  # fmt: skip
    write_rows(path, head, rows())


def summary(series: Mapping[str, Series]) -> None:
    """Print where the motions of each series are stable, and what bounds them."""
    rows = []
    for name, one in series.items():
        sequences = sorted({branch.orbits[0].stops for branch in one.branches})
        for stops in sequences:
            ranges = one.stable_ranges(stops)
            if ranges:
                texts = (f'{low:.4f} to {high:.4f}' for low, high in ranges)
                rows.append([name, ''.join(map(str, stops)), '; '.join(texts)])
    show(('series', 'stops', 'stable'), rows)
