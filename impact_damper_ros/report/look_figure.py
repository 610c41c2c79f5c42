# SPDX-License-Identifier: Apache-2.0
"""What a file of measured data was read as, before anything is fitted to it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from impact_damper_ros.fit.measured_motion import MeasuredMotion, RawColumn

from .drawing import COLORS, blank_figure, finish_panel, print_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Most columns that are drawn.
_MOST_PANELS = 12


@print_style()
def look_figure(
    columns: Sequence[RawColumn], data: MeasuredMotion | None, title: str = ''
) -> Figure:
    """Draw each column over time, and in that of M what is not used, and the impacts."""
    columns = sorted(columns, key=lambda column: (column.role != 'motion', not column.role))
    columns = columns[:_MOST_PANELS]
    figure = blank_figure(6.3, 1.0 + 1.25 * len(columns), title)
    panels = np.atleast_1d(figure.subplots(len(columns), 1, sharex=True))
    for number, (panel, column) in enumerate(zip(panels, columns, strict=True)):
        color = COLORS['primary'] if column.role else COLORS['quiet']
        panel.plot(column.time, column.values, color=color, lw=0.7)
        finish_panel(panel, 'abcdefghijkl'[number], '', textwrap.fill(column.title[:60], 20))
        notes = [column.role or 'not used']
        if column.role == 'motion' and data is not None:
            motion, unused = data.motion / column.factor, ~data.used
            panel.plot(data.time[unused], motion[unused], '.', color=COLORS['special'], ms=3)
            # What stands for a missing sample may be far beyond all others
            pad = 0.1 * float(np.ptp(motion))
            panel.set_ylim(motion.min() - 2.0 * pad, motion.max() + pad)
            notes += [f'{unused.sum()} of {len(unused)} samples not used'] * bool(unused.any())
            if data.impact_times is not None:
                inside = panel.get_xaxis_transform()
                panel.vlines(
                    data.impact_times, 0.0, 0.06, color=COLORS['ink'], lw=0.7, transform=inside
                )
                notes.append(f'{len(data.impact_times)} impacts')
        panel.set_title('; '.join(notes), fontsize=7, loc='right')
    panels[-1].set_xlabel('Time [s]')
    return figure
