# SPDX-License-Identifier: Apache-2.0
"""The figure of a run and its what-if."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from impact_damper_ros.compare.result import Array
from impact_damper_ros.replay.rows import Events, Samples

from .drawing import (
    COLORS,
    blank_figure,
    draw_impacts,
    draw_stop,
    finish_panel,
    legend_below,
    print_style,
    unit_axis,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: The part of the run that is shown close up.
_BAND: dict[str, Any] = {'color': '#e69f00', 'alpha': 0.4, 'linewidth': 0}
#: Depth of a stop in the figure, as a share of the gap.
_DEPTH = 0.15
#: Width of a letter of a label, as a share of that of the panel.
_LETTER = 0.0075
#: Most changes that are written out; otherwise they are only marked.
_MOST_LABELS = 6


class RunRows(NamedTuple):
    """Samples and impacts of a run, as rows."""

    samples: Samples
    impacts: Events


class Side(NamedTuple):
    """One of two compared runs: the title of its end, X over the run, and its end in detail."""

    title: str
    envelope: Array  # time, least and greatest X
    closeup: RunRows


def _draw_closeup(
    axes: Any, motion: RunRows, start: float, end: float, looks: Sequence[dict[str, Any]]
) -> None:
    """Draw both masses, each in its look, stops and impacts from `start` to before `end`."""
    samples = motion.samples
    samples = samples[(samples['time'] >= start) & (samples['time'] < end)]
    time, stop_1, stop_2 = (samples[name] for name in ('time', 'stop_1', 'stop_2'))
    for name, look in zip('xz', looks, strict=True):
        axes.plot(time, samples[name], **look)
    depth = _DEPTH * float(np.nan_to_num(stop_1 - stop_2).max(initial=0.0))
    draw_stop(axes, time, stop_1, depth, 'stops')
    draw_stop(axes, time, stop_2, -depth)
    draw_impacts(axes, motion.impacts, start, end)
    if end > start:
        axes.set_xlim(start, end)


def _mark_changes(axes: Any, changes: Sequence[tuple[float, str]]) -> None:
    """Mark the instants of changes; write them out if there are not too many."""
    start, end = axes.get_xlim()
    # A label is put into the first row in which it does not run into another one
    rows: list[list[tuple[float, float]]] = []
    for instant, text in changes:
        axes.axvline(instant, color='black', linewidth=0.7, linestyle='--', alpha=0.7)
        if len(changes) > _MOST_LABELS:
            continue
        width = (len(text) + 2) * _LETTER * (end - start)
        late = instant + width > end
        extent = (instant - width, instant) if late else (instant, instant + width)
        free = (all(b <= extent[0] or extent[1] <= a for a, b in row) for row in rows)
        place = next((number for number, is_free in enumerate(free) if is_free), len(rows))
        rows += [[] for _ in range(place + 1 - len(rows))]
        rows[place].append(extent)
        axes.annotate(
            text,
            (instant, 1.0),
            xycoords=('data', 'axes fraction'),
            xytext=(-4 if late else 4, -11 - 11 * place),
            textcoords='offset points',
            ha='right' if late else 'left',
            bbox={'facecolor': 'white', 'alpha': 0.8, 'linewidth': 0, 'pad': 0.5},
        )


def _legend(figure: Figure) -> None:
    """Put one legend of all panels below them."""
    found: dict[str, Any] = {}
    for axes in [*figure.axes[1:], figure.axes[0]]:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    legend_below(figure, list(found.values()), len(found))


#: Colours of X of the recorded run and of the what-if, as in the page.
_RUNS = {'X recorded': COLORS['primary'], 'X what if': COLORS['special']}


def _draw_envelopes(axes: Any, sides: Sequence[Side]) -> None:
    """Draw X of two runs over each other, the larger motion behind."""
    largest = 0.0
    pairs = list(zip(sides, _RUNS.values(), strict=True))
    pairs.sort(key=lambda pair: -float(np.square(pair[0].envelope[2]).sum()))
    for (side, color), alpha in zip(pairs, (0.5, 0.75), strict=True):
        time, low, high = side.envelope
        if not len(time):
            continue
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
def draw_runs(
    sides: tuple[Side, Side],
    changes: Sequence[tuple[float, str]] = (),
    title: str = '',
) -> Figure:
    """Draw two runs over each other, and the end of each in detail."""
    figure = blank_figure(11, 7.2)
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1.5))
    largest = [s.envelope[1:] for s in sides]
    overview = figure.add_subplot(grid[0, :])
    _draw_envelopes(overview, sides)
    end = sides[0].closeup.samples['time']
    if len(end) and end[0] > overview.get_xlim()[0]:
        overview.axvspan(end[0], end[-1], **_BAND, zorder=0, label='close up below')
    _mark_changes(overview, changes)
    finish_panel(overview, '', 'rig time [s]', '')
    unit_axis(overview.yaxis, 'X', 'm', *largest)
    left = figure.add_subplot(grid[1, 0])
    right = figure.add_subplot(grid[1, 1], sharey=left)
    damper = {'color': COLORS['damper'], 'linewidth': 1.2, 'label': 'Z, loose mass'}
    pairs = zip((left, right), sides, sides[::-1], _RUNS.items(), strict=True)
    for axes, side, other, (label, color) in pairs:
        motion, shadow = side.closeup, other.closeup.samples
        time = motion.samples['time']
        others = next(c for c in _RUNS.values() if c != color)
        axes.plot(shadow['time'], shadow['x'], linewidth=0.8, color=others, alpha=0.8)
        start, last = (time[0], time[-1]) if len(time) else (0.0, 0.0)
        primary = {'color': color, 'linewidth': 1.9, 'label': label}
        _draw_closeup(axes, motion, start, np.nextafter(last, np.inf), (primary, damper))
        axes.locator_params(axis='x', nbins=6)
        axes.ticklabel_format(axis='x', useOffset=False)
        finish_panel(axes, '', 'rig time [s]', '')
        axes.set_title(side.title, color=color)
    unit_axis(left.yaxis, 'position along the axis', 'm', *largest)
    right.tick_params(labelleft=False)
    _legend(figure)
    if title:
        figure.suptitle(title, fontsize=11)
    return figure
