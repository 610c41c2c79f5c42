# SPDX-License-Identifier: Apache-2.0
"""
Least squares under conditions: Gauss-Newton steps with Lagrange multipliers.

Each step minimises the linearised residuals where the linearised conditions hold, exactly. A
condition joins neighbouring nodes, so that the system is a band but for the shared unknowns, which
are eliminated last. The same system gives the covariance of the estimates and the multiplier of
each condition, from which follows the fall of the sum of squares without it [1]_.

References
----------
.. [1] S. D. Silvey, "The Lagrangian multiplier test", Ann. Math. Statist. 30 (1959), 389-407.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg.lapack import dgbtrf, dgbtrs

from .nodes import V, W
from .shooting import Equations, Shooting
from .vibration import Array

#: Weight of the squares of the conditions where steps are judged.
_WEIGHT = 100.0
_TRIES = 4
#: Parts of a step that are tried before it is damped.
_PARTS = (1.0, 0.5, 0.25, 0.1, 0.03)
#: Largest condition at which steps may end, in standard deviations of the data.
_EXACT = 1e-3
_LEAST_DAMPING, _FIRST_DAMPING = 1e-11, 1e-9
#: Regularisation: redundant conditions leave the system regular.
_GIVE = 1e-13
#: Largest growth of restitution over speed, v/v_c, after a step.
_MOST_GROWTH = 0.1


class FitSolution(NamedTuple):
    """
    The result of Gauss-Newton steps.

    Attributes
    ----------
    unknowns : ndarray
        All unknowns.
    equations : Equations
        The equations at the solution.
    """

    unknowns: Array
    equations: Equations

    @property
    def broken(self) -> float:
        """Largest condition, in standard deviations of the data."""
        return float(np.abs(self.equations.condition).max(initial=0.0))


class System:
    """The linear system of one step."""

    def __init__(self, equations: Equations, damping: float) -> None:
        rates, laws = equations.residual_rates, equations.condition_rates
        size, count = rates.shape[1], len(equations.condition)
        squares = np.bincount(rates.indices, rates.data**2, size)
        scale = np.sqrt(squares + 1e-6 * np.bincount(laws.indices, laws.data**2, size))
        scale[scale == 0.0] = 1.0
        self.scale, self._size, self._count = scale, size, count
        self._rates, self._laws = _scale_columns(rates, scale), _scale_columns(laws, scale)
        hessian, below = (self._rates.T @ self._rates).tocoo(), self._laws.tocoo()
        diagonal = damping * (squares / scale**2 + 1e-4)
        both = np.arange(size + count)
        self._order = _band_order(equations)
        place = np.empty_like(both)
        place[self._order] = both
        row = place[np.concatenate([hessian.row, below.row + size, below.col, both])]
        column = place[np.concatenate([hessian.col, below.col, below.row + size, both])]
        entries = [hessian.data, below.data, below.data, diagonal, np.full(count, -_GIVE)]
        self._factor(row, column, np.concatenate(entries), size + count - equations.shared)

    def _factor(
        self, row: NDArray[np.int64], column: NDArray[np.int64], entries: Array, inner: int
    ) -> None:
        """Factor the band of the first unknowns, and the Schur complement of the others."""
        in_band = (row < inner) & (column < inner)
        apart = row[in_band] - column[in_band]
        self._reach = reach = int(apart.max())
        depth, last = 3 * reach + 1, int(column.max()) + 1 - inner
        at = column[in_band] * depth + 2 * reach + apart
        band = np.bincount(at, entries[in_band], depth * inner).reshape(inner, depth).T
        self._band, self._pivots, info = dgbtrf(band, reach, reach, overwrite_ab=True)
        if info > 0:
            raise np.linalg.LinAlgError('the flights do not determine their states')
        beside = column >= inner
        at = row[beside] * last + column[beside] - inner
        sums = np.asarray(np.bincount(at, entries[beside], (inner + last) * last), np.float64)
        edge = sums.reshape(-1, last)
        self._edge, corner = edge[:inner], edge[inner:]
        self._through = self._solve_band(self._edge)
        self._corner = corner - self._edge.T @ self._through

    def _solve_band(self, right: Array) -> Array:
        found, _ = dgbtrs(self._band, self._reach, self._reach, right, self._pivots)
        return np.asarray(found)

    def _solve(self, right: Array) -> Array:
        """Return the solution of the system for right-hand sides, shape (n,) or (n, k)."""
        ordered, inner = right[self._order], len(self._edge)
        first = self._solve_band(ordered[:inner])
        last = np.linalg.solve(self._corner, ordered[inner:] - self._edge.T @ first)
        found = np.empty_like(right)
        found[self._order] = np.concatenate([first - self._through @ last, last])
        return found

    def step(self, equations: Equations) -> tuple[Array, Array]:
        """Return the step, and the multipliers of the conditions."""
        right = np.concatenate([-(self._rates.T @ equations.residual), -equations.condition])
        found = self._solve(right)
        return found[: self._size] / self.scale, found[self._size :]

    def covariance(self, columns: NDArray[np.int64]) -> Array:
        """Return the covariance of some unknowns."""
        right = np.zeros((self._size + self._count, len(columns)))
        right[columns, np.arange(len(columns))] = 1.0 / self.scale[columns]
        found = self._solve(right)[columns] / self.scale[columns, None]
        covariance: Array = 0.5 * (found + found.T)
        return covariance

    def deviations(self, rates: sparse.csr_array) -> Array:
        """Return standard deviations of quantities, whose derivatives are rows of a matrix."""
        right = np.zeros((self._size + self._count, rates.shape[0]))
        right[: self._size] = rates.multiply(1.0 / self.scale).toarray().T
        found = self._solve(right)
        variances: Array = (right * found).sum(0)
        deviations: Array = np.sqrt(np.maximum(variances, 0.0))
        return deviations

    def profile(self, residual_rates: Array, condition_rates: Array) -> tuple[Array, Array]:
        """
        Return the information on further unknowns, with the others fitted again.

        The results are their information matrix, and the changes of all others with them.
        """
        right = np.vstack([self._rates.T @ residual_rates, condition_rates])
        found = self._solve(right)
        information: Array = residual_rates.T @ residual_rates - right.T @ found
        return information, -found[: self._size] / self.scale[:, None]

    def release(self, rows: NDArray[np.int64]) -> Array:
        """Return the block of the inverse system that belongs to some conditions."""
        right = np.zeros((self._size + self._count, len(rows)))
        right[self._size + rows, np.arange(len(rows))] = 1.0
        found: Array = self._solve(right)[self._size + rows]
        return found


def _band_order(equations: Equations) -> NDArray[np.int64]:
    """Return unknowns and conditions, node by node, with the shared unknowns last."""
    laws, shared = equations.condition_rates, equations.shared
    unknowns = np.arange(equations.residual_rates.shape[1])
    # A condition stands before the unknowns of the last node in it.
    conditions = laws.indices[laws.indptr[1:] - 1]
    keys = np.concatenate([2 * ((unknowns - shared) // 5) + 1, 2 * ((conditions - shared) // 5)])
    keys[:shared] = keys.max(initial=0) + 1
    return np.argsort(keys, kind='stable')


def _scale_columns(rates: sparse.csr_array, scale: Array) -> sparse.csr_array:
    """Return a matrix whose columns are divided by scales."""
    data = rates.data / scale[rates.indices]
    return sparse.csr_array((data, rates.indices, rates.indptr), shape=rates.shape)


def _is_allowed(shooting: Shooting, u: Array) -> bool:
    """Return whether instants rise, and stiffness, damping, alpha and gap are positive."""
    shared, states = shooting.parts(u)
    gap = shared[shooting.unknowns.column('gap')]
    first, second = shooting.unknowns.alpha_columns()
    positive = min(shared[0], shared[1], shared[first], shared[second], gap) > 0.0
    # Restitution that grows with the speed must stay finite.
    fastest = float(np.abs(states[:, W] - states[:, V]).max())
    grows = shooting.unknowns.value(shared, 'slowness') * fastest < -_MOST_GROWTH
    return bool(positive and not grows and np.all(np.diff(states[:, 0]) > 0.0))


def solve(
    shooting: Shooting, u: Array, *, soft: float = 0.0, most: int = 30, least_gain: float = 0.02
) -> FitSolution:
    """
    Minimise the residuals where the conditions hold; `soft` is a deviation of the laws.

    Instants move by at most a sample in a step. A step that makes residuals and conditions larger
    is shortened or damped. A friction below zero is set to zero: no flight of the engine has one.
    """
    grip = shooting.unknowns.column('grip')
    longest = float(np.median(np.diff(shooting.record.time)))
    equations = shooting.equations(u, soft)
    merit = _merit(equations.residual, equations.condition)
    damping = _FIRST_DAMPING
    for _ in range(most):
        taken = None
        for _ in range(_TRIES):
            step, _ = System(equations, damping).step(equations)
            if not np.isfinite(step).all():
                damping = max(10.0 * damping, 1e-7)
                continue
            instants = step[shooting.count :: 5]
            np.clip(instants, -longest, longest, out=instants)
            for part in _PARTS:
                tried = u + part * step
                if _is_allowed(shooting, tried):
                    other = _merit(*shooting.residual(tried, soft))
                    if other <= merit * (1.0 + 1e-9):
                        taken = tried, other
                        break
            if taken is not None:
                break
            damping = max(100.0 * damping, 1e-6)
        if taken is None:
            break
        gain = merit - taken[1]
        u, merit = taken
        damping = max(damping / 30.0, _LEAST_DAMPING)
        equations = shooting.equations(u, soft)
        if (
            gain < least_gain
            and part == 1.0
            and np.abs(equations.condition).max(initial=0.0) < _EXACT
        ):
            break
    if grip >= 0 and u[grip] < 0.0 and not (shooting.frictionless or soft):
        shooting.frictionless = True
        u = u.copy()
        u[grip] = 0.0
        return solve(shooting, u, most=most, least_gain=least_gain)
    return FitSolution(u, equations)


def _merit(residual: Array, condition: Array) -> float:
    # A product of long vectors would wait for the threads of BLAS, which takes longer.
    return float(np.sum(residual**2) + _WEIGHT * np.sum(condition**2))


def gains_of_release(shooting: Shooting, solution: FitSolution) -> Array:
    """
    Return the fall of the sum of squares for each flight if its laws did not hold.

    It is correct to first order, by the test of Lagrange multipliers.
    """
    system = System(solution.equations, _LEAST_DAMPING)
    _, multipliers = system.step(solution.equations)
    flights = shooting.law_flights
    rows = np.flatnonzero(flights >= 0)
    gains = np.zeros(len(shooting.course) - 1)
    if not len(rows):
        return gains
    inverse = -system.release(rows)
    for k in np.unique(flights[rows]):
        own = np.flatnonzero(flights[rows] == k)
        block = 0.5 * (inverse[np.ix_(own, own)] + inverse[np.ix_(own, own)].T)
        m = multipliers[rows[own]]
        gains[k] = m @ np.linalg.pinv(block, rcond=1e-9, hermitian=True) @ m
    return gains
