"""The best rig of a sweep: on its grid, and then between the values of the grid."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any

import numpy as np

from impact_damper_ros.rig import InitialConditions

from .sweep_axes import Axis, Target
from .sweep_plan import SweepPlan
from .sweep_settings import varied
from .sweep_table import SweepTable
from .sweep_work import Snapshot, rig_row

__all__ = ['Best', 'Optimum', 'find_optimum']

#: Steps at the end of the search, relative to those of the grid, of motions that repeat and of
#: those that do not, whose measures scatter.
_FINEST, _FINEST_SCATTERED = 1e-4, 1.0 / 32.0
_MOST_TRIALS = 400
#: How often a measure that scatters is taken again.
_AGAIN = 4
#: How exact, relatively, the measures of a motion that repeats are.
_EXACT = 1e-9
#: Kinds of parameters that can have any value in their range.
_REAL = ('double', 'double_array')


class Best(Enum):
    """What is looked for."""

    LEAST = 'least'
    GREATEST = 'greatest'


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

    def as_dict(self) -> dict[str, Any]:
        """Return it as numbers and texts."""
        return {**self.__dict__, 'best': self.best.value}


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
    edge = any(
        len(axis) > 1 and place in (axis.values[0], axis.values[-1])
        for axis, place in zip(plan.axes, found, strict=True)
    )
    return Optimum(
        *(measure, best, row, at, value, found, reached, search.scatter, edge, search.trials)
    )


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
        plan = self.plan
        if plan.control.active:
            self.state = json.loads(table.texts('state')[row] or 'null')
            return self.state is not None
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
        _, self.state = rig_row(plan.parameters, start, settings, plan.settling)
        return self.state is not None

    def _run(self, values: tuple[float, ...]) -> tuple[float, Snapshot | None]:
        """Return the measure of a rig, as one to be least, and its last state."""
        self.trials += 1
        plan = self.plan
        settings: list[tuple[Target, float]] = [
            (target, value)
            for axis, value in zip(plan.axes, values, strict=True)
            for target in axis.targets
        ]
        row, last = rig_row(
            *(plan.parameters, plan.initial, settings, plan.settling, self.state, plan.control)
        )
        if self.progress is not None:
            self.progress()
        if not row['ok'] or row['settled'] < self.settled or row[self.measure] is None:
            return math.inf, last
        return self.sign * float(row[self.measure]), last

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
