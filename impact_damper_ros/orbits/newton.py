"""Roots of the equations of periodic motion, by MINPACK's Levenberg-Marquardt method."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, TypeAlias

import numpy as np

from impact_damper_ros.rig import ParameterError

from .equations import Array

__all__ = ['Solution', 'System', 'solve']


#: Residual and Jacobian at a point; `ArithmeticError` or `ParameterError` where there are none.
System: TypeAlias = Callable[[Array], tuple[Array, Array]]

#: The residual where there is none: a step there is taken back.
_NOWHERE = 1e9
#: A residual that is small enough, a step that is, and most evaluations.
_ENOUGH = 1e-15
_OPTIONS = {'xtol': 1e-14, 'ftol': 1e-16, 'gtol': 0.0, 'maxiter': 40}


class _EnoughError(Exception):
    """The residual is small enough."""


class Solution(NamedTuple):
    """Where the residual is least, how large it is, and its history from the start on."""

    unknowns: Array
    residual: float
    history: tuple[float, ...]


def solve(system: System, start: Array) -> Solution:
    """
    Solve n equations from a start near a root, to round-off.

    The Jacobian may be singular at the root. Whether the least residual reached is a root is
    for the caller to judge.
    """
    # Not needed where all motions come from a scan, and slow to import
    from scipy.optimize import root

    history: list[float] = []
    best = (np.inf, start)

    def guarded(unknowns: Array) -> tuple[Array, Array]:
        nonlocal best
        try:
            residual, jacobian = system(unknowns)
        except (ArithmeticError, ParameterError):
            residual = np.full(1, np.nan)
        size = float(np.abs(residual).max())
        if not np.isfinite(size) or not np.isfinite(jacobian).all():
            return np.full(len(start), _NOWHERE), np.eye(len(start))
        if size < best[0]:
            best = (size, unknowns.copy())
            history.append(size)
            if size < _ENOUGH:
                raise _EnoughError
        return residual, jacobian

    if np.isfinite(start).all():
        with suppress(_EnoughError):
            root(guarded, start, jac=True, method='lm', options=_OPTIONS)
    return Solution(best[1], best[0], tuple(history) or (np.inf,))
