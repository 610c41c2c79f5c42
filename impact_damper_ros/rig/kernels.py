"""
Registry of the scalar kernels: functions of floats and named tuples that numba can compile.

A kernel runs as plain Python, so that a program starts without waiting for a compiler. `compiled`
returns the same functions compiled; both forms do the same floating-point operations in the same
order. Where a kernel takes a tuple with an entry for each harmonic, the compiled one also takes an
array, and is then the same code for any number of harmonics. Constants are a named tuple;
compiled kernels take it `by_reference`, too. A state that kernels change is a dataclass of numbers
marked by `state`; compiled kernels take it as `packed`.

numba caches compiled code by the source file of a function, but a kernel calls kernels of other
files. All of them therefore share one stamp file in place of their sources, in a directory named
by a digest of everything that compiled code depends on; the sources may be read-only. Compiled
code runs with the rights of the user who loads it, so that a directory which belongs to another
user, or holds a file of another user, is not used.
"""

from __future__ import annotations

import hashlib
import logging
import os
import stat
import sys
import tempfile
import threading
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import repeat
from pathlib import Path
from typing import Any, TypeVar, overload

_STAMP = 'kernels.py'
#: Folders of the package that have kernels.
_FOLDERS = ('rig', 'control')
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def _digest() -> str:
    """Return a digest of all sources of kernels and of the versions of the compiler."""
    digest = hashlib.sha256()
    for text in (sys.version, version('numba'), version('llvmlite')):
        digest.update(text.encode() + b'\0')
    package = Path(__file__).parent.parent
    for path in sorted(path for folder in _FOLDERS for path in package.glob(f'{folder}/*.py')):
        digest.update(path.name.encode() + b'\0' + path.read_bytes() + b'\0')
    return digest.hexdigest()[:24]


def _bases() -> Iterator[Path]:
    """Yield the cache directories of the user, the preferred one first."""
    if named := os.environ.get('NUMBA_CACHE_DIR'):
        yield Path(named)
    if named := os.environ.get('XDG_CACHE_HOME'):
        yield Path(named)
    try:
        yield Path.home() / '.cache'
    except RuntimeError:
        return


def _write_stamp(path: Path) -> None:
    """Write the stamp file atomically, with a fixed time: many processes may write it."""
    handle, name = tempfile.mkstemp(dir=path.parent, suffix='.part')
    try:
        with os.fdopen(handle, 'w', encoding='utf-8') as stamp:
            stamp.write(f'# Stands for the sources of the kernels: {path.parent.name}\n')
        os.utime(name, (0, 0))
        Path(name).replace(path)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


def _is_own(path: Path) -> bool:
    """Return whether a file or directory, and a link to it, is the user's own; or gone."""
    user = os.geteuid()
    try:
        return path.lstat().st_uid == user and path.stat().st_uid == user
    except FileNotFoundError:
        return True  # another process has renamed it


def _made_own(path: Path) -> bool:
    """Make a directory that only the user writes to; return whether it is, with its files."""
    path.mkdir(mode=0o700, exist_ok=True)
    if not _is_own(path):
        return False
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & _OTHERS_WRITE:
        path.chmod(mode & ~_OTHERS_WRITE)
    return all(_is_own(inside) for inside in path.iterdir())


def _is_open_to_all(path: Path) -> bool:
    """Return whether any user may replace a directory in it."""
    mode = path.stat().st_mode
    return bool(mode & stat.S_IWOTH) and not mode & stat.S_ISVTX


def stamp_file() -> Path | None:
    """Return the stamp file, beside which numba caches compiled kernels; None without a place."""
    try:
        folder = f'kernels-{_digest()}'
    except (OSError, PackageNotFoundError):
        return None
    for base in _bases():
        path = base / 'impact_damper_ros' / folder / _STAMP
        try:
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            if _is_open_to_all(base) or not all(
                _made_own(place) for place in (path.parent.parent, path.parent)
            ):
                continue
            # numba's own files go here too: it must be writable now.
            _write_stamp(path)
        except OSError:
            continue
        return path
    return None


