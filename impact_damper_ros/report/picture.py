# SPDX-License-Identifier: Apache-2.0
"""A picture of a report: its axes, legend, title and caption."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .formatting import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Widths in inches. A narrow picture fits a phone; a wide one is scrolled there.
NARROW, WIDE = 5.3, 10.9
#: Room beside the axes, left, right and below, and above them, for each row of the legend too.
_MARGINS, _TOP, _ROW = (0.78, 0.22, 0.5), 0.12, 0.185


class Picture(NamedTuple):
    """A figure, its title and its caption."""

    figure: Figure
    title: str
    caption: str

    @property
    def wide(self) -> bool:
        """Whether the picture is as wide as the page."""
        return bool(self.figure.get_figwidth() == WIDE)


def panel(x_label: str, y_label: str, *, wide: bool = False, height: float = 3.7) -> Any:
    """Return the axes of a new figure."""
    from matplotlib.figure import Figure

    width = WIDE if wide else NARROW
    figure = Figure(figsize=(width, height))
    axes = figure.subplots()
    axes.set(xlabel=x_label, ylabel=y_label)
    # matplotlib's own layouts take longer than the drawing.
    left, right, bottom = _MARGINS
    figure.subplots_adjust(left / width, bottom / height, 1.0 - right / width)
    return axes


def picture_of(axes: Any, title: str, caption: str, columns: int = 0) -> Picture:
    """Put the legend above the axes, and return the picture."""
    count = len(axes.get_legend_handles_labels()[0])
    columns = columns or max(1, count)
    room = _TOP + _ROW * math.ceil(count / columns)
    axes.figure.subplots_adjust(top=1.0 - room / axes.figure.get_figheight())
    axes.legend(
        loc='lower left',
        bbox_to_anchor=(-0.01, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        borderpad=0.1,
        columnspacing=1.1,
        handlelength=1.6,
        handletextpad=0.5,
        labelspacing=0.25,
        markerscale=0.8,
    )
    return Picture(axes.figure, title, caption)


def set_log_axis(axes: Any, low: float, high: float, factor: float = 1.0) -> None:
    """Make the vertical axis logarithmic, from `low` to `high`, with few labels."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.set_yscale('log')
    axes.set_ylim(low, high)
    axes.yaxis.set_major_locator(LogLocator(numticks=7))
    axes.yaxis.set_major_formatter(lambda value, _: number(factor * value, 1))
    axes.yaxis.set_minor_locator(NullLocator())


def finite_range(
    *values: ArrayLike, margin: float = 0.06, least: float = 0.0
) -> tuple[float, float]:
    """Return limits of an axis that hold all finite values."""
    joined = np.concatenate([np.asarray(value, dtype=float).ravel() for value in values])
    joined = joined[np.isfinite(joined)]
    low, high = (float(joined.min()), float(joined.max())) if len(joined) else (-1.0, 1.0)
    # In a narrower range all numbers at the axis would be the same.
    width = max(high - low, least, 1e-6 * max(abs(low), abs(high))) or 1.0
    middle = 0.5 * (low + high)
    return middle - width * (0.5 + margin), middle + width * (0.5 + margin)
