# SPDX-License-Identifier: Apache-2.0
"""
Charts of the report: the whole run, and a stretch in time, phase plane, section and spectrum.

They are drawn in SI units; the numbers at an axis are those of a handy unit. Each chart of a
stretch is None if too little is recorded to draw it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from impact_damper_ros.compare.result import (
    Array,
    Convergence,
    LogVerdict,
    MotionCurve,
    PredictedCurve,
    StretchComparison,
)
from impact_damper_ros.orbits.settled_motion import cycle_of

from .drawing import COLORS, IMPACTS, MOTION_LINES, draw_impacts, draw_stop, unit_axis
from .formatting import number, quantity
from .ring_down_figure import draw_decay, draw_loss
from .swept_response_figure import draw_response

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Widths in inches. A narrow picture fits a phone as it is; a wide one is scrolled there.
NARROW, WIDE = 5.3, 10.9
#: Room beside the axes, left, right and below, and above them, for each row of the legend too.
_MARGINS, _TOP, _ROW = (0.78, 0.22, 0.5), 0.12, 0.185
_RINGS: dict[str, Any] = {
    'linestyle': 'none',
    'marker': 'o',
    'markersize': 9.0,
    'markeredgecolor': COLORS['theory'],
    'markerfacecolor': 'none',
    'markeredgewidth': 1.3,
    'clip_on': False,
    'zorder': 4,
}


class Picture(NamedTuple):
    """A figure, its title and its caption."""

    figure: Figure
    title: str
    caption: str

    @property
    def wide(self) -> bool:
        """Whether it is as wide as the page."""
        return bool(self.figure.get_figwidth() == WIDE)


def _panel(x_label: str, y_label: str, *, wide: bool = False, height: float = 3.7) -> Any:
    """Return the axes of a new figure."""
    from matplotlib.figure import Figure

    width = WIDE if wide else NARROW
    figure = Figure(figsize=(width, height))
    axes = figure.subplots()
    axes.set(xlabel=x_label, ylabel=y_label)
    # matplotlib's own layouts take longer than the drawing.
    left, right, bottom = _MARGINS
    figure.subplots_adjust(left / width, bottom / height, 1.0 - right / width)
    return axes


def _picture(axes: Any, title: str, caption: str, columns: int = 0) -> Picture:
    """Put the legend above the axes, where it hides nothing; return the picture."""
    count = len(axes.get_legend_handles_labels()[0])
    columns = columns or max(1, count)
    room = _TOP + _ROW * math.ceil(count / columns)
    axes.figure.subplots_adjust(top=1.0 - room / axes.figure.get_figheight())
    axes.legend(
        loc='lower left',
        bbox_to_anchor=(-0.01, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.1,
        columnspacing=1.1,
        handlelength=1.6,
        handletextpad=0.5,
        labelspacing=0.25,
        markerscale=0.8,
    )
    return Picture(axes.figure, title, caption)


def _log_axis(axes: Any, low: float, high: float, factor: float = 1.0) -> None:
    """Make the vertical axis logarithmic, from `low` to `high`, with few labels."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.set_yscale('log')
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_major_formatter(lambda value, _: number(factor * value, 1))
    axes.yaxis.set_minor_locator(NullLocator())


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


def _prediction(stretch: StretchComparison) -> dict[str, Any]:
    """Return line and label of the predicted motion, by its stability."""
    orbit = stretch.predicted
    words = 'stable' if orbit is None else orbit.stability
    label = 'predicted' if words == 'stable' else f'predicted, but {words}'
    # Over the recorded motion, which is wider, each is in the ink of the theory.
    look = {'color': COLORS['theory'], 'linewidth': 1.0, 'zorder': 3.5}
    return {**MOTION_LINES[words], **look, 'label': label}


#: Stretches that are numbered in the picture of the whole run; more would run into each other.
_MOST_NUMBERS = 30
#: Pieces of the picture of the whole run, all stretches together, and of one of them at least.
_MOST_PIECES, _LEAST_PIECES = 1200.0, 8.0
#: Cycles of the force, in all, that can be distinguished in it.
_MOST_CYCLES = 160
#: Share of the width of that picture that a number of a stretch takes.
_NUMBER = 0.02


