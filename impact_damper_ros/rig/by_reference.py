"""
Constants and arrays that compiled kernels reach through a pointer.

numba passes a named tuple as one argument for each of its numbers, to every function that is not
inlined. `ByReference` is what compiled kernels take in place of a named tuple of constants: the
same attributes, read where they are. numba counts the references to an array, at each use of a
tuple that holds it; `ArrayByReference` is an array without that count. This module imports numba.
"""

from __future__ import annotations

import operator
from array import array
from functools import cache
from struct import pack
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from llvmlite import ir
from numba.core import types as nb
from numba.core.cgutils import create_struct_proxy as make_struct
from numba.core.types import BaseTuple, CPointer, UniTuple  # type: ignore[attr-defined]
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


class _Layout(NamedTuple):
    """
    How a named tuple of constants is stored.

    Attributes
    ----------
    kind : Record
        Its numba type.
    form : str
        Its words as `struct` writes them.
    parts : tuple of (_Layout or None, bool)
        For each entry the layout of a named tuple, and whether the entry is a tuple.
    """

    kind: Record
    form: str
    parts: tuple[tuple[Any, bool], ...]


@cache
def _layout_of(cls: Any) -> _Layout:
    """Return how the named tuples of a class are stored, by their annotations."""
    entries, parts, form = [], [], ''
    for name, annotated in get_type_hints(cls).items():
        in_rows = get_origin(annotated) is tuple
        single = get_args(annotated)[0] if in_rows else annotated
        inner = None if single in _NUMBERS else _layout_of(single)
        kind: Any = inner.kind if inner else _NUMBERS[single]
        of_one = inner.form if inner else 'd' if single is float else 'q'
        entries.append((name, Entry(Rows(kind, len(of_one)) if in_rows else kind, len(form))))
        parts.append((inner, in_rows))
        form += 'q' if in_rows else of_one
    return _Layout(Record(cls.__name__, tuple(entries)), form, tuple(parts))


class ByReference:
    """
    A named tuple of constants in the form that compiled kernels take.

    It has to be kept for as long as they run.

    Parameters
    ----------
    constants : NamedTuple
        The constants. Each entry is annotated as float, int or bool, as a named tuple of such
        entries, or as a tuple, of any length, of one of these.

    Attributes
    ----------
    kind : Record
        Its numba type, which does not depend on the lengths of tuples.
    address : int
        Where it is.
    """

    def __init__(self, constants: Any) -> None:
        self._kept: list[array[float]] = []
        layout = _layout_of(constants.__class__)
        self.kind = layout.kind
        self.address = self._keep(layout.form, self._words(layout, constants))

    def _keep(self, form: str, words: list[Any]) -> int:
        """Return the address of a copy of words."""
        kept = array('d', pack(form, *words))
        self._kept.append(kept)
        return kept.buffer_info()[0]

    def _words(self, layout: _Layout, values: Any) -> list[Any]:
        """Return the words of a named tuple; for a tuple, the address of a copy of its entries."""
        words: list[Any] = []
        for value, (inner, in_rows) in zip(values, layout.parts, strict=True):
            if in_rows:
                rows = [self._words(inner, row) for row in value] if inner else [list(value)]
                form = inner.form * len(rows) if inner else 'd' * len(value)
                words.append(self._keep(form, [word for row in rows for word in row]))
            elif inner:
                words += self._words(inner, value)
            else:
                words.append(value)
        return words


@typeof_impl.register(ByReference)  # type: ignore[untyped-decorator]
def _type_of(held: ByReference, _context: Any) -> Record:
    return held.kind


