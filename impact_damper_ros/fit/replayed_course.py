# SPDX-License-Identifier: Apache-2.0
"""
What the exact engine says of each flight of a course, and the course that follows from it.

Its reversals become nodes. A flight that sticks, or does not end as it was fitted, is cut out; it
is joined again once the replay agrees. An impact that the engine has before the end is inserted:
without measured times always, with them where there is a measured one to spare, or one may have
been missed. An impact that the engine passes is removed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from .course import Course, Flags
from .first_course import matched
from .flight_replay import FlightReplay, Passage, passage, start_velocity
from .shooting import Shooting

#: For how long a flight is replayed beyond its end, in natural periods.
_MARGIN = 0.15
#: Reversals with less relative acceleration than this part of the largest of M are held.
_FLAT = 0.1
#: Least friction of the replay, m/s^2.
_LEAST_GRIP = 1e-9


@dataclass
class Memory:
    """What earlier rounds have found, by instants, since the numbers of the flights change."""

    same: float
    cuts: list[tuple[float, int]] = field(default_factory=list)
    starts: list[tuple[float, int]] = field(default_factory=list)

    def count(self, entries: list[tuple[float, int]], time: float) -> int:
        """Return how often something happened at an instant."""
        return sum(times for at, times in entries if abs(at - time) < self.same)


class ReplayedCourse:
    """One round of the revision."""

    def __init__(
        self,
        course: Course,
        shooting: Shooting,
        memory: Memory,
        gains: dict[int, float],
        tolerance: float,
    ) -> None:
        self.course, self.shooting, self.memory = course.copy(), shooting, memory
        self.gains, self.tolerance = gains, tolerance
        self.unknowns = shooting.unknowns
        # With a little friction the engine reports reversals, which a fit may need
        self.replay = FlightReplay(self.unknowns.rig_of(course.shared, _LEAST_GRIP))
        self.margin = _MARGIN * 2.0 * np.pi / shooting.rate
        self.largest = float(np.abs(course.velocity).max())
        self.inserted: dict[int, Passage] = {}
        self.removed: set[int] = set()
        self.risky: list[float] = []
        self.why_cut: dict[int, str] = {}
        self.log: list[str] = []

    def _passage(self, k: int, end: int, tolerance: float) -> Passage:
        course = self.course
        span = float(course.time[end] - course.time[k])
        damper, stop = float(course.damper_velocity[k]), int(course.stop[k])
        if not (damper - course.velocity[k]) * stop <= 0.0:
            return Passage(-1, [], False)
        state = float(course.time[k]), stop, float(course.x[k]), float(course.velocity[k]), damper
        events = self.replay.events(*state, span + self.margin)
        return passage(events, span, tolerance, int(course.stop[end]))

    def _arrival(self, k: int) -> float:
        """Return the velocity with which m arrives at an impact, as its jump says."""
        first, second = self.unknowns.alpha_columns()
        alpha = self.course.shared[first if self.course.stop[k] > 0 else second]
        share = self.unknowns.share
        ratio = 1.0 / share - 1.0
        # w = v_b + (alpha - M/m) J and v = v_b + J
        jump = (self.course.damper_velocity[k] - self.course.velocity[k]) / (alpha - ratio - 1.0)
        return float(self.course.velocity[k] + (alpha - 1.0) * jump)

    def _search_start(self, k: int) -> Passage:
        """Look for the velocity of m where the motion begins anew."""
        course = self.course
        span = float(course.time[k + 1] - course.time[k])
        start = float(course.time[k]), float(course.x[k]), float(course.velocity[k])
        wanted = self._arrival(k + 1), self.largest, self.shooting.rate
        found = start_velocity(
            self.replay, start, span, self.margin, int(course.stop[k + 1]), wanted
        )
        course.damper_velocity[k], course.stop[k] = found
        self.memory.starts.append((float(course.time[k]), 1))
        self.risky.append(float(course.time[k + 1]))
        self.log.append(f'{k}:start')
        return self._passage(k, k + 1, 4.0 * self.tolerance)

    def revise(self) -> Course:
        """Return the course that the engine's flights suggest."""
        course, memory = self.course, self.memory
        was_cut, free = course.begins.copy(), course.begins.copy()
        begins = np.zeros(len(course), bool)
        begins[0] = True
        for k in range(len(course) - 1):
            if k in self.removed:
                continue
            found = self._passage(k, k + 1, self.tolerance)
            end = float(course.time[k + 1])
            if (
                found.missed < 0
                and free[k]
                and not was_cut[k + 1]
                and memory.count(memory.starts, float(course.time[k])) < 2
            ):
                found = self._search_start(k)
            gain = self.gains.get(k, 0.0)
            agrees = (
                found.missed == 0
                and not found.sticks
                and memory.count(memory.cuts, end) < 2
                and not gain
            )
            if 0 < found.missed < 4 and not found.sticks and self._spare(k, found):
                self.inserted[k] = found
                self.risky.append(end)
                self.log.append(f'{k}:+{found.missed}')
                agrees = True
            if not agrees and found.missed < 0 and (passed := self._passed(k, free)):
                self.removed.add(k + 1)
                found, agrees = passed, True
                self.log.append(f'{k}:-1')
            if agrees:
                if was_cut[k + 1]:
                    self.risky.append(end)
                    self.log.append(f'{k}:joined')
                if k not in self.inserted:
                    self._take_reversals(k, found)
            else:
                begins[k + 1] = True
                course.reversals[k], course.held[k] = np.zeros(0), np.zeros(0, bool)
                self.why_cut[k + 1] = _why(found, gain)
                if not was_cut[k + 1]:
                    memory.cuts.append((end, 2 if gain else 1))
                    self.log.append(f'{k}:cut {self.why_cut[k + 1]}')
        course.begins = begins
        return self._rebuilt()

    def _take_reversals(self, k: int, found: Passage) -> None:
        """Make the engine's reversals nodes; those in which m hardly reverses are held."""
        course, events = self.course, found.reversals
        course.reversals[k] = np.array([course.time[k] + event.time for event in events])
        vibration = self.shooting.vibration(course.shared)
        grip = self.unknowns.value(course.shared, 'grip')
        flat, was_held = [], bool(course.held[k].any())
        for event in events:
            x, v = np.array([event.x]), np.array([event.primary_velocity_before])
            at = np.array([course.time[k] + event.time])
            rate = vibration.acceleration(at, x, v, np.zeros(1))[0] - self.unknowns.slope
            limit = _FLAT * self.shooting.rate * self.largest + grip
            # One that was held stays so a little longer, or rounds would alternate
            flat.append(bool(abs(rate) < (2.0 * limit if was_held else limit)))
        course.held[k] = np.array(flat, bool)

    def _spare(self, k: int, found: Passage) -> bool:
        """Return whether impacts of the engine may have been missed by the data."""
        times = self.shooting.times_of_impacts(self.course.shared)
        if not len(times):
            return True
        course = self.course
        between = (times > course.time[k] + 1e-9) & (times < course.time[k + 1] - 1e-9)
        spare = np.setdiff1d(np.flatnonzero(between), course.measured)
        hits = np.array([course.time[k] + event.time for event in found.impacts[:-1]])
        if not len(spare):
            return self._unmeasured(found)
        near = np.abs(times[spare][None, :] - hits[:, None]).min(1)
        limit = 8.0 * self.shooting.impact_deviation + 2e-3
        return bool(len(spare) >= len(hits) and (near < limit).all())

    def _unmeasured(self, found: Passage) -> bool:
        """Return whether an impact may have been there though its time was not measured."""
        return found.missed == 1

    def _passed(self, k: int, free: Flags) -> Passage | None:
        """Return the passage to the impact after the next, if the engine passes the next one."""
        course = self.course
        if k + 2 >= len(course) or k + 1 in self.removed or k in self.removed or free[k]:
            return None
        found = self._passage(k, k + 2, self.tolerance)
        return found if found.missed == 0 and not found.sticks else None

    def _rebuilt(self) -> Course:
        """Return the course with impacts inserted and removed."""
        course = self.course
        keep = np.ones(len(course), bool)
        keep[list(self.removed)] = False
        for k in sorted(self.inserted, reverse=True):
            hits = self.inserted[k].impacts
            rows = np.array(
                [
                    (
                        course.time[k] + e.time,
                        e.x,
                        e.primary_velocity_after,
                        e.damper_velocity_after,
                    )
                    for e in hits[:-1]
                ]
            )
            stops = np.array([1 if e.stop == 1 else -1 for e in hits[:-1]])
            edges = [-np.inf, *(e.time for e in hits)]
            turns = [
                np.array(
                    [
                        course.time[k] + e.time
                        for e in self.inserted[k].reversals
                        if low < e.time < high
                    ]
                )
                for low, high in pairwise(edges)
            ]
            course = course.inserted(k, rows, stops, turns)
            keep = np.insert(keep, k + 1, np.ones(len(rows), bool))
        course = course.kept(keep)
        times = self.shooting.times_of_impacts(course.shared)
        limit = max(6.0 * self.shooting.impact_deviation, 1e-9)
        course.measured = matched(course.time, times, limit)
        _rising(course)
        return course


def _rising(course: Course) -> None:
    """Move instants that cross apart by a little."""
    least = 1e-6
    for k in range(len(course) - 1):
        if course.time[k + 1] <= course.time[k] + least:
            course.time[k + 1] = course.time[k] + 2.0 * least
        low, high = course.time[k], course.time[k + 1]
        inside = (course.reversals[k] > low) & (course.reversals[k] < high)
        course.reversals[k], course.held[k] = course.reversals[k][inside], course.held[k][inside]


def _why(found: Passage, gain: float) -> str:
    if gain:
        return f'its laws cost {gain:.0f} in the sum of squares'
    if found.sticks:
        return 'm sticks or rests in it'
    if found.missed > 0:
        return f'the engine has {found.missed} more impacts in it'
    return 'the engine does not arrive as measured'
