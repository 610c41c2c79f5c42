# SPDX-License-Identifier: Apache-2.0
"""
Figure 5: the gap with the least displacement, and that displacement, against the angle.

    python examples/paper/figure_5.py [--out DIR] [--quick]

figure_5.png and figure_5.csv.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from bapat_rigs import BASIC
from series import BLUE, LOOKS, MARKS, STABLE, Best, best_of, branches_along, near, same, settled

from impact_damper_ros import with_value
from output import blank_figure, finish_panel, options, print_style, save, show, write_rows

#: Gaps in which the optima lie, and one with a stable motion at each angle, m.
LOW, HIGH, START = 35.0, 62.0, 50.0
HEAD = ('angle [deg]', 'gap [m]', 'xmax_over_a', 'limit', 'settled run')


def optimum_at(angle: float) -> Best:
    """Return the best gap at an angle, degrees, with two impacts per cycle; r = 1, no friction."""
    rig = BASIC.replace(angle=math.radians(angle))
    at = partial(with_value, rig, 'gap')
    best = best_of(branches_along(at, LOW, HIGH, (START, 57.0), name='gap'))
    assert best is not None
    return best


def optima_of_figure(quick: bool = False) -> dict[float, Best]:
    """Return the optima by the angles."""
    fine = [0.0, 10.0, 45.0, 90.0] if quick else [*np.arange(0, 20, 2.5), *np.arange(20, 91, 5)]
    return {float(angle): optimum_at(float(angle)) for angle in fine}


@print_style()
def main() -> None:
    """Compute, print, write and draw."""
    arguments = options(__doc__)
    optima = optima_of_figure(arguments.quick)
    rows = []
    reached = []
    for angle, (gap, orbit, limit) in optima.items():
        # From near the motion: other attractors are near
        run = settled(near(orbit), 3000)
        hit = same(run, orbit)
        if hit:
            reached.append((angle, run.x_max / orbit.parameters.response_amplitude))
        rows.append([angle, gap, orbit.x_max_ratio, limit, reached[-1][1] if hit else ''])
    show(HEAD, rows)
    write_rows(arguments.out / 'figure_5.csv', HEAD, rows)
    figure = blank_figure(8.2, 3.7)
    left, right = figure.subplots(1, 2)
    edges = [row for row in rows if row[3]]
    for axes, column in ((left, 1), (right, 2)):
        axes.plot([row[0] for row in rows], [row[column] for row in rows], color=BLUE, **STABLE,
                  label='theory, stable')  # fmt: skip
        axes.plot([row[0] for row in edges], [row[column] for row in edges], '|', color='0.2',
                  markersize=11, label='limited by stability, no minimum')  # fmt: skip
    right.plot(*zip(*reached, strict=True), linestyle='none', marker=LOOKS[0][1], color=BLUE,
               label='simulation', **MARKS)  # fmt: skip
    left.set(xlim=(0.0, 91.5), ylim=(56.0, 61.0))
    right.set(xlim=(0.0, 91.5), ylim=(0.0, 0.06))
    finish_panel(left, 'a', 'angle of inclination $θ$ [°]', 'optimal gap [m]')
    label = r'$X_{\max}/A$ at the optimal gap'
    finish_panel(right, 'b', 'angle of inclination $θ$ [°]', label)
    handles = right.get_legend_handles_labels()
    figure.legend(*handles, loc='outside lower center', ncols=3, frameon=False)
    save(figure, arguments.out / 'figure_5.png')


if __name__ == '__main__':
    main()
