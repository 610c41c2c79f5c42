"""
Charts of the report: the whole run, and a stretch in time, phase plane, section and spectrum.

Each chart of a stretch is None if too little is recorded to draw it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impact_damper_ros.compare.result import (
    Array,
    Convergence,
    GapCurve,
    MotionCurve,
    PredictedCurve,
    StretchComparison,
    SwingEnvelope,
)
from impact_damper_ros.replay.rows import Events

from .drawing import COLORS, DASHED, DOTTED, draw_stop, legend_handles
from .formatting import number, unit_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Widths in inches. A narrow picture fits a phone as it is; a wide one is scrolled there.
_NARROW, _WIDE = 5.3, 10.9
_LEFT, _RIGHT, _BOTTOM = 0.78, 0.22, 0.5
#: Room above the axes, and how much of it each row of the legend takes.
_TOP, _ROW = 0.12, 0.185


class Picture(NamedTuple):
    """A figure, its title, its caption, and whether it is as wide as the page."""

    figure: Figure
    title: str
    caption: str
    wide: bool


class _Chart:
    """A figure of one panel that is being drawn, and its legend."""

    def __init__(
        self, x_label: str, y_label: str, *, wide: bool = False, height: float = 3.7
    ) -> None:
        from matplotlib.figure import Figure

        self.wide = wide
        self.figure = Figure(figsize=(_WIDE if wide else _NARROW, height))
        self.axes: Any = self.figure.add_axes(self._place(1))
        self.axes.set_xlabel(x_label)
        self.axes.set_ylabel(y_label)
        self.legend: list[tuple[str, str, str]] = []

    def _place(self, rows: int) -> tuple[float, float, float, float]:
        """Return the place of the axes below a legend, as shares of the figure."""
        width, height = self.figure.get_size_inches()
        inside = (width - _LEFT - _RIGHT, height - _TOP - rows * _ROW - _BOTTOM)
        return _LEFT / width, _BOTTOM / height, inside[0] / width, inside[1] / height

    def entry(self, look: str, color: str, label: str) -> None:
        """Add to the legend; see `legend_handles`."""
        if label:
            self.legend.append((look, color, label))

    def line(
        self,
        x: ArrayLike,
        y: ArrayLike,
        color: str,
        width: float,
        label: str = '',
        look: str = 'line',
        **style: Any,
    ) -> None:
        """Draw a line that is full, dashed or dotted."""
        dashes: Any = {'line': '-', 'dashed': DASHED, 'dotted': DOTTED}[look]
        self.axes.plot(x, y, color=COLORS[color], linewidth=width, linestyle=dashes, **style)
        self.entry(look, color, label)

    def marks(
        self, x: ArrayLike, y: ArrayLike, color: str, marker: str, size: float, label: str = ''
    ) -> None:
        """Draw points."""
        style = {'linestyle': 'none', 'marker': marker, 'markersize': size, 'zorder': 4}
        self.axes.plot(x, y, color=COLORS[color], markeredgewidth=0, **style)
        self.entry(marker, color, label)

    def rings(
        self,
        x: ArrayLike,
        y: ArrayLike,
        size: float,
        label: str,
        color: str = 'theory',
        marker: str = 'o',
        **style: Any,
    ) -> None:
        """Draw open circles, which do not hide what is inside."""
        style = {'markeredgewidth': 1.3, 'clip_on': False, 'zorder': 4, **style}
        self.axes.plot(
            x,
            y,
            linestyle='none',
            marker=marker,
            markersize=size,
            markeredgecolor=COLORS[color],
            markerfacecolor='none',
            **style,
        )
        self.entry(marker, color, label)

    def log_axis(self, low: float, high: float) -> None:
        """Make the vertical axis logarithmic, from `low` to `high`, with few labels."""
        from matplotlib.ticker import LogLocator, NullLocator

        self.axes.set_yscale('log')
        self.axes.set_ylim(low, high)
        self.axes.yaxis.set_major_locator(LogLocator(numticks=7))
        self.axes.yaxis.set_major_formatter('{x:.0e}')
        self.axes.yaxis.set_minor_locator(NullLocator())

    def picture(self, title: str, caption: str, columns: int = 0) -> Picture:
        """Put the legend above the axes, where it hides nothing; return the picture."""
        columns = columns or max(1, len(self.legend))
        self.axes.set_position(self._place(-(-len(self.legend) // columns)))
        self.axes.legend(
            handles=legend_handles(self.legend),
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
        return Picture(self.figure, title, caption, self.wide)


def _finite_range(
    *values: ArrayLike, margin: float = 0.06, least: float = 0.0
) -> tuple[float, float]:
    """Return limits of an axis that hold all finite values."""
    joined = np.concatenate([np.asarray(value, dtype=float).ravel() for value in values])
    joined = joined[np.isfinite(joined)]
    low, high = (float(joined.min()), float(joined.max())) if len(joined) else (-1.0, 1.0)
    # Narrower than that, the numbers at the axis would all be the same
    width = max(high - low, least, 1e-6 * max(abs(low), abs(high))) or 1.0
    middle = 0.5 * (low + high)
    return middle - width * (0.5 + margin), middle + width * (0.5 + margin)


def _predicted_label(stretch: StretchComparison) -> str:
    orbit = stretch.predicted
    return 'predicted' if orbit is None or orbit.stable else f'predicted, but {orbit.stability}'


#: Stretches that are numbered in the picture of the whole run; more would run into each other.
_MOST_NUMBERS = 30
#: Pieces of a narrow picture of the whole run, all stretches together; a wide one has four times
#: as many.
_MOST_PIECES = 300
#: Cycles of the force, in all, that can be distinguished in it.
_MOST_CYCLES = 160
#: Share of the width of that picture that a number of a stretch takes.
_NUMBER = 0.02


def _cycles(stretch: StretchComparison) -> float:
    """Return the number of cycles of the force in a stretch."""
    return (stretch.end - stretch.start) * stretch.parameters.force_frequencies[0] / math.tau


def _outline(stretch: StretchComparison, envelope: SwingEnvelope, most: float) -> Array:
    """Return the outline of an envelope with a largest number of pieces, rows of time and X."""
    # Equal pieces: a short one at the end would not hold a whole oscillation.
    count = min(len(envelope.time), int(most))
    starts = np.arange(count) * len(envelope.time) // count
    low, high = np.fmin.reduceat(envelope.low, starts), np.fmax.reduceat(envelope.high, starts)
    # The last piece reaches to the end of the stretch
    time = np.append(envelope.time[starts], stretch.end)
    low, high = np.append(low, low[-1]), np.append(high, high[-1])
    outline = np.array([[*time, *time[::-1]], [*low, *high[::-1]]]).T
    finite: Array = outline[np.isfinite(outline).all(axis=1)]
    return finite


def _fill(axes: Any, outlines: Sequence[Array]) -> None:
    """Fill several areas as one path, which takes less room than many."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    paths = [Path(np.vstack([o, o[:1]]), closed=True) for o in outlines if len(o)]
    if paths:
        joined = Path.make_compound_path(*paths)
        style = {'color': COLORS['primary'], 'alpha': 0.6, 'linewidth': 0.6, 'zorder': 2}
        axes.add_patch(PathPatch(joined, **style))


