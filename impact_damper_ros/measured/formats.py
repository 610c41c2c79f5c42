# SPDX-License-Identifier: Apache-2.0
"""The formats of measured data: the kinds of files, and the reader of each."""

from __future__ import annotations

import io
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import as_line, quote

from .sheet import Array, Heading, Sheet, TableError, array_sheet, heading
from .text_table import Body, text_sheet

#: Largest file that is read, bytes, and largest one that is read as a whole; read, it takes up to
#: ten times as much memory.
_MOST_BYTES, _MOST_WHOLE = 100_000_000, 40_000_000
#: For the documents: suffixes, and the part of such a file that is read.
SHOWN = {
    '.csv, .txt, any other': 'text with commas, semicolons, tabs or spaces between its columns',
    '.zip': 'the one table in it, as phyphox exports it',
    '.uff, .unv, .uf': 'functions of time (dataset 58) with the units of dataset 164, by `pyuff`',
    '.lvm': 'channels of all segments, each with its own X column',
    '.AT2': 'the acceleration of a PEER record, in g',
}


def content_of(path: Path, most: int = _MOST_BYTES) -> bytes:
    """Return the bytes of a plain file that is not too large, or raise `TableError`."""
    name = as_line(str(path))
    try:
        about = path.stat()
        plain, size = stat.S_ISREG(about.st_mode), about.st_size
        if plain and size <= most:
            return path.read_bytes()
    # A name with a null is no OSError
    except (OSError, ValueError) as error:
        cause = getattr(error, 'strerror', None) or error
        raise TableError(f'{name}: cannot be read ({cause}): give the path of a file') from error
    if not plain:
        raise TableError(f'{name}: not a regular file: give the path of one')
    raise TableError(f'{name}: {size} bytes: give at most {most}; cut it, or leave out columns')


def read_sheet(path: Path) -> Sheet:
    """Return the columns of a file of any format."""
    kind = path.suffix.lower()
    source = as_line(str(path))
    if kind in _WHOLE:
        content_of_kind, reader = _WHOLE[kind]
        content = content_of(path, _MOST_WHOLE)
        try:
            return reader(path, content)
        except TableError:
            raise
        # A damaged file may raise any error.
        except Exception as error:
            raise TableError(
                f'{source}: no {content_of_kind} that can be read: {as_line(str(error))}'
            ) from None
    content = content_of(path)
    if kind == '.zip':
        content = _unpack(source, content)
    return text_sheet(source, content)


def _unpack(source: str, content: bytes) -> bytes:
    """Return the one table of a phone's export."""
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            tables = [
                entry
                for entry in archive.infolist()
                if entry.filename.lower().endswith('.csv')
                and not entry.filename.startswith(('meta/', '__MACOSX/'))
            ]
            if len(tables) == 1 and tables[0].file_size <= _MOST_BYTES:
                with archive.open(tables[0]) as file:
                    return file.read(_MOST_BYTES)
    # A damaged archive raises errors of each of its decoders
    except Exception as error:
        raise TableError(
            f'{source}: no .zip file that can be read: {as_line(str(error))}: unpack it'
        ) from None
    if len(tables) == 1:
        raise TableError(
            f'{source}: {tables[0].file_size} bytes unpacked: give at most {_MOST_BYTES}'
        )
    held = ', '.join(quote(entry.filename) for entry in tables[:10]) or 'none'
    raise TableError(f'{source}: {len(tables)} tables ({held}): unpack it, and give one')


def _strong_motion(path: Path, content: bytes) -> Sheet:
    """Return the acceleration of a PEER record: values in rows below four lines of header."""
    lines = content.decode('latin-1').splitlines()
    count, step = (
        re.search(rf'{key}\s*=\s*([\d.]+(?:E[-+]?\d+)?)', lines[3], re.IGNORECASE)
        for key in ('NPTS', 'DT')
    )
    if count is None or step is None or 'units of g' not in lines[2].lower():
        raise ValueError('lines 3 and 4 do not have UNITS OF G, NPTS= and DT=')
    values = np.array(' '.join(lines[4:]).split(), float)
    if len(values) < int(float(count[1])):
        raise ValueError(f'{len(values)} values of {count[1]}')
    values = values[: int(float(count[1]))]
    times = np.arange(len(values), dtype=np.float64) * float(step[1])
    return array_sheet(
        as_line(str(path)), [(heading('time', 's'), times), (heading('acceleration', 'g'), values)]
    )


#: Quantity, SI unit and powers of length and force by the numbers that universal files have.
_UNIVERSAL = {
    8: ('displacement', 'm', 1, 0),
    11: ('velocity', 'm/s', 1, 0),
    12: ('acceleration', 'm/s^2', 1, 0),
    13: ('force', 'N', 0, 1),
    9: ('force', 'N', 0, 1),
}
_DIRECTIONS = {1: '+X', 2: '+Y', 3: '+Z', -1: '-X', -2: '-Y', -3: '-Z'}


