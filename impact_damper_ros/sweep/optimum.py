"""
The optimum of a sweep: the best row, refined between the values of the grid.

The best rig often lies next to the end of its branch, and may have other motions besides. So the
surroundings are searched, too: for edges beyond which the measure is far worse, and for other
motions of the same rig.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np

from impact_damper_ros.rig import InitialConditions

from .execution import rig_row
from .plan import Axis, SweepPlan
from .table import Row, SweepTable, check_measure

_State = dict[str, Any]
#: Relative steps at which the search ends, of motions that repeat and of those that do not, whose
#: measures scatter.
_FINEST, _FINEST_SCATTERED = 1e-4, 1.0 / 32.0
_MOST_TRIALS = 400
#: Number of further runs for a measure that scatters.
_REPETITIONS = 4
#: Relative accuracy of the measures of a motion that repeats.
_EXACT = 1e-9
#: A rig is beyond an edge if its measure is worse by more than this share.
_CLIFF = 0.5
#: Measures that differ by more than this share belong to different motions.
_OTHER = 0.05
#: Distances at which edges are searched for, in steps of the grid and as a share of the value, and
#: the bisections in between.
_PROBES, _FAR = (1e-3, 0.1, 1.0), 0.05
_BISECTIONS = 6
#: Kinds of parameters that can take any value in their range.
_REAL = ('double', 'double_array')


class Best(Enum):
    """Which value of a measure is best."""

    LEAST = 'least'
    GREATEST = 'greatest'


@dataclass(frozen=True)
class Nearby:
    """A different motion, of the best rig or of one next to it."""

    values: tuple[float, ...]  # value of the rig on each axis
    #: The axis along which it differs from the best rig; None if it is the best rig.
    axis: int | None
    start: str  # how the motion was reached, in words
    measure: float
    ratio: float  # of its measure over that of the best rig; infinite if that is 0
    motion: str  # kind of motion
    period: int | None  # its period in cycles of the force, if it repeats
    stops: str | None  # stops hit in a period

    @property
    def kind(self) -> tuple[str, int | None, str | None]:
        """Kind, period and stops of the motion."""
        return self.motion, self.period, self.stops


@dataclass(frozen=True)
class Optimum:
    """
    The rig with the least or greatest measure, among those whose motion repeats.

    Under gap control all rigs are considered, since a motion whose control samples out of step
    does not repeat to the last digits.

    Attributes
    ----------
    measure : str
        Name of the measure.
    best : Best
        Which value is best.
    point : int
        The best row of the table.
    grid_values : tuple of float
        Its value on each axis.
    grid_measure : float
        Its measure.
    values, value : tuple of float, float
        Values on the axes and measure after the search between the values of the grid; those of
        the grid if there was no search or it found nothing better.
    scatter : float
        Largest change of the measure of the best row if it is taken again later; 0 if its motion
        repeats. A change within the scatter is no improvement.
    at_edge : bool
        Whether the rig lies at the end of a range, so that a wider one may hold a better rig.
    trials : int
        Rigs run by the search.
    edges : tuple of Nearby
        The nearest rig on each side along each axis whose motion is different and whose measure is
        worse by half or more, continued from the motion of the best rig or started from the
        initial conditions. The search extends to the next value of the grid or 5 % of the value;
        without a search, and under gap control, only the next value is considered.
    coexisting : tuple of Nearby
        Motions of the best rig with a different measure: from its initial conditions, from the
        other direction, or back from beyond an edge.
    """

    measure: str
    best: Best
    point: int
    grid_values: tuple[float, ...]
    grid_measure: float
    values: tuple[float, ...]
    value: float
    scatter: float
    at_edge: bool
    trials: int
    edges: tuple[Nearby, ...] = ()
    coexisting: tuple[Nearby, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the optimum for JSON."""
        return {**asdict(self), 'best': self.best.value}


