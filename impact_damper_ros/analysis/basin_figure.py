"""Basins of attraction: which motion a rig settles into from where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .attractors import FAILED
from .drawing import blank_figure
from .sweep_drawing import axis_label, edges, fixed_text
from .sweep_summary import attractor_text, attractors_of
from .sweep_table import SweepTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['basin_figure']

# Tol's light scheme, told apart with any kind of colour vision; grey is kept for what failed
_COLORS = (
    '#77AADD', '#EE8866', '#EEDD88', '#FFAABB', '#44BB99', '#99DDFF', '#BBCC33', '#AAAA00',
)  # fmt: skip
_OTHERS, _NONE = '#555555', '#DDDDDD'


def basin_figure(table: SweepTable) -> Figure:
    """
    Draw the attractor that is reached from each pair of initial conditions.

    Parameters
    ----------
    table : SweepTable
        A sweep of two initial conditions.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    across, up = table.plan.axes
    numbers = np.nan_to_num(table.numbers('attractor'), nan=FAILED)
    # One colour for all attractors beyond those that have their own, and one for failures
    grid = np.minimum(numbers, len(_COLORS)).reshape(table.plan.shape)
    colors = ListedColormap([_NONE, *_COLORS, _OTHERS])
    figure = blank_figure(6.3, 6.4)
    axes: Any = figure.subplots()
    axes.pcolormesh(
        edges(across),
        edges(up),
        grid.T,
        cmap=colors,
        norm=BoundaryNorm(np.arange(FAILED - 0.5, len(_COLORS) + 1.0), colors.N),
        rasterized=True,
    )
    axes.set_xlabel(axis_label(across))
    axes.set_ylabel(axis_label(up))
    axes.tick_params(direction='out')
    found = attractors_of(table)
    handles = [
        Patch(
            facecolor=color,
            label=f'{attractor_text(one)}: {one["share"]:.1%}, largest |X| {one["x_max"]:.4g} m',
        )
        for color, one in zip(_COLORS, found, strict=False)
    ]
    if len(found) > len(_COLORS):
        share = sum(one['share'] for one in found[len(_COLORS) :])
        handles.append(
            Patch(facecolor=_OTHERS, label=f'{len(found) - len(_COLORS)} others: {share:.1%}')
        )
    if (numbers == FAILED).any():
        handles.append(Patch(facecolor=_NONE, label='failed'))
    figure.legend(handles=handles, loc='outside lower center', ncols=1, frameon=False)
    figure.suptitle(fixed_text(table), fontsize=7.5, color='0.3')
    return figure
