"""
The approach of a stretch to its periodic motion: how near it is, and how fast it comes nearer.

Near the periodic motion the state at impact one period later is a linear function of the one
before. Its largest eigenvalue is measured by dynamic mode decomposition (Schmid, J. Fluid Mech.
656, 2010) of the differences of successive periods, each scaled to the same size, so that nothing
of the theory enters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .recurrence import ImpactTable, Recurrence
from .run_curves import Array

__all__ = ['DecayRate', 'decay_rate', 'distances_to', 'period_states']

#: Differences of successive periods between which the decay is measured: the linear regime.
_LINEAR = 5e-3
_NOISE_FLOORS = 300.0
_LEAST_PERIODS = 8
_PERIODS_PER_RANK = 4
_MOST_RANK = 4
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True)
class DecayRate:
    """
    Measured factor by which deviations shrink in a period.

    Attributes
    ----------
    factor : float
        Largest modulus of the eigenvalues; NaN if it could not be measured.
    angle : float
        Angle of that eigenvalue, rad, from 0 to pi.
    start, stop : int
        The periods on which it was measured.
    """

    factor: float
    angle: float
    start: int
    stop: int


def period_states(table: ImpactTable, recurrence: Recurrence, end: int) -> Array:
    """
    Return the states of the last periods, one row for each, with whole periods taken out.

    Parameters
    ----------
    table : ImpactTable
        The impacts.
    recurrence : Recurrence
        Their period.
    end : int
        Index after the last impact of the last period, in the last period of the table.

    Returns
    -------
    ndarray, shape (p, 4 N)
        For each of the N impacts of a period, its instant in cycles and its scaled states; the
        last period last.
    """
    n, k = recurrence.impacts, recurrence.cycles
    begin = len(table) - (len(recurrence.distance) + 1) * n
    count = (end - begin) // n
    rows = slice(end - count * n, end)
    periods = np.arange(count)[:, None]
    phase = table.phase[rows].reshape(count, n) - k * (periods - (count - 1))
    states = table.states[rows].reshape(count, 3 * n)
    return np.hstack([phase, states])


def distances_to(states: Array, reference: Array) -> Array:
    """Return the distance of each period from a reference: the largest difference."""
    distance: Array = np.abs(states - reference).max(axis=1)
    return distance


def decay_rate(states: Array, floor: float) -> DecayRate:
    """
    Measure the decay of the differences of successive periods.

    Parameters
    ----------
    states : ndarray, shape (p, 4 N)
        As `period_states` returns.
    floor : float
        What the rounding of stamps makes of a distance.
    """
    steps = np.diff(states, axis=0)
    sizes = np.abs(steps).max(axis=1)
    large = np.flatnonzero(sizes > _LINEAR)
    start = int(large[-1]) + 1 if len(large) else 0
    largest_later = np.maximum.accumulate(sizes[::-1])[::-1]
    small = np.flatnonzero(largest_later < _NOISE_FLOORS * floor)
    stop = int(small[0]) if len(small) else len(sizes)
    count = stop - start
    if count < _LEAST_PERIODS:
        return DecayRate(math.nan, math.nan, start, start)
    steps, sizes = steps[start:stop], sizes[start:stop, None]
    before, after = (steps[:-1] / sizes[:-1]).T, (steps[1:] / sizes[:-1]).T
    modes, values, rows = np.linalg.svd(before, full_matrices=False)
    rank = min(_MOST_RANK, max(1, count // _PERIODS_PER_RANK))
    rank = int(min(rank, (values > _NEGLIGIBLE * values[0]).sum()))
    modes, values, rows = modes[:, :rank], values[:rank], rows[:rank]
    map_ = modes.T @ after @ rows.T / values
    eigenvalue = max(np.linalg.eigvals(map_), key=abs)
    return DecayRate(float(abs(eigenvalue)), float(abs(np.angle(eigenvalue))), start, stop)
