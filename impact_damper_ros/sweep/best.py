# SPDX-License-Identifier: Apache-2.0
"""The best rig of a sweep: the row with the least or greatest measure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from .table import Columns, check_measure

if TYPE_CHECKING:
    import pandas as pd

#: Which value of a measure is best.
Best = Literal['least', 'greatest']


@dataclass(frozen=True)
class Optimum:
    """
    The rig with the least or greatest measure, among those whose motion repeats.

    Under gap control all rigs are considered, since a motion does not repeat to the last digits
    where the samples of the control are not in step with the force.

    Attributes
    ----------
    measure : str
        Name of the measure.
    best : str
        Which value is best, least or greatest.
    point : int
        Row of the rig in the table.
    values : tuple of float
        Value of the rig on each axis.
    value : float
        Measure of the rig.
    direction : str
        Up or down, if the rig started from the last state of the rig before in this direction;
        else empty.
    at_edge : bool
        Whether the rig lies at the end of a range: a wider range may hold a better rig.
    """

    measure: str
    best: Best
    point: int
    values: tuple[float, ...]
    value: float
    direction: str
    at_edge: bool


def find_optimum(
    table: pd.DataFrame | Columns, measure: str, best: Best = 'least'
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

    Returns
    -------
    Optimum or None
        None if no motion of the sweep repeats, or under control no rig could be simulated, or none
        has the measure.

    Raises
    ------
    ValueError
        If the measure is not known, or the table is not that of a whole sweep.
    """
    check_measure(measure)
    if best not in get_args(Best):
        raise ValueError(f'best is {best!r}: give one of {", ".join(get_args(Best))}')
    grid, columns = Columns.of(table)
    eligible = columns['ok' if grid.setup.control.active else 'settled']
    known = {
        k: float(value)
        for k, (chosen, value) in enumerate(zip(eligible, columns[measure], strict=True))
        if chosen and value is not None
    }
    if not known:
        return None
    point = (min if best == 'least' else max)(known, key=known.__getitem__)
    values = grid.values(point)
    return Optimum(
        *(measure, best, point, values, known[point]),
        direction=columns['direction'][point] or '',
        at_edge=any(
            len(axis) > 1 and value in (axis.values[0], axis.values[-1])
            for axis, value in zip(grid.axes, values, strict=True)
        ),
    )
