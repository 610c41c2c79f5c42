# SPDX-License-Identifier: Apache-2.0
"""
Tables of measured data: files whose header names each column and its unit.

``t [s], x [mm], force [N]``, the export of a phone (``"Time (s)","Acceleration x (m/s^2)"``, also
in its .zip), files with semicolons and decimal commas, and those with the units in a row below the
names are read alike; so are universal files (.uff, .unv) and those of LabVIEW (.lvm) where their
readers are installed. Columns come out in SI units.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import as_line, shown
from impact_damper_ros.parameters.units import STANDARD_GRAVITY, UNITS

Array = NDArray[np.float64]

#: Largest file that is read, bytes.
MOST_BYTES = 2 * 10**9
#: Units of what only a table has, such as spectral densities, as factors to SI.
_OF_TABLES = {
    '(m/s^2)^2/Hz': {
        'g^2/Hz': STANDARD_GRAVITY**2,
        '(m/s^2)^2/Hz': 1.0,
        'm^2/s^3': 1.0,
    },
    'N^2/Hz': {'N^2/Hz': 1.0},
    # Of a logic signal
    'V': {'V': 1.0, 'mV': 1e-3},
    's': {'sec': 1.0, 'seconds': 1.0, 'Sekunden': 1.0, 'µs': 1e-6, 'us': 1e-6},
    'm': {'in': 0.0254, 'inch': 0.0254},
    'm/s^2': {'G': STANDARD_GRAVITY, 'mg': 1e-3 * STANDARD_GRAVITY, 'm s^-2': 1.0},
    'N': {'lbf': 4.4482216152605},
}
#: Units of the columns that `simulate_rig` and `replay_run` write without any.
_OF_RIGS = {'time': 's', 'x': 'm', 'force': 'N', 'base': 'm'}
_HEADER = re.compile(r'\s*(?P<name>.*?)\s*(?:[\[(]\s*(?P<unit>.*?)\s*[\])])?\s*$')
#: A unit behind a name without brackets: time / s, time in s, x_mm.
_BEHIND = re.compile(r'(?P<name>.+?)(?:\s*[/,]\s*|\s+in\s+|[\s_]+)(?P<unit>[^\s_]+)')
_KNOWN = {unit for tables in (UNITS, _OF_TABLES) for units in tables.values() for unit in units}


class TableError(ValueError):
    """A table of measured data that cannot be used; the text names column, line and remedy."""


class ColumnError(TableError):
    """A quantity (`key`) for which no column is there, or several ones are."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(problem)
        self.key = key


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
FORCE = Quantity(('force', 'kraft', 'load', 'f'), ('N',))
ACCELERATION = Quantity(
    (
        *('acceleration', 'accel', 'acc', 'a', 'linear acceleration'),
        *('beschleunigung', 'lineare beschleunigung'),
    ),
    ('m/s^2',),
)
DISPLACEMENT = Quantity(('displacement', 'x', 'position', 'weg', 'disp'), ('m',))
VELOCITY = Quantity(('velocity', 'v', 'vel', 'geschwindigkeit'), ('m/s',))
BASE = Quantity(('base', 'table', 'b', 'basis', 'fußpunkt'), ('m/s^2', 'm/s', 'm'))
#: A pulse, or a level, that is high during an impact.
IMPACT = Quantity(
    ('impact', 'impacts', 'hit', 'contact', 'trigger', 'stoß', 'aufprall'), ('', 'V'), bare=True
)
#: Instants of impacts in a file of their own.
INSTANT = TIME._replace(bare=True)
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
    factor : float
        Of the unit in the file.
    """

    values: Array
    unit: str
    title: str
    factor: float


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
        wrong = np.flatnonzero(np.diff(self.columns[key].values) <= 0.0)
        if len(wrong):
            row = int(wrong[0]) + 1
            raise self.error(
                key,
                row,
                f'{self.as_given(key, row)} after {self.as_given(key, row - 1)}: the column must '
                'rise; leave out rows that repeat, sort them, or export more digits',
            )

    def check_positive(self, key: str) -> None:
        """Raise `TableError` where a column has anything else than positive numbers."""
        wrong = np.flatnonzero(~(self.columns[key].values > 0.0))
        if len(wrong):
            row = int(wrong[0])
            raise self.error(key, row, f'{self.as_given(key, row)}: give a positive number')

    def as_given(self, key: str, row: int) -> str:
        """Return the number in a row of a column, in the unit of the file."""
        column = self.columns[key]
        return f'{column.values[row] / column.factor:.9g}'


def _unit_of(quantity: Quantity, unit: str) -> tuple[str, float] | None:
    """Return SI unit and factor of a unit of a quantity; None if it is none of it."""
    for si in quantity.units:
        factors = {**UNITS.get(si, {}), **_OF_TABLES.get(si, {})}
        if _usual(unit) in factors:
            return si, factors[_usual(unit)]
    return None


def _usual(unit: str) -> str:
    """Return a unit as the tables have it: with the sign of micro, and ^ before an exponent."""
    written = unit.replace('μ', 'µ').replace('**', '^')
    return re.sub(r'(?<=s)2$', '^2', written.replace('²', '^2'))


def _is_named(quantity: Quantity, name: str) -> bool:
    words = name.casefold()
    return any(words == n or re.match(rf'{re.escape(n)}[\s_.\d]', words) for n in quantity.names)


class _Sheet(NamedTuple):
    """A file as it is: headers, the line of each row, and the reader of a column."""

    path: Path
    titles: list[str]
    lines: NDArray[np.int64]
    numbers: Callable[[int], Array]


def _split_row(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line; an empty delimiter stands for spaces."""
    if not delimiter:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _delimiter(header: str, row: str) -> str:
    """Return what separates the cells of a header and of the first row below it."""
    if any(mark in header for mark in ';\t,'):
        return max(';\t,', key=header.count)
    # Of one column, whose name may have spaces, or of several
    return '' if len(row.split()) > 1 else ';'