def _level_lines(stretches: Sequence[StretchComparison]) -> Array:
    """Return the predicted largest |X| on both sides, from where each stretch is steady."""
    rows = []
    for stretch in stretches:
        # What is not stable cannot last
        if stretch.predicted is not None and stretch.predicted.stable:
            level = stretch.predicted.x_max
            since = stretch.start if stretch.settled_at is None else stretch.settled_at
            for side in (-level, level):
                rows += [(since, side), (stretch.end, side), (math.nan, math.nan)]
    return np.array(rows).reshape(-1, 2)


def draw_run(stretches: Sequence[StretchComparison], *, wide: bool = True) -> Picture | None:
    """Draw X over the whole run, with the largest |X| that theory predicts for each stretch."""
    shown = [
        (stretch, stretch.curves.envelope)
        for stretch in stretches
        if stretch.curves.envelope is not None and len(stretch.curves.envelope.time)
    ]
    if not shown:
        return None
    levels = _level_lines(stretches)
    sizes = [np.abs([envelope.low, envelope.high]).ravel() for _, envelope in shown]
    joined = np.concatenate([*sizes, levels[:, 1]])
    reach = float(np.max(joined[np.isfinite(joined)], initial=0.0))
    unit = unit_for('m', reach)
    reach = unit.factor * reach or 1.0
    chart = _Chart('rig time [s]', f'X [{unit.name}]', wide=wide, height=2.8)
    few = len(stretches) <= _MOST_NUMBERS
    crowded = sum(map(_cycles, stretches)) > _MOST_CYCLES
    begin, end = stretches[0].start, stretches[-1].end
    least = 8.0 if wide else 2.0
    chart.axes.set_ylim(-1.12 * reach, 1.3 * reach)
    outlines = []
    for stretch, envelope in shown:
        most = max(least, (4.0 if wide else 1.0) * _MOST_PIECES / len(shown))
        if crowded:
            # Cycles drawn one by one would only make a pattern of their own
            most = min(most, max(least, _cycles(stretch)))
        outlines.append(_outline(stretch, envelope, most) * (1.0, unit.factor))
    _fill(chart.axes, outlines)
    chart.entry('patch', 'primary', 'X as recorded')
    if len(levels):
        label = 'largest |X| of the stable motion predicted'
        time, level = levels.T
        chart.line(time, unit.factor * level, 'theory', 1.5, label, 'dashed', zorder=3)
    starts = np.array([stretch.start for stretch in stretches[1:]])
    edges = np.tile([*chart.axes.get_ylim(), math.nan], len(starts))
    chart.line(np.repeat(starts, 3), edges, 'quiet', 0.7 if few else 0.3)
    room = _NUMBER * (end - begin) * (1.0 if wide else 2.5)
    numbered = -math.inf
    for stretch in stretches:
        # A number that would cover the one before is left out
        if few and stretch.start - numbered >= room:
            numbered = stretch.start
            chart.axes.annotate(
                str(stretch.number),
                (stretch.start, 1.28 * reach),
                xytext=(4, 0),
                textcoords='offset points',
                va='top',
                fontweight='bold',
            )
    chart.axes.set_xlim(begin, end if end > begin else begin + 1.0)
    caption = 'Displacement of the primary mass over the whole run. A stretch begins at each '
    caption += 'upright line.'
    return chart.picture('The whole run', caption, columns=0 if wide else 1)


