# SPDX-License-Identifier: Apache-2.0
"""The units in which people type quantities, and the reading of a number with one."""

from __future__ import annotations

import re
from math import pi, tau

#: 1 g as an acceleration, m/s^2.
STANDARD_GRAVITY = 9.80665
_LENGTHS = {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3, 'µm': 1e-6, 'um': 1e-6}
_SPEEDS = {'m/s': 1.0, 'cm/s': 1e-2, 'mm/s': 1e-3}
_ACCELERATIONS = {
    'm/s^2': 1.0,
    'm/s²': 1.0,
    'mm/s^2': 1e-3,
    'mm/s²': 1e-3,
    'g': STANDARD_GRAVITY,
}
#: Units of the motion of a base: the unit decides which quantity is meant.
_OF_BASE = 'm, m/s or m/s^2'
#: Units of a quantity by its SI unit, as factors to that.
UNITS: dict[str, dict[str, float]] = {
    'm': _LENGTHS,
    'm/s': _SPEEDS,
    's/m': {'s/m': 1.0, 's/mm': 1e3},
    'm/s^2': _ACCELERATIONS,
    _OF_BASE: {_OF_BASE: 1.0, **_LENGTHS, **_SPEEDS, **_ACCELERATIONS},
    'kg': {'kg': 1.0, 'g': 1e-3, 'mg': 1e-6, 't': 1e3},
    'N': {'N': 1.0, 'mN': 1e-3, 'kN': 1e3},
    'N/m': {'N/m': 1.0, 'kN/m': 1e3, 'N/mm': 1e3},
    'N s/m': {'N s/m': 1.0, 'Ns/m': 1.0, 'kg/s': 1.0},
    'rad': {'rad': 1.0, 'deg': pi / 180.0, '°': pi / 180.0},
    'rad/s': {'rad/s': 1.0, 'Hz': tau, 'kHz': 1e3 * tau, 'rpm': tau / 60.0},
    'Hz': {'Hz': 1.0, 'kHz': 1e3, 'rad/s': 1.0 / tau, 'rpm': 1.0 / 60.0},
    'octaves/min': {'octaves/min': 1.0, 'octave/min': 1.0, 'oct/min': 1.0},
    's': {'s': 1.0, 'ms': 1e-3, 'min': 60.0, 'h': 3600.0},
    'B': {'B': 1.0, 'kB': 1e3, 'MB': 1e6, 'GB': 1e9},
    '': {'': 1.0, '%': 1e-2},
}
#: Sizes that quantities have in most rigs, from the smallest one to the largest one, in SI.
USUAL: dict[str, tuple[float, float]] = {
    'm': (1e-4, 100.0),
    'm/s': (1e-3, 100.0),
    'm/s^2': (0.1, 25.0),
    'kg': (1e-3, 1e4),
    'N': (1e-3, 1e4),
    'N/m': (0.1, 1e7),
    'N s/m': (1e-3, 1e4),
    'rad': (0.0, tau),
    'rad/s': (0.1, 600.0),
    'Hz': (1.0, 1e4),
    's': (1e-3, 1e3),
}
_NUMBER = re.compile(r'([-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)(.*)', re.DOTALL)
#: 1,000 is 1 where the comma is a decimal sign, and 1000 where it separates thousands.
_AMBIGUOUS = re.compile(r'[-+]?[1-9]\d{0,2},\d{3}')


def in_si(number: float, factor: float) -> float:
    """Return a number of a unit in SI, rounded to 15 digits, as a person would type it."""
    return number if factor == 1.0 else float(f'{number * factor:.15g}')


def split_number(text: str) -> tuple[float | None, str, str]:
    """
    Return the number that a text begins with, what is behind it, and what to write instead.

    The number is None if there is none. A comma may be its decimal sign; where it may as well
    separate thousands, the last text says how to write either.
    """
    found = _NUMBER.fullmatch(text.strip().replace('−', '-').replace('\u202f', ' '))
    if found is None:
        return None, text, ''
    digits, point = found[1], found[1].replace(',', '.')
    ambiguous = _AMBIGUOUS.fullmatch(digits)
    other = f'{point} or {digits.replace(",", "")}' if ambiguous else ''
    return float(point), found[2].strip(), other


def si_value(text: str, unit: str) -> float:
    """Return a number in SI that may have a unit of its own, as 500ms; or raise ValueError."""
    number, own, other = split_number(text)
    if number is None or other or (own and own not in UNITS.get(unit, ())):
        return float(text)
    return in_si(number, UNITS[unit][own]) if own else number
