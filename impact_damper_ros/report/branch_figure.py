# SPDX-License-Identifier: Apache-2.0
"""The figure of a branch of periodic motions, with its special points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from impact_damper_ros.orbits.branch import Branch, SpecialKind
from impact_damper_ros.orbits.varied_parameter import spec_of

from .drawing import COLORS, MOTION_LINES, blank_figure, finish_panel, legend_below, print_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Marks of special points, in all figures.
SPECIAL_MARKS = {
    SpecialKind.FOLD: '>',
    SpecialKind.PERIOD_DOUBLING: 's',
    SpecialKind.NEIMARK_SACKER: 'D',
    SpecialKind.BRANCH_POINT: 'o',
    SpecialKind.GRAZING: 'X',
}


def parameter_label(name: str) -> str:
    """Return a parameter and its unit for an axis."""
    spec = spec_of(name)
    return f'{name} [{spec.unit}]' if spec.unit else name


@print_style()
def branch_figure(branches: Sequence[Branch], title: str = '') -> Figure:
    """Draw the largest |X| along branches of one parameter, with their special points."""
    from matplotlib.lines import Line2D

    figure = blank_figure(6.3, 4.4, title)
    axes: Any = figure.subplots()
    mark: dict[str, Any] = {'ls': 'none', 'ms': 6, 'mfc': 'white', 'color': COLORS['special']}
    lines: set[str] = set()
    marks: set[SpecialKind] = set()
    for branch in branches:
        for words, part in branch.parts():
            swings = [orbit.x_max for orbit in branch.orbits[part]]
            axes.plot(branch.values[part], swings, **MOTION_LINES[words])
            lines.add(words)
        for special in branch.special:
            axes.plot(
                special.value, special.orbit.x_max, marker=SPECIAL_MARKS[special.kind], **mark
            )
            marks.add(special.kind)
    name = branches[0].name
    finish_panel(axes, '', parameter_label(name), 'Largest |X| [m]')
    handles = [
        Line2D([], [], **look, label=word) for word, look in MOTION_LINES.items() if word in lines
    ]
    handles += [
        Line2D([], [], marker=SPECIAL_MARKS[kind], label=kind.value, **mark)
        for kind in SpecialKind
        if kind in marks
    ]
    legend_below(figure, handles, 4)
    return figure
