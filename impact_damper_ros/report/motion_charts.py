# SPDX-License-Identifier: Apache-2.0
"""Pictures of a motion over time, and of its phase portraits, with the predicted motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from impact_damper_ros.compare.result import (
    Array,
    LogVerdict,
    MotionCurve,
    PredictedCurve,
    StretchComparison,
)
from impact_damper_ros.orbits.settled_motion import cycle_of

from .drawing import COLORS, MOTION_LINES, draw_impacts, draw_stop, unit_axis
from .picture import Picture, finite_range, panel, picture_of

RINGS: dict[str, Any] = {
    'linestyle': 'none',
    'marker': 'o',
    'markersize': 9.0,
    'markeredgecolor': COLORS['theory'],
    'markerfacecolor': 'none',
    'markeredgewidth': 1.3,
    'clip_on': False,
    'zorder': 4,
}


def prediction_look(stretch: StretchComparison) -> dict[str, Any]:
    """Return line and label of the predicted motion, by its stability."""
    orbit = stretch.predicted
    words = 'stable' if orbit is None else orbit.stability
    label = 'predicted' if words == 'stable' else f'predicted, but {words}'
    # Each line is in the ink of theory, over the recorded motion, which is wider.
    look = {'color': COLORS['theory'], 'linewidth': 1.0, 'zorder': 3.5}
    return {**MOTION_LINES[words], **look, 'label': label}


#: Stretches that are numbered in the picture of the whole run; more would run into each other.
_MOST_NUMBERS = 30
#: Pieces of the picture of the whole run, all stretches together, and of one of them at least.
_MOST_PIECES, _LEAST_PIECES = 1200.0, 8.0
#: Most cycles of the force that can be distinguished in that picture.
_MOST_CYCLES = 160
#: Share of the width of that picture that a number of a stretch takes.
_NUMBER = 0.02


def cycles_in(stretch: StretchComparison) -> float:
    """Return the number of cycles of the force in a stretch."""
    return (stretch.end - stretch.start) / cycle_of(stretch.parameters)


def source_of_curves(*stretches: StretchComparison) -> str:
    """Return the source of curves in words: the replay, or the record if it is equal."""
    differs = any(stretch.log is LogVerdict.DIFFERS for stretch in stretches)
    return 'as replayed' if differs else 'as recorded'


def _coarser(stretch: StretchComparison, envelope: Array, most: float) -> Array:
    """Return time, least and greatest X of at most so many pieces, up to the end."""
    # The pieces are equal: a short one at the end would not hold a whole oscillation.
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
        # A motion that is not stable cannot last.
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
    axes = panel('rig time [s]', '', wide=True, height=2.8)
    # Single cycles of so many could not be distinguished.
    crowded = sum(map(cycles_in, stretches)) > _MOST_CYCLES
    pieces = []
    for stretch, envelope in shown:
        count = max(_LEAST_PIECES, _MOST_PIECES / len(shown))
        if crowded:
            count = min(count, max(_LEAST_PIECES, cycles_in(stretch)))
        pieces.append(_coarser(stretch, envelope, count))
    time, low, high = np.hstack(pieces)
    color, how = COLORS['primary'], source_of_curves(*stretches)
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
    return picture_of(axes, 'The whole run', caption)


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
    axes = panel('rig time [s]', '', wide=True)
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
    caption = f'The end of the stretch {source_of_curves(stretch)}.'
    if theory is not None:
        time, x, y = predicted_motion(theory, start, end)
        look = prediction_look(stretch)
        axes.plot(time, x, **look)
        axes.plot(time, x + y, **{**look, 'label': ''})
        hit, place = predicted_impacts(stretch, start, end)
        for at in hit:
            axes.axvline(at, color=COLORS['quiet'], linewidth=0.5, alpha=0.6, zorder=1)
        axes.plot(hit, place, **RINGS, label='its impacts')
        caption += ' Over it is the predicted motion, with its impacts as rings.'
    axes.set_xlim(start, end)
    return picture_of(axes, 'Time history', caption)


def _portrait(
    stretch: StretchComparison, names: tuple[str, str], color: str, labels: tuple[str, str]
) -> Any:
    """Draw a velocity over its position, by their names in both curves; return the axes."""
    motion, theory = stretch.curves.motion, stretch.curves.predicted
    places, rates = [[getattr(motion, name)] for name in names]
    axes = panel('', '')
    unit_axis(axes.xaxis, labels[0], 'm', places[0])
    unit_axis(axes.yaxis, labels[1], 'm/s', rates[0])
    # The curve of a motion that repeats lies below that of the theory.
    width = 1.4 if stretch.settled_at is None else 2.6
    how = source_of_curves(stretch)
    axes.plot(places[0], rates[0], color=COLORS[color], linewidth=width, label=how)
    if theory is not None and len(theory.x):
        places.append(getattr(theory, names[0]))
        rates.append(getattr(theory, names[1]))
        axes.plot(places[1], rates[1], **prediction_look(stretch))
    axes.set(xlim=finite_range(*places), ylim=finite_range(*rates))
    return axes


def draw_primary_portrait(stretch: StretchComparison) -> Picture | None:
    """Draw X' over X."""
    motion = _motion_of(stretch)
    if motion is None or not np.any(motion.velocity):
        return None
    axes = _portrait(stretch, ('x', 'velocity'), 'primary', ('X', 'X′'))
    caption = 'Velocity of the primary mass over its displacement; each impact is a step.'
    return picture_of(axes, 'Phase portrait of M', caption)


def draw_damper_portrait(stretch: StretchComparison) -> Picture | None:
    """Draw Y' over Y."""
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
    return picture_of(axes, 'Phase portrait of m relative to M', caption)
