# SPDX-License-Identifier: Apache-2.0
"""
Tables of measured data: files whose header names each column and its unit.

``t [s], x [mm], force [N]``, the export of a phone (``"Time (s)","Acceleration x (m/s^2)"``, also
in its .zip), files with semicolons and decimal commas, and those with the units in a row below the
names are read alike; so are universal files (.uff, .unv) and those of LabVIEW (.lvm) where their
readers are installed. Columns come out in SI units.
"""

from __future__ import annotations

import csv
import math
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .quoting import as_line, shown
from .units import STANDARD_GRAVITY, UNITS

Array = NDArray[np.float64]

#: Largest file that is read, bytes.
MOST_BYTES = 2 * 10**9
#: Units of what only a table has, such as spectral densities, as factors to SI.
_OF_TABLES = {
    '(m/s^2)^2/Hz': {
        'g^2/Hz': STANDARD_GRAVITY**2,
        'g²/Hz': STANDARD_GRAVITY**2,
        '(m/s^2)^2/Hz': 1.0,
        '(m/s²)²/Hz': 1.0,
        'm^2/s^3': 1.0,
    },
    'N^2/Hz': {'N^2/Hz': 1.0, 'N²/Hz': 1.0},
    # Of a logic signal
    'V': {'V': 1.0, 'mV': 1e-3},
}
#: Units of the columns that `simulate_rig` and `replay_run` write without any.
_OF_RIGS = {'time': 's', 'x': 'm', 'force': 'N', 'base': 'm'}
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
                'rise, leave out the rows that repeat, or sort them',
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
        if unit in factors:
            return si, factors[unit]
    return None


def _is_named(quantity: Quantity, name: str) -> bool:
    words = name.casefold()
    return any(words == n or re.match(rf'{re.escape(n)}[\s_.\d]', words) for n in quantity.names)


class _Sheet(NamedTuple):
    """A file as it is: headers, the line of each row, and the reader of a column."""

    path: Path
    titles: list[str]
    lines: NDArray[np.int64]
    numbers: Callable[[int], Array]


def _delimiter(header: str) -> str:
    return max(';\t,', key=header.count) if any(c in header for c in ';\t,') else ','


def _text_sheet(path: Path, text: str) -> _Sheet:
    """Return the columns of a text with separators."""
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
    if body and _are_units(header, body[0][1]):
        units = body.pop(0)[1]
        pairs = zip(header, [*units, *[''] * len(header)], strict=False)
        header = [f'{name} [{unit.strip("[]()")}]' if unit else name for name, unit in pairs]

    if 'primary_velocity' in header:
        header = [f'{t} [{_OF_RIGS[t]}]' if t in _OF_RIGS else t for t in header]

    def numbers(place: int) -> Array:
        cells = ((line, row[place] if place < len(row) else '') for line, row in body)
        found = _numbers(path, header[place], cells, delimiter != ',')
        return np.fromiter(found, float, len(body))

    return _Sheet(path, header, np.array([line for line, _ in body]), numbers)


def _are_units(header: Sequence[str], row: Sequence[str]) -> bool:
    """Return whether a row below a header without units has those."""
    known = {unit for table in (UNITS, _OF_TABLES) for units in table.values() for unit in units}
    bare = all(_HEADER.sub(r'\g<unit>', title) == '' for title in header)
    return bare and all(cell.strip('[]()') in known for cell in row) and any(row)


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
    if kind == '.zip':
        return _text_sheet(path, _zipped_text(path))
    return _text_sheet(path, _decoded(path.read_bytes()))


def _split(title: str) -> tuple[str, str | None]:
    """Return name and unit of a header."""
    match = _HEADER.match(title)
    assert match is not None
    return match['name'], match['unit']


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
        raise TableError(
            f'{start}: {both} may both be the {key}: name the one that is meant, or rename the '
            'other one'
        )
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
                raise TableError(
                    f'{as_line(str(path))}: no column for the {key} among '
                    f'{", ".join(map(shown, sheet.titles))}: name it {quantity.names[0]} '
                    f'[{quantity.units[0]}]'
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
        raise table.error(
            key,
            row,
            f'a step of {steps[row - 1]:.4g} s where the others are {step:.4g} s: fill the gap, '
            'or cut the record there',
        )
    return float((len(times) - 1) / (times[-1] - times[0]))
