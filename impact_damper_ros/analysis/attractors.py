"""Attractors: which rows of a sweep show the same motion of the same rig."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .sweep_columns import Row

__all__ = ['FAILED', 'identified']

#: Sections that differ by less, relative to their size, are the same motion.
_SAME = 1e-3
#: Stands for the attractor of a rig that could not be simulated.
FAILED = -1
_SECTION_NAMES = ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity')


class _Known(NamedTuple):
    """A motion that has been met: its number, and its section."""

    number: int
    section: NDArray[np.float64]


def _kind(row: Row) -> Hashable:
    """Return what two rows of one attractor share exactly; irregular motions are all one."""
    return row['motion'], row['period'], row['stops']


def _section(row: Row) -> NDArray[np.float64]:
    """Return the section of a motion that repeats, relative to its size; shape (4, k)."""
    section = np.array([row[name] for name in _SECTION_NAMES], dtype=float)
    size = row['x_max'] + float(np.ptp(section[2])) or 1.0
    section /= size * np.array([[1.0], [math.tau / row['cycle']]] * 2).reshape(4, 1)
    if row['impacts'] == 0:
        # Nothing tells m where in the gap to be
        section[2] = 0.0
    return section


def _same(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two sections are the same, from whichever cycle they begin."""
    return any(
        float(np.abs(np.roll(one, shift, axis=1) - other).max()) < _SAME
        for shift in range(one.shape[1])
    )


def identified(rows: Iterable[tuple[Hashable, Row]]) -> NDArray[np.int64]:
    """
    Return numbers for the motions that each rig settles into.

    Parameters
    ----------
    rows : iterable of (hashable, Row)
        The rig, without its initial conditions, and its row.

    Returns
    -------
    ndarray of int
        For each row the number of its motion among those of its rig: 0 for the one with most
        rows, of equals the one met first; `FAILED` for a rig that could not be simulated. All
        motions of a rig that do not repeat are one, if they are of one kind.
    """
    known: dict[tuple[Hashable, Hashable], list[_Known]] = {}
    rigs: list[Hashable] = []
    numbers: list[int] = []
    met: dict[Hashable, int] = {}
    for rig, row in rows:
        rigs.append(rig)
        if not row['ok']:
            numbers.append(FAILED)
            continue
        section = _section(row) if row['settled'] else np.zeros((4, 1))
        motions = known.setdefault((rig, _kind(row)), [])
        found = next((one.number for one in motions if _same(one.section, section)), FAILED)
        if found == FAILED:
            found = met.get(rig, 0)
            met[rig] = found + 1
            motions.append(_Known(found, section))
        numbers.append(found)
    frequency = Counter(zip(rigs, numbers, strict=True))
    ranks: dict[tuple[Hashable, int], int] = {}
    for rig, count in met.items():
        order = sorted(range(count), key=lambda number: (-frequency[rig, number], number))
        ranks.update({(rig, number): rank for rank, number in enumerate(order)})
    return np.array(
        [
            ranks[rig, number] if number != FAILED else FAILED
            for rig, number in zip(rigs, numbers, strict=True)
        ],
        dtype=np.int64,
    )
