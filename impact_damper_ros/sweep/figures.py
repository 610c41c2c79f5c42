"""The figures of a sweep: bifurcation diagram, response surface, basins of attraction."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.recognition import MotionKind
from impact_damper_ros.report.drawing import (
    BLUE,
    ORANGE,
    blank_figure,
    finish_panel,
    legend_below,
    save_figure,
)

from .optimum import Nearby, Optimum
from .plan import Axis
from .summary import attractor_text, attractors_of
from .table import FAILED, MEASURES, SweepTable, check_measure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

_SYMBOLS = {
    'angle': 'Angle θ',
    'damper_mass': 'Damper mass m',
    'damping': 'Damping C',
    'force_amplitudes': 'Force amplitude F',
    'force_frequencies': 'Frequency of the force Ω',
    'friction': 'Friction coefficient γ',
    'gap': 'Gap d',
    'gravity': 'Gravitational acceleration g',
    'initial_damper_offset': 'Initial offset Y',
    'initial_damper_velocity': "Initial velocity of m, Z'",
    'initial_primary_position': 'Initial displacement X',
    'initial_primary_velocity': "Initial velocity X'",
    'primary_mass': 'Primary mass M',
    'restitution_1': 'Restitution R₁',
    'restitution_2': 'Restitution R₂',
    'stiffness': 'Stiffness K',
}
_MEASURES = {
    'chatter_share': 'Share of time in chatter',
    'impacts': 'Impacts in a period, N',
    'impacts_per_cycle': 'Impacts per cycle',
    'largest_multiplier': 'Largest multiplier, modulus',
    'lyapunov_exponent': 'Largest Lyapunov exponent [1/s]',
    'lyapunov_uncertainty': 'Uncertainty of the Lyapunov exponent [1/s]',
    'period': 'Period, cycles of the force',
    'rest_share': 'Share of time at rest on a stop',
    'stick_share': 'Share of time sticking',
    'x_max': 'Largest |X| [m]',
    'x_max_ratio': 'Largest |X| / A',
    'x_mean': 'Mean X [m]',
    'x_rms': 'RMS of X [m]',
}


def _axis_label(axis: Axis) -> str:
    """Return the label of an axis: the parameters that are varied, with their unit."""
    names = [
        _SYMBOLS.get(p.name, p.name.replace('_', ' ').capitalize())
        + (f' [{p.index + 1}]' if p.index is not None else '')
        for p in axis.parameters
    ]
    first = names[0] + ''.join(f' = {name.rsplit(" ", 1)[-1]}' for name in names[1:])
    unit = axis.parameters[0].spec.unit
    return f'{first} [{unit}]' if unit else first


def _measure_label(name: str) -> str:
    """Return the label of a measure, with its unit."""
    return _MEASURES.get(name, MEASURES[name].label)


def _place_text(axis: Axis, value: float) -> str:
    """Return a value of an axis for a legend, with symbol and unit."""
    first = axis.parameters[0]
    known = _SYMBOLS.get(first.name)
    symbol = first.name.replace('_', ' ') if known is None else known.rsplit(' ', 1)[-1]
    return f'{symbol} = {value:.5g} {first.spec.unit}'.rstrip()


def _best_text(optimum: Optimum, measure: str) -> str:
    """Return the value of a measure at the optimum for a legend, with its unit."""
    return f'{optimum.value:.4g} {MEASURES[measure].unit}'.rstrip()


def _times(nearby: Nearby) -> str:
    """Return the ratio of a motion to the optimum and its kind, for the legend."""
    ratio = f'× {nearby.ratio:.3g}, ' if 0.0 < nearby.ratio < math.inf else ''
    return f' ({ratio}{nearby.motion})'


def _set_axes(axes: Any, across: Axis, up: Axis) -> None:
    """Label both axes of a map, and scale them as the sweep does."""
    axes.set(xlabel=_axis_label(across), ylabel=_axis_label(up))
    if across.logarithmic:
        axes.set_xscale('log')
    if up.logarithmic:
        axes.set_yscale('log')
    axes.tick_params(direction='out')


def _cell_edges(axis: Axis) -> Array:
    """Return the edges of the cells that have the values of an axis in their middle."""
    values = np.array(axis.values, dtype=float)
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    if axis.logarithmic:
        values = np.log(values)
    middles = 0.5 * (values[1:] + values[:-1])
    ends = np.concatenate(
        [[1.5 * values[0] - 0.5 * values[1]], middles, [1.5 * values[-1] - 0.5 * values[-2]]]
    )
    return np.exp(ends) if axis.logarithmic else ends


def _grid_of(table: SweepTable, column: Array) -> list[tuple[str, Array]]:
    """Return a column as a grid over the axes, for each direction that was followed."""
    plan = table.plan
    grids = column.reshape(len(plan.follow.directions), *plan.shape)
    return list(zip(plan.follow.directions, grids, strict=True))


def _fixed_text(table: SweepTable) -> str:
    """Return the parameters that are not varied, in two lines."""
    rig = table.plan.parameters
    varied = {p.name for axis in table.plan.axes for p in axis.parameters}
    shown = [
        ('M', 'primary_mass', 'kg'),
        ('K', 'stiffness', 'N/m'),
        ('C', 'damping', 'N s/m'),
        ('m', 'damper_mass', 'kg'),
        ('d', 'gap', 'm'),
        ('R₁', 'restitution_1', ''),
        ('R₂', 'restitution_2', ''),
        ('θ', 'angle', 'rad'),
        ('γ', 'friction', ''),
        ('g', 'gravity', 'm/s²'),
        ('p', 'air_force', 'N'),
    ]
    level = rig.angle == 0.0 and rig.friction == 0.0 and not varied & {'angle', 'friction'}
    left_out = {'gravity'} if level else set()
    if rig.air_force == 0.0:
        left_out.add('air_force')
    parts = [
        f'{symbol} = {getattr(rig, name):.6g} {unit}'.rstrip()
        for symbol, name, unit in shown
        if name not in varied | left_out
    ]
    for symbol, name, unit in (
        ('F', 'force_amplitudes', 'N'),
        ('Ω', 'force_frequencies', 'rad/s'),
    ):
        if name not in varied:
            values = ', '.join(f'{value:.6g}' for value in getattr(rig, name)[:4])
            parts.append(f'{symbol} = {values} {unit}')
    if rig.multisine_level:
        parts.append(f'multisine of {rig.multisine_level:.6g} N rms')
    if rig.one_sided:
        parts.append('stop 1 only')
    if table.plan.control.active:
        parts.append(f'gap control: {table.plan.control.gap_control}')
    half = (len(parts) + 1) // 2
    return ',  '.join(parts[:half]) + '\n' + ',  '.join(parts[half:])


# The light scheme of Paul Tol, distinguishable with any colour vision; grey means failed
_COLORS = (
    '#77AADD', '#EE8866', '#EEDD88', '#FFAABB', '#44BB99', '#99DDFF', '#BBCC33', '#AAAA00',
)  # fmt: skip
_OTHERS, _NONE = '#555555', '#DDDDDD'


def basin_figure(table: SweepTable) -> Figure:
    """Draw the attractor that each pair of initial conditions leads to."""
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
        _cell_edges(across),
        _cell_edges(up),
        grid.T,
        cmap=colors,
        norm=BoundaryNorm(np.arange(FAILED - 0.5, len(_COLORS) + 1.0), colors.N),
        rasterized=True,
    )
    _set_axes(axes, across, up)
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
    legend_below(figure, handles, 1)
    figure.suptitle(_fixed_text(table), fontsize=7.5, color='0.3')
    return figure


_LOOKS: dict[str, dict[str, Any]] = {
    '': {'color': BLUE, 'label': 'each from the initial conditions'},
    'up': {'color': BLUE, 'label': 'followed upwards'},
    'down': {'color': ORANGE, 'label': 'followed downwards'},
}


def _draw_phases(axes: Any, table: SweepTable, values: NDArray[np.float64]) -> None:
    """Draw the phase of each impact; fainter if the motion does not repeat."""
    phases = table.lists('impact_phase')
    rows = np.arange(len(table)).reshape(-1, len(values))
    settled = table.flags('settled')
    for turn, direction in enumerate(table.plan.follow.directions):
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


def _draw_surroundings(axes: Any, axis: Axis, optimum: Optimum) -> None:
    """Draw the edges around the optimum, and other motions of the best rig."""
    for edge in optimum.edges:
        axes.axvline(
            edge.values[0],
            color='0.3',
            linewidth=0.8,
            linestyle='--',
            label=f'edge at {_place_text(axis, edge.values[0])}{_times(edge)}',
        )
    for other in optimum.coexisting:
        axes.plot(
            *(optimum.values[0], other.measure),
            marker='*',
            markersize=5.5,
            markerfacecolor='none',
            markeredgecolor='black',
            linestyle='none',
            label=f'{other.start}{_times(other)}',
            zorder=4,
        )


def bifurcation_figure(table: SweepTable, measure: str, optimum: Optimum | None) -> Figure:
    """Draw impact phases, a measure and the Lyapunov exponent against the parameter."""
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
    spread = _grid_of(table, table.numbers('lyapunov_uncertainty') * cycle)
    columns = (table.numbers(measure), exponent)
    for axes, column in zip(panels[1:], columns, strict=False):
        for turn, (direction, series) in enumerate(_grid_of(table, column)):
            axes.plot(
                *(values, series),
                linestyle='none',
                marker='o',
                # Smaller marks for the second direction leave the first one visible
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
        # A nearly superstable motion must not compress the others
        panels[2].set_ylim(max(finite.min(), np.quantile(finite, 0.02) - 0.2) - 0.05, None)
    if optimum is not None:
        middle.plot(
            *(optimum.values[0], optimum.value),
            marker='*',
            markersize=5.5,
            color='black',
            linestyle='none',
            label=f'{optimum.best.value}: {_best_text(optimum, measure)} at '
            f'{_place_text(axis, optimum.values[0])}',
            zorder=4,
        )
        _draw_surroundings(middle, axis, optimum)
    failed = ~table.flags('ok').reshape(-1, len(values)).any(axis=0)
    for axes in panels:
        for value in values[failed]:
            axes.axvline(value, color='0.85', linewidth=1.0, zorder=0)
        if axis.logarithmic:
            axes.set_xscale('log')
    upper.set_ylim(0.0, 1.0)
    finish_panel(upper, 'a', '', 'Phase of the impacts [cycles]')
    finish_panel(middle, 'b', '' if exponents else _axis_label(axis), _measure_label(measure))
    if exponents:
        finish_panel(panels[2], 'c', _axis_label(axis), 'Lyapunov exponent\n[1/cycle]')
    handles, _ = middle.get_legend_handles_labels()
    legend_below(figure, handles, 2 if optimum is not None else 3, markerscale=2.0)
    figure.suptitle(_fixed_text(table), fontsize=7.5, color='0.3')
    return figure


_FAILED = '0.8'
#: A measure is drawn on a logarithmic scale if its greatest value is more times its least.
_DECADES = 30.0
_STAR: dict[str, Any] = {
    'marker': '*',
    'markersize': 12,
    'color': ORANGE,
    'markeredgecolor': 'white',
    'linestyle': 'none',
}
#: Colours of the dots in cells of motions that do not repeat.
_DOTS = {
    'chaotic': 'black',
    'not periodic, not chaotic': '#CC3311',
}


def _scale(values: NDArray[np.float64]) -> Any:
    """Return the mapping of a measure to colours."""
    from matplotlib.colors import LogNorm, Normalize

    finite = values[np.isfinite(values)]
    if not len(finite):
        return Normalize(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if low > 0.0 and high > _DECADES * low:
        return LogNorm(low, high)
    return Normalize(low, high if high > low else low + 1.0)


def _classes(table: SweepTable) -> dict[str, NDArray[np.float64]]:
    """Return a mask of the rows of each class of motions that has dots."""
    motions = table.texts('motion')
    chaotic = np.array([motion == MotionKind.CHAOTIC.value for motion in motions])
    unsettled = table.flags('ok') & ~table.flags('settled') & ~chaotic
    return dict(zip(_DOTS, (chaotic.astype(float), unsettled.astype(float)), strict=True))


def _outlined() -> list[Any]:
    """Return path effects that make a white line visible on white."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground='0.2')]


