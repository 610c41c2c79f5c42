# SPDX-License-Identifier: Apache-2.0
"""The figures of a sweep: bifurcation diagram, response surface, basins of attraction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.branch import Branch, SpecialKind, SpecialPoint
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.orbits.solved_orbits import transmissibility
from impact_damper_ros.orbits.transmissibility import TRANSMISSIBILITIES, Transmissibility
from impact_damper_ros.parameters.all_parameters import unit_of
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import STANDARD_GRAVITY
from impact_damper_ros.report.branch_figure import SPECIAL_MARKS
from impact_damper_ros.report.drawing import (
    BLUE,
    GREEN,
    MOTION_LINES,
    blank_figure,
    finish_panel,
    legend_below,
    place_log_ticks,
    print_style,
    save_figure,
    unit_axis,
)
from impact_damper_ros.report.formatting import quantity

from .best import Optimum
from .branches import branches_of
from .grid import Axis, Grid
from .summary import attractor_text, attractors_of
from .table import MEASURES, check_measure, complete_table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

_SYMBOLS = {
    'air_force': 'Air force p',
    'base_amplitudes': 'Amplitude of the base b₀',
    'base_frequencies': 'Frequency of the base Ω',
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
    'acceleration_transmissibility': 'Transmissibility,\nrms X″ / rms b″',
    'chatter_share': 'Share of time in chatter',
    'impacts': 'Impacts in a period, N',
    'impacts_per_cycle': 'Impacts per cycle',
    'largest_multiplier': 'Largest multiplier, modulus',
    'lyapunov_exponent': 'Largest Lyapunov exponent [1/s]',
    'lyapunov_uncertainty': 'Uncertainty of the Lyapunov exponent [1/s]',
    'cycles': 'Period, cycles of the force',
    'rest_share': 'Share of time at rest on a stop',
    'relative_transmissibility': 'Transmissibility,\nrms (X − b) / rms b',
    'stick_share': 'Share of time sticking',
    'transmissibility': 'Transmissibility,\nrms X / rms b',
    'x_max': 'Largest |X|',
    'x_max_ratio': 'Largest |X| / A',
    'x_mean': 'Mean X',
    'x_rms': 'RMS of X',
}


def _symbol(name: str) -> str:
    """Return the symbol of a parameter, or its name."""
    return _SYMBOLS[name].rsplit(' ', 1)[-1] if name in _SYMBOLS else name.replace('_', ' ')


def _label_axis(drawn: Any, axis: Axis, rig: RigParameters) -> None:
    """Label an axis with the parameters that are varied and their unit, and place its ticks."""
    names = [
        _SYMBOLS.get(one.name, one.name.replace('_', ' ').capitalize())
        + (f' [{one.entry + 1}]' if one.entry is not None else '')
        for one in axis.varied
    ]
    first = names[0] + ''.join(f' = {name.rsplit(" ", 1)[-1]}' for name in names[1:])
    unit = axis.shown_unit(rig)
    if axis.logarithmic:
        place_log_ticks(drawn)
    if unit == 'm':
        unit_axis(drawn, first, unit, axis.values)
    else:
        drawn.set_label_text(f'{first} [{unit}]' if unit else first)


def _label_measure(drawn: Any, measure: str) -> None:
    """Label an axis with the measure that it shows, a length in a handy unit."""
    if MEASURES[measure].unit == 'm':
        unit_axis(drawn, _MEASURES[measure], 'm', drawn.get_view_interval())
    else:
        drawn.set_label_text(_MEASURES[measure])


def _place_text(axis: Axis, value: float, rig: RigParameters) -> str:
    """Return a value of an axis for a legend, with symbol and unit."""
    length = axis.shown_unit(rig) == 'm'
    text = quantity(value, 'm', 5) if length else axis.value_text(value, rig)
    return f'{_symbol(axis.varied[0].name)} = {text}'


def _best_text(optimum: Optimum) -> str:
    """Return the value of a measure at the optimum for a legend, with its unit."""
    unit = MEASURES[optimum.measure].unit
    if unit == 'm':
        return quantity(optimum.value, 'm', 4)
    return f'{optimum.value:.4g} {unit}'.rstrip()


def _set_axes(axes: Any, grid: Grid) -> None:
    """Label both axes of a map, and scale them as the sweep does."""
    rig, (across, up) = grid.setup.parameters, grid.axes
    if across.logarithmic:
        axes.set_xscale('log')
    if up.logarithmic:
        axes.set_yscale('log')
    for drawn, axis in ((axes.xaxis, across), (axes.yaxis, up)):
        _label_axis(drawn, axis, rig)
    axes.tick_params(direction='out')


def _cell_edges(axis: Axis) -> Array:
    """Return the edges of the cells that have the values of an axis in their middle."""
    values = axis.shown_values
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    if axis.logarithmic:
        values = np.log(values)
    middles = 0.5 * (values[1:] + values[:-1])
    ends = np.concatenate(
        [[1.5 * values[0] - 0.5 * values[1]], middles, [1.5 * values[-1] - 0.5 * values[-2]]]
    )
    return np.exp(ends) if axis.logarithmic else ends


def _numbers(column: pd.Series[Any]) -> Array:
    """Return a column of numbers; NaN where there is none."""
    found: Array = column.astype('Float64').to_numpy(float, na_value=math.nan)
    return found


def _grids(grid: Grid, column: Array) -> list[tuple[str, Array]]:
    """Return a column over the axes, for each direction that was followed."""
    parts = column.reshape(len(grid.directions), *grid.shape)
    return list(zip(grid.directions, parts, strict=True))


#: Parameters of the rig in the order in which a figure states them.
_STATED = """
    primary_mass stiffness damping damper_mass gap restitution_1 restitution_2 angle friction
    gravity air_force force_amplitudes force_frequencies base_amplitudes base_frequencies
