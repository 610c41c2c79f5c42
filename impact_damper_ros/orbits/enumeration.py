"""
All motions with one or two impacts in a period.

The linear part of the equations leaves, for fixed instants, vectors (X_1, .., X_N, C, S, W) that
satisfy it up to a factor; the force then asks for C^2 + S^2 = W^2. For N = 1 these vectors span a
plane and the condition is a quadratic. For N = 2 they are one vector for each alpha_2, and the
condition is one equation for alpha_2: the paper's (16), in a form without poles. Where the
equations lose rank, as in the symmetric motion of a symmetric rig, it is a quadratic again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .equations import Array, ImpactEquations
from .newton import Root, polish

__all__ = ['one_impact_roots', 'two_impact_roots']

_POINTS_PER_CYCLE = 400
_MOST_POINTS = 100_000
_BISECTIONS = 24
_CLOSER_LOOKS = 5
_LOOKS = 33


def _plane_meets_cone(basis: Array) -> Iterator[Array]:
    """
    Yield the vectors of a plane with C^2 + S^2 = W^2, divided by W.

    Parameters
    ----------
    basis : ndarray, shape (2, M)
        Two vectors that span the plane; their last three entries are C, S and W.
    """
    form = basis[:, -3:] @ np.diag([1.0, 1.0, -1.0]) @ basis[:, -3:].T
    angle = 0.5 * math.atan2(2.0 * form[0, 1], form[0, 0] - form[1, 1])
    mean = 0.5 * (form[0, 0] + form[1, 1])
    reach = math.hypot(0.5 * (form[0, 0] - form[1, 1]), form[0, 1])
    # mean + reach cos 2(t - angle) = 0; a near miss is taken for touching, Newton decides.
    if reach == 0.0 or abs(mean) > 1.0001 * reach:
        return
    opening = 0.5 * math.acos(min(1.0, max(-1.0, -mean / reach)))
    for t in (angle + opening, angle - opening):
        vector = math.cos(t) * basis[0] + math.sin(t) * basis[1]
        if abs(vector[-1]) > 1e-12 * float(np.abs(vector).max()):
            yield vector / vector[-1]


def _scaled(equations: ImpactEquations, rows: Array) -> Array:
    """Return the rows for displacements in units of the length scale, and of similar size."""
    rows = rows.copy()
    rows[..., : equations.impacts] *= equations.length
    rows /= np.abs(rows).max(axis=-1, keepdims=True)
    return rows


def _start(equations: ImpactEquations, vector: Array, offsets: Array) -> tuple[Array, Array]:
    """Return displacements and instants of a vector with W = 1."""
    n = equations.impacts
    phase = math.atan2(vector[-2], vector[-3]) - equations.phase
    return vector[:n] * equations.length, offsets + phase / equations.frequency


def one_impact_roots(equations: ImpactEquations) -> list[Root]:
    """
    Find all motions with one impact in a period: none, one or two.

    Parameters
    ----------
    equations : ImpactEquations
        The equations for N = 1.
    """
    offsets = np.zeros(1)
    rows = _scaled(equations, equations.linear_system(offsets))
    basis = np.linalg.svd(rows)[2][-2:]
    starts = [_start(equations, v, offsets) for v in _plane_meets_cone(basis)]
    return [root for x, t in starts if (root := polish(equations, x, t)) is not None]


def _symmetric_starts(equations: ImpactEquations) -> Iterator[tuple[Array, Array]]:
    """
    Yield the motions whose second half mirrors the first: X_2 = -X_1 half a period later.

    The force must have changed sign by then, hence an odd number of cycles.
    """
    parameters = equations.parameters
    restitutions = parameters.restitution_1 == parameters.restitution_2
    mirrored = np.all(equations.accelerations == -equations.accelerations[::-1])
    if equations.stops not in ((1, 2), (2, 1)) or equations.cycles % 2 == 0:
        return
    if not (restitutions and mirrored):
        return
    offsets = np.array([0.0, 0.5 * equations.period])
    rows = _scaled(equations, equations.linear_system(offsets))
    reduced = rows[[0, 2]][:, 1:].copy()
    reduced[:, 0] = rows[[0, 2], 0] - rows[[0, 2], 1]
    for vector in _plane_meets_cone(np.linalg.svd(reduced)[2][-2:]):
        yield _start(equations, np.concatenate([vector[:1], -vector[:1], vector[1:]]), offsets)


class _Scan:
    """The condition C^2 + S^2 = W^2 along the second instant."""

    def __init__(self, equations: ImpactEquations) -> None:
        self.equations = equations

    def look(self, second: Array) -> tuple[Array, Array, Array]:
        """Return the condition, the last two singular vectors and the smallest singular value."""
        offsets = np.stack([np.zeros_like(second), second], axis=-1)
        rows = _scaled(self.equations, self.equations.linear_system(offsets))
        _, values, vectors = np.linalg.svd(rows)
        last = vectors[:, -1]
        return last[:, 2] ** 2 + last[:, 3] ** 2 - last[:, 4] ** 2, vectors[:, -2:], values[:, -1]

    def between(self, left: Array, right: Array) -> Array:
        """Bisect all intervals at whose ends the condition differs in sign."""
        sign = np.sign(self.look(left)[0])
        for _ in range(_BISECTIONS):
            middle = 0.5 * (left + right)
            same = np.sign(self.look(middle)[0]) == sign
            left, right = np.where(same, middle, left), np.where(same, right, middle)
        return 0.5 * (left + right)

    def starts(self, second: Array) -> Iterator[tuple[Array, Array]]:
        """Yield a start at each instant."""
        for alpha, basis in zip(second, self.look(second)[1], strict=True):
            vector = basis[1]
            if abs(vector[-1]) > 1e-12:
                yield _start(self.equations, vector / vector[-1], np.array([0.0, alpha]))


def _closer(scan: _Scan, left: float, right: float, index: int) -> Iterator[tuple[float, Array]]:
    """
    Narrow an interval around the least |condition| (index 0) or singular value (index 2).

    Yields the instant reached and the condition's values on the way, as (instant, [a, b]) where
    it changes sign between a and b, and finally (instant, []).
    """
    best = 0.5 * (left + right)
    for _ in range(_CLOSER_LOOKS):
        grid = np.linspace(left, right, _LOOKS)
        values = scan.look(grid)
        if index == 0:
            crossing = np.flatnonzero(np.diff(np.sign(values[0])) != 0)
            if len(crossing):
                for i in crossing:
                    yield best, grid[i : i + 2]
                return
        j = int(np.argmin(np.abs(values[index])))
        best = float(grid[j])
        left, right = float(grid[max(j - 1, 0)]), float(grid[min(j + 1, _LOOKS - 1)])
    yield best, np.empty(0)


def two_impact_roots(equations: ImpactEquations) -> list[Root]:
    """
    Find all motions with two impacts in a period.

    Parameters
    ----------
    equations : ImpactEquations
        The equations for N = 2.

    Returns
    -------
    list of Root
        Each root, in no order; the same may be there more than once.

    Notes
    -----
    The condition is scanned over the whole period. Sign changes are bisected; minima of its
    modulus are looked at closely for two roots side by side and for double ones; where the linear
    equations come close to losing rank, the plane they nearly leave is searched too. Every
    candidate is finished by Newton's method on the full equations.
    """
    ratio = max(1.0, equations.rate / equations.frequency)
    points = min(_MOST_POINTS, math.ceil(_POINTS_PER_CYCLE * equations.cycles * ratio))
    even = (np.arange(points) + 0.5) / points
    edge = even[0] * 0.5 ** np.arange(12, 0, -1)
    second = equations.period * np.concatenate([edge, even, 1.0 - edge[::-1]])
    scan = _Scan(equations)
    condition, _, rank = scan.look(second)
    starts = list(_symmetric_starts(equations))
    crossing = np.flatnonzero(np.diff(np.sign(condition)) != 0)
    lefts, rights = list(second[crossing]), list(second[crossing + 1])
    tangents: list[float] = []
    size = np.abs(condition)
    low = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    for i in low:
        if condition[i - 1] * condition[i + 1] > 0.0 and condition[i] * condition[i + 1] > 0.0:
            for best, bracket in _closer(scan, second[i - 1], second[i + 1], 0):
                if len(bracket):
                    lefts.append(bracket[0])
                    rights.append(bracket[1])
                else:
                    tangents.append(best)
    roots = scan.between(np.array(lefts), np.array(rights)) if lefts else np.empty(0)
    starts += scan.starts(np.concatenate([roots, tangents]))
    for i in np.flatnonzero((rank[1:-1] <= rank[:-2]) & (rank[1:-1] <= rank[2:])) + 1:
        best = [b for b, _ in _closer(scan, second[i - 1], second[i + 1], 2)][-1]
        basis = scan.look(np.array([best]))[1][0]
        starts += [_start(equations, v, np.array([0.0, best])) for v in _plane_meets_cone(basis)]
    polished = (polish(equations, x, t) for x, t in starts)
    return [root for root in polished if root is not None]
