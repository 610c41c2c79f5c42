# SPDX-License-Identifier: Apache-2.0
"""
Tables of measured data: CSV files whose header names each column and its unit.

``t [s], x [mm], force [N]``, the export of a phone (``"Time (s)","Acceleration x (m/s^2)"``) and
files with semicolons and decimal commas are read alike. Columns come out in SI units.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .quoting import as_line, shown
from .units import STANDARD_GRAVITY, UNITS

Array = NDArray[np.float64]

#: Largest file that is read, bytes.
MOST_BYTES = 2 * 10**9
#: Units of spectral densities, as factors to SI.
_DENSITIES = {
    '(m/s^2)^2/Hz': {
        'g^2/Hz': STANDARD_GRAVITY**2,
        'g²/Hz': STANDARD_GRAVITY**2,
        '(m/s^2)^2/Hz': 1.0,
        '(m/s²)²/Hz': 1.0,
        'm^2/s^3': 1.0,
    },
    'N^2/Hz': {'N^2/Hz': 1.0, 'N²/Hz': 1.0},
}
_HEADER = re.compile(r'\s*(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>.*?)\s*[\])])?\s*$')


class TableError(ValueError):
    """A table of measured data that cannot be used; the text names column, line and remedy."""


class Quantity(NamedTuple):
    """
    A column that is looked for.

    Attributes
    ----------
    names : tuple of str
        Words that its header may have, without case; a header that begins with one of them is it.
    units : tuple of str
        SI units that it may have; the first of them is that of a column that needs none.
    bare : bool
        Whether it may stand without a unit.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    bare: bool = False


TIME = Quantity(('time', 't', 'zeit', 'timestamp'), ('s',))
FREQUENCY = Quantity(('frequency', 'f', 'freq', 'frequenz'), ('Hz',))
FORCE = Quantity(('force', 'kraft', 'load'), ('N',))
ACCELERATION = Quantity(
    ('acceleration', 'accel', 'acc', 'a', 'linear acceleration', 'beschleunigung'), ('m/s^2',)
)
DISPLACEMENT = Quantity(('displacement', 'x', 'position', 'weg', 'disp'), ('m',))
VELOCITY = Quantity(('velocity', 'v', 'vel', 'geschwindigkeit'), ('m/s',))
LEVEL = Quantity(('level', 'psd', 'asd', 'density', 's', 'g'), ('(m/s^2)^2/Hz', 'N^2/Hz'))


class Column(NamedTuple):
    """
    A column of a table, in SI units.

    Attributes
    ----------
    values : ndarray
        The numbers; NaN for an empty cell.
    unit : str
        Their SI unit.
    title : str
        The header as it stands in the file.
    """

    values: Array
    unit: str
    title: str


class MeasuredTable(NamedTuple):
    """
    The columns of a file that were looked for, by their keys, and the line of each row.

    Attributes
    ----------
    path : Path
        The file.
    columns : dict of Column
        What was found.
    lines : ndarray of int
        Line of each row in the file, from 1.
    """

    path: Path
    columns: dict[str, Column]
    lines: NDArray[np.int64]

    def error(self, key: str, row: int, problem: str) -> TableError:
        """Return the error of a row of a column."""
        return TableError(
            f'{as_line(str(self.path))}, line {self.lines[row]}, column '
            f'{shown(self.columns[key].title)}: {problem}'
        )

    def check_finite(self, key: str) -> None:
        """Raise `TableError` where a column has no number."""
        wrong = np.flatnonzero(~np.isfinite(self.columns[key].values))
        if len(wrong):
            raise self.error(key, int(wrong[0]), 'no number: fill the gap, or leave the row out')

    def check_rising(self, key: str) -> None:
        """Raise `TableError` where a column does not rise from row to row."""
        self.check_finite(key)
        values = self.columns[key].values
        wrong = np.flatnonzero(np.diff(values) <= 0.0)
        if len(wrong):
            row = int(wrong[0]) + 1
            raise self.error(
                key,
                row,
                f'{values[row]:.9g} after {values[row - 1]:.9g}: the column must rise, leave out '
                'the rows that repeat, or sort them',
            )


def _unit_of(quantity: Quantity, unit: str) -> tuple[str, float] | None:
    """Return SI unit and factor of a unit of a quantity; None if it is none of it."""
    for si in quantity.units:
        factors = {**UNITS.get(si, {}), **_DENSITIES.get(si, {})}
        if unit in factors:
            return si, factors[unit]
    return None


def _is_named(quantity: Quantity, name: str) -> bool:
    words = name.casefold()
    return any(words == n or re.match(rf'{re.escape(n)}[\s_.\d]', words) for n in quantity.names)


def _delimiter(header: str) -> str:
    return max(';\t,', key=header.count) if any(c in header for c in ';\t,') else ','


