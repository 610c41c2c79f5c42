"""How the paper's figures are drawn: curves of theory, marks of simulations, legends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from .paper_settled import SettledMotion
from .paper_sweep import Curve, Point, Status

__all__ = ['draw_curves', 'draw_marks', 'legend_below']

_STYLES: dict[Status, dict[str, Any]] = {
    Status.STABLE: {'linestyle': '-', 'linewidth': 1.7},
    Status.UNSTABLE: {'linestyle': (0, (4, 2.2)), 'linewidth': 0.9},
}


def _stretches(points: Sequence[Point]) -> Iterator[tuple[Status, list[Point]]]:
    """Yield stretches of one status; each reaches to the first point of the next."""
    run: list[Point] = []
    for point in points:
        if run and point.status != run[-1].status:
            # The edge is found to a fraction of a line's width; either style may bridge it
            bridged = point.status != Status.NOT_VIABLE
            yield run[-1].status, [*run, point] if bridged else run
            run = []
        run.append(point)
    if run:
        yield run[-1].status, run


def draw_curves(
    axes: Any,
    curves: Sequence[Curve],
    color: str,
    quantity: Callable[[Point], Sequence[float]],
    scale: float = 1.0,
) -> None:
    """
    Draw theory: stable motions solid, unstable ones dashed, those not viable not at all.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    curves : sequence of Curve
        The curves.
    color : str
        Their colour.
    quantity : callable
        Gives the ordinates of a point, one line for each.
    scale : float, optional
        Factor of the line widths.
    """
    for curve in curves:
        for status, points in _stretches(curve.points):
            if status == Status.NOT_VIABLE:
                continue
            style = dict(_STYLES[status])
            style['linewidth'] *= scale
            rows = zip(*(quantity(point) for point in points), strict=True)
            for row in rows:
                axes.plot([p.value for p in points], row, color=color, zorder=2, **style)


def draw_marks(
    axes: Any,
    motions: Sequence[SettledMotion],
    impacts: int,
    color: str,
    marker: str,
    quantity: Callable[[SettledMotion], Sequence[float]],
) -> None:
    """
    Draw simulation: settled motions with a number of impacts in one cycle of the force.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where.
    motions : sequence of SettledMotion
        The motions.
    impacts : int
        The number.
    color, marker : str
        How.
    quantity : callable
        Gives the ordinates of a motion.
    """
    pairs = [
        (motion.value, ordinate)
        for motion in motions
        if motion.cycles == 1 and len(motion.stops) == impacts
        for ordinate in quantity(motion)
    ]
    if pairs:
        axes.plot(
            *zip(*pairs, strict=True),
            linestyle='none',
            marker=marker,
            markersize=4.2,
            markeredgewidth=0.9,
            markeredgecolor=color,
            markerfacecolor='white',
            zorder=3,
            clip_on=False,
        )


def legend_below(
    where: Any, series: Sequence[tuple[str, str, str]], columns: int, *, marks: bool = True
) -> None:
    """
    Put the legend of a figure below its panels.

    Parameters
    ----------
    where : matplotlib.figure.Figure
        The figure.
    series : sequence of (str, str, str)
        Label, colour and marker of each series.
    columns : int
        Number of columns.
    marks : bool, optional
        Whether there are simulated motions.
    """
    from matplotlib.lines import Line2D

    look: dict[str, Any] = {'markersize': 4.5, 'markerfacecolor': 'white'}
    handles = [
        Line2D([], [], color=color, marker=marker, linewidth=1.7, label=label, **look)
        for label, color, marker in series
    ]
    handles += [
        Line2D([], [], color='0.3', label='theory, stable', **_STYLES[Status.STABLE]),
        Line2D([], [], color='0.3', label='theory, unstable', **_STYLES[Status.UNSTABLE]),
    ]
    if marks:
        handles.append(
            Line2D([], [], color='0.3', marker='o', linestyle='none', label='simulation', **look)
        )
    where.legend(handles=handles, loc='outside lower center', ncols=columns, frameon=False)
