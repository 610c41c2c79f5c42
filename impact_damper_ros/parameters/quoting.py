# SPDX-License-Identifier: Apache-2.0
"""Values, counts and texts as messages quote them: short, without control characters."""

from __future__ import annotations

import difflib
import re
import reprlib
from array import array
from collections.abc import Collection
from typing import Any

_LONGEST = 80
_LONGEST_LINE = 2000
_LONGEST_WORD = 300
_LONG_WORD = re.compile(rf'\S{{{_LONGEST_WORD + 1},}}')
# Control characters but newline and tab; those that turn the direction of writing; halves of pairs
_UNPRINTABLE = re.compile('[\0-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]')


class _Short(reprlib.Repr):
    """Shortened `repr` of lists and mappings, which may contain one another many times."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlist = self.maxtuple = self.maxset = self.maxdict = 20
        self.maxstring = self.maxother = self.maxlong = _LONGEST
        self.maxlevel = 3

    def repr1(self, x: Any, level: int) -> str:
        return self.repr_dict(x, level) if isinstance(x, dict) else super().repr1(x, level)


_SHORT = _Short()


def printable(text: str) -> str:
    r"""
    Return a text with escapes in place of characters that a terminal would act on.

    Examples
    --------
    >>> printable('a\x1b[31mb')
    'a\\x1b[31mb'
    """
    return _UNPRINTABLE.sub(lambda match: ascii(match[0])[1:-1], text)


def as_message(text: str) -> str:
    """
    Return a message as `printable`, its long words, such as names of files, cut in the middle.

    Examples
    --------
    >>> as_message(f'no file {1000 * "x"}').count('x')
    223
    """
    return printable(_LONG_WORD.sub(lambda match: as_name(match[0], _LONGEST_WORD), text))


def as_line(text: str) -> str:
    r"""
    Return a text that may hold anything as one printable line of bounded length.

    Examples
    --------
    >>> as_line('two\nlines')
    'two\\nlines'
    """
    if len(text) > _LONGEST_LINE:
        text = f'{text[:_LONGEST_LINE]}...'
    return printable(text).replace('\n', '\\n').replace('\t', '\\t')


def quote(value: object, longest: int = _LONGEST) -> str:
    """
    Return a value as `repr` has it, on one line; a long one is cut in the middle.

    Examples
    --------
    >>> quote('a' * 1000, 20)
    "'aaaaaaaaa ... (1002 characters) ... aaaa'"
    """
    if isinstance(value, array):
        # As rclpy has an array of numbers
        value = value.tolist()
    if isinstance(value, str) and len(value) > 8 * longest:
        # Without a copy of all of it
        text, count = repr(value[: 4 * longest] + value[-4 * longest :]), len(value) + 2
    else:
        try:
            text = (_SHORT.repr if isinstance(value, list | tuple | dict) else repr)(value)
        except ValueError:
            text = f'{type(value).__name__} of too many digits'
        count = len(text)
    text = printable(text).replace('\n', '\\n').replace('\t', '\\t')
    if count <= longest:
        return text
    return f'{text[: longest // 2]} ... ({count} characters) ... {text[-(longest // 4) :]}'


def as_name(name: object, longest: int = _LONGEST) -> str:
    r"""
    Return a name or another text as `quote` does, without quotes.

    Examples
    --------
    >>> as_name('gap'), as_name('two\nlines')
    ('gap', 'two\\nlines')
    """
    return quote(str(name), longest)[1:-1]


def plural(count: int, noun: str, form: str = '') -> str:
    """
    Return a count, formatted as `form` says, with its noun in singular or plural.

    Examples
    --------
    >>> plural(1, 'stretch'), plural(2, 'stretch'), plural(1000, 'message', ',')
    ('1 stretch', '2 stretches', '1,000 messages')
    """
    ending = '' if count == 1 else 'es' if noun.endswith(('ch', 's')) else 's'
    return f'{count:{form}} {noun}{ending}'


def setting(value: Any, digits: int = 6) -> str:
    """
    Return a value as it is written for a parameter.

    Examples
    --------
    >>> setting((1.0, True, 'timed')), setting(0.0123456789, 3)
    ('[1, true, timed]', '0.0123')
    """
    if isinstance(value, tuple | list):
        return f'[{", ".join(setting(one, digits) for one in value)}]'
    return f'{value:.{digits}g}' if isinstance(value, float) else str(value).lower()


def similar_names(name: object, names: Collection[str], cutoff: float = 0.6) -> str:
    """
    Return the known name that is most similar, or all numbered ones of that name; or nothing.

    Examples
    --------
    >>> known = ['gap', 'restitution_1', 'restitution_2']
    >>> similar_names('gab', known), similar_names('restitution', known), similar_names('x', known)
    ('gap', 'restitution_1 and restitution_2', '')
    """
    text = str(name)[:_LONGEST]
    numbered = [known for known in names if re.fullmatch(rf'{re.escape(text)}_\d+', known)]
    return ' and '.join(numbered or difflib.get_close_matches(text, names, 1, cutoff))
