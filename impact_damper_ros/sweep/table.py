"""
The table of a sweep: Apache Parquet, with units, descriptions and the inputs in its metadata.

A name that ends in .csv asks for CSV instead, with units and inputs in comments.

Parquet and not Zarr: a row is a rig, with texts, missing values and lists of different lengths
beside its numbers; it is one file that appears whole or not at all; and every tool that reads
tables reads it. Zarr keeps large regular arrays of numbers, which this is not.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .columns import (
    FAILED,
    Column,
    Row,
    columns_of,
    csv_inputs,
    csv_rows,
    identified,
    place_of,
    write_csv,
)
from .plan import SweepPlan
from .work import Journal

__all__ = [
    'FORMATS',
    'MetadataError',
    'SweepTable',
    'need_pyarrow',
    'stored_inputs',
    'write_table',
]


Array = NDArray[np.float64]

_INPUTS = b'impact_damper_ros.sweep'
#: What pandas shows as the attributes of the table.
_PANDAS = b'PANDAS_ATTRS'
_ROWS_AT_ONCE = 16384
#: How the name of a table ends.
FORMATS = ('.parquet', '.csv')


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() == '.csv'


class MetadataError(ValueError):
    """A file that is no table of a sweep."""


def need_pyarrow() -> None:
    """
    Check that pyarrow is there.

    Raises
    ------
    ImportError
        If it is not; the message says how to install it.
    """
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f'pyarrow, which writes the table, cannot be imported ({error}): install it with '
            '"pip install pyarrow", or the package with its extra [sweep]'
        ) from error


def _schema(plan: SweepPlan, columns: list[Column]) -> Any:
    import pyarrow as pa

    types = {
        'double': pa.float64(),
        'integer': pa.int64(),
        'bool': pa.bool_(),
        'text': pa.string(),
        'doubles': pa.list_(pa.float64()),
        'integers': pa.list_(pa.int8()),
    }
    inputs = plan.inputs()
    attributes = {
        'title': 'Steady states of an impact damper',
        'units': {column.name: column.unit for column in columns},
        'descriptions': {column.name: column.description for column in columns},
        'inputs': inputs,
    }
    return pa.schema(
        [
            pa.field(
                column.name,
                types[column.kind],
                metadata={'unit': column.unit, 'description': column.description},
            )
            for column in columns
        ],
        metadata={_INPUTS: json.dumps(inputs), _PANDAS: json.dumps(attributes)},
    )


def _attractors(plan: SweepPlan, journal: Journal) -> NDArray[np.int64] | None:
    """Return the attractor of each row; None if each rig has but one row."""
    if len(plan.follow.passes) == 1 and not any(axis.initial for axis in plan.axes):
        return None
    return identified(_rigs(plan, journal))


def _rigs(plan: SweepPlan, journal: Journal) -> Iterator[tuple[tuple[float, ...], Row]]:
    """Yield what of each row is the rig, without its initial conditions, and the row."""
    for index in range(plan.size):
        values = plan.point(index).values
        rig = (v for axis, v in zip(plan.axes, values, strict=True) if not axis.initial)
        yield tuple(rig), journal.row(index)


def write_table(plan: SweepPlan, journal: Journal, path: Path) -> None:
    """
    Write the table of a sweep, whole or not at all.

    Parameters
    ----------
    plan : SweepPlan
        The sweep.
    journal : Journal
        Its journal, with all rigs.
    path : Path
        The file; CSV if its name ends in .csv, else Parquet.

    Raises
    ------
    OSError
        If it cannot be written; what stood there before still does.
    """
    columns = columns_of(plan)
    attractors = _attractors(plan, journal)

    def whole(index: int) -> Row:
        row = journal.row(index)
        number = FAILED if not row['ok'] else 0 if attractors is None else int(attractors[index])
        attractor = None if number == FAILED else number
        return {**place_of(plan, plan.point(index)), **row, 'attractor': attractor}

    unfinished = path.with_name(path.name + '.tmp')
    try:
        if _is_csv(path):
            with unfinished.open('w', encoding='utf-8', newline='') as text:
                write_csv(text, plan.inputs(), columns, map(whole, range(plan.size)))
                text.flush()
                os.fsync(text.fileno())
        else:
            _write_parquet(plan, columns, whole, unfinished)
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
    _sync_directory(path.parent)


def _write_parquet(
    plan: SweepPlan, columns: list[Column], whole: Callable[[int], Row], path: Path
) -> None:
    """Write all rows, some at once."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = _schema(plan, columns)
    with path.open('wb') as stream:
        with pq.ParquetWriter(stream, schema, compression='zstd') as writer:
            for first in range(0, plan.size, _ROWS_AT_ONCE):
                last = min(plan.size, first + _ROWS_AT_ONCE)
                rows = [whole(index) for index in range(first, last)]
                arrays = [
                    pa.array([row.get(column.name) for row in rows], field.type)
                    for column, field in zip(columns, schema, strict=True)
                ]
                writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
        stream.flush()
        os.fsync(stream.fileno())


def _sync_directory(path: Path) -> None:
    """Order the disk to keep the names in a directory."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def stored_inputs(path: Path) -> dict[str, Any]:
    """
    Return the inputs that a table was made from.

    Raises
    ------
    MetadataError
        If the file is no table of a sweep.
    OSError
        If it cannot be read.
    """
    if _is_csv(path):
        try:
            return csv_inputs(path)
        except ValueError as error:
            raise MetadataError(f'{path} is no table of a sweep') from error
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        metadata = pq.read_schema(path).metadata or {}
        inputs: dict[str, Any] = json.loads(metadata[_INPUTS])
    except (pa.ArrowInvalid, KeyError, ValueError) as error:
        raise MetadataError(f'{path} is no table of a sweep') from error
    return inputs


def _parquet(path: Path) -> Any:
    import pyarrow.parquet as pq

    return pq.read_table(path)


def _table_of_csv(plan: SweepPlan, path: Path) -> Any:
    import pyarrow as pa

    columns = columns_of(plan)
    schema = _schema(plan, columns)
    try:
        values = csv_rows(path, columns)
        arrays = [pa.array(v, field.type) for v, field in zip(values, schema, strict=True)]
        return pa.Table.from_arrays(arrays, schema=schema)
    except (pa.ArrowInvalid, ValueError) as error:
        raise MetadataError(f'{path} is not whole: {error}') from error


class SweepTable:
    """
    The table of a sweep, read.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    plan : SweepPlan
        The sweep.

    Raises
    ------
    MetadataError
        If the file is no table of a sweep.
    OSError
        If it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.plan = SweepPlan.from_inputs(stored_inputs(path))
        self._table: Any = _table_of_csv(self.plan, path) if _is_csv(path) else _parquet(path)

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def numbers(self, name: str) -> Array:
        """Return a column of numbers; NaN where there is none."""
        column = self._table.column(name).cast('float64')
        numbers: Array = column.to_numpy(zero_copy_only=False)
        return numbers

    def texts(self, name: str) -> list[str | None]:
        """Return a column of texts."""
        texts: list[str | None] = self._table.column(name).to_pylist()
        return texts

    def flags(self, name: str) -> NDArray[np.bool_]:
        """Return a column of true and false; false where there is none."""
        return np.array([value is True for value in self._table.column(name).to_pylist()])

    def lists(self, name: str) -> list[list[float]]:
        """Return a column of lists; empty where there is none."""
        return [value or [] for value in self._table.column(name).to_pylist()]
