# SPDX-License-Identifier: Apache-2.0
"""
Figure 6: compressed air that pushes m away from the stop hit last; horizontal, friction 0.5.

    python examples/paper/figure_6.py [--out DIR] [--quick]

figure_6.png and figure_6.csv.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from bapat_rigs import ABOVE, BASIC, with_air
from series import LOOKS, Series, computed, draw, legend, series_along, summary, write_series

from output import blank_figure, finish_panel, options, print_style, save


def series_of_figure(quick: bool = False) -> dict[str, Series]:
    """Return the series at and above the resonance, along the air force over that of friction."""
    marks = np.linspace(0.0, 6.0, 5 if quick else 25)
    return computed(
        {
            f'r = {ratio}': partial(
                series_along, partial(with_air, rig.replace(friction=0.5)), marks, marks
            )
            for ratio, rig in ((1, BASIC), (1.02, ABOVE))
        }
    )


@print_style()
def main() -> None:
    """Compute, print, write and draw."""
    arguments = options(__doc__)
    found = series_of_figure(arguments.quick)
    summary(found)
    write_series(arguments.out / 'figure_6.csv', found)
    figure = blank_figure(5.6, 4.2)
    axes = figure.subplots()
    looks = dict(zip(found, LOOKS, strict=False))
    for name, look in looks.items():
        draw(axes, found[name], look)
    for share, text in ((1.0, 'air cancels friction'), (2.0, 'air is twice friction')):
        axes.axvline(share, color='0.6', linewidth=0.8, linestyle=':')
        axes.text(share + 0.04, 0.585, text, rotation=90, fontsize=8, color='0.35', va='top')
    axes.set(xlim=(0.0, 5.5), ylim=(0.0, 0.6))
    finish_panel(axes, '', 'air force over friction force, $p/(mγg)$', r'$X_{\max}/A$')
    legend(figure, list(looks.items()), ncols=3)
    save(figure, arguments.out / 'figure_6.png')


if __name__ == '__main__':
    main()
