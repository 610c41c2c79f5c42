"""
The best rig of a sweep, on its grid and between its values; the summary of a sweep.

The best rig is often the last one before a motion ends, and the motion that it has need not be the
only one. So what lies around it is found too: edges beyond which the measure is far worse, and
other motions of the same rig.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.rig import InitialConditions

from .columns import FAILED, Row
from .plan import Axis, SweepPlan, Target, varied
from .table import SweepTable
from .work import Snapshot, rig_row

__all__ = [
    'Best',
    'Nearby',
    'Optimum',
    'attractor_text',
    'attractors_of',
    'caution_texts',
    'find_optimum',
    'summary_of',
    'summary_text',
]


#: Steps at the end of the search, relative to those of the grid, of motions that repeat and of
#: those that do not, whose measures scatter.
_FINEST, _FINEST_SCATTERED = 1e-4, 1.0 / 32.0
_MOST_TRIALS = 400
#: How often a measure that scatters is taken again.
_AGAIN = 4
#: How exact, relatively, the measures of a motion that repeats are.
_EXACT = 1e-9
#: What is worse by more than this part of the measure is beyond an edge.
_CLIFF = 0.5
#: Measures that differ by more than this, relatively, are of other motions.
_OTHER = 0.05
#: Where edges are looked for, in steps of the grid and as a part of the value, and how often what
#: lies between is halved.
_PROBES, _FAR = (1e-3, 0.1, 1.0), 0.05
_HALVINGS = 6
#: Kinds of parameters that can have any value in their range.
_REAL = ('double', 'double_array')


class Best(Enum):
    """What is looked for."""

    LEAST = 'least'
    GREATEST = 'greatest'


@dataclass(frozen=True)
class Nearby:
    """
    Another motion, of the best rig or of one next to it.

    Attributes
    ----------
    values : tuple of float
        Value of the rig on each axis.
    axis : int or None
        The axis along which it differs from the best rig; None if it is the best rig.
    start : str
        What the motion was reached from, in words.
    measure : float
        The measure of the motion.
    ratio : float
        The same over that of the best rig; not finite if that is 0.
    motion : str
        What kind of motion it is.
    period : int or None
        Its period in cycles of the force, if it repeats.
    stops : str or None
        Stops that it hits in a period.
    """

    values: tuple[float, ...]
    axis: int | None
    start: str
    measure: float
    ratio: float
    motion: str
    period: int | None
    stops: str | None


@dataclass(frozen=True)
class Optimum:
    """
    The rig with the least or greatest measure, among those whose motion repeats.

    Under gap control it is among all rigs, since no motion repeats to the last digits whose
    samples do not.

    Attributes
    ----------
    measure : str
        Name of the measure.
    best : Best
        What was looked for.
    point : int
        The best row of the table.
    grid_values : tuple of float
        Its value on each axis.
    grid_measure : float
        The measure there.
    values, value : tuple of float, float
        The same after a search between the values of the grid, from the motion of the best row;
        the same as there, if there is nothing to search or nothing better.
    scatter : float
        By how much the measure of the best row differs if it is taken again later, at most; 0 of
        a motion that repeats. What is better by less is not taken for better.
    at_edge : bool
        Whether it lies at the end of a range, so that a wider one may hold a better rig.
    trials : int
        Rigs run by the search.
    edges : tuple of Nearby
        Rigs next to it, the nearest on each side along each axis, with another motion whose
        measure is worse by half of it or more, if it goes on from the motion of the best rig or
        starts anew. With a search they are looked for up to the distance of the next value of the
        grid, or 5 % of the value (under gap control, which takes long, only there); else they are
        the next values of the grid.
    coexisting : tuple of Nearby
        Motions of the best rig with another measure, reached from its initial conditions, from
        the other direction, or back from beyond an edge.
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
        """Return it as numbers and texts."""
        return {**asdict(self), 'best': self.best.value}


def _step(axis: Axis, value: float) -> float:
    """Return how far it is from a value of an axis to the next; 0 if nothing lies between."""
    if axis.initial or not all(target.spec.kind in _REAL for target in axis.targets):
        return 0.0
    place = axis.values.index(value)
    near = axis.values[max(0, place - 1) : place + 2]
    return max((b - a for a, b in pairwise(near)), default=0.0)


