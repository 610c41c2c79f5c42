# SPDX-License-Identifier: Apache-2.0
"""
Kernels: functions of numbers and records that run as plain Python or compiled by numba.

A program starts with the plain functions, without waiting for a compiler. `compiled_kernel`
returns them compiled; both do the same floating-point operations in the same order. Module
`records` has the forms of their constants, states and rows.

Compiled code is kept for other processes in a file named by a digest of the kernel and of those
that it calls; a comment is no part of that, nor is what else a program has loaded. Kept code is
loaded without numba.
"""

from __future__ import annotations

import gc
import hashlib
import logging
import os
import pickle
import secrets
import sys
import threading
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache
from inspect import unwrap
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from .kept_kernels import MachineCode, numba_version

F = TypeVar('F', bound=Callable[..., Any])
T = TypeVar('T')
R = TypeVar('R')

#: The first release that compiles the kernels, and the first that was not tried, as in setup.py:
#: private parts of numba that are used below may be others there (`test/motion/test_numba.py`).
NUMBA = (0, 59), (0, 69)
#: How long a program runs without a compiler before it reports that, s.
_PATIENCE_S = 5.0

_KERNELS: dict[str, types.FunctionType] = {}
_INLINE: set[str] = set()


@overload
def kernel(function: F) -> F: ...


@overload
def kernel(
    *, inline: bool = False, twin: Callable[..., Any] | None = None
) -> Callable[[F], F]: ...


def kernel(
    function: F | None = None, *, inline: bool = False, twin: Callable[..., Any] | None = None
) -> F | Callable[[F], F]:
    """Mark a function as a kernel and return it unchanged; its `twin` is compiled in its place."""

    def mark(function: F) -> F:
        name = function.__name__
        if name in _KERNELS:
            raise ValueError(f'there are two kernels named {name}: they share a namespace')
        source = twin or function
        assert isinstance(source, types.FunctionType)
        _KERNELS[name] = source
        if inline:
            _INLINE.add(name)
        return function

    return mark if function is None else mark(function)


@cache
def has_numba() -> bool:
    """Return whether the kernels can be compiled; a program without it reports that."""
    installed = numba_version()
    if installed is None:
        lack = 'numba is not installed'
    else:
        release = tuple(map(int, installed.split('.')[:2]))
        if NUMBA[0] <= release < NUMBA[1]:
            return True
        lack = f'numba {installed} is {"too old" if release < NUMBA[0] else "not known yet"}'
    oldest, unknown = ('.'.join(map(str, release)) for release in NUMBA)
    remedy = f'pip install "numba>={oldest},<{unknown}"'
    text = f'{lack}: long runs take up to ten times as long without it; {remedy}'
    notice = threading.Timer(_PATIENCE_S, logging.getLogger(__package__).warning, [text])
    notice.daemon = True
    notice.start()
    return False


def _below(name: str) -> dict[str, types.FunctionType]:
    """Return a kernel and all those that it calls."""
    found: dict[str, types.FunctionType] = {}
    names = [name]
    while names:
        one = names.pop()
        if one in _KERNELS and one not in found:
            found[one] = function = _KERNELS[one]
            called = {name for code in _codes(function.__code__) for name in code.co_names}
            # An attribute may have the name of a kernel
            names += called & function.__globals__.keys()
    return found


def _digest(kernel_name: str) -> str:
    """Return a digest of what a kernel and those that it calls do, comments and places apart."""
    kernels, parts = _below(kernel_name), list[Any]()
    for name, value in sorted(_namespace(kernels.values()).items()):
        if not callable(value):
            parts.append((name, value))
        elif isinstance(value, type):
            parts.append((name, getattr(value, '_fields', ())))
    for name, function in sorted(kernels.items()):
        code = function.__code__
        constants = [value for value in code.co_consts if value != function.__doc__]
        parts += [name, name in _INLINE, function.__defaults__, constants]
        parts += [code.co_code, code.co_names, code.co_varnames]
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


def _compiler_digest() -> str:
    """Return a digest of compiler and processor, and of how code is linked and kept."""
    import llvmlite
    import llvmlite.binding as llvm

    parts: list[Any] = [sys.version, numba_version(), llvmlite.__version__]
    parts += [llvm.get_host_cpu_name(), sorted(llvm.get_host_cpu_features().items())]
    for maker in (_part_compiler, _entry_compiler, _compiled_only_row, _compile, _kind):
        for code in _codes(unwrap(maker).__code__):
            texts = [value for value in code.co_consts if not isinstance(value, types.CodeType)]
            parts += [code.co_code, code.co_names, texts]
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield the code of a function, and of those inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            yield from _codes(inner)


