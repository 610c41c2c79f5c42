"""The figures of Bapat (1995), drawn from computed series."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from impact_damper_ros.orbits.optimum import Limit
from impact_damper_ros.report.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    blank_figure,
    finish_panel,
)

from .curves import Curve, CurvePoint, SettledMotion, Status
from .rigs import OPERATIONS, VARIABLES
from .series import AngleOptimum, Series

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STYLES: dict[Status, dict[str, Any]] = {
    Status.STABLE: {'linestyle': '-', 'linewidth': 1.7},
    Status.UNSTABLE: {'linestyle': (0, (4, 2.2)), 'linewidth': 0.9},
}


def _pieces(points: Sequence[CurvePoint]) -> Iterator[tuple[Status, list[CurvePoint]]]:
    """Yield pieces of one status; each extends to the first point of the next."""
    run: list[CurvePoint] = []
    for point in points:
        if run and point.status != run[-1].status:
            bridged = point.status != Status.NOT_VIABLE
            yield run[-1].status, [*run, point] if bridged else run
            run = []
        run.append(point)
    if run:
        yield run[-1].status, run


def _draw_curves(
    axes: Any,
    curves: Sequence[Curve],
    color: str,
    quantity: Callable[[CurvePoint], Sequence[float]],
    scale: float = 1.0,
) -> None:
    """Draw theory: stable motions as solid lines, unstable viable ones as dashed lines."""
    for curve in curves:
        for status, points in _pieces(curve.points):
            if status == Status.NOT_VIABLE:
                continue
            style = dict(_STYLES[status])
            style['linewidth'] *= scale
            rows = zip(*(quantity(point) for point in points), strict=True)
            for row in rows:
                axes.plot([p.value for p in points], row, color=color, zorder=2, **style)


def _draw_marks(
    axes: Any,
    motions: Sequence[SettledMotion],
    impacts: int,
    color: str,
    marker: str,
    quantity: Callable[[SettledMotion], Sequence[float]],
) -> None:
    """Draw simulation: settled motions with a number of impacts in one cycle of the force."""
    pairs = [
        (motion.value, ordinate)
        for motion in motions
        if motion.cycles == 1 and len(motion.stops) == impacts
        for ordinate in quantity(motion)
    ]
    if pairs:
        axes.plot(
            *zip(*pairs, strict=True),
            linestyle='none',
            marker=marker,
            markersize=4.2,
            markeredgewidth=0.9,
            markeredgecolor=color,
            markerfacecolor='white',
            zorder=3,
            clip_on=False,
        )


_MARK: dict[str, Any] = {'markersize': 4.5, 'markerfacecolor': 'white'}
_LINE: dict[str, Any] = {'linewidth': 1.7}


def _line(label: str, color: str, **look: Any) -> Any:
    """Return an entry of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=color, label=label, **look)


def _legend_below(figure: Figure, series: Sequence[tuple[str, str, str]], columns: int) -> None:
    """Put a legend of series and line styles below the panels."""
    handles = [
        *(_line(label, color, marker=mark, **_LINE, **_MARK) for label, color, mark in series),
        _line('theory, stable', '0.3', **_STYLES[Status.STABLE]),
        _line('theory, unstable', '0.3', **_STYLES[Status.UNSTABLE]),
        _line('simulation', '0.3', marker='o', linestyle='none', **_MARK),
    ]
    figure.legend(handles=handles, loc='outside lower center', ncols=columns, frameon=False)


def _legend_inside(axes: Any, series: Sequence[tuple[str, str, str]], where: str) -> None:
    look = {**_MARK, 'markersize': 4.2}
    handles = [_line(label, color, marker=mark, **look) for label, color, mark in series]
    axes.legend(handles=handles, loc=where, frameon=True, framealpha=0.9, edgecolor='none')


_RATIO = r'$X_{\max}/A$'
_DURATION = r'$(t_{i+1}-t_i)\,\Omega/\pi$'
#: Curves over a smaller share of the axis would be dots, and are left out.
_LEAST_SPAN = 1e-3
_LOOKS = ((BLUE, 'o'), (ORANGE, 's'), (GREEN, '^'), (PURPLE, 'D'))


def _ratio(point: Any) -> Sequence[float]:
    return (point.ratio,)


def _durations(point: Any) -> Sequence[float]:
    durations: tuple[float, ...] = point.durations
    return durations


def _viable_span(curve: Curve) -> float:
    values = [p.value for p in curve.points if p.status != Status.NOT_VIABLE]
    return max(values) - min(values) if values else 0.0


