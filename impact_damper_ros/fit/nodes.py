# SPDX-License-Identifier: Apache-2.0
"""The nodes of a course: impacts and turns, and the unknowns that are determined at each."""

from __future__ import annotations

import numpy as np

from .course import Course
from .node_kernels import AT, HIT, OFFSET, PLACE_M, RELEASES, REVERSES, SPEED_D, SPEED_M, STAYS

#: Unknowns of a node: instant, X, X' and Z' just after it, and Y.
T, X, V, W, Y = AT, PLACE_M, SPEED_M, SPEED_D, OFFSET


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
    demands : ndarray of int
        What each node demands, see `node_kernels`.
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
        self.demands = np.where(np.append(False, self.sticks[:-1]), RELEASES, REVERSES)
        self.demands[np.isfinite(self.held_at)] = STAYS
        self.demands[hit] = HIT
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
        self.holds = np.array(
            [(node, what) for node in self.lone for what in (T, X, V, W)], np.int64
        ).reshape(-1, 2)