def _step(axis: Axis, value: float) -> float:
    """Return the distance to the next value of an axis; 0 if no values lie between."""
    if axis.initial or not all(p.spec.kind in _REAL for p in axis.parameters):
        return 0.0
    place = axis.values.index(value)
    near = axis.values[max(0, place - 1) : place + 2]
    return max((b - a for a, b in pairwise(near)), default=0.0)


def _moved(axis: Axis, i: int, values: tuple[float, ...], distance: float) -> tuple[float, ...]:
    """Return values moved along the i-th axis, within its range."""
    moved = min(max(values[i] + distance, axis.values[0]), axis.values[-1])
    return (*values[:i], moved, *values[i + 1 :])


def find_optimum(
    table: SweepTable,
    measure: str,
    best: Best = Best.LEAST,
    *,
    refine: bool = True,
    progress: Callable[[], object] | None = None,
) -> Optimum | None:
    """
    Find the best rig of a sweep.

    Parameters
    ----------
    table : SweepTable
        The sweep.
    measure : str
        Name of a measure, one of `MEASURES`.
    best : Best, optional
        Which value of it is best.
    refine : bool, optional
        Whether to search between the values of the grid.
    progress : callable, optional
        Called after each rig that the search runs.

    Returns
    -------
    Optimum or None
        None if no motion of the sweep repeats, or under control no rig could be simulated.

    Notes
    -----
    The search varies parameters that are real numbers; initial conditions, flags and whole numbers
    stay as in the best row. It stays on the motion of that row: each rig takes over its last
    state, that of the control included. It is a pattern search: the measures one step away on
    either side along each axis are compared, then the search moves to the best of them, or halves
    the steps. It uses no slope, so that it also ends where the motion ends.
    """
    check_measure(measure)
    plan = table.plan
    eligible = table.flags('ok' if plan.control.active else 'settled')
    measures = np.where(eligible, table.numbers(measure), np.nan)
    if np.isnan(measures).all():
        return None
    sign = 1.0 if best is Best.LEAST else -1.0
    row = int(np.nanargmin(sign * measures))
    at, value = plan.point(row).values, float(measures[row])
    search = _PatternSearch(plan, at, measure, sign, settled=bool(table.flags('settled')[row]))
    search.progress = progress
    found, reached = at, value
    if refine and any(search.steps) and search.begin(table, row):
        search.measure_scatter(at, value)
        found, reached = search.refined(at, value)
        edges, coexisting = search.surroundings(table, row, found, reached)
    else:
        edges, coexisting = _on_grid(table, row, measure, sign)
    edge = any(
        len(axis) > 1 and place in (axis.values[0], axis.values[-1])
        for axis, place in zip(plan.axes, found, strict=True)
    )
    return Optimum(
        *(measure, best, row, at, value, found, reached, search.scatter, edge, search.trials),
        edges=edges,
        coexisting=coexisting,
    )


def _is_worse(measure: float, value: float, sign: float) -> bool:
    return sign * (measure - value) > _CLIFF * abs(value)


def _is_same(one: Nearby, other: Nearby) -> bool:
    """Return whether two motions of a rig are one; measures scatter if they do not repeat."""
    if one.kind != other.kind:
        return False
    return one.period is None or abs(one.measure - other.measure) <= _OTHER * abs(other.measure)


def _ratio(measure: float, value: float) -> float:
    return measure / value if value else math.inf


def _other_directions(plan: SweepPlan, row: int) -> list[tuple[str, int]]:
    """Return the rows of the same rig in the other directions that were followed."""
    grid = plan.size // len(plan.follow.directions)
    own = plan.point(row).direction
    return [
        (f'followed {direction}wards', turn * grid + row % grid)
        for turn, direction in enumerate(plan.follow.directions)
        if direction != own
    ]


