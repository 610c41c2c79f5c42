"""Figures of a run: its stages close up, and a recorded run beside its what-if."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.compare.result import SwingEnvelope

from .drawing import (
    COLORS,
    DASHED,
    blank_figure,
    draw_stop,
    finish_panel,
    legend_below,
    legend_handles,
    print_style,
)
from .formatting import Unit, unit_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

#: Impacts, and the part of the run that is shown close up; no mass has one of these colours.
_IMPACT, _BAND = '#ffd700', '#e69f00'
_BAND_ALPHA = 0.5
#: Depth of a stop in the figure, as a share of the gap.
_DEPTH = 0.15
#: Changes that are written out; more of them are only marked.
_MOST_LABELS = 6


@dataclass(frozen=True)
class SampledMotion:
    """Sampled motion and impacts of a run."""

    #: Time since the start of the run, s; positions of M, m and the stops along the axis, m.
    #: Shape (n,).
    time: Array
    x: Array
    z: Array
    stop_1: Array
    stop_2: Array
    #: Instants of the impacts, s, and where m then is, m, shape (k,).
    impact_time: Array
    impact_position: Array
    impact_stop: NDArray[np.int64]  # the stops hit, 1 or 2, shape (k,)


class Closeup(NamedTuple):
    """A part of a run to be shown close up, s, without its end, and its title."""

    start: float
    end: float
    title: str


class Side(NamedTuple):
    """One of two runs that are compared: the title of its end, X over it, and its end close up."""

    title: str
    envelope: SwingEnvelope
    closeup: SampledMotion


def _draw_closeup(
    axes: Any,
    motion: SampledMotion,
    start: float,
    end: float,
    unit: Unit,
    primary: str,
    damper: str,
) -> None:
    """Draw both masses, stops and impacts from `start` to before `end`."""
    inside = (motion.time >= start) & (motion.time < end)
    time = motion.time[inside]
    stop_1, stop_2 = (unit.factor * stop[inside] for stop in (motion.stop_1, motion.stop_2))
    depth = _DEPTH * float((stop_1 - stop_2).max(initial=0.0))
    draw_stop(axes, time, stop_1, depth)
    draw_stop(axes, time, stop_2, -depth)
    axes.plot(time, unit.factor * motion.x[inside], color=primary, linewidth=1.9)
    axes.plot(time, unit.factor * motion.z[inside], color=damper, linewidth=1.2)
    hits = (motion.impact_time >= start) & (motion.impact_time < end)
    for stop, marker in ((1, '^'), (2, 'v')):
        chosen = hits & (motion.impact_stop == stop)
        axes.plot(
            motion.impact_time[chosen],
            unit.factor * motion.impact_position[chosen],
            linestyle='none',
            marker=marker,
            markersize=6.5,
            markeredgecolor='black',
            markerfacecolor=_IMPACT,
            zorder=5,
        )
    if end > start:
        axes.set_xlim(start, end)


def _mark_changes(axes: Any, changes: Sequence[tuple[float, str]], most: int) -> None:
    """Mark the instants of changes; write them out if there are not too many."""
    start, end = axes.get_xlim()
    for number, (instant, text) in enumerate(changes):
        axes.axvline(instant, color='black', linewidth=0.7, linestyle='--', alpha=0.7)
        if len(changes) <= most:
            late = instant > start + 0.8 * (end - start)
            axes.annotate(
                text,
                (instant, 1.0),
                xycoords=('data', 'axes fraction'),
                xytext=(-4 if late else 4, -11 - 11 * (number % 2)),
                textcoords='offset points',
                ha='right' if late else 'left',
            )


def _band(axes: Any, start: float, end: float) -> None:
    axes.axvspan(start, end, color=_BAND, alpha=_BAND_ALPHA, linewidth=0, zorder=0)


def _legend(figure: Figure, lines: Sequence[tuple[str, str, str]], *, band: bool) -> None:
    entries = [*lines, ('patch', 'stop', 'stops')]
    entries += [(m, _IMPACT, f'impact on stop {stop}') for stop, m in ((1, '^'), (2, 'v'))]
    handles = legend_handles(
        [*entries, ('patch', _BAND, 'close up below')][: None if band else -1]
    )
    for mark in handles[len(lines) + 1 : len(lines) + 3]:
        mark.set_markeredgecolor('black')
    legend_below(figure, handles, len(handles))


@print_style()
def draw_motion(
    motion: SampledMotion,
    closeups: Sequence[Closeup],
    changes: Sequence[tuple[float, str]] = (),
    title: str = '',
) -> Figure:
    """
    Draw a run: X over all of it, and parts of it close up, one panel each.

    `changes` are instants, s, at which something was changed, and what.
    """
    figure = blank_figure(11, 7)
    grid = figure.add_gridspec(2, max(1, len(closeups)), height_ratios=(1, 1.5))
    unit = unit_for('m', motion.x)
    overview = figure.add_subplot(grid[0, :])
    overview.plot(motion.time, unit.factor * motion.x, color=COLORS['primary'], linewidth=0.5)
    for closeup in closeups:
        _band(overview, closeup.start, closeup.end)
    overview.set_xlim(motion.time[0], motion.time[-1])
    overview.margins(y=0.3)
    _mark_changes(overview, changes, len(changes))
    finish_panel(overview, '', 'time [s]', f'X [{unit.name}]')
    first = None
    for column, closeup in enumerate(closeups):
        axes = figure.add_subplot(grid[1, column], sharey=first)
        colors = COLORS['primary'], COLORS['damper']
        _draw_closeup(axes, motion, closeup.start, closeup.end, unit, *colors)
        label = '' if first else f'position along the axis [{unit.name}]'
        finish_panel(axes, '', 'time [s]', label)
        axes.set_title(closeup.title)
        first = first or axes
    lines = [('line', 'primary', 'X, primary mass'), ('line', 'damper', 'Z, loose mass')]
    _legend(figure, lines, band=bool(closeups))
    if title:
        figure.suptitle(title, fontsize=11)
    return figure


def _draw_envelopes(axes: Any, sides: Sequence[Side], unit: Unit) -> None:
    """Draw X of two runs over each other, the larger motion behind."""
    largest = 0.0
    pairs = list(zip(sides, (COLORS['primary'], COLORS['damper']), strict=True))
    pairs.sort(key=lambda pair: -float(np.square(pair[0].envelope.high).sum()))
    for (side, color), alpha in zip(pairs, (0.5, 0.75), strict=True):
        time, low, high = side.envelope.time, side.envelope.low, side.envelope.high
        if not len(time):
            continue
        low, high = unit.factor * low, unit.factor * high
        axes.set_xlim(time[0], max(time[-1], time[0] + 1e-9))
        largest = max(largest, float(np.abs(np.concatenate([low, high])).max()))
        if np.array_equal(low, high):
            axes.plot(time, low, color=color, alpha=0.85, linewidth=0.7)
        else:
            axes.fill_between(time, low, high, color=color, alpha=alpha, linewidth=0)
            for edge in (low, high):
                axes.plot(time, edge, color=color, linewidth=0.9)
    axes.set_ylim(-1.15 * largest or -1.0, 1.45 * largest or 1.0)


@print_style()
def draw_what_if(
    recorded: Side,
    what_if: Side,
    changes: Sequence[tuple[float, str]] = (),
    title: str = '',
) -> Figure:
    """Draw two runs: all of both over each other, and the end of each close up."""
    figure = blank_figure(11, 7.2)
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1.5))
    sides = (recorded, what_if)
    unit = unit_for('m', *(s.envelope.low for s in sides), *(s.envelope.high for s in sides))
    overview = figure.add_subplot(grid[0, :])
    _draw_envelopes(overview, sides, unit)
    end = recorded.closeup.time
    if len(end) and end[0] > overview.get_xlim()[0]:
        _band(overview, end[0], end[-1])
    _mark_changes(overview, changes, _MOST_LABELS)
    finish_panel(overview, '', 'rig time [s]', f'X [{unit.name}]')
    left = figure.add_subplot(grid[1, 0])
    right = figure.add_subplot(grid[1, 1], sharey=left)
    colors = COLORS['primary'], COLORS['damper']
    for axes, side, other, color, others in (
        (left, recorded, what_if, *colors),
        (right, what_if, recorded, *colors[::-1]),
    ):
        motion, shadow = side.closeup, other.closeup
        style: dict[str, Any] = {'color': others, 'linestyle': DASHED, 'alpha': 0.8}
        axes.plot(shadow.time, unit.factor * shadow.x, linewidth=1.0, **style)
        start, last = (motion.time[0], motion.time[-1]) if len(motion.time) else (0.0, 0.0)
        _draw_closeup(
            axes, motion, start, np.nextafter(last, np.inf), unit, color, COLORS['quiet']
        )
        axes.locator_params(axis='x', nbins=6)
        axes.ticklabel_format(axis='x', useOffset=False)
        finish_panel(axes, '', 'rig time [s]', '')
        axes.set_title(side.title, color=color)
    left.set_ylabel(f'position along the axis [{unit.name}]')
    right.tick_params(labelleft=False)
    lines = [
        ('line', 'primary', 'X recorded'),
        ('line', 'damper', 'X what if'),
        ('line', 'quiet', 'Z, loose mass'),
    ]
    _legend(figure, lines, band=bool(len(end)))
    if title:
        figure.suptitle(title, fontsize=11)
    return figure