def _general(function: Mapping[str, Any]) -> tuple[str, str, int, int]:
    """Return the quantity that powers of length and force determine: a force, but no motion."""
    length, force = (int(function.get(f'ordinate_{of}_unit_exp') or 0) for of in ('len', 'force'))
    name, unit = ('force', 'N') if (length, force) == (0, 1) else ('channel', '')
    return name, unit, length, force


def _universal(path: Path, _: bytes) -> Sheet:
    """Return the functions of time in a universal file."""
    try:
        library = import_module('pyuff')
    except ImportError:
        raise TableError(
            f'{as_line(str(path))}: pyuff, which reads universal files, is not installed: pip '
            'install pyuff, or the package with its extra [uff]; or export the data as CSV'
        ) from None
    sets = library.UFF(str(path)).read_sets()
    sets = sets if isinstance(sets, list) else [sets]
    # Factors by which values in SI are multiplied
    units = next((one for one in sets if one.get('type') == 164), {'length': 1.0, 'force': 1.0})
    found: list[tuple[Heading, Array]] = []
    for one in sets:
        # 1 is a time response
        if one.get('type') != 58 or one.get('func_type') != 1:
            continue
        points = int(one['num_pts'])
        times, values = np.real(one['x'])[:points], np.real(one['data'])[:points]
        if not found:
            found.append((heading('time', 's'), times))
        elif len(times) != len(found[0][1]) or np.any(times != found[0][1]):
            raise ValueError('its functions have different instants: export one measurement')
        kind = int(one.get('ordinate_spec_data_type') or 0)
        name, unit, length, force = _UNIVERSAL.get(kind) or _general(one)
        own = str(one.get('ordinate_axis_units_lab') or '').strip()
        given = own not in ('', 'NONE')
        if not given:
            values = values / (units['length'] ** length * units['force'] ** force)
        # The place, such as 12:+X, and the label of the axis
        direction = _DIRECTIONS.get(int(one.get('rsp_dir') or 0), '')
        label = str(one.get('ordinate_axis_lab') or '').strip()
        parts = [name, str(one.get('rsp_node') or ''), direction]
        parts += [label] if label not in ('', 'NONE') and kind not in _UNIVERSAL else []
        found.append((heading(' '.join(filter(None, parts)), own if given else unit), values))
    if len(found) < 2:
        raise ValueError(
            'no function of time (dataset 58, function type 1): export the time histories'
        )
    return array_sheet(as_line(str(path)), found)


def _labview(path: Path, content: bytes) -> Sheet:
    """Return the channels of a LabVIEW measurement file, its segments one after the other."""
    lines = content.decode('latin-1').splitlines()
    ends = [n for n, line in enumerate(lines) if line.startswith('***End_of_Header***')]
    starts = [n for n, line in enumerate(lines) if line.startswith('Channels')]
    if not 1 < len(ends) == len(starts) + 1:
        raise ValueError('it has no segment')
    source = as_line(str(path))
    about = dict(line.partition('\t')[::2] for line in lines[: ends[0]])
    separator = ',' if about.get('Separator', '').strip() == 'Comma' else '\t'
    segments: list[tuple[list[Heading], int, int, list[float]]] = []
    for start, end, after in zip(starts, ends[1:], [*starts[1:], len(lines)], strict=True):
        # Cells of a key stand above their columns.
        keys = {line.partition(separator)[0]: line.split(separator) for line in lines[start:end]}
        names = lines[end + 1].rstrip(f' {separator}').split(separator)
        units = [unit.strip() for unit in keys.get('Y_Unit_Label', [])]
        units += [''] * len(names)
        headings = [
            heading('time', 's') if name == 'X_Value' else heading(name, unit)
            for name, unit in zip(names, units, strict=False)
        ]
        if segments and headings != segments[0][0]:
            raise ValueError(f'line {end + 2}: other channels than in the first segment')
        start_and_step = [float(keys[key][1].replace(',', '.')) for key in ('X0', 'Delta_X')]
        segments.append((headings, end + 2, after, start_and_step))
    headings = segments[0][0]
    body = Body(source, headings, separator)

    def read(places: Sequence[int]) -> tuple[list[Array], NDArray[np.int64]]:
        parts, rows = [], []
        for _, begin, end, (first, step) in segments:
            columns, numbers = body.read(lines[begin:end], begin + 1, places)
            for k, place in enumerate(places):
                if headings[place].name == 'time' and np.isnan(columns[k]).all():
                    # X_Columns: No
                    columns[k] = first + step * np.arange(len(numbers), dtype=np.float64)
            parts.append(columns)
            rows.append(numbers)
        return [np.concatenate(c) for c in zip(*parts, strict=True)], np.concatenate(rows)

    return Sheet(source, headings, read, [])


#: Readers of files that are no tables of text.
_WHOLE: dict[str, tuple[str, Callable[[Path, bytes], Sheet]]] = {
    '.uff': ('universal file', _universal),
    '.unv': ('universal file', _universal),
    '.uf': ('universal file', _universal),
    '.lvm': ('LabVIEW file', _labview),
    '.at2': ('PEER record', _strong_motion),
}
