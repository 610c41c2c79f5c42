"""Pictures of a run, and of a run beside what it would have been with other parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .replay_report import Envelope

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['Closeup', 'Motion', 'Side', 'draw_motion', 'draw_what_if']


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """
    Sampled motion and impacts of a run.

    Attributes
    ----------
    time, x, z, stop_1, stop_2 : ndarray of shape (n,)
        Time since the start of the run, s; positions of M, m and the stops along the axis, m.
    impact_time, impact_position : ndarray of shape (k,)
        Instants of the impacts, s, and where m then is, m.
    impact_stop : ndarray of shape (k,)
        The stops hit, 1 or 2.
    impact_impulse : ndarray of shape (k,)
        Impulses, N s.
    """

    time: Array
    x: Array
    z: Array
    stop_1: Array
    stop_2: Array
    impact_time: Array
    impact_position: Array
    impact_stop: NDArray[np.int64]
    impact_impulse: Array


PRIMARY = '#0b3c5d'
DAMPER = '#d1495b'
STOP = '#8d99ae'
#: The bands of what is shown close up; not the colour of a mass.
CLOSE = '#e09f00'
_FAINT = 0.45
MILLI = 1e3


class Closeup(NamedTuple):
    """A stretch to be drawn close up, s, without its end, and what to write above it."""

    start: float
    end: float
    title: str


def _overview(axes: Any, motion: Motion, closeups: Sequence[Closeup]) -> None:
    axes.plot(motion.time, MILLI * motion.x, color=PRIMARY, linewidth=0.5)
    for closeup in closeups:
        axes.axvspan(closeup.start, closeup.end, color=CLOSE, alpha=_FAINT, linewidth=0)
    axes.set_xlim(motion.time[0], motion.time[-1])
    axes.set_xlabel('time [s]')
    axes.set_ylabel('X [mm]')
    axes.margins(y=0.25)


def _close(axes: Any, motion: Motion, closeup: Closeup) -> None:
    inside = (motion.time >= closeup.start) & (motion.time < closeup.end)
    time = motion.time[inside]
    stop_1, stop_2 = MILLI * motion.stop_1[inside], MILLI * motion.stop_2[inside]
    reach = 0.18 * float((stop_1 - stop_2).max())
    for edge, outer in ((stop_1, stop_1 + reach), (stop_2, stop_2 - reach)):
        axes.fill_between(time, edge, outer, color=STOP, alpha=0.35, linewidth=0)
        axes.plot(time, edge, color=STOP, linewidth=1.0)
    axes.plot(time, MILLI * motion.x[inside], color=PRIMARY, linewidth=1.8)
    axes.plot(time, MILLI * motion.z[inside], color=DAMPER, linewidth=1.3)
    hits = (motion.impact_time >= closeup.start) & (motion.impact_time < closeup.end)
    for stop, marker in ((1, '^'), (2, 'v')):
        chosen = hits & (motion.impact_stop == stop)
        axes.plot(
            motion.impact_time[chosen],
            MILLI * motion.impact_position[chosen],
            linestyle='none',
            marker=marker,
            markersize=7,
            markeredgecolor='black',
            markerfacecolor='gold',
            zorder=5,
        )
    axes.set_title(closeup.title, fontsize=10)
    axes.set_xlabel('time [s]')
    axes.set_xlim(closeup.start, closeup.end)


def _legend(figure: Figure, *, closeups: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    mark: dict[str, Any] = {
        'linestyle': 'none',
        'markeredgecolor': 'black',
        'markerfacecolor': 'gold',
    }
    handles = [
        Line2D([], [], color=PRIMARY, linewidth=1.8, label='X, primary mass'),
        Line2D([], [], color=DAMPER, linewidth=1.3, label='Z, damper mass'),
        Patch(facecolor=STOP, alpha=0.5, label='stops'),
        Line2D([], [], marker='^', label='impact on stop 1', **mark),
        Line2D([], [], marker='v', label='impact on stop 2', **mark),
    ]
    if closeups:
        band = Patch(facecolor=CLOSE, alpha=_FAINT, label='close up below')
        handles.append(band)
    figure.legend(handles=handles, loc='outside lower center', ncols=len(handles), frameon=False)


def draw_motion(
    motion: Motion,
    closeups: Sequence[Closeup],
    changes: Sequence[tuple[float, str]] = (),
    title: str = '',
) -> Figure:
    """
    Draw a run.

    Parameters
    ----------
    motion : Motion
        The run.
    closeups : sequence of Closeup
        Stretches to show close up, one panel each.
    changes : sequence of (float, str), optional
        Instants, s, at which something was changed, and what.
    title : str, optional
        Title of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        The figure; positions in mm, time in s.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout='constrained')
    grid = figure.add_gridspec(2, len(closeups), height_ratios=(1, 1.5))
    overview = figure.add_subplot(grid[0, :])
    _overview(overview, motion, closeups)
    top = float(np.abs(MILLI * motion.x).max())
    for instant, text in changes:
        overview.axvline(instant, color='black', linewidth=0.8, linestyle='--')
        overview.annotate(
            text, (instant, 1.12 * top), xytext=(4, 0), textcoords='offset points', fontsize=9
        )
    first = None
    for column, closeup in enumerate(closeups):
        axes = figure.add_subplot(grid[1, column], sharey=first)
        _close(axes, motion, closeup)
        if first is None:
            first = axes
            axes.set_ylabel('position along the axis [mm]')
    _legend(figure, closeups=bool(closeups))
    if title:
        figure.suptitle(title, fontsize=12)
    return figure