#: After so long, s, a compilation is reported.
_PATIENCE = 3.0


@contextmanager
def _reported(text: str) -> Iterator[None]:
    """Log what takes long, once it has taken some time."""
    notice = threading.Timer(_PATIENCE, logging.getLogger(__package__).warning, (text,))
    notice.daemon = True
    notice.start()
    try:
        yield
    finally:
        notice.cancel()


@contextmanager
def compiling_alone(stamp: Path | None, form: str) -> Iterator[None]:
    """
    Let one process at a time compile a form of the kernels; the others load its result.

    Where the compiled code cannot be kept, as on a full disk, it serves this process alone.
    """
    text = (
        'compiling the simulator, or waiting for another process that does: once for each '
        'version (some 15 s on an idle core, 25 s under gap control; minutes on a busy machine)'
    )
    try:
        with _reported(text), _locked(stamp, form):
            yield
    except OSError as error:
        logging.getLogger(__package__).warning(
            'the compiled code cannot be kept (%s): the next process compiles it again',
            error.strerror or error,
        )


@contextmanager
def _locked(stamp: Path | None, form: str) -> Iterator[None]:
    if stamp is None:
        yield
        return
    try:
        import fcntl

        lock = os.open(stamp.with_name(f'{form}.lock'), os.O_RDWR | os.O_CREAT, 0o600)
    except (ImportError, OSError):
        yield
        return
    try:
        with suppress(OSError):
            # The lock ends with its process.
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


F = TypeVar('F', bound=Callable[..., Any])

_KERNELS: dict[str, Callable[..., Any]] = {}
_INLINE: set[str] = set()
#: Scalar functions and how many numbers they return.
_ELEMENTWISE: dict[str, tuple[Callable[..., Any], int]] = {}


_RECORDS: list[Any] = []
C = TypeVar('C', bound=type)


def record(cls: C) -> C:
    """Mark a named tuple so that kernels can call its `_replace`, and return it unchanged."""
    _RECORDS.append(cls)
    return cls


_KINDS = {'float': 'f8', 'int': 'i8', 'bool': '?'}


def state(cls: C) -> C:
    """
    Mark a dataclass as a state that kernels change, and return it unchanged.

    Every field is annotated as `float`, `int` or `bool`.
    """
    for entry in fields(cls):
        if entry.type not in _KINDS:
            raise TypeError(f'{cls.__name__}.{entry.name} is of type {entry.type!r}')
    return cls


def packed(state: Any) -> Any:
    """Return a copy of a state for compiled kernels: a record with the same fields."""
    import numpy as np

    entries = fields(state)
    fields_of = [(entry.name, _KINDS[str(entry.type)]) for entry in entries]
    kinds = np.dtype((np.record, fields_of))
    return np.array([tuple(getattr(state, entry.name) for entry in entries)], kinds)[0]


def unpack(record: Any, state: Any) -> None:
    """Set a state to what compiled kernels have made of its record."""
    for entry, value in zip(fields(state), record.item(), strict=True):
        setattr(state, entry.name, value)


def by_reference(constants: Any) -> Any:
    """Return a named tuple of constants in the form that compiled kernels take."""
    from .by_reference import ByReference

    return ByReference(constants)


def array_by_reference(array: Any) -> Any:
    """Return an array of floats or integers in the form that compiled kernels take."""
    from .by_reference import ArrayByReference

    return ArrayByReference(array)


def _register(name: str) -> None:
    if name in _KERNELS or name in _ELEMENTWISE:
        raise ValueError(f'there are two kernels named {name}; compiled ones share a namespace')


@overload
def kernel(function: F) -> F: ...


@overload
def kernel(
    *, inline: bool = False, twin: Callable[..., Any] | None = None
) -> Callable[[F], F]: ...


def kernel(
    function: F | None = None, *, inline: bool = False, twin: Callable[..., Any] | None = None
) -> F | Callable[[F], F]:
    """
    Mark a function as a kernel and return it unchanged.

    With a `twin`, that one is compiled in its place.
    """

    def mark(function: F) -> F:
        _register(function.__name__)
        _KERNELS[function.__name__] = twin or function
        if inline:
            _INLINE.add(function.__name__)
        return function

    return mark if function is None else mark(function)


