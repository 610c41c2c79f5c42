"""
Registry of the scalar kernels: functions of floats and named tuples that numba can compile.

A kernel runs as plain Python, so that a program starts without waiting for a compiler.
`compiled` returns the same functions compiled; both forms do the same floating-point operations
in the same order.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from itertools import repeat
from typing import Any, TypeVar

__all__ = ['compiled', 'elementwise', 'kernel']

F = TypeVar('F', bound=Callable[..., Any])

_KERNELS: dict[str, Callable[..., Any]] = {}
_ELEMENTWISE: dict[str, Callable[..., float]] = {}


def _register(name: str) -> None:
    if name in _KERNELS or name in _ELEMENTWISE:
        raise ValueError(f'there are two kernels named {name}; compiled ones share a namespace')


def kernel(function: F) -> F:
    """
    Mark a function as a kernel and return it unchanged.

    Raises
    ------
    ValueError
        If another kernel has the same name.
    """
    _register(function.__name__)
    _KERNELS[function.__name__] = function
    return function


def elementwise(function: Callable[..., float]) -> Callable[..., tuple[float, ...]]:
    """
    Return a kernel that applies a scalar one along its tuple arguments.

    Arguments that are not tuples are passed on to every call.

    Raises
    ------
    ValueError
        If another kernel has the same name.
    """
    _register(function.__name__)
    _ELEMENTWISE[function.__name__] = function

    def along(*arguments: Any) -> tuple[float, ...]:
        return tuple(map(function, *(a if isinstance(a, tuple) else repeat(a) for a in arguments)))

    along.__name__ = function.__name__
    along.__doc__ = function.__doc__
    return along


def _compile_elementwise(scalar: Any) -> Any:
    """Return a compiled function that unrolls over tuples of any length."""
    import numba
    from numba import types as nb

    def along(*arguments: Any) -> Any:
        raise NotImplementedError

    @numba.extending.overload(along)  # type: ignore[untyped-decorator]
    def overloaded(*arguments: Any) -> Any:
        tuples = [a for a in arguments if isinstance(a, nb.BaseTuple)]
        names = ', '.join(f'a{i}' for i in range(len(arguments)))
        rows = ''
        for row in range(len(tuples[0])):
            cells = ', '.join(
                f'a{i}[{row}]' if isinstance(a, nb.BaseTuple) else f'a{i}'
                for i, a in enumerate(arguments)
            )
            rows += f'scalar({cells}), '
        scope: dict[str, Any] = {'scalar': scalar}
        exec(f'def unrolled({names}):\n    return ({rows})', scope)
        unrolled = numba.njit(scope['unrolled'])

        def implementation(*arguments: Any) -> Any:
            return unrolled(*arguments)

        return implementation

    return along


def compiled() -> dict[str, Any]:
    """
    Compile every kernel imported so far with numba.

    Returns
    -------
    dict
        Name and compiled function of each kernel; they compile at their first call.

    Raises
    ------
    ImportError
        If numba is not installed (extra ``compiled``).
    """
    import numba

    namespace: dict[str, Any] = {}
    for function in _KERNELS.values():
        assert isinstance(function, types.FunctionType)
        namespace.update(function.__globals__)
    for name, function in _ELEMENTWISE.items():
        namespace[name] = _compile_elementwise(numba.njit(function))
    for name, function in _KERNELS.items():
        assert isinstance(function, types.FunctionType)
        twin = types.FunctionType(
            function.__code__, namespace, name, function.__defaults__, function.__closure__
        )
        # No fast-math: the operations and their order stay those of the plain kernel.
        namespace[name] = numba.njit(twin)
    return {name: namespace[name] for name in _KERNELS}
