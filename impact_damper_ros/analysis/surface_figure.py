"""The response surface of a sweep of two quantities, with its optimum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .drawing import ORANGE, blank_figure
from .motion_kind import MotionKind
from .sweep_axes import Axis
from .sweep_drawing import axis_label, edges, fixed_text, grid_of, measure_label, times
from .sweep_optimum import Optimum
from .sweep_table import SweepTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['surface_figure']

_FAILED = '0.8'
#: A measure whose greatest value is more times its least is drawn on a logarithmic scale.
_DECADES = 30.0
_STAR: dict[str, Any] = {
    'marker': '*',
    'markersize': 12,
    'color': ORANGE,
    'markeredgecolor': 'white',
    'linestyle': 'none',
}
#: Dots in the cells of motions that do not repeat.
_DOTS = {
    'chaotic': 'black',
    'not periodic, not chaotic': '#CC3311',
}


def _scale(values: NDArray[np.float64]) -> Any:
    """Return how the measure is mapped to colours."""
    from matplotlib.colors import LogNorm, Normalize

    finite = values[np.isfinite(values)]
    if not len(finite):
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if low > 0.0 and high > _DECADES * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + 1.0)


def _classes(table: SweepTable) -> dict[str, NDArray[np.float64]]:
    """Return for each class of motions that is dotted which rows are in it."""
    motions = table.texts('motion')
    chaotic = np.array([motion == MotionKind.CHAOTIC.value for motion in motions])
    unsettled = table.flags('ok') & ~table.flags('settled') & ~chaotic
    return dict(zip(_DOTS, (chaotic.astype(float), unsettled.astype(float)), strict=True))


def _outlined() -> list[Any]:
    """Return what makes a white line visible on white too."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground='0.2')]


def _draw_map(axes: Any, table: SweepTable, turn: int, values: Any, scale: Any) -> Any:
    """Draw one direction; return what the colour bar belongs to."""
    across, up = table.plan.axes
    axes.set_facecolor(_FAILED)
    grid = grid_of(table, values)[turn][1]
    colors = axes.pcolormesh(
        edges(across), edges(up), grid.T, norm=scale, cmap='viridis', rasterized=True
    )
    size = max(0.5, min(2.5, 150.0 / max(table.plan.shape)))
    for name, rows in _classes(table).items():
        i, j = np.nonzero(grid_of(table, rows)[turn][1])
        axes.plot(
            np.array(across.values)[i],
            np.array(up.values)[j],
            linestyle='none',
            marker='o',
            markersize=size,
            markeredgewidth=0.0,
            color=_DOTS[name],
            rasterized=True,
        )
    impacts = grid_of(table, table.numbers('impacts_per_cycle'))[turn][1]
    if min(impacts.shape) > 1 and (impacts > 0.0).any() and (impacts == 0.0).any():
        some = np.ma.masked_invalid(np.where(np.isnan(impacts), np.nan, impacts > 0.0))
        edge = axes.contour(
            across.values, up.values, some.T, [0.5], colors='white', linewidths=1.0
        )
        edge.set_path_effects(_outlined())
    return colors


def _legend(table: SweepTable, optimum: Optimum | None) -> list[Any]:
    """Return an entry for each mark that there is."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if optimum is not None:
        at = ', '.join(f'{value:.5g}' for value in optimum.values)
        among = 'all' if table.plan.control.active else 'those that repeat'
        label = f'{optimum.best.value} of {among}: {optimum.value:.4g} at ({at})'
        handles.append(Line2D([], [], label=label, **{**_STAR, 'markersize': 10}))
        symbols = [axis_label(axis).split(' [')[0].rsplit(' ', 1)[-1] for axis in table.plan.axes]
        blank: dict[str, Any] = {'linestyle': 'none'}
        handles += [
            Line2D(
                *([], []),
                label=f'edge at {symbols[i]} = {edge.values[i]:.5g}{times(edge)}',
                **blank,
            )
            for edge in optimum.edges
            if (i := edge.axis) is not None
        ]
        handles += [
            Line2D([], [], label=f'the same rig {other.start}{times(other)}', **blank)
            for other in optimum.coexisting
        ]
    dot: dict[str, Any] = {'marker': 'o', 'linestyle': 'none', 'markersize': 3.0}
    handles += [
        Line2D([], [], color=_DOTS[name], label=name, **dot)
        for name, rows in _classes(table).items()
        if rows.any()
    ]
    if not table.flags('ok').all():
        handles.append(Patch(facecolor=_FAILED, label='failed'))
    impacts = table.numbers('impacts_per_cycle')
    if (impacts == 0.0).any() and (impacts > 0.0).any():
        handles.append(
            Line2D(
                *([], []),
                color='white',
                linewidth=1.0,
                label='no impacts beyond',
                path_effects=_outlined(),
            )
        )
    return handles


def surface_figure(table: SweepTable, measure: str, optimum: Optimum | None) -> Figure:
    """
    Draw a measure over two axes.

    Parameters
    ----------
    table : SweepTable
        A sweep along two axes.
    measure : str
        Name of the measure.
    optimum : Optimum or None
        The rig to mark.
    """
    plan = table.plan
    across, up = plan.axes
    values = np.where(np.isfinite(table.numbers(measure)), table.numbers(measure), np.nan)
    scale = _scale(values)
    count = len(plan.follow.passes)
    figure = blank_figure(6.3 if count == 1 else 9.4, 4.9)
    panels = np.atleast_1d(figure.subplots(1, count, sharey=True))
    best = '' if optimum is None else plan.point(optimum.point).direction
    colors: Any = None
    for turn, (axes, direction) in enumerate(zip(panels, plan.follow.passes, strict=True)):
        colors = _draw_map(axes, table, turn, values, scale)
        if optimum is not None and direction == best:
            axes.plot(*([value] for value in optimum.values), clip_on=False, zorder=5, **_STAR)
        _set_scales(axes, across, up)
        axes.set_xlabel(axis_label(across))
        axes.tick_params(direction='out')
        if direction:
            axes.set_title(f'followed {direction}wards', loc='left')
    panels[0].set_ylabel(axis_label(up))
    figure.colorbar(colors, ax=list(panels), label=measure_label(measure), pad=0.015)
    handles = _legend(table, optimum)
    if handles:
        figure.legend(handles=handles, loc='outside lower center', ncols=2, frameon=False)
    figure.suptitle(fixed_text(table), fontsize=7.5, color='0.3')
    return figure


def _set_scales(axes: Any, across: Axis, up: Axis) -> None:
    if across.logarithmic:
        axes.set_xscale('log')
    if up.logarithmic:
        axes.set_yscale('log')