@overload
def elementwise(function: Callable[..., float]) -> Callable[..., tuple[float, ...]]: ...


@overload
def elementwise(
    *, results: int
) -> Callable[
    [Callable[..., tuple[float, ...]]], Callable[..., tuple[tuple[float, ...], ...]]
]: ...


def elementwise(function: Callable[..., Any] | None = None, *, results: int = 1) -> Any:
    """
    Return a kernel that applies a scalar one along its tuple arguments.

    Arguments that are not tuples are passed on to every call.
    """

    def mark(function: Callable[..., Any]) -> Callable[..., Any]:
        _register(function.__name__)
        _ELEMENTWISE[function.__name__] = function, results

        def along(*arguments: Any) -> tuple[Any, ...]:
            rows = map(function, *(a if isinstance(a, tuple) else repeat(a) for a in arguments))
            if results == 1:
                return tuple(rows)
            return tuple(zip(*rows, strict=True)) or ((),) * results

        along.__name__ = function.__name__
        along.__doc__ = function.__doc__
        return along

    return mark if function is None else mark(function)


def _unrolled(arguments: list[Any], rows: int, results: int) -> str:
    """Return the source of a function that applies `scalar` along tuples of that length."""
    from numba import types as nb

    names = ', '.join(f'a{i}' for i in range(len(arguments)))
    cells = [
        ', '.join(
            f'a{i}' if isinstance(a, nb.Number) else f'a{i}[{row}]'
            for i, a in enumerate(arguments)
        )
        for row in range(rows)
    ]
    lines = [f'    r{row} = scalar({cell})\n' for row, cell in enumerate(cells)]
    if results == 1:
        out = ''.join(f'r{row}, ' for row in range(rows))
    else:
        out = ''.join(
            f'({"".join(f"r{row}[{k}], " for row in range(rows))}), ' for k in range(results)
        )
    return f'def along({names}):\n{"".join(lines)}    return ({out})'


def _looped(arguments: list[Any], results: int) -> str:
    """Return the source of a function that applies `scalar` along arrays."""
    from numba import types as nb

    names = ', '.join(f'a{i}' for i in range(len(arguments)))
    arrays = [i for i, a in enumerate(arguments) if isinstance(a, nb.Array)]
    cells = ', '.join(
        f'a{i}' if isinstance(a, nb.Number) else f'a{i}[row]' for i, a in enumerate(arguments)
    )
    outs = [f'out{k}' for k in range(results)]
    made = ''.join(f'    {out} = empty(len(a{arrays[0]}))\n' for out in outs)
    return (
        f'def along({names}):\n'
        f'{made}'
        f'    for row in range(len(out0)):\n'
        f'        {", ".join(f"{out}[row]" for out in outs)} = scalar({cells})\n'
        f'    return {", ".join(outs)}'
    )


def _compile_elementwise(scalar: Any, results: int) -> Any:
    """Return a compiled function along tuples, unrolled, or arrays."""
    import numba
    import numpy as np
    from numba import types as nb

    def along(*arguments: Any) -> Any:
        raise NotImplementedError

    @numba.extending.overload(along)  # type: ignore[untyped-decorator]
    def overloaded(*arguments: Any) -> Any:
        tuples = [a for a in arguments if isinstance(a, nb.BaseTuple)]
        if tuples:
            source = _unrolled(list(arguments), len(tuples[0]), results)
        else:
            source = _looped(list(arguments), results)
        scope: dict[str, Any] = {'scalar': scalar, 'empty': np.empty}
        exec(source, scope)
        inner = numba.njit(scope['along'], **_FROM_COMPILED_CODE)

        def implementation(*arguments: Any) -> Any:
            return inner(*arguments)

        return implementation

    return along


