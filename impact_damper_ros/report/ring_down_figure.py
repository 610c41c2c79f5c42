# SPDX-License-Identifier: Apache-2.0
"""The figure, the table and the text of a ring-down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.orbits.ring_down import RingDown
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .csv_tables import csv_text
from .drawing import COLORS, blank_figure, finish_panel, print_style, unit_axis
from .formatting import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_COLUMNS = ('release', 'time', 'velocity', 'amplitude', 'acceleration_g', 'loss', 'zeta')


def ring_down_csv(found: RingDown) -> str:
    """Return the cycles of all releases as CSV."""
    omega, cycles = found.parameters.omega, []
    for release, run in enumerate(found.runs):
        size = run.velocity[:-1] / omega
        columns = (run.time[:-1], run.velocity[:-1], size, size * omega**2 / STANDARD_GRAVITY)
        cycles.append([np.full(len(size), release), *columns, run.loss, run.zeta])
    return csv_text(dict(zip(_COLUMNS, np.hstack(cycles), strict=True)))


def percent_of_loss(loss: float) -> float:
    """Return the damping ratio, %, with which a cycle loses a share of its energy."""
    return -100.0 * math.log1p(-loss) / (2.0 * math.tau) if loss < 1.0 else math.inf


def _loss_words(loss: float) -> str:
    return f'Ψ {loss:.3f} of the energy in a cycle = damping ratio {percent_of_loss(loss):.2f} %'


def ring_down_text(found: RingDown) -> str:
    """Return the result in words."""
    curve = found.curve()
    size = quantity(found.amplitude, 'm', 4)
    lines = [
        f'{len(found.loss)} cycles of {len(found.runs)} releases, from {size} down',
        f'dashpot alone: {_loss_words(found.dashpot_loss)}',
    ]
    if len(curve['median']):
        best = int(np.argmax(curve['median']))
        place = quantity(float(curve['amplitude'][best]), 'm', 4)
        lines.append(
            f'largest loss, median: {_loss_words(float(curve["median"][best]))} at an amplitude '
            f'of {place} ({curve["acceleration"][best]:.3g} g)'
        )
    if found.bound < 1.0:
        lines.append(f'two impacts per cycle at X = 0 would take Ψ {found.bound:.3f}')
    return '\n'.join(lines)


def draw_decay(axes: Any, found: RingDown) -> None:
    """Draw the amplitude of each release over time, and that with the dashpot alone."""
    omega, start = found.parameters.omega, min(run.time[0] for run in found.runs)
    one = {'lw': 1.2} if len(found.runs) == 1 else {'lw': 0.5, 'alpha': 0.5}
    for run in found.runs:
        axes.plot(run.time, run.velocity / omega, color=COLORS['primary'], **one)
    times = np.linspace(start, max(run.time[-1] for run in found.runs), 200)
    alone = found.amplitude * np.exp(-found.parameters.zeta * omega * (times - start))
    axes.plot(times, alone, color=COLORS['quiet'], lw=1.0, ls='--', label='dashpot alone')
    axes.set_ylim(0.0, 1.05 * found.amplitude)


def draw_loss(axes: Any, found: RingDown) -> None:
    """Draw the loss of each cycle over its amplitude, with median, dashpot and bound."""
    curve, many = found.curve(), len(found.runs) > 1
    dots = {'ms': 2, 'alpha': 0.25} if many else {'ms': 4, 'label': 'each cycle'}
    axes.plot(found.amplitudes, found.loss, '.', color=COLORS['primary'], **dots)
    if many:
        band = {'color': COLORS['damper'], 'alpha': 0.25, 'lw': 0}
        axes.fill_between(curve['amplitude'], curve['low'], curve['high'], **band)
        middle = {'color': COLORS['damper'], 'lw': 1.4, 'label': 'median'}
        axes.plot(curve['amplitude'], curve['median'], **middle)
    axes.axhline(found.dashpot_loss, color=COLORS['quiet'], lw=1.0, ls='--', label='dashpot alone')
    if found.bound < 1.0:
        text = 'two impacts per cycle at X = 0'
        axes.axhline(found.bound, color=COLORS['special'], lw=1.0, ls=':', label=text)
    axes.set_xscale('log')
    lowest = min(0.0, 1.1 * float(curve['low'].min()))
    axes.set_ylim(lowest, max(1.1 * float(found.loss.max()), 1.2 * found.dashpot_loss))


@print_style()
def ring_down_figure(found: RingDown, title: str = '') -> Figure:
    """Draw the decay of each release, and the loss of a cycle over amplitude."""
    figure = blank_figure(6.3, 5.6, title)
    decay, loss = figure.subplots(2, 1)
    draw_decay(decay, found)
    decay.legend(frameon=False)
    finish_panel(decay, 'a', 'Time [s]', '')
    unit_axis(decay.yaxis, 'Amplitude of M', 'm', found.amplitude)
    draw_loss(loss, found)
    loss.legend(frameon=False)
    finish_panel(loss, 'b', '', 'Loss of a cycle, Ψ = 1 − E₊/E')
    unit_axis(loss.xaxis, 'Amplitude of M', 'm', found.amplitude)
    to_g = found.parameters.omega**2 / STANDARD_GRAVITY
    above = loss.secondary_xaxis('top', functions=(lambda x: x * to_g, lambda g: g / to_g))
    above.set_xlabel('Amplitude of the acceleration of M [g]')
    above.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    return figure
