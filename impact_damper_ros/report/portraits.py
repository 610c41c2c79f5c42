"""Charts of a stretch: phase portraits, Poincaré section, settling, spectrum and the gap curve."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from impact_damper_ros.compare import (
    Array,
    Convergence,
    GapCurve,
    PredictedCurve,
    StretchComparison,
)

from .charts import (
    DASHED,
    Picture,
    Points,
    cloud,
    figure_of,
    filled_motion,
    finite_range,
    legend_above,
    log_axis,
    predicted_label,
    rings,
)
from .html import COLORS
from .units import number, unit_for

__all__ = [
    'draw_convergence',
    'draw_damper_portrait',
    'draw_gap_curve',
    'draw_primary_portrait',
    'draw_section',
    'draw_spectrum',
    'predicted_lines',
]


#: Least height of the Poincaré section, as a share of the largest velocity in it.
_LEAST = 0.05


def _portrait(
    measured: tuple[Array, Array],
    predicted: tuple[Array, Array] | None,
    color: str,
    names: tuple[str, str],
    label: str,
) -> tuple[Any, Any, float]:
    """Draw a velocity over its position; return figure, axes and the factor of positions."""
    place, rate = unit_for('m', measured[0]), unit_for('m/s', measured[1])
    figure, axes = figure_of(f'{names[0]} [{place.name}]', f'{names[1]} [{rate.name}]')
    x, velocity = place.factor * measured[0], rate.factor * measured[1]
    axes.plot(x, velocity, color=COLORS[color], linewidth=2.0)
    legend = [('line', color, 'as recorded')]
    limits: list[tuple[Array, ...]] = [measured[:1], measured[1:]]
    if predicted is not None and len(predicted[0]):
        x, velocity = place.factor * predicted[0], rate.factor * predicted[1]
        axes.plot(x, velocity, color=COLORS['theory'], linewidth=1.1, linestyle=DASHED, zorder=3)
        legend.append(('dashed', 'theory', label))
        limits = [(measured[0], predicted[0]), (measured[1], predicted[1])]
    axes.set_xlim(*(place.factor * edge for edge in finite_range(*limits[0])))
    axes.set_ylim(*(rate.factor * edge for edge in finite_range(*limits[1])))
    legend_above(axes, legend)
    return figure, axes, place.factor


def draw_primary_portrait(stretch: StretchComparison) -> Picture | None:
    """Draw X' over X at the end of a stretch; None if there is nothing to draw."""
    motion, theory = filled_motion(stretch), stretch.curves.predicted
    if motion is None or not np.any(motion.velocity):
        return None
    predicted = None if theory is None else (theory.x, theory.velocity)
    names, label = ('X', 'X′'), predicted_label(stretch)
    figure, _, _ = _portrait((motion.x, motion.velocity), predicted, 'primary', names, label)
    caption = 'Velocity of the primary mass over its displacement; each impact is a step. '
    caption += 'Between samples far apart stand cubics through positions and velocities.'
    return Picture(figure, 'Phase portrait of M', caption)


def draw_damper_portrait(stretch: StretchComparison) -> Picture | None:
    """Draw Y' over Y at the end of a stretch; None if there is nothing to draw."""
    motion, theory = filled_motion(stretch), stretch.curves.predicted
    if motion is None or not np.any(motion.relative_velocity):
        return None
    predicted = None if theory is None else (theory.y, theory.relative_velocity)
    measured = (motion.y, motion.relative_velocity)
    names, label = ('Y = Z − X', 'Y′'), predicted_label(stretch)
    figure, axes, factor = _portrait(measured, predicted, 'damper', names, label)
    left, right = axes.get_xlim()
    for edge, side in ((motion.stop_1, 1.0), (motion.stop_2, -1.0)):
        place = factor * float(edge[-1])
        if math.isfinite(place):
            outer = place + side * 0.03 * (right - left)
            axes.axvspan(place, outer, color=COLORS['stop'], alpha=0.4, linewidth=0)
            left, right = min(left, outer), max(right, outer)
    axes.set_xlim(left, right)
    caption = 'Motion of the loose mass within M, between the stops (grey).'
    return Picture(figure, 'Phase portrait of m relative to M', caption)


