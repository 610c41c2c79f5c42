# SPDX-License-Identifier: Apache-2.0
"""Numbers and units for readers: in a handy unit, with their significant digits."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

_PREFIXES = ((1.0, ''), (1e3, 'm'), (1e6, 'µ'), (1e9, 'n'))
_MINUS = '\N{MINUS SIGN}'
#: Sign of a missing number.
NONE = '–'


class Unit(NamedTuple):
    """A unit in which some values are handy, and the factor from SI units to it."""

    factor: float
    name: str


def unit_for(name: str, *values: ArrayLike) -> Unit:
    """Return the unit in which values are handy numbers."""
    sizes = np.concatenate([np.abs(np.asarray(v, float)).ravel() for v in (0.0, *values)])
    largest = float(sizes[np.isfinite(sizes)].max())
    if largest == 0.0:
        return Unit(1.0, name)
    handy = [(factor, prefix) for factor, prefix in _PREFIXES if largest * factor >= 0.5]
    factor, prefix = (handy or [_PREFIXES[-1]])[0]
    return Unit(factor, prefix + name)


_MODES = {'SLIDE_DOWN': 'slide towards stop 1', 'SLIDE_UP': 'slide away from stop 1'}


def mode_words(mode: str) -> str:
    """Return the name of a mode in words that are right at any angle."""
    return _MODES.get(mode, mode.lower().replace('_', ' '))


def number(value: float | None, digits: int = 6) -> str:
    """Return a number with significant digits, or a dash if there is none."""
    if value is None or math.isnan(value):
        return NONE
    # A number that is printed as zero has no sign.
    return f'{value + 0.0:.{digits}g}'.replace('-', _MINUS).replace('inf', '∞')


def numbers(values: Iterable[float], digits: int = 6) -> list[str]:
    """Return the cells of a column of numbers."""
    return [number(value, digits) for value in values]


def quantity(value: float, name: str, digits: int = 6, like: float | None = None) -> str:
    """Return a value with a handy unit, or with that of another value like it."""
    unit = unit_for(name, value if like is None else like)
    return f'{number(unit.factor * value, digits)} {unit.name}'


def percent(value: float, digits: int = 3) -> str:
    """Return a share in per cent."""
    return f'{100.0 * value:.{digits}g} %'


def instant(value: float | None) -> str:
    """Return a time with a millisecond's precision."""
    if value is None or not math.isfinite(value):
        return NONE
    return number(round(value, 3), 12)