def _without_mirror_images(one: Series, curves: Sequence[Curve]) -> list[Curve]:
    """Leave out stop sequences that are mirror images: on the level their curves coincide."""
    if one.plan.rig.angle or one.plan.variable == 'angle':
        return list(curves)

    def first(stops: tuple[int, ...]) -> tuple[int, ...]:
        return min(stops[i:] + stops[:i] for i in range(len(stops)))

    return [c for c in curves if first(c.stops) <= first(tuple(3 - stop for stop in c.stops))]


def _series(axes: Any, one: Series, impacts: int, look: tuple[str, str], quantity: Any) -> None:
    curves = _without_mirror_images(one, one.of(impacts))
    values = one.plan.values
    curves = [c for c in curves if _viable_span(c) > _LEAST_SPAN * (values[-1] - values[0])]
    _draw_curves(axes, curves, look[0], quantity)
    _draw_marks(axes, one.marks, impacts, *look, quantity)


def _gravity_series(results: Mapping[str, Series], gravity: float) -> list[Series]:
    inclined, friction = OPERATIONS[1:]
    names = [f'2 {operation.key} g={gravity:g}' for operation in (inclined, friction)]
    return [results[name] for name in ('2 horizontal', *names)]


def draw_figure_2(results: Mapping[str, Series], gravity: float) -> Figure:
    """Draw durations between impacts and the largest displacement against the gap."""
    figure = blank_figure(8.2, 9.2)
    series = _gravity_series(results, gravity)
    limits = {2: (15.0, 64.0, 0.1, 0.55), 3: (9.0, 24.0, 0.36, 0.46), 4: (4.0, 14.0, 0.4, 0.5)}
    heights = {2: (0.2, 1.8), 3: (0.3, 1.2), 4: (0.2, 1.0)}
    for row, (impacts, (low, high, bottom, top)) in enumerate(limits.items()):
        for column, quantity in enumerate((_durations, _ratio)):
            axes = figure.add_subplot(3, 2, 2 * row + column + 1)
            for one, look in zip(series, _LOOKS, strict=False):
                _series(axes, one, impacts, look, quantity)
            axes.set_xlim(low, high)
            if column:
                axes.set_ylim(bottom, top)
            else:
                axes.set_ylim(*heights[impacts])
            label = _RATIO if column else _DURATION
            finish_panel(axes, 'abcdef'[2 * row + column], VARIABLES['gap'].label, label)
            word = {2: 'two', 3: 'three', 4: 'four'}[impacts]
            axes.set_title(f'{word} impacts per cycle', loc='right')
    cases = [(operation.label, *look) for operation, look in zip(OPERATIONS, _LOOKS, strict=False)]
    _legend_below(figure, cases, 2)
    return figure


def _panel(
    axes: Any,
    letter: str,
    series: Mapping[str, Series],
    variable: str,
    limits: tuple[float, float, float, float],
    looks: Sequence[tuple[str, str]] = _LOOKS,
    thin: Sequence[Series] = (),
) -> list[tuple[str, str, str]]:
    """Draw the displacement with two impacts of some series; return the legend's entries."""
    for one, other, look in zip_longest(series.values(), thin, looks[: len(series)]):
        if other is not None:
            _draw_curves(axes, other.of(2), look[0], _ratio, 0.55)
        _series(axes, one, 2, look, _ratio)
    axes.set(xlim=limits[:2], ylim=limits[2:])
    finish_panel(axes, letter, VARIABLES[variable].label, _RATIO)
    return [(label, *look) for label, look in zip(series, looks, strict=False)]


