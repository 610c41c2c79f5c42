"""
The table of a sweep as CSV, for spreadsheets and for tools without Parquet.

Lines that begin with # come first: the inputs of the sweep and the units of its columns, as JSON.
What is not known is an empty cell, a list is written as JSON.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import IO, Any

from .sweep_columns import Column, Row

__all__ = ['csv_inputs', 'csv_rows', 'write_csv']

_TITLE = '# Steady states of an impact damper. In pandas: read_csv(file, comment="#")'
_INPUTS = '# impact_damper_ros.sweep: '
_UNITS = '# units: '
_LISTS = ('doubles', 'integers')


def write_csv(
    stream: IO[str], inputs: dict[str, Any], columns: Sequence[Column], rows: Iterable[Row]
) -> None:
    """
    Write a table.

    Parameters
    ----------
    stream : text file
        Where to; opened with ``newline=''``.
    inputs : dict
        The inputs of the sweep.
    columns : sequence of Column
        The columns.
    rows : iterable of Row
        The rows, in order.
    """
    units = {column.name: column.unit for column in columns if column.unit}
    stream.write(f'{_TITLE}\n{_INPUTS}{json.dumps(inputs)}\n{_UNITS}{json.dumps(units)}\n')
    table = csv.writer(stream, lineterminator='\n')
    table.writerow([column.name for column in columns])
    table.writerows([_cell(row.get(column.name)) for column in columns] for row in rows)


def _cell(value: Any) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value) if isinstance(value, list) else str(value)


def csv_inputs(path: Path) -> dict[str, Any]:
    """
    Return the inputs that a table was made from.

    Raises
    ------
    ValueError
        If the file is no table of a sweep.
    OSError
        If it cannot be read.
    """
    with path.open(encoding='utf-8', newline='') as stream:
        for line in stream:
            if line.startswith(_INPUTS):
                inputs: dict[str, Any] = json.loads(line.removeprefix(_INPUTS))
                return inputs
            if not line.startswith('#'):
                break
    raise ValueError(f'{path} is no table of a sweep')


def csv_rows(path: Path, columns: Sequence[Column]) -> list[list[Any]]:
    """
    Return the values of a table, column by column.

    Raises
    ------
    ValueError
        If a row is not one of such a table.
    OSError
        If it cannot be read.
    """
    with path.open(encoding='utf-8', newline='') as stream:
        csv.field_size_limit(1 << 30)  # the state of rig and control is a long text
        table = csv.reader(line for line in stream if not line.startswith('#'))
        if next(table, None) != [column.name for column in columns]:
            raise ValueError(f'{path} has not the columns of its sweep')
        return [
            [_value(column, cell) for cell in cells]
            for column, cells in zip(columns, zip(*table, strict=True), strict=True)
        ]


def _value(column: Column, cell: str) -> Any:
    if column.kind == 'text':
        return cell or None
    if not cell:
        return None
    if column.kind == 'bool':
        return cell == 'true'
    if column.kind in _LISTS:
        return json.loads(cell)
    return int(cell) if column.kind == 'integer' else float(cell)