def find_optimum(
    table: SweepTable,
    measure: str,
    best: Best = Best.LEAST,
    *,
    refine: bool = True,
    progress: Callable[[], object] | None = None,
) -> Optimum | None:
    """
    Find the best rig.

    Parameters
    ----------
    table : SweepTable
        The sweep.
    measure : str
        Name of a measure.
    best : Best, optional
        What to look for.
    refine : bool, optional
        Whether to search between the values of the grid, along the axes of numbers of rig and
        control; initial conditions, choices and whole numbers stay as they are in the best row.
        The search keeps to the motion of that row: each rig takes over its last state, that of
        the control included. It compares the measures at a step on either side along each axis,
        goes to the best of them, or halves the steps; it needs no slope, so that it also ends
        where the motion does.
    progress : callable, optional
        Called after each rig that the search runs.

    Returns
    -------
    Optimum or None
        None if no motion of the sweep repeats, or under control no rig could be simulated.
    """
    plan = table.plan
    eligible = table.flags('ok' if plan.control.active else 'settled')
    measures = np.where(eligible, table.numbers(measure), np.nan)
    if np.isnan(measures).all():
        return None
    sign = 1.0 if best is Best.LEAST else -1.0
    row = int(np.nanargmin(sign * measures))
    at, value = plan.point(row).values, float(measures[row])
    search = _Search(plan, at, measure, sign, settled=bool(table.flags('settled')[row]))
    search.progress = progress
    found, reached = at, value
    if refine and any(search.steps) and search.begin(table, row):
        search.look_again(at, value)
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


def _kind(nearby: Nearby) -> tuple[str, int | None, str | None]:
    return nearby.motion, nearby.period, nearby.stops


def _is_same(one: Nearby, other: Nearby) -> bool:
    """Return whether two motions of a rig are one; those that do not repeat scatter."""
    if _kind(one) != _kind(other):
        return False
    return one.period is None or abs(one.measure - other.measure) <= _OTHER * abs(other.measure)


def _ratio(measure: float, value: float) -> float:
    return measure / value if value else math.inf


def _other_directions(plan: SweepPlan, row: int) -> list[tuple[str, int]]:
    """Return the same rig in the other directions that were followed, with its row."""
    grid = plan.size // len(plan.follow.passes)
    own = plan.point(row).direction
    return [
        (f'followed {direction}wards', turn * grid + row % grid)
        for turn, direction in enumerate(plan.follow.passes)
        if direction != own
    ]


def _on_grid(
    table: SweepTable, row: int, measure: str, sign: float
) -> tuple[tuple[Nearby, ...], tuple[Nearby, ...]]:
    """Return edges and other motions that the table itself shows."""
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

    settled, own = table.flags('settled')[row], _kind(nearby(row, None, ''))
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
            if not settled or _kind(edge) != own:
                edges.append(edge)
        stride *= count
    others = [
        nearby(other, None, start)
        for start, other in _other_directions(plan, row)
        if abs(measures[other] - value) > _OTHER * abs(value)
    ]
    return tuple(edges[::-1]), tuple(others)


