# SPDX-License-Identifier: Apache-2.0
"""Pictures of a fit: data over motion, residuals, intervals, correlations, flights, damping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.fit.estimate import Estimate
from impact_damper_ros.fit.measured_motion import MeasuredMotion
from impact_damper_ros.fit.rig_fit import RigFit
from impact_damper_ros.fit.structure import StructureFit

from .drawing import COLORS, IMPACTS, unit_axis
from .picture import NARROW, WIDE, Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

UNITS = {'displacement': 'm', 'velocity': 'm/s', 'acceleration': 'm/s^2'}
_LABELS = {'displacement': 'X', 'velocity': "X'", 'acceleration': "X''"}
#: Most samples that are drawn; of more samples every second or third.
_MOST_DRAWN = 6000


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')


def _motion_picture(
    data: MeasuredMotion, fitted: Array, residuals: Array, deviation: float, impacts: Any
) -> Picture:
    """Draw data over the fitted motion, and below it the residuals over the noise."""
    figure = _figure(WIDE, 4.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.4))
    part = slice(None, None, 1 + len(data.time) // _MOST_DRAWN)
    time, measured = data.time[part], np.where(data.used, data.motion, np.nan)[part]
    above.plot(
        *(time, measured, '.'), ms=2.5, color=COLORS['primary'], label='measured', rasterized=True
    )
    above.plot(data.time, fitted, color=COLORS['theory'], lw=0.9, label='fitted')
    for stop, look in IMPACTS.items():
        if impacts is not None and len(hits := impacts[impacts['stop'] == stop]):
            places = np.interp(hits['time'], data.time, np.nan_to_num(fitted))
            above.plot(
                hits['time'], places, ls='none', ms=4.0, label=f'impact on stop {stop}', **look
            )
    unit_axis(above.yaxis, _LABELS[data.quantity], UNITS[data.quantity], np.abs(measured))
    above.legend(loc='lower right', ncols=4)
    below.axhspan(-2.0, 2.0, color=COLORS['grid'], lw=0)
    relative = residuals / deviation if deviation > 0.0 else residuals
    below.plot(time, relative[part], '.', ms=2.0, color=COLORS['primary'], rasterized=True)
    below.set_ylabel('residual / noise')
    below.set_xlabel('time [s]')
    finite = relative[np.isfinite(relative)]
    if len(finite):
        below.set_ylim(*(np.array([-1.0, 1.0]) * max(4.0, 1.05 * np.abs(finite).max())))
    return Picture(
        figure,
        'Data and model',
        'Above the measured samples and the fitted motion, below their difference over the '
        'standard deviation of the noise; 95 % of white noise is within the band.',
    )


def _histogram(residuals: Array, deviation: float) -> Picture | None:
    """Draw the distribution of the residuals, and that of normal noise."""
    relative = residuals[np.isfinite(residuals)] / (deviation or 1.0)
    if len(relative) < 50:
        return None
    figure = _figure(NARROW, 3.2)
    axes = figure.subplots()
    bins = np.linspace(-5.0, 5.0, 41).tolist()
    axes.hist(np.clip(relative, -5.0, 5.0), bins, density=True, color=COLORS['primary'], alpha=0.6)
    places = np.linspace(-5.0, 5.0, 201)
    axes.plot(
        places, np.exp(-0.5 * places**2) / np.sqrt(2.0 * np.pi), color=COLORS['theory'], lw=1.2
    )
    axes.set_xlabel('residual / noise')
    axes.set_ylabel('density')
    return Picture(
        figure,
        'Residuals',
        'Bars: the residuals; line: normal noise of the same size.',
    )


def _intervals(parameters: dict[str, Estimate]) -> Picture:
    """Draw each parameter with its interval, relative to its value."""
    names = [n for n, one in parameters.items() if one.value != 0.0]
    figure = _figure(NARROW, max(2.2, 0.8 + 0.34 * len(names)))
    axes = figure.subplots()
    for k, name in enumerate(reversed(names)):
        one = parameters[name]
        low, high = sorted(100.0 * (end / one.value - 1.0) for end in one.interval)
        axes.plot([low, high], [k, k], color=COLORS['damper'], lw=2.4, solid_capstyle='butt')
        axes.plot([0.0], [k], 'o', ms=4.0, color=COLORS['theory'])
    axes.axvline(0.0, color=COLORS['quiet'], lw=0.7)
    axes.set_yticks(range(len(names)), reversed(names))
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xscale('symlog', linthresh=1.0)
    axes.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.set_xlabel('95 % interval, relative to the value [%]')
    return Picture(
        figure,
        'Intervals',
        'Interval of each parameter; the axis is linear between −1 and 1 %.',
    )


def _correlations(found: RigFit, names: Sequence[str]) -> Picture:
    """Draw the correlations of some parameters as a matrix."""
    matrix = np.array([[found.correlations[a][b] for b in names] for a in names])
    figure = _figure(NARROW, 0.9 + 0.42 * len(names))
    axes = figure.subplots()
    axes.imshow(matrix, cmap='RdBu_r', vmin=-1.0, vmax=1.0)
    for i in range(len(names)):
        for j in range(len(names)):
            strong = abs(matrix[i, j]) > 0.6
            axes.text(
                *(j, i, f'{matrix[i, j]:.2f}'.replace('-', '−')),
                ha='center',
                va='center',
                fontsize=7.5,
                color='#ffffff' if strong else '#1b1b1b',
            )
    axes.set_xticks(range(len(names)), names, rotation=40, ha='right')
    axes.set_yticks(range(len(names)), names)
    axes.grid(visible=False)
    return Picture(
        figure,
        'Correlations',
        'Near 1 or −1, the data hardly distinguish the two parameters.',
    )


def _flights(found: RigFit) -> Picture | None:
    """Draw the residual of each flight over the speed of the impact that begins it."""
    if not found.flights:
        return None
    speeds = np.asarray(found.impacts['speed'], float)[: len(found.flights)]
    size = np.array([flight.residual for flight in found.flights])
    used = np.array([flight.used for flight in found.flights])
    figure = _figure(NARROW, 3.2)
    axes = figure.subplots()
    axes.axhline(1.0, color=COLORS['quiet'], lw=0.7)
    for mask, color, label in (
        (used, COLORS['primary'], 'used'),
        (~used, COLORS['special'], 'not used'),
    ):
        if mask.any():
            axes.plot(speeds[mask], size[mask], '.', ms=5.0, color=color, label=label)
    axes.set_xlabel('speed of the impact [m/s]')
    axes.set_ylabel('residual of the flight / noise')
    axes.set_ylim(bottom=0.0)
    axes.legend()
    return Picture(
        figure,
        'Flights',
        'Residuals that grow with the speed of impact show a restitution that depends on it.',
    )


def rig_pictures(found: RigFit, data: MeasuredMotion, names: Sequence[str]) -> list[Picture]:
    """Return the pictures of a fit of a rig; `names` are those of independent parameters."""
    if not found.parameters:
        return []
    pictures = [
        _motion_picture(data, found.motion, found.residuals, found.deviation, found.impacts),
        _intervals(found.parameters),
        _correlations(found, names),
        _histogram(found.residuals, found.deviation),
        _flights(found),
    ]
    return [picture for picture in pictures if picture is not None]


def structure_pictures(found: StructureFit) -> list[Picture]:
    """Return the pictures of a fit of a structure."""
    data = found.data
    residuals = np.where(data.used, data.motion - found.fitted, np.nan)
    pictures = [_motion_picture(data, found.fitted, residuals, found.noise, None)]
    if len(found.parts) > 1:
        pictures.append(_over_amplitude(found))
    histogram = _histogram(residuals, found.noise)
    return pictures if histogram is None else [*pictures, histogram]


def _over_amplitude(found: StructureFit) -> Picture:
    """Draw damping ratio and frequency of parts of the ring-down over their amplitude."""
    size = np.array([part.amplitude for part in found.parts])
    figure = _figure(NARROW, 4.4)
    above, below = figure.subplots(2, 1, sharex=True)
    for axes, name, factor, label, whole in (
        (above, 'damping', 100.0, 'damping ratio [%]', found.damping_ratio),
        (below, 'frequency', 1.0, 'frequency [Hz]', found.frequency),
    ):
        field = 'damping_ratio' if name == 'damping' else name
        values = factor * np.array([getattr(part, field) for part in found.parts])
        bars = 1.96 * factor * np.array([getattr(p, f'{name}_deviation') for p in found.parts])
        axes.errorbar(size, values, bars, fmt='o', ms=4.0, color=COLORS['primary'], lw=1.1)
        axes.axhline(factor * whole.value, color=COLORS['theory'], lw=1.0)
        axes.set_ylabel(label)
    below.set_xscale('log')
    unit_axis(below.xaxis, 'Amplitude', UNITS[found.data.quantity], size)
    return Picture(
        figure,
        'Over the amplitude',
        'Each part of the record alone, with 95 % intervals; the line is the whole record. A '
        'linear structure with viscous damping has both constant.',
    )
