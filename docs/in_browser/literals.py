# SPDX-License-Identifier: Apache-2.0
"""Numbers, texts and names as JavaScript writes them."""

from __future__ import annotations

import math

#: Words of JavaScript that are names in Python.
RESERVED = {
    *(
        'arguments',
        'case',
        'const',
        'default',
        'delete',
        'do',
        'enum',
        'eval',
        'export',
        'extends',
    ),
    *('function', 'instanceof', 'interface', 'let', 'new', 'null', 'package', 'private', 'public'),
    *('static', 'super', 'switch', 'this', 'throw', 'typeof', 'var', 'void', 'catch', 'protected'),
}
#: Largest whole number that a float has with all before it.
EXACT = 2**53


class TranslationError(Exception):
    """A construct, a name or a constant that has no translation."""


def number(value: float) -> str:
    """Return a number as JavaScript writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return f'{int(value)}n' if abs(value) > EXACT and not is_power(value) else str(int(value))
    if math.isnan(value):
        return 'NaN'
    return ('-' if value < 0 else '') + 'Infinity' if math.isinf(value) else repr(float(value))


def quoted(text: str) -> str:
    """Return a text as JavaScript writes it."""
    escaped = text.replace('\\', '\\\\').replace("'", "\\'").replace('\n', '\\n')
    return f"'{escaped}'".replace('\u2028', '\\u2028').replace('\u2029', '\\u2029')


def local(name: str) -> str:
    """Return a local name."""
    return f'{name}_' if name in RESERVED else name


def is_power(value: int) -> bool:
    """Return whether a whole number is a power of two that bounds a count: a float has it."""
    return value in (2**62,)