# The predicted motion over any time


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


def predicted_lines(curve: PredictedCurve, highest: float) -> tuple[Array, Array]:
    """Return the lines of the spectrum of the predicted X."""
    period = curve.cycles * curve.cycle
    if not (len(curve.phase) > 2 and highest * period >= 1.0):
        return np.empty(0), np.empty(0)
    orders = np.arange(1, math.floor(highest * period) + 1)
    angle = math.tau * (curve.phase - curve.phase[0]) / curve.cycles
    signal = curve.x * np.exp(-1j * orders[:, None] * angle)
    lines = (0.5 * (signal[:, 1:] + signal[:, :-1]) * np.diff(angle)).sum(axis=1) / math.pi
    return orders / period, np.abs(lines)


#: Share of the time history that a narrow picture of it shows.
_LAST = 3.0 / 8.0


def _end_of(motion: MotionCurve) -> MotionCurve:
    """Return the last part of a motion, as much as fits into a narrow picture."""
    start, end = motion.time[0], motion.time[-1]
    late = motion.time >= end - _LAST * (end - start)
    return MotionCurve(*(getattr(motion, f.name)[late] for f in fields(motion)))


def _draw_impacts(
    chart: _Chart, impacts: Events | None, motion: MotionCurve, factor: float
) -> None:
    """Draw the recorded impacts where m hits, with a mark for each stop."""
    if impacts is None:
        return
    times = impacts['time']
    inside = (times >= motion.time[0]) & (times <= motion.time[-1])
    label = 'impact'
    for stop, marker in ((1, '^'), (2, 'v')):
        chosen = inside & (impacts['stop'] == stop)
        if chosen.any():
            time = times[chosen]
            place = (impacts['x'] + impacts['y'])[chosen]
            chart.marks(time, factor * place, 'damper', marker, 7, label)
            label = ''


