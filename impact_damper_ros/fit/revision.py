# SPDX-License-Identifier: Apache-2.0
"""
The course revised until the exact engine computes it again.

In each round every flight is replayed by the engine, from its fitted start. Its reversals become
nodes. A flight that sticks, or does not end as it was fitted, is cut out; it is joined again once
the replay agrees. An impact that the engine has before the end is inserted: without measured times
always, with them only where there is a measured one to spare. An impact that the engine passes is
removed. Then the course is fitted again. A flight whose release would reduce the sum of squares by
much is cut out, too. A round that makes the fit worse is undone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .course import Course, Flags
from .first_course import matched
from .flight_replay import FlightReplay, Passage, passage, start_velocity
from .gauss_newton import Solution, gains_of_release, solve
from .relaxation import Problem
from .shooting import Shooting
from .vibration import Array

MOST_ROUNDS = 14
#: A fall of the sum of squares beyond which the laws of a flight are not believed.
MOST_GAIN = 20.0
#: Largest law, in standard deviations of the data, that counts as exact.
EXACT = 5e-2
#: Rise of chi that undoes a round, and how often that is done.
_WORSE, _MOST_UNDONE = 1.15, 3
#: For how long a flight is replayed beyond its end, in natural periods.
_MARGIN = 0.15
#: A replay ends at the impact if it is there within this many samples or this part of a period,
#: or within this many deviations of a measured time.
_SAMPLES, _PART, _DEVIATIONS = 1.2, 0.025, 4.0
#: Times of one impact are this close between rounds, in natural periods.
_SAME = 0.05
_FLAT = 0.1
#: Fall of the sum of squares at which a fit with soft laws ends.
_ROUGH = 1.0
#: Median of the square of a normal variable; residuals of a flight that are too large, in standard
#: deviations of their sum of squares.
_MEDIAN, _LARGE = 0.4549, 6.0
#: Fall of the sum of squares for which a flight is cut before any replay, and how often.
_CONTRADICTION, _MOST_RELEASES = 100.0, 6
#: Least friction of the replay, m/s^2.
_LEAST_GRIP = 1e-9


class Revised(NamedTuple):
    """
    The course as revised, and how that ended.

    Attributes
    ----------
    course : Course
        With the numbers of the last fit.
    shooting : Shooting
        Its equations.
    solution : Solution
        Where they are solved.
    gains : ndarray
        Fall of the sum of squares if the laws of each flight did not hold.
    unchanged : bool
        Whether the last round changed nothing.
    rounds : int
        How many there were.
    why_cut : dict
        Why flights were left out, by the index of the impact at their end.
    """

    course: Course
    shooting: Shooting
    solution: Solution
    gains: Array
    unchanged: bool
    rounds: int
    why_cut: dict[int, str]

    @property
    def chi(self) -> float:
        """Root of the mean square of the residuals of the data, in standard deviations."""
        return chi_of(self.shooting, self.solution)


def chi_of(shooting: Shooting, solution: Solution) -> float:
    """Return the root of the mean square of the residuals of the data."""
    n = len(shooting.record.time)
    residual = solution.equations.residual[:n]
    used = int(shooting.motion(solution.unknowns)[1].sum())
    free = max(1, used - shooting.freedom)
    return float(np.sqrt(residual @ residual / free))


@dataclass
class _Memory:
    """What earlier rounds have found, by instants, since the numbers of the flights change."""

    same: float
    cuts: list[tuple[float, int]] = field(default_factory=list)
    starts: list[tuple[float, int]] = field(default_factory=list)

    def count(self, entries: list[tuple[float, int]], time: float) -> int:
        """Return how often something happened at an instant."""
        return sum(times for at, times in entries if abs(at - time) < self.same)


class _Round:
    """One round: what the engine says of each flight, and the course that follows."""

    def __init__(
        self,
        course: Course,
        shooting: Shooting,
        memory: _Memory,
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


def _gains(shooting: Shooting, solution: Solution) -> Array:
    """
    Return how much each flight costs: its laws, or residuals of its own that are too large.

    A flight of n samples has n squares, with a deviation of sqrt(2 n).
    """
    gains = gains_of_release(shooting, solution)
    n = len(shooting.record.time)
    residual = solution.equations.residual[:n]
    counts = shooting.motion(solution.unknowns)[1]
    flight = np.searchsorted(shooting.course_of(solution.unknowns).time, shooting.record.time) - 1
    inside = counts & (flight >= 0) & (flight < len(gains))
    sums = np.bincount(flight[inside], residual[inside] ** 2, len(gains))
    sizes = np.bincount(flight[inside], minlength=len(gains))
    level = max(1.0, float(np.median(residual[inside] ** 2)) / _MEDIAN) if inside.any() else 1.0
    excess = sums / level - sizes
    too_large = excess > _LARGE * np.sqrt(2.0 * np.maximum(sizes, 1))
    return np.maximum(gains, np.where(too_large, excess, 0.0))


def _to_release(gains: Array, limit: float) -> dict[int, float]:
    """Return the flights whose laws are not believed, the worst ones of neighbours."""
    chosen: dict[int, float] = {}
    order = np.argsort(gains)[::-1][:3]
    top = float(gains[order[0]]) if len(order) else 0.0
    for k in map(int, order):
        if gains[k] > max(limit, 0.5 * top) and not {k - 1, k + 1} & set(chosen):
            chosen[k] = float(gains[k])
    return chosen


def revised(course: Course, problem: Problem, *, report: bool = False) -> Revised:
    """Revise and fit a course until nothing changes, or for `MOST_ROUNDS` rounds."""
    shooting = problem(course)
    step = float(np.median(np.diff(shooting.record.time)))
    timed = len(shooting.impact_times) > 0
    period = 2.0 * np.pi / shooting.rate
    tolerance = max(_SAMPLES * step, _PART * period)
    if timed:
        tolerance = _DEVIATIONS * shooting.impact_deviation
    memory = _Memory(_SAME * period)
    course, least_chi = _first_fit(course, problem)
    undone = 0
    gains_now: dict[int, float] = {}
    kept: Revised | None = None
    seen: set[object] = set()
    for number in range(MOST_ROUNDS):
        turn = _Round(course, shooting, memory, gains_now, tolerance)
        proposed = turn.revise()
        if kept and not turn.log and proposed.structure == course.structure:
            return kept._replace(
                unchanged=kept.solution.broken < EXACT, rounds=number, why_cut=turn.why_cut
            )
        if kept and (proposed.structure, tuple(gains_now)) in seen:
            break  # rounds alternate
        seen.add((proposed.structure, tuple(gains_now)))
        shooting = problem(proposed)
        u = solve(shooting, shooting.start(), soft=1.0, most=12, least_gain=_ROUGH).unknowns
        shooting, solution, gains = _without_contradictions(problem, shooting, u, turn.why_cut)
        cut_again = shooting.course.begins & ~proposed.begins
        memory.cuts += [(time, 1) for time in shooting.course.time[cut_again].tolist()]
        proposed = shooting.course
        chi = chi_of(shooting, solution)
        laws = np.abs(solution.equations.condition)
        if report:
            print(
                f'  {number}: chi {chi:.3f} laws {laws.max(initial=0.0):.1e} '
                f'{int(proposed.flies.sum())}/{len(proposed) - 1} flights, '
                f'gain {gains.max(initial=0.0):.1f}',
                turn.log,
                flush=True,
            )
        worse = chi > _WORSE * max(1.0, least_chi)
        if worse and turn.risky and undone < _MOST_UNDONE:
            shooting, gains_now = problem(course), {}
            memory.cuts += [(time, 2) for time in turn.risky]
            undone += 1
            continue
        course = shooting.course_of(solution.unknowns)
        least_chi = min(least_chi, chi)
        gains_now = _to_release(gains, MOST_GAIN)
        if laws.max(initial=0.0) > 1.0 and not gains_now:
            flight = int(shooting.law_flights[int(laws.argmax())])
            gains_now = {flight: 1e3 * float(laws.max())} if flight >= 0 else {}
        kept = Revised(course, shooting, solution, gains, False, number + 1, turn.why_cut)
    assert kept is not None
    return kept


def _without_contradictions(
    problem: Problem, shooting: Shooting, u: Array, why_cut: dict[int, str]
) -> tuple[Shooting, Solution, Array]:
    """
    Fit a course, and cut flights that contradict all others before anything is replayed.

    They would spoil the parameters, and with these the replay of every other flight.
    """
    solution = solve(shooting, u)
    gains = _gains(shooting, solution)
    for _ in range(_MOST_RELEASES):
        chosen = _to_release(gains, _CONTRADICTION)
        if not chosen:
            break
        course = shooting.course_of(solution.unknowns)
        for k, gain in chosen.items():
            course.begins[k + 1] = True
            course.reversals[k], course.held[k] = np.zeros(0), np.zeros(0, bool)
            why_cut[k + 1] = f'its laws cost {gain:.0f} in the sum of squares'
        shooting = problem(course)
        u = solve(shooting, shooting.start(), soft=1.0, most=12, least_gain=_ROUGH).unknowns
        solution = solve(shooting, u)
        gains = _gains(shooting, solution)
    return shooting, solution, gains


def _first_fit(course: Course, problem: Problem) -> tuple[Course, float]:
    """Return the course with exact laws if they fit, or as it is, and the chi of it."""
    shooting = problem(course)
    u = shooting.start()
    used = max(1, int(shooting.motion(u)[1].sum()))
    residual = shooting.residual(u)[0][: len(shooting.record.time)]
    chi = float(np.sqrt(residual @ residual / used))
    shooting, solution, _ = _without_contradictions(problem, shooting, u, {})
    exact = chi_of(shooting, solution)
    if exact < _WORSE * chi and solution.broken < 1.0:
        return shooting.course_of(solution.unknowns), min(exact, chi)
    return course, min(exact, chi)