def _cycles(stretch: StretchComparison) -> float:
    """Return the number of cycles of the force in a stretch."""
    return (stretch.end - stretch.start) / cycle_of(stretch.parameters)


def _as_in_the_log(*stretches: StretchComparison) -> str:
    """Return whether the curves of stretches, which are those of the replay, are in the log."""
    differs = any(stretch.log is LogVerdict.DIFFERS for stretch in stretches)
    return 'as replayed' if differs else 'as recorded'


def _coarser(stretch: StretchComparison, envelope: Array, most: float) -> Array:
    """Return time, least and greatest X of at most so many pieces, up to the end."""
    # Equal pieces: a short one at the end would not hold a whole oscillation.
    time, low, high = envelope
    count = min(len(time), int(most))
    starts = np.arange(count) * len(time) // count
    low, high = np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)
    # The last piece reaches to the end of the stretch
    rows = np.array([time[starts], low, high])
    return np.hstack([rows, [[stretch.end], [low[-1]], [high[-1]]]])


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


def draw_run(stretches: Sequence[StretchComparison]) -> Picture | None:
    """Draw X over the whole run, with the largest |X| that theory predicts for each stretch."""
    shown = [
        (stretch, stretch.curves.envelope)
        for stretch in stretches
        if stretch.curves.envelope is not None and stretch.curves.envelope.size
    ]
    if not shown:
        return None
    axes = _panel('rig time [s]', '', wide=True, height=2.8)
    # Cycles drawn one by one would only make a pattern of their own
    crowded = sum(map(_cycles, stretches)) > _MOST_CYCLES
    pieces = []
    for stretch, envelope in shown:
        count = max(_LEAST_PIECES, _MOST_PIECES / len(shown))
        if crowded:
            count = min(count, max(_LEAST_PIECES, _cycles(stretch)))
        pieces.append(_coarser(stretch, envelope, count))
    time, low, high = np.hstack(pieces)
    color, how = COLORS['primary'], _as_in_the_log(*stretches)
    axes.fill_between(time, low, high, color=color, alpha=0.6, linewidth=0.6, label=f'X {how}')
    times, levels = _level_lines(stretches).T
    if len(levels):
        look = {**MOTION_LINES['stable'], 'linewidth': 1.2, 'zorder': 3}
        axes.plot(times, levels, **look, label='largest |X| of the stable motion predicted')
    joined = np.abs(np.concatenate([low, high, levels]))
    reach = float(np.max(joined[np.isfinite(joined)], initial=0.0))
    unit_axis(axes.yaxis, 'X', 'm', reach)
    reach = reach or 1.0
    axes.set_ylim(-1.12 * reach, 1.3 * reach)
    few = len(stretches) <= _MOST_NUMBERS
    starts = np.repeat([stretch.start for stretch in stretches[1:]], 3)
    edges = np.tile([*axes.get_ylim(), math.nan], len(stretches) - 1)
    axes.plot(starts, edges, color=COLORS['quiet'], linewidth=0.7 if few else 0.3)
    begin, end = stretches[0].start, stretches[-1].end
    room = _NUMBER * (end - begin)
    numbered = -math.inf
    for stretch in stretches:
        # A number that would cover the one before is left out
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
    caption = 'Displacement of the primary mass over the whole run. A stretch begins at each '
    caption += 'upright line.'
    return _picture(axes, 'The whole run', caption)


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


def _motion_of(stretch: StretchComparison) -> MotionCurve | None:
    motion = stretch.curves.motion
    return motion if motion is not None and np.ptp(motion.time) > 0.0 else None