def _titles(header: str, row: str, delimiter: str) -> list[str]:
    """Return the cells of a header; between spaces those that the row has."""
    if delimiter:
        return _split_row(header, delimiter)
    wide = re.split(r'\s{2,}', header.strip())
    return wide if len(wide) == len(row.split()) else header.split()


def _first_row(lines: Sequence[str]) -> int | None:
    """Return the first line of numbers; None if there is none."""
    filled = [n for n, line in enumerate(lines) if line.strip()]

    def numbers(n: int, cells: int | None = None) -> bool:
        rows = (_split_row(lines[n], delimiter) for delimiter in (*';\t,', ''))
        return any(_are_numbers(row[:cells]) for row in rows)

    for at, n in enumerate(filled):
        if numbers(n):
            # With the lines above it that have something else in a later cell
            while at and numbers(filled[at - 1], 1):
                at -= 1
            return filled[at]
    return None


def _text_sheet(path: Path, text: str) -> _Sheet:
    """Return the columns of a text with separators: its header stands above the numbers."""
    lines = text.splitlines()
    name, first = as_line(str(path)), _first_row(lines)
    above = [
        n
        for n, line in enumerate(lines[:first])
        if line.strip() and not line.lstrip().startswith(('#', '%', '//'))
    ]
    if not above:
        if first is None:
            raise TableError(f'{name}: empty; give a header and rows, as t [s], x [mm]')
        raise TableError(
            f'{name}, line {first + 1}: numbers where the header should be: name each column and '
            'its unit, as t [s], x [mm]'
        )
    if first is None:
        # No line has numbers only: what is wrong with them is said of each cell
        above = above[:1]
        first = above[0] + 1
    row = lines[first] if first < len(lines) else ''
    delimiter = _delimiter(lines[above[-1]], row)
    header = _titles(lines[above[-1]], row, delimiter)
    if len(above) > 1:
        names = _titles(lines[above[-2]], row, delimiter)
        if _are_units(names, header):
            pairs = zip(names, [*header, *[''] * len(names)], strict=False)
            header = [
                f'{title} [{unit.strip("[]()")}]' if unit else title for title, unit in pairs
            ]
    if 'primary_velocity' in header:
        header = [f'{t} [{_OF_RIGS[t]}]' if t in _OF_RIGS else t for t in header]
    body = lines[first:]
    rows = csv.reader(body, delimiter=delimiter) if delimiter else (line.split() for line in body)
    cells_of = [
        (first + n, [cell.strip() for cell in cells])
        for n, cells in enumerate(rows, 1)
        if any(cell.strip() for cell in cells)
    ]
    for line, cells in cells_of:
        if any(cells[len(header) :]):
            raise TableError(
                f'{name}, line {line}: {len(cells)} cells below a header of {len(header)}: '
                'separate columns by semicolons if numbers have decimal commas'
            )

    def numbers(place: int) -> Array:
        column = [row[place] if place < len(row) else '' for _, row in cells_of]
        found = _numbers(column, delimiter != ',')
        wrong = next((n for n, number in enumerate(found) if isinstance(number, str)), None)
        if wrong is not None:
            raise TableError(
                f'{name}, line {cells_of[wrong][0]}, column {shown(header[place])}: '
                f'{shown(column[wrong])} {found[wrong]}'
            )
        return np.array(found, float)

    return _Sheet(path, header, np.array([line for line, _ in cells_of]), numbers)