class _Search:
    """A search by steps along the axes, on one motion."""

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
        self.state: Snapshot | None = None
        self.progress: Callable[[], object] | None = None

    def begin(self, table: SweepTable, row: int) -> bool:
        """Bring the rig of a row back to its motion; return whether that is so."""
        self.state = self._state_of(table, row)
        return self.state is not None

    def _state_of(self, table: SweepTable, row: int) -> Snapshot | None:
        """Return a state of the motion of a row."""
        plan = self.plan
        if plan.control.active:
            stored: Snapshot | None = json.loads(table.texts('state')[row] or 'null')
            return stored
        if not table.lists('section_x')[row]:
            return None
        x, velocity, offset, relative = (
            table.lists(f'section_{name}')[row][-1]
            for name in ('x', 'velocity', 'offset', 'relative_velocity')
        )
        settings = plan.settings(plan.point(row))
        half = 0.5 * varied(plan.parameters, plan.initial, settings)[0].gap
        start = InitialConditions(
            initial_primary_position=x,
            initial_primary_velocity=velocity,
            # Z - X is off the stop by round-off
            initial_damper_offset=min(max(offset, -half), half),
            initial_damper_velocity=velocity + relative,
        )
        return rig_row(plan.parameters, start, settings, plan.settling)[1]

    def _run(self, values: tuple[float, ...]) -> tuple[float, Snapshot | None]:
        """Return the measure of a rig, as one to be least, and its last state."""
        row, last = self._row(values, self.state)
        if not row['ok'] or row['settled'] < self.settled or row[self.measure] is None:
            return math.inf, last
        return self.sign * float(row[self.measure]), last

    def _row(
        self, values: tuple[float, ...], state: Snapshot | None
    ) -> tuple[Row, Snapshot | None]:
        """Run a rig from a state, or from its initial conditions."""
        self.trials += 1
        plan = self.plan
        settings: list[tuple[Target, float]] = [
            (target, value)
            for axis, value in zip(plan.axes, values, strict=True)
            for target in axis.targets
        ]
        done = rig_row(
            *(plan.parameters, plan.initial, settings, plan.settling, state, plan.control)
        )
        if self.progress is not None:
            self.progress()
        return done

    def look_again(self, at: tuple[float, ...], value: float) -> None:
        """Learn by how much the measure scatters, from the rig as it goes on."""
        if self.settled:
            return
        begun = self.state
        for _ in range(_AGAIN):
            again, last = self._run(at)
            if last is None:
                break
            self.scatter = max(self.scatter, abs(again - self.sign * value))
            self.state = last
        self.state = begun

    def refined(self, at: tuple[float, ...], value: float) -> tuple[tuple[float, ...], float]:
        """Go down from a value of the grid."""
        here, lowest, share = at, self.sign * value, 0.5
        finest = _FINEST if self.settled else _FINEST_SCATTERED
        while share > finest and self.trials < _MOST_TRIALS:
            trials: list[tuple[float, tuple[float, ...]]] = []
            for i, axis in enumerate(self.plan.axes):
                for step in (-share * self.steps[i], share * self.steps[i]):
                    moved = min(max(here[i] + step, axis.values[0]), axis.values[-1])
                    if moved != here[i]:
                        place = (*here[:i], moved, *here[i + 1 :])
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
        """Return the edges around the best rig, and its other motions."""
        own, state = self._row(at, self.state)
        best = self._nearby(own, at, None, '', value)
        anew = self._nearby(self._row(at, None)[0], at, None, '', value)
        begun_as = [('from the motion of the best rig', state)]
        slow = self.plan.control.active
        if anew is not None and not slow and not _is_worse(anew.measure, value, self.sign):
            begun_as.append(('from the initial conditions', None))
        edges: list[Nearby] = []
        starts: list[tuple[str, Snapshot | None]] = [('from the initial conditions', None)]
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
        for start, begun in starts:
            nearby = self._nearby(self._row(at, begun)[0], at, None, start, value)
            if nearby is None or abs(nearby.measure - value) <= max(
                _OTHER * abs(value), self.scatter
            ):
                continue
            if not any(_is_same(nearby, other) for other in others):
                others.append(nearby)
        return tuple(edges), tuple(others)

    def _edge(
        self,
        at: tuple[float, ...],
        value: float,
        starts: list[tuple[str, Snapshot | None]],
        best: Nearby | None,
        i: int,
        step: float,
    ) -> tuple[Nearby, Snapshot | None] | None:
        """Return the nearest rig beyond an edge on one side along an axis, and its last state."""
        axis = self.plan.axes[i]

        def looked(distance: float) -> tuple[Nearby, Snapshot | None] | None:
            moved = min(max(at[i] + distance, axis.values[0]), axis.values[-1])
            if moved == at[i]:
                return None
            place = (*at[:i], moved, *at[i + 1 :])
            for start, begun in starts:
                row, last = self._row(place, begun)
                nearby = self._nearby(row, place, i, start, value)
                if nearby is None or not _is_worse(nearby.measure, value, self.sign):
                    continue
                if not self.settled or best is None or _kind(nearby) != _kind(best):
                    return nearby, last
            return None

        near = 0.0
        slow = self.plan.control.active
        distances = [share * step for share in (_PROBES[-1:] if slow else _PROBES)]
        if not slow:
            distances.append(math.copysign(max(abs(step), _FAR * abs(at[i])), step))
        for far in distances if step else ():
            found = looked(far) if far != near else None
            if found is None:
                near = far
                continue
            for _ in range(_HALVINGS if near else 0):
                middle = 0.5 * (near + far)
                nearer = looked(middle)
                if nearer is None:
                    near = middle
                else:
                    far, found = middle, nearer
            return found
        return None

    def _nearby(
        self, row: Row, values: tuple[float, ...], axis: int | None, start: str, value: float
    ) -> Nearby | None:
        """Return what a rig does; None if it could not be run."""
        if not row['ok'] or row[self.measure] is None:
            return None
        measure = float(row[self.measure])
        kind = (row['motion'], row['period'], row['stops'])
        return Nearby(values, axis, start, measure, _ratio(measure, value), *kind)


_MOST_SHOWN = 8


