"""Pictures of the motion in its state space: phase portraits and the Poincaré section."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .report_axes import (
    DASHED,
    Picture,
    Points,
    cloud,
    figure_of,
    finite_range,
    legend_above,
    predicted_label,
    rings,
)
from .report_motion import filled_motion
from .report_svg import COLORS
from .report_units import unit_for
from .run_comparison import StretchComparison
from .run_curves import Array

__all__ = ['draw_damper_portrait', 'draw_primary_portrait', 'draw_section']

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