def _are_units(header: Sequence[str], row: Sequence[str]) -> bool:
    """Return whether a row below a header without units has those."""
    bare = all(_split(title)[1] is None for title in header)
    return bare and all(_usual(cell.strip('[]()')) in _KNOWN for cell in row) and any(row)


#: What a spreadsheet or a program of measurement writes where there is no number.
_MISSING = {'', '-', '--', 'nan', 'na', 'n/a', '#n/a', '#nv', 'null', 'none', '#value!', '#wert!'}
#: 1 or 1000, as the reader is used to.
_UNCLEAR = re.compile(r'[-+]?[1-9]\d{0,2}[.,]\d{3}')


#: How a date, or a time of day, begins.
_CLOCK = re.compile(r'\d{4}-\d\d-\d\d|\d{1,2}[./]\d{1,2}[./]\d{4}|\d{1,2}:\d\d')


def _is_number(cell: str) -> bool:
    return not isinstance(_numbers([cell], True)[0], str)


def _are_numbers(cells: Sequence[str]) -> bool:
    """Return whether cells of a row are numbers, or missing ones, and one is a number at least."""
    return all(map(_is_number, cells)) and any(cell.lower() not in _MISSING for cell in cells)


def _numbers(cells: Sequence[str], comma: bool) -> list[float | str]:
    """
    Return the numbers of a column, NaN for missing ones, and of each other cell what is wrong.

    Where a cell has both a comma and a point, the later one is the decimal mark, and the other one
    separates thousands. Else the mark that there is, or the one that `comma` names, is decimal.
    """
    plain = [re.sub(r"[\s'’]", '', cell.replace('−', '-')) for cell in cells]
    used = {mark: [cell for cell in plain if mark in cell] for mark in ',.'}
    both = next((cell for cell in used['.'] if ',' in cell), '')
    decimal = ',' if comma else '.'
    if both:
        decimal = max(',.', key=both.rfind)
    elif not used[decimal]:
        decimal = ',.'.replace(decimal, '')
    if any(cell.count(decimal) > 1 for cell in used[decimal]):
        decimal = ',.'.replace(decimal, '')
    thousands = ',.'.replace(decimal, '')
    grouped = re.compile(rf'[-+]?\d{{1,3}}(\{thousands}\d{{3}})+(\{decimal}\d*)?')
    sure = both or any(cell.count(thousands) > 1 for cell in used[thousands])
    # 1.016 among 998 is rather a thousand
    whole = any(cell.lstrip('+-').isdigit() and len(cell) > 2 for cell in plain)
    unclear = (whole or (decimal == ',' and not comma)) and not sure
    unclear = unclear and bool(used[decimal]) and all(map(_UNCLEAR.fullmatch, used[decimal]))
    found: list[float | str] = []
    for cell in plain:
        if (thousands in cell and not sure) or (unclear and decimal in cell):
            mark = thousands if thousands in cell else decimal
            both_ways = f'{cell.replace(mark, ".")} or {cell.replace(mark, "")}'
            found.append(f'may be {both_ways}: write it without a separator of thousands')
            continue
        try:
            if thousands in cell and not grouped.fullmatch(cell):
                raise ValueError
            number = cell.replace(thousands, '').replace(decimal, '.')
            found.append(math.nan if number.lower() in _MISSING else float(number))
        except ValueError:
            clock = 'a date or a time of day: write seconds, as those since the first row'
            found.append(f'is {clock if _CLOCK.match(cell) else "no number"}')
    return found


def _array_sheet(path: Path, columns: Sequence[tuple[str, str, Any]]) -> _Sheet:
    """Return columns that are arrays already: name, unit and numbers of each."""
    titles = [f'{name} [{unit}]' if unit else name for name, unit, _ in columns]
    rows = min(len(numbers) for _, _, numbers in columns)

    def numbers(place: int) -> Array:
        return np.asarray(columns[place][2][:rows], float)

    return _Sheet(path, titles, np.arange(1, rows + 1), numbers)


#: Quantity and SI unit by the numbers that universal files (dataset 58) have for them.
_UNIVERSAL = {
    8: ('displacement', 'm'),
    11: ('velocity', 'm/s'),
    12: ('acceleration', 'm/s^2'),
    13: ('force', 'N'),
    9: ('force', 'N'),
}


