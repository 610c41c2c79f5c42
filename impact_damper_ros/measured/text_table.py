# SPDX-License-Identifier: Apache-2.0
"""
Tables that are text: CSV and similar formats.

The header is found above the first line of numbers: it may be a comment, have the units in a row
of their own, and descriptions between. Numbers are read in pieces, so that a table takes the
memory of its file and of the columns that are used.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import date

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import plural, quote

from .sheet import CLOCK, FREQUENCY, TIME, Array, Heading, Sheet, TableError, heading
from .units import si_unit_of

#: Most rows and columns of a table, longest line, bytes, and lines among which the header is.
_MOST_ROWS, _MOST_COLUMNS, _LONGEST_LINE, _HEAD = 5_000_000, 1000, 1_000_000, 2000
#: Lines that are read at once, cells by which the kind of a line is found.
_PIECE, _CELLS_SEEN = 20_000, 50
_COMMENTS = ('#', '%', '//', ';')
#: What a spreadsheet or a program of measurement writes where there is no number.
_MISSING = {'', '-', '--', 'nan', 'na', 'n/a', '#n/a', '#nv', 'null', 'none', '#value!', '#wert!'}
#: Units of the columns that `simulate_rig` and `replay_run` write without any.
_OF_RIGS = {'time': 's', 'x': 'm', 'force': 'N', 'base': 'm'}
#: 1,000 is 1 where the comma is a decimal sign, and 1000 where it separates thousands.
_UNCLEAR = re.compile(r'[-+]?[1-9]\d{0,2}[.,]\d{3}')
#: Day, if there is one, hours, minutes and seconds; 10.00.00.5 as some phones have it, too.
_TIME_OF_DAY = re.compile(
    r'(?:(?:(\d{4})[-/.](\d\d?)[-/.](\d\d?)|(\d\d?)([./-])(\d\d?)[./-](\d{4})|(\d+) days?),?'
    r'[T ] *)?(?:(\d{1,3})([:.]))?(\d\d?)(?(10)\10|:)(\d\d(?:[.,]\d+)?) ?([AaPp][Mm])?'
    r'(?:Z|[-+]\d\d:?\d\d)?'
)


def text_sheet(source: str, content: bytes) -> Sheet:
    """Return the columns of a text with separators, whose header stands above the numbers."""
    text = _Text(source, content)
    # Lines behind a long line are not read.
    sizes = itertools.accumulate(map(len, text.lines(0, _HEAD)), initial=0)
    pairs = zip(text.lines(0, _HEAD), sizes, strict=False)
    head = [line for line, size in pairs if size < _LONGEST_LINE]
    first = _first_row(head)
    above = [n for n, line in enumerate(head[:first]) if line.strip()]
    if first is None and not above:
        raise TableError(f'{source}: empty; give a header and rows, as t [s], x [mm]')
    if first is None:
        # No line has numbers only: the error names the cell.
        first = above[0] + 1
        above = above[:1]
    row = head[first] if first < len(head) else ''
    headings, delimiter = _header(head, above, row)
    if not headings:
        if len(_split_row(row, delimiter)) > 1 or ',' in row:
            raise TableError(
                f'{source}, line {first + 1}: numbers where the header should be: name each '
                'column and its unit, as t [s], x [mm]'
            )
        headings = [heading('column 1')]
    if len(headings) > _MOST_COLUMNS:
        raise TableError(f'{source}: more than {_MOST_COLUMNS} columns: leave some out')
    names = [head.title for head in headings]
    if 'primary_velocity' in names:
        headings = [heading(t, _OF_RIGS.get(t)) for t in names]
    body = Body(source, headings, delimiter)

    def read(places: Sequence[int]) -> tuple[list[Array], NDArray[np.int64]]:
        return body.read(text.lines(first), first + 1, places)

    return Sheet(source, headings, read, _split_row(row, delimiter))


class _Text:
    """The lines of a content that is text in some encoding."""

    def __init__(self, source: str, content: bytes) -> None:
        self._content = content
        wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        blocks = range(0, len(content) - _LONGEST_LINE, _LONGEST_LINE)
        pieces = (content[start : start + _LONGEST_LINE] for start in blocks)
        if any(b'\n' not in piece and b'\r' not in piece for piece in pieces):
            raise TableError(f'{source}: a line of more than {_LONGEST_LINE} bytes: no table')
        count = content.count(b'\n') + content.count(b'\r')
        if count > 2 * _MOST_ROWS:
            raise TableError(f'{source}: {count} lines: cut it to {_MOST_ROWS}')
        if not wide and b'\0' in content:
            raise TableError(f'{source}: no text: export the data as CSV')
        decoder = codecs.getincrementaldecoder('utf-16' if wide else 'utf-8')()
        self._encoding = 'utf-16' if wide else 'utf-8-sig'
        try:
            for start in range(0, len(content), _LONGEST_LINE):
                decoder.decode(content[start : start + _LONGEST_LINE])
        except UnicodeDecodeError:
            self._encoding = self._encoding if wide else 'latin-1'

    def lines(self, start: int, count: int | None = None) -> Iterator[str]:
        """Yield lines from one on."""
        text = io.TextIOWrapper(io.BytesIO(self._content), self._encoding, 'replace')
        end = None if count is None else start + count
        return (line.rstrip('\n') for line in itertools.islice(text, start, end))


def _split_row(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line; an empty delimiter stands for spaces."""
    if not delimiter:
        return line.split()
    # A quote that is not closed ends nowhere
    if line.count('"') % 2 or '"' not in line or len(line) > csv.field_size_limit():
        return [cell.strip() for cell in line.split(delimiter)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _is_value(cell: str) -> bool:
    known = not isinstance(_number(cell), str) or _TIME_OF_DAY.fullmatch(cell)
    return bool(known or _ends_in_digits(cell))


def _first_row(lines: Sequence[str]) -> int | None:
    """Return the first line of numbers; None if there is none."""
    filled = [n for n, s in enumerate(lines) if s.strip() and not s.startswith(('#', '%', '//'))]

    def numbers(n: int, cells: int) -> bool:
        for delimiter in (*';\t,', ''):
            row = _split_row(lines[n], delimiter)[:cells]
            if all(map(_is_value, row)) and any(cell.lower() not in _MISSING for cell in row):
                return True
        return False

    for at, n in enumerate(filled):
        if numbers(n, _CELLS_SEEN):
            # Lines above it belong to the numbers, too, if only a later cell is no number.
            while at and numbers(filled[at - 1], 1):
                at -= 1
            return filled[at]
    return None


def _header(head: list[str], above: list[int], row: str) -> tuple[list[Heading], str]:
    """Return the headings that stand above the first row, and the delimiter."""

    def cells_of(n: int) -> tuple[list[str], str]:
        line = head[n].strip()
        if n in marked:
            line = line.lstrip('#%;/ ')
        delimiter = _delimiter(line, row)
        return _titles(line, row, delimiter), delimiter

    def fits(n: int) -> bool:
        cells, delimiter = cells_of(n)
        least = len(_split_row(row.rstrip(delimiter or None), delimiter))
        known = [h for cell in cells[:_CELLS_SEEN] if (h := heading(cell)).name]
        return least <= len(cells) <= len(_split_row(row, delimiter)) + 1 and any(
            h.has_word_of(TIME) or h.has_word_of(FREQUENCY) or (h.si or ('',))[0] == 's'
            for h in known
        )

    marked = {n for n in above if head[n].lstrip().startswith(_COMMENTS)}
    marked = {n for n in marked if head[n].lstrip()[0] != ';' or ';' not in row}
    nearest = [*reversed(above)]
    units: list[str] = []
    if len(nearest) > 1 and _are_units(cells_of(nearest[0])[0]):
        units = cells_of(nearest.pop(0))[0]
    likely = [*filter(fits, nearest), *(n for n in nearest if units or n not in marked)]
    if not likely:
        return [], _delimiter('', row)
    chosen = likely[0]
    cells, delimiter = cells_of(chosen)
    if chosen in marked and len(cells) == 1 + len(_split_row(row, delimiter)):
        # ;Headers, time [s], Ax [mg]
        cells = cells[1:]
    pairs = zip(cells, [*units, *[''] * len(cells)], strict=False)
    few = itertools.islice(pairs, _MOST_COLUMNS + 1)
    return [heading(title, unit.strip('[]()')) for title, unit in few], delimiter


def _delimiter(header: str, row: str) -> str:
    """Return the delimiter of a header and of the first row below it."""
    if any(mark in header for mark in ';\t,'):
        return max(';\t,', key=header.count)
    # Spaces separate several columns; in the name of a single one they do not.
    return '' if len(row.split()) > 1 else ';'


def _titles(header: str, row: str, delimiter: str) -> list[str]:
    """Return the cells of a header; between wide spaces if that gives as many as the row has."""
    if delimiter:
        return _split_row(header, delimiter)
    wide = re.split(r'\s{2,}', header.strip())
    return wide if len(wide) == len(row.split()) else header.split()


def _are_units(cells: Sequence[str]) -> bool:
    """Return whether the cells of a row are units, or empty."""
    known = [si_unit_of(cell.strip('[]()')) for cell in cells[:_CELLS_SEEN]]
    return all(known) and any(unit and unit[0] for unit in known)


class Body:
    """The rows of a table below its header."""

    def __init__(self, source: str, headings: list[Heading], delimiter: str) -> None:
        self._source, self._headings, self._delimiter = source, headings, delimiter

    def read(
        self, lines: Iterable[str], number: int, places: Sequence[int]
    ) -> tuple[list[Array], NDArray[np.int64]]:
        """Return the numbers of some columns, and the line of each row, from a number on."""
        pieces: list[Array] = [np.empty((0, len(places)))]
        numbers: list[NDArray[np.int64]] = [np.empty(0, np.int64)]
        comments = tuple(mark for mark in _COMMENTS if mark != self._delimiter)
        empty = f' \t{self._delimiter}'
        every = (
            (n, line)
            for n, line in enumerate(lines, number)
            if line.strip(empty) and not line.startswith(comments)
        )
        piece = [*itertools.islice(every, _PIECE)]
        self._day: int | None = None
        rows = 0
        while piece:
            coming = [*itertools.islice(every, _PIECE)]
            if not coming and not any(map(_is_value, self._split(piece[-1][1]))):
                # EOF
                del piece[-1]
            rows += len(piece)
            if rows > _MOST_ROWS:
                raise TableError(f'{self._source}: more than {_MOST_ROWS} rows: cut it')
            if piece:
                pieces.append(self._piece(piece, places))
                numbers.append(np.array([n for n, _ in piece], np.int64))
            piece = coming
        whole = np.concatenate(pieces)
        whole[~np.isfinite(whole)] = np.nan
        return [whole[:, n] for n in range(len(places))], np.concatenate(numbers)

    def _split(self, line: str) -> list[str]:
        return _split_row(line, self._delimiter)

    def _piece(self, piece: list[tuple[int, str]], places: Sequence[int]) -> Array:
        """Return the numbers of a piece of the rows."""
        values = self._quickly(piece, places)
        if values is not None:
            return values
        width = len(self._headings)
        rows = []
        for n, line in piece:
            if line.count('"') % 2:
                raise TableError(f'{self._source}, line {n}: a quote that is not closed: close it')
            cells = self._split(line)
            if any(cells[width:]):
                raise TableError(
                    f'{self._source}, line {n}: {plural(len(cells), "cell")} below a header of '
                    f'{width}: separate columns by semicolons if numbers have decimal commas'
                )
            rows.append([*cells, *[''] * (width - len(cells))])
        found = np.empty((len(rows), len(places)))
        for k, place in enumerate(places):
            column = [row[place] for row in rows]
            for row, number in enumerate(self._numbers(column)):
                if isinstance(number, str):
                    raise TableError(
                        f'{self._source}, line {piece[row][0]}, column '
                        f'{quote(self._headings[place].title)}: {quote(column[row])} {number}'
                    )
                found[row, k] = number
        return found

    def _quickly(self, piece: list[tuple[int, str]], places: Sequence[int]) -> Array | None:
        """Return the numbers of rows that have nothing else in the columns that are used."""
        lines, delimiter = [line.rstrip() for _, line in piece], self._delimiter
        text = '\n'.join(lines)
        if '"' in text or (delimiter != ',' and ',' in text and '.' in text):
            return None
        if delimiter != ',' and ',' in text:
            lines = text.replace(',', '.').split('\n')
        if delimiter:
            lines = [line.rstrip(f'{delimiter} ') for line in lines]
            widest = max(line.count(delimiter) for line in lines) + 1
        else:
            widest = max(len(line.split()) for line in lines)
        if widest > len(self._headings):
            return None
        try:
            values: Array = np.loadtxt(
                lines, delimiter=delimiter or None, usecols=places, ndmin=2, comments=None
            )
        except ValueError:
            return None
        # 1.016 among 998 is rather a thousand: the cells say which
        whole = (values == np.rint(values)) | ~np.isfinite(values)
        large = ((np.abs(values) >= 100.0) & whole).any(axis=0)
        parts = (~whole).any(axis=0) & (whole | (np.abs(values) < 1000.0)).all(axis=0)
        return None if (large & parts).any() else values

    def _numbers(self, cells: Sequence[str]) -> Iterable[float | str]:
        """Return the numbers of cells: NaN for a missing one, a text for what is no number."""
        if CLOCK.match(next((cell for cell in cells if cell.lower() not in _MISSING), '')):
            return [self._seconds(cell) for cell in cells]
        marks = {mark: [cell for cell in cells if mark in cell] for mark in ',.'}
        used = marks[','] or marks['.']
        comma = self._delimiter != ','
        # 1,016 beside 998 or 998.5 is rather a thousand
        others = [c for c in cells if c.lstrip('+-').isdigit() and len(c) > 2]
        unclear = all(map(_UNCLEAR.fullmatch, used)) and (others or (marks[','] and not comma))
        both = marks[','] and marks['.']
        return [
            f'may be {re.sub("[,.]", ".", cell)} or {re.sub("[,.]", "", cell)}: write it without '
            'a separator of thousands'
            if _UNCLEAR.fullmatch(cell) and (unclear or both)
            else _number(cell)
            for cell in cells
        ]

    def _seconds(self, cell: str) -> float | str:
        """Return a time of day, of the first day on, or a duration, in seconds."""
        found = _TIME_OF_DAY.fullmatch(cell)
        if found is None:
            return math.nan if cell.lower() in _MISSING else 'is no date and time of day'
        year, month, day, one, _, two, late, days, hours, _, minutes, seconds, half = (
            found.groups()
        )
        try:
            if late:
                # Day first, unless it has slashes and may be a month
                day, month = (one, two) if found[5] != '/' or int(one) > 12 else (two, one)
            number = int(days or 0)
            if late or year:
                number = date(int(late or year), int(month), int(day)).toordinal()
        except ValueError:
            return 'is no date'
        if self._day is None:
            self._day = number
        hour = int(hours or 0) % (12 if half else 10**9) + 12 * (half or '').lower().count('p')
        whole = (number - self._day) * 86400 + hour * 3600 + int(minutes) * 60
        return whole + float(seconds.replace(',', '.'))


def _number(cell: str) -> float | str:
    """Return the number in a cell, NaN if it is missing, or the error as a text."""
    if cell.lower() in _MISSING:
        return math.nan
    plain = cell.replace('−', '-')
    if ('.' in plain and ',' in plain) or max(plain.count(','), plain.count('.')) > 1:
        return (
            'has a separator of thousands: write it without'
            if _ends_in_digits(plain)
            else _NO_NUMBER
        )
    try:
        return float(plain.replace(',', '.')) if '_' not in plain else _NO_NUMBER
    except ValueError:
        return _NO_NUMBER


_NO_NUMBER = 'is no number'


def _ends_in_digits(plain: str) -> bool:
    return plain[-1:].isdigit() and not plain.strip('0123456789+-.,')
