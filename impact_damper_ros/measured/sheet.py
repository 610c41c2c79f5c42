# SPDX-License-Identifier: Apache-2.0
"""Columns of a file as they are in it: headings, units and the reader of their numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import quote

from .units import SHOWN, si_unit_of

Array = NDArray[np.float64]

#: Longest header that is examined.
_LONGEST_TITLE = 200
#: A unit behind a name without brackets: time / s, t in s, x_mm.
_BESIDE = re.compile(r'(.+?)(?:\s*[/,]\s*|\s+in\s+|[\s_]+)([^\s_]+)')


class TableError(ValueError):
    """A file of measured data that cannot be used; the text names column, line and remedy."""


class ColumnError(TableError):
    """No column, or more than one, for a quantity (`key`)."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(problem)
        self.key = key


class Quantity(NamedTuple):
    """A column that is looked for, by a word of its header and the SI units that it may have."""

    #: In lower case; the first one is that of messages.
    names: tuple[str, ...]
    units: tuple[str, ...]
    #: The column may stand without a unit, and then has the first one.
    bare: bool = False
    #: The column may have another name if it is the only one of its unit.
    by_unit: bool = True


TIME = Quantity(
    ('time', 't', 'zeit', 'timestamp', 'epoch', 'epoc', 'elapsed', 'uhrzeit', 'datetime'), ('s',)
)
FREQUENCY = Quantity(('frequency', 'f', 'freq', 'frequenz'), ('Hz',))
FORCE = Quantity(('force', 'kraft', 'load', 'f'), ('N',))
ACCELERATION = Quantity(('acceleration', 'accel', 'acc', 'a', 'beschleunigung'), ('m/s^2',))
DISPLACEMENT = Quantity(('displacement', 'x', 'position', 'weg', 'disp'), ('m',))
VELOCITY = Quantity(('velocity', 'v', 'vel', 'geschwindigkeit'), ('m/s',))
BASE = Quantity(
    (
        *('base', 'table', 'b', 'shaker', 'excitation', 'input', 'ground', 'drive'),
        *('basis', 'fußpunkt', 'tisch', 'anregung', 'erregung'),
    ),
    ('m/s^2', 'm/s', 'm'),
    by_unit=False,
)
#: A pulse, or a level, that is high during an impact.
IMPACT = Quantity(
    ('impact', 'impacts', 'hit', 'hits', 'contact', 'trigger', 'stoß', 'aufprall'),
    ('', 'V'),
    bare=True,
    by_unit=False,
)
#: Instants of impacts in a file of their own.
INSTANT = TIME._replace(bare=True)
LEVEL = Quantity(('level', 'psd', 'asd', 'density', 's', 'g'), ('(m/s^2)^2/Hz', 'N^2/Hz'))


class Heading(NamedTuple):
    """The header of a column: as it is in the file, its name, its unit, and that in SI."""

    title: str
    name: str
    unit: str | None
    si: tuple[str, float] | None

    def has_word_of(self, quantity: Quantity) -> bool:
        """Return whether the name has a word of a quantity; a letter has to be the first one."""
        words = re.findall(r'[^\W\d_]+', self.name.casefold())
        return any(word in quantity.names for word in words if len(word) > 1) or (
            bool(words) and words[0] in quantity.names
        )