"""


def _statement(grid: Grid, name: str) -> str:
    """Return a parameter with its value, as a figure states it."""
    rig = grid.setup.parameters
    values = np.atleast_1d(getattr(rig, name))[:4]
    unit = unit_of(name, rig.as_dict())
    text = f'{", ".join(f"{value:.6g}" for value in values)} {unit.replace("^2", "²")}'.rstrip()
    if name == 'base_amplitudes' and rig.base_quantity == 'acceleration':
        text += f' = {", ".join(f"{value / STANDARD_GRAVITY:.4g}" for value in values)} g'
    if name.endswith('_frequencies'):
        text += f' = {", ".join(f"{value / math.tau:.4g}" for value in values)} Hz'
    return f'{_symbol(name)} = {text}'


def _fixed_text(grid: Grid) -> str:
    """Return the parameters that are not varied."""
    rig, control = grid.setup.parameters, grid.setup.control
    left_out = {one.name for axis in grid.axes for one in axis.varied}
    if rig.angle == 0.0 and rig.friction == 0.0 and not left_out & {'angle', 'friction'}:
        left_out.add('gravity')
    if rig.air_force == 0.0:
        left_out.add('air_force')
    if not any(rig.force_amplitudes):
        left_out |= {'force_amplitudes', 'force_frequencies'}
    if not rig.base_motion.moves:
        left_out |= {'base_amplitudes', 'base_frequencies'}
    parts = [_statement(grid, name) for name in _STATED.split() if name not in left_out]
    if rig.multisine_level:
        parts.append(f'multisine of {rig.multisine_level:.6g} N rms')
    if rig.one_sided:
        parts.append('stop 1 only')
    if control.active:
        parts.append(f'gap control: {control.gap_control}')
    return ',  '.join(parts)


#: Places at which the motion without the damper is drawn.
_FINE = 400


def _without_damper(grid: Grid, measure: str) -> tuple[Array, Array] | None:
    """Return a measure of M alone along the axis of a sweep, in closed form; None if unknown."""
    axis, measures = grid.axes[0], dict(zip(TRANSMISSIBILITIES, range(3), strict=True))
    known = measure in measures or measure in ('x_max', 'x_max_ratio', 'x_rms')
    if not (known and axis.real and len(axis) > 1):
        return None
    ends = axis.values[0], axis.values[-1]
    values = (np.geomspace if axis.logarithmic else np.linspace)(*ends, _FINE)
    found = np.full(len(values), np.nan)
    for place, value in enumerate(values.tolist()):
        rig = grid.setup.vary(grid.settings((value,))).parameters
        if measure in measures:
            found[place] = Transmissibility.without_damper(rig)[measures[measure]]
        elif rig.periodic_force:
            size = rig.response_amplitude
            sizes = {'x_max': size, 'x_max_ratio': 1.0, 'x_rms': size / math.sqrt(2.0)}
            found[place] = sizes[measure]
    return values / axis.factor, np.where(np.isfinite(found), found, np.nan)


# The light scheme of Paul Tol, distinguishable with any colour vision; grey marks failures.
_COLORS = (
    '#77AADD', '#EE8866', '#EEDD88', '#FFAABB', '#44BB99', '#99DDFF', '#BBCC33', '#AAAA00',
)  # fmt: skip
_OTHERS, _NONE = '#555555', '#DDDDDD'


@print_style()
def basin_figure(table: pd.DataFrame) -> Figure:
    """Draw the attractor that each pair of initial conditions leads to."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    grid = Grid.from_inputs(table.attrs['inputs'])
    across, up = grid.axes
    numbers = table.attractor.to_numpy(float, na_value=-1.0)
    # One colour for all further attractors, and one for failures
    cells = np.minimum(numbers, len(_COLORS)).reshape(grid.shape)
    colors = ListedColormap([_NONE, *_COLORS, _OTHERS])
    figure = blank_figure(6.3, 6.4, _fixed_text(grid))
    axes: Any = figure.subplots()
    axes.pcolormesh(
        _cell_edges(across),
        _cell_edges(up),
        cells.T,
        cmap=colors,
        norm=BoundaryNorm(np.arange(-1.5, len(_COLORS) + 1.0), colors.N),
        rasterized=True,
    )
    _set_axes(axes, grid)
    found = attractors_of(table)
    handles = [
        Patch(
            facecolor=color,
            label=f'{attractor_text(one)}: {one["share"]:.1%}, largest |X| '
            f'{quantity(one["x_max"], "m", 4)}',
        )
        for color, one in zip(_COLORS, found, strict=False)
    ]
    if len(found) > len(_COLORS):
        share = sum(one['share'] for one in found[len(_COLORS) :])
        handles.append(
            Patch(facecolor=_OTHERS, label=f'{len(found) - len(_COLORS)} others: {share:.1%}')
        )
    if (numbers < 0).any():
        handles.append(Patch(facecolor=_NONE, label='failed'))
    legend_below(figure, handles, 1)
    return figure


