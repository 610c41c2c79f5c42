# SPDX-License-Identifier: Apache-2.0
"""The figure, the table and the text of the response to a random base."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from impact_damper_ros.compare.random_response import RandomResponse
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .csv_tables import csv_text
from .drawing import COLORS, blank_figure, finish_panel, place_log_ticks, print_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest remaining part of a free vibration with which the averages are valid.
_SETTLED = 0.01
#: Columns of the table.
_COLUMNS = (
    'frequency [Hz]',
    'base_level [(m/s^2)^2/Hz]',
    'primary_level [(m/s^2)^2/Hz]',
    'transmissibility',
    'relative_transmissibility',
    'transmissibility_without_damper',
    'relative_transmissibility_without_damper',
)


def response_csv(found: RandomResponse) -> str:
    """Return the lines as CSV."""
    return csv_text(dict(zip(_COLUMNS, found[:7], strict=True)))


def response_text(found: RandomResponse) -> str:
    """Return the result in words."""
    smooth = found.smooth(found.absolute)
    best = int(np.argmax(smooth))
    without = found.smooth(found.absolute_without)
    alone = int(np.argmax(without))
    plural = 's' if found.periods > 1 else ''
    settled = f'a vibration of the start has decayed to {100.0 * found.left:.2g} % before them'
    if found.left > _SETTLED:
        settled += ': give a longer --duration'
    return (
        f'transmissibility over {found.periods} period{plural} of {found.period:.6g} s, after '
        f'{found.left_out}; {settled}: rms X/rms '
        f'b {found.total[0]:.6g}; rms (X - b)/rms b {found.total[1]:.6g}\n'
        f"at the {len(found.frequencies)} lines: X'' "
        f"{found.primary_rms / STANDARD_GRAVITY:.4g} g rms, b'' "
        f'{found.base_rms / STANDARD_GRAVITY:.4g} g rms; |X|/|b|, over 9 of them, is largest at '
        f'{found.frequencies[best]:.4g} Hz, {smooth[best]:.4g}; without damper at '
        f'{found.frequencies[alone]:.4g} Hz, {without[alone]:.4g}'
    )


@print_style()
def response_figure(found: RandomResponse, title: str = '') -> Figure:
    """Draw the transmissibilities and the densities over frequency."""
    figure = blank_figure(6.3, 6.6, title)
    panels = figure.subplots(3, 1, sharex=True)
    hertz = found.frequencies
    pairs = (
        (found.absolute, found.absolute_without, '|X|/|b|'),
        (found.relative, found.relative_without, '|X − b|/|b|'),
    )
    for panel, (values, alone, label), letter in zip(panels, pairs, 'ab', strict=False):
        panel.plot(hertz, values, color=COLORS['primary'], lw=0.6, alpha=0.4)
        panel.plot(
            hertz, found.smooth(values), color=COLORS['primary'], lw=1.6, label='with damper'
        )
        panel.plot(
            hertz, found.smooth(alone), color=COLORS['quiet'], lw=1.2, ls='--', label='without'
        )
        panel.set_yscale('log')
        place_log_ticks(panel.yaxis)
        panel.legend(frameon=False)
        finish_panel(panel, letter, '', label)
    level = STANDARD_GRAVITY**2
    panels[2].plot(hertz, found.primary / level, color=COLORS['primary'], lw=0.8, label='M')
    panels[2].plot(hertz, found.base / level, color=COLORS['special'], lw=1.4, label='base')
    panels[2].set_yscale('log')
    place_log_ticks(panels[2].yaxis)
    panels[2].legend(frameon=False)
    finish_panel(panels[2], 'c', 'Frequency [Hz]', 'Density [g²/Hz]')
    return figure
