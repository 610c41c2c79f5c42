# SPDX-License-Identifier: Apache-2.0
"""The scores of controlled runs: one table of all, and their amplitudes as a figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.compare.score import RunScore, Score

from .drawing import (
    BLUE,
    COLORS,
    GREEN,
    ORANGE,
    PURPLE,
    blank_figure,
    finish_panel,
    legend_below,
    print_style,
    unit_axis,
)
from .formatting import number, quantity, unit_for
from .table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Kinds of line of runs; the dashed one is that of the fixed gap.
_KINDS = ('-', '-.', ':')
_LINES = (BLUE, ORANGE, GREEN, PURPLE, '#e69f00', '#56b4e9')


def _name(run: RunScore) -> str:
    path = Path(run.bag)
    name = path.stem if path.suffix == '.mcap' else path.name
    return f'{name}, run {run.number}' if run.run_count > 1 else name


def score_table(runs: Sequence[RunScore]) -> Table:
    """Return the table of all stretches, and of each whole run with its two references."""
    every = [part for run in runs for part in (*run.stretches, run.overall)]
    length = unit_for('m', [part.run.x_rms for part in every])
    energy = unit_for('J', [part.run.impact_energy for part in every])
    impulse = unit_for('N s', [part.run.largest_impulse for part in every])
    pushed = any(part.run.active_work for part in every)
    head = [
        *('run', 'stretch', 'control', f'rms of X [{length.name}]', '/ fixed gap', '/ M alone'),
        *(f'largest |X| [{length.name}]', 'settles in [s]', 'impacts'),
        *(f'mean impulse [{impulse.name}]', f'largest [{impulse.name}]'),
        f'taken from M by impacts [{energy.name}]',
        *([f'by the active force [{energy.name}]'] if pushed else []),
        f'spent by actuators [{energy.name}]',
    ]

    def row(label: Sequence[str], part: Score, which: str = 'run') -> list[str]:
        found = getattr(part, which)
        settled = part.settling_time if which == 'run' else None
        entries = (
            (length.factor * found.x_rms, 4),
            (found.x_rms / part.fixed_gap.x_rms if part.fixed_gap.x_rms else None, 3),
            (found.x_rms / part.alone.x_rms if part.alone.x_rms else None, 3),
            (length.factor * found.x_max, 4),
            (settled, 4),
            (found.impacts, 9),
            (impulse.factor * found.total_impulse / found.impacts if found.impacts else None, 4),
            (impulse.factor * found.largest_impulse if found.impacts else None, 4),
            (energy.factor * found.impact_energy, 4),
            *([(-energy.factor * found.active_work, 4)] if pushed else []),
            (energy.factor * found.actuator_energy, 4),
        )
        return [*label, *(number(value, digits) for value, digits in entries)]

    rows = []
    for run in runs:
        name = _name(run)
        for count, part in enumerate(run.stretches, 1):
            rows.append(row([name, str(count), part.control], part))
        rows.append(row([name, 'all', run.overall.control], run.overall))
        gap = f'fixed: gap {quantity(run.gap, "m", 3)}'
        rows.append(row([name, 'all', gap], run.overall, 'fixed_gap'))
        rows.append(row([name, 'all', 'M alone'], run.overall, 'alone'))
    return Table.of_rows(head, rows, texts=3)


def score_text(runs: Sequence[RunScore]) -> str:
    """Return the scores as text: the scored runs, and the table."""
    lines = []
    for run in runs:
        log = 'log reproduced'
        which = f', run {run.number} of {run.run_count}' if run.run_count > 1 else ''
        if run.differences:
            log = f'LOG DIFFERS from its replay in {run.differences:,} numbers or messages'
        lines.append(f'scored       {run.bag}, node {run.node}{which}: {log}')
        for part, score in enumerate(run.stretches, 1):
            lines.append(
                f'  stretch {part:<3} {score.start:.9g} s to {score.end:.9g} s; begins with: '
                f'{score.cause}'
            )
        lines += [f'  fault       {fault}' for fault in run.faults]
    return '\n'.join([*lines, '', score_table(runs).text()])


@print_style()
def score_figure(runs: Sequence[RunScore]) -> Figure:
    """Draw the amplitude of X over time, and the rms of X of each run and its references."""
    figure = blank_figure(9.5, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1))
    largest = [run.amplitude[1] for run in runs]
    handles: list[Any] = []
    seen: list[float] = []
    alike = len({round(math.log(run.gap), 6) for run in runs}) == 1
    for count, (run, color) in enumerate(zip(runs, _line_styles(len(runs)), strict=True)):
        look = {'color': color, 'linewidth': 1.4, 'label': _name(run)}
        # Runs that share a colour have lines of different kinds.
        kind = _KINDS[count // len(_LINES) % len(_KINDS)]
        handles += left.plot(*run.amplitude, **look, linestyle=kind)
        if not any(np.isclose(run.gap, gap, rtol=1e-6) for gap in seen):
            seen.append(run.gap)
            label = f'fixed gap, {quantity(run.gap, "m", 3)}'
            shade = COLORS['ink'] if alike else color
            look = {'color': shade, 'linewidth': 1.1, 'linestyle': (0, (4, 2)), 'alpha': 0.75}
            handles += left.plot(*run.fixed_amplitude, **look, label=label)
            largest.append(run.fixed_amplitude[1])
    for edge in {score.start for run in runs for score in run.stretches[1:]}:
        left.axvline(edge, color=COLORS['grid'], linewidth=1.0, zorder=0)
    left.set_ylim(0.0)
    left.set_xlim(min(run.overall.start for run in runs), max(run.overall.end for run in runs))
    finish_panel(left, 'a', 'rig time [s]', '')
    unit_axis(left.yaxis, 'largest |X| in a cycle', 'm', *largest)
    place = np.arange(len(runs))[::-1]
    alone = [run.overall.alone.x_rms or math.inf for run in runs]
    ratio = [run.overall.run.x_rms / rms for run, rms in zip(runs, alone, strict=True)]
    right.barh(place, ratio, 0.6, color=_line_styles(len(runs)))
    fixed = [run.overall.fixed_gap.x_rms / rms for run, rms in zip(runs, alone, strict=True)]
    look = {'color': COLORS['ink'], 'linestyle': 'none', 'marker': '|', 'markersize': 16}
    handles += right.plot(fixed, place, **look, markeredgewidth=2, label='with the fixed gap')
    right.set_yticks(place, [_name(run) for run in runs])
    right.set_ylim(-0.6, len(runs) - 0.4)
    right.set_xlim(0.0, 1.08 * max(ratio + fixed) or 1.0)
    finish_panel(right, 'b', 'rms of X / rms of M alone', '')
    legend_below(figure, handles, 4)
    return figure


def _line_styles(count: int) -> list[str]:
    return [_LINES[i % len(_LINES)] for i in range(count)]
