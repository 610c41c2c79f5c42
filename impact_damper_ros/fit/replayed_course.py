# SPDX-License-Identifier: Apache-2.0
"""
The replay of each flight of a course by the exact engine, and the course that follows.

From each impact the engine flies on until it hits a stop where and when the course has an impact.
If that is the next one, the flight agrees. If it is a later one, the impacts between are removed;
further impacts of the engine are inserted: without measured times always, with them where each has
a spare time, or one impact was missed. The data must agree with what is changed. The reversals,
sticks and releases of the engine become nodes. A flight in which m rests on a stop, or from which
the engine arrives nowhere, is cut out, until a later round agrees.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from impact_damper_ros.motion.event import Event, EventKind
from impact_damper_ros.motion.state import SLIDE_DOWN, SLIDE_UP

from .contradictions import contradiction_of
from .course import Counts, Course, Flags, reversals
from .first_course import match_times
from .flight_replay import TURNS, FlightReplay, Passage, passage
from .shooting import Shooting
from .vibration import Array

#: Time for which a flight is replayed beyond its end, in natural periods.
_MARGIN = 0.15
#: Most impacts of the course that are removed, and most of the engine that are inserted, in a
#: flight.
_MOST_PASSED, _MOST_INSERTED = 3, 3
#: Reversals with less relative acceleration than this part of the largest of M are held.
_FLAT = 0.1
#: Least friction of the replay, m/s^2.
_LEAST_GRIP = 1e-9
#: Number of cuts at an instant after which it is left unchanged.
_OFTEN = 2
#: Residuals of the data in a flight that changes the course, in standard deviations.
_MISFIT = 3.0
#: Why a flight is left out that the engine makes as measured, but the equations do not have.
RESTS = 'm rests on a stop in it'
#: Direction in which m moves relative to M.
_DIRECTIONS = {SLIDE_DOWN: 1, SLIDE_UP: -1}
#: Least time between two nodes, s.
_LEAST_SPAN = 2e-6


@dataclass
class Memory:
    """The flights that earlier rounds cut, by their instants, as numbers of flights change."""

    same: float
    cuts: list[tuple[float, int]] = field(default_factory=list)

    def count(self, time: float) -> int:
        """Return the number of times that a flight was cut at an instant."""
        return sum(times for at, times in self.cuts if abs(at - time) < self.same)


class Impact:
    """An impact of the course to come: its row (time, x, velocity, damper velocity) and stop."""

    def __init__(self, row: list[float], stop: int, *, begins: bool) -> None:
        self.row, self.stop, self.begins = row, stop, begins
        # What friction does in the flight that ends there
        self.turns: Array = np.zeros(0)
        self.after: Counts = reversals(0)
        self.held: Flags = np.zeros(0, bool)

    @property
    def time(self) -> float:
        """Instant of the impact, s."""
        return self.row[0]


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
        self.course, self.shooting, self.memory = course, shooting, memory
        self.gains, self.tolerance = gains, tolerance
        self.unknowns = shooting.unknowns
        # With a little friction the engine reports reversals, which a fit may need..
        self.replay = FlightReplay(self.unknowns.rig_of(course.shared, _LEAST_GRIP))
        self.margin = _MARGIN * 2.0 * np.pi / shooting.rate
        self.largest = float(np.abs(course.velocity).max())
        self.impacts: list[Impact] = []
        self.risky: list[float] = []
        self.why_cut: dict[int, str] = {}
        self.changed = False

    def _own(self, k: int) -> list[float]:
        """Return the state just after an impact of the course."""
        course = self.course
        values = course.time[k], course.x[k], course.velocity[k], course.damper_velocity[k]
        return [float(value) for value in values]

    def _passage(self, k: int, tolerance: float) -> Passage:
        """Return the events of the engine after the last impact of the new course, the k-th."""
        course, last = self.course, self.impacts[-1]
        time, x, velocity, damper = last.row
        if not (damper - velocity) * last.stop <= 0.0:
            return Passage(0, [], False)
        ends = slice(k + 1, k + 2 + _MOST_PASSED)
        spans, stops = course.time[ends] - time, course.stop[ends]
        events = self.replay.events(
            time, last.stop, x, velocity, damper, 1.1 * float(spans[-1]) + self.margin
        )
        return passage(events, spans, stops, tolerance)

    def revise(self) -> Course:
        """Return the course that the engine's flights suggest."""
        course = self.course
        self.impacts = [Impact(self._own(0), int(course.stop[0]), begins=True)]
        k = 0
        while k < len(course) - 1:
            k = self._fly(k)
        return self._rebuilt()

    def confirms(self, k: int) -> bool:
        """Return whether the engine reaches the next impact with the events of the course."""
        course = self.course
        self.impacts = [Impact(self._own(k), int(course.stop[k]), begins=bool(course.begins[k]))]
        found = self._passage(k, self.tolerance)
        agrees = found.ahead == 1 and not found.missed and not found.rests
        return agrees and self._ways(found.events) == [*course.after[k].tolist(), 1]

    def _ways(self, events: list[Event]) -> list[int]:
        """Return how m slides after each event since the last impact, as in `Course.after`."""
        ways, way, stop = [], 1, self.impacts[-1].stop
        for event in events:
            if event.kind is EventKind.IMPACT:
                way, stop = 1, event.side
            elif event.kind in TURNS:
                way = -stop * _DIRECTIONS.get(event.mode, 0)
            ways.append(way)
        return ways

    def _fly(self, k: int) -> int:
        """Add the flight from an impact, and return the impact of the course where it ends."""
        course, memory = self.course, self.memory
        found = self._passage(k, self.tolerance)
        was_cut = bool(course.begins[k + 1])
        end = k + max(found.ahead, 1)
        gain = self.gains.get(k, 0.0)
        banned = memory.count(float(course.time[end])) >= _OFTEN
        agrees = found.ahead > 0 and not found.rests and not banned and not gain
        if agrees and found.missed:
            agrees = self._spare(k, end, found)
        if agrees and (found.missed or end > k + 1 or was_cut):
            agrees = self._misfit(found) < _MISFIT
        if agrees:
            self._join(k, end, found, was_cut)
            return end
        if not (found.ahead > 0 and found.rests):
            end = k + 1
        self._cut(k, end, found, gain)
        return end

    def _misfit(self, found: Passage) -> float:
        """Return the residuals of the data in a replayed flight, rms, in standard deviations."""
        shooting, shared = self.shooting, self.course.shared
        record, last = shooting.record, self.impacts[-1]
        begin, end = last.time, last.time + found.events[-1].time
        stops = [last.stop]
        for event in found.events[:-1]:
            stops.append(event.side if event.kind is EventKind.IMPACT else stops[-1])
        last_stop = np.array(stops, float)
        direction = -last_stop * [1, *self._ways(found.events)[:-1]]
        pushes = shooting.push_of(self.unknowns.value(shared, 'grip'), direction, last_stop)
        states = [last.row, *(_row_of(begin, event) for event in found.events)]
        rows = np.array(states)
        inside = slice(*np.searchsorted(record.time, [begin, end]))
        times, weight = record.time[inside], shooting.weight[inside]
        if not weight.any():
            return 0.0
        flights = rows[:-1], pushes, direction == 0.0
        signal, _ = shooting.signal([shared], *flights, times, record.order)
        left = (shooting.sense(shared, signal) - record.motion[inside]) * weight
        return float(np.sqrt(left @ left / (weight > 0.0).sum()))

    def _join(self, k: int, end: int, found: Passage, was_cut: bool) -> None:
        """Add a flight that agrees, with the impacts that the engine has in it."""
        course, begin = self.course, self.impacts[-1].time
        if found.missed or end > k + 1 or was_cut:
            self.risky.append(float(course.time[end]))
            self.changed = True
        turns: list[tuple[Event, int]] = []
        held = bool(course.held[k].any())
        hits = found.impacts
        for event, way in zip(found.events, self._ways(found.events), strict=True):
            if event.kind in TURNS:
                turns.append((event, way))
            elif event.kind is EventKind.IMPACT:
                impact = Impact(_row_of(begin, event), event.side, begins=False)
                if event is hits[-1]:
                    # A state that is fitted on its other side is taken from that side.
                    lone = bool(course.begins[end]) and (
                        end + 1 >= len(course) or bool(course.begins[end + 1])
                    )
                    impact.row = _row_of(begin, event) if lone else self._own(end)
                    impact.stop = int(course.stop[end])
                impact.turns = np.array([begin + turn.time for turn, _ in turns])
                impact.after = np.array([way for _, way in turns], int)
                impact.held = np.array([self._flat(begin, turn, held) for turn, _ in turns], bool)
                self.impacts.append(impact)
                turns = []

    def _cut(self, k: int, end: int, found: Passage, gain: float) -> None:
        """Add a flight that does not count."""
        time = float(self.course.time[end])
        self.impacts.append(Impact(self._own(end), int(self.course.stop[end]), begins=True))
        self.why_cut[len(self.impacts) - 1] = _why(found, gain)
        if not self.course.begins[end] or end > k + 1:
            self.memory.cuts.append((time, _OFTEN if gain else 1))
            self.changed = True

    def _flat(self, begin: float, event: Event, was_held: bool) -> bool:
        """Return whether m hardly reverses at an event, so that its instant is fixed."""
        if event.kind is not EventKind.REVERSAL:
            return False
        x, v = np.array([event.x]), np.array([event.primary_velocity_before])
        at = np.array([begin + event.time])
        vibration = self.shooting.vibration(self.course.shared)
        rate = vibration.acceleration(at, x, v, np.zeros(1))[0] - self.unknowns.slope
        grip = self.unknowns.value(self.course.shared, 'grip')
        limit = _FLAT * self.shooting.rate * self.largest + grip
        # A fixed instant stays fixed a little longer, or rounds would alternate.
        return bool(abs(rate) < (2.0 * limit if was_held else limit))

    def _spare(self, k: int, end: int, found: Passage) -> bool:
        """Return whether impacts of the engine may have been missed by the data."""
        if found.missed > _MOST_INSERTED:
            return False
        times = self.shooting.impact_times
        if not len(times):
            return True
        course, begin = self.course, self.impacts[-1].time
        between = (times > begin + 1e-9) & (times < course.time[end] - 1e-9)
        taken = np.delete(course.measured, np.arange(k + 1, end))
        spare = np.setdiff1d(np.flatnonzero(between), taken)
        if not len(spare):
            return found.missed == 1
        hits = np.array([begin + event.time for event in found.impacts[:-1]])
        near = np.abs(times[spare][None, :] - hits[:, None]).min(1)
        limit = 8.0 * self.shooting.impact_deviation + 2e-3
        return bool(len(spare) >= len(hits) and (near < limit).all())

    def _rebuilt(self) -> Course:
        """Return the course of the impacts."""
        impacts = self.impacts
        rows = np.array([impact.row for impact in impacts])
        for k in range(1, len(rows)):
            rows[k, 0] = max(rows[k, 0], rows[k - 1, 0] + _LEAST_SPAN)
        times = self.shooting.impact_times
        time, x, velocity, damper_velocity = rows.T.copy()
        course = Course(
            self.course.shared.copy(),
            time,
            x,
            velocity,
            damper_velocity,
            np.array([impact.stop for impact in impacts]),
            np.array([impact.begins for impact in impacts]),
            match_times(time, times, max(6.0 * self.shooting.impact_deviation, 1e-9)),
        )
        for k, impact in enumerate(impacts[1:]):
            inside = (impact.turns > rows[k, 0]) & (impact.turns < rows[k + 1, 0])
            course.turns[k], course.after[k] = impact.turns[inside], impact.after[inside]
            course.held[k] = impact.held[inside]
        return course


def _row_of(begin: float, event: Event) -> list[float]:
    return [
        begin + event.time,
        event.x,
        event.primary_velocity_after,
        event.damper_velocity_after,
    ]


def _why(found: Passage, gain: float) -> str:
    if gain:
        return contradiction_of(gain)
    if found.rests and found.ahead:
        return RESTS
    if found.missed > 0:
        return f'computed from its start, it has {found.missed} more impacts'
    return 'computed from its start, m does not arrive as measured'
