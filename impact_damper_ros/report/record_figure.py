# SPDX-License-Identifier: Apache-2.0
"""The figure of a motion over time, and the text of the response to measured records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from impact_damper_ros.compare.record_response import Array, RecordResponse
from impact_damper_ros.measured.record import BASE_RECORD, MeasuredRecord

from .drawing import COLORS, blank_figure, finish_panel, print_style, unit_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _sizes(displacement: Array) -> str:
    largest, rms = np.abs(displacement).max(), math.sqrt(float(np.mean(displacement**2)))
    return f'{largest:.5g} m at most, {rms:.5g} m rms'


def record_text(found: RecordResponse, records: Sequence[MeasuredRecord]) -> str:
    """Return the response to measured records in words."""
    lines = [f'records     |{found.name}| {_sizes(found.displacement)}']
    if any(record.quantity == BASE_RECORD for record in records):
        place, speed = found.base
        lines.append(
            f"base        at the end b = {place:.5g} m, b' = {speed:.5g} m/s, the integrals of "
            'its acceleration; X counts from a fixed place'
        )
    return '\n'.join(lines)


@print_style()
def record_figure(
    found: RecordResponse, records: Sequence[MeasuredRecord], title: str = ''
) -> Figure:
    """Draw the records and the motion of both masses over time."""
    figure = blank_figure(6.3, 3.9 + 1.7 * len(records), title)
    *panels, primary, damper = figure.subplots(len(records) + 2, 1, sharex=True)
    for number, (panel, record) in enumerate(zip(panels, records, strict=True)):
        starts, values = record.steps()
        panel.step(starts, values, where='post', color=COLORS['special'], lw=0.7)
        finish_panel(panel, 'abc'[number], '', '')
        label, unit = ("b''", 'm/s²') if record.quantity == BASE_RECORD else ('Force', 'N')
        unit_axis(panel.yaxis, label, unit, record.values)
    primary.plot(found.times, found.displacement, color=COLORS['primary'], lw=1.0)
    finish_panel(primary, 'abc'[len(records)], '', '')
    unit_axis(primary.yaxis, found.name.replace('-', '−'), 'm', found.displacement)
    damper.plot(found.times, found.stops, color=COLORS['stop'], lw=1.2)
    damper.plot(*found.offset, color=COLORS['damper'], lw=1.0)
    damper.set_xlim(found.times[0], found.times[-1])
    finish_panel(damper, 'abcd'[len(records) + 1], 'Time [s]', '')
    unit_axis(damper.yaxis, 'Y, and the stops', 'm', found.stops)
    return figure
