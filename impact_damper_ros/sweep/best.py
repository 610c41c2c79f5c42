# SPDX-License-Identifier: Apache-2.0
"""
The best rig of a sweep: the best row, refined between the values of the grid.

It often lies next to the end of its branch, and may have other motions besides. So the
surroundings are searched, too: for edges beyond which the measure is far worse, and for other
motions of the same rig.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from .ensemble import rig_of_row
from .execution import State, rig_row
from .grid import Axis, Grid
from .journal import Row
from .table import check_measure, complete_table

if TYPE_CHECKING:
    import pandas as pd

#: Which value of a measure is best.
Best = Literal['least', 'greatest']
#: Steps of the grid at which the search ends, for motions that repeat and for those that do not,
#: whose measures scatter; and relative changes of a measure that are none.
_FINEST, _FINEST_SCATTERED, _FLAT = 1e-4, 1.0 / 32.0, 1e-6
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
_PROBES, _FAR, _BISECTIONS = (1e-3, 0.1, 1.0), 0.05, 6


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
    best : str
        Which value is best, least or greatest.
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


def find_optimum(
    table: pd.DataFrame,
    measure: str,
    best: Best = 'least',
    *,
    refine: bool = True,
    progress: Callable[[], object] = lambda: None,
) -> Optimum | None:
    """
    Find the best rig of a sweep.

    Parameters
    ----------
    table : pandas.DataFrame
        The table of the sweep.
    measure : str
        Name of a measure, one of `MEASURES`.
    best : {'least', 'greatest'}, optional
        Which value of it is best.
    refine : bool, optional
        Whether to search between the values of the grid.
    progress : callable, optional
        Called after each rig that the search runs.

    Returns
    -------
    Optimum or None
        None if no motion of the sweep repeats, or under control no rig could be simulated, or none
        has the measure.

    Raises
    ------
    ValueError
        If the measure is not known, or the table is not that of a whole sweep.

    Notes
    -----
    The search varies parameters that are real numbers; initial conditions, flags and whole numbers
    stay as in the best row. It stays on the motion of that row: each rig takes over its last
    state, that of the control included. It is that of Nelder and Mead (`scipy.optimize.minimize`),
    which uses no slope, so that it also ends where the motion ends.
    """
    check_measure(measure)
    if best not in get_args(Best):
        raise ValueError(f'best is {best!r}: give one of {", ".join(get_args(Best))}')
    table = complete_table(table)
    controlled = Grid.from_inputs(table.attrs['inputs']).setup.control.active
    eligible = table['ok' if controlled else 'settled'].fillna(False).astype(bool)
    measures = table[measure].astype(float).where(eligible)
    if measures.isna().all():
        return None
    sign = 1.0 if best == 'least' else -1.0
    row = int((sign * measures).idxmin())
    search = _Search(table, row, measure, sign, progress)
    at, value = search.at, search.value
    if refine and any(search.steps) and search.state is not None:
        search.measure_scatter()
        search.refine()
        edges, coexisting = search.surroundings()
    else:
        edges, coexisting = search.on_grid()
    edge = any(
        len(axis) > 1 and place in (axis.values[0], axis.values[-1])
        for axis, place in zip(search.grid.axes, search.at, strict=True)
    )
    return Optimum(
        *(measure, best, row, at, value, search.at, search.value, search.scatter, edge),
        *(search.trials, tuple(edges), tuple(coexisting)),
    )


def _step(axis: Axis, value: float) -> float:
    """Return the distance to the next value of an axis; 0 if no values lie between."""
    place = axis.values.index(value)
    near = axis.values[max(0, place - 1) : place + 2]
    return float(max(np.diff(near), default=0.0)) if axis.real else 0.0


class _Search:
    """A search along the axes, on one motion."""

    def __init__(
        self,
        table: pd.DataFrame,
        row: int,
        measure: str,
        sign: float,
        progress: Callable[[], object],
    ) -> None:
        self.grid = Grid.from_inputs(table.attrs['inputs'])
        self.table, self.row, self.measure, self.sign = table, row, measure, sign
        self.progress = progress
        self.settled = bool(table.settled[row])
        self.slow = self.grid.setup.control.active
        #: Where the search is, and the measure there.
        self.at = self.grid.values(row)
        self.value = float(table[measure][row])
        self.steps = [_step(axis, v) for axis, v in zip(self.grid.axes, self.at, strict=True)]
        self.trials, self.scatter = 0, 0.0
        self.state = self._state_of(row)

    def _state_of(self, row: int) -> State | None:
        """Return a state of the motion of a row."""
        if self.slow:
            text = self.table.state[row]
            return json.loads(text) if isinstance(text, str) else None
        if not self.table.ok[row]:
            return None
        setup = self.grid.setup.vary(self.grid.settings(self.grid.values(row)))
        return rig_of_row(self.table.loc[row], setup.parameters).snapshot()

    def _run(self, values: tuple[float, ...], state: State | None) -> tuple[Row, State | None]:
        """Run a rig from a state, or from its initial conditions."""
        self.trials += 1
        done = rig_row(self.grid.setup.vary(self.grid.settings(values)), state)
        self.progress()
        return done

    def _cost(self, row: Row) -> float:
        """Return the measure of a rig, negated if the greatest is best."""
        if not row['ok'] or row['settled'] < self.settled or row[self.measure] is None:
            return math.inf
        return self.sign * float(row[self.measure])

    def measure_scatter(self) -> None:
        """Measure the scatter of the measure of a motion that does not repeat, as it goes on."""
        state = self.state
        for _ in range(0 if self.settled else _REPETITIONS):
            row, state = self._run(self.at, state)
            if state is None:
                break
            self.scatter = max(self.scatter, abs(self._cost(row) - self.sign * self.value))

    def refine(self) -> None:
        """Search between the values of the grid."""
        from scipy.optimize import minimize

        axes, at, lowest = self.grid.axes, self.at, self.sign * self.value
        free = [i for i, step in enumerate(self.steps) if step]

        def values(place: Any) -> tuple[float, ...]:
            found = list(at)
            for i, share in zip(free, place, strict=True):
                low, high = axes[i].values[0], axes[i].values[-1]
                found[i] = min(max(at[i] + float(share) * self.steps[i], low), high)
            return tuple(found)

        corners = np.zeros((len(free) + 1, len(free)))
        for k, i in enumerate(free):
            corners[k + 1, k] = 0.5 if at[i] < axes[i].values[-1] else -0.5
        bounds = [
            tuple((end - at[i]) / self.steps[i] for end in (axes[i].values[0], axes[i].values[-1]))
            for i in free
        ]
        found = minimize(
            lambda place: self._cost(self._run(values(place), self.state)[0]),
            np.zeros(len(free)),
            method='Nelder-Mead',
            bounds=bounds,
            options={
                'initial_simplex': corners,
                'xatol': _FINEST if self.settled else _FINEST_SCATTERED,
                'fatol': max(self.scatter, _FLAT * abs(lowest)),
                'maxfev': _MOST_TRIALS,
            },
        )
        if found.fun < lowest - max(self.scatter, _EXACT * abs(lowest)):
            self.at, self.value = values(found.x), self.sign * float(found.fun)

    def _nearby(
        self, row: Mapping[Any, Any], values: tuple[float, ...], axis: int | None, start: str
    ) -> Nearby | None:
        """Return the motion of a rig; None if it could not be run."""
        import pandas as pd

        if not row['ok'] or pd.isna(row[self.measure]):
            return None
        measure = float(row[self.measure])
        repeats = bool(row['settled'])
        return Nearby(
            *(values, axis, start, measure, measure / self.value if self.value else math.inf),
            row['motion'],
            int(row['period']) if repeats else None,
            row['stops'] if repeats else None,
        )

    def _is_worse(self, nearby: Nearby) -> bool:
        return self.sign * (nearby.measure - self.value) > _CLIFF * abs(self.value)

    def _turns(self) -> list[tuple[str, int]]:
        """Return the rows of the same rig in the other directions that were followed."""
        places = math.prod(self.grid.shape)
        return [
            (f'followed {direction}wards', turn * places + self.row % places)
            for turn, direction in enumerate(self.grid.directions)
            if turn != self.row // places
        ]

    def on_grid(self) -> tuple[list[Nearby], list[Nearby]]:
        """Return the edges and other motions that the table itself shows."""

        def at(row: int, axis: int | None, start: str) -> Nearby | None:
            return self._nearby(self.table.loc[row], self.grid.values(row), axis, start)

        own = at(self.row, None, '')
        edges = []
        stride = math.prod(self.grid.shape)
        for i, count in enumerate(self.grid.shape):
            stride //= count
            place = self.row // stride % count
            for step in (-1, 1):
                if 0 <= place + step < count:
                    edge = at(self.row + step * stride, i, 'at the next value of the grid')
                    other = not self.settled or (edge and own and edge.kind != own.kind)
                    if edge and self._is_worse(edge) and other:
                        edges.append(edge)
        others = [at(row, None, start) for start, row in self._turns()]
        least = _OTHER * abs(self.value)
        return edges, [o for o in others if o and abs(o.measure - self.value) > least]

    def surroundings(self) -> tuple[list[Nearby], list[Nearby]]:
        """Return the edges around the best rig, and other motions of it."""
        own, state = self._run(self.at, self.state)
        best = self._nearby(own, self.at, None, '')
        begun = [('from the motion of the best rig', state)]
        anew = self._nearby(self._run(self.at, None)[0], self.at, None, '')
        if anew is not None and not self.slow and not self._is_worse(anew):
            begun.append(('from the initial conditions', None))
        starts: list[tuple[str, State | None]] = [('from the initial conditions', None)]
        starts += [(s, there) for s, row in self._turns() if (there := self._state_of(row))]
        edges = []
        for i, axis in enumerate(self.grid.axes):
            for step in (-self.steps[i], self.steps[i]):
                found = self._edge(begun, best, i, step) if step else None
                if found is not None:
                    edges.append(found[0])
                    place = found[0].values[i]
                    starts.append((f'back from {axis.name} = {place:.6g}', found[1]))
        others: list[Nearby] = []
        for start, there in starts:
            other = self._nearby(self._run(self.at, there)[0], self.at, None, start)
            least = max(_OTHER * abs(self.value), self.scatter)
            if other is None or abs(other.measure - self.value) <= least:
                continue
            # Measures of motions that do not repeat scatter
            if not any(
                one.kind == other.kind
                and (
                    one.period is None or math.isclose(one.measure, other.measure, rel_tol=_OTHER)
                )
                for one in others
            ):
                others.append(other)
        return edges, others

    def _edge(
        self, starts: list[tuple[str, State | None]], best: Nearby | None, i: int, step: float
    ) -> tuple[Nearby, State | None] | None:
        """Return the nearest rig beyond an edge on one side along an axis, and its last state."""
        axis = self.grid.axes[i]

        def beyond(distance: float) -> tuple[Nearby, State | None] | None:
            moved = min(max(self.at[i] + distance, axis.values[0]), axis.values[-1])
            place = (*self.at[:i], moved, *self.at[i + 1 :])
            for start, begun in starts if place != self.at else ():
                row, last = self._run(place, begun)
                nearby = self._nearby(row, place, i, start)
                if nearby is None or not self._is_worse(nearby):
                    continue
                if not self.settled or best is None or nearby.kind != best.kind:
                    return nearby, last
            return None

        distances = [share * step for share in (_PROBES[-1:] if self.slow else _PROBES)]
        if not self.slow and abs(step) < _FAR * abs(self.at[i]):
            distances.append(math.copysign(_FAR * self.at[i], step))
        near = 0.0
        for far in distances:
            found = beyond(far)
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