@cache
def directory() -> Path | None:
    """Return the directory where compiled kernels are kept; None if it cannot be made."""
    places = [os.environ.get('NUMBA_CACHE_DIR'), os.environ.get('XDG_CACHE_HOME'), '~/.cache']
    for base in filter(None, places):
        try:
            path = Path(base).expanduser() / 'impact_damper_ros' / f'kernels-{_compiler_digest()}'
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(path, os.W_OK):
                return path
        except (ImportError, OSError, RuntimeError):
            continue
    return None


def _namespace(kernels: Iterable[types.FunctionType]) -> dict[str, Any]:
    """Return the globals that kernels refer to, in one namespace."""
    namespace: dict[str, Any] = {}
    for function in kernels:
        for name in (name for code in _codes(function.__code__) for name in code.co_names):
            value = function.__globals__.get(name, namespace)
            if value is namespace:
                continue
            if namespace.setdefault(name, value) is not value and namespace[name] != value:
                raise ValueError(
                    f'kernels share a namespace, and {name} is {value!r} in '
                    f'{function.__module__} but {namespace[name]!r} elsewhere: rename one'
                )
    return namespace


@cache
def _part_compiler() -> Any:
    """
    Return the compiler of kernels that only kernels call.

    numba would optimise each of them together with all that it calls, and make machine code of
    it. As parts they are linked only, and what Python calls is optimised once, as a whole.
    """
    from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
    from numba.core.compiler import Compiler

    class Part(JITCodeLibrary):  # type: ignore[misc]
        def add_linking_library(self, library: Any) -> None:
            library._ensure_finalized()
            self._linking_libraries.append(library)

        def finalize(self) -> None:
            self._finalized = True

        def get_pointer_to_function(self, _name: str) -> int:
            return 0

    class Parts(JITCPUCodegen):  # type: ignore[misc]
        _library_class = Part

        def set_env(self, env_name: str, env: Any) -> None:
            pass

    parts = Parts('parts')

    class PartCompiler(Compiler):  # type: ignore[misc]
        def __init__(self, typing: Any, target: Any, _library: Any, *rest: Any) -> None:
            super().__init__(typing, target, parts.create_library('part'), *rest)

    return PartCompiler


@cache
def _entry_compiler(alone: bool) -> Any:
    """
    Return the compiler of kernels that Python calls.

    All kernels that one calls are linked into it once. With `alone` they are visible in that
    kernel only: the compiler then knows which arguments are the same in all calls, and takes
    longer.
    """
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import Compiler

    class Entry(JITCodeLibrary):  # type: ignore[misc]
        def add_linking_library(self, library: Any) -> None:
            if library not in self._linking_libraries:
                super().add_linking_library(library)
                for part in library._linking_libraries:
                    self.add_linking_library(part)

        def _optimize_final_module(self) -> None:
            # numba numbers the functions of each process: parts that two processes kept may have
            # the same name, and the loader would take the first one for both.
            mark = secrets.token_hex(8)
            for function in self._final_module.functions:
                if function.linkage.name == 'linkonce_odr':
                    function.name += mark
                    if alone:
                        function.linkage = 'internal'
            super()._optimize_final_module()

    class EntryCompiler(Compiler):  # type: ignore[misc]
        def __init__(self, typing: Any, target: Any, _library: Any, *rest: Any) -> None:
            library = target.codegen().create_library('entry')
            library.__class__ = Entry
            library.enable_object_caching()
            super().__init__(typing, target, library, *rest)

    return EntryCompiler


@cache
def compiled_namespace() -> dict[str, Any]:
    """Return all kernels, each compiled at its first call, and what they refer to."""
    import numba

    namespace = _namespace(_KERNELS.values())
    namespace['only_row'] = _compiled_only_row()
    for name, function in _KERNELS.items():
        # No fast-math: the operations and their order stay those of the plain kernel.
        twin = types.FunctionType(
            function.__code__, namespace, name, function.__defaults__, function.__closure__
        )
        twin.__module__, twin.__qualname__ = function.__module__, name
        namespace[name] = _once_for_all_values(
            numba.njit(
                twin,
                nogil=True,
                error_model='numpy',
                forceinline=name in _INLINE,
                no_cpython_wrapper=True,
                no_cfunc_wrapper=True,
                _nrt=False,
                pipeline_class=_part_compiler(),
            )
        )
    return namespace