#: Marks of rigs by direction: those of the second are smaller, so that both are seen.
_LOOKS: dict[str, dict[str, Any]] = {
    '': {'color': BLUE, 'markersize': 2.4, 'label': 'each from the initial conditions'},
    'up': {'color': BLUE, 'markersize': 2.8, 'label': 'followed upwards'},
    'down': {'color': GREEN, 'markersize': 1.5, 'label': 'followed downwards'},
}
_INK = '0.1'
#: Exponents per cycle up to which a motion may be one at the end of its stability.
_NEUTRAL = 0.01
#: Values of theory, by the measure that is drawn.
_THEORY: dict[str, Callable[[PeriodicOrbit], float]] = {
    'x_max': lambda orbit: orbit.x_max,
    'x_max_ratio': lambda orbit: orbit.x_max_ratio,
    'largest_multiplier': lambda orbit: abs(orbit.multipliers[0]),
    'impacts_per_cycle': lambda orbit: orbit.impacts / orbit.cycles,
    'cycles': lambda orbit: orbit.cycles,
    'impacts': lambda orbit: orbit.impacts,
    'transmissibility': lambda orbit: transmissibility(orbit).absolute,
    'relative_transmissibility': lambda orbit: transmissibility(orbit).relative,
    'acceleration_transmissibility': lambda orbit: transmissibility(orbit).acceleration,
}


