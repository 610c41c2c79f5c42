# SPDX-License-Identifier: Apache-2.0
"""The style of all figures: colours, the style of print and that of the page, files."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from impact_damper_ros.outputs import whole

from .formatting import Unit, number, unit_for

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure


# Colours of Okabe and Ito, distinguished with any kind of colour vision
BLUE, ORANGE, GREEN, PURPLE = '#0072b2', '#d55e00', '#009e73', '#aa4499'

#: Colours by their use, in all figures and in both pages, which have a variable of each name, with
#: another value in a dark scheme. Theory is in ink, over the measurement.
COLORS = {
    'ink': '#1b1f24',
    'quiet': '#5c6570',
    'grid': '#dfe3e8',
    'stop': '#98a2ae',
    'primary': BLUE,
    'damper': ORANGE,
    'lower': '#00848c',
    'upper': '#7a4fb5',
    'theory': '#0b0d10',
    'special': '#a0358f',
}

#: Mark and colour of the impacts on each stop.
IMPACTS: dict[int, dict[str, Any]] = {
    1: {'marker': '^', 'color': COLORS['lower']},
    2: {'marker': 'v', 'color': COLORS['upper']},
}

#: Lines of periodic motions by their stability, and of those that the rig cannot perform.
MOTION_LINES: dict[str, dict[str, Any]] = {
    'stable': {'color': COLORS['theory'], 'linestyle': '-', 'linewidth': 1.8},
    'neutral': {'color': COLORS['theory'], 'linestyle': '-.', 'linewidth': 1.8},
    'unstable': {'color': COLORS['quiet'], 'linestyle': '--', 'linewidth': 1.2},
    'not viable': {'color': COLORS['quiet'], 'linestyle': ':', 'linewidth': 1.2},
}

#: Patterns of such lines.
_PATTERNS = {'lines.dashed_pattern': (4.2, 2.4), 'lines.dotted_pattern': (1, 1.8)}

_PRINT = {
    **_PATTERNS,
    'font.size': 9,
    'axes.labelsize': 9,
    'axes.titlesize': 9,
    'legend.fontsize': 8.5,
    'mathtext.fontset': 'dejavusans',
    'svg.hashsalt': 'impact_damper_ros',
}
_PAGE = {
    **_PATTERNS,
    'axes.axisbelow': True,
    'axes.edgecolor': COLORS['quiet'],
    'axes.facecolor': 'none',
    'axes.formatter.useoffset': False,
    'axes.grid': True,
    'axes.labelcolor': COLORS['ink'],
    'axes.labelsize': 9.5,
    'axes.linewidth': 0.8,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlesize': 9.5,
    'figure.dpi': 72,
    'figure.facecolor': 'none',
    'font.family': 'sans-serif',
    'font.size': 9.5,
    'grid.color': COLORS['grid'],
    'grid.linewidth': 0.7,
    'legend.fontsize': 8.5,
    'legend.frameon': False,
    'legend.labelcolor': COLORS['ink'],
    'path.simplify_threshold': 0.25,
    'savefig.facecolor': 'none',
    'svg.fonttype': 'none',
    'svg.hashsalt': 'impact_damper_ros',
    'text.color': COLORS['ink'],
    'text.parse_math': False,
    'xtick.color': COLORS['quiet'],
    'xtick.labelcolor': COLORS['ink'],
    'xtick.labelsize': 8.5,
    'ytick.color': COLORS['quiet'],
    'ytick.labelcolor': COLORS['ink'],
    'ytick.labelsize': 8.5,
}


@contextmanager
def page_style() -> Iterator[None]:
    """Draw in the style of the page, whatever matplotlibrc sets; then restore the style."""
    import matplotlib as mpl

    settings = {**mpl.rcParamsDefault, 'backend': mpl.rcParams['backend'], **_PAGE}
    with mpl.rc_context(settings):
        yield


@contextmanager
def print_style() -> Iterator[None]:
    """Draw, or write, in the style of print, and restore the style afterwards."""
    import matplotlib as mpl

    with mpl.rc_context(_PRINT):
        yield


def blank_figure(width: float, height: float, title: str = '') -> Figure:
    """Return an empty figure for print, its size in inches, with the rig in small print above."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout='constrained', dpi=180)
    if title:
        figure.suptitle(textwrap.fill(title, 100), fontsize=7.5, color='0.3')
    return figure