@unbox(Record)  # type: ignore[untyped-decorator]
def _unboxed(_kind: Record, held: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(held, 'address')
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(c.builder.bitcast(pointer, ir.PointerType(_WORD)))


class Table(nb.Type):
    """Type of an array that is not counted: a pointer to its rows, and how many there are."""

    def __init__(self, kind: Any, columns: int) -> None:
        self.kind = kind
        #: Numbers in a row; 0 for an array of one dimension.
        self.columns = columns
        super().__init__(f'Table({kind}, {columns})')


@register_model(Table)
class _TableModel(models.StructModel):  # type: ignore[misc]
    def __init__(self, manager: Any, kind: Table) -> None:
        super().__init__(manager, kind, [('data', CPointer(kind.kind)), ('rows', nb.intp)])


_PAIR = UniTuple(nb.intp, 2)


def _type_at(table: Any, index: Any) -> Any:
    """Return the types of an index and of what a table has there: a number, or a row."""
    if isinstance(table, Table):
        if isinstance(index, nb.Integer):
            return nb.intp, CPointer(table.kind) if table.columns else table.kind
        if isinstance(index, BaseTuple) and len(index) == 2 and table.columns:
            return _PAIR, table.kind
    return None


@infer_global(len)
class _Length(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        (table,) = arguments
        return signature(nb.intp, table) if isinstance(table, Table) else None


@infer_global(operator.getitem)
class _Taken(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        types = _type_at(*arguments)
        return types and signature(types[1], arguments[0], types[0])


@infer_global(operator.setitem)
class _Set(AbstractTemplate):  # type: ignore[misc]
    def generic(self, arguments: Any, _keywords: Any) -> Any:
        types = _type_at(*arguments[:2])
        return types and signature(nb.none, arguments[0], *types)


@lower_builtin(len, Table)  # type: ignore[untyped-decorator]
def _length(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    return make_struct(sig.args[0])(context, builder, value=arguments[0]).rows


def _place(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    """Return where a table has a number, or where a row of it begins."""
    table = sig.args[0]
    data = make_struct(table)(context, builder, value=arguments[0]).data
    columns = ir.Constant(_WORD, max(1, table.columns))
    if sig.args[1] != _PAIR:
        return builder.gep(data, [builder.mul(arguments[1], columns)], inbounds=True)
    row, column = (builder.extract_value(arguments[1], k) for k in range(2))
    return builder.gep(data, [builder.add(builder.mul(row, columns), column)], inbounds=True)


@lower_builtin(operator.getitem, Table, nb.Any)  # type: ignore[untyped-decorator]
def _taken(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    place = _place(context, builder, sig, arguments)
    return place if isinstance(sig.return_type, CPointer) else builder.load(place)


@lower_builtin(operator.setitem, Table, nb.Any, nb.Any)  # type: ignore[untyped-decorator]
def _set(context: Any, builder: Any, sig: Any, arguments: Any) -> Any:
    builder.store(arguments[2], _place(context, builder, sig, arguments))
    return context.get_dummy_value()


_OF_ARRAYS = {'f': nb.float64, 'i': nb.int64}


class ArrayByReference:
    """
    An array in the form that compiled kernels take.

    They take and set single numbers, without checks. It has to be kept for as long as they run.

    Parameters
    ----------
    array : ndarray of float or int, of 64 bits
        The array, of one or two dimensions, in C order.
    """

    def __init__(self, array: Any) -> None:
        self.array = array
        self.address, self.rows = array.ctypes.data, len(array)
        self.kind = Table(_OF_ARRAYS[array.dtype.kind], array.shape[1] if array.ndim == 2 else 0)


@typeof_impl.register(ArrayByReference)  # type: ignore[untyped-decorator]
def _type_of_array(held: ArrayByReference, _context: Any) -> Table:
    return held.kind


@unbox(Table)  # type: ignore[untyped-decorator]
def _unboxed_array(kind: Table, held: Any, c: Any) -> NativeValue:
    table = make_struct(kind)(c.context, c.builder)
    values = []
    for name in ('address', 'rows'):
        number = c.pyapi.object_getattr_string(held, name)
        values.append(c.pyapi.long_as_longlong(number))
        c.pyapi.decref(number)
    table.data = c.builder.inttoptr(values[0], table.data.type)
    table.rows = values[1]
    return NativeValue(table._getvalue())