def _exponent(orbit: PeriodicOrbit) -> float:
    """Return the largest Lyapunov exponent of a motion, per cycle."""
    largest = abs(orbit.multipliers[0])
    return math.log(largest) / orbit.cycles if largest else -math.inf


def phases_along(branch: Branch) -> Array:
    """Return the phases of the impacts, shape (N, points), in cycles; a row is one impact."""
    rows: list[Array] = []
    for orbit in branch.orbits:
        turned = [np.roll(orbit.phases, k) for k in range(orbit.impacts)]
        # The motion may begin with another of its impacts than the one before.
        before = rows[-1] if rows else turned[0]
        apart = [np.abs((one - before + 0.5) % 1.0 - 0.5).sum() for one in turned]
        rows.append(turned[int(np.argmin(apart))])
    return np.unwrap(np.array(rows).T, period=1.0)


def _ends_of_stability(branch: Branch) -> Iterator[SpecialPoint]:
    """Yield the special points at the ends of parts that are stable, or within them."""
    stable = {
        id(orbit)
        for status, part in branch.parts()
        if status == 'stable'
        for orbit in branch.orbits[part]
    }
    return (special for special in branch.special if id(special.orbit) in stable)


def _draw_branch(
    axes: Any, branch: Branch, factor: float, heights: Array, *, unstable: bool = True
) -> None:
    """Draw a quantity along a branch: solid where it is stable, dashed where it is not."""
    values = np.array(branch.values) / factor
    for status, part in branch.parts():
        if status != 'not viable' and (unstable or status != 'unstable'):
            look = {**MOTION_LINES[status], 'linewidth': 0.9, 'zorder': 2.5}
            axes.plot(values[part], heights[part], **look)


def _draw_phases(axes: Any, table: pd.DataFrame, grid: Grid) -> None:
    """Draw the phase of each impact; fainter if the motion does not repeat."""
    faint = min(1.8, max(0.7, 60.0 / len(grid.axes[0])))
    settled = table.settled.fillna(False).to_numpy(bool)
    turns = table.direction.fillna('').to_numpy(str)
    for direction in grid.directions:
        for repeats in (False, True):
            rows = table[(turns == direction) & (settled == repeats) & table.ok.to_numpy(bool)]
            phases = rows[[str(grid.axes[0].varied[0]), 'impact_phase']].explode('impact_phase')
            x, y = (column.astype(float).to_numpy() for _, column in phases.items())
            look = _LOOKS[direction]
            axes.plot(
                *(x / grid.axes[0].factor, y),
                linestyle='none',
                marker='o',
                markeredgewidth=0.0,
                markersize=look['markersize'] if repeats else faint,
                alpha=1.0 if repeats else min(1.0, max(0.25, 6000.0 / max(len(x), 1))),
                rasterized=len(x) > 2000,
                color=look['color'],
                zorder=2.2 if repeats else 2.0,
            )


def _draw_theory(
    panels: Sequence[Any], branches: Sequence[Branch], factor: float, measure: str
) -> list[Any]:
    """Draw branches and their special points in all panels; return the entries of a legend."""
    from matplotlib.lines import Line2D

    upper, middle, *lower = panels
    of_measure = _THEORY.get(measure)
    kinds = set()
    for branch in branches:
        for column in phases_along(branch):
            # Once for each cycle into which the line reaches
            for turn in range(math.floor(column.min()), math.floor(column.max()) + 1):
                _draw_branch(upper, branch, factor, column - turn)
        for axes in lower:
            exponents = np.array([_exponent(orbit) for orbit in branch.orbits])
            # At a grazing a stable part may end with the motion beyond it.
            exponents[exponents > _NEUTRAL] = np.nan
            _draw_branch(axes, branch, factor, exponents, unstable=False)
        if of_measure is None:
            continue
        heights = np.array([of_measure(orbit) for orbit in branch.orbits])
        _draw_branch(middle, branch, factor, heights)
        for special in _ends_of_stability(branch):
            kinds.add(special.kind)
            place = special.value / factor, of_measure(special.orbit)
            middle.plot(*place, **_special_look(special.kind))
    if not branches:
        return []
    return [
        *(
            Line2D([], [], label=f'theory, {word}', **{**MOTION_LINES[word], 'linewidth': 0.9})
            for word in ('stable', 'unstable')
        ),
        *(
            Line2D([], [], label=kind.value, **{**_special_look(kind), 'markersize': 2.8})
            for kind in SPECIAL_MARKS
            if kind in kinds
        ),
    ]