RECORDED = '#0b3c5d'
WHAT_IF = '#d1495b'
REPLAY_DAMPER = '#6d6875'
IMPACT = 'gold'
#: Changes that are written out; more of them are only marked.
_MOST_LABELS = 6


class Side(NamedTuple):
    """
    One of the two runs.

    Attributes
    ----------
    label : str
        For the legend and the title of its close-up.
    envelope : Envelope
        X over the whole run, m over s.
    closeup : Motion
        Its end.
    """

    label: str
    envelope: Envelope
    closeup: Motion


def _scale(sides: Sequence[Side]) -> tuple[float, str]:
    """Return factor and unit in which the motion is a handy number."""
    largest = max(
        (float(np.abs(part).max()) for side in sides for part in side.envelope.arrays()[1:]),
        default=1.0,
    )
    for factor, unit in ((1.0, 'm'), (1e3, 'mm')):
        if largest * factor >= 0.5:
            return factor, unit
    return 1e6, 'µm'


def _replay_overview(
    axes: Any,
    sides: Sequence[Side],
    changes: Sequence[tuple[float, str]],
    scale: tuple[float, str],
) -> None:
    factor, unit = scale
    largest = 0.0
    ends = [0.0, 1.0]
    pairs = list(zip(sides, (RECORDED, WHAT_IF), strict=True))
    # The larger motion goes behind.
    pairs.sort(key=lambda pair: -float(np.square(pair[0].envelope.arrays()[2]).sum()))
    for (side, color), alpha in zip(pairs, (0.5, 0.75), strict=True):
        time, low, high = side.envelope.arrays()
        if not len(time):
            continue
        ends = [time[0], max(time[-1], time[0] + 1e-9)]
        largest = max(largest, float(np.abs(factor * np.concatenate([low, high])).max()))
        if np.array_equal(low, high):
            axes.plot(time, factor * low, color=color, alpha=0.85, linewidth=0.7)
        else:
            axes.fill_between(
                time, factor * low, factor * high, color=color, alpha=alpha, linewidth=0
            )
            for edge in (low, high):
                axes.plot(time, factor * edge, color=color, linewidth=0.9)
    closeup = sides[0].closeup.time
    if len(closeup) and closeup[0] > ends[0]:
        axes.axvspan(closeup[0], closeup[-1], color=IMPACT, alpha=0.6, linewidth=0, zorder=0)
    for number, (instant, text) in enumerate(changes):
        axes.axvline(instant, color='black', linewidth=0.7, linestyle='--', alpha=0.6)
        if len(changes) <= _MOST_LABELS:
            late = instant > ends[0] + 0.8 * (ends[1] - ends[0])
            axes.annotate(
                text,
                (instant, 1.0),
                xycoords=('data', 'axes fraction'),
                xytext=(-3 if late else 3, -10 - 10 * (number % 2)),
                textcoords='offset points',
                ha='right' if late else 'left',
                fontsize=8,
            )
    axes.set_xlim(*ends)
    axes.set_ylim(-1.15 * largest or -1.0, (1.45 if changes else 1.15) * largest or 1.0)
    axes.set_xlabel('rig time [s]')
    axes.set_ylabel(f'X [{unit}]')