def _on_grid(
    table: SweepTable, row: int, measure: str, sign: float
) -> tuple[tuple[Nearby, ...], tuple[Nearby, ...]]:
    """Return the edges and other motions that the table itself shows."""
    plan = table.plan
    measures, motions = table.numbers(measure), table.texts('motion')
    periods, stops = table.numbers('period'), table.texts('stops')
    value = float(measures[row])

    def nearby(other: int, axis: int | None, start: str) -> Nearby:
        period = None if np.isnan(periods[other]) else int(periods[other])
        x = float(measures[other])
        values = plan.point(other).values
        motion = motions[other] or ''
        return Nearby(values, axis, start, x, _ratio(x, value), motion, period, stops[other])

    settled, own = table.flags('settled')[row], nearby(row, None, '').kind
    edges = []
    stride = 1
    for i in reversed(range(len(plan.axes))):
        count = plan.shape[i]
        place = row // stride % count
        for step in (-1, 1):
            other = row + step * stride
            if not 0 <= place + step < count or not _is_worse(measures[other], value, sign):
                continue
            edge = nearby(other, i, 'at the next value of the grid')
            if not settled or edge.kind != own:
                edges.append(edge)
        stride *= count
    others = [
        nearby(other, None, start)
        for start, other in _other_directions(plan, row)
        if abs(measures[other] - value) > _OTHER * abs(value)
    ]
    return tuple(edges[::-1]), tuple(others)


