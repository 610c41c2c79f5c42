# SPDX-License-Identifier: Apache-2.0
"""The figure of measured data as they are read, before a fit."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from impact_damper_ros.fit.measured_motion import (
    NO_OPTIONS,
    MeasuredMotion,
    ReadingOptions,
    choices_of,
)
from impact_damper_ros.fit.recorded_motion import TopicMessages, series_of
from impact_damper_ros.measured.formats import read_sheet
from impact_damper_ros.measured.sheet import Array, TableError

from .drawing import COLORS, blank_figure, finish_panel, print_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Most columns that are drawn.
_MOST_PANELS = 12


class RawColumn(NamedTuple):
    """A column of a file over time in s, with its use and its factor to SI."""

    title: str
    time: Array
    values: Array
    role: str
    factor: float


def raw_columns(path: Path, options: ReadingOptions = NO_OPTIONS) -> list[RawColumn]:
    """Return all columns of numbers of a file, used or not."""
    sheet = read_sheet(path)
    _, choices = choices_of(sheet, options)
    roles = {choice.place: (key, choice.factor) for key, choice in choices.items()}
    clock = choices['time']
    found = []
    for place, head in enumerate(sheet.headings):
        role, factor = roles.get(place, ('', 1.0))
        # A column of text is left out.
        with contextlib.suppress(TableError):
            (time, values), _ = sheet.read([clock.place, place])
            if not role.startswith('time'):
                found.append(RawColumn(head.title, time * clock.factor, values, role, factor))
    return found


def message_columns(messages: TopicMessages, options: ReadingOptions) -> list[RawColumn]:
    """Return all columns of a topic, used or not."""
    series = series_of(messages, options)
    roles = {series.base: 'base', series.place: 'motion'}
    return [
        RawColumn(head.title, series.seconds, values, roles.get(n, ''), 1.0)
        for n, (head, values) in enumerate(series.found.columns)
    ]


@print_style()
def look_figure(
    columns: Sequence[RawColumn], data: MeasuredMotion | None, title: str = ''
) -> Figure:
    """Draw each column over time, and in that of M the unused samples and the impacts."""
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
            # A number that stands for a missing sample may be far beyond all others.
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
