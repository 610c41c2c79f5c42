"""The best rig of a sweep: on its grid, and then between the values of the grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from impact_damper_ros.rig import InitialConditions

from .sweep_axes import Target
from .sweep_plan import SweepPlan
from .sweep_settings import varied
from .sweep_table import SweepTable
from .sweep_work import Snapshot, rig_row

__all__ = ['Best', 'Optimum', 'find_optimum']

#: Steps at the end of the search, relative to those of the grid.
_FINEST = 1e-4
_MOST_TRIALS = 400


class Best(Enum):
    """What is looked for."""

    LEAST = 'least'
    GREATEST = 'greatest'


@dataclass(frozen=True)
class Optimum:
    """
    The rig with the least or greatest measure, among those whose motion repeats.

    Under gap control it is among all rigs, since no motion repeats to the last digits whose
    samples do not; and on the grid, a search taking too long.

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
        the same as there, if there is nothing to search.
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
    at_edge: bool
    trials: int

    def as_dict(self) -> dict[str, Any]:
        """Return it as numbers and texts."""
        return {**self.__dict__, 'best': self.best.value}


def find_optimum(
    table: SweepTable, measure: str, best: Best = Best.LEAST, *, refine: bool = True
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
        Whether to search between the values of the grid, where only numbers of the rig (not
        initial conditions) are varied. The search keeps to the motion of the best row: each rig
        takes over its last state. It compares the measures at a step on either side along each
        axis, goes to the best of them, or halves the steps; it needs no slope, so that it also
        ends where the motion does.

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
    numeric = all(not axis.initial and not isinstance(axis.values[0], bool) for axis in plan.axes)
    search = _Search(plan, measure, sign)
    found, reached = at, value
    if refine and numeric and not plan.control.active and search.begin(table, row):
        found, reached = search.refined(at, value)
    edge = any(
        len(axis) > 1 and place in (axis.values[0], axis.values[-1])
        for axis, place in zip(plan.axes, found, strict=True)
    )
    return Optimum(measure, best, row, at, value, found, reached, edge, search.trials)


class _Search:
    """A search by steps along the axes, on one motion."""

    def __init__(self, plan: SweepPlan, measure: str, sign: float) -> None:
        self.plan = plan
        self.measure = measure
        self.sign = sign
        self.trials = 0
        self.state: Snapshot | None = None

    def begin(self, table: SweepTable, row: int) -> bool:
        """Bring the rig of a row back to its motion; return whether that is so."""
        plan = self.plan
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

    def value(self, values: tuple[float, ...]) -> float:
        """Return the measure of a rig, as one to be least; infinite if it does not settle."""
        self.trials += 1
        plan = self.plan
        settings: list[tuple[Target, float]] = [
            (target, value)
            for axis, value in zip(plan.axes, values, strict=True)
            for target in axis.targets
        ]
        row, _ = rig_row(plan.parameters, plan.initial, settings, plan.settling, self.state)
        if not row['ok'] or not row['settled'] or row[self.measure] is None:
            return math.inf
        return self.sign * float(row[self.measure])

    def refined(self, at: tuple[float, ...], value: float) -> tuple[tuple[float, ...], float]:
        """Go down from a value of the grid."""
        axes = self.plan.axes
        steps = [
            (axis.values[-1] - axis.values[0]) / (len(axis) - 1) if len(axis) > 1 else 0.0
            for axis in axes
        ]
        here, lowest, share = at, self.sign * value, 0.5
        while share > _FINEST and self.trials < _MOST_TRIALS:
            trials: list[tuple[float, tuple[float, ...]]] = []
            for i, axis in enumerate(axes):
                for step in (-share * steps[i], share * steps[i]):
                    moved = min(max(here[i] + step, axis.values[0]), axis.values[-1])
                    if moved != here[i]:
                        place = (*here[:i], moved, *here[i + 1 :])
                        trials.append((self.value(place), place))
            found, place = min(trials, default=(math.inf, here))
            if found < lowest:
                here, lowest = place, found
            else:
                share *= 0.5
        return here, self.sign * lowest