class _PatternSearch:
    """A pattern search along the axes, on one motion."""

    def __init__(
        self,
        plan: SweepPlan,
        at: tuple[float, ...],
        measure: str,
        sign: float,
        *,
        settled: bool,
    ) -> None:
        self.plan = plan
        self.measure = measure
        self.sign = sign
        self.settled = settled
        self.steps = [_step(axis, value) for axis, value in zip(plan.axes, at, strict=True)]
        self.trials = 0
        self.scatter = 0.0
        self.state: _State | None = None
        self.progress: Callable[[], object] | None = None

    def begin(self, table: SweepTable, row: int) -> bool:
        """Run the rig of a row until it has its motion again; return whether that succeeded."""
        self.state = self._state_of(table, row)
        return self.state is not None

    def _state_of(self, table: SweepTable, row: int) -> _State | None:
        """Return a state of the motion of a row."""
        plan = self.plan
        if plan.control.active:
            stored: _State | None = json.loads(table.texts('state')[row] or 'null')
            return stored
        if not table.lists('section_x')[row]:
            return None
        x, velocity, offset, relative = (
            table.lists(f'section_{name}')[row][-1]
            for name in ('x', 'velocity', 'offset', 'relative_velocity')
        )
        settings = plan.settings(plan.point(row).values)
        half = 0.5 * plan.setup.varied(settings).parameters.gap
        start = InitialConditions(
            initial_primary_position=x,
            initial_primary_velocity=velocity,
            # Round-off may put m beyond a stop
            initial_damper_offset=min(max(offset, -half), half),
            initial_damper_velocity=velocity + relative,
        )
        return rig_row(plan.setup._replace(initial=start), settings)[1]

    def _run(self, values: tuple[float, ...]) -> tuple[float, _State | None]:
        """Return the measure of a rig, negated if the greatest is best, and its last state."""
        row, last = self._row(values, self.state)
        if not row['ok'] or row['settled'] < self.settled or row[self.measure] is None:
            return math.inf, last
        return self.sign * float(row[self.measure]), last

    def _row(self, values: tuple[float, ...], state: _State | None) -> tuple[Row, _State | None]:
        """Run a rig from a state, or from its initial conditions."""
        self.trials += 1
        done = rig_row(self.plan.setup, self.plan.settings(values), state)
        if self.progress is not None:
            self.progress()
        return done

    def measure_scatter(self, at: tuple[float, ...], value: float) -> None:
        """Measure the scatter of the measure as the rig continues."""
        if self.settled:
            return
        begun = self.state
        for _ in range(_REPETITIONS):
            again, last = self._run(at)
            if last is None:
                break
            self.scatter = max(self.scatter, abs(again - self.sign * value))
            self.state = last
        self.state = begun

    def refined(self, at: tuple[float, ...], value: float) -> tuple[tuple[float, ...], float]:
        """Return the best values and their measure, starting from those of the grid."""
        here, lowest, share = at, self.sign * value, 0.5
        finest = _FINEST if self.settled else _FINEST_SCATTERED
        while share > finest and self.trials < _MOST_TRIALS:
            trials: list[tuple[float, tuple[float, ...]]] = []
            for i, axis in enumerate(self.plan.axes):
                for step in (-share * self.steps[i], share * self.steps[i]):
                    place = _moved(axis, i, here, step)
                    if place != here:
                        trials.append((self._run(place)[0], place))
            found, place = min(trials, default=(math.inf, here))
            if found < lowest - max(self.scatter, _EXACT * abs(lowest)):
                here, lowest = place, found
            else:
                share *= 0.5
        return here, self.sign * lowest

    def surroundings(
        self, table: SweepTable, row: int, at: tuple[float, ...], value: float
    ) -> tuple[tuple[Nearby, ...], tuple[Nearby, ...]]:
        """Return the edges around the best rig, and other motions of it."""
        own, state = self._row(at, self.state)
        best = self._nearby(own, at, None, '', value)
        anew = self._nearby(self._row(at, None)[0], at, None, '', value)
        begun_as = [('from the motion of the best rig', state)]
        slow = self.plan.control.active
        if anew is not None and not slow and not _is_worse(anew.measure, value, self.sign):
            begun_as.append(('from the initial conditions', None))
        edges: list[Nearby] = []
        starts: list[tuple[str, _State | None]] = [('from the initial conditions', None)]
        for start, other in _other_directions(self.plan, row):
            if (of_other := self._state_of(table, other)) is not None:
                starts.append((start, of_other))
        for i, axis in enumerate(self.plan.axes):
            for sign in (-1.0, 1.0):
                found = self._edge(at, value, begun_as, best, i, sign * self.steps[i])
                if found is not None:
                    edges.append(found[0])
                    place = found[0].values[i]
                    starts.append((f'back from {axis.name} = {place:.6g}', found[1]))
        others: list[Nearby] = []
        least = max(_OTHER * abs(value), self.scatter)
        for start, begun in starts:
            nearby = self._nearby(self._row(at, begun)[0], at, None, start, value)
            if nearby is None or abs(nearby.measure - value) <= least:
                continue
            if not any(_is_same(nearby, other) for other in others):
                others.append(nearby)
        return tuple(edges), tuple(others)

    def _edge(
        self,
        at: tuple[float, ...],
        value: float,
        starts: list[tuple[str, _State | None]],
        best: Nearby | None,
        i: int,
        step: float,
    ) -> tuple[Nearby, _State | None] | None:
        """Return the nearest rig beyond an edge on one side along an axis, and its last state."""
        axis = self.plan.axes[i]

        def beyond(distance: float) -> tuple[Nearby, _State | None] | None:
            place = _moved(axis, i, at, distance)
            for start, begun in starts if place != at else ():
                row, last = self._row(place, begun)
                nearby = self._nearby(row, place, i, start, value)
                if nearby is None or not _is_worse(nearby.measure, value, self.sign):
                    continue
                if not self.settled or best is None or nearby.kind != best.kind:
                    return nearby, last
            return None

        near = 0.0
        slow = self.plan.control.active
        distances = [share * step for share in (_PROBES[-1:] if slow else _PROBES)]
        if not slow:
            distances.append(math.copysign(max(abs(step), _FAR * abs(at[i])), step))
        for far in distances if step else ():
            found = beyond(far) if far != near else None
            if found is None:
                near = far
                continue
            for _ in range(_BISECTIONS if near else 0):
                middle = 0.5 * (near + far)
                nearer = beyond(middle)
                if nearer is None:
                    near = middle
                else:
                    far, found = middle, nearer
            return found
        return None

    def _nearby(
        self, row: Row, values: tuple[float, ...], axis: int | None, start: str, value: float
    ) -> Nearby | None:
        """Return the motion of a rig; None if it could not be run."""
        if not row['ok'] or row[self.measure] is None:
            return None
        measure = float(row[self.measure])
        kind = (row['motion'], row['period'], row['stops'])
        return Nearby(values, axis, start, measure, _ratio(measure, value), *kind)