def _motion_of(stretch: StretchComparison) -> MotionCurve | None:
    motion = stretch.curves.motion
    known = motion is not None and len(motion.time) > 1 and np.isfinite(motion.time).all()
    return motion if known else None


def draw_history(stretch: StretchComparison, *, wide: bool = True) -> Picture | None:
    """Draw the end of a stretch as recorded, with the predicted motion and impacts over it."""
    motion, theory = _motion_of(stretch), stretch.curves.predicted
    if motion is None:
        return None
    if not wide:
        motion = _end_of(motion)
    z = motion.x + motion.y
    unit = unit_for('m', motion.x, z)
    chart = _Chart('rig time [s]', f'position along the axis [{unit.name}]', wide=wide)
    width = motion.stop_1 - motion.stop_2
    depth = 0.1 * unit.factor * float(np.max(width[np.isfinite(width)], initial=0.0))
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        if np.isfinite(edge).any():
            draw_stop(chart.axes, motion.time, unit.factor * (motion.x + edge), side * depth)
    chart.line(motion.time, unit.factor * motion.x, 'primary', 2.6, 'X, primary mass')
    chart.line(motion.time, unit.factor * z, 'damper', 1.9, 'Z, loose mass')
    chart.entry('patch', 'stop', 'stops')
    _draw_impacts(chart, stretch.curves.impacts, motion, unit.factor)
    start, end = float(motion.time[0]), float(motion.time[-1])
    caption = 'The end of the stretch as recorded.'
    if theory is not None:
        time, x, y = predicted_motion(theory, start, end)
        chart.line(time, unit.factor * x, 'theory', 1.0, look='dashed', zorder=3.5)
        label = _predicted_label(stretch)
        chart.line(time, unit.factor * (x + y), 'theory', 1.0, label, 'dashed', zorder=3.5)
        hit, place = predicted_impacts(stretch, start, end)
        for at in hit:
            chart.axes.axvline(at, color=COLORS['quiet'], linewidth=0.6, zorder=1)
        chart.rings(hit, unit.factor * place, 10.0, 'its impacts')
        caption += ' Over it is the predicted motion, with its impacts as rings.'
    chart.axes.set_xlim(start, end if end > start else start + 1e-9)
    return chart.picture('Time history', caption, columns=0 if wide else 3)


def _portrait(
    stretch: StretchComparison, measured: tuple[Array, Array], color: str, names: tuple[str, str]
) -> tuple[_Chart, float]:
    """Draw a velocity over its position; return the chart and the factor of positions."""
    place, rate = unit_for('m', measured[0]), unit_for('m/s', measured[1])
    chart = _Chart(f'{names[0]} [{place.name}]', f'{names[1]} [{rate.name}]')
    chart.line(place.factor * measured[0], rate.factor * measured[1], color, 2.0, 'as recorded')
    drawn = [measured]
    theory = stretch.curves.predicted
    if theory is not None and len(theory.x):
        x, velocity = theory.x, theory.velocity
        if color == 'damper':
            x, velocity = theory.y, theory.relative_velocity
        drawn.append((x, velocity))
        label = _predicted_label(stretch)
        x, velocity = place.factor * x, rate.factor * velocity
        chart.line(x, velocity, 'theory', 1.1, label, 'dashed', zorder=3)
    places, rates = zip(*drawn, strict=True)
    chart.axes.set_xlim(*(place.factor * edge for edge in _finite_range(*places)))
    chart.axes.set_ylim(*(rate.factor * edge for edge in _finite_range(*rates)))
    return chart, place.factor


