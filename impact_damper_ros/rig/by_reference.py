"""
Constants that compiled kernels read through a pointer.

numba passes a named tuple as one argument for each of its numbers, to every function that is not
inlined. `ByReference` is what compiled kernels take in place of a named tuple of constants: the
same attributes, read where they are. This module imports numba.
"""

from __future__ import annotations

import operator
from functools import cache
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from llvmlite import ir
from numba.core import types as nb
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_global,
    signature,
)
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

_WORD = ir.IntType(64)
#: Types of entries of one word.
_NUMBERS = {bool: nb.boolean, int: nb.int64, float: nb.float64}


class Entry(NamedTuple):
    """
    An entry of a record.

    Attributes
    ----------
    kind : numba type
        Type of its value.
    word : int
        Its first word, counted from the start of the record.
    """

    kind: Any
    word: int


class Record(nb.Type):
    """Type of a pointer to a record, with the entries of a named tuple."""

    def __init__(self, name: str, entries: tuple[tuple[str, Entry], ...]) -> None:
        self.entries = dict(entries)
        described = ', '.join(f'{n}: {e.kind}@{e.word}' for n, e in entries)
        super().__init__(f'{name}({described})')


class Rows(nb.Type):
    """Type of a pointer to the entries of a tuple, each of so many words."""

    def __init__(self, kind: Any, words: int) -> None:
        self.kind = kind
        self.words = words
        super().__init__(f'Rows({kind}, {words})')


@register_model(Record)
@register_model(Rows)
class _PointerModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.PointerType(_WORD))


def _value(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """Return the value at a place: of a record its address, of all else what is stored there."""
    if isinstance(kind, Record):
        return place
    stored = _WORD if kind == nb.boolean else context.get_value_type(kind)
    value = builder.load(builder.bitcast(place, stored.as_pointer()))
    # Constants: a store elsewhere does not change them.
    value.set_metadata('invariant.load', builder.module.add_metadata([]))
    if kind == nb.boolean:
        return builder.icmp_unsigned('!=', value, ir.Constant(_WORD, 0))
    return value


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = Record

    def generic_resolve(self, record: Record, name: str) -> Any:
        entry = record.entries.get(name)
        return entry and entry.kind


@lower_getattr_generic(Record)  # type: ignore[untyped-decorator]
def _attribute(context: Any, builder: Any, record: Record, pointer: Any, name: str) -> Any:
    entry = record.entries[name]
    place = builder.gep(pointer, [ir.Constant(_WORD, entry.word)], inbounds=True)
    return _value(context, builder, entry.kind, place)


@infer_global(operator.getitem)
class _Items(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        rows, index = arguments
        if isinstance(rows, Rows) and isinstance(index, nb.Integer):
            return signature(rows.kind, rows, nb.intp)
        return None


@lower_builtin(operator.getitem, Rows, nb.Integer)  # type: ignore[untyped-decorator]
def _item(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    pointer, index = arguments
    rows = sig.args[0]
    word = builder.mul(index, ir.Constant(_WORD, rows.words))
    return _value(context, builder, rows.kind, builder.gep(pointer, [word], inbounds=True))


@cache
def _types_of(cls: Any) -> dict[str, Any]:
    """Return the annotated types of the entries of a named tuple."""
    return get_type_hints(cls)


class ByReference:
    """
    A named tuple of constants in the form that compiled kernels take.

    It has to be kept for as long as they run.

    Parameters
    ----------
    constants : NamedTuple
        The constants. Each entry is a float, int or bool, as annotated, a named tuple of such
        entries, or a tuple of floats or of equal named tuples; of any length, but not empty.

    Attributes
    ----------
    kind : Record
        Its numba type, which does not depend on the lengths of tuples.
    address : int
        Where it is.
    """

    def __init__(self, constants: Any) -> None:
        self._kept: list[Any] = []
        self.kind, words = self._record(constants)
        self.address = self._keep(words)

    def _keep(self, words: list[float | int]) -> int:
        """Return the address of a copy of words."""
        kept = np.empty(len(words))
        of_integers = kept.view('i8')
        for k, word in enumerate(words):
            if isinstance(word, float):
                kept[k] = word
            else:
                of_integers[k] = word
        self._kept.append(kept)
        return int(kept.ctypes.data)

    def _record(self, values: Any) -> tuple[Record, list[float | int]]:
        """Return the type of a named tuple and its words."""
        entries: list[tuple[str, Entry]] = []
        words: list[float | int] = []
        for name, annotated in _types_of(values.__class__).items():
            value = getattr(values, name)
            kind: Any
            more: list[float | int]
            if hasattr(value, '_asdict'):
                kind, more = self._record(value)
            elif isinstance(value, tuple):
                kind, address = self._rows(value)
                more = [address]
            else:
                kind, more = _NUMBERS[annotated], [annotated(value)]
            entries.append((name, Entry(kind, len(words))))
            words += more
        return Record(type(values).__name__, tuple(entries)), words

    def _rows(self, values: tuple[Any, ...]) -> tuple[Rows, int]:
        """Return the type of the entries of a tuple and the address of a copy of them."""
        if not hasattr(values[0], '_asdict'):
            return Rows(nb.float64, 1), self._keep([float(value) for value in values])
        records = [self._record(value) for value in values]
        kind, first = records[0]
        return Rows(kind, len(first)), self._keep([word for _, row in records for word in row])


@typeof_impl.register(ByReference)  # type: ignore[untyped-decorator]
def _type_of(held: ByReference, _context: Any) -> Record:
    return held.kind


@unbox(Record)  # type: ignore[untyped-decorator]
def _unboxed(_kind: Record, held: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(held, 'address')
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.bitcast(pointer, ir.PointerType(_WORD)))
