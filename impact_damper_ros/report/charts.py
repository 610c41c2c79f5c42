"""Charts of a report: the frame that all share, and the motion in time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.compare import (
    Array,
    MotionCurve,
    PredictedCurve,
    StretchComparison,
    SwingEnvelope,
    cubic_rates,
)

from .html import BOTH, COLORS
from .units import power_of_ten, unit_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    'DASHED',
    'Picture',
    'Points',
    'cloud',
    'draw_history',
    'draw_run',
    'draw_stop',
    'figure_of',
    'filled_motion',
    'finite_range',
    'legend_above',
    'log_axis',
    'predicted_impacts',
    'predicted_label',
    'predicted_motion',
    'rings',
]


#: Widths in inches. A narrow picture fits a phone as it is; a wide one is scrolled there.
NARROW, WIDE = 5.3, 10.9
_LEFT, _RIGHT, _BOTTOM = 0.78, 0.22, 0.5
#: Room above the axes, and how much of it each row of the legend takes.
_TOP, _ROW = 0.12, 0.185
DASHED = (0, (3.2, 2.2))
_DOTTED = (0, (1, 1.8))
#: More marks than this are drawn as pixels, which take the same room for any number.
_MOST_MARKS = 300
#: Points closer than the width of the axes by this are one.
_RASTER = 700.0


class Picture(NamedTuple):
    """
    A figure with its words.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    title : str
        What it is.
    caption : str
        What it shows, in a sentence or two.
    wide : bool
        Whether it is as wide as the page.
    """

    figure: Figure
    title: str
    caption: str
    wide: bool = False


def _place(width: float, height: float, rows: int) -> tuple[float, float, float, float]:
    """Return where the axes are in a figure, as shares of it."""
    inside = (width - _LEFT - _RIGHT, height - _TOP - rows * _ROW - _BOTTOM)
    return _LEFT / width, _BOTTOM / height, inside[0] / width, inside[1] / height


def figure_of(
    x_label: str, y_label: str, *, wide: bool = False, height: float = 3.7
) -> tuple[Figure, Any]:
    """Return an empty figure and its axes."""
    from matplotlib.figure import Figure

    width = WIDE if wide else NARROW
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes(_place(width, height, rows=1))
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    return figure, axes


def legend_above(axes: Any, entries: Sequence[tuple[str, str, str]], columns: int = 0) -> None:
    """Put a legend above the axes, where it hides nothing."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines: dict[str, Any] = {'line': '-', 'dashed': DASHED, 'dotted': _DOTTED}
    handles: list[Any] = []
    for look, name, label in entries:
        color = COLORS[name]
        if look == 'patch':
            handles.append(Patch(facecolor=color, alpha=0.5, label=label))
        elif look in lines:
            style: dict[str, Any] = {'linewidth': 1.8, 'linestyle': lines[look]}
            handles.append(Line2D([], [], color=color, label=label, **style))
        else:
            style = {'markeredgecolor': color, 'markerfacecolor': color}
            if look in 'oD':
                style['markerfacecolor'] = 'none'
            size = 8 if look == '*' else 6.5
            handles.append(Line2D([], [], ls='none', marker=look, ms=size, label=label, **style))
    columns = columns or max(1, len(handles))
    width, height = axes.figure.get_size_inches()
    axes.set_position(_place(width, height, rows=-(-len(handles) // columns)))
    axes.legend(
        handles=handles,
        loc='lower left',
        bbox_to_anchor=(-0.01, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.1,
        columnspacing=1.1,
        handlelength=1.6,
        handletextpad=0.5,
        labelspacing=0.25,
    )


def finite_range(
    *values: ArrayLike, margin: float = 0.06, least: float = 0.0
) -> tuple[float, float]:
    """Return limits of an axis that hold all finite values."""
    joined = np.concatenate([np.asarray(value, dtype=float).ravel() for value in values])
    joined = joined[np.isfinite(joined)]
    low, high = (float(joined.min()), float(joined.max())) if len(joined) else (-1.0, 1.0)
    # Narrower than that, the numbers at the axis would all be the same.
    width = max(high - low, least, 1e-6 * max(abs(low), abs(high))) or 1.0
    middle = 0.5 * (low + high)
    return middle - width * (0.5 + margin), middle + width * (0.5 + margin)


def log_axis(axes: Any, low: float, high: float) -> None:
    """Make the upright axis one of powers of ten, from `low` to `high`, numbered sparsely."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale('log')
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis='y', which='minor', length=0)


def predicted_label(stretch: StretchComparison) -> str:
    """Return what a legend calls the prediction."""
    orbit = stretch.predicted
    return 'predicted' if orbit is None or orbit.stable else 'predicted, but unstable'


def rings(axes: Any, x: ArrayLike, y: ArrayLike, size: float = 10.0) -> None:
    """Draw predicted points, as rings that leave what is in them to be seen."""
    axes.plot(
        x,
        y,
        linestyle='none',
        marker='o',
        markersize=size,
        markeredgewidth=1.3,
        markeredgecolor=COLORS['theory'],
        markerfacecolor='none',
        clip_on=False,
        zorder=4,
    )


def draw_stop(axes: Any, place: ArrayLike, time: ArrayLike, depth: float) -> None:
    """Draw a stop over time, as a wall of some depth on its outer side."""
    outer = np.asarray(place) + depth
    axes.fill_between(time, place, outer, color=COLORS['stop'], alpha=0.35, linewidth=0)
    axes.plot(time, place, color=COLORS['stop'], linewidth=1.0)


class Points(NamedTuple):
    """
    Points of one kind in a picture.

    Attributes
    ----------
    x, y : ndarray of shape (n,)
        Where they are.
    marker : str
        Their look, if there are few in the picture.
    name : str
        Their colour, one of `BOTH`.
    alpha : float
        How much of it they have.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    marker: str
    name: str
    alpha: float


def cloud(axes: Any, kinds: Sequence[Points]) -> None:
    """Draw points: coinciding ones once, very many as the pixels of an image."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    rows = []
    for kind in kinds:
        place = np.stack([(kind.x - left) / (right - left), (kind.y - low) / (high - low)])
        rows.append(np.unique(np.round(_RASTER * place), axis=1, return_index=True)[1])
    # All kinds alike, so that none looks as if it had more points.
    dense = sum(map(len, rows)) > _MOST_MARKS
    for kind, seen in zip(kinds, rows, strict=True):
        axes.plot(
            kind.x[seen],
            kind.y[seen],
            linestyle='none',
            marker='o' if dense else kind.marker,
            markersize=1.6 if dense else 4.5,
            markeredgewidth=0,
            color=BOTH[kind.name] if dense else COLORS[kind.name],
            alpha=max(kind.alpha, 0.6) if dense else kind.alpha,
            rasterized=dense,
            clip_on=dense,
            zorder=2,
        )


#: Samples in a cycle of the force from which on straight lines between them look smooth.
_FINE = 100
#: Into how many parts each interval is cut otherwise.
_PARTS = 3
#: Intervals so many times longer than usual are left as they are: something is missing there.
_LONGEST = 3.0


def _between(time: Array, place: Array, rate: Array) -> tuple[Array, Array]:
    """Return positions and velocities of the cubics between knots, at the parts."""
    step = np.diff(time)
    usual = float(np.median(step[step > 0.0]))
    smooth = (step > 0.0) & (step < _LONGEST * usual)
    share = np.where(smooth[:, None], np.arange(_PARTS) / _PARTS, 0.0)
    width = np.where(smooth, step, 1.0)
    b, a = cubic_rates(width, np.diff(place), rate[:-1], rate[1:])
    v_0, a, b, width = (v[:, None] for v in (rate[:-1], a, b, width))
    x = place[:-1, None] + width * share * (v_0 + share * (b / 2.0 + share * a / 3.0))
    return x, v_0 + share * (b + share * a)


def filled_motion(stretch: StretchComparison) -> MotionCurve | None:
    """Return the end of a stretch in detail, with cubics between samples that are far apart."""
    motion = stretch.curves.motion
    if motion is None or len(motion.time) < 2 or not np.isfinite(motion.time).all():
        return None
    span = float(motion.time[-1] - motion.time[0])
    cycles = span * stretch.parameters.force_frequencies[0] / math.tau
    if span <= 0.0 or len(motion.time) > _FINE * cycles:
        return motion
    x, velocity = _between(motion.time, motion.x, motion.velocity)
    y, relative = _between(motion.time, motion.y, motion.relative_velocity)
    # A part of an interval that stays as it is comes to lie on its beginning.
    time, _ = _between(motion.time, motion.time, np.ones_like(motion.time))

    def joined(inner: Array, knots: Array) -> Array:
        return np.append(inner.ravel(), knots[-1])

    def spread(edge: Array) -> Array:
        return np.interp(joined(time, motion.time), motion.time, edge)

    return MotionCurve(
        joined(time, motion.time),
        joined(x, motion.x),
        joined(velocity, motion.velocity),
        joined(y, motion.y),
        joined(relative, motion.relative_velocity),
        spread(motion.stop_1),
        spread(motion.stop_2),
    )


#: Stretches that are numbered in the picture of the whole run; more would run into each other.
_MOST_NUMBERS = 30
#: Pieces of a narrow picture of the whole run, all stretches together; a wide one has four times
#: as many.
_MOST_PIECES = 300
#: Cycles of the force, in all, that can be told apart in it.
_MOST_CYCLES = 160
#: Share of the width of that picture that a number of a stretch takes.
_NUMBER = 0.02
#: Share of the time history that a narrow picture of it shows.
_LAST = 3.0 / 8.0


def _cycles(stretch: StretchComparison) -> float:
    """Return the number of cycles of the force in a stretch."""
    return (stretch.end - stretch.start) * stretch.parameters.force_frequencies[0] / math.tau


def _thinned(envelope: SwingEnvelope, most: float) -> list[Array]:
    """Return an envelope of no more than so many pieces."""
    size = max(1, math.ceil(len(envelope.time) / most))
    starts = np.arange(0, len(envelope.time), size)
    low = np.fmin.reduceat(envelope.low, starts)
    return [envelope.time[starts], low, np.fmax.reduceat(envelope.high, starts)]


def _fill(axes: Any, outlines: Sequence[Array]) -> None:
    """Fill several areas as one path, which takes less room than many."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    outlines = [outline[np.isfinite(outline).all(axis=1)] for outline in outlines]
    paths = [Path(np.vstack([o, o[:1]]), closed=True) for o in outlines if len(o)]
    if paths:
        joined = Path.make_compound_path(*paths)
        style = {'color': COLORS['primary'], 'alpha': 0.6, 'linewidth': 0.6, 'zorder': 2}
        axes.add_patch(PathPatch(joined, **style))


def _level_lines(
    axes: Any,
    stretches: Sequence[StretchComparison],
    levels: Mapping[int, float],
    factor: float,
    style: Mapping[str, Any],
) -> None:
    """Draw the predicted largest |X| on both sides, from where a stretch is steady."""
    rows = []
    for stretch in stretches:
        level = factor * levels[stretch.number]
        since = stretch.start if stretch.settled_at is None else stretch.settled_at
        for side in (-level, level):
            rows += [(since, side), (stretch.end, side), (math.nan, math.nan)]
    if rows:
        axes.plot(*np.array(rows).T, zorder=3, **style)


def draw_run(stretches: Sequence[StretchComparison], *, wide: bool = True) -> Picture | None:
    """Draw X over the whole run, with what theory has for its largest value in each stretch."""
    shown = [
        (stretch, stretch.curves.envelope)
        for stretch in stretches
        if stretch.curves.envelope is not None and len(stretch.curves.envelope.time)
    ]
    if not shown:
        return None
    # What is not stable cannot last.
    levels = {
        s.number: s.predicted.x_max
        for s in stretches
        if s.predicted is not None and s.predicted.stable
    }
    sizes = [np.abs([envelope.low, envelope.high]).ravel() for _, envelope in shown]
    joined = np.concatenate([*sizes, list(levels.values())])
    reach = float(np.max(joined[np.isfinite(joined)], initial=0.0))
    unit = unit_for('m', reach)
    reach = unit.factor * reach or 1.0
    figure, axes = figure_of('rig time [s]', f'X [{unit.name}]', wide=wide, height=2.8)
    few = len(stretches) <= _MOST_NUMBERS
    crowded = sum(map(_cycles, stretches)) > _MOST_CYCLES
    begin, end = stretches[0].start, stretches[-1].end
    room = _NUMBER * (end - begin) * (1.0 if wide else 2.5)
    least = 8.0 if wide else 2.0
    numbered = -math.inf
    axes.set_ylim(-1.12 * reach, 1.3 * reach)
    bands: list[Array] = []
    for stretch, envelope in shown:
        most = max(least, (4.0 if wide else 1.0) * _MOST_PIECES / len(shown))
        if crowded:
            # Cycles drawn one by one would only make a pattern of their own.
            most = min(most, max(least, _cycles(stretch)))
        time, low, high = _thinned(envelope, most)
        # The last piece reaches to the end of the stretch.
        time = np.append(time, stretch.end)
        low, high = (unit.factor * np.append(edge, edge[-1]) for edge in (low, high))
        around = [np.concatenate([time, time[::-1]]), np.concatenate([low, high[::-1]])]
        bands.append(np.column_stack(around))
    _fill(axes, bands)
    dashed = {'color': COLORS['theory'], 'linewidth': 1.5, 'linestyle': DASHED}
    _level_lines(axes, [s for s in stretches if s.number in levels], levels, unit.factor, dashed)
    starts = np.array([stretch.start for stretch in stretches[1:]])
    edges = np.tile([*axes.get_ylim(), math.nan], len(starts))
    width = 0.7 if few else 0.3
    axes.plot(np.repeat(starts, 3), edges, color=COLORS['quiet'], linewidth=width)
    for stretch in stretches:
        # A number that would cover the one before is left out.
        if few and stretch.start - numbered >= room:
            numbered = stretch.start
            axes.annotate(
                str(stretch.number),
                (stretch.start, 1.28 * reach),
                xytext=(4, 0),
                textcoords='offset points',
                va='top',
                fontweight='bold',
            )
    axes.set_xlim(begin, end if end > begin else begin + 1.0)
    legend = [('patch', 'primary', 'X as recorded')]
    if levels:
        legend.append(('dashed', 'theory', 'largest |X| of the stable motion predicted'))
    legend_above(axes, legend, columns=0 if wide else 1)
    caption = 'Displacement of the primary mass over the whole run; stretches begin at the '
    caption += 'upright lines.'
    return Picture(figure, 'The whole run', caption, wide=wide)


def _occurrences(curve: PredictedCurve, phase: float, start: float, end: float) -> Array:
    """Return the instants from `start` to `end` at which a phase of the motion comes."""
    period = curve.cycles * curve.cycle
    once = curve.force_zero + phase * curve.cycle
    if not (np.isfinite([once, start, end]).all() and period > 0.0):
        return np.empty(0)
    first, last = np.ceil((start - once) / period), np.floor((end - once) / period)
    return once + period * np.arange(first, last + 1.0)


def predicted_motion(
    curve: PredictedCurve, start: float, end: float
) -> tuple[Array, Array, Array]:
    """Return the predicted motion over a stretch of time."""
    if not len(curve.phase):
        return np.empty(0), np.empty(0), np.empty(0)
    period = curve.cycles * curve.cycle
    begins = _occurrences(curve, float(curve.phase[0]), start - period, end)
    within = (curve.phase - curve.phase[0]) * curve.cycle
    time = (begins[:, None] + within).ravel()
    inside = (time >= start) & (time <= end)
    x, y = (np.tile(values, len(begins))[inside] for values in (curve.x, curve.y))
    return time[inside], x, y


def predicted_impacts(stretch: StretchComparison, start: float, end: float) -> tuple[Array, Array]:
    """Return the predicted impacts from `start` to `end`, s."""
    orbit, curve = stretch.predicted, stretch.curves.predicted
    if orbit is None or curve is None:
        return np.empty(0), np.empty(0)
    half = 0.5 * orbit.parameters.gap
    instants = [_occurrences(curve, phase, start, end) for phase in orbit.phases]
    places = [
        np.full(len(row), x + (half if stop == 1 else -half))
        for row, stop, x in zip(instants, orbit.stops, orbit.x, strict=True)
    ]
    return np.concatenate([[], *instants]), np.concatenate([[], *places])


def _where(stretch: StretchComparison, motion: MotionCurve) -> dict[str, tuple[Array, Array]]:
    """Return instants and places of the recorded impacts, by the marks that show the stops."""
    impacts = stretch.curves.impacts
    marks: dict[str, tuple[Array, Array]] = {}
    if impacts is None:
        return marks
    inside = (impacts.time >= motion.time[0]) & (impacts.time <= motion.time[-1])
    for stop, marker, edge in ((1, '^', motion.stop_1), (2, 'v', motion.stop_2)):
        chosen = inside & (impacts.stop == stop)
        if chosen.any():
            time = impacts.time[chosen]
            marks[marker] = (time, impacts.x[chosen] + np.interp(time, motion.time, edge))
    return marks


def _end_of(motion: MotionCurve) -> MotionCurve:
    """Return the last part of a motion, that a narrow picture has room for."""
    start, end = motion.time[0], motion.time[-1]
    late = motion.time >= end - _LAST * (end - start)
    return MotionCurve(*(getattr(motion, f.name)[late] for f in fields(motion)))


def draw_history(stretch: StretchComparison, *, wide: bool = True) -> Picture | None:
    """Draw the end of a stretch as recorded, with the predicted motion and impacts over it."""
    motion, theory = filled_motion(stretch), stretch.curves.predicted
    if motion is None:
        return None
    if not wide:
        motion = _end_of(motion)
    z = motion.x + motion.y
    unit = unit_for('m', motion.x, z)
    figure, axes = figure_of('rig time [s]', f'position along the axis [{unit.name}]', wide=wide)
    width = motion.stop_1 - motion.stop_2
    depth = 0.1 * unit.factor * float(np.max(width[np.isfinite(width)], initial=0.0))
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        if np.isfinite(edge).any():
            draw_stop(axes, unit.factor * (motion.x + edge), motion.time, side * depth)
    axes.plot(motion.time, unit.factor * motion.x, color=COLORS['primary'], linewidth=2.6)
    axes.plot(motion.time, unit.factor * z, color=COLORS['damper'], linewidth=1.9)
    legend = [
        ('line', 'primary', 'X, primary mass'),
        ('line', 'damper', 'Z, loose mass'),
        ('patch', 'stop', 'stops'),
    ]
    marks = _where(stretch, motion)
    for marker, (time, place) in marks.items():
        style = {'linestyle': 'none', 'marker': marker, 'markersize': 7, 'markeredgewidth': 0}
        axes.plot(time, unit.factor * place, color=COLORS['damper'], zorder=4, **style)
    if marks:
        legend.append(('^', 'damper', 'impact'))
    start, end = float(motion.time[0]), float(motion.time[-1])
    caption = 'The end of the stretch as recorded.'
    if theory is not None:
        time, x, y = predicted_motion(theory, start, end)
        for line in (x, x + y):
            style = {'linewidth': 1.0, 'linestyle': DASHED}
            axes.plot(time, unit.factor * line, color=COLORS['theory'], zorder=3.5, **style)
        hit, place = predicted_impacts(stretch, start, end)
        for at in hit:
            axes.axvline(at, color=COLORS['quiet'], linewidth=0.6, zorder=1)
        rings(axes, hit, unit.factor * place)
        legend += [('dashed', 'theory', predicted_label(stretch)), ('o', 'theory', 'its impacts')]
        caption += ' Over it the predicted motion, with its impacts as rings.'
    axes.set_xlim(start, end if end > start else start + 1e-9)
    legend_above(axes, legend, columns=0 if wide else 3)
    return Picture(figure, 'Time history', caption, wide=wide)
