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
from scipy.linalg.lapack import dgbtrf

from impact_damper_ros.motion.kernels import call_kernel

from .nodes import V, W
from .shooting import Equations, Shooting
from .system_kernels import add_squares, solve_band, write_system
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
#: Laws that are released at a time.
_AT_ONCE = 16
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
        self._equations = equations
        rows = equations.samples, equations.sample_node, equations.rows, equations.row_node
        self._size, self._count = equations.size, len(equations.condition)
        squares = np.zeros((2, self._size))
        call_kernel(add_squares, *rows, equations.others, squares, what='fit')
        scale = np.sqrt(squares[0] + 1e-6 * squares[1])
        scale[scale == 0.0] = 1.0
        self.scale = scale
        self._order, reach = _band_order(equations)
        places = np.empty_like(self._order)
        places[self._order] = np.arange(len(places))
        last, inner = equations.shared, len(places) - equations.shared
        band, edge = np.zeros((inner, 3 * reach + 1)), np.zeros((inner, last))
        corner, width = np.zeros((last, last)), equations.samples.shape[1]
        call_kernel(
            *(write_system, *rows, equations.others, scale, places),
            *(np.empty((width, width)), band, edge, corner),
            what='fit',
        )
        diagonal = np.full(len(places), -_GIVE)
        diagonal[places[: self._size]] = damping * (squares[0] / scale**2 + 1e-4)
        band[:, 2 * reach] += diagonal[:inner]
        corner[np.diag_indices(last)] += diagonal[inner:]
        # The Schur complement of the shared unknowns
        factors, self._pivots, info = dgbtrf(band.T, reach, reach, overwrite_ab=True)
        self._band, self._edge, self._places = factors.T, edge, places
        if info > 0:
            raise np.linalg.LinAlgError('the flights do not determine their states')
        self._through = self._solve_band(edge)
        self._corner = corner - edge.T @ self._through

    def _solve_band(self, right: Array, first: int = 0) -> Array:
        """Return the solution of the band, from the first row on that is not zero."""
        found = np.array(right, order='C')
        call_kernel(solve_band, self._band, self._pivots, first, found, what='fit')
        return found

    def _solve(self, right: Array) -> Array:
        """Return the solution of the system for right-hand sides, shape (n, k)."""
        ordered, inner = right[self._order], len(self._edge)
        first = self._solve_band(ordered[:inner])
        last = np.linalg.solve(self._corner, ordered[inner:] - self._edge.T @ first)
        found = np.empty_like(right)
        found[self._order] = np.concatenate([first - self._through @ last, last])
        return found

    def step(self, equations: Equations) -> tuple[Array, Array]:
        """Return the step, and the multipliers of the conditions."""
        right = self._right(equations.residual[:, None], equations.condition[:, None])
        found = -self._solve(right)[:, 0]
        return found[: self._size] / self.scale, found[self._size :]

    def _right(self, residuals: Array, conditions: Array) -> Array:
        """Return right-hand sides of columns of residuals and conditions."""
        rows = self._equations.transpose_times(residuals) / self.scale[:, None]
        return np.concatenate([rows, conditions])

    def covariance(self, columns: NDArray[np.int64]) -> Array:
        """Return the covariance of some unknowns."""
        right = np.zeros((self._size + self._count, len(columns)))
        right[columns, np.arange(len(columns))] = 1.0 / self.scale[columns]
        found = self._solve(right)[columns] / self.scale[columns, None]
        covariance: Array = 0.5 * (found + found.T)
        return covariance

    def profile(self, residual_rates: Array, condition_rates: Array) -> tuple[Array, Array]:
        """
        Return the information on further unknowns, with the others fitted again.

        The results are their information matrix, and the changes of all others with them.
        """
        right = self._right(residual_rates, condition_rates)
        found = self._solve(right)
        information: Array = residual_rates.T @ residual_rates - right.T @ found
        return information, -found[: self._size] / self.scale[:, None]

    def release(self, rows: NDArray[np.int64]) -> Array:
        """Return the block of the inverse system that belongs to some conditions, in order."""
        places = self._places[self._size + rows]
        right = np.zeros((len(self._band), len(rows)))
        right[places, np.arange(len(rows))] = 1.0
        through = self._through[places]
        block: Array = self._solve_band(right, int(places[0]))[places]
        return block + through @ np.linalg.solve(self._corner, through.T)


def _band_order(equations: Equations) -> tuple[NDArray[np.int64], int]:
    """
    Return unknowns and conditions, node by node, with the shared unknowns last; and the reach.

    A condition stands before the unknowns of its node. The reach is how far apart an entry joins
    two of them at most.
    """
    shared, nodes = equations.shared, equations.row_node[equations.others :]
    keys = np.concatenate([2 * ((np.arange(equations.size) - shared) // 5) + 1, 2 * nodes])
    keys[:shared] = keys.max(initial=0) + 1
    most = int(np.bincount(nodes).max(initial=0))
    # Soft laws join the unknowns of two nodes.
    soft = (equations.rows[: equations.others, :5] != 0.0).any()
    return np.argsort(keys, kind='stable'), most + (9 if soft else 4)


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
    flights, starts, sizes = np.unique(flights[rows], return_index=True, return_counts=True)
    # The laws of each flight; where it has fewer than others, zeros beside them
    blocks = np.zeros((len(flights), int(sizes.max()), int(sizes.max())))
    pulls = np.zeros(blocks.shape[:2])
    for few in np.array_split(np.arange(len(flights)), -(-len(rows) // _AT_ONCE)):
        own = slice(starts[few[0]], starts[few[-1]] + sizes[few[-1]])
        inverse = -system.release(rows[own])
        for k in few.tolist():
            at, size = starts[k] - own.start, sizes[k]
            block = inverse[at : at + size, at : at + size]
            blocks[k, :size, :size] = 0.5 * (block + block.T)
            pulls[k, :size] = multipliers[rows[starts[k] : starts[k] + size]]
    inverses = np.linalg.pinv(blocks, rcond=1e-9, hermitian=True)
    gains[flights] = np.einsum('ki,kij,kj->k', pulls, inverses, pulls)
    return gains
