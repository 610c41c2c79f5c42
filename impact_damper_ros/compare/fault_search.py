"""
What is wrong where a log does not obey the equations of motion.

Intervals in which m turns, or begins or ends to rest, are followed event by event. Where a knot
does not follow from the one before, the rig of the theory runs on from the last sound joint state
before the trouble to the first one after it. If it gets there, the motion was right and a message
is wrong, missing or too many, and the expected one says by how much. If it does not, something
happened to the rig that is not logged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.event_map import (
    Trajectory,
    TrajectoryEvent,
    follow_trajectory,
    origin_at,
)
from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.hybrid_motion import RunawayError
from impact_damper_ros.rig.mode import REST_1, REST_2, STICK, rig_constants
from impact_damper_ros.rig.origin import offset_of

from .flight_check import Intervals, Knots, check_intervals, resting_place
from .recorded_stretch import ForceClock, RecordedImpacts
from .run_curves import Array

__all__ = ['Fault', 'FaultSearch', 'FollowedRig', 'Repair']


#: A stamp is rounded to the nanosecond; an impact is looked for so much later.
_ROUNDED_S = 2e-9
_ROUND_OFF = 1e-14
_WEAK = 1e-3
_RELATIVE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0]]
)


class FollowedRig:
    """
    Follows the rig between knots.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged; the stops are in their places.
    """

    def __init__(self, clock: ForceClock) -> None:
        self.rig = clock.counted_from_zero()
        self._clock = clock
        self._machine = rig_constants(self.rig)

    def course(
        self, knots: Knots, first: int, duration: float, *, differentiate: bool = False
    ) -> Trajectory | None:
        """Return the motion from just after a knot on."""
        x, z = float(knots.x[first]), float(knots.z[first])
        velocity = float(knots.velocity[first])
        relative = float(knots.damper_velocity[first]) - velocity
        half = self._machine.stop
        stop = int(knots.stop[first]) or resting_place(self.rig, z - x)
        beyond = {0: z - x - half, 1: 0.0, 2: -2.0 * half}[stop if relative == 0.0 else 0]
        if knots.stop[first]:
            beyond = 0.0 if stop == 1 else -2.0 * half
        resting = {0: STICK, 1: REST_1, 2: REST_2}[stop] if relative == 0.0 else 0
        origin = origin_at(
            self._machine,
            float(knots.time[first]) - self._clock.zero,
            x,
            velocity,
            beyond,
            relative,
            resting,
            int(knots.last_stop[first]),
        )
        try:
            return follow_trajectory(self._machine, origin, duration, differentiate=differentiate)
        except (ArithmeticError, RunawayError):
            # A wrong number may be one with which no rig can move.
            return None

    def out_of_reach(self, knots: Knots, first: int, last: int) -> bool:
        """Return whether a stop that follows m has still to come to its place."""
        y = np.abs(knots.z[[first, last]] - knots.x[[first, last]])
        beyond = y > self._machine.stop * (1.0 + 1e-9)
        return not self.rig.one_sided and bool((beyond & (knots.touched[[first, last]] > 0)).any())

    def next_knot(self, knots: Knots, first: int) -> Array | None:
        """Return X, X', Z and Z' just before the knot after the next interval."""
        last = first + 1
        duration = float(knots.time[last] - knots.time[first])
        at_impact = knots.stop[last] > 0.0
        course = self.course(knots, first, duration + (_ROUNDED_S if at_impact else 0.0))
        if course is None:
            return None
        hits = [i for i in course.events if i.kind is EventKind.IMPACT]
        speed = max(abs(float(knots.velocity[first])), abs(float(knots.damper_velocity[first])))
        # Of the weak impacts that end a chatter none is told.
        strong = [hit for hit in hits if abs(hit.relative_before) > _WEAK * speed]
        if not at_impact:
            return None if strong else _state_of(course)
        there = [hit for hit in hits if hit.time >= duration - _ROUNDED_S]
        if any(hit.time < duration - _ROUNDED_S for hit in strong) or not there:
            return None
        hit = there[0]
        if hit.stop != int(knots.stop[last]):
            return None
        half = self._machine.stop
        z = hit.x + (half if hit.stop == 1 else -half)
        return np.array([hit.x, hit.velocity_before, z, hit.velocity_before + hit.relative_before])

    def reaches(
        self, course: Trajectory, knots: Knots, last: int, tolerances: Array
    ) -> tuple[Array, bool]:
        """Return by how much a course misses a joint state, and whether that can be told."""
        missed = _recorded(knots, last) - _state_of(course)
        scale = np.array(
            [
                max(abs(float(knots.x[last])), abs(float(knots.z[last]))),
                max(abs(float(knots.velocity[last])), abs(float(knots.damper_velocity[last]))),
            ]
        )
        grown = np.abs(course.matrix) @ (_ROUND_OFF * np.tile(scale, 2))
        return missed, bool((grown < tolerances).all())


def _state_of(course: Trajectory) -> Array:
    """Return X, X', Z and Z' at the end."""
    end = course.end
    offset = offset_of(end.clearance_1, end.clearance_2, end.stop_1, end.stop_2)
    state: Array = _RELATIVE @ np.array([end.x, end.velocity, offset, end.relative_velocity])
    return state


def _recorded(knots: Knots, knot: int) -> Array:
    """Return X, X', Z and Z' just before a knot."""
    return np.array(
        [
            knots.x[knot],
            knots.velocity_before[knot],
            knots.z[knot],
            knots.damper_velocity_before[knot],
        ]
    )


#: Intervals that are followed event by event in a stretch, and troubles that are looked into.
_MOST_FOLLOWED = 4000
_MOST_TROUBLES = 200
_MOST_UNEXPLAINED = 25
_LONGEST_TROUBLE = 100_000
_STAMP_S = 1.1e-9
_MARGIN = 4.0
_QUANTITIES = (('X', 'm'), ("X'", 'm/s'), ('Z', 'm'), ("Z'", 'm/s'))


@dataclass(frozen=True)
class Fault:
    """
    One number of a log that is not as expected, or one message.

    Attributes
    ----------
    kind : str
        ``'impact'`` for a value of an impact, ``'missing'`` or ``'surplus'`` for an impact,
        ``'motion'`` where one knot does not follow from the one before.
    quantity, unit : str
        What is concerned.
    stop : int
        The stop of the impact, or 0.
    time : float
        Expected instant, or that of the first knot that does not follow, rig time, s.
    recorded, expected, tolerance : float
        The numbers; NaN for a message.
    """

    kind: str
    quantity: str
    unit: str
    stop: int
    time: float
    recorded: float
    expected: float
    tolerance: float


@dataclass(frozen=True)
class Repair:
    """The impacts that should stand in a log from just after `start` to `end`, s."""

    start: float
    end: float
    impacts: RecordedImpacts


class FaultSearch:
    """
    Looks through a stretch, part by part.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    in_closed_form : bool, optional
        Whether nothing can be followed event by event, since a control moves the stops or the
        force is a multisine. Then unsound intervals are counted, and that is all.

    Attributes
    ----------
    faults : list of Fault
        What is wrong.
    repairs : list of Repair
        What should stand there instead.
    intervals, plain, followed, unsound : int
        Intervals seen; checked in closed form; followed event by event; not sound at first sight.
    unexplained : int
        Troubles after which the rig was not where it should have been.
    """

    def __init__(self, clock: ForceClock, *, in_closed_form: bool = False) -> None:
        self.faults: list[Fault] = []
        self.repairs: list[Repair] = []
        self.intervals = self.plain = self.followed = self.unsound = self.unexplained = 0
        self.in_closed_form = in_closed_form
        self._clock = clock
        self._rig = FollowedRig(clock)
        self._held: Knots | None = None
        self._troubles = 0

    @property
    def verified(self) -> float:
        """Share of the intervals that were checked, in one way or the other."""
        done = self.plain + self.followed
        return min(1.0, done / self.intervals) if self.intervals else 0.0

    def look(self, knots: Knots, *, final: bool = False) -> None:
        """Take the next knots."""
        if self._held is not None:
            knots = Knots.joined([self._held, knots])
        self._held = None
        if len(knots) < 2:
            self._held = knots
            return
        found = check_intervals(self._clock, knots)
        end = len(knots) - 1
        unsound = found.plain & ~found.sound
        if not self.in_closed_form:
            wrong = self._wrong_intervals(knots, found)
            for first, last in _troubles(wrong, knots.stop == 0.0):
                if last == end and not final and end - first < _LONGEST_TROUBLE:
                    # What is wrong here may go on in the next part.
                    end = first
                    break
                self._look_into(knots, first, last, wrong, found)
        else:
            self._single_out(knots, found)
        self.intervals += end
        self.plain += int(found.plain[:end].sum())
        self.unsound += int(unsound[:end].sum())
        self._held = knots[end:]

    def _single_out(self, knots: Knots, found: Intervals) -> None:
        """Look for joint states that do not fit, where those around them fit together."""
        doubtful = ~found.sound
        unsound = found.plain & doubtful
        between = (doubtful[:-1] & doubtful[1:]) & (unsound[:-1] | unsound[1:])
        places = np.flatnonzero(between & (knots.stop[1:-1] == 0.0)) + 1
        if not len(places) or len(places) > _MOST_FOLLOWED:
            return
        around = np.column_stack([places - 1, places + 1]).ravel()
        fits = check_intervals(self._clock, knots[around]).sound[::2]
        for place in places[fits]:
            if self.unexplained < _MOST_UNEXPLAINED:
                self.unexplained += 1
                first = int(place) - 1
                self.faults.append(
                    _unexplained(knots, first if found.plain[first] else first + 1, found)
                )

    def _wrong_intervals(self, knots: Knots, found: Intervals) -> NDArray[np.bool_]:
        """Return which intervals do not lead to their next knot, not even event by event."""
        wrong = found.plain & ~found.sound
        doubtful = np.flatnonzero(~found.sound)
        if wrong.sum() > _MOST_FOLLOWED:
            return wrong
        for index in doubtful:
            first = int(index)
            if self._rig.out_of_reach(knots, first, first + 1):
                # Whether m turned meanwhile cannot be found out so.
                wrong[first] = False
                continue
            if self.followed >= _MOST_FOLLOWED:
                continue
            self.followed += not found.plain[first]
            expected = self._rig.next_knot(knots, first)
            if expected is None:
                wrong[first] = True
                continue
            off = np.abs(_before(knots, first + 1) - expected)
            wrong[first] = not bool((off <= _MARGIN * found.tolerances).all())
        return wrong

    def _look_into(
        self, knots: Knots, first: int, last: int, wrong: NDArray[np.bool_], found: Intervals
    ) -> None:
        """Follow the rig from one joint state to another; the knots between are in doubt."""
        if self._troubles >= _MOST_TROUBLES or self.unexplained >= _MOST_UNEXPLAINED:
            return
        self._troubles += 1
        duration = float(knots.time[last] - knots.time[first])
        course = None
        if self._rig.rig.one_sided or not self._rig.out_of_reach(knots, first, last):
            course = self._rig.course(knots, first, duration, differentiate=True)
        if course is not None:
            tolerances = _MARGIN * found.tolerances
            missed, telling = self._rig.reaches(course, knots, last, tolerances)
            if telling and bool((np.abs(missed) <= tolerances).all()):
                self._compare(course, knots, first, last, found)
                return
        self.unexplained += 1
        index = first + int(np.argmax(wrong[first:last]))
        self.faults.append(_unexplained(knots, index, found))

    def _compare(
        self, course: Trajectory, knots: Knots, first: int, last: int, found: Intervals
    ) -> None:
        """Hold the recorded impacts between two knots against the expected ones."""
        start = float(knots.time[first])
        hits = [i for i in course.events if i.kind is EventKind.IMPACT]
        rows = [k for k in range(first + 1, last + 1) if knots.stop[k] > 0.0]
        faults: list[Fault] = []
        for row, hit in _pairs(knots, rows, hits, start):
            if row is not None and hit is not None:
                faults += self._differences(knots, row, hit, start, found)
            elif hit is not None:
                faults.append(_message('missing', hit.stop, start + hit.time))
            elif row is not None:
                faults.append(_message('surplus', int(knots.stop[row]), float(knots.time[row])))
        if not faults:
            # A joint state between them is wrong.
            self.unexplained += 1
            self.faults.append(_unexplained(knots, first, found))
            return
        self.faults += faults
        repair = Repair(start, float(knots.time[last]), self._expected(hits, start))
        self.repairs.append(repair)

    def _differences(
        self, knots: Knots, row: int, hit: TrajectoryEvent, start: float, found: Intervals
    ) -> Iterator[Fault]:
        tol_x, tol_v, _, tol_w = (_MARGIN * float(t) for t in found.tolerances)
        mass = self._rig.rig.primary_mass
        after = hit.velocity_after + hit.relative_after
        before = float(knots.velocity[row] - knots.velocity_before[row])
        impulse = mass * (hit.velocity_after - hit.velocity_before)
        stamp = _STAMP_S + 4.5e-16 * abs(start)
        damper = float(knots.damper_velocity[row])
        for quantity, unit, recorded, expected, tolerance in (
            ('instant', 's', float(knots.time[row]), start + hit.time, stamp),
            ('X', 'm', float(knots.x[row]), hit.x, tol_x),
            ("X' after", 'm/s', float(knots.velocity[row]), hit.velocity_after, tol_v),
            ("Z' after", 'm/s', damper, after, tol_w),
            ('impulse', 'N s', mass * before, impulse, mass * tol_v),
        ):
            if not abs(recorded - expected) <= tolerance:
                time = start + hit.time
                yield Fault(
                    'impact', quantity, unit, hit.stop, time, recorded, expected, tolerance
                )

    def _expected(self, hits: Sequence[TrajectoryEvent], start: float) -> RecordedImpacts:
        if not hits:
            return RecordedImpacts.none()
        rig = self._rig.rig
        half = 0.5 * rig.gap
        impulses = [rig.primary_mass * (h.velocity_after - h.velocity_before) for h in hits]
        columns = [
            [start + h.time for h in hits],
            [float(h.stop) for h in hits],
            [h.x for h in hits],
            [h.x + (half if h.stop == 1 else -half) for h in hits],
            [h.velocity_after for h in hits],
            [h.velocity_after + h.relative_after for h in hits],
            impulses,
            [-impulse for impulse in impulses],
        ]
        return RecordedImpacts(*(np.array(column) for column in columns))


def _before(knots: Knots, knot: int) -> Array:
    """Return X, X', Z and Z' just before a knot."""
    columns = (knots.x, knots.velocity_before, knots.z, knots.damper_velocity_before)
    return np.array([column[knot] for column in columns])


def _message(kind: str, stop: int, time: float) -> Fault:
    return Fault(kind, 'impact', '', stop, time, math.nan, math.nan, math.nan)


def _unexplained(knots: Knots, index: int, found: Intervals) -> Fault:
    """Return what is worst about the end of an interval."""
    if not found.plain[index]:
        return _message('motion', 0, float(knots.time[index + 1]))
    residuals = found.residuals[index]
    shares = np.nan_to_num(np.abs(residuals) / found.tolerances, nan=np.inf)
    worst = int(np.argmax(shares))
    recorded = float(_before(knots, index + 1)[worst])
    return Fault(
        'motion',
        *_QUANTITIES[worst],
        0,
        float(knots.time[index + 1]),
        recorded,
        recorded - float(residuals[worst]),
        float(found.tolerances[worst]),
    )


def _troubles(wrong: NDArray[np.bool_], samples: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the joint states, or ends, around each group of wrong intervals."""
    places = np.flatnonzero(samples)
    end = len(wrong)
    reached = 0
    for index in np.flatnonzero(wrong):
        if index < reached:
            continue
        before = int(np.searchsorted(places, index, side='right')) - 1
        first = int(places[before]) if before >= 0 else 0
        last = int(index) + 1
        while True:
            after = int(np.searchsorted(places, last))
            last = int(places[after]) if after < len(places) else end
            # One joint state on the wrong side of a shifted impact is not a sound one.
            if last >= end or not wrong[last]:
                break
            last += 1
        yield max(first, reached), last
        reached = last


def _pairs(
    knots: Knots, rows: Sequence[int], hits: Sequence[TrajectoryEvent], start: float
) -> Iterator[tuple[int | None, TrajectoryEvent | None]]:
    """Yield recorded with expected impacts; None for what has no counterpart."""
    if [int(knots.stop[row]) for row in rows] == [hit.stop for hit in hits]:
        yield from zip(rows, hits, strict=True)
        return
    left, due = list(rows), list(hits)
    while left and due:
        row, hit = left[0], due[0]
        same = int(knots.stop[row]) == hit.stop
        late = float(knots.time[row]) - (start + hit.time)
        if same and (len(left) == len(due) or abs(late) <= _STAMP_S):
            yield left.pop(0), due.pop(0)
        elif len(left) > len(due):
            yield left.pop(0), None
        else:
            yield None, due.pop(0)
    yield from ((row, None) for row in left)
    yield from ((None, hit) for hit in due)
