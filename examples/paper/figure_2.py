# SPDX-License-Identifier: Apache-2.0
"""
Figure 2: two, three and four impacts per cycle against the gap, in three operations.

    python examples/paper/figure_2.py [--out DIR] [--quick]

The paper's caption has g = 1, its text g = 2: figure_2_g1.png, figure_2_g2.png, figure_2.csv.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from bapat_rigs import ABOVE, LABELS, OPERATIONS
from series import (
    LOOKS,
    Series,
    branches_along,
    computed,
    draw,
    durations,
    legend,
    performed,
    ratio,
    settled_runs,
    summary,
    write_series,
)

from impact_damper_ros import RigParameters, with_value
from output import blank_figure, finish_panel, options, print_style, save

LOW, HIGH = 4.0, 64.0  # of the gap, m
#: Gap from which on no rig of this figure has motions with three or four impacts, m.
MANY_UP_TO = 26.0
MANY = ((1, 1, 2), (1, 2, 2), (1, 1, 2, 2), (1, 1, 1, 2), (1, 2, 2, 2))
WORDS = {2: 'two', 3: 'three', 4: 'four'}


def gap_series(rig: RigParameters, quick: bool = False) -> Series:
    """Return all motions of a rig over the gap; with three and more impacts those stable once."""
    at = partial(with_value, rig, 'gap')
    two = (20.0, 23.0, 40.0) if quick else np.arange(5.0, HIGH)
    many = (19.0,) if quick else np.arange(5.0, MANY_UP_TO)
    sequences = MANY[:2] if quick else MANY
    branches = [
        *branches_along(at, LOW, HIGH, two, name='gap'),
        *filter(performed, branches_along(at, LOW, HIGH, many, sequences, name='gap')),
    ]
    if rig.friction:
        # m may also reverse between two stops: found from simulated starts
        near = (20.0,) if quick else np.arange(15.0, 26.0)
        found = branches_along(at, LOW, HIGH, near, name='gap', simulate=True)
        branches += [branch for branch in found if branch.orbits[0].events]
    marks = (
        (8.0, 16.0, 37.0) if quick else [*np.arange(6.0, 24.0, 0.5), *np.arange(24.0, 65.0, 2.0)]
    )
    return Series(at, LOW, HIGH, tuple(branches), tuple(settled_runs(at, marks, branches)))


def series_of_figure(quick: bool = False) -> dict[str, Series]:
    """Return the series of both figures; of that with g = 2 if quick."""
    rigs = {'horizontal': ABOVE.replace(gravity=1.0)}
    for gravity in (2,) if quick else (1, 2):
        for name in ('inclined', 'friction'):
            rigs[f'{name} g={gravity}'] = ABOVE.replace(gravity=gravity, **OPERATIONS[name])
    return computed({name: partial(gap_series, rig, quick) for name, rig in rigs.items()})


@print_style()
def main() -> None:
    """Compute, print, write and draw."""
    arguments = options(__doc__)
    found = series_of_figure(arguments.quick)
    summary(found)
    write_series(arguments.out / 'figure_2.csv', found)
    limits = {2: (15.0, 64.0, 0.1, 0.55), 3: (9.0, 24.0, 0.36, 0.46), 4: (4.0, 14.0, 0.4, 0.5)}
    heights = {2: (0.2, 1.8), 3: (0.3, 1.2), 4: (0.2, 1.0)}
    for gravity in (2,) if arguments.quick else (1, 2):
        names = ('horizontal', f'inclined g={gravity}', f'friction g={gravity}')
        figure = blank_figure(8.2, 9.2)
        panels = figure.subplots(3, 2)
        for row, (impacts, (low, high, bottom, top)) in zip(panels, limits.items(), strict=True):
            for axes, ordinate in zip(row, (durations, ratio), strict=True):
                for name, look in zip(names, LOOKS, strict=False):
                    draw(axes, found[name], look, impacts, ordinate)
                axes.set(xlim=(low, high), ylim=(bottom, top))
            row[0].set_ylim(*heights[impacts])
            letters = {2: 'ab', 3: 'cd', 4: 'ef'}[impacts]
            label = r'$(t_{i+1}-t_i)\,\Omega/\pi$'
            finish_panel(row[0], letters[0], 'gap $d$ [m]', label)
            finish_panel(row[1], letters[1], 'gap $d$ [m]', r'$X_{\max}/A$')
            for axes in row:
                axes.set_title(f'{WORDS[impacts]} impacts per cycle', loc='right')
        legend(figure, list(zip(LABELS.values(), LOOKS, strict=False)), ncols=2)
        save(figure, arguments.out / f'figure_2_g{gravity}.png')


if __name__ == '__main__':
    main()