def _special_look(kind: SpecialKind) -> dict[str, Any]:
    return {
        'marker': SPECIAL_MARKS[kind],
        'markersize': 4.2,
        'markerfacecolor': 'white',
        'markeredgecolor': _INK,
        'markeredgewidth': 0.8,
        'linestyle': 'none',
        'zorder': 4,
    }


def _draw_optimum(axes: Any, grid: Grid, optimum: Optimum) -> None:
    """Draw the best rig."""
    rig, (axis,) = grid.setup.parameters, grid.axes
    place = _place_text(axis, optimum.values[0], rig)
    axes.plot(
        *(optimum.values[0] / axis.factor, optimum.value),
        marker='*',
        markersize=7.0,
        color='black',
        markeredgecolor='white',
        markeredgewidth=0.6,
        linestyle='none',
        label=f'{optimum.best}: {_best_text(optimum)} at {place}',
        zorder=6,
    )


@print_style()
def bifurcation_figure(
    table: pd.DataFrame, measure: str, optimum: Optimum | None, branches: Sequence[Branch] = ()
) -> Figure:
    """Draw impact phases, a measure and the Lyapunov exponent against the parameter."""
    from matplotlib.lines import Line2D

    grid = Grid.from_inputs(table.attrs['inputs'])
    axis = grid.axes[0]
    values = axis.shown_values
    cycle = _numbers(table.cycle)
    exponent = _numbers(table.lyapunov_exponent) * cycle
    exponents = bool(np.isfinite(exponent).any())
    figure = blank_figure(6.8, 7.8 if exponents else 5.8, _fixed_text(grid))
    heights = [1.7, 1.1, 1.0] if exponents else [1.6, 1.0]
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    upper, middle = panels[:2]
    _draw_phases(upper, table, grid)
    error = np.nan_to_num(_numbers(table.lyapunov_uncertainty) * cycle)
    for axes, column in zip(panels[1:], (_numbers(table[measure]), exponent), strict=False):
        for turn, (direction, series) in enumerate(_grids(grid, column)):
            look = _LOOKS[direction]
            axes.plot(*(values, series), ls='none', marker='o', markeredgewidth=0.0, **look)
            if column is exponent:
                half = _grids(grid, error)[turn][1]
                axes.vlines(
                    values, series - half, series + half, color=look['color'], linewidth=0.5
                )
    alone = _without_damper(grid, measure)
    if alone is not None and np.isfinite(alone[1]).any():
        middle.plot(*alone, color='0.5', linewidth=1.0, label='without the damper', zorder=1.5)
    limits = middle.get_ylim()
    if exponents:
        panels[2].axhline(0.0, color='0.3', linewidth=0.7)
        finite = exponent[np.isfinite(exponent)]
        # A nearly superstable motion must not compress the other curves.
        low = max(finite.min(), np.quantile(finite, 0.02) - 0.2)
        high = np.nanmax(np.where(np.isfinite(exponent), exponent + error, np.nan))
        panels[2].set_ylim(low - 0.04 * (high - low) - 0.02, high + 0.06 * (high - low) + 0.02)
    handles = _draw_theory(panels, branches, axis.factor, measure)
    if branches and measure == 'largest_multiplier':
        middle.set_ylim(limits)
    if optimum is not None:
        _draw_optimum(middle, grid, optimum)
    failed = ~table.ok.to_numpy(bool).reshape(-1, len(values)).any(axis=0)
    for axes in panels:
        for value in values[failed]:
            axes.axvline(value, color='0.85', linewidth=1.0, zorder=0)
        if axis.logarithmic:
            axes.set_xscale('log')
        elif axis.varied[0].spec.kind == 'bool':
            axes.set_xticks([0.0, 1.0], ['no', 'yes'])
        else:
            axes.margins(x=0.02)
    upper.set_ylim(0.0, 1.0)
    finish_panel(upper, 'a', '', 'Phase of the impacts [cycles]')
    finish_panel(middle, 'b', '', '')
    _label_measure(middle.yaxis, measure)
    if exponents:
        finish_panel(panels[2], 'c', '', 'Lyapunov exponent\n[1/cycle]')
    _label_axis(panels[-1].xaxis, axis, grid.setup.parameters)
    own = middle.get_legend_handles_labels()[0]
    if handles:
        # The legend has the sweep on the left, theory on the right.
        blank = [Line2D([], [], linestyle='none', label=' ')]
        own += blank * (len(handles) - len(own))
        handles += blank * (len(own) - len(handles))
    legend_below(figure, [*own, *handles], 2, markerscale=1.6)
    return figure


