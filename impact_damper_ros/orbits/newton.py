"""Newton's method on the impact equations: many starts at once, and one to the last digit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .equations import Array, ImpactEquations

__all__ = ['RESIDUAL_TOLERANCE', 'Root', 'approach_roots', 'polish']

#: Largest relative residual of a root; just beyond a fold the least residual is not zero.
RESIDUAL_TOLERANCE = 1e-12

_POLISH_STEPS = 40
_ROUND_OFF = 4e-16
_SHORTEST_SHARE = 0.2


@dataclass(frozen=True)
class Root:
    """
    A solution of the impact equations.

    Attributes
    ----------
    x, instants : ndarray, shape (N,)
        Displacements of M at the impacts, m, and their instants, s.
    residual : float
        Largest residual, relative to the displacements.
    history : tuple of float
        The residual before each Newton step and at the end.
    """

    x: Array
    instants: Array
    residual: float
    history: tuple[float, ...]


def _allowed(lasts: Array, changes: Array) -> Array:
    """Return the largest part of a step, at most 1, that keeps every duration positive."""
    with np.errstate(divide='ignore', invalid='ignore'):
        parts = np.where(changes < 0.0, -(1.0 - _SHORTEST_SHARE) * lasts / changes, 1.0)
    smallest: Array = np.minimum(parts.min(axis=-1), 1.0)
    return smallest


def approach_roots(
    equations: ImpactEquations, x: Array, instants: Array, steps: int = 60
) -> tuple[Array, Array, Array]:
    """
    Bring many starts close to roots by damped least squares (Levenberg and Marquardt).

    Parameters
    ----------
    equations : ImpactEquations
        The 2N equations.
    x, instants : ndarray, shape (S, N)
        Starts: displacements at the impacts, m, and instants, s.
    steps : int, optional
        Most iterations.

    Returns
    -------
    x, instants : ndarray, shape (S, N)
        What the starts have become.
    residuals : ndarray, shape (S,)
        Their largest residuals.
    """
    n = equations.impacts
    x, instants = x.copy(), instants.copy()
    scale, rate = equations.length, equations.rate
    value, jacobian = equations.residual(x, instants)
    cost = np.einsum('si,si->s', value, value)
    damping = np.full(len(x), 1e-2)
    identity = np.eye(2 * n)
    for _ in range(steps):
        # A start that runs into two impacts at once has blown up, and is left.
        active = (cost > 1e-24) & (cost < 1e12) & (damping < 1e12)
        if not active.any():
            break
        k = np.flatnonzero(active)
        j = jacobian[k]
        normal = np.einsum('sij,sik->sjk', j, j)
        slope = np.einsum('sij,si->sj', j, value[k])
        size = np.einsum('sjj->s', normal) / (2 * n)
        normal += (damping[k] * size)[:, None, None] * identity
        step = -np.linalg.solve(normal, slope[..., None])[..., 0]
        by_time = step[:, n:] / rate
        change = np.roll(by_time, -1, axis=-1) - by_time
        part = _allowed(equations.durations(instants[k]), change)
        x_new = x[k] + part[:, None] * step[:, :n] * scale
        instants_new = instants[k] + part[:, None] * by_time
        value_new, jacobian_new = equations.residual(x_new, instants_new)
        cost_new = np.einsum('si,si->s', value_new, value_new)
        better = cost_new < cost[k]
        kept = k[better]
        x[kept], instants[kept] = x_new[better], instants_new[better]
        value[kept], jacobian[kept] = value_new[better], jacobian_new[better]
        cost[kept] = cost_new[better]
        damping[k] = np.where(better, np.maximum(damping[k] * 0.1, 1e-11), damping[k] * 10.0)
    return x, instants, np.abs(value).max(axis=-1)


def polish(equations: ImpactEquations, x: Array, instants: Array) -> Root | None:
    """
    Run Newton's method from a good start until the residual no longer falls.

    Parameters
    ----------
    equations : ImpactEquations
        The 2N equations.
    x, instants : ndarray, shape (N,)
        The start.

    Returns
    -------
    Root or None
        The root; None if the residual does not fall below `RESIDUAL_TOLERANCE`.
    """
    n = equations.impacts
    history: list[float] = []
    best: tuple[float, Array, Array] | None = None
    stalled = 0
    for _ in range(_POLISH_STEPS):
        value, jacobian = equations.residual(x, instants)
        size = float(np.abs(value).max()) / max(1.0, float(np.abs(x).max()) / equations.length)
        if not np.isfinite(size):
            break
        history.append(size)
        if best is None or size < best[0]:
            stalled = 0 if best is None or size < 0.5 * best[0] else stalled + 1
            best = (size, x, instants)
        else:
            stalled += 1
        if size < _ROUND_OFF or stalled >= 3:
            break
        step = np.linalg.lstsq(jacobian, -value, rcond=1e-14)[0]
        by_time = step[n:] / equations.rate
        change = np.roll(by_time, -1) - by_time
        part = float(_allowed(equations.durations(instants), change))
        x = x + part * step[:n] * equations.length
        instants = instants + part * by_time
    if best is None or best[0] > RESIDUAL_TOLERANCE:
        return None
    return Root(best[1], best[2], best[0], tuple(history))
