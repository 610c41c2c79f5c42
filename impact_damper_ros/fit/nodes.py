# SPDX-License-Identifier: Apache-2.0
"""The nodes of a course: impacts and turns, and the unknowns that are determined at each."""

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
        +1 and -1 for an impact on stop 1 and 2, 0 for a turn.
    impacts, ends, firsts, lone : ndarray of int
        The impacts; the nodes that end a flight that counts; the nodes at which the motion begins
        anew; and those of the latter that begin no flight either, and stay where they are.
    flight : ndarray of int
        Flight after each node, by the number of its first impact.
    direction, last_stop : ndarray
        Direction of m relative to M after each node, +1 down, 0 while m sticks; and the stop hit
        last, +1 or -1.
    sticks : ndarray of bool
        Whether m sticks after each node.
    held_at : ndarray
        Instant of a turn that keeps it, NaN at other nodes.
    lawless_ends : ndarray of bool
        Whether the flight that ends at each of `ends` obeys no law of m.
    holds : ndarray, shape (n, 2)
        Unknowns that keep their start value, since no equation determines them: node, coordinate.
    """

    def __init__(self, course: Course) -> None:
        self.course = course
        turns = np.array([*map(len, course.turns), 0])
        order = np.arange(len(course))
        self.flight = np.repeat(order, turns + 1)
        self.count_of_nodes = n = len(self.flight)
        self.impacts = np.cumsum(turns + 1) - turns - 1
        self.impact_of = np.full(n, -1)
        self.impact_of[self.impacts] = order
        hit = self.impact_of >= 0
        self.last_stop = course.stop[self.flight].astype(float)
        self.kind = np.where(hit, course.stop[self.flight], 0)
        after = np.ones(n)
        self.held_at = np.full(n, np.nan)
        if not hit.all():
            times, held = np.concatenate(course.turns), np.concatenate(course.held)
            self.held_at[~hit] = np.where(held, times, np.nan)
            after[~hit] = np.concatenate(course.after)
        self.direction, self.sticks = -self.last_stop * after, after == 0.0
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
