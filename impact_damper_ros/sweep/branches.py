# SPDX-License-Identifier: Apache-2.0
"""The branches of periodic motions that a sweep along one parameter has met, by theory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.orbits.branch import Branch
from impact_damper_ros.orbits.continuation import follow
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.solved_orbits import orbit_near
from impact_damper_ros.orbits.varied_parameter import Path
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .grid import Grid
from .steady_state import rig_of_row

if TYPE_CHECKING:
    import pandas as pd

#: Most impacts of a motion that is followed, and most branches.
MOST_IMPACTS, _MOST_BRANCHES = 8, 40
#: Largest distance of a motion from a branch: phases in cycles, and relative difference of the
#: largest |X|.
_SAME_PHASE, _SAME_SIZE = 0.02, 0.02


def branches_of(table: pd.DataFrame) -> list[Branch]:
    """
    Follow the periodic motions of a sweep along its axis, stable and unstable.

    Parameters
    ----------
    table : pandas.DataFrame
        The table of a sweep of one axis.

    Returns
    -------
    list of Branch
        A branch through each motion that has settled and is not on one of the others.
    """
    grid = Grid.from_inputs(table.attrs['inputs'])
    axis, setup = grid.axes[0], grid.setup
    if (
        len(grid.axes) > 1
        or len(axis) < 2
        or not axis.real
        or setup.control.active
        or not setup.parameters.periodic_force
    ):
        return []
    (low, *_, high), (one, *others) = axis.values, axis.varied

    def rig_at(value: float) -> RigParameters:
        return setup.vary(grid.settings((value,))).parameters

    # Derivatives by the gap are exact if it is given by name.
    path: Path = rig_at if others or one.entry is not None else one.name
    found: list[Branch] = []
    few = table[
        table.settled.fillna(False) & (table.impacts > 0) & (table.impacts <= MOST_IMPACTS)
    ]
    for row in few.itertuples():
        value = grid.values(int(row.point))[0]
        if len(found) == _MOST_BRANCHES or _is_on(found, row, value):
            continue
        orbit = orbit_of_row(row, rig_at(value))
        if orbit is not None and orbit.viable:
            found.append(follow(orbit, path, low, high, start=value))
    return found


def orbit_of_row(row: Any, rig: RigParameters) -> PeriodicOrbit | None:
    """Return the periodic motion that a rig has settled into."""
    events = rig_of_row(row, rig).advance(row.cycles * row.cycle)
    hit = next((event for event in events if event.kind is EventKind.IMPACT), None)
    if hit is None:
        return None
    return orbit_near(rig, hit, hit.time / row.cycle, int(row.cycles))


def _phases(stops: ArrayLike, phases: ArrayLike) -> NDArray[np.float64]:
    """Return the phases of the impacts on stop 1 as points of the unit circle, and of stop 2."""
    turns = np.exp(2j * np.pi * np.asarray(phases, float))
    sides = [turns[np.asarray(stops) == stop].sum() for stop in (1, 2)]
    return np.array([part for side in sides for part in (side.real, side.imag)]) / (2.0 * np.pi)


def _is_on(branches: Sequence[Branch], row: Any, value: float) -> bool:
    """Return whether a settled motion is on one of the branches."""
    own = _phases(row.impact_stop, row.impact_phase)
    for branch in branches:
        for one, other in zip(branch.points[:-1], branch.points[1:], strict=True):
            low, high = sorted((one.value, other.value))
            if not low <= value <= high or one.orbit.impacts != row.impacts:
                continue
            share = (value - one.value) / ((other.value - one.value) or 1.0)
            x_max = one.orbit.x_max + share * (other.orbit.x_max - one.orbit.x_max)
            ends = [_phases(o.stops, o.phases) for o in (one.orbit, other.orbit)]
            apart = np.abs(ends[0] + share * (ends[1] - ends[0]) - own).max()
            if apart < _SAME_PHASE and abs(x_max - row.x_max) < _SAME_SIZE * row.x_max:
                return True
    return False