def heading(title: str, unit: str | None = None) -> Heading:
    """Return name and unit of a header: x [mm], Time (s) Run #1, Latest: x (m), t / s, x_mm."""
    title = title.strip()
    if unit:
        return Heading(f'{title} [{unit}]', title, unit, si_unit_of(unit))
    text = re.sub(r'^[^:\[(]*:\s+', '', title[:_LONGEST_TITLE])
    start = min((text.find(mark) for mark in '[(' if mark in text), default=-1)
    end = max(text.rfind(mark) for mark in '])')
    if 0 <= start < end:
        # The outermost brackets, as of ((m/s2)2/Hz), or the last ones that are a unit
        inner = [*re.finditer(r'[\[(][^\[\]()]*[\])]', text)]
        spans = [(start, end), *((m.start(), m.end() - 1) for m in reversed(inner))]
        for begin, last in spans:
            if text[begin + 1 : last].strip() and si_unit_of(text[begin + 1 : last]):
                start, end = begin, last
                break
        own = text[start + 1 : end].strip()
        name = ' '.join(f'{text[:start]} {text[end + 1 :]}'.split())
        return Heading(title, name, own, si_unit_of(own))
    words = text.split('_' if '_' in text else None)
    # A time may be called by its unit alone
    if words and len(words[0]) > 1 and (si_unit_of(words[0]) or ('',))[0] == 's':
        text, unit = ' '.join(words[1:]) or 'time', words[0].casefold()
        return Heading(title, text, unit, si_unit_of(unit))
    beside = _BESIDE.fullmatch(text)
    si = si_unit_of(beside[2], any_case=False) if beside else None
    if beside and si:
        return Heading(title, beside[1], beside[2], si)
    return Heading(title, text, None, None)


class Sheet(NamedTuple):
    """The columns of a file, and the reader of their numbers."""

    source: str
    headings: list[Heading]
    #: Numbers of some columns as they are in the file, NaN where one is missing, and the line of
    #: each row; a date or a time of day is in seconds.
    read: Callable[[Sequence[int]], tuple[list[Array], NDArray[np.int64]]]
    #: Cells of the first row, of a file that is text.
    first: list[str]

    def titles(self, without: Collection[int] = ()) -> str:
        """Return the headers of all columns but some."""
        left = [h.title for n, h in enumerate(self.headings) if n not in without]
        return ', '.join(map(quote, left[:20])) + (' ...' if len(left) > 20 else '')

    def columns_text(self, places: Mapping[str, int]) -> str:
        """Return which columns are used, and which are not."""
        named = [key for key in places if not key.startswith('time of ')]
        order = sorted(named, key=lambda key: key != 'time')
        used = ', '.join(f'{key} {quote(self.headings[places[key]].title)}' for key in order)
        left = self.titles(places.values())
        return f'reads {used}{f"; not used: {left}" if left else ""}'


def array_sheet(source: str, columns: Sequence[tuple[Heading, Array]]) -> Sheet:
    """Return columns that are arrays already."""
    rows = min(len(numbers) for _, numbers in columns)

    def read(places: Sequence[int]) -> tuple[list[Array], NDArray[np.int64]]:
        return [columns[n][1][:rows] for n in places], np.arange(1, rows + 1)

    return Sheet(source, [head for head, _ in columns], read, [])


class Choice(NamedTuple):
    """The column of a quantity: its place, its SI unit, and the factor to that."""

    place: int
    unit: str
    factor: float


#: How a date, or a time of day, or a duration begins.
CLOCK = re.compile(r'\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{4}|\d{1,3}:\d\d|\d+ days')


def _unit_and_factor(sheet: Sheet, place: int, quantity: Quantity) -> tuple[str, float] | None:
    """Return SI unit and factor of a column as a quantity; None if it is not one."""
    head = sheet.headings[place]
    if head.si is not None and head.si[0] in quantity.units:
        return head.si
    if 's' in quantity.units and head.has_word_of(quantity):
        first = sheet.first[place] if place < len(sheet.first) else ''
        if CLOCK.match(first):
            return 's', 1.0
        # Times since 1970, in s, ms, us or ns by the size of the number
        if head.unit is None and re.fullmatch(r'[12]\d{9}(\d{3}){0,3}', first):
            return 's', 10.0 ** (10 - len(first))
    return (quantity.units[0], 1.0) if quantity.bare and head.unit is None else None