def draw_history(stretch: StretchComparison) -> Picture | None:
    """Draw the end of a stretch, with the predicted motion and impacts over it."""
    motion, theory = _motion_of(stretch), stretch.curves.predicted
    if motion is None:
        return None
    z = motion.x + motion.y
    axes = _panel('rig time [s]', '', wide=True)
    unit_axis(axes.yaxis, 'position along the axis', 'm', motion.x, z)
    axes.plot(
        motion.time, motion.x, color=COLORS['primary'], linewidth=3.6, label='X, primary mass'
    )
    axes.plot(motion.time, z, color=COLORS['damper'], linewidth=2.8, label='Z, loose mass')
    width = motion.stop_1 - motion.stop_2
    depth = 0.1 * float(np.max(width[np.isfinite(width)], initial=0.0))
    label = 'stops'
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        if np.isfinite(edge).any():
            draw_stop(axes, motion.time, motion.x + edge, side * depth, label)
            label = ''
    start, end = float(motion.time[0]), float(motion.time[-1])
    if stretch.curves.impacts is not None:
        draw_impacts(axes, stretch.curves.impacts, start, end)
    caption = f'The end of the stretch {_as_in_the_log(stretch)}.'
    if theory is not None:
        time, x, y = predicted_motion(theory, start, end)
        look = _prediction(stretch)
        axes.plot(time, x, **look)
        axes.plot(time, x + y, **{**look, 'label': ''})
        hit, place = predicted_impacts(stretch, start, end)
        for at in hit:
            axes.axvline(at, color=COLORS['quiet'], linewidth=0.5, alpha=0.6, zorder=1)
        axes.plot(hit, place, **_RINGS, label='its impacts')
        caption += ' Over it is the predicted motion, with its impacts as rings.'
    axes.set_xlim(start, end)
    return _picture(axes, 'Time history', caption)


def _portrait(
    stretch: StretchComparison, names: tuple[str, str], color: str, labels: tuple[str, str]
) -> Any:
    """Draw a velocity over its position, by their names in both curves; return the axes."""
    motion, theory = stretch.curves.motion, stretch.curves.predicted
    places, rates = [[getattr(motion, name)] for name in names]
    axes = _panel('', '')
    unit_axis(axes.xaxis, labels[0], 'm', places[0])
    unit_axis(axes.yaxis, labels[1], 'm/s', rates[0])
    # Of a motion that repeats, one curve lies below that of the theory.
    width = 1.4 if stretch.settled_at is None else 2.6
    how = _as_in_the_log(stretch)
    axes.plot(places[0], rates[0], color=COLORS[color], linewidth=width, label=how)
    if theory is not None and len(theory.x):
        places.append(getattr(theory, names[0]))
        rates.append(getattr(theory, names[1]))
        axes.plot(places[1], rates[1], **_prediction(stretch))
    axes.set(xlim=_finite_range(*places), ylim=_finite_range(*rates))
    return axes


def _draw_primary_portrait(stretch: StretchComparison) -> Picture | None:
    motion = _motion_of(stretch)
    if motion is None or not np.any(motion.velocity):
        return None
    axes = _portrait(stretch, ('x', 'velocity'), 'primary', ('X', 'X′'))
    caption = 'Velocity of the primary mass over its displacement; each impact is a step.'
    return _picture(axes, 'Phase portrait of M', caption)


def _draw_damper_portrait(stretch: StretchComparison) -> Picture | None:
    motion = _motion_of(stretch)
    if motion is None or not np.any(motion.relative_velocity):
        return None
    axes = _portrait(stretch, ('y', 'relative_velocity'), 'damper', ('Y = Z − X', 'Y′'))
    left, right = axes.get_xlim()
    depth = 0.03 * (right - left)
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        place = float(edge[-1])
        if math.isfinite(place):
            outer = place + side * depth
            axes.axvspan(place, outer, color=COLORS['stop'], alpha=0.4, linewidth=0)
            left, right = min(left, outer), max(right, outer)
    axes.set_xlim(left, right)
    caption = 'Motion of the loose mass within M, between the stops (grey).'
    return _picture(axes, 'Phase portrait of m relative to M', caption)


#: Least height of the Poincaré section, as a share of the largest velocity in it.
_LEAST = 0.05
#: More marks than this are drawn as pixels, which take the same room for any number.
_MOST_MARKS = 300
#: Points closer than the width of the axes by this are one.
_RASTER = 700.0
#: Colours of the stops for pixels, visible on a light and on a dark page.
_BOTH = {1: '#17a0a8', 2: '#9a72d0'}


