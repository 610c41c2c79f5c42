"""The frame that all pictures of a report share: size, margins, legend, scales."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .report_svg import BOTH, COLORS
from .report_units import power_of_ten
from .run_comparison import StretchComparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    'DASHED',
    'Picture',
    'Points',
    'cloud',
    'draw_stop',
    'figure_of',
    'finite_range',
    'legend_above',
    'log_axis',
    'predicted_label',
    'rings',
]

#: Widths in inches. A narrow picture fits a phone as it is; a wide one is scrolled there.
NARROW, WIDE = 5.3, 10.9
_LEFT, _RIGHT, _BOTTOM = 0.78, 0.22, 0.5
#: Room above the axes, and how much of it each row of the legend takes.
_TOP, _ROW = 0.12, 0.185
DASHED = (0, (3.2, 2.2))
_DOTTED = (0, (1, 1.8))
#: More marks than this are drawn as pixels, which take the same room for any number.
_MOST_MARKS = 300
#: Points closer than the width of the axes by this are one.
_RASTER = 700.0


class Picture(NamedTuple):
    """
    A figure with its words.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    title : str
        What it is.
    caption : str
        What it shows, in a sentence or two.
    wide : bool
        Whether it is as wide as the page.
    """

    figure: Figure
    title: str
    caption: str
    wide: bool = False


def _place(width: float, height: float, rows: int) -> tuple[float, float, float, float]:
    """Return where the axes are in a figure, as shares of it."""
    inside = (width - _LEFT - _RIGHT, height - _TOP - rows * _ROW - _BOTTOM)
    return _LEFT / width, _BOTTOM / height, inside[0] / width, inside[1] / height


def figure_of(
    x_label: str, y_label: str, *, wide: bool = False, height: float = 3.7
) -> tuple[Figure, Any]:
    """
    Return an empty figure and its axes.

    Parameters
    ----------
    x_label, y_label : str
        Labels with units.
    wide : bool, optional
        Whether it is as wide as the page.
    height : float, optional
        In inches.
    """
    from matplotlib.figure import Figure

    width = WIDE if wide else NARROW
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes(_place(width, height, rows=1))
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    return figure, axes


def legend_above(axes: Any, entries: Sequence[tuple[str, str, str]], columns: int = 0) -> None:
    """
    Put a legend above the axes, where it hides nothing.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The axes.
    entries : sequence of (str, str, str)
        What each looks like ('line', 'dashed', 'dotted', 'patch' or a marker), colour, label.
    columns : int, optional
        In how many columns; all in a row if not given.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines: dict[str, Any] = {'line': '-', 'dashed': DASHED, 'dotted': _DOTTED}
    handles: list[Any] = []
    for look, name, label in entries:
        color = COLORS[name]
        if look == 'patch':
            handles.append(Patch(facecolor=color, alpha=0.5, label=label))
        elif look in lines:
            style: dict[str, Any] = {'linewidth': 1.8, 'linestyle': lines[look]}
            handles.append(Line2D([], [], color=color, label=label, **style))
        else:
            style = {'markeredgecolor': color, 'markerfacecolor': color}
            if look in 'oD':
                style['markerfacecolor'] = 'none'
            size = 8 if look == '*' else 6.5
            handles.append(Line2D([], [], ls='none', marker=look, ms=size, label=label, **style))
    columns = columns or max(1, len(handles))
    width, height = axes.figure.get_size_inches()
    axes.set_position(_place(width, height, rows=-(-len(handles) // columns)))
    axes.legend(
        handles=handles,
        loc='lower left',
        bbox_to_anchor=(-0.01, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.1,
        columnspacing=1.1,
        handlelength=1.6,
        handletextpad=0.5,
        labelspacing=0.25,
    )


def finite_range(
    *values: ArrayLike, margin: float = 0.06, least: float = 0.0
) -> tuple[float, float]:
    """
    Return limits of an axis that hold all finite values.

    Parameters
    ----------
    values : array_like
        The values.
    margin : float, optional
        Free room on both sides, as a share.
    least : float, optional
        Least width.
    """
    joined = np.concatenate([np.asarray(value, dtype=float).ravel() for value in values])
    joined = joined[np.isfinite(joined)]
    low, high = (float(joined.min()), float(joined.max())) if len(joined) else (-1.0, 1.0)
    # Narrower than that, the numbers at the axis would all be the same.
    width = max(high - low, least, 1e-6 * max(abs(low), abs(high))) or 1.0
    middle = 0.5 * (low + high)
    return middle - width * (0.5 + margin), middle + width * (0.5 + margin)


def log_axis(axes: Any, low: float, high: float) -> None:
    """Make the upright axis one of powers of ten, from `low` to `high`, numbered sparsely."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale('log')
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis='y', which='minor', length=0)


def predicted_label(stretch: StretchComparison) -> str:
    """Return what a legend calls the prediction."""
    orbit = stretch.predicted
    return 'predicted' if orbit is None or orbit.stable else 'predicted, but unstable'


def rings(axes: Any, x: ArrayLike, y: ArrayLike, size: float = 10.0) -> None:
    """Draw predicted points, as rings that leave what is in them to be seen."""
    axes.plot(
        x,
        y,
        linestyle='none',
        marker='o',
        markersize=size,
        markeredgewidth=1.3,
        markeredgecolor=COLORS['theory'],
        markerfacecolor='none',
        clip_on=False,
        zorder=4,
    )


def draw_stop(axes: Any, place: ArrayLike, time: ArrayLike, depth: float) -> None:
    """Draw a stop over time, as a wall of some depth on its outer side."""
    outer = np.asarray(place) + depth
    axes.fill_between(time, place, outer, color=COLORS['stop'], alpha=0.35, linewidth=0)
    axes.plot(time, place, color=COLORS['stop'], linewidth=1.0)


class Points(NamedTuple):
    """
    Points of one kind in a picture.

    Attributes
    ----------
    x, y : ndarray of shape (n,)
        Where they are.
    marker : str
        Their look, if there are few in the picture.
    name : str
        Their colour, one of `BOTH`.
    alpha : float
        How much of it they have.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    marker: str
    name: str
    alpha: float


def cloud(axes: Any, kinds: Sequence[Points]) -> None:
    """
    Draw points, very many as the pixels of an image, and those that would cover one another once.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        The axes, their limits set.
    kinds : sequence of Points
        All points of the picture.
    """
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    rows = []
    for kind in kinds:
        place = np.stack([(kind.x - left) / (right - left), (kind.y - low) / (high - low)])
        rows.append(np.unique(np.round(_RASTER * place), axis=1, return_index=True)[1])
    # All kinds alike, so that none looks as if it had more points.
    dense = sum(map(len, rows)) > _MOST_MARKS
    for kind, seen in zip(kinds, rows, strict=True):
        axes.plot(
            kind.x[seen],
            kind.y[seen],
            linestyle='none',
            marker='o' if dense else kind.marker,
            markersize=1.6 if dense else 4.5,
            markeredgewidth=0,
            color=BOTH[kind.name] if dense else COLORS[kind.name],
            alpha=max(kind.alpha, 0.6) if dense else kind.alpha,
            rasterized=dense,
            clip_on=dense,
            zorder=2,
        )
