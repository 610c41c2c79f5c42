"""Pictures of the motion in time: the whole run, and the end of a stretch against theory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from .report_axes import (
    DASHED,
    Picture,
    draw_stop,
    figure_of,
    legend_above,
    predicted_label,
    rings,
)
from .report_motion import filled_motion
from .report_svg import COLORS
from .report_units import unit_for
from .run_comparison import StretchComparison
from .run_curves import Array, MotionCurve, PredictedCurve, SwingEnvelope

__all__ = ['draw_history', 'draw_run', 'predicted_impacts', 'predicted_motion']

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
    """
    Draw X over the whole run, with what theory has for its largest value in each stretch.

    Parameters
    ----------
    stretches : sequence of StretchComparison
        All of them.
    wide : bool, optional
        Whether as wide as the page; for a phone otherwise.

    Returns
    -------
    Picture or None
        None if there is nothing to draw.
    """
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
    """
    Return the predicted motion over a stretch of time.

    Parameters
    ----------
    curve : PredictedCurve
        One period.
    start, end : float
        Rig time, s.

    Returns
    -------
    time, x, y : ndarray
        Instants, s; X and Y there, m.
    """
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
    """
    Return the predicted impacts from `start` to `end`, s.

    Returns
    -------
    time, z : ndarray
        Instants, s; where m then is, m.
    """
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
    """
    Draw the end of a stretch as recorded, with the predicted motion and impacts over it.

    Parameters
    ----------
    stretch : StretchComparison
        The stretch.
    wide : bool, optional
        Whether as wide as the page; the last part for a phone otherwise.

    Returns
    -------
    Picture or None
        None if there is nothing to draw.
    """
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