def _rows(path: Path, text: str) -> tuple[list[str], list[tuple[int, list[str]]], str]:
    """Return the header, the numbered rows with their cells, and the delimiter."""
    lines = text.splitlines()
    start = next(
        (
            n
            for n, line in enumerate(lines)
            if line.strip() and not line.lstrip().startswith(('#', '%', '//'))
        ),
        None,
    )
    if start is None:
        raise TableError(f'{as_line(str(path))}: empty; give a header and rows, as t [s], x [mm]')
    delimiter = _delimiter(lines[start])
    rows = [
        (start + n, [cell.strip() for cell in cells])
        for n, cells in enumerate(csv.reader(lines[start:], delimiter=delimiter), 1)
        if any(cell.strip() for cell in cells)
    ]
    (_, header), *body = rows
    if all(map(_is_number, filter(None, header))):
        raise TableError(
            f'{as_line(str(path))}, line {start + 1}: numbers where the header should be: name '
            'each column and its unit, as t [s], x [mm]'
        )
    return header, body, delimiter


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(',', '.'))
    except ValueError:
        return False
    return True


def _numbers(
    path: Path, title: str, cells: Iterator[tuple[int, str]], comma: bool
) -> Iterator[float]:
    for line, cell in cells:
        try:
            yield float((cell.replace(',', '.') if comma else cell) or 'nan')
        except ValueError:
            raise TableError(
                f'{as_line(str(path))}, line {line}, column {shown(title)}: {shown(cell)} is no '
                'number'
            ) from None


def _found(
    path: Path, titles: Sequence[str], key: str, quantity: Quantity
) -> tuple[int, str, float] | None:
    """Return place, SI unit and factor of the column of a quantity; None if there is none."""
    named = []
    for place, title in enumerate(titles):
        match = _HEADER.match(title)
        assert match is not None
        if not _is_named(quantity, match['name']):
            continue
        unit = match['unit']
        known = _unit_of(quantity, unit or '')
        if known is None and unit is None and quantity.bare:
            known = quantity.units[0], 1.0
        named.append((place, title, unit, known))
    usable = [entry for entry in named if entry[3] is not None]
    if not named:
        return None
    if not usable:
        _, title, unit, _ = named[0]
        units = ', '.join(
            u for si in quantity.units for u in {**UNITS.get(si, {}), **_DENSITIES.get(si, {})}
        )
        problem = 'has no unit' if unit is None else f'has the unit {shown(unit)}'
        name = quantity.names[0]
        raise TableError(
            f'{as_line(str(path))}: column {shown(title)} {problem}: write it behind the name, as '
            f'{name} [{quantity.units[0]}]; known for {key} are {units}'
        )
    if len(usable) > 1:
        both = ' and '.join(shown(title) for _, title, _, _ in usable[:2])
        raise TableError(
            f'{as_line(str(path))}: {both} may both be the {key}: rename the one that is not'
        )
    place, _, _, known = usable[0]
    assert known is not None
    return place, *known


def read_table(
    path: Path, needed: Mapping[str, Quantity], optional: Mapping[str, Quantity] | None = None
) -> MeasuredTable:
    """
    Read a CSV file of measured data.

    Parameters
    ----------
    path : Path
        The file. Lines that begin with #, % or // before the header are skipped.
    needed, optional : mapping of str to Quantity
        Columns that must be there, and those that may be.

    Returns
    -------
    MeasuredTable
        The columns in SI units.

    Raises
    ------
    TableError
        If a needed column is missing, has no unit or holds something else than numbers.
    OSError
        If the file cannot be read.
    """
    if path.stat().st_size > MOST_BYTES:
        raise TableError(f'{as_line(str(path))}: larger than {MOST_BYTES:.0e} bytes: cut it')
    try:
        text = path.read_text(encoding='utf-8-sig')
    except UnicodeDecodeError:
        text = path.read_text(encoding='latin-1')
    titles, body, delimiter = _rows(path, text)
    columns = {}
    for key, quantity in {**needed, **(optional or {})}.items():
        found = _found(path, titles, key, quantity)
        if found is None:
            if key in needed:
                raise TableError(
                    f'{as_line(str(path))}: no column for the {key} among '
                    f'{", ".join(map(shown, titles))}: name it {quantity.names[0]} '
                    f'[{quantity.units[0]}]'
                )
            continue
        place, unit, factor = found
        cells = ((line, row[place] if place < len(row) else '') for line, row in body)
        numbers = _numbers(path, titles[place], cells, delimiter != ',')
        values = np.fromiter(numbers, float, len(body)) * factor
        columns[key] = Column(values, unit, titles[place])
    if len(body) < 2:
        raise TableError(f'{as_line(str(path))}: {len(body)} rows: give at least 2')
    return MeasuredTable(path, columns, np.array([line for line, _ in body]))


def sampling_rate(table: MeasuredTable, key: str = 'time') -> float:
    """
    Return the rate of samples at equal intervals, Hz; or raise `TableError` at a gap.

    Intervals may differ by a hundredth, as clocks do that print few digits.
    """
    table.check_rising(key)
    times = table.columns[key].values
    steps = np.diff(times)
    step = float(np.median(steps))
    digits = 10.0 ** math.floor(math.log10(abs(times[-1]) or 1.0) - 6)
    wrong = np.flatnonzero(np.abs(steps - step) > 0.01 * step + digits)
    if len(wrong):
        row = int(wrong[0]) + 1
        raise table.error(
            key,
            row,
            f'a step of {steps[row - 1]:.4g} s where the others are {step:.4g} s: fill the gap, '
            'or cut the record there',
        )
    return float((len(times) - 1) / (times[-1] - times[0]))