def _closeup(axes: Any, side: Side, other: Side, color: str, scale: tuple[float, str]) -> None:
    factor, _ = scale
    motion = side.closeup
    stop_1, stop_2 = factor * motion.stop_1, factor * motion.stop_2
    reach = 0.12 * float((stop_1 - stop_2).max(initial=0.0))
    for edge, outer in ((stop_1, stop_1 + reach), (stop_2, stop_2 - reach)):
        axes.fill_between(motion.time, edge, outer, color=STOP, alpha=0.35, linewidth=0)
        axes.plot(motion.time, edge, color=STOP, linewidth=1.0)
    axes.plot(
        other.closeup.time,
        factor * other.closeup.x,
        color=WHAT_IF if color == RECORDED else RECORDED,
        linewidth=1.0,
        linestyle=(0, (4, 2)),
        alpha=0.8,
    )
    axes.plot(motion.time, factor * motion.x, color=color, linewidth=1.9)
    axes.plot(motion.time, factor * motion.z, color=REPLAY_DAMPER, linewidth=1.2)
    for stop, marker in ((1, '^'), (2, 'v')):
        chosen = motion.impact_stop == stop
        axes.plot(
            motion.impact_time[chosen],
            factor * motion.impact_position[chosen],
            linestyle='none',
            marker=marker,
            markersize=6,
            markeredgecolor='black',
            markeredgewidth=0.7,
            markerfacecolor=IMPACT,
            zorder=5,
        )
    axes.set_title(side.label, fontsize=10, color=color)
    axes.set_xlabel('rig time [s]')
    axes.locator_params(axis='x', nbins=6)
    axes.ticklabel_format(axis='x', useOffset=False)
    if len(motion.time) > 1:
        axes.set_xlim(motion.time[0], motion.time[-1])


def _replay_legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    mark: dict[str, Any] = {
        'linestyle': 'none',
        'markerfacecolor': IMPACT,
        'markeredgecolor': 'black',
    }
    handles = [
        Line2D([], [], color=RECORDED, linewidth=1.9, label='X recorded'),
        Line2D([], [], color=WHAT_IF, linewidth=1.9, label='X what if'),
        Line2D([], [], color=REPLAY_DAMPER, linewidth=1.2, label='loose mass Z'),
        Patch(facecolor=STOP, alpha=0.5, label='stops'),
        Line2D([], [], marker='^', label='impact on stop 1', **mark),
        Line2D([], [], marker='v', label='impact on stop 2', **mark),
    ]
    figure.legend(handles=handles, loc='outside lower center', ncols=6, frameon=False, fontsize=9)


def draw_what_if(
    recorded: Side,
    what_if: Side,
    changes: Sequence[tuple[float, str]] = (),
    title: str = '',
) -> Figure:
    """
    Draw both runs: the whole time history over each other, and the end of each close up.

    Parameters
    ----------
    recorded, what_if : Side
        The runs.
    changes : sequence of (float, str), optional
        Instants, s, at which something was changed, and what.
    title : str, optional
        Title of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    from matplotlib.figure import Figure

    sides = (recorded, what_if)
    scale = _scale(sides)
    figure = Figure(figsize=(11, 7.2), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1.5))
    _replay_overview(figure.add_subplot(grid[0, :]), sides, changes, scale)
    left = figure.add_subplot(grid[1, 0])
    right = figure.add_subplot(grid[1, 1], sharey=left)
    _closeup(left, recorded, what_if, RECORDED, scale)
    _closeup(right, what_if, recorded, WHAT_IF, scale)
    left.set_ylabel(f'position along the axis [{scale[1]}]')
    right.tick_params(labelleft=False)
    _replay_legend(figure)
    if title:
        figure.suptitle(title, fontsize=12)
    return figure