_FAILED = '0.8'
#: A measure is drawn on a logarithmic scale if its greatest value is more times its least.
_DECADES = 30.0
_STAR: dict[str, Any] = {
    'marker': '*',
    'markersize': 13,
    'color': '#FFD700',
    'markeredgecolor': 'black',
    'markeredgewidth': 0.8,
    'linestyle': 'none',
}
#: Colours of the dots in cells of motions that do not repeat.
_DOTS = {'chaotic': 'black', 'not periodic, not chaotic': '#AA3377'}


def _scale(values: Array, measure: str) -> tuple[Any, str]:
    """Return the mapping of a measure to colours, and their scheme."""
    from matplotlib.colors import LogNorm, Normalize, TwoSlopeNorm

    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if measure == 'x_max_ratio' and low < 1.0 < high:
        # Blue where the damper helps, red where it does harm
        return TwoSlopeNorm(1.0, low, high), 'RdBu_r'
    if low > 0.0 and high > _DECADES * low:
        return LogNorm(low, high), 'viridis'
    return Normalize(low, high if high > low else low + 1.0), 'viridis'


def _classes(table: pd.DataFrame) -> dict[str, Array]:
    """Return a mask of the rows of each class of motions that has dots."""
    chaotic = (table.kind == MotionKind.CHAOTIC.value).to_numpy(bool, na_value=False)
    repeats = table.settled.to_numpy(bool, na_value=True)
    masks = chaotic, table.ok.to_numpy(bool) & ~repeats & ~chaotic
    return dict(zip(_DOTS, (mask.astype(float) for mask in masks), strict=True))


def _outline() -> list[Any]:
    """Return path effects that make a white line visible on white."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.0, foreground='0.2')]


def _draw_map(
    axes: Any, table: pd.DataFrame, grid: Grid, turn: int, cells: Array, **look: Any
) -> Any:
    """Draw one direction; return its colour mesh."""
    across, up = grid.axes
    axes.set_facecolor(_FAILED)
    mesh = axes.pcolormesh(_cell_edges(across), _cell_edges(up), cells.T, rasterized=True, **look)
    size = max(0.5, min(2.5, 150.0 / max(grid.shape)))
    for name, rows in _classes(table).items():
        i, j = np.nonzero(_grids(grid, rows)[turn][1])
        axes.plot(
            across.shown_values[i],
            up.shown_values[j],
            linestyle='none',
            marker='o',
            markersize=size,
            markeredgewidth=0.0,
            color=_DOTS[name],
            rasterized=True,
        )
    impacts = _grids(grid, _numbers(table.impacts_per_cycle))[turn][1]
    if min(impacts.shape) > 1 and (impacts > 0.0).any() and (impacts == 0.0).any():
        some = np.ma.masked_invalid(np.where(np.isnan(impacts), np.nan, impacts > 0.0))
        edge = axes.contour(
            across.shown_values, up.shown_values, some.T, [0.5], colors='white', linewidths=1.0
        )
        edge.set_path_effects(_outline())
    return mesh


def _legend(table: pd.DataFrame, grid: Grid, optimum: Optimum | None) -> list[Any]:
    """Return a legend entry for each kind of mark."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def entry(label: str, **look: Any) -> Any:
        return Line2D([], [], label=label, **{'linestyle': 'none', **look})

    handles: list[Any] = []
    axes = grid.axes
    if optimum is not None:
        rig = grid.setup.parameters
        places = zip(axes, optimum.values, strict=True)
        at = ', '.join(_place_text(axis, value, rig) for axis, value in places)
        among = 'all' if grid.setup.control.active else 'those that repeat'
        label = f'{optimum.best} of {among}: {_best_text(optimum)} at {at}'
        handles.append(entry(label, **{**_STAR, 'markersize': 10}))
    handles += [
        entry(name, color=_DOTS[name], marker='o', markersize=3.0)
        for name, rows in _classes(table).items()
        if rows.any()
    ]
    if not table.ok.all():
        handles.append(Patch(facecolor=_FAILED, label='failed'))
    impacts = _numbers(table.impacts_per_cycle)
    if (impacts == 0.0).any() and (impacts > 0.0).any():
        outlined = {'linestyle': '-', 'linewidth': 1.0, 'path_effects': _outline()}
        handles.append(entry('no impacts beyond', color='white', **outlined))
    return handles


