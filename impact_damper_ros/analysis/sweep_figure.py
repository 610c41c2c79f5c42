"""The figure that fits a sweep."""

from __future__ import annotations

from pathlib import Path

from .basin_figure import basin_figure
from .bifurcation_figure import bifurcation_figure
from .drawing import save_figure
from .surface_figure import surface_figure
from .sweep_optimum import Optimum
from .sweep_table import SweepTable

__all__ = ['draw_sweep']


def draw_sweep(table: SweepTable, measure: str, optimum: Optimum | None, path: Path) -> None:
    """
    Draw a sweep of one axis or two.

    Parameters
    ----------
    table : SweepTable
        The sweep.
    measure : str
        Name of the measure that is drawn; basins of attraction need none.
    optimum : Optimum or None
        The rig to mark.
    path : Path
        The file; its suffix is the format, png, svg or pdf.

    Raises
    ------
    ValueError
        If the sweep has more axes.
    OSError
        If the file cannot be written.
    """
    axes = table.plan.axes
    if len(axes) > 2:
        raise ValueError(f'a figure shows one axis or two, not {len(axes)}')
    if len(axes) == 1:
        figure = bifurcation_figure(table, measure, optimum)
    elif all(axis.initial for axis in axes):
        figure = basin_figure(table)
    else:
        figure = surface_figure(table, measure, optimum)
    save_figure(figure, path)
