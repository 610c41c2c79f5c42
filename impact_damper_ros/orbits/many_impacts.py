"""Motions with three and more impacts in a period, from many starts."""

from __future__ import annotations

import numpy as np

from .equations import Array, ImpactEquations
from .newton import RESIDUAL_TOLERANCE, Root, approach_roots, polish
from .report import StartReport
from .settled import settled_impacts, starting_points, windows

__all__ = ['many_impact_roots']

_CLOSE = 1e-6
_SETTLING_CYCLES = 120
_WATCHED_CYCLES = 12
_MOST_WINDOWS = 16


def _systematic_starts(equations: ImpactEquations, count: int) -> tuple[Array, Array]:
    """
    Return starts that cover the instants evenly.

    The gaps between impacts are spacings of sorted points of a Kronecker sequence, the phase of
    the first impact is another of its coordinates; the displacements solve the linear equations
    best in the sense of least squares.
    """
    n = equations.impacts
    # The generalised golden ratio: the most evenly spread of such sequences
    golden = 2.0
    for _ in range(64):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    steps = golden ** -np.arange(1.0, n + 1)
    points = (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0
    offsets = np.zeros((count, n))
    offsets[:, 1:] = np.sort(points[:, 1:], axis=-1) * equations.period
    # Two impacts at once have no equations
    least = 1e-3 * equations.period
    offsets += least * np.arange(n)
    offsets *= equations.period / (equations.period + least * (n + 1))
    first = points[:, :1] * equations.cycle
    phase = equations.frequency * first[:, 0] + equations.phase
    rows = equations.linear_system(offsets)
    known = rows[..., n] * np.cos(phase)[:, None] + rows[..., n + 1] * np.sin(phase)[:, None]
    target = -(known + rows[..., n + 2])
    matrix = rows[..., :n]
    normal = np.einsum('sij,sik->sjk', matrix, matrix) + 1e-12 * np.eye(n)
    x = np.linalg.solve(normal, np.einsum('sij,si->sj', matrix, target)[..., None])[..., 0]
    return x, offsets + first


def _simulated_starts(equations: ImpactEquations) -> tuple[Array, Array]:
    """Return starts from motion simulated from several initial conditions."""
    parameters = equations.parameters
    n = equations.impacts
    xs: list[list[float]] = []
    instants: list[list[float]] = []
    # Impacts, as many reversals, and room for another motion on the way
    most_events = (4 * n + 8) / equations.cycles
    for initial in starting_points(parameters):
        impacts = settled_impacts(
            parameters, initial, _SETTLING_CYCLES, _WATCHED_CYCLES, most_events
        )
        found = list(windows(impacts, equations.stops, equations.period))[-_MOST_WINDOWS:]
        xs += [x for x, _ in found]
        instants += [t for _, t in found]
    return np.array(xs).reshape(-1, n), np.array(instants).reshape(-1, n)


def many_impact_roots(
    equations: ImpactEquations, starts: int, simulate: bool
) -> tuple[list[Root], StartReport]:
    """
    Find motions of one stop sequence from systematic starts and from simulation.

    Parameters
    ----------
    equations : ImpactEquations
        The 2N equations.
    starts : int
        Number of systematic starts.
    simulate : bool
        Whether to take starts from simulated motion as well.

    Returns
    -------
    roots : list of Root
        The roots found; the same may be there more than once.
    report : StartReport
        How many starts converged; its `distinct` counts the roots returned.
    """
    x, instants = _systematic_starts(equations, starts)
    if simulate:
        x_seen, instants_seen = _simulated_starts(equations)
        x = np.concatenate([x, x_seen])
        instants = np.concatenate([instants, instants_seen])
    x, instants, residuals = approach_roots(equations, x, instants)
    close = residuals < _CLOSE
    # One of each group of starts that came to the same place is polished
    keys: dict[tuple[int, ...], int] = {}
    phases = (equations.frequency * instants) / (2.0 * np.pi)
    phases -= np.floor(phases[:, :1])
    finite = np.isfinite(phases).all(axis=-1) & np.isfinite(x).all(axis=-1)
    for s in np.flatnonzero(close & finite):
        place = np.concatenate([phases[s], x[s] / equations.length])
        keys.setdefault(tuple(np.round(place * 1e5).astype(int)), int(s))
    polished = (polish(equations, x[s], instants[s]) for s in keys.values())
    roots = [root for root in polished if root is not None]
    converged = residuals < RESIDUAL_TOLERANCE
    return roots, StartReport(
        stops=equations.stops,
        method='starts',
        starts=starts,
        converged=int(converged[:starts].sum()),
        simulated=len(x) - starts,
        simulated_converged=int(converged[starts:].sum()),
        distinct=len(roots),
    )