class _Points(NamedTuple):
    """Points in a section: where they are, on which stop, and opacity."""

    x: Array
    y: Array
    stop: int
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
    pixels = {'marker': 'o', 'markersize': 1.6, 'rasterized': True}
    for kind, seen in zip(kinds, rows, strict=True):
        look = {**IMPACTS[kind.stop], 'markersize': 4.5}
        look |= {**pixels, 'color': _BOTH[kind.stop]} if dense else {}
        axes.plot(
            kind.x[seen],
            kind.y[seen],
            linestyle='none',
            markeredgewidth=0,
            alpha=max(kind.alpha, 0.6) if dense else kind.alpha,
            clip_on=dense,
            zorder=2,
            **look,
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
    axes = _panel('phase of the force at the impact [cycles]', '')
    unit_axis(axes.yaxis, 'Z′ just after the impact', 'm/s', *velocities)
    axes.set_xlim(0.0, 1.0)
    # Points at one place, a settled motion on one stop, need no axis of seven digits
    sizes = np.abs(np.concatenate(velocities))
    least = _LEAST * float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    axes.set_ylim(_finite_range(*velocities, margin=0.1, least=least))
    settled = np.full(len(known), True)
    if stretch.settled_at is not None:
        settled = impacts['time'] >= stretch.settled_at
    kinds = []
    for stop, look in IMPACTS.items():
        chosen = known & (impacts['stop'] == stop)
        for part, alpha in ((chosen & ~settled, 0.35), (chosen & settled, 1.0)):
            if part.any():
                kinds.append(_Points(phases[part], after[part], stop, alpha))
        if chosen.any():
            axes.plot([], [], linestyle='none', **look, label=f'on stop {stop}')
    _cloud(axes, kinds)
    caption = f'The state just after each of the {known.sum()} latest impacts'
    caption += ', faint before the motion is steady.' if not settled.all() else '.'
    caption += ' A periodic motion shows as many points as it has impacts, a quasi-periodic one '
    caption += 'closed curves.'
    if orbit is not None:
        places = [phase % 1.0 for phase in orbit.phases]
        label = _prediction(stretch)['label']
        look = {**_RINGS, 'markersize': 12.0, 'label': label}
        axes.plot(places, orbit.damper_velocity_after, **look)
    return _picture(axes, 'Poincaré section', caption)


#: Periods of the convergence that are drawn after it has reached its floor, at least.
_TAIL = 20


def _slopes(axes: Any, curve: Convergence) -> None:
    """Draw the decay as measured and as predicted, within the axes."""
    low, high = axes.get_ylim()
    part = slice(curve.first, curve.first + curve.decay.periods)
    time, distance = curve.time[part], curve.distance[part]
    count = np.arange(len(time))
    used = np.isfinite(distance) & (distance > 0.0)
    if used.sum() < 2:
        return
    for factor, color, width, label in (
        (curve.decay.measured, 'primary', 3.4, 'measured'),
        (curve.decay.predicted, 'theory', 1.2, 'predicted'),
    ):
        if math.isfinite(factor) and factor > 0.0:
            # Through the middle of the points, so that the slopes can be compared
            begin = np.mean(np.log(distance[used]) - count[used] * math.log(factor))
            slope = np.exp(begin + count * math.log(factor))
            slope = np.where((slope >= low) & (slope <= high), slope, np.nan)
            label = f'{label}: × {number(factor, 4)} per period'
            look = {'color': COLORS[color], 'linewidth': width, 'zorder': 3}
            axes.plot(time, slope, **look, label=label)


def _draw_convergence(stretch: StretchComparison) -> Picture | None:
    """Draw the distance from the periodic motion, period by period."""
    curve = stretch.curves.convergence
    if curve is None:
        return None
    floor = curve.decay.floor
    shown = np.isfinite(curve.distance) & (curve.distance > 0.0)
    if shown.sum() < 2:
        return None
    above = np.flatnonzero(shown & (curve.distance > floor))
    if len(above):
        # Distances at the floor carry no information
        shown[above[-1] + 1 + max(_TAIL, len(above) // 2) :] = False
    axes = _panel('rig time [s]', 'relative distance')
    low, high = float(curve.distance[shown].min()), float(curve.distance[shown].max())
    if floor > 0.0:
        low = min(low, floor)
    _log_axis(axes, 0.2 * low, 4.0 * high)
    time, distance = curve.time[shown], curve.distance[shown]
    marks: dict[str, Any] = {'marker': 'o', 'markersize': 2.4} if shown.sum() < 150 else {}
    look = {'color': COLORS['primary'], 'linewidth': 1.0, **marks}
    axes.plot(time, distance, **look, label=_as_in_the_log(stretch))
    if floor > 0.0:
        look = {'color': COLORS['stop'], 'alpha': 0.3, 'linewidth': 0}
        axes.axhspan(1e-3 * low, floor, **look, label='below the resolution of the log')
    _slopes(axes, curve)
    axes.set_xlim(_finite_range(time, margin=0.02))
    caption = 'Distance of the impacts of each period from those of the periodic motion. The '
    caption += 'slope is the decay per period; the prediction is the largest multiplier.'
    return _picture(axes, 'Convergence', caption, columns=2)


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
    axes = _panel('', '')
    unit_axis(axes.xaxis, 'frequency', 'Hz', highest)
    unit = unit_axis(axes.yaxis, 'amplitude of X', 'm', largest)
    at, lines = (np.empty(0),) * 2 if theory is None else predicted_lines(theory, highest)
    top = max(largest, float(np.nanmax(lines, initial=0.0)))
    _log_axis(axes, _DEPTH * largest, 5.0 * top, unit.factor)
    inside = finite & (curve.frequency <= highest) & (curve.amplitude > 0.0)
    how = _as_in_the_log(stretch)
    look = {'color': COLORS['primary'], 'linewidth': 1.1, 'label': how}
    axes.plot(curve.frequency[inside], curve.amplitude[inside], **look)
    caption = f'The end of the stretch, {curve.window} window, lines {number(curve.resolution, 3)}'
    caption += ' Hz wide.'
    if driven:
        label = 'multiples of the force'
        for n in range(1, math.floor(highest / curve.force_frequency) + 1):
            look = {'color': COLORS['quiet'], 'linewidth': 0.6, 'alpha': 0.6, 'zorder': 1}
            axes.axvline(n * curve.force_frequency, **look, label=label)
            label = ''
    if theory is not None:
        seen = lines > _SEEN * largest
        label = _prediction(stretch)['label']
        axes.plot(at[seen], lines[seen], **{**_RINGS, 'markersize': 8.0, 'label': label})
        caption += ' Rings: the Fourier coefficients of the predicted motion.'
    axes.set_xlim(0.0, highest)
    return _picture(axes, 'Spectrum', caption)


#: How much higher than all else the part of a gap curve may be that is not viable.
_TALLEST = 2.5
_MOST_SPECIAL = 6
_KINDS = ('stable', 'unstable', 'not viable')


def _draw_gap_curve(stretch: StretchComparison) -> Picture | None:
    """Draw Xmax/A over the gap, with this run."""
    curve, measured = stretch.curves.gap_curve, stretch.measured
    if curve is None or measured is None or not curve['branches']:
        return None
    names = ('gap', 'x_max_ratio', 'stable', 'viable')
    branches = [[np.array(branch[name]) for name in names] for branch in curve['branches']]
    gap = stretch.parameters.gap
    special = curve['special']
    others = [0.0, measured.x_max_ratio, *(point['x_max_ratio'] for point in special)]
    wanted, top = (
        _finite_range(others, *(ratio[chosen] for ratio, chosen in pairs), margin=0.08)[1]
        for pairs in ([(b[1], b[3]) for b in branches], [(b[1], ...) for b in branches])
    )
    # Motions that the rig cannot perform must not press the others down
    top = top if top <= _TALLEST * wanted else wanted
    axes = _panel('', 'Xmax / A')
    unit_axis(axes.xaxis, 'gap d', 'm', gap)
    seen: set[int] = set()
    for gaps, ratio, stable, viable in branches:
        kinds = np.where(viable, np.where(stable, 0, 1), 2)
        drawn = np.where(ratio <= top, ratio, np.nan)
        for begin, end in pairwise([0, *(np.flatnonzero(np.diff(kinds)) + 1), len(kinds)]):
            # Each piece reaches to the first point of the next
            piece, kind = slice(begin, end + 1), int(kinds[begin])
            axes.plot(gaps[piece], drawn[piece], **MOTION_LINES[_KINDS[kind]])
            seen.add(kind)
    for kind in sorted(seen):
        axes.plot([], [], **MOTION_LINES[_KINDS[kind]], label=_KINDS[kind])
    if special:
        look = {**_RINGS, 'marker': 'D', 'markersize': 5, 'clip_on': True, 'zorder': 3}
        look['markeredgecolor'] = COLORS['special']
        places = zip(*((point['gap'], point['x_max_ratio']) for point in special), strict=True)
        axes.plot(*places, **look, label='special point')
    if math.isfinite(measured.x_max_ratio):
        axes.axvline(gap, color=COLORS['quiet'], linewidth=0.7, zorder=1)
        look = {'linestyle': 'none', 'marker': '*', 'markersize': 14, 'markeredgewidth': 0}
        look |= {'color': COLORS['primary'], 'zorder': 4}
        axes.plot([gap], [measured.x_max_ratio], **look, label='this run')
    axes.set_ylim(0.0, top)
    caption = _gap_caption(curve, gap)
    if any((ratio > top).any() for _, ratio, _, _ in branches):
        caption += f' Motions that are not viable are not drawn above {number(top, 2)}.'
    return _picture(axes, 'Largest |X| over the gap', caption, columns=3)


def _gap_caption(curve: Mapping[str, Any], gap: float) -> str:
    words = ' and '.join(dict.fromkeys(branch['label'] for branch in curve['branches']))
    caption = f'The predicted motion ({words}) followed in the gap, all else as logged; A '
    caption += 'is the amplitude without impacts. The line is solid where the motion is stable, '
    caption += 'dashed where it is unstable, dotted where it is not viable.'
    if (best := curve['optimum']) is not None:
        where = f'{best["bound"]} {quantity(best["gap"], "m", 3, gap)}'.strip()
        caption += f' Least: {number(best["x_max_ratio"], 3)} at a gap of {where}.'
        if best['bound']:
            caption += ' It was not followed further, where M may move less.'
    points = [
        f'{point["kind"]} at {quantity(point["gap"], "m", 4, gap)}' for point in curve['special']
    ]
    if points:
        left = len(points) - _MOST_SPECIAL
        more = f' and {left} more' if left > 0 else ''
        caption += f' Special points: {", ".join(points[:_MOST_SPECIAL])}{more}.'
    return caption


def _draw_decay(stretch: StretchComparison) -> Picture | None:
    """Draw the amplitude of a rig that is left to itself over time."""
    found = stretch.ring_down
    if found is None:
        return None
    axes = _panel('rig time [s]', '')
    draw_decay(axes, found)
    unit_axis(axes.yaxis, 'amplitude of M', 'm', found.amplitude)
    caption = 'The amplitude V/ω at each upward passage of X through its middle, without force.'
    return _picture(axes, 'Ring-down', caption)


def _draw_loss(stretch: StretchComparison) -> Picture | None:
    """Draw what each cycle of a rig that is left to itself loses."""
    found = stretch.ring_down
    if found is None:
        return None
    axes = _panel('', 'loss of a cycle, Ψ = 1 − E₊/E')
    draw_loss(axes, found)
    unit_axis(axes.xaxis, 'amplitude of M', 'm', found.amplitude)
    caption = 'The share of the energy M V²/2 that is lost from one upward passage to the next; '
    caption += 'the loss factor is Ψ/2π.'
    return _picture(axes, 'Loss of a cycle over amplitude', caption)


def _draw_response(stretch: StretchComparison) -> Picture | None:
    """Draw the largest |X| at each frequency of a sweep."""
    found = stretch.response
    if found is None or len(found.time) < 2:
        return None
    axes = _panel('frequency [Hz]', '')
    draw_response(axes, found, found.x, found.x_without)
    unit_axis(axes.yaxis, 'largest |X|', 'm', float(found.x.max()))
    caption = 'The largest |X| late in the time of each frequency, on the ways up and down, and '
    caption += 'the settled amplitude without damper.'
    return _picture(axes, 'Response over frequency', caption, 2)


#: Charts of a stretch by the name that begins their ids, in the order of the page.
PICTURES: dict[str, Callable[[StretchComparison], Picture | None]] = {
    'history': draw_history,
    'decay': _draw_decay,
    'loss': _draw_loss,
    'response': _draw_response,
    'portrait': _draw_primary_portrait,
    'relative': _draw_damper_portrait,
    'section': _draw_section,
    'spectrum': _draw_spectrum,
    'convergence': _draw_convergence,
    'gap': _draw_gap_curve,
}