def _place_of(sheet: Sheet, key: str, column: str) -> int:
    """Return the place of the column that was named, by its header, name or number."""
    words = column.strip().casefold()
    heads = [*enumerate(sheet.headings)]
    places = [n for n, head in heads if head.title.casefold() == words]
    places = places or [n for n, head in heads if head.name.casefold() == words]
    if len(places) == 1:
        return places[0]
    if not places and words.isdigit() and 0 < int(words[:9]) <= len(heads):
        return int(words) - 1
    problem = f'{"several columns" if places else "no column"} {quote(column)} for the {key}'
    numbers = ' and '.join(str(n + 1) for n in places[:3])
    remedy = f': give the number of the column, {numbers}' if places else ''
    raise ColumnError(key, f'{sheet.source}: {problem} among {sheet.titles()}{remedy}')


def choose(
    sheet: Sheet,
    key: str,
    quantity: Quantity,
    *,
    needed: bool = True,
    column: str = '',
    unit: str = '',
    without: Collection[int] = (),
    near: int | None = None,
    strict: bool = True,
) -> Choice | None:
    """
    Return the column of a quantity; None if there is none and it is not needed.

    `column` names it, and `unit` is that of a column without one; `without` are columns to leave
    out. Of several columns of time the nearest one before the column `near` is taken. Without
    `strict` a column with the word of a quantity may have the unit of another one.
    """
    if column:
        place = _place_of(sheet, key, column)
        given = si_unit_of(unit) if unit else _unit_and_factor(sheet, place, quantity)
        if given is None or given[0] not in quantity.units:
            raise _unusable(sheet, key, quantity, place)
        return Choice(place, *given)
    usable = [
        Choice(n, *si)
        for n in range(len(sheet.headings))
        if n not in without and (si := _unit_and_factor(sheet, n, quantity)) is not None
    ]
    worded = [c for c in usable if sheet.headings[c.place].has_word_of(quantity)]
    of_unit = [c for c in usable if sheet.headings[c.place].unit is not None]
    best = worded or (of_unit if quantity.by_unit else [])
    if 's' in quantity.units and len(best) > 1:
        elapsed = [c for c in best if 'elapsed' in sheet.headings[c.place].title.casefold()]
        before = [c for c in best if near is not None and c.place < near]
        best = (elapsed or before[-1:] or best)[:1]
    if len(best) == 1:
        return best[0]
    if best:
        titles = {c.place + 1: sheet.headings[c.place].title for c in best[:3]}
        alike = len(set(titles.values())) < len(titles)
        both = ' and '.join(
            quote(title) + (f' (column {number})' if alike else '')
            for number, title in titles.items()
        )
        remedy = 'give the number of one' if alike else 'name one'
        raise ColumnError(
            key, f'{sheet.source}: {both} may each be the {key}: {remedy}, or rename the others'
        )
    others = [
        n
        for n, head in enumerate(sheet.headings)
        # A column t [°C] is another one, unless it is all there is
        if n not in without and head.has_word_of(quantity) and (needed or len(head.name) > 1)
    ]
    if others and (needed or (strict and sheet.headings[others[0]].unit is not None)):
        raise _unusable(sheet, key, quantity, others[0])
    if needed:
        raise ColumnError(
            key,
            f'{sheet.source}: no column for the {key} among {sheet.titles()}: add it, with the '
            f'heading {quantity.names[0]} [{quantity.units[0]}]',
        )
    return None


def _unusable(sheet: Sheet, key: str, quantity: Quantity, place: int) -> ColumnError:
    """Return the error of a column whose unit is missing, or that of another quantity."""
    head = sheet.headings[place]
    problem = 'has no unit' if head.unit is None else f'has the unit {quote(head.unit)}'
    known = '; '.join(SHOWN.get(si, 'none') for si in quantity.units)
    return ColumnError(
        key,
        f'{sheet.source}: column {quote(head.title)} {problem}: write it behind the name, as '
        f'{quantity.names[0]} [{quantity.units[0]}]; known for {key} are {known}',
    )