def attractors_of(table: SweepTable) -> list[dict[str, Any]]:
    """Return the attractors of a sweep of initial conditions, the one with most rows first."""
    if not all(axis.initial for axis in table.plan.axes):
        return []
    numbers = np.nan_to_num(table.numbers('attractor'), nan=FAILED).astype(int)
    motions, stops = table.texts('motion'), table.texts('stops')
    period, x_max, ratio = (table.numbers(name) for name in ('period', 'x_max', 'x_max_ratio'))
    found = []
    for number in range(numbers.max(initial=FAILED) + 1):
        rows = np.flatnonzero(numbers == number)
        first = int(rows[0])
        found.append(
            {
                'attractor': number,
                'motion': motions[first],
                'period': None if np.isnan(period[first]) else int(period[first]),
                'stops': stops[first],
                'share': len(rows) / len(numbers),
                'x_max': float(x_max[rows].mean()),
                'x_max_ratio': float(ratio[rows].mean()),
                'first_point': first,
            }
        )
    return found


def attractor_text(attractor: dict[str, Any]) -> str:
    """Return an attractor in words."""
    text = str(attractor['motion'])
    if attractor['period'] is not None:
        cycles = attractor['period']
        text += f', {cycles} cycle{"s" if cycles > 1 else ""}'
        if attractor['stops']:
            text += f', stops {attractor["stops"]}'
    return text


def caution_texts(optimum: Optimum, names: Sequence[str]) -> list[str]:
    """Return what an optimum is next to, and what else the best rig can do, each in words."""
    texts = []
    for edge in optimum.edges:
        assert edge.axis is not None
        best, there = optimum.values[edge.axis], edge.values[edge.axis]
        far = ''
        if best:
            percent = 100.0 * (there - best) / abs(best)
            far = f' ({abs(percent):.2g} % {"more" if percent > 0.0 else "less"})'
        texts.append(
            f'edge: at {names[edge.axis]} = {there:.6g}{far} {_as_much(edge, optimum.measure)}, '
            f'{edge.start}'
        )
    texts += [
        f'the same rig {other.start}: {_as_much(other, optimum.measure)}'
        for other in optimum.coexisting
    ]
    return texts


def _as_much(nearby: Nearby, measure: str) -> str:
    """Return the measure of another motion, and what motion it is."""
    times = f', {nearby.ratio:.3g} times as much' if 0.0 < nearby.ratio < math.inf else ''
    return f'{measure} is {nearby.measure:.5g}{times} ({attractor_text(vars(nearby))})'


def summary_of(table: SweepTable, optimum: Optimum | None) -> dict[str, Any]:
    """Return counts, attractors and optimum of a sweep."""
    ok = table.flags('ok')
    reasons = Counter(reason for reason in table.texts('reason') if reason is not None)
    return {
        'rigs': len(table),
        'failed': int((~ok).sum()),
        'reasons': dict(reasons.most_common(_MOST_SHOWN)),
        'motions': dict(Counter(m for m in table.texts('motion') if m is not None).most_common()),
        'attractors': attractors_of(table),
        'optimum': None
        if optimum is None
        else {
            **optimum.as_dict(),
            'names': [axis.name for axis in table.plan.axes],
            'cautions': caution_texts(optimum, [axis.name for axis in table.plan.axes]),
        },
    }


def summary_text(path: Path, summary: dict[str, Any]) -> str:
    """Return the same in words."""
    kinds = ', '.join(f'{count} {kind}' for kind, count in summary['motions'].items())
    failed = f'{summary["failed"]} failed' if summary['failed'] else ''
    lines = [f'{path}: {summary["rigs"]} rigs: {", ".join(p for p in (kinds, failed) if p)}']
    lines += [f'  {count} failed: {reason}' for reason, count in summary['reasons'].items()]
    attractors = summary['attractors']
    lines += [
        f'  attractor {one["attractor"]}: {one["share"]:.1%} of the starts, '
        f'{attractor_text(one)}, largest |X| {one["x_max"]:.6g} m'
        for one in attractors[:_MOST_SHOWN]
    ]
    if len(attractors) > _MOST_SHOWN:
        lines.append(f'  and {len(attractors) - _MOST_SHOWN} attractors more')
    optimum = summary['optimum']
    if optimum is not None and not attractors:
        at = ', '.join(
            f'{name} = {value:.7g}'
            for name, value in zip(optimum['names'], optimum['values'], strict=True)
        )
        edge = ', at the end of a range' if optimum['at_edge'] else ''
        scatter = f' +- {optimum["scatter"]:.1g}' if optimum['scatter'] else ''
        lines.append(
            f'  {optimum["best"]} {optimum["measure"]}: {optimum["value"]:.7g}{scatter} at '
            f'{at}{edge}'
        )
        lines += [f'    {caution}' for caution in optimum['cautions']]
    return '\n'.join(lines)