def draw_section(stretch: StretchComparison) -> Picture | None:
    """Draw phase and velocity of m just after each impact; None if there is nothing to draw."""
    impacts, orbit = stretch.curves.impacts, stretch.predicted
    if impacts is None:
        return None
    known = np.isfinite(impacts.phase) & np.isfinite(impacts.damper_velocity_after)
    if not known.any():
        return None
    velocities = [impacts.damper_velocity_after[known]]
    if orbit is not None:
        velocities.append(np.array(orbit.damper_velocity_after))
    rate = unit_for('m/s', *velocities)
    figure, axes = figure_of(
        'phase of the force at the impact [cycles]', f'Z′ just after the impact [{rate.name}]'
    )
    axes.set_xlim(0.0, 1.0)
    # Points at one place, a settled motion on one stop, need no axis of seven digits.
    sizes = np.abs(np.concatenate(velocities))
    least = _LEAST * float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
    limits = finite_range(*velocities, margin=0.1, least=least)
    axes.set_ylim(*(rate.factor * edge for edge in limits))
    settled = np.full(len(known), True)
    if stretch.settled_at is not None:
        settled = impacts.time >= stretch.settled_at
    legend = []
    kinds = []
    for stop, marker, color in ((1, '^', 'damper'), (2, 'v', 'primary')):
        chosen = known & (impacts.stop == stop)
        for part, alpha in ((chosen & ~settled, 0.35), (chosen & settled, 1.0)):
            if part.any():
                velocity = rate.factor * impacts.damper_velocity_after[part]
                kinds.append(Points(impacts.phase[part] % 1.0, velocity, marker, color, alpha))
        if chosen.any():
            legend.append((marker, color, f'on stop {stop}'))
    cloud(axes, kinds)
    caption = f'The state just after each of the {known.sum()} latest impacts'
    caption += ', faint before the motion is steady.' if not settled.all() else '.'
    caption += ' A periodic motion is as many points as it has impacts, a quasi-periodic one lies '
    caption += 'on closed curves.'
    if orbit is not None:
        phases = [phase % 1.0 for phase in orbit.phases]
        rings(axes, phases, [rate.factor * v for v in orbit.damper_velocity_after], 12.0)
        legend.append(('o', 'theory', predicted_label(stretch)))
    legend_above(axes, legend)
    return Picture(figure, 'Poincaré section', caption)


#: Harmonics of the force up to which the spectrum is drawn, with room for the last.
_HARMONICS = 9.4
#: How far below the largest line the spectrum is drawn, as a factor.
_DEPTH = 1e-6
#: Predicted lines below this are but what the integration leaves.
_SEEN = 1e-5
#: Periods of the convergence that are drawn after it has reached its floor, at least.
_TAIL = 20
#: How much higher than all else the part of a gap curve may be that is not viable.
_TALLEST = 2.5


def _slopes(axes: Any, curve: Convergence) -> list[tuple[str, str, str]]:
    """Draw the decay as measured and as predicted, within the axes; return the legend."""
    low, high = axes.get_ylim()
    part = slice(curve.fitted_from, curve.fitted_to)
    time, distance = curve.time[part], curve.distance[part]
    count = np.arange(len(time))
    used = np.isfinite(distance) & (distance > 0.0)
    legend = []
    if used.sum() > 1:
        for factor, name, look, label in (
            (curve.measured, 'damper', 'line', 'measured'),
            (curve.predicted, 'theory', 'dashed', 'predicted'),
        ):
            if math.isfinite(factor) and factor > 0.0:
                # Through the middle of the points: the slope is what is to be seen.
                begin = np.mean(np.log(distance[used]) - count[used] * math.log(factor))
                slope = np.exp(begin + count * math.log(factor))
                axes.plot(
                    time,
                    np.where((slope >= low) & (slope <= high), slope, np.nan),
                    color=COLORS[name],
                    linewidth=1.8,
                    linestyle='-' if look == 'line' else DASHED,
                    zorder=3,
                )
                legend.append((look, name, f'{label}: × {number(factor, 4)} per period'))
    return legend