@print_style()
def surface_figure(table: pd.DataFrame, measure: str, optimum: Optimum | None) -> Figure:
    """Draw a measure as colours over two axes."""
    grid = Grid.from_inputs(table.attrs['inputs'])
    values = _numbers(table[measure])
    values[~np.isfinite(values)] = np.nan
    scale, scheme = _scale(values, measure)
    count = len(grid.directions)
    figure = blank_figure(6.8 if count == 1 else 9.4, 5.4, _fixed_text(grid))
    panels = np.atleast_1d(figure.subplots(1, count, sharey=True))
    best = -1 if optimum is None else optimum.point * count // grid.size
    mesh: Any = None
    for turn, (axes, (direction, cells)) in enumerate(
        zip(panels, _grids(grid, values), strict=True)
    ):
        mesh = _draw_map(axes, table, grid, turn, cells, norm=scale, cmap=scheme)
        if optimum is not None and turn == best:
            pairs = zip(optimum.values, grid.axes, strict=True)
            place = (value / axis.factor for value, axis in pairs)
            axes.plot(*place, clip_on=False, zorder=6, **_STAR)
        _set_axes(axes, grid)
        if turn:
            axes.set_ylabel('')
        if direction:
            axes.set_title(f'followed {direction}wards', loc='left')
    bar = figure.colorbar(mesh, ax=list(panels), pad=0.015)
    _label_measure(bar.ax.yaxis, measure)
    handles = _legend(table, grid, optimum)
    if handles:
        legend_below(figure, handles, 2)
    return figure


def draw_sweep(
    table: pd.DataFrame,
    measure: str,
    optimum: Optimum | None,
    path: str | Path,
    branches: Sequence[Branch] | None = None,
) -> None:
    """
    Draw a sweep of one axis or two.

    Parameters
    ----------
    table : pandas.DataFrame
        The table of the sweep.
    measure : str
        Name of the measure that is drawn, one of `MEASURES`; basins of attraction use none.
    optimum : Optimum or None
        The rig to mark.
    path : path
        The file; its suffix is the format, png, svg or pdf.
    branches : sequence of Branch, optional
        Periodic motions along the axis, by default those that `branches_of` finds; an empty list
        omits them.

    Raises
    ------
    ValueError
        If the sweep has more axes, or the table is not that of a whole sweep.
    OSError
        If the file cannot be written.
    """
    check_measure(measure)
    table = complete_table(table)
    axes = Grid.from_inputs(table.attrs['inputs']).axes
    if len(axes) > 2:
        raise ValueError(f'a figure shows one axis or two, not {len(axes)}')
    if len(axes) == 1:
        known = branches_of(table) if branches is None else branches
        figure = bifurcation_figure(table, measure, optimum, known)
    elif all(axis.initial for axis in axes):
        figure = basin_figure(table)
    else:
        figure = surface_figure(table, measure, optimum)
    save_figure(figure, Path(path))
