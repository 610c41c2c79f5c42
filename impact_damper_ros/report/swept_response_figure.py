# SPDX-License-Identifier: Apache-2.0
"""The figure, the table and the text of the response to a stepped sine, in the units of a test."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.orbits.response import Array
from impact_damper_ros.orbits.swept_response import SweptResponse
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .csv_tables import csv_text
from .drawing import COLORS, blank_figure, finish_panel, place_log_ticks, print_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Ratio of neighbouring largest values from which on a step is a jump.
_JUMP = 1.3
#: Most jumps that are listed, and points that are marked.
_MOST_JUMPS, _MOST_MARKERS = 8, 100


def level_of(rig: RigParameters, level: Array) -> tuple[Array, str]:
    """Return the level in the unit of a test, and the unit."""
    if rig.swept == 'force':
        return level, 'N'
    scale, unit = {
        'displacement': (1e3, 'mm'),
        'velocity': (1.0, 'm/s'),
        'acceleration': (1.0 / STANDARD_GRAVITY, 'g'),
    }[rig.base_quantity]
    return level * scale, unit


def base_amplitude(rig: RigParameters, found: SweptResponse) -> Array:
    """Return the amplitude of b at each step, m."""
    power = ('displacement', 'velocity', 'acceleration').index(rig.base_quantity)
    return found.level / found.frequency**power


def _columns(rig: RigParameters, found: SweptResponse) -> dict[str, Array]:
    """Return the columns of the table with their headers."""
    level, unit = level_of(rig, found.level)
    g = STANDARD_GRAVITY
    moved = rig.swept == 'base'
    base = base_amplitude(rig, found)
    columns = {
        'frequency [Hz]': found.frequency / math.tau,
        f'level [{unit}]': level,
        'x [mm]': 1e3 * found.x,
        'x without damper [mm]': 1e3 * found.x_without,
        'x - b [mm]': 1e3 * found.relative,
        'x - b without damper [mm]': 1e3 * found.relative_without,
        'acceleration [g]': found.acceleration / g,
        'acceleration without damper [g]': found.acceleration_without / g,
        'transmissibility': found.x / base,
        'transmissibility without damper': found.x_without / base,
        'impacts per cycle': found.impacts,
        'time [s]': found.time,
    }
    of_base = ('x - b', 'transmissibility')
    return {n: values for n, values in columns.items() if moved or not n.startswith(of_base)}


def swept_table(rig: RigParameters, found: SweptResponse) -> str:
    """Return the steps as CSV."""
    # Nine digits: a largest value between points has fewer.
    columns = {n: [f'{v:.9g}' for v in column] for n, column in _columns(rig, found).items()}
    return csv_text({'way': np.where(found.upwards, 'up', 'down'), **columns})


def _jumps(found: SweptResponse) -> list[int]:
    """Return the steps at which the largest |X| jumps with the damper only."""
    with np.errstate(divide='ignore', invalid='ignore'):
        ratio = np.abs(np.diff(np.log(found.x)))
        smooth = np.abs(np.diff(np.log(found.x_without)))
    same = found.upwards[1:] == found.upwards[:-1]
    return (np.flatnonzero((ratio - smooth > math.log(_JUMP)) & same) + 1).tolist()


def swept_text(rig: RigParameters, found: SweptResponse) -> str:
    """Return the result in words."""
    level, unit = level_of(rig, found.level)
    low, high = (f'{value:.4g}' for value in (level.min(), level.max()))
    ends = found.frequency.min() / math.tau, found.frequency.max() / math.tau
    lines = [
        f'sweep       {len(found.time)} frequencies from {ends[0]:.4g} Hz to {ends[1]:.4g} Hz at '
        f'{low if low == high else f"{low} to {high}"} {unit}'
    ]
    for way, chosen in (('up', found.upwards), ('down', ~found.upwards)):
        if not chosen.any():
            continue
        places = np.flatnonzero(chosen)
        best = places[found.x[places].argmax()]
        lines.append(
            f'largest |X| {1e3 * found.x[best]:.4g} mm at {found.frequency[best] / math.tau:.4g} '
            f'Hz on the way {way}'
        )
    jumps = ', '.join(
        f'{found.frequency[k] / math.tau:.4g} Hz ({"up" if found.upwards[k] else "down"})'
        for k in _jumps(found)[:_MOST_JUMPS]
    )
    if jumps:
        lines.append(f'jumps       at {jumps}')
    best = int(found.x_without.argmax())
    lines.append(
        f'without damper {1e3 * found.x_without[best]:.4g} mm at '
        f'{found.frequency[best] / math.tau:.4g} Hz, settled'
    )
    return '\n'.join(lines)


def draw_response(axes: Any, found: SweptResponse, values: Array, alone: Array) -> None:
    """Draw largest values of a sweep over frequency, up and down, and without damper."""
    hertz = found.frequency / math.tau
    order = np.argsort(hertz)
    look = {'color': COLORS['quiet'], 'lw': 1.2, 'ls': '--', 'label': 'without damper'}
    axes.plot(hertz[order], alone[order], **look)
    for name, chosen, color, marker in (
        ('up', found.upwards, COLORS['primary'], '^'),
        ('down', ~found.upwards, COLORS['special'], 'v'),
    ):
        if not chosen.any():
            continue
        axes.plot(
            hertz[chosen],
            values[chosen],
            color=color,
            lw=1.2,
            marker=marker if chosen.sum() < _MOST_MARKERS else None,
            ms=3,
            label=f'with damper, {name}',
        )
    for number, k in enumerate(_jumps(found)):
        look = {'color': '0.2', 'lw': 2.6, 'alpha': 0.45, 'label': '' if number else 'jump'}
        axes.plot(hertz[k - 1 : k + 1], values[k - 1 : k + 1], **look)
    axes.set_yscale('log')
    place_log_ticks(axes.yaxis)


@print_style()
def swept_figure(rig: RigParameters, found: SweptResponse, title: str = '') -> Figure:
    """Draw the largest values over frequency, up and down, with and without damper."""
    hertz = found.frequency / math.tau
    panels = [
        (1e3 * found.x, 1e3 * found.x_without, 'largest |X| [mm]'),
        (1e3 * found.relative, 1e3 * found.relative_without, 'largest |X − b| [mm]'),
        (
            found.acceleration / STANDARD_GRAVITY,
            found.acceleration_without / STANDARD_GRAVITY,
            'largest |X″| [g]',
        ),
    ]
    if rig.swept == 'force':
        del panels[1]
    figure = blank_figure(6.3, 1.2 + 2.0 * len(panels), title)
    axes = figure.subplots(len(panels), 1, sharex=True)
    order = np.argsort(hertz)
    for panel, (values, alone, label), letter in zip(axes, panels, 'abc', strict=False):
        draw_response(panel, found, values, alone)
        finish_panel(panel, letter, 'Frequency [Hz]' if panel is axes[-1] else '', label)
    if rig.swept == 'base' and rig.base_quantity == 'acceleration':
        level, _ = level_of(rig, found.level)
        axes[-1].plot(hertz[order], level[order], color='0.2', lw=1.0, ls=':', label='base')
    axes[-1].legend(frameon=False, fontsize=7)
    axes[0].legend(frameon=False, fontsize=7)
    return figure