def only_row(rows: Any, k: int) -> Any:
    """Return one row as rows; compiled, their number is known to be 1, and no loop is left."""
    return rows[k : k + 1]


def _compiled_only_row() -> Any:
    """Return `only_row` as an intrinsic of the compiler, for kernels."""
    from numba.core import cgutils, types
    from numba.extending import intrinsic
    from numba.np.arrayobj import make_array, populate_array

    @intrinsic  # type: ignore[untyped-decorator]
    def only(_typing: Any, rows: Any, _k: Any) -> Any:
        def write(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kind = signature.args[0]
            array = make_array(kind)(context, builder, values[0])
            place = cgutils.get_item_pointer(context, builder, kind, array, [values[1]])
            one = make_array(kind)(context, builder)
            count, size = (
                context.get_constant(types.intp, value)
                for value in (1, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
            )
            populate_array(
                one, data=place, shape=[count], strides=[size], itemsize=size, meminfo=None
            )
            return one._getvalue()

        return rows(rows, types.intp), write

    return only


def _once_for_all_values(function: Any) -> Any:
    """Return a compiled function that has one form for all whole numbers, not one for each."""
    from numba.core.types import unliteral

    template = function.get_call_template

    def of_types(arguments: Any, named: Any) -> Any:
        kinds = {name: unliteral(kind) for name, kind in named.items()}
        return template(tuple(map(unliteral, arguments)), kinds)

    function.get_call_template = of_types
    return function


def _compile(name: str, arguments: Sequence[Any]) -> tuple[Any, MachineCode]:
    """Compile a kernel that Python is to call; return it, and its code to be kept."""
    import numba

    function = _KERNELS[name]
    code = function.__code__
    twin = types.FunctionType(code, compiled_namespace(), name, function.__defaults__)
    twin.__module__, twin.__qualname__ = function.__module__, f'{name}_entry'
    loop = numba.njit(
        twin,
        nogil=True,
        error_model='numpy',
        _nrt=False,
        pipeline_class=_entry_compiler('only_row' in code.co_names),
    )
    kinds = tuple(map(numba.typeof, arguments))
    with _without_collection():
        loop.compile(kinds)
    made = loop.overloads[kinds]
    module = made.library._final_module
    needed = [one for one in module.functions if one.is_declaration]
    needed += [one for one in module.global_variables if one.is_declaration]
    names = tuple(one.name for one in needed if not one.name.startswith('llvm.'))
    return loop.get_overload(kinds), MachineCode(
        bytes(made.library._get_compiled_object()),
        made.fndesc.llvm_cpython_wrapper_name,
        made.target_context.get_env_name(made.fndesc),
        names,
    )


@contextmanager
def _without_collection() -> Iterator[None]:
    """Collect no garbage: a compiler has many objects and little garbage, and is 12 % faster."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


#: Kernels compiled or loaded in this process, and the groups whose compilation was reported.
_ENTRIES: dict[tuple[str, str], Any] = {}
_BUSY: dict[tuple[str, str], threading.Lock] = {}
_REPORTED: set[str] = set()


#: Whether kernels are compiled by processes of their own; see `compile_elsewhere`.
_ELSEWHERE = threading.Event()


def compile_elsewhere() -> None:
    """
    Have kernels compiled by processes of low priority, which only keep them, from now on.

    A compiler holds the lock of the interpreter for seconds, in which other threads wait.
    """
    _ELSEWHERE.set()


def _keep_elsewhere(name: str, arguments: Sequence[Any], path: Path) -> None:
    """Have a kernel compiled and kept by another process; if that fails, nothing is kept."""
    import subprocess

    modules = sorted({function.__module__ for function in _below(name).values()})
    program = (
        'import importlib, os, pickle, sys\n'
        'os.nice(10)\n'
        'modules, name, arguments, path = pickle.load(sys.stdin.buffer)\n'
        'list(map(importlib.import_module, modules))\n'
        f'from {__name__} import _compile\n'
        '_compile(name, pickle.loads(arguments))[1].write(path)\n'
    )
    with suppress(TypeError, AttributeError, pickle.PicklingError):
        subprocess.run(
            [sys.executable, '-c', program],
            input=pickle.dumps((modules, name, pickle.dumps(tuple(arguments)), path)),
            stderr=subprocess.DEVNULL,
            check=False,
        )


def _kind(argument: Any) -> str:
    """Return the type of an argument, as far as compiled code depends on it."""
    if isinstance(argument, tuple):
        return f'{type(argument).__name__}({",".join(map(_kind, argument))})'
    if isinstance(argument, np.ndarray | np.void):
        dtype, flags = argument.dtype, argument.flags
        order = 'C' if flags.c_contiguous else 'F' if flags.f_contiguous else 'A'
        shape = argument.ndim, order, flags.writeable
        return f'{type(argument).__name__}{shape}{dtype.descr}{dtype.itemsize}'
    return type(argument).__name__


def _load_kept(name: str, path: Path, log: logging.Logger) -> Any:
    """Return a kernel that is kept; None if it is not, or damaged."""
    try:
        return MachineCode.read(path).load(name)
    except FileNotFoundError:
        return None
    except Exception as error:
        # A file that another program has written may raise anything.
        log.warning(
            'the compiled code kept in %s is damaged (%s): it is compiled again', path, error
        )
        path.unlink(missing_ok=True)
        return None


def compiled_kernel(
    name: str, arguments: Sequence[Any], what: str = 'simulator', form: str = ''
) -> Any:
    """
    Return a kernel compiled for arguments, which have the same types in all calls of one form.

    numba would look at the types of the arguments at each call, which takes longer than a short
    run. Compiled code that cannot be kept, as on a full disk, serves this process; code that was
    kept and is damaged, as by a power cut, is compiled again. A kernel that no process has kept is
    compiled, and `what` it belongs to is reported.
    """
    key = name, form
    if key not in _ENTRIES:
        # Threads that need the same one wait for it; one that another needs may take long.
        with _BUSY.setdefault(key, threading.Lock()):
            if key not in _ENTRIES:
                _ENTRIES[key] = _load_or_compile(name, arguments, what)
    return _ENTRIES[key]


def _load_or_compile(name: str, arguments: Sequence[Any], what: str) -> Any:
    """Return a compiled kernel as it is kept, or compiled and kept."""
    log, place, entry = logging.getLogger(__package__), directory(), None
    if place is not None:
        kinds = hashlib.sha256(_kind(tuple(arguments)).encode()).hexdigest()[:16]
        path = place / f'{name}-{_digest(name)}-{kinds}'
        entry = _load_kept(name, path, log)
    if entry is None:
        if what not in _REPORTED:
            log.warning('compiling the %s, once for each version (about 7 s)', what)
        _REPORTED.add(what)
        if place is not None and _ELSEWHERE.is_set():
            _keep_elsewhere(name, arguments, path)
            entry = _load_kept(name, path, log)
    if entry is None:
        entry, code = _compile(name, arguments)
        try:
            if place is not None:
                code.write(path)
        except OSError as error:
            log.warning(
                'the compiled code cannot be kept (%s): the next process compiles it again',
                error.strerror or error,
            )
    return entry


#: For each kernel, type and dimension of the arrays of its first call, and whether they have no
#: gaps.
_ARRAYS: dict[str, list[tuple[Any, int, bool]]] = {}


def call_kernel(function: Any, *arguments: Any, what: str = 'analysis') -> Any:
    """
    Call the compiled code of a kernel, or the Python function where numba is not installed.

    Raises
    ------
    TypeError
        If arrays differ in type, dimension or contiguity from those of the first call: code
        compiled for these would read other numbers in them.
    """
    if not has_numba():
        with np.errstate(all='ignore'):
            return function(*arguments)
    name = function.__name__
    compiled = compiled_kernel(name, arguments, what)
    arrays = [
        (one.dtype, one.ndim, one.flags.c_contiguous)
        for one in arguments
        if type(one) is np.ndarray
    ]
    if arrays != _ARRAYS.setdefault(name, arrays):
        raise TypeError(
            f'{name} is compiled for arrays (type, dimension, without gaps) {_ARRAYS[name]}, not '
            f'{arrays}: copy them by np.ascontiguousarray'
        )
    return compiled(*arguments)


def on_threads(run: Callable[[T], R], parts: Sequence[T], threads: int | None = None) -> list[R]:
    """Run kernels on the parts of a task in threads; return the results in order."""
    count = min(threads or len(os.sched_getaffinity(0)), len(parts))
    if count < 2:
        return [run(part) for part in parts]
    with ThreadPoolExecutor(count) as pool:
        try:
            return [done.result() for done in [pool.submit(run, part) for part in parts]]
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