def draw_figure_3(results: Mapping[str, Series]) -> Figure:
    """Draw the effect of restitution, angle, frequency and friction on the displacement."""
    figure = blank_figure(8.2, 7.0)
    axes = figure.add_subplot(2, 2, 1)
    labels = ('horizontal', 'inclined 45°', 'inclined, γ = 0.5')
    unequal = {
        label: results[f'3a {operation.key} unequal']
        for label, operation in zip(labels, OPERATIONS, strict=True)
    }
    equal = [results[f'3a {operation.key} equal'] for operation in OPERATIONS]
    entries = _panel(axes, 'a', unequal, 'gap', (30.0, 66.0, 0.0, 0.2), thin=equal)
    _legend_inside(axes, entries, 'upper right')
    axes.text(
        0.03,
        0.05,
        'thick: $R_1, R_2$ = 0.78, 0.72\nthin: $R_1 = R_2$ = 0.75',
        transform=axes.transAxes,
        fontsize=8,
    )
    axes = figure.add_subplot(2, 2, 2)
    both = {'$r$ = 1': results['3b r=1'], '$r$ = 1.02': results['3b r=1.02']}
    entries = _panel(axes, 'b', both, 'angle', (0.0, 90.0, 0.05, 0.32))
    _legend_inside(axes, entries, 'upper left')
    axes = figure.add_subplot(2, 2, 3)
    tilted = {f'θ = {angle}°': results[f'3c θ={angle}°'] for angle in (0, 5, 10, 15)}
    entries = _panel(axes, 'c', tilted, 'frequency', (0.999, 1.12, 0.08, 0.55))
    _legend_inside(axes, entries, 'upper left')
    axes = figure.add_subplot(2, 2, 4)
    _series(axes, results['3d'], 2, _LOOKS[0], _ratio)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(bottom=0.0)
    finish_panel(axes, 'd', VARIABLES['friction'].label, _RATIO)
    _legend_below(figure, [], 3)
    return figure


def draw_figure_4(results: Mapping[str, Series]) -> Figure:
    """Draw the largest displacement against the natural frequency."""
    figure = blank_figure(5.6, 4.2)
    axes = figure.add_subplot()
    axes.set_xscale('log')
    axes.set_xticks([0.5, 1, 2, 5, 10, 20], ['0.5', '1', '2', '5', '10', '20'])
    axes.minorticks_off()
    series = {
        'inclined (θ = 15°, γ = 0.5)': results['4 ζ=0.005'],
        'horizontal, no friction': results['4 ζ=0.005 level'],
    }
    looks = (_LOOKS[2], _LOOKS[0])
    _legend_below(figure, _panel(axes, '', series, 'omega', (0.5, 20.0, 0.0, 0.2), looks), 3)
    return figure


def draw_figure_5(points: Sequence[AngleOptimum]) -> Figure:
    """Draw the optimal gap and the displacement with it against the angle."""
    figure = blank_figure(8.2, 3.7)
    angles = [point.angle for point in points]
    edges = [point for point in points if point.best.limit is not Limit.MINIMUM]
    quantities: tuple[tuple[str, Any], ...] = (
        ('optimal gap [m]', lambda point: point.best.gap),
        (_RATIO + ' at the optimal gap', lambda point: point.best.orbit.amplitude_ratio),
    )
    for column, (label, quantity) in enumerate(quantities):
        axes = figure.add_subplot(1, 2, column + 1)
        axes.plot(angles, [quantity(p) for p in points], color=BLUE, linewidth=1.7)
        axes.plot(
            [p.angle for p in edges],
            [quantity(p) for p in edges],
            linestyle='none',
            marker='|',
            markersize=11,
            color='0.2',
            zorder=4,
            clip_on=False,
        )
        if column:
            good = [p for p in points if p.settled.stops == p.best.orbit.stops]
            _draw_marks(axes, [p.settled for p in good], 2, BLUE, 'o', _ratio)
            axes.set_ylim(0.0, 0.06)
        else:
            axes.set_ylim(56.0, 61.0)
        axes.set_xlim(0.0, 90.0)
        finish_panel(axes, 'ab'[column], VARIABLES['angle'].label, label)
    handles = [
        _line('theory, stable', BLUE, **_LINE),
        _line('simulation', BLUE, marker='o', linestyle='none', **_MARK),
        _line(
            *('limited by stability, not a minimum', '0.2'),
            marker='|',
            markersize=11,
            linestyle='none',
        ),
    ]
    figure.legend(handles=handles, loc='outside lower center', ncols=3, frameon=False)
    return figure


def draw_figure_6(results: Mapping[str, Series]) -> Figure:
    """Draw the largest displacement against the force of compressed air."""
    figure = blank_figure(5.6, 4.2)
    axes = figure.add_subplot()
    both = {'$r$ = 1': results['6 r=1'], '$r$ = 1.02': results['6 r=1.02']}
    entries = _panel(axes, '', both, 'air', (0.0, 5.5, 0.0, 0.6))
    for share, text in ((1.0, 'air cancels friction'), (2.0, 'air is twice friction')):
        axes.axvline(share, color='0.6', linewidth=0.8, linestyle=':')
        axes.annotate(
            text,
            (share, 0.585),
            rotation=90,
            fontsize=8,
            color='0.35',
            xytext=(2, 0),
            textcoords='offset points',
            va='top',
        )
    _legend_below(figure, entries, 3)
    return figure
