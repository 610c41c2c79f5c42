"""A picture of a run: the whole of it, and the motion between the stops close up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from impact_damper_ros.analysis.motion import Motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ['Closeup', 'draw_motion']

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