def _draw_primary_portrait(stretch: StretchComparison) -> Picture | None:
    motion = _motion_of(stretch)
    if motion is None or not np.any(motion.velocity):
        return None
    chart, _ = _portrait(stretch, (motion.x, motion.velocity), 'primary', ('X', 'X′'))
    caption = 'Velocity of the primary mass over its displacement; each impact is a step.'
    return chart.picture('Phase portrait of M', caption)


def _draw_damper_portrait(stretch: StretchComparison) -> Picture | None:
    motion = _motion_of(stretch)
    if motion is None or not np.any(motion.relative_velocity):
        return None
    measured = (motion.y, motion.relative_velocity)
    chart, factor = _portrait(stretch, measured, 'damper', ('Y = Z − X', 'Y′'))
    left, right = chart.axes.get_xlim()
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        place = factor * float(edge[-1])
        if math.isfinite(place):
            outer = place + side * 0.03 * (right - left)
            chart.axes.axvspan(place, outer, color=COLORS['stop'], alpha=0.4, linewidth=0)
            left, right = min(left, outer), max(right, outer)
    chart.axes.set_xlim(left, right)
    caption = 'Motion of the loose mass within M, between the stops (grey).'
    return chart.picture('Phase portrait of m relative to M', caption)


#: Least height of the Poincaré section, as a share of the largest velocity in it.
_LEAST = 0.05
#: More marks than this are drawn as pixels, which take the same room for any number.
_MOST_MARKS = 300
#: Points closer than the width of the axes by this are one.
_RASTER = 700.0
#: Colours for pixels, visible on a light and on a dark page.
_BOTH = {'primary': '#2b83c4', 'damper': '#d0661c'}


class _Points(NamedTuple):
    """Points in a section: where they are, their mark if there are few, colour and opacity."""

    x: Array
    y: Array
    marker: str
    color: str
    alpha: float


