# SPDX-License-Identifier: Apache-2.0
"""
Figure 3: restitution, angle, input frequency and friction; two impacts per cycle.

    python examples/paper/figure_3.py [--out DIR] [--quick]

figure_3.png and figure_3.csv.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from bapat_rigs import ABOVE, BASIC, OPERATIONS, at_angle
from series import LOOKS, Series, computed, draw, legend, series_along, summary, write_series

from impact_damper_ros import with_value
from output import blank_figure, finish_panel, options, print_style, save

UNEQUAL = {'restitution_1': 0.78, 'restitution_2': 0.72}
ANGLES = (0, 5, 10, 15)


def series_of_figure(quick: bool = False) -> dict[str, Series]:
    """Return the series of all panels."""

    def grid(low: float, high: float, count: int) -> list[float]:
        return np.linspace(low, high, (count - 1) // (4 if quick else 1) + 1).tolist()

    work = {}
    for name, operation in OPERATIONS.items():
        for kind, changes in (('equal', {}), ('unequal', UNEQUAL)):
            rig = BASIC.replace(gravity=2.0, **operation, **changes)
            marks = grid(20.0, 70.0, 21) if changes else []
            along = partial(with_value, rig, 'gap')
            gaps = grid(20.0, 70.0, 11)
            work[f'a, {name}, {kind}'] = partial(series_along, along, gaps, marks, name='gap')
    for ratio, rig in ((1, BASIC), (1.02, ABOVE)):
        work[f'b, r = {ratio}'] = partial(
            series_along, partial(at_angle, rig), grid(0.0, 90.0, 31), grid(0.0, 50.0, 26)
        )
    rates = [*grid(0.999, 1.006, 8), *grid(1.01, 1.12, 23)]
    for angle in ANGLES:
        rig = partial(with_value, at_angle(BASIC, angle), 'force_frequencies')
        work[f'c, {angle}°'] = partial(
            series_along, rig, rates, grid(1.0, 1.12, 13), carried=False
        )
    rig = partial(with_value, BASIC.replace(gap=50.0), 'friction')
    work['d'] = partial(series_along, rig, grid(0.0, 1.0, 21), grid(0.0, 1.0, 21))
    return computed(work)


@print_style()
def main() -> None:
    """Compute, print, write and draw."""
    arguments = options(__doc__)
    found = series_of_figure(arguments.quick)
    summary(found)
    write_series(arguments.out / 'figure_3.csv', found)
    figure = blank_figure(8.2, 7.0)
    (a, b), (c, d) = figure.subplots(2, 2)
    inside = {'loc': 'upper left', 'framealpha': 0.9}
    for name, look in zip(OPERATIONS, LOOKS, strict=False):
        draw(a, found[f'a, {name}, equal'], look, width=0.55)
        draw(a, found[f'a, {name}, unequal'], look)
    a.set(xlim=(30.0, 66.0), ylim=(0.0, 0.2))
    labels = ('horizontal', 'inclined 45°', 'inclined, γ = 0.5')
    legend(a, list(zip(labels, LOOKS, strict=False)), **inside | {'loc': 'upper right'})
    note = 'thick: $R_1, R_2$ = 0.78, 0.72\nthin: $R_1 = R_2$ = 0.75'
    a.text(0.03, 0.05, note, transform=a.transAxes, fontsize=8)
    finish_panel(a, 'a', 'gap $d$ [m]', r'$X_{\max}/A$')
    for ratio, look in zip(('1', '1.02'), LOOKS, strict=False):
        draw(b, found[f'b, r = {ratio}'], look)
    b.set(xlim=(0.0, 90.0), ylim=(0.05, 0.32))
    legend(b, [(f'$r$ = {r}', look) for r, look in zip(('1', '1.02'), LOOKS, strict=False)],
           **inside)  # fmt: skip
    finish_panel(b, 'b', 'angle of inclination $θ$ [°]', r'$X_{\max}/A$')
    for angle, look in zip(ANGLES, LOOKS, strict=True):
        draw(c, found[f'c, {angle}°'], look)
    c.set(xlim=(0.999, 1.12), ylim=(0.08, 0.55))
    legend(c, [(f'θ = {angle}°', look) for angle, look in zip(ANGLES, LOOKS, strict=True)],
           **inside)  # fmt: skip
    finish_panel(c, 'c', 'input frequency $Ω$ [rad/s]', r'$X_{\max}/A$')
    draw(d, found['d'], LOOKS[0])
    d.set(xlim=(0.0, 1.0), ylim=(0.0, 0.25))
    finish_panel(d, 'd', 'friction coefficient $γ$', r'$X_{\max}/A$')
    legend(figure, [], ncols=3)
    save(figure, arguments.out / 'figure_3.png')


if __name__ == '__main__':
    main()
