"""
Private parts of numba that `motion/kernels.py` stands on.

A release that moves one of them fails here, by name, and not with whatever LLVM says of it. To try
the next one: `pip install --pre numba`, this file, then the bounds in `NUMBA` and in setup.py.
"""

import inspect

import pytest
from setup_file import setup_says

from impact_damper_ros.motion import kernels
from impact_damper_ros.motion.kept_kernels import numba_version

pytest.importorskip('numba')

import llvmlite.binding as llvm
import numba
from numba import _dynfunc, _helperlib
from numba.core import codegen, compiler, types
from numba.core.types import CompileResultWAP

#: What is called or replaced, and the names of its arguments.
PARTS = {
    codegen.JITCodeLibrary._optimize_final_module: 'self',
    codegen.JITCodeLibrary._finalize_final_module: 'self',
    codegen.JITCodeLibrary.get_pointer_to_function: 'self name',
    codegen.JITCodeLibrary._get_compiled_object: 'self',
    codegen.JITCPUCodegen.__init__: 'self module_name',
    codegen.JITCPUCodegen.create_library: 'self name kwargs',
    codegen.JITCPUCodegen.set_env: 'self env_name env',
    compiler.Compiler.__init__: 'self typingctx targetctx library args return_type flags locals',
    types.unliteral: 'lit_type',
}


def test_signatures():
    assert {part: ' '.join(inspect.signature(part).parameters) for part in PARTS} == PARTS


def test_attributes_of_what_is_compiled():
    assert codegen.JITCPUCodegen._library_class is codegen.JITCodeLibrary
    library = codegen.JITCPUCodegen('one').create_library('two')
    assert library._finalized is False
    function = numba.njit(lambda x: x + 1.0, cache=False)
    assert [*inspect.signature(function.get_call_template).parameters] == ['args', 'kws']
    kinds = (numba.typeof(1.0),)
    function.compile(kinds)
    assert function.get_overload(kinds)(1.0) == 2.0
    made = function.overloads[kinds]
    assert isinstance(made.library._final_module, llvm.ModuleRef)
    assert made.fndesc.llvm_cpython_wrapper_name.startswith('_ZN7cpython')
    assert made.target_context.get_env_name(made.fndesc).startswith('_ZN08NumbaEnv')
    # What is loaded without numba needs these of it, by their files
    assert numba_version() == numba.__version__
    assert 'adapt_ndarray' in _helperlib.c_helpers
    assert {'Environment', 'make_function', 'c_helpers'} <= {*dir(_dynfunc)}
    # That of a law of the user's own, in control/own_law.py
    assert CompileResultWAP(function.get_compile_result(numba.types.float64(*kinds)))


def test_bounds_are_those_of_setup_py():
    (asked,) = (one for one in setup_says('install_requires') if one.startswith('numba'))
    oldest, unknown = ('.'.join(map(str, release)) for release in kernels.NUMBA)
    assert asked == f'numba>={oldest},<{unknown}'
    installed = tuple(map(int, numba.__version__.split('.')[:2]))
    assert kernels.NUMBA[0] <= installed < kernels.NUMBA[1]