def _cloud(axes: Any, kinds: Sequence[_Points]) -> None:
    """Draw points: coinciding ones once, very many as the pixels of an image."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    rows = []
    for kind in kinds:
        place = np.stack([(kind.x - left) / (right - left), (kind.y - low) / (high - low)])
        rows.append(np.unique(np.round(_RASTER * place), axis=1, return_index=True)[1])
    # All kinds alike, so that none looks as if it had more points
    dense = sum(map(len, rows)) > _MOST_MARKS
    for kind, seen in zip(kinds, rows, strict=True):
        axes.plot(
            kind.x[seen],
            kind.y[seen],
            linestyle='none',
            marker='o' if dense else kind.marker,
            markersize=1.6 if dense else 4.5,
            markeredgewidth=0,
            color=_BOTH[kind.color] if dense else COLORS[kind.color],
            alpha=max(kind.alpha, 0.6) if dense else kind.alpha,
            rasterized=dense,
            clip_on=dense,
            zorder=2,
        )


def _draw_section(stretch: StretchComparison) -> Picture | None:
    """Draw phase and velocity of m just after each impact."""
    impacts, orbit, phases = stretch.curves.impacts, stretch.predicted, stretch.curves.phases
    if impacts is None or phases is None:
        return None
    after = impacts['damper_velocity_after']
    known = np.isfinite(phases) & np.isfinite(after)
    if not known.any():
        return None
    velocities = [after[known]]
    if orbit is not None:
        velocities.append(np.array(orbit.damper_velocity_after))
    rate = unit_for('m/s', *velocities)
    chart = _Chart(
        'phase of the force at the impact [cycles]', f'Z′ just after the impact [{rate.name}]'
    )
    chart.axes.set_xlim(0.0, 1.0)
    # Points at one place, a settled motion on one stop, need no axis of seven digits
    sizes = np.abs(np.concatenate(velocities))
    least = _LEAST * float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    limits = _finite_range(*velocities, margin=0.1, least=least)
    chart.axes.set_ylim(*(rate.factor * edge for edge in limits))
    settled = np.full(len(known), True)
    if stretch.settled_at is not None:
        settled = impacts['time'] >= stretch.settled_at
    kinds = []
    for stop, marker, color in ((1, '^', 'damper'), (2, 'v', 'primary')):
        chosen = known & (impacts['stop'] == stop)
        for part, alpha in ((chosen & ~settled, 0.35), (chosen & settled, 1.0)):
            if part.any():
                velocity = rate.factor * after[part]
                kinds.append(_Points(phases[part], velocity, marker, color, alpha))
        if chosen.any():
            chart.entry(marker, color, f'on stop {stop}')
    _cloud(chart.axes, kinds)
    caption = f'The state just after each of the {known.sum()} latest impacts'
    caption += ', faint before the motion is steady.' if not settled.all() else '.'
    caption += ' A periodic motion shows as many points as it has impacts, a quasi-periodic one '
    caption += 'closed curves.'
    if orbit is not None:
        places = [phase % 1.0 for phase in orbit.phases]
        velocity = rate.factor * np.array(orbit.damper_velocity_after)
        chart.rings(places, velocity, 12.0, _predicted_label(stretch))
    return chart.picture('Poincaré section', caption)


#: Periods of the convergence that are drawn after it has reached its floor, at least.
_TAIL = 20


def _slopes(chart: _Chart, curve: Convergence) -> None:
    """Draw the decay as measured and as predicted, within the axes."""
    low, high = chart.axes.get_ylim()
    part = slice(curve.fitted_from, curve.fitted_to)
    time, distance = curve.time[part], curve.distance[part]
    count = np.arange(len(time))
    used = np.isfinite(distance) & (distance > 0.0)
    if used.sum() < 2:
        return
    for factor, name, look, label in (
        (curve.measured, 'damper', 'line', 'measured'),
        (curve.predicted, 'theory', 'dashed', 'predicted'),
    ):
        if math.isfinite(factor) and factor > 0.0:
            # Through the middle of the points, so that the slopes can be compared
            begin = np.mean(np.log(distance[used]) - count[used] * math.log(factor))
            slope = np.exp(begin + count * math.log(factor))
            slope = np.where((slope >= low) & (slope <= high), slope, np.nan)
            label = f'{label}: × {number(factor, 4)} per period'
            chart.line(time, slope, name, 1.8, label, look, zorder=3)


def _draw_convergence(stretch: StretchComparison) -> Picture | None:
    """Draw the distance from the periodic motion, period by period."""
    curve = stretch.curves.convergence
    if curve is None:
        return None
    shown = np.isfinite(curve.distance) & (curve.distance > 0.0)
    if shown.sum() < 2:
        return None
    above = np.flatnonzero(shown & (curve.distance > curve.floor))
    if len(above):
        # Distances at the floor carry no information
        shown[above[-1] + 1 + max(_TAIL, len(above) // 2) :] = False
    chart = _Chart('rig time [s]', 'relative distance')
    low, high = float(curve.distance[shown].min()), float(curve.distance[shown].max())
    marks: dict[str, Any] = {'marker': 'o', 'markersize': 2.4} if shown.sum() < 150 else {}
    if curve.floor > 0.0:
        low = min(low, curve.floor)
        chart.axes.axhspan(1e-3 * low, curve.floor, color=COLORS['stop'], alpha=0.3, linewidth=0)
    chart.log_axis(0.2 * low, 4.0 * high)
    time, distance = curve.time[shown], curve.distance[shown]
    chart.line(time, distance, 'primary', 1.0, 'as recorded', **marks)
    if curve.floor > 0.0:
        chart.entry('patch', 'stop', 'below the resolution of the log')
    _slopes(chart, curve)
    chart.axes.set_xlim(*_finite_range(time, margin=0.02))
    caption = 'Distance of the impacts of each period from those of the periodic motion. The '
    caption += 'slope is the decay per period; the prediction is the largest multiplier.'
    return chart.picture('Convergence', caption, columns=2)


#: Harmonics of the force up to which the spectrum is drawn, with room for the last.
_HARMONICS = 9.4
#: How far below the largest line the spectrum is drawn, as a factor.
_DEPTH = 1e-6
#: Predicted lines below this share of the largest are errors of the integration.
_SEEN = 1e-5


def _draw_spectrum(stretch: StretchComparison) -> Picture | None:
    """Draw the amplitude spectrum of X."""
    curve, theory = stretch.curves.spectrum, stretch.curves.predicted
    if curve is None or len(curve.frequency) < 2:
        return None
    finite = np.isfinite(curve.amplitude)
    largest = float(np.max(curve.amplitude[finite], initial=0.0))
    highest = float(curve.frequency[-1])
    driven = curve.force_frequency > 0.0
    if driven:
        highest = min(highest, _HARMONICS * curve.force_frequency)
    if largest <= 0.0 or not highest > 0.0:
        return None
    unit, rate = unit_for('m', largest), unit_for('Hz', highest)
    chart = _Chart(f'frequency [{rate.name}]', f'amplitude of X [{unit.name}]')
    at, lines = (np.empty(0),) * 2 if theory is None else predicted_lines(theory, highest)
    top = max(largest, float(np.nanmax(lines, initial=0.0)))
    chart.log_axis(_DEPTH * unit.factor * largest, 5.0 * unit.factor * top)
    inside = finite & (curve.frequency <= highest) & (curve.amplitude > 0.0)
    x, y = rate.factor * curve.frequency[inside], unit.factor * curve.amplitude[inside]
    chart.line(x, y, 'primary', 1.1, 'as recorded')
    caption = f'The end of the stretch, {curve.window} window, lines {number(curve.resolution, 3)}'
    caption += ' Hz wide.'
    if driven:
        for n in range(1, math.floor(highest / curve.force_frequency) + 1):
            line = rate.factor * n * curve.force_frequency
            chart.axes.axvline(line, color=COLORS['quiet'], linewidth=0.7, linestyle=DOTTED)
        chart.entry('dotted', 'quiet', 'multiples of the force')
    if theory is not None:
        seen = lines > _SEEN * largest
        x, y = rate.factor * at[seen], unit.factor * lines[seen]
        chart.rings(x, y, 8.0, _predicted_label(stretch))
        caption += ' Rings: the Fourier coefficients of the predicted motion.'
    chart.axes.set_xlim(0.0, rate.factor * highest)
    return chart.picture('Spectrum', caption)


#: How much higher than all else the part of a gap curve may be that is not viable.
_TALLEST = 2.5
_MOST_SPECIAL = 6


def _top(curve: GapCurve) -> float:
    """Return where the axis of Xmax/A ends, above all of the curve if that can be."""
    special = curve.special_ratio[np.isfinite(curve.special_ratio)]
    others = (special, [curve.measured_ratio, 0.0])
    wanted = _finite_range(curve.ratio[curve.viable], *others, margin=0.08)[1]
    everything = _finite_range(curve.ratio, *others, margin=0.08)[1]
    # Motions that the rig cannot perform must not press the others down
    return everything if everything <= _TALLEST * wanted else wanted


def _draw_gap_curve(stretch: StretchComparison) -> Picture | None:
    """Draw Xmax/A over the gap, with this run."""
    curve = stretch.curves.gap_curve
    if curve is None or not np.isfinite(curve.ratio).any():
        return None
    unit = unit_for('m', curve.measured_gap)
    chart = _Chart(f'gap d [{unit.name}]', 'Xmax / A')
    top = _top(curve)
    inside = curve.ratio <= top
    looks = (
        ('line', 'theory', 2.0, 'stable'),
        ('dashed', 'theory', 1.2, 'unstable'),
        ('dotted', 'quiet', 1.0, 'not viable'),
    )
    kinds = np.where(curve.viable, np.where(curve.stable, 0, 1), 2)
    for begin, end in pairwise([0, *(np.flatnonzero(np.diff(kinds)) + 1), len(kinds)]):
        look, color, width, _ = looks[kinds[begin]]
        # Each piece reaches to the first point of the next
        piece = slice(begin, end + 1)
        x, y = unit.factor * curve.gap[piece], np.where(inside, curve.ratio, np.nan)[piece]
        chart.line(x, y, color, width, look=look)
    for kind in sorted(set(kinds.tolist())):
        look, color, _, label = looks[kind]
        chart.entry(look, color, label)
    special = np.isfinite(curve.special_ratio)
    if special.any():
        x, y = unit.factor * curve.special_gap[special], curve.special_ratio[special]
        style = {'markeredgewidth': 1.2, 'clip_on': True, 'zorder': 3}
        chart.rings(x, y, 5, 'special point', 'special', 'D', **style)
    if math.isfinite(curve.measured_ratio):
        at = unit.factor * curve.measured_gap
        chart.axes.axvline(at, color=COLORS['quiet'], linewidth=0.7, zorder=1)
        chart.marks([at], [curve.measured_ratio], 'damper', '*', 14, 'this run')
    chart.axes.set_ylim(0.0, top)
    caption = _gap_caption(curve, unit.factor, unit.name)
    if (np.isfinite(curve.ratio) & ~inside).any():
        caption += f' Motions that are not viable are not drawn above {number(top, 2)}.'
    return chart.picture('Largest |X| over the gap', caption, columns=3)


def _gap_caption(curve: GapCurve, factor: float, unit: str) -> str:
    stops = ', '.join(map(str, curve.stops))
    caption = f'The predicted motion (stops {stops}) followed in the gap, all else as logged; A '
    caption += 'is the amplitude without impacts. The line is full where the motion is stable, '
    caption += 'dashed where it is unstable, dotted where it is not viable.'
    sound = np.flatnonzero(curve.stable & curve.viable & np.isfinite(curve.ratio))
    if len(sound):
        best = sound[np.argmin(curve.ratio[sound])]
        where = 'on this branch' if 0 < best < len(curve.gap) - 1 else 'at the end of this branch'
        caption += f' Least {where}: {number(float(curve.ratio[best]), 3)} at a gap of '
        caption += f'{number(factor * float(curve.gap[best]), 3)} {unit}.'
        if where.startswith('at'):
            caption += ' It was not followed further, where M may move less.'
    points = [
        f'{kind} at {number(factor * float(gap), 4)} {unit}'
        for kind, gap in zip(curve.special_kind, curve.special_gap, strict=False)
    ]
    if points:
        left = len(points) - _MOST_SPECIAL
        more = f' and {left} more' if left > 0 else ''
        caption += f' Special points: {", ".join(points[:_MOST_SPECIAL])}{more}.'
    return caption


#: Charts of a stretch by the name that begins their ids, in the order of the page.
PICTURES: dict[str, Callable[[StretchComparison], Picture | None]] = {
    'history': draw_history,
    'portrait': _draw_primary_portrait,
    'relative': _draw_damper_portrait,
    'section': _draw_section,
    'spectrum': _draw_spectrum,
    'convergence': _draw_convergence,
    'gap': _draw_gap_curve,
}
