# SPDX-License-Identifier: Apache-2.0
"""
Figure 4: the largest displacement against the natural frequency; M, zeta, r and F/K are kept.

    python examples/paper/figure_4.py [--out DIR] [--quick]

The printed values (AK/F = 1, zeta = 0.05, r = 1) contradict each other: the figure is for
F/K = 1 m and zeta = 0.005. figure_4.png and figure_4.csv.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from bapat_rigs import BASIC, TILTED, scaled_rig
from series import LOOKS, Series, computed, draw, legend, series_along, summary, write_series

from output import blank_figure, finish_panel, options, print_style, save, set_ticks

RIGS = {
    'inclined (θ = 15°, γ = 0.5)': TILTED,
    'horizontal, no friction': BASIC.replace(gap=50.0),
}


def series_of_figure(quick: bool = False) -> dict[str, Series]:
    """Return both series."""
    # From the stiff rigs on: steps are relative to where a branch starts
    starts = np.geomspace(20.0, 0.5, 9 if quick else 49)
    marks = {name: starts[:: 2 * k] for k, name in enumerate(RIGS, 1)}
    return computed(
        {
            name: partial(
                series_along, partial(scaled_rig, rig), starts, marks[name], carried=False
            )
            for name, rig in RIGS.items()
        }
    )


@print_style()
def main() -> None:
    """Compute, print, write and draw."""
    arguments = options(__doc__)
    found = series_of_figure(arguments.quick)
    summary(found)
    write_series(arguments.out / 'figure_4.csv', found)
    figure = blank_figure(5.6, 4.2)
    axes = figure.subplots()
    looks = dict(zip(found, (LOOKS[2], LOOKS[0]), strict=True))
    for name, look in looks.items():
        draw(axes, found[name], look)
    axes.set(xscale='log', xlim=(0.5, 20.0), ylim=(0.0, 0.2))
    finish_panel(axes, '', 'natural frequency $ω$ [rad/s]', r'$X_{\max}/A$')
    set_ticks(axes.xaxis, (0.5, 1, 2, 5, 10, 20))
    legend(figure, list(looks.items()), ncols=2)
    save(figure, arguments.out / 'figure_4.png')


if __name__ == '__main__':
    main()
