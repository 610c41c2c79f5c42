"""The bifurcation diagram of a sweep of one parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .drawing import BLUE, ORANGE, blank_figure, finish_panel
from .sweep_drawing import axis_label, fixed_text, grid_of, measure_label, times
from .sweep_optimum import Optimum
from .sweep_table import SweepTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['bifurcation_figure']

_LOOKS: dict[str, dict[str, Any]] = {
    '': {'color': BLUE, 'label': 'each from the initial conditions'},
    'up': {'color': BLUE, 'label': 'followed upwards'},
    'down': {'color': ORANGE, 'label': 'followed downwards'},
}


def _draw_phases(axes: Any, table: SweepTable, values: NDArray[np.float64]) -> None:
    """Draw the phase of each impact; of motions that do not repeat as a faint cloud."""
    phases = table.lists('impact_phase')
    rows = np.arange(len(table)).reshape(-1, len(values))
    settled = table.flags('settled')
    for turn, direction in enumerate(table.plan.follow.passes):
        for repeats in (False, True):
            kept = [row for row in rows[turn] if settled[row] == repeats]
            x = np.repeat(
                values[[row % len(values) for row in kept]], [len(phases[r]) for r in kept]
            )
            y = np.concatenate([[], *(phases[row] for row in kept)])
            axes.plot(
                *(x, y),
                linestyle='none',
                marker='o',
                markeredgewidth=0.0,
                markersize=(1.2 if turn else 2.4) if repeats else 0.7,
                alpha=1.0 if repeats else min(1.0, max(0.25, 6000.0 / max(len(x), 1))),
                rasterized=len(x) > 2000,
                color=_LOOKS[direction]['color'],
                zorder=3 if repeats else 2,
            )


def _draw_surroundings(axes: Any, optimum: Optimum) -> None:
    """Draw the edges around the optimum, and what else the best rig can do."""
    for edge in optimum.edges:
        axes.axvline(
            edge.values[0],
            color='0.3',
            linewidth=0.8,
            linestyle='--',
            label=f'edge at {edge.values[0]:.5g}{times(edge)}',
        )
    for other in optimum.coexisting:
        axes.plot(
            *(optimum.values[0], other.measure),
            marker='*',
            markersize=5.5,
            markerfacecolor='none',
            markeredgecolor='black',
            linestyle='none',
            label=f'{other.start}{times(other)}',
            zorder=4,
        )


def bifurcation_figure(table: SweepTable, measure: str, optimum: Optimum | None) -> Figure:
    """
    Draw impact phases, a measure and, if there is any, the Lyapunov exponent on the parameter.

    Parameters
    ----------
    table : SweepTable
        A sweep along one axis.
    measure : str
        Name of the measure in the middle.
    optimum : Optimum or None
        The rig to mark there.
    """
    axis = table.plan.axes[0]
    values = np.array(axis.values, dtype=float)
    cycle = table.numbers('cycle')
    exponent = table.numbers('lyapunov_exponent') * cycle
    exponents = bool(np.isfinite(exponent).any())
    figure = blank_figure(6.3, 7.4 if exponents else 5.6)
    heights = [1.6, 1.0, 1.0] if exponents else [1.6, 1.0]
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    upper, middle = panels[:2]
    _draw_phases(upper, table, values)
    spread = grid_of(table, table.numbers('lyapunov_uncertainty') * cycle)
    columns = (table.numbers(measure), exponent)
    for axes, column in zip(panels[1:], columns, strict=False):
        for turn, (direction, series) in enumerate(grid_of(table, column)):
            axes.plot(
                *(values, series),
                linestyle='none',
                marker='o',
                # The second direction is smaller, so that the first one shows around it
                markersize=1.2 if turn else 2.4,
                markeredgewidth=0.0,
                **_LOOKS[direction],
            )
            if column is exponent:
                error = spread[turn][1]
                color = _LOOKS[direction]['color']
                axes.vlines(values, series - error, series + error, color=color, linewidth=0.5)
    if exponents:
        panels[2].axhline(0.0, color='0.3', linewidth=0.7)
        finite = exponent[np.isfinite(exponent)]
        # One that is next to superstable must not flatten all others
        panels[2].set_ylim(max(finite.min(), np.quantile(finite, 0.02) - 0.2) - 0.05, None)
    if optimum is not None:
        middle.plot(
            *(optimum.values[0], optimum.value),
            marker='*',
            markersize=5.5,
            color='black',
            linestyle='none',
            label=f'{optimum.best.value}: {optimum.value:.4g} at {optimum.values[0]:.5g}',
            zorder=4,
        )
        _draw_surroundings(middle, optimum)
    failed = ~table.flags('ok').reshape(-1, len(values)).any(axis=0)
    for axes in panels:
        for value in values[failed]:
            axes.axvline(value, color='0.85', linewidth=1.0, zorder=0)
        if axis.logarithmic:
            axes.set_xscale('log')
    upper.set_ylim(0.0, 1.0)
    finish_panel(upper, 'a', '', 'Phase of the impacts [cycles]')
    finish_panel(middle, 'b', '' if exponents else axis_label(axis), measure_label(measure))
    if exponents:
        finish_panel(panels[2], 'c', axis_label(axis), 'Lyapunov exponent\n[1/cycle]')
    handles, labels = middle.get_legend_handles_labels()
    figure.legend(
        *(handles, labels),
        loc='outside lower center',
        ncols=2 if optimum is not None else 3,
        frameon=False,
        markerscale=2.0,
    )
    figure.suptitle(fixed_text(table), fontsize=7.5, color='0.3')
    return figure
