"""Numbers, units and counts as readers see them: in a handy unit, with the digits they carry."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

_PREFIXES = ((1.0, ''), (1e3, 'm'), (1e6, 'µ'), (1e9, 'n'))
_MINUS = '\N{MINUS SIGN}'
_RAISED = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')
#: What is written otherwise in print than on a terminal: signs, powers, units, X' for a rate.
_PLUS_MINUS = re.compile(r'(?<!\S)\+/?-(?=[\s\d.])')
_NUMBER = re.compile(r'(?<![\w.)\]])([-+]?)(\d+(?:\.\d+)?)(e[-+]?\d+)?(?![\w])')
_POWER = re.compile(r'(?<=[a-z])\^(-?\d+)')
_MICRO = re.compile(r'(?<=\d )u(?=(?:s|m|N|J)\b)')
_JOINED = re.compile(r'(?<=N) (?=s\b)')
_RATE = re.compile(r"(?<=\b[XYZ])'(?!\w)")
#: What stands for a number that is not there.
NONE = '–'


class Unit(NamedTuple):
    """A unit in which some values are handy, and the factor from SI units to it."""

    factor: float
    name: str


def unit_for(name: str, *values: ArrayLike) -> Unit:
    """Return the unit in which values are handy numbers."""
    largest = 0.0
    for value in values:
        array = np.abs(np.asarray(value, dtype=float)).ravel()
        array = array[np.isfinite(array)]
        largest = max(largest, float(array.max(initial=0.0)))
    if largest == 0.0:
        return Unit(1.0, name)
    for factor, prefix in _PREFIXES:
        if largest * factor >= 0.5:
            return Unit(factor, prefix + name)
    return Unit(_PREFIXES[-1][0], _PREFIXES[-1][1] + name)


_MODES = {'SLIDE_DOWN': 'slide towards stop 1', 'SLIDE_UP': 'slide away from stop 1'}


def mode_words(mode: str) -> str:
    """Return the name of a mode in words that hold at any angle, on the level too."""
    return _MODES.get(mode, mode.lower().replace('_', ' '))


def setting(value: Any) -> str:
    """Return a value as it is written for a parameter: [1, 2], true, 0.5 or timed."""
    if isinstance(value, tuple | list):
        return f'[{", ".join(map(setting, value))}]'
    return f'{value:g}' if isinstance(value, float) else str(value).lower()


def _plain(text: str) -> str:
    """Return a number as it is printed: with a true minus, powers of ten raised."""
    mantissa, _, exponent = text.partition('e')
    if not mantissa.strip('-0.'):
        # What is zero as printed has no sign.
        mantissa = mantissa.replace('-', '')
    mantissa = mantissa.replace('-', _MINUS)
    if not exponent:
        return mantissa
    power = str(int(exponent)).translate(_RAISED)
    return f'{mantissa}\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10{power}'


def _printed_number(match: re.Match[str]) -> str:
    sign, size, exponent = match[1], match[2], match[3] or ''
    return ('+' if sign == '+' else '') + _plain(sign.replace('+', '') + size + exponent)


def worded(text: str) -> str:
    """Return a sentence with its numbers, units and signs typeset."""
    text = _PLUS_MINUS.sub('\N{PLUS-MINUS SIGN}', text)
    text = _MICRO.sub('\N{MICRO SIGN}', text)
    text = _NUMBER.sub(_printed_number, text)
    text = _POWER.sub(lambda match: match[1].translate(_RAISED), text)
    text = _JOINED.sub('\N{NO-BREAK SPACE}', text)
    return _RATE.sub('\N{PRIME}', text)


def number(value: float | None, digits: int = 6) -> str:
    """Return a number with significant digits, or a dash if there is none."""
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return '∞' if value > 0 else f'{_MINUS}∞'
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        mantissa, _, exponent = f'{value:.{digits - 1}e}'.partition('e')
        if '.' in mantissa:
            mantissa = mantissa.rstrip('0').rstrip('.')
        return _plain(f'{mantissa}e{exponent}')
    size = math.floor(math.log10(abs(value))) if value != 0.0 else 0
    text = f'{value:.{max(0, digits - 1 - size)}f}'
    return _plain(text.rstrip('0').rstrip('.') if '.' in text else text)


def quantity(value: float, name: str, digits: int = 6, like: float | None = None) -> str:
    """Return a value with a handy unit, or with that of another value like it."""
    unit = unit_for(name, value if like is None else like)
    return f'{number(unit.factor * value, digits)} {unit.name}'


def difference(value: float | None) -> str:
    """Return a difference with two digits and its sign."""
    if value is None or not math.isfinite(value):
        return NONE
    if value == 0.0:
        return '0'
    sign = '+' if value > 0 else ''
    return sign + number(value, 2)


def instant(value: float | None) -> str:
    """Return a time with a millisecond's precision."""
    if value is None or not math.isfinite(value):
        return NONE
    return _plain(f'{value:.3f}'.rstrip('0').rstrip('.'))


def power_of_ten(value: float) -> str:
    """Return a power of ten, for the axis of a plot."""
    exponent = round(math.log10(value)) if value > 0.0 else 0
    return f'10{str(exponent).translate(_RAISED)}' if abs(exponent) > 2 else number(value, 1)


def aligned(values: Sequence[float] | Iterable[float], digits: int = 6) -> list[str]:
    """Return numbers of one column, with the same number of decimals."""
    column = list(values)
    largest = max((abs(v) for v in column if math.isfinite(v)), default=0.0)
    if largest == 0.0 or not 1e-4 <= largest < 1e6:
        return [number(v, digits) for v in column]
    decimals = max(0, digits - 1 - math.floor(math.log10(largest)))
    return [_plain(f'{v:.{decimals}f}') if math.isfinite(v) else number(v, digits) for v in column]


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown, without an end of line after the last row."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)