def finish_panel(axes: Any, panel: str, x_label: str, y_label: str) -> None:
    """Label a panel for print: its letter, axes, a light grid."""
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    # Marks are drawn whole at the frame, but not beyond it
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for line in axes.lines:
        if line.get_linestyle() == 'None':
            pairs = zip(*line.get_data(), strict=True)
            inside = [(x, y) for x, y in pairs if left <= x <= right and bottom <= y <= top]
            line.set_data(*zip(*inside, strict=True) if inside else ([], []))
    axes.grid(color='0.9', linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(direction='in', top=True, right=True)
    if panel:
        axes.set_title(f'({panel})', loc='left', fontweight='bold')


def legend_below(figure: Figure, handles: Sequence[Any], columns: int, **look: Any) -> None:
    """Put a legend below the panels of a figure, in as many columns as fit into it."""
    if not handles:
        return
    for count in range(columns, 0, -1):
        legend = figure.legend(
            handles=handles, loc='lower center', ncols=count, frameon=False, **look
        )
        extent = legend.get_window_extent()
        if extent.width <= figure.bbox.width:
            break
        if count > 1:
            legend.remove()
    # matplotlib 3.6, that of Ubuntu 24.04, has no place outside of the panels.
    share = (extent.height + 0.12 * figure.dpi) / figure.bbox.height
    figure.get_layout_engine().set(rect=(0.0, share, 1.0, 1.0 - share))


#: Parts of an SVG that belong to a file of its own; ids and the references to them.
_DOCUMENT = re.compile(r'<metadata>.*?</metadata>|<style [^>]*>.*?</style>', re.DOTALL)
_ID = re.compile(r'(\bid="|href="#|url\(#)')


def inline_svg(figure: Figure, key: str, label: str) -> str:
    """Return a figure as an element of an HTML page, in its colours, with unique ids."""
    content = io.StringIO()
    nothing = dict.fromkeys(('Date', 'Creator', 'Format', 'Type'))
    figure.savefig(content, format='svg', metadata=nothing, dpi=144)
    text = _DOCUMENT.sub('', content.getvalue()[content.getvalue().index('<svg') :])
    text = _ID.sub(rf'\g<1>{key}-', text)
    for name, color in COLORS.items():
        text = text.replace(color, f'var(--{name})')
    described = f'<svg role="img" aria-label="{escape(label)}"'
    return text.replace('<svg', described, 1).strip()


@print_style()
def save_figure(figure: Figure, path: Path) -> None:
    """
    Write a figure, whole or not at all, without a date.

    The suffix of the file is its format: png, svg or pdf.
    """
    kind = path.suffix.lower().lstrip('.')
    dated = {'png': 'Software', 'svg': 'Date', 'pdf': 'CreationDate'}
    if kind not in dated:
        raise ValueError(f'path is {path}: give a name that ends in .png, .svg or .pdf')
    with whole(path) as draft:
        figure.savefig(draft, format=kind, metadata={dated[kind]: None})


def draw_stop(axes: Any, time: ArrayLike, place: ArrayLike, depth: float, label: str = '') -> None:
    """Draw a stop over time, filled on its outer side."""
    outer, color = np.asarray(place) + depth, COLORS['stop']
    axes.fill_between(time, place, outer, color=color, alpha=0.35, linewidth=0, label=label)
    axes.plot(time, place, color=color, linewidth=1.0)


def draw_impacts(axes: Any, impacts: Any, start: float, end: float) -> None:
    """Draw impacts from `start` to `end` where m hits, with mark and colour of each stop."""
    inside = (impacts['time'] >= start) & (impacts['time'] <= end)
    for stop, look in IMPACTS.items():
        hits = impacts[inside & (impacts['stop'] == stop)]
        if len(hits):
            style = {'linestyle': 'none', 'markersize': 7, 'markeredgewidth': 0, 'zorder': 4}
            label = f'impact on stop {stop}'
            axes.plot(hits['time'], hits['x'] + hits['y'], **style, **look, label=label)


def place_log_ticks(axis: Any) -> None:
    """Put ticks of a logarithmic axis at 1, 2 and 5, plain numbers; at powers over 3 decades."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    if high < 1e3 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter('{x:.6g}')
    axis.set_minor_formatter(NullFormatter())


def unit_axis(axis: Any, label: str, name: str, *values: ArrayLike) -> Unit:
    """Label an axis in the handy unit of values that are drawn in SI units; return the unit."""
    unit = unit_for(name, *values)
    if axis.get_scale() == 'log':
        place_log_ticks(axis)
    axis.set_label_text(f'{label} [{unit.name}]')
    axis.set_major_formatter(lambda value, _: number(unit.factor * value))
    return unit
