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
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.compare.result import Array, Convergence, StretchComparison

from .drawing import COLORS, IMPACTS, MOTION_LINES, unit_axis
from .formatting import number, quantity
from .motion_charts import (
    RINGS,
    draw_damper_portrait,
    draw_history,
    draw_primary_portrait,
    predicted_lines,
    prediction_look,
    source_of_curves,
)
from .picture import Picture, finite_range, panel, picture_of, set_log_axis
from .ring_down_figure import draw_decay, draw_loss
from .swept_response_figure import draw_response

#: Least height of the Poincaré section, as a share of the largest velocity in it.
_LEAST = 0.05
#: More marks than this are drawn as pixels, whose image has the same size for any number.
_MOST_MARKS = 300
#: Points closer than this share of the width of the axes are one.
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
    # All kinds have marks of one size, so that no kind seems to have more points.
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
    axes = panel('phase of the force at the impact [cycles]', '')
    unit_axis(axes.yaxis, 'Z′ just after the impact', 'm/s', *velocities)
    axes.set_xlim(0.0, 1.0)
    # Points at one place, as of a settled motion on one stop, need no axis with seven digits.
    sizes = np.abs(np.concatenate(velocities))
    least = _LEAST * float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    axes.set_ylim(finite_range(*velocities, margin=0.1, least=least))
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
        label = prediction_look(stretch)['label']
        look = {**RINGS, 'markersize': 12.0, 'label': label}
        axes.plot(places, orbit.damper_velocity_after, **look)
    return picture_of(axes, 'Poincaré section', caption)


#: Least number of periods that are drawn after the distance has reached its floor.
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
            # The lines pass through the middle of the points, so that the slopes can be compared.
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
    axes = panel('rig time [s]', 'relative distance')
    low, high = float(curve.distance[shown].min()), float(curve.distance[shown].max())
    if floor > 0.0:
        low = min(low, floor)
    set_log_axis(axes, 0.2 * low, 4.0 * high)
    time, distance = curve.time[shown], curve.distance[shown]
    marks: dict[str, Any] = {'marker': 'o', 'markersize': 2.4} if shown.sum() < 150 else {}
    look = {'color': COLORS['primary'], 'linewidth': 1.0, **marks}
    axes.plot(time, distance, **look, label=source_of_curves(stretch))
    if floor > 0.0:
        look = {'color': COLORS['stop'], 'alpha': 0.3, 'linewidth': 0}
        axes.axhspan(1e-3 * low, floor, **look, label='below the resolution of the log')
    _slopes(axes, curve)
    axes.set_xlim(finite_range(time, margin=0.02))
    caption = 'Distance of the impacts of each period from those of the periodic motion. The '
    caption += 'slope is the decay per period; the prediction is the largest multiplier.'
    return picture_of(axes, 'Convergence', caption, columns=2)


#: Harmonics of the force up to which the spectrum is drawn, with room for the last.
_HARMONICS = 9.4
#: Lowest level of the spectrum that is drawn, as a share of the largest line.
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
    axes = panel('', '')
    unit_axis(axes.xaxis, 'frequency', 'Hz', highest)
    unit = unit_axis(axes.yaxis, 'amplitude of X', 'm', largest)
    at, lines = (np.empty(0),) * 2 if theory is None else predicted_lines(theory, highest)
    top = max(largest, float(np.nanmax(lines, initial=0.0)))
    set_log_axis(axes, _DEPTH * largest, 5.0 * top, unit.factor)
    inside = finite & (curve.frequency <= highest) & (curve.amplitude > 0.0)
    how = source_of_curves(stretch)
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
        label = prediction_look(stretch)['label']
        axes.plot(at[seen], lines[seen], **{**RINGS, 'markersize': 8.0, 'label': label})
        caption += ' Rings: the Fourier coefficients of the predicted motion.'
    axes.set_xlim(0.0, highest)
    return picture_of(axes, 'Spectrum', caption)


#: Factor by which the part of a gap curve that is not viable may exceed the rest.
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
        finite_range(others, *(ratio[chosen] for ratio, chosen in pairs), margin=0.08)[1]
        for pairs in ([(b[1], b[3]) for b in branches], [(b[1], ...) for b in branches])
    )
    # Motions that the rig cannot perform must not determine the scale.
    top = top if top <= _TALLEST * wanted else wanted
    axes = panel('', 'Xmax / A')
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
        look = {**RINGS, 'marker': 'D', 'markersize': 5, 'clip_on': True, 'zorder': 3}
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
    return picture_of(axes, 'Largest |X| over the gap', caption, columns=3)


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
    """Draw the amplitude of a ring-down over time."""
    found = stretch.ring_down
    if found is None:
        return None
    axes = panel('rig time [s]', '')
    draw_decay(axes, found)
    unit_axis(axes.yaxis, 'amplitude of M', 'm', found.amplitude)
    caption = 'The amplitude V/ω at each upward passage of X through its middle, without force.'
    return picture_of(axes, 'Ring-down', caption)


def _draw_loss(stretch: StretchComparison) -> Picture | None:
    """Draw the loss of each cycle of a ring-down."""
    found = stretch.ring_down
    if found is None:
        return None
    axes = panel('', 'loss of a cycle, Ψ = 1 − E₊/E')
    draw_loss(axes, found)
    unit_axis(axes.xaxis, 'amplitude of M', 'm', found.amplitude)
    caption = 'The share of the energy M V²/2 that is lost from one upward passage to the next; '
    caption += 'the loss factor is Ψ/2π.'
    return picture_of(axes, 'Loss of a cycle over amplitude', caption)


def _draw_response(stretch: StretchComparison) -> Picture | None:
    """Draw the largest |X| at each frequency of a sweep."""
    found = stretch.response
    if found is None or len(found.time) < 2:
        return None
    axes = panel('frequency [Hz]', '')
    draw_response(axes, found, found.x, found.x_without)
    unit_axis(axes.yaxis, 'largest |X|', 'm', float(found.x.max()))
    caption = 'The largest |X| late in the time of each frequency, on the ways up and down, and '
    caption += 'the settled amplitude without damper.'
    return picture_of(axes, 'Response over frequency', caption, 2)


#: Charts of a stretch by the first word of their ids, in the order of the page.
PICTURES: dict[str, Callable[[StretchComparison], Picture | None]] = {
    'history': draw_history,
    'decay': _draw_decay,
    'loss': _draw_loss,
    'response': _draw_response,
    'portrait': draw_primary_portrait,
    'relative': draw_damper_portrait,
    'section': _draw_section,
    'spectrum': _draw_spectrum,
    'convergence': _draw_convergence,
    'gap': _draw_gap_curve,
}
