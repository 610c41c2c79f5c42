# SPDX-License-Identifier: Apache-2.0
"""Columns of a file as they are in it: headings, units and the reader of their numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import shown

from .units import SHOWN, unit_of

Array = NDArray[np.float64]

#: Longest header that is looked at.
_LONGEST_TITLE = 200


class TableError(ValueError):
    """A file of measured data that cannot be used; the text names column, line and remedy."""


class ColumnError(TableError):
    """No column, or more than one, for a quantity (`key`)."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(problem)
        self.key = key


class Quantity(NamedTuple):
    """
    A column that is looked for.

    Attributes
    ----------
    names : tuple of str
        Words of which its header may have one, in any case; the first is that of messages.
    units : tuple of str
        SI units that it may have; the first of them is that of a column that needs none.
    bare : bool
        Whether it may stand without a unit.
    by_unit : bool
        Whether a column of another name may be it if it is the only one of that unit.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    bare: bool = False
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
        return Heading(f'{title} [{unit}]', title, unit, unit_of(unit))
    text = re.sub(r'^[^:\[(]*:\s+', '', title[:_LONGEST_TITLE])
    start = min((text.find(mark) for mark in '[(' if mark in text), default=-1)
    end = max(text.rfind(mark) for mark in '])')
    if 0 <= start < end:
        # The outermost brackets, as of ((m/s2)2/Hz), or the last ones that are a unit
        spans = [(start, end), *((m.start(), m.end() - 1) for m in _brackets(text))]
        for begin, last in spans:
            if text[begin + 1 : last].strip() and unit_of(text[begin + 1 : last]):
                start, end = begin, last
                break
        own = text[start + 1 : end].strip()
        name = ' '.join(f'{text[:start]} {text[end + 1 :]}'.split())
        return Heading(title, name, own, unit_of(own))
    for name, own in _unit_beside(text):
        if own and (si := unit_of(own, any_case=False)):
            return Heading(title, name, own, si)
    return Heading(title, text, None, None)


def _brackets(text: str) -> list[re.Match[str]]:
    return [*re.finditer(r'[\[(][^\[\]()]*[\])]', text)][::-1]


def _unit_beside(text: str) -> list[tuple[str, str]]:
    """Return name and unit where a unit may stand without brackets: x_mm, seconds_elapsed."""
    parts = re.split(r'[\s_,]+', text)
    slash, _, below = text.partition(' / ')
    found = [(slash, below.strip())] if below else []
    if len(parts) > 1:
        found.append((text[: -len(parts[-1])].rstrip(' _,/').removesuffix(' in'), parts[-1]))
    if '/' in text and len(parts) == 1:
        found.append((text.partition('/')[0], text.partition('/')[2]))
    # A time may be called by its unit alone
    if len(parts[0]) > 1 and (unit_of(parts[0], any_case=True) or ('', 0.0))[0] == 's':
        found.append((' '.join(parts[1:]) or 'time', parts[0].casefold()))
    return found


class Sheet(NamedTuple):
    """
    Columns of a file.

    Attributes
    ----------
    source : str
        Name of the file, for messages.
    headings : list of Heading
        One for each column.
    read : callable
        Returns the numbers of some columns, as they are in the file (NaN where one is missing; a
        date or a time of day as seconds), and the line of each row.
    first : list of str
        Cells of the first row, of a file that is text.
    """

    source: str
    headings: list[Heading]
    read: Callable[[Sequence[int]], tuple[list[Array], NDArray[np.int64]]]
    first: list[str]

    def titles(self, without: Collection[int] = ()) -> str:
        """Return the headers of all columns but some."""
        left = [h.title for n, h in enumerate(self.headings) if n not in without]
        return ', '.join(map(shown, left[:20])) + (' ...' if len(left) > 20 else '')

    def described(self, places: Mapping[str, int]) -> str:
        """Return which columns are used, and which are not."""
        named = [key for key in places if not key.startswith('time of ')]
        order = sorted(named, key=lambda key: key != 'time')
        used = ', '.join(f'{key} {shown(self.headings[places[key]].title)}' for key in order)
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


def _known(sheet: Sheet, place: int, quantity: Quantity) -> tuple[str, float] | None:
    """Return SI unit and factor of a column as a quantity; None if it is not one."""
    head = sheet.headings[place]
    if head.si is not None and head.si[0] in quantity.units:
        return head.si
    if 's' in quantity.units and head.has_word_of(quantity):
        first = sheet.first[place] if place < len(sheet.first) else ''
        if CLOCK.match(first):
            return 's', 1.0
        # Since 1970, in s, ms, us or ns, as each number of that size is
        if head.unit is None and first.isdigit() and first[0] in '12':
            factors = {10: 1.0, 13: 1e-3, 16: 1e-6, 19: 1e-9}
            if len(first) in factors:
                return 's', factors[len(first)]
    return (quantity.units[0], 1.0) if quantity.bare and head.unit is None else None


def _named(sheet: Sheet, key: str, column: str) -> int:
    """Return the place of the column that was named, by its header, name or number."""
    words = column.strip().casefold()
    of: tuple[Callable[[Heading], str], ...] = (lambda h: h.title, lambda h: h.name)
    places: list[int] = []
    for text in of:
        places = [n for n, h in enumerate(sheet.headings) if text(h).casefold() == words]
        if len(places) == 1:
            return places[0]
        if places:
            break
    if not places and words.isdigit() and 0 < int(words[:9]) <= len(sheet.headings):
        return int(words) - 1
    problem = f'{"several columns" if places else "no column"} {shown(column)}'
    numbers = ' and '.join(str(n + 1) for n in places[:3])
    remedy = f': give the number of the column, {numbers}' if places else ''
    raise ColumnError(
        key, f'{sheet.source}: {problem} for the {key} among {sheet.titles()}{remedy}'
    )


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

    `column` names it, and `unit` is that of a column without one; those of `without` are others.
    Of several columns of time that of `near` is the nearest one before it. Without `strict` a
    column with the word of a quantity may have the unit of another one.
    """
    if column:
        place = _named(sheet, key, column)
        given = unit_of(unit) if unit else _known(sheet, place, quantity)
        if given is None or given[0] not in quantity.units:
            raise _unusable(sheet, key, quantity, place)
        return Choice(place, *given)
    usable = [
        Choice(n, *si)
        for n in range(len(sheet.headings))
        if n not in without and (si := _known(sheet, n, quantity)) is not None
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
        both = ' and '.join(shown(sheet.headings[c.place].title) for c in best[:3])
        raise ColumnError(key, f'{sheet.source}: {both} may each be the {key}: rename the others')
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
            f'{sheet.source}: no column for the {key} among {sheet.titles()}: name it '
            f'{quantity.names[0]} [{quantity.units[0]}]',
        )
    return None


def _unusable(sheet: Sheet, key: str, quantity: Quantity, place: int) -> ColumnError:
    """Return the error of a column whose unit is missing, or another one's."""
    head = sheet.headings[place]
    problem = 'has no unit' if head.unit is None else f'has the unit {shown(head.unit)}'
    known = '; '.join(SHOWN.get(si, 'none') for si in quantity.units)
    return ColumnError(
        key,
        f'{sheet.source}: column {shown(head.title)} {problem}: write it behind the name, as '
        f'{quantity.names[0]} [{quantity.units[0]}]; known for {key} are {known}',
    )