def _draw_map(axes: Any, table: SweepTable, turn: int, values: Any, scale: Any) -> Any:
    """Draw one direction; return its colour mesh."""
    across, up = table.plan.axes
    axes.set_facecolor(_FAILED)
    grid = _grid_of(table, values)[turn][1]
    colors = axes.pcolormesh(
        _cell_edges(across), _cell_edges(up), grid.T, norm=scale, cmap='viridis', rasterized=True
    )
    size = max(0.5, min(2.5, 150.0 / max(table.plan.shape)))
    for name, rows in _classes(table).items():
        i, j = np.nonzero(_grid_of(table, rows)[turn][1])
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
    impacts = _grid_of(table, table.numbers('impacts_per_cycle'))[turn][1]
    if min(impacts.shape) > 1 and (impacts > 0.0).any() and (impacts == 0.0).any():
        some = np.ma.masked_invalid(np.where(np.isnan(impacts), np.nan, impacts > 0.0))
        edge = axes.contour(
            across.values, up.values, some.T, [0.5], colors='white', linewidths=1.0
        )
        edge.set_path_effects(_outlined())
    return colors


def _legend(table: SweepTable, measure: str, optimum: Optimum | None) -> list[Any]:
    """Return a legend entry for each kind of mark."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def entry(label: str, **look: Any) -> Any:
        return Line2D([], [], label=label, **{'linestyle': 'none', **look})

    handles: list[Any] = []
    if optimum is not None:
        axes = table.plan.axes
        at = ', '.join(map(_place_text, axes, optimum.values))
        among = 'all' if table.plan.control.active else 'those that repeat'
        label = f'{optimum.best.value} of {among}: {_best_text(optimum, measure)} at {at}'
        handles.append(entry(label, **{**_STAR, 'markersize': 10}))
        handles += [
            entry(f'edge at {_place_text(axes[i], edge.values[i])}{_times(edge)}')
            for edge in optimum.edges
            if (i := edge.axis) is not None
        ]
        handles += [
            entry(f'the same rig {other.start}{_times(other)}') for other in optimum.coexisting
        ]
    handles += [
        entry(name, color=_DOTS[name], marker='o', markersize=3.0)
        for name, rows in _classes(table).items()
        if rows.any()
    ]
    if not table.flags('ok').all():
        handles.append(Patch(facecolor=_FAILED, label='failed'))
    impacts = table.numbers('impacts_per_cycle')
    if (impacts == 0.0).any() and (impacts > 0.0).any():
        outlined = {'linestyle': '-', 'linewidth': 1.0, 'path_effects': _outlined()}
        handles.append(entry('no impacts beyond', color='white', **outlined))
    return handles


def surface_figure(table: SweepTable, measure: str, optimum: Optimum | None) -> Figure:
    """Draw a measure as colours over two axes."""
    plan = table.plan
    across, up = plan.axes
    values = np.where(np.isfinite(table.numbers(measure)), table.numbers(measure), np.nan)
    scale = _scale(values)
    count = len(plan.follow.directions)
    figure = blank_figure(6.3 if count == 1 else 9.4, 4.9)
    panels = np.atleast_1d(figure.subplots(1, count, sharey=True))
    best = '' if optimum is None else plan.point(optimum.point).direction
    colors: Any = None
    for turn, (axes, direction) in enumerate(zip(panels, plan.follow.directions, strict=True)):
        colors = _draw_map(axes, table, turn, values, scale)
        if optimum is not None and direction == best:
            axes.plot(*([value] for value in optimum.values), clip_on=False, zorder=5, **_STAR)
        _set_axes(axes, across, up)
        if turn:
            axes.set_ylabel('')
        if direction:
            axes.set_title(f'followed {direction}wards', loc='left')
    figure.colorbar(colors, ax=list(panels), label=_measure_label(measure), pad=0.015)
    handles = _legend(table, measure, optimum)
    if handles:
        legend_below(figure, handles, 2)
    figure.suptitle(_fixed_text(table), fontsize=7.5, color='0.3')
    return figure


def draw_sweep(table: SweepTable, measure: str, optimum: Optimum | None, path: Path) -> None:
    """
    Draw a sweep of one axis or two.

    Parameters
    ----------
    table : SweepTable
        The sweep.
    measure : str
        Name of the measure that is drawn, one of `MEASURES`; basins of attraction use none.
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
    path = Path(path)
    check_measure(measure)
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
