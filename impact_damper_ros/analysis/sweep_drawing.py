"""What the figures of a sweep share: axes with units, the grid of a map, names of motions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .sweep_axes import Axis
from .sweep_columns import MEASURES
from .sweep_optimum import Nearby
from .sweep_table import SweepTable

__all__ = [
    'axis_label',
    'edges',
    'fixed_text',
    'grid_of',
    'measure_label',
    'set_axis',
    'times',
]

Array = NDArray[np.float64]

_SYMBOLS = {
    'angle': 'Angle θ',
    'damper_mass': 'Damper mass m',
    'damping': 'Damping C',
    'force_amplitudes': 'Force amplitude F',
    'force_frequencies': 'Frequency of the force Ω',
    'friction': 'Friction coefficient γ',
    'gap': 'Gap d',
    'gravity': 'Gravitational acceleration g',
    'initial_damper_offset': 'Initial offset Y',
    'initial_damper_velocity': "Initial velocity of m, Z'",
    'initial_primary_position': 'Initial displacement X',
    'initial_primary_velocity': "Initial velocity X'",
    'primary_mass': 'Primary mass M',
    'restitution_1': 'Restitution R₁',
    'restitution_2': 'Restitution R₂',
    'stiffness': 'Stiffness K',
}
_MEASURES = {
    'chatter_share': 'Share of time in chatter',
    'impacts': 'Impacts in a period, N',
    'impacts_per_cycle': 'Impacts per cycle',
    'largest_multiplier': 'Largest multiplier, modulus',
    'lyapunov_exponent': 'Largest Lyapunov exponent [1/s]',
    'lyapunov_uncertainty': 'Uncertainty of the Lyapunov exponent [1/s]',
    'period': 'Period, cycles of the force',
    'rest_share': 'Share of time at rest on a stop',
    'stick_share': 'Share of time sticking',
    'x_max': 'Largest |X| [m]',
    'x_max_ratio': 'Largest |X| / A',
    'x_mean': 'Mean X [m]',
    'x_rms': 'RMS of X [m]',
}


def axis_label(axis: Axis) -> str:
    """Return what stands at an axis: what is varied, with its unit."""
    names = [
        _SYMBOLS.get(t.name, t.name.replace('_', ' ').capitalize())
        + (f' [{t.index + 1}]' if t.index is not None else '')
        for t in axis.targets
    ]
    first = names[0] + ''.join(f' = {name.rsplit(" ", 1)[-1]}' for name in names[1:])
    unit = axis.targets[0].spec.unit
    return f'{first} [{unit}]' if unit else first


def measure_label(name: str) -> str:
    """Return what stands at a measure, with its unit."""
    return _MEASURES.get(name, MEASURES[name].label)


def times(nearby: Nearby) -> str:
    """Return how much more or less a motion next to the optimum is, for a legend."""
    ratio = f'× {nearby.ratio:.3g}, ' if 0.0 < nearby.ratio < math.inf else ''
    return f' ({ratio}{nearby.motion})'


def set_axis(axes: Any, side: str, axis: Axis) -> None:
    """Label the x or y axis of a panel, and scale it as the sweep does."""
    getattr(axes, f'set_{side}label')(axis_label(axis))
    if axis.logarithmic:
        getattr(axes, f'set_{side}scale')('log')


def edges(axis: Axis) -> Array:
    """Return the edges of the cells whose middles are the values of an axis."""
    values = np.array(axis.values, dtype=float)
    if len(values) == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    if axis.logarithmic:
        values = np.log(values)
    middles = 0.5 * (values[1:] + values[:-1])
    ends = np.concatenate(
        [[1.5 * values[0] - 0.5 * values[1]], middles, [1.5 * values[-1] - 0.5 * values[-2]]]
    )
    return np.exp(ends) if axis.logarithmic else ends


def grid_of(table: SweepTable, column: Array) -> list[tuple[str, Array]]:
    """Return a column as a grid over the axes, for each direction that was followed."""
    plan = table.plan
    grids = column.reshape(len(plan.follow.passes), *plan.shape)
    return list(zip(plan.follow.passes, grids, strict=True))


def fixed_text(table: SweepTable) -> str:
    """Return the rig, but for what is varied, in a line or two for below a figure."""
    rig = table.plan.parameters
    varied = {target.name for axis in table.plan.axes for target in axis.targets}
    shown = [
        ('M', 'primary_mass', 'kg'),
        ('K', 'stiffness', 'N/m'),
        ('C', 'damping', 'N s/m'),
        ('m', 'damper_mass', 'kg'),
        ('d', 'gap', 'm'),
        ('R₁', 'restitution_1', ''),
        ('R₂', 'restitution_2', ''),
        ('θ', 'angle', 'rad'),
        ('γ', 'friction', ''),
        ('g', 'gravity', 'm/s²'),
        ('p', 'air_force', 'N'),
    ]
    level = rig.angle == 0.0 and rig.friction == 0.0 and not varied & {'angle', 'friction'}
    left_out = {'gravity'} if level else set()
    if rig.air_force == 0.0:
        left_out.add('air_force')
    parts = [
        f'{symbol} = {getattr(rig, name):.6g} {unit}'.rstrip()
        for symbol, name, unit in shown
        if name not in varied | left_out
    ]
    for symbol, name, unit in (
        ('F', 'force_amplitudes', 'N'),
        ('Ω', 'force_frequencies', 'rad/s'),
    ):
        if name not in varied:
            values = ', '.join(f'{value:.6g}' for value in getattr(rig, name)[:4])
            parts.append(f'{symbol} = {values} {unit}')
    if rig.multisine_level:
        parts.append(f'multisine of {rig.multisine_level:.6g} N rms')
    if rig.one_sided:
        parts.append('stop 1 only')
    if table.plan.control.active:
        parts.append(f'gap control: {table.plan.control.gap_control}')
    half = (len(parts) + 1) // 2
    return ',  '.join(parts[:half]) + '\n' + ',  '.join(parts[half:])
