# SPDX-License-Identifier: Apache-2.0
"""
Records: the numbers of constants and states, as objects of Python or as records of numpy.

Constants are named tuples and states are dataclasses in plain Python. Compiled kernels take both
as numpy records, made by `pack`, which they read and change where they are. Rows (harmonics,
events, samples) are lists of such objects, or arrays of records.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from typing import Any, get_type_hints

import numpy as np


@cache
def dtype_of(cls: Any) -> np.dtype[Any]:
    """Return the dtype of the records of a class, by the annotations of its fields."""
    kinds: dict[Any, Any] = {float: 'f8', int: 'i8', bool: 'i8'}
    hints = get_type_hints(cls)
    names = [f.name for f in fields(cls)] if is_dataclass(cls) else cls._fields
    entries = [(name, kinds.get(hints[name]) or dtype_of(hints[name])) for name in names]
    return np.dtype(entries)


def rows_of(cls: Any, shape: int | tuple[int, ...], **columns: Any) -> Any:
    """Return records of a class with the given columns."""
    rows = np.zeros(shape, dtype_of(cls))
    for name, column in columns.items():
        rows[name] = column
    return rows


def _itself(values: Any) -> Any:
    return values


@cache
def reader_of(cls: Any) -> Callable[[Any], Any]:
    """Return a function that reads the numbers of an object of a class."""
    if is_dataclass(cls):
        return attrgetter(*(field.name for field in fields(cls)))
    kinds = get_type_hints(cls).values() if hasattr(cls, '_fields') else ()
    readers = [reader_of(kind) for kind in kinds]
    if all(read is _itself for read in readers):
        # numpy reads numbers, and named tuples of them, as they are
        return _itself
    return lambda values: tuple(read(v) for read, v in zip(readers, values, strict=True))


@cache
def _copier_of(cls: Any) -> Callable[[Any], Any]:
    """Return a function that copies a state field by field, without a call for each."""
    lines = ['def copier(state):', 'copy = new(cls)']
    lines += [f'copy.{field.name} = state.{field.name}' for field in fields(cls)]
    names: dict[str, Any] = {'new': object.__new__, 'cls': cls}
    exec('\n    '.join([*lines, 'return copy']), names)
    copier: Callable[[Any], Any] = names['copier']
    return copier


def copy_of(state: Any) -> Any:
    """Return another object with the numbers of a state."""
    cls: Any = type(state)
    return _copier_of(cls)(state)


def pack(state: Any) -> Any:
    """Return a copy of constants or of a state as a record."""
    return pack_rows([state], type(state))[0]


def pack_rows(rows: Sequence[Any], cls: Any) -> Any:
    """Return copies of objects of a class as an array of records."""
    return np.array(list(map(reader_of(cls), rows)), dtype_of(cls))


@cache
def _setter_of(cls: Any) -> Callable[[Any, Any], None]:
    """Return what sets all fields of a state, in a fifth of the time of a loop over them."""
    names = [field.name for field in fields(cls)]
    lines = ['def setter(state, values):', ', '.join(f'state.{n}' for n in names) + ', = values']
    flags = [field.name for field in fields(cls) if type(field.default) is bool]
    lines += [f'state.{name} = bool(state.{name})' for name in flags]
    made: dict[str, Any] = {}
    exec('\n    '.join(lines), made)
    setter: Callable[[Any, Any], None] = made['setter']
    return setter


def unpack(record: Any, state: Any) -> None:
    """Set a state from its record, which compiled kernels have changed."""
    cls: Any = type(state)
    _setter_of(cls)(state, record.item())
