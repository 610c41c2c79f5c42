# SPDX-License-Identifier: Apache-2.0
"""The nodes of a course: impacts and reversals, and the unknowns that are determined at each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .course import Course

#: Unknowns of a node: instant, X, X' and Z' just after it, and Y.
T, X, V, W, Y = range(5)


class Nodes:
    """
    The nodes of a course.

    Attributes
    ----------
    course : Course
        The course.
    kind : ndarray of int
        +1 and -1 for an impact on stop 1 and 2, 0 for a reversal.
    impacts, ends, firsts, lone : ndarray of int
        The impacts; the nodes that end a flight that counts; the nodes at which the motion begins
        anew; and those of the latter that begin no flight either, and stay where they are.
    flight : ndarray of int
        Flight after each node, by the number of its first impact.
    direction, last_stop : ndarray
        Direction of m relative to M after each node, +1 down, and the stop hit last, +1 or -1.
    held_at : ndarray
        Instant of a reversal that keeps it, NaN at other nodes.
    lawless_ends : ndarray of bool
        Whether the flight that ends at each of `ends` obeys no law of m.
    holds : ndarray, shape (n, 2)
        Unknowns that keep their start value, since no equation determines them: node, coordinate.
    """

    def __init__(self, course: Course) -> None:
        self.course = course
        kind, impact_of, held_at, flight = [], [], [], []
        for k in range(len(course)):
            kind.append(int(course.stop[k]))
            impact_of.append(k)
            held_at.append(np.nan)
            flight.append(k)
            if k < len(course) - 1:
                for time, held in zip(course.reversals[k], course.held[k], strict=True):
                    kind.append(0)
                    impact_of.append(-1)
                    held_at.append(float(time) if held else np.nan)
                    flight.append(k)
        self.kind, self.impact_of = np.array(kind), np.array(impact_of)
        self.held_at = np.array(held_at)
        self.flight = np.array(flight)
        self.count_of_nodes = n = len(kind)
        self.impacts = np.flatnonzero(self.kind)
        direction = np.empty(n)
        last = np.empty(n)
        for i in range(n):
            direction[i] = -kind[i] if kind[i] else -direction[i - 1]
            last[i] = kind[i] or last[i - 1]
        self.direction, self.last_stop = direction, last
        counts = np.zeros(n, bool)
        counts[1:] = course.flies[self.flight[:-1]]
        self.ends = np.flatnonzero(counts)
        begins = np.zeros(n, bool)
        begins[self.impacts] = course.begins
        self.firsts = np.flatnonzero(begins)
        counts_after = np.zeros(n, bool)
        counts_after[:-1] = counts[1:]
        self.counts_after = counts_after
        self.lone = np.flatnonzero(~counts & ~counts_after)
        lawless = np.append(course.lawless, False)[self.flight]
        self.lawless_ends = np.append(False, lawless[:-1])[self.ends]
        self.holds = self._find_holds(counts, counts_after, lawless)

    def _find_holds(
        self,
        counts: NDArray[np.bool_],
        counts_after: NDArray[np.bool_],
        lawless: NDArray[np.bool_],
    ) -> NDArray[np.int64]:
        """Return nodes and coordinates that no equation determines."""
        holds = [(node, what) for node in self.lone for what in (T, X, V, W)]
        begins = ~counts & counts_after & lawless
        holds += [(node, W) for node in np.flatnonzero(begins)]
        ends = counts & ~counts_after & np.append(False, lawless[:-1])
        holds += [(node, V) for node in np.flatnonzero(ends)]
        return np.array(holds, np.int64).reshape(-1, 2)