def _reader(path: Path, module: str, kind: str) -> Any:
    """Return the library that reads a kind of file."""
    try:
        return import_module(module)
    except ImportError:
        raise TableError(
            f'{as_line(str(path))}: {module}, which reads {kind}, is not installed: pip install '
            f'{module}, or the package with its extra [uff]; or export the data as CSV'
        ) from None


def _universal_sheet(path: Path) -> _Sheet:
    """Return the functions of time in a universal file."""
    library = _reader(path, 'pyuff', 'universal files')
    try:
        sets = library.UFF(str(path)).read_sets()
    except Exception as error:
        raise TableError(
            f'{as_line(str(path))}: no universal file that can be read: {as_line(str(error))}'
        ) from None
    found: list[tuple[str, str, Any]] = []
    for one in sets if isinstance(sets, list) else [sets]:
        # 1 is a time response
        if one.get('type') != 58 or one.get('func_type') != 1:
            continue
        if not found:
            found.append(('time', 's', one['x']))
        elif len(one['x']) != len(found[0][2]) or np.any(one['x'] != found[0][2]):
            raise TableError(
                f'{as_line(str(path))}: its functions have different instants: export those of '
                'one measurement'
            )
        name, unit = _UNIVERSAL.get(int(one.get('ordinate_spec_data_type') or 0), ('channel', ''))
        own = str(one.get('ordinate_axis_units_lab') or '').strip()
        label = f'{name} {one.get("rsp_node", "")}'.strip()
        found.append((label, own if own not in ('', 'NONE') else unit, np.real(one['data'])))
    if len(found) < 2:
        raise TableError(
            f'{as_line(str(path))}: no function of time (dataset 58, function type 1): export '
            'the time histories'
        )
    return _array_sheet(path, found)


def _labview_sheet(path: Path) -> _Sheet:
    """Return the channels of the first segment of a LabVIEW measurement file."""
    library = _reader(path, 'lvm_read', 'LabVIEW measurement files')
    try:
        segment = library.read(str(path), read_from_pickle=False, dump_file=False)[0]
        data, names = np.asarray(segment['data'], float), segment['Channel names']
        places = [n for n, name in enumerate(names) if name not in ('X_Value', 'Comment')]
        units = [*segment.get('Y_Unit_Label', []), *[''] * len(places)]
        step = float(segment['Delta_X'][0])
        times = data[:, 0] if names[0] == 'X_Value' else np.arange(len(data)) * step
        columns = [(names[n], unit, data[:, n]) for n, unit in zip(places, units, strict=False)]
    except Exception as error:
        raise TableError(
            f'{as_line(str(path))}: no LabVIEW file that can be read: {as_line(str(error))}'
        ) from None
    return _array_sheet(path, [('time', 's', times), *columns])


def _decoded(content: bytes) -> str:
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode('utf-16', 'replace')
    try:
        return content.decode('utf-8-sig')
    except UnicodeDecodeError:
        return content.decode('latin-1')


