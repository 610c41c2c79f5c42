# SPDX-License-Identifier: Apache-2.0
"""
The course of a motion: its impacts in order, what m does between them, and which flights count.

A flight leads from one impact to the next. In it friction turns where m reverses, sticks or is
released. A flight that does not obey the laws, since m rests on a stop or an impact was missed, is
left out with its data: at its end M and m begin anew, and the course has several parts that share
the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .vibration import Array

Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]


@dataclass
class Course:
    """
    The impacts of m, and the flights between them.

    Attributes
    ----------
    shared : ndarray
        The shared unknowns, see `Unknowns`.
    time, x, velocity, damper_velocity : ndarray, shape (n,)
        Instant of each impact, X, and X' and Z' just after it.
    stop : ndarray of int, shape (n,)
        +1 for stop 1, -1 for stop 2.
    begins : ndarray of bool, shape (n,)
        Whether the motion begins anew there: the flight before it does not count.
    measured : ndarray of int, shape (n,)
        Index of the measured time of each impact, -1 for none.
    turns : list of ndarray
        Instants at which m reverses, sticks or is released, for each of the n - 1 flights.
    after : list of ndarray of int
        How m slides after each of them: +1 away from the stop hit last, -1 towards it, 0 if it
        sticks. Without them all are reversals.
    held : list of ndarray of bool
        Turns whose instants are fixed, since the data hardly determine them.
    """

    shared: Array
    time: Array
    x: Array
    velocity: Array
    damper_velocity: Array
    stop: Counts
    begins: Flags
    measured: Counts
    turns: list[Array] = field(default_factory=list)
    after: list[Counts] = field(default_factory=list)
    held: list[Flags] = field(default_factory=list)

    def __post_init__(self) -> None:
        flights = max(len(self.time) - 1, 0)
        if not self.turns:
            self.turns = [np.zeros(0)] * flights
        if not self.after:
            self.after = [reversals(len(times)) for times in self.turns]
        if not self.held:
            self.held = [np.zeros(len(times), bool) for times in self.turns]

    def __len__(self) -> int:
        return len(self.time)

    def copy(self) -> Course:
        """Return a copy that shares nothing."""
        arrays = ('shared', 'time', 'x', 'velocity', 'damper_velocity', 'stop', 'begins')
        return replace(
            self,
            **{name: getattr(self, name).copy() for name in (*arrays, 'measured')},
            turns=[times.copy() for times in self.turns],
            after=[ways.copy() for ways in self.after],
            held=[flags.copy() for flags in self.held],
        )

    @property
    def flies(self) -> Flags:
        """Whether each flight counts, shape (n - 1,)."""
        counts: Flags = ~self.begins[1:]
        return counts

    def with_sticks(self) -> Course:
        """Return the course in which m sticks between two reversals."""
        course = self.copy()
        for ways in course.after:
            if ways.all():
                ways[: len(ways) // 2 * 2 : 2] = 0
        return course

    def leave_out(self, flight: int) -> None:
        """Let the motion begin anew at the end of a flight."""
        self.begins[flight + 1] = True
        self.turns[flight], self.held[flight] = np.zeros(0), np.zeros(0, bool)
        self.after[flight] = reversals(0)

    @property
    def structure(self) -> tuple[object, ...]:
        """The parts that a round of the revision may change, for comparison."""
        return (
            tuple(self.stop.tolist()),
            tuple(self.begins.tolist()),
            tuple(tuple(ways.tolist()) for ways in self.after),
            tuple(tuple(flags.tolist()) for flags in self.held),
        )


def reversals(count: int) -> Counts:
    """Return how m slides after each of some reversals in a flight, as in `Course.after`."""
    return np.where(np.arange(count) % 2, 1, -1)