def draw_convergence(stretch: StretchComparison) -> Picture | None:
    """Draw the distance from the periodic motion; None if there is nothing to draw."""
    curve = stretch.curves.convergence
    if curve is None:
        return None
    shown = np.isfinite(curve.distance) & (curve.distance > 0.0)
    if shown.sum() < 2:
        return None
    above = np.flatnonzero(shown & (curve.distance > curve.floor))
    if len(above):
        # How it goes on at the floor says nothing more.
        shown[above[-1] + 1 + max(_TAIL, len(above) // 2) :] = False
    figure, axes = figure_of('rig time [s]', 'relative distance')
    low, high = float(curve.distance[shown].min()), float(curve.distance[shown].max())
    legend = [('line', 'primary', 'as recorded')]
    if curve.floor > 0.0:
        low = min(low, curve.floor)
        axes.axhspan(1e-3 * low, curve.floor, color=COLORS['stop'], alpha=0.3, linewidth=0)
        legend.append(('patch', 'stop', 'below the resolution of the log'))
    log_axis(axes, 0.2 * low, 4.0 * high)
    axes.plot(
        curve.time[shown],
        curve.distance[shown],
        color=COLORS['primary'],
        marker='o' if shown.sum() < 150 else None,
        markersize=2.4,
        linewidth=1.0,
    )
    legend += _slopes(axes, curve)
    axes.set_xlim(*finite_range(curve.time[shown], margin=0.02))
    legend_above(axes, legend, columns=2)
    caption = 'How far the impacts of each period are from those of the periodic motion. The '
    caption += 'slope is the decay per period; theory has the largest multiplier for it.'
    return Picture(figure, 'Convergence', caption)


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


def draw_spectrum(stretch: StretchComparison) -> Picture | None:
    """Draw the amplitude spectrum of X; None if there is nothing to draw."""
    curve = stretch.curves.spectrum
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
    figure, axes = figure_of(f'frequency [{rate.name}]', f'amplitude of X [{unit.name}]')
    at, lines = np.empty(0), np.empty(0)
    if stretch.curves.predicted is not None:
        at, lines = predicted_lines(stretch.curves.predicted, highest)
    top = max(largest, float(np.nanmax(lines, initial=0.0)))
    log_axis(axes, _DEPTH * unit.factor * largest, 5.0 * unit.factor * top)
    inside = finite & (curve.frequency <= highest) & (curve.amplitude > 0.0)
    x, y = rate.factor * curve.frequency[inside], unit.factor * curve.amplitude[inside]
    axes.plot(x, y, color=COLORS['primary'], linewidth=1.1)
    legend = [('line', 'primary', 'as recorded')]
    caption = f'The end of the stretch, {curve.window} window, lines {number(curve.resolution, 3)}'
    caption += ' Hz wide.'
    if driven:
        for n in range(1, math.floor(highest / curve.force_frequency) + 1):
            line = rate.factor * n * curve.force_frequency
            axes.axvline(line, color=COLORS['quiet'], linewidth=0.7, linestyle=(0, (1, 1.8)))
        legend.append(('dotted', 'quiet', 'multiples of the force'))
    if stretch.curves.predicted is not None:
        seen = lines > _SEEN * largest
        rings(axes, rate.factor * at[seen], unit.factor * lines[seen], 8.0)
        legend.append(('o', 'theory', predicted_label(stretch)))
        caption += ' Rings: the Fourier coefficients of the predicted motion.'
    axes.set_xlim(0.0, rate.factor * highest)
    legend_above(axes, legend)
    return Picture(figure, 'Spectrum', caption)


def _top(curve: GapCurve) -> float:
    """Return where the axis of Xmax/A ends, above all of the curve if that can be."""
    special = curve.special_ratio[np.isfinite(curve.special_ratio)]
    wanted = finite_range(
        curve.ratio[curve.viable], special, [curve.measured_ratio, 0.0], margin=0.08
    )[1]
    everything = finite_range(curve.ratio, special, [curve.measured_ratio, 0.0], margin=0.08)[1]
    # Motions that the rig cannot make must not press the others down.
    return everything if everything <= _TALLEST * wanted else wanted


def _branch(
    axes: Any, curve: GapCurve, factor: float, top: float
) -> tuple[list[tuple[str, str, str]], bool]:
    """Draw the branch by pieces of one kind; return the legend, and whether some is left out."""
    inside = curve.ratio <= top
    kinds = np.where(curve.viable, np.where(curve.stable, 0, 1), 2)
    edges = [0, *(np.flatnonzero(np.diff(kinds)) + 1), len(kinds)]
    looks: list[tuple[str, str, str, Any, float]] = [
        ('line', 'theory', 'stable', '-', 2.0),
        ('dashed', 'theory', 'unstable', DASHED, 1.2),
        ('dotted', 'quiet', 'not viable', (0, (1, 1.8)), 1.0),
    ]
    for begin, end in pairwise(edges):
        _, color, _, style, width = looks[kinds[begin]]
        # Each piece reaches to the first point of the next.
        piece = slice(begin, end + 1)
        x, y = factor * curve.gap[piece], np.where(inside, curve.ratio, np.nan)[piece]
        axes.plot(x, y, color=COLORS[color], linestyle=style, linewidth=width)
    left_out = bool((np.isfinite(curve.ratio) & ~inside).any())
    return [looks[kind][:3] for kind in sorted(set(kinds.tolist()))], left_out


def draw_gap_curve(stretch: StretchComparison) -> Picture | None:
    """Draw Xmax/A over the gap, with this run; None if there is nothing to draw."""
    curve = stretch.curves.gap_curve
    if curve is None or not np.isfinite(curve.ratio).any():
        return None
    unit = unit_for('m', curve.measured_gap)
    figure, axes = figure_of(f'gap d [{unit.name}]', 'Xmax / A')
    top = _top(curve)
    legend, left_out = _branch(axes, curve, unit.factor, top)
    special = np.isfinite(curve.special_ratio)
    if special.any():
        axes.plot(
            unit.factor * curve.special_gap[special],
            curve.special_ratio[special],
            linestyle='none',
            marker='D',
            markersize=5,
            markeredgewidth=1.2,
            markeredgecolor=COLORS['special'],
            markerfacecolor='none',
            zorder=3,
        )
        legend.append(('D', 'special', 'special point'))
    if math.isfinite(curve.measured_ratio):
        at = unit.factor * curve.measured_gap
        axes.axvline(at, color=COLORS['quiet'], linewidth=0.7, zorder=1)
        style = {'linestyle': 'none', 'marker': '*', 'markersize': 14, 'markeredgewidth': 0}
        axes.plot([at], [curve.measured_ratio], color=COLORS['damper'], zorder=4, **style)
        legend.append(('*', 'damper', 'this run'))
    axes.set_ylim(0.0, top)
    legend_above(axes, legend, columns=3)
    caption = _gap_caption(curve, unit.factor, unit.name)
    if left_out:
        caption += f' What is not viable is left out above {number(top, 2)}.'
    return Picture(figure, 'Largest |X| over the gap', caption)


def _gap_caption(curve: GapCurve, factor: float, unit: str) -> str:
    stops = ', '.join(map(str, curve.stops))
    caption = f'The predicted motion (stops {stops}) followed in the gap, all else as logged; A '
    caption += 'is the amplitude without impacts. The line is full where it is stable, dashed '
    caption += 'where it is unstable, dotted where it is not viable.'
    sound = np.flatnonzero(curve.stable & curve.viable & np.isfinite(curve.ratio))
    if len(sound):
        best = sound[np.argmin(curve.ratio[sound])]
        caption += f' Least on this branch: {number(float(curve.ratio[best]), 3)} with a gap of '
        caption += f'{number(factor * float(curve.gap[best]), 3)} {unit}.'
    special = zip(curve.special_kind, curve.special_gap, strict=False)
    told = [f'{kind} at {number(factor * float(gap), 4)} {unit}' for kind, gap in special]
    if told:
        more = f' and {len(told) - 6} more' if len(told) > 6 else ''
        caption += f' Special points: {", ".join(told[:6])}{more}.'
    return caption