@cache
def _compile_replace() -> None:
    """Let compiled code call `_replace` of the named tuples marked by `record`."""
    import numba
    from numba import types as nb

    names = dict.fromkeys(name for record in _RECORDS for name in record._fields)
    given = ', '.join(f'{name}=None' for name in names)

    def made(record: Any, values: dict[str, Any]) -> Any:
        kept = {n for n, kind in values.items() if kind is None or isinstance(kind, nb.Omitted)}
        fields = [f'record.{n}' if n in kept else n for n in record.fields]
        scope: dict[str, Any] = {'make': record.instance_class}
        exec(f'def replace(record, {given}):\n    return make({", ".join(fields)})', scope)
        return scope['replace']

    scope: dict[str, Any] = {'made': made}
    exec(f'def replace(record, {given}):\n    return made(record, locals())', scope)
    method = numba.extending.overload_method(
        nb.BaseNamedTuple,
        '_replace',
        jit_options={'forceinline': True, **_FROM_COMPILED_CODE},
    )
    method(scope['replace'])


@cache
def stamp(form: str = '') -> Path | None:
    """Return the stamp file of this process, or the one of a form of the kernels."""
    if not form:
        return stamp_file()
    path = stamp()
    if path is None:
        return None
    path = path.with_name(f'{path.stem}_{form}{path.suffix}')
    try:
        _write_stamp(path)
    except OSError:
        return None
    return path


def _share(function: types.FunctionType, namespace: dict[str, Any]) -> None:
    """Add the globals that a kernel refers to to the namespace of all kernels."""
    for name in function.__code__.co_names:
        if name in function.__globals__:
            value = function.__globals__[name]
            if namespace.setdefault(name, value) is not value and namespace[name] != value:
                raise ValueError(
                    f'kernels share a namespace, and {name} is {value!r} in '
                    f'{function.__module__} but {namespace[name]!r} elsewhere: rename one'
                )


#: For a function that only compiled code calls: half of the time of compiling it goes into what
#: lets Python call it.
_FROM_COMPILED_CODE = {'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}


def compiled(
    *called: str, given: dict[str, Callable[..., Any]] | None = None, form: str | None = None
) -> tuple[Any, ...]:
    """
    Compile kernels with numba.

    Parameters
    ----------
    called : str
        Names of the kernels that Python is to call, and of no others.
    given : dict of str to callable, optional
        Functions that take the place of kernels, with globals of their own.
    form : str, optional
        Name for what is given, by which the compiled kernels are kept from one process to the
        next; if there is none, they are not kept.

    Returns
    -------
    tuple of function
        The called kernels.
    """
    import numba

    _compile_replace()
    namespace: dict[str, Any] = {}
    for function in _KERNELS.values():
        assert isinstance(function, types.FunctionType)
        _share(function, namespace)
    for name, (function, results) in _ELEMENTWISE.items():
        assert isinstance(function, types.FunctionType)
        scalar_kernel = numba.njit(function, forceinline=True, **_FROM_COMPILED_CODE)
        namespace[name] = _compile_elementwise(scalar_kernel, results)
    for name, function in _KERNELS.items():
        assert isinstance(function, types.FunctionType)
        code = function.__code__
        inner = name not in called
        keep = None if inner or form is None else stamp(form)
        if keep is not None:
            code = code.replace(co_filename=str(keep))
        twin = types.FunctionType(
            code, namespace, name, function.__defaults__, function.__closure__
        )
        twin.__module__ = function.__module__
        # LLVM finds functions by name and number. Two forms that were compiled by different
        # processes may share both, and a process that loads them would run the first for both.
        twin.__qualname__ = f'{name}_{form}' if form else name
        # No fast-math: the operations and their order stay those of the plain kernel.
        namespace[name] = numba.njit(
            twin,
            nogil=True,
            error_model='numpy',
            forceinline=name in _INLINE,
            cache=keep is not None,
            **(_FROM_COMPILED_CODE if inner else {}),
        )
    for name, function in (given or {}).items():
        is_plain = isinstance(function, types.FunctionType)
        namespace[name] = numba.njit(function, error_model='numpy') if is_plain else function
    return tuple(namespace[name] for name in called)
