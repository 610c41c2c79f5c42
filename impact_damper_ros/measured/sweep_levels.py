# SPDX-License-Identifier: Apache-2.0
"""The level of a sweep over frequency, from a table: where it is notched."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.parameters.base_motion import quantity_of

from .sheet import FREQUENCY, Quantity
from .table import read_measured_table

_LEVEL = Quantity(
    (
        *('level', 'amplitude', 'force', 'acceleration', 'velocity', 'displacement'),
        *('base', 'pegel', 'beschleunigung', 'kraft'),
    ),
    ('m/s^2', 'm/s', 'm', 'N'),
)
#: Width of a step, in parts of its frequency.
_STEP = 1e-6


def sweep_levels(path: Path) -> tuple[dict[str, Any], str]:
    """Return amplitude and notches of a sweep from a table, of base or force, and its columns."""
    table = read_measured_table(path, {'frequency': FREQUENCY, 'level': _LEVEL})
    table.check_rising('frequency', steps=True)
    for key in ('frequency', 'level'):
        table.check_finite(key)
        table.check_positive(key)
    hertz, levels = (table.columns[key].values for key in ('frequency', 'level'))
    # A step, where a frequency is there twice, is one of this width
    hertz = np.where(np.diff(hertz, prepend=0.0) == 0.0, hertz * (1.0 + _STEP), hertz)
    greatest = float(levels.max())
    notches = {
        'sweep_notch_frequencies': tuple(math.tau * float(f) for f in hertz),
        'sweep_notch_factors': tuple(float(level) / greatest for level in levels),
    }
    unit = table.columns['level'].unit
    if unit == 'N':
        return {'force_amplitudes': (greatest,), **notches}, table.described
    base = {'base_amplitudes': (greatest,), 'base_quantity': quantity_of(unit)}
    return base | notches, table.described
