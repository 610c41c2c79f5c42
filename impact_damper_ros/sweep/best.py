# SPDX-License-Identifier: Apache-2.0
"""The best rig of a sweep: its best rows, refined between the values of the grid."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from impact_damper_ros.orbits.arguments import OrbitError
from impact_damper_ros.orbits.continuation import follow

from .branches import MOST_IMPACTS, orbit_of_row, path_along
from .execution import rig_row
from .grid import Axis, Grid
from .part_file import State
from .steady_state import Row, rig_of_row
from .table import check_measure, complete_table

if TYPE_CHECKING:
    import pandas as pd

#: Which value of a measure is best.
Best = Literal['least', 'greatest']
#: How the motion of the best rig was reached.
ANEW, FOLLOWED = 'from the initial conditions', 'from the motion of a rig nearby'
#: Steps of the grid at which the search ends, for motions that repeat and for those that do not,
#: whose measures scatter; and relative changes of a measure that are none.
_FINEST, _FINEST_SCATTERED, _FLAT = 1e-4, 1.0 / 32.0, 1e-6
_MOST_TRIALS = 400
#: Rows from which the search starts: so many at most, no worse than the best by this share.
_MOST_STARTS, _NEAR = 3, 0.1
#: Number of further runs for a measure that scatters.
_REPETITIONS = 4


@dataclass(frozen=True)
class Edge:
    """
    Where a motion is lost as one parameter varies.

    Attributes
    ----------
    axis : int
        Number of the axis.
    value : float
        The value up to which the motion is kept.
    reason : str
        What happens there.
    """

    axis: int
    value: float
    reason: str


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
        Values on the axes and measure of the best rig that was run; those of the grid if the
        search found nothing better.
    start : str
        How its motion was reached: from its initial conditions, or from the motion of a rig
        nearby.
    anew : float or None
        The measure of the same rig from its initial conditions; None if it was not run from them.
    scatter : float
        Largest change of the measure of the best row if it is taken again later; 0 if its motion
        repeats. A change within the scatter is no improvement.
    at_edge : bool
        Whether the rig lies at the end of a range, so that a wider one may hold a better rig.
    trials : int
        Rigs run by the search.
    edges : tuple of Edge
        How far each parameter may vary within its range before the motion is lost, by `follow`;
        none under gap control, without impacts, and where the motion does not repeat.
    """

    measure: str
    best: Best
    point: int
    grid_values: tuple[float, ...]
    grid_measure: float
    values: tuple[float, ...]
    value: float
    start: str
    anew: float | None
    scatter: float
    at_edge: bool
    trials: int
    edges: tuple[Edge, ...] = ()


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
        Whether to search between the values of the grid, and for the edges of the motion.
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
    The search is that of Nelder and Mead (`scipy.optimize.minimize`), from up to three of the best
    rows. It varies parameters that are real numbers; initial conditions, flags and whole numbers
    stay as in the row. Each rig is run from its initial conditions and from the best motion so
    far, the state of the control included. The result is the best of all rigs that were run.
    """
    check_measure(measure)
    if best not in get_args(Best):
        raise ValueError(f'best is {best!r}: give one of {", ".join(get_args(Best))}')
    table = complete_table(table)
    grid = Grid.from_inputs(table.attrs['inputs'])
    controlled = grid.setup.control.active
    eligible = table['ok' if controlled else 'settled'].fillna(False).astype(bool)
    sign = 1.0 if best == 'least' else -1.0
    costs = sign * table[measure].astype(float).where(eligible)
    if costs.isna().all():
        return None
    starts = _starts(grid, costs) if refine else [int(costs.idxmin())]
    searches = [_Search(grid, table, row, measure, sign, progress) for row in starts]
    if refine:
        for search in searches:
            search.refine()
    found = min(searches, key=lambda search: search.cost)
    return Optimum(
        measure=measure,
        best=best,
        point=starts[0],
        grid_values=grid.values(starts[0]),
        grid_measure=float(table[measure][starts[0]]),
        values=found.values,
        value=sign * found.cost,
        start=found.start,
        anew=found.anew,
        scatter=found.scatter,
        at_edge=any(
            len(axis) > 1 and place in (axis.values[0], axis.values[-1])
            for axis, place in zip(grid.axes, found.values, strict=True)
        ),
        trials=sum(search.trials for search in searches),
        edges=found.edges() if refine else (),
    )


def _starts(grid: Grid, costs: pd.Series[float]) -> list[int]:
    """Return the rows to start from: the best one, and others as good that are not next to it."""
    least = float(costs.min())
    found: list[int] = []
    places: list[Any] = []
    for row in costs.sort_values(kind='stable').index:
        if not costs[row] <= least + _NEAR * abs(least) or len(found) == _MOST_STARTS:
            break
        place = np.array(np.unravel_index(row % math.prod(grid.shape), grid.shape))
        if all(np.abs(place - other).max() > 1 for other in places):
            found.append(int(row))
            places.append(place)
    return found


def _step(axis: Axis, value: float) -> float:
    """Return the distance to the next value of an axis; 0 if no values lie between."""
    place = axis.values.index(value)
    near = axis.values[max(0, place - 1) : place + 2]
    return float(max(np.diff(near), default=0.0)) if axis.real else 0.0


class _Search:
    """A search along the axes from one row, and the best rig that it has run."""

    def __init__(
        self,
        grid: Grid,
        table: pd.DataFrame,
        row: int,
        measure: str,
        sign: float,
        progress: Callable[[], object],
    ) -> None:
        self.grid, self.measure, self.sign, self.progress = grid, measure, sign, progress
        self.trials, self.scatter = 0, 0.0
        self.values = grid.values(row)
        self.row: Any = table.loc[row]
        self.cost = sign * float(self.row[measure])
        self.start = ANEW if grid.follow == 'none' else FOLLOWED
        self.anew = float(self.row[measure]) if grid.follow == 'none' else None
        self.settled = bool(self.row.settled)
        self.state = self._state()

    def _state(self) -> State | None:
        """Return a state of the motion of the row from which the search starts."""
        if self.grid.setup.control.active:
            return json.loads(self.row.state) if isinstance(self.row.state, str) else None
        setup = self.grid.setup.vary(self.grid.settings(self.values))
        return rig_of_row(self.row, setup.parameters).snapshot()

    def _run(self, values: tuple[float, ...], state: State | None) -> tuple[Row, State | None]:
        self.trials += 1
        done = rig_row(self.grid.setup, self.grid.settings(values), state)
        self.progress()
        return done

    def _cost(self, row: Row) -> float:
        """Return the measure of a rig, negated if the greatest is best."""
        if not row['ok'] or row['settled'] < self.settled or row[self.measure] is None:
            return math.inf
        return self.sign * float(row[self.measure])

    def _trial(self, values: tuple[float, ...]) -> float:
        """Run a rig from its initial conditions and from the best motion; return its cost."""
        runs = [
            (start, *self._run(values, s)) for start, s in ((ANEW, None), (FOLLOWED, self.state))
        ]
        anew, least = runs[0][1], math.inf
        for start, row, last in runs:
            cost = self._cost(row)
            least = min(least, cost)
            if cost < self.cost - self.scatter:
                self.values, self.cost, self.start = values, cost, start
                self.row, self.state = SimpleNamespace(**row), last
                self.anew = float(anew[self.measure]) if anew['ok'] else None
        return least

    def refine(self) -> None:
        """Search between the values of the grid."""
        from scipy.optimize import minimize

        axes, at, state = self.grid.axes, self.values, self.state
        steps = [_step(axis, value) for axis, value in zip(axes, at, strict=True)]
        free = [i for i, step in enumerate(steps) if step]
        if state is None or not free:
            return
        # As it goes on, the measure of a motion that does not repeat changes
        for _ in range(0 if self.settled else _REPETITIONS):
            row, state = self._run(at, state)
            if state is None:
                break
            self.scatter = max(self.scatter, abs(self._cost(row) - self.cost))

        def cost(place: Any) -> float:
            values = list(at)
            for i, share in zip(free, place, strict=True):
                low, high = axes[i].values[0], axes[i].values[-1]
                values[i] = min(max(at[i] + float(share) * steps[i], low), high)
            return self._trial(tuple(values))

        corners = np.zeros((len(free) + 1, len(free)))
        for k, i in enumerate(free):
            corners[k + 1, k] = 0.5 if at[i] < axes[i].values[-1] else -0.5
        minimize(
            cost,
            np.zeros(len(free)),
            method='Nelder-Mead',
            bounds=[
                tuple((end - at[i]) / steps[i] for end in (axes[i].values[0], axes[i].values[-1]))
                for i in free
            ],
            options={
                'initial_simplex': corners,
                'xatol': _FINEST if self.settled else _FINEST_SCATTERED,
                'fatol': max(self.scatter, _FLAT * abs(self.cost)),
                'maxfev': _MOST_TRIALS,
            },
        )

    def edges(self) -> tuple[Edge, ...]:
        """Return where the motion of the best rig is lost along each axis."""
        setup = self.grid.setup.vary(self.grid.settings(self.values))
        hits = self.settled and not setup.control.active and setup.parameters.periodic_force
        if not hits or not 0 < self.row.impacts <= MOST_IMPACTS:
            return ()
        orbit = orbit_of_row(self.row, setup.parameters)
        if orbit is None or not orbit.viable:
            return ()
        found: list[Edge] = []
        for i, axis in enumerate(self.grid.axes):
            if axis.real and len(axis) > 1:
                path, here = path_along(self.grid, i, self.values), self.values[i]
                try:
                    branch = follow(orbit, path, axis.values[0], axis.values[-1], start=here)
                except (OrbitError, ArithmeticError):
                    continue
                span = branch.span(here, orbit)
                edges = (span.low, span.low_reason), (span.high, span.high_reason)
                found += [Edge(i, value, reason) for value, reason in edges if reason]
        return tuple(found)