def _zipped_text(path: Path) -> str:
    """Return the one table of a phone's export."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [
                n for n in archive.namelist() if n.endswith('.csv') and not n.startswith('meta/')
            ]
            if len(names) != 1:
                held = ', '.join(map(shown, names)) or 'none'
                raise TableError(
                    f'{as_line(str(path))}: {len(names)} tables ({held}): unpack it, and give one'
                )
            if archive.getinfo(names[0]).file_size > MOST_BYTES:
                raise TableError(f'{as_line(str(path))}: too large: cut it')
            return _decoded(archive.read(names[0]))
    except zipfile.BadZipFile:
        raise TableError(f'{as_line(str(path))}: no .zip file that can be read') from None


def _sheet(path: Path) -> _Sheet:
    """Return the columns of a file of any kind."""
    if path.stat().st_size > MOST_BYTES:
        raise TableError(f'{as_line(str(path))}: larger than {MOST_BYTES:.0e} bytes: cut it')
    kind = path.suffix.lower()
    if kind in ('.uff', '.unv', '.uf'):
        return _universal_sheet(path)
    if kind == '.lvm':
        return _labview_sheet(path)
    text = _zipped_text(path) if kind == '.zip' else _decoded(path.read_bytes())
    if '\0' in text:
        raise TableError(f'{as_line(str(path))}: no text: export the data as CSV')
    return _text_sheet(path, text)


def _split(title: str) -> tuple[str, str | None]:
    """Return name and unit of a header."""
    match = _HEADER.match(title)
    assert match is not None
    name, unit = match['name'], match['unit']
    bare = _BEHIND.fullmatch(name) if unit is None else None
    if bare is not None and _usual(bare['unit']) in _KNOWN:
        return bare['name'], bare['unit']
    return name, unit


def _units_of(quantity: Quantity) -> str:
    """Return the units that a quantity may have, in words."""
    return ', '.join(
        u or 'none'
        for si in quantity.units
        for u in {**UNITS.get(si, {}), **_OF_TABLES.get(si, {})}
    )


def _named(sheet: _Sheet, key: str, quantity: Quantity, column: str) -> list[int]:
    """Return the places of the columns that may be a quantity, or the one that was named."""
    if not column:
        return [n for n, t in enumerate(sheet.titles) if _is_named(quantity, _split(t)[0])]
    words = column.strip().casefold()
    for wanted in (str.casefold, lambda title: _split(title)[0].casefold()):
        places = [n for n, title in enumerate(sheet.titles) if wanted(title) == words]
        if len(places) == 1:
            return places
    raise TableError(
        f'{as_line(str(sheet.path))}: {"several columns" if places else "no column"} '
        f'{shown(column)} for the {key} among {", ".join(map(shown, sheet.titles))}'
    )


def _found(
    sheet: _Sheet, key: str, quantity: Quantity, *, needed: bool, column: str = ''
) -> tuple[int, str, float] | None:
    """Return place, SI unit and factor of the column of a quantity; None if there is none."""
    named = []
    for place in _named(sheet, key, quantity, column):
        title = sheet.titles[place]
        name, unit = _split(title)
        known = _unit_of(quantity, unit or '')
        if known is None and unit is None and quantity.bare:
            known = quantity.units[0], 1.0
        # A column t [°C] is another one
        if known is not None or needed or len(name) > 1:
            named.append((place, title, unit, known))
    usable = [entry for entry in named if entry[3] is not None]
    if not named:
        return None
    start = as_line(str(sheet.path))
    if not usable:
        _, title, unit, _ = named[0]
        problem = 'has no unit' if unit is None else f'has the unit {shown(unit)}'
        name = quantity.names[0]
        raise TableError(
            f'{start}: column {shown(title)} {problem}: write it behind the name, as '
            f'{name} [{quantity.units[0]}]; known for {key} are {_units_of(quantity)}'
        )
    if len(usable) > 1:
        both = ' and '.join(shown(title) for _, title, _, _ in usable[:2])
        raise ColumnError(key, f'{start}: {both} may both be the {key}: rename the other one')
    place, _, _, known = usable[0]
    assert known is not None
    return place, *known


def read_table(
    path: Path,
    needed: Mapping[str, Quantity],
    optional: Mapping[str, Quantity] | None = None,
    named: Mapping[str, str] | None = None,
) -> MeasuredTable:
    """
    Read a file of measured data.

    Parameters
    ----------
    path : Path
        The file: CSV, a phone's .zip, .uff or .lvm. Lines of a CSV file that begin with #, % or //
        before the header are skipped.
    needed, optional : mapping of str to Quantity
        Columns that must be there, and those that may be.
    named : mapping of str to str, optional
        The header of the column that is meant, with or without its unit, for some of them.

    Returns
    -------
    MeasuredTable
        The columns in SI units.

    Raises
    ------
    TableError
        If the file cannot be read, or a needed column is missing, has no unit or holds something
        else than numbers.
    """
    try:
        sheet = _sheet(path)
    except OSError as error:
        raise TableError(
            f'{as_line(str(path))}: cannot be read ({error.strerror or error}): give the path of '
            'a table'
        ) from error
    columns = {}
    for key, quantity in {**needed, **(optional or {})}.items():
        column = (named or {}).get(key, '')
        found = _found(sheet, key, quantity, needed=key in needed, column=column)
        if found is None:
            if key in needed:
                raise ColumnError(
                    key,
                    f'{as_line(str(path))}: no column for the {key} among '
                    f'{", ".join(map(shown, sheet.titles))}: name it {quantity.names[0]} '
                    f'[{quantity.units[0]}]',
                )
            continue
        place, unit, factor = found
        columns[key] = Column(sheet.numbers(place) * factor, unit, sheet.titles[place], factor)
    if len(sheet.lines) < 2:
        raise TableError(f'{as_line(str(path))}: {len(sheet.lines)} rows: give at least 2')
    return MeasuredTable(path, columns, sheet.lines)


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
        missing = steps[row - 1] > 1.5 * step
        remedy = 'fill the gap, or cut the record there'
        raise table.error(
            key,
            row,
            f'a step of {steps[row - 1]:.4g} s where the others are {step:.4g} s: '
            f'{remedy if missing else "resample it at equal intervals"}',
        )
    return float((len(times) - 1) / (times[-1] - times[0]))
