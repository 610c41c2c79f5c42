# SPDX-License-Identifier: Apache-2.0
"""
Compiled kernels in files, loaded without numba, whose import takes longer than most commands.

A file has the machine code of one kernel as numba compiled it, with the function that takes
Python's arguments. LLVM loads it; of numba it needs its two extension modules in C alone.
"""

from __future__ import annotations

import builtins
import ctypes
import hashlib
import importlib.util
import marshal
import os
import sys
import threading
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

_LOADING = threading.Lock()


class MachineCode(NamedTuple):
    """A compiled kernel: its code, the names in it, and what it needs from elsewhere."""

    code: bytes
    function: str  # that takes Python's arguments
    environment: str  # the variable that holds what numba calls its environment
    symbols: tuple[str, ...]

    def write(self, path: Path) -> None:
        """Write a file, whole or not at all."""
        content = marshal.dumps(tuple(self))
        draft = path.with_name(f'{path.name}.{os.getpid()}.part')
        try:
            draft.write_bytes(hashlib.sha256(content).digest() + content)
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)

    @classmethod
    def read(cls, path: Path) -> MachineCode:
        """Read a file; raise ValueError if it is damaged."""
        content = path.read_bytes()
        if hashlib.sha256(content[32:]).digest() != content[:32]:
            raise ValueError('its checksum does not match')
        return cls(*marshal.loads(content[32:]))

    def load(self, name: str) -> Any:
        """Return the function; raise ValueError if a symbol that it needs is missing."""
        import llvmlite.binding as llvm

        with _LOADING:
            engine = _engine()
            for symbol in self.symbols:
                if not llvm.address_of_symbol(symbol):
                    llvm.add_symbol(symbol, _address(symbol))
            engine.add_object_file(llvm.ObjectFileRef.from_data(self.code))
            engine.finalize_object()
            environment = _part_of_numba('_dynfunc').Environment({})
            place = engine.get_global_value_address(self.environment)
            ctypes.c_void_p.from_address(place).value = id(environment)
            function = engine.get_function_address(self.function)
        kept = environment, engine
        return _part_of_numba('_dynfunc').make_function(
            sys.modules[__name__], name, '', function, environment, kept
        )


@cache
def _engine() -> Any:
    """Return the engine of LLVM that loads machine code into this process."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(''), machine)


def numba_version() -> str | None:
    """Return the version of numba; None if it is not installed."""
    if importlib.util.find_spec('numba') is None:
        return None
    # Metadata of distributions would take longer than all else
    installed: str = _part_of_numba('_version').get_versions()['version']
    return installed


def _part_of_numba(name: str) -> ModuleType:
    """Return a module of numba that needs no other, without the rest of numba."""
    full = f'numba.{name}'
    if full not in sys.modules:
        package = importlib.util.find_spec('numba')
        assert package is not None
        spec = PathFinder.find_spec(full, package.submodule_search_locations)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        # numba uses this module if it compiles something later
        sys.modules[full] = module
    return sys.modules[full]


def _address(symbol: str) -> int:
    """Return the address of a symbol to which machine code of numba refers."""
    if symbol == '_Py_NoneStruct':
        return id(None)
    kind, _, name = symbol.partition('_')
    if kind == 'PyExc':
        return id(getattr(builtins, name))
    for module in ('_helperlib', '_dynfunc'):
        if kind == 'numba' and name in (helpers := _part_of_numba(module).c_helpers):
            return int(helpers[name])
    raise ValueError(f'{symbol} is not known')
