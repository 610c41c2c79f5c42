# SPDX-License-Identifier: Apache-2.0
"""
The course revised until the exact engine computes it again.

In each round every flight is replayed by the engine (`replayed_course`), and the resulting course
is fitted, without flights that contradict the others (`contradictions`). A round that makes the
fit worse is undone. At the end each flight has one verdict, and rejected flights are left out. A
fit is judged by the number of flights that remain, and by their residuals.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from .contradictions import (
    CONTRADICTION,
    MOST_GAIN,
    Problem,
    contradiction_of,
    gains_of,
    to_release,
    without_contradictions,
)
from .course import Course, Flags
from .first_course import WRONG_RIG, UnfitRecordError
from .gauss_newton import FitSolution, solve
from .replayed_course import RESTS, Memory, ReplayedCourse
from .shooting import Shooting
from .vibration import Array

#: Most rounds of the revision, and most rounds of verdicts.
_MOST_ROUNDS, _MOST_VERDICTS = 6, 8
#: Share of flights below which a course is given up, and rounds before that.
_HOPELESS, _EARLY = 0.5, 2
#: Largest law, in standard deviations of the data, that counts as exact.
_EXACT = 5e-2
#: Rise of chi that undoes a round, most undone rounds, and rounds that leave contradictions.
_WORSE, _MOST_UNDONE, _MOST_CONTRARY = 1.15, 3, 2
#: Most rounds that begin with one course; a flight cut twice at an instant stays cut.
_MOST_REPEATS = 3
#: A replay ends at the impact if it is there within this many samples or this part of a period.
_SAMPLES, _PART = 1.2, 0.025
#: An impact slower than this part of the median speed is doubtful.
_GRAZING = 0.02
#: Why flights are left out whose reversal may be none, or whose laws are not put to a test.
FLAT, UNCONFIRMED = 'm hardly reverses in it', 'no other flight confirms it'
#: Times of one impact are this close between rounds, in natural periods.
_SAME = 0.05


class Revised(NamedTuple):
    """
    The revised course.

    Attributes
    ----------
    course : Course
        The course with the numbers of the last fit.
    shooting : Shooting
        Equations of the course.
    solution : Solution
        Solution of the equations.
    gains : ndarray
        Fall of the sum of squares if the laws of each flight did not hold.
    why_cut : dict
        Why flights were left out, by the index of the impact at their end.
    """

    course: Course
    shooting: Shooting
    solution: FitSolution
    gains: Array
    why_cut: dict[int, str]

    @property
    def chi(self) -> float:
        """Root of the mean square of the residuals of the data, in standard deviations."""
        return chi_of(self.shooting, self.solution)

    @property
    def unclear(self) -> int:
        """
        Number of flights left out that say neither that the model is right nor that it is wrong.

        The engine makes them as measured, but m rests on a stop or hardly reverses in them.
        """
        return self._left_out(RESTS, FLAT)

    @property
    def obey(self) -> int:
        """
        Number of flights that the model explains.

        They count in the fit, or would if a neighbour confirmed them (`UNCONFIRMED`).
        """
        return int(self.course.flies.sum()) + self.unconfirmed

    @property
    def unconfirmed(self) -> int:
        """Number of flights that are left out only since no other one confirms them."""
        return self._left_out(UNCONFIRMED)

    def _left_out(self, *whys: str) -> int:
        """Return the number of flights that are left out for one of some reasons of `why_cut`."""
        return sum(self.why_cut.get(int(k)) in whys for k in np.flatnonzero(self.course.begins))

    @property
    def grazes(self) -> Flags:
        """Doubtful impacts: hardly faster than M, and without a measured time."""
        course, shooting, u = self.course, self.shooting, self.solution.unknowns
        inner = ~course.begins
        if not inner.any():
            return course.begins & ~inner
        speed = np.where(inner, shooting.speeds(u), np.inf)
        grazing: Flags = (speed < _GRAZING * np.median(speed[inner])) & (course.measured < 0)
        return grazing

    def verdicts(self) -> dict[int, str]:
        """
        Return the flights to leave out, with the reasons.

        The engine must reproduce each flight. Its events must be the same for parameters near the
        fitted ones: where m hardly reverses the instant is fixed, and a doubtful impact requires
        that m touches the stop exactly; both would determine the parameters too well. Beside a
        rejected flight, instant and velocity of m are free at an impact that was not measured: any
        number of reversals meets the laws there, and friction on M is a guess; so it is between
        two rejected flights. And chi squared must not fall by much if its laws are released.
        """
        course, shooting = self.course, self.shooting
        tolerance, same = _tolerances(shooting)
        turn = ReplayedCourse(course, shooting, Memory(same), {}, tolerance)
        grazes, free = self.grazes, course.measured < 0
        # What is beside an unconfirmed flight has been confirmed by that.
        breaks = np.append(course.begins, True)
        breaks[[k for k, why in self.why_cut.items() if why == UNCONFIRMED]] = False
        before, after = breaks[:-2], breaks[2:]
        alone = (before & after) | (before & free[:-1]) | (after & free[1:])
        found: dict[int, str] = {}
        for k in map(int, np.flatnonzero(course.flies)):
            if not turn.confirms(k):
                found[k] = 'computed from its start, m does not arrive as measured'
            elif course.held[k].any():
                found[k] = FLAT
            elif grazes[k] or grazes[k + 1]:
                found[k] = 'm hardly touches a stop'
            elif alone[k]:
                found[k] = UNCONFIRMED
        dear = to_release(self.gains, MOST_GAIN) or (
            unmet(shooting, self.solution) if self.solution.broken > _EXACT and not found else {}
        )
        return found | {k: contradiction_of(gain) for k, gain in dear.items() if course.flies[k]}

    def without_rejected(self, problem: Problem) -> Revised:
        """Leave out rejected flights until the verdicts reject none."""
        found = self
        for _ in range(_MOST_VERDICTS):
            rejected = found.verdicts()
            if not rejected:
                break
            course, why_cut = found.course.copy(), dict(found.why_cut)
            for k, why in rejected.items():
                course.leave_out(k)
                why_cut[k + 1] = why
            found = found._replace(course=course, why_cut=why_cut)
            if not course.flies.any():
                break
            found = found.solve(problem)
        return found

    def solve(self, problem: Problem, course: Course | None = None) -> Revised:
        """Return the fit of the course, or of the course with other numbers."""
        shooting = problem(course or self.course)
        solution = solve(shooting, shooting.start())
        return self._replace(
            course=shooting.course_of(solution.unknowns),
            shooting=shooting,
            solution=solution,
            gains=gains_of(shooting, solution),
        )


def chi_of(shooting: Shooting, solution: FitSolution) -> float:
    """Return the root of the mean square of the residuals of the data."""
    n = len(shooting.record.time)
    residual = solution.equations.residual[:n]
    used = int(shooting.motion(solution.unknowns)[1].sum())
    free = max(1, used - shooting.freedom)
    return float(np.sqrt(np.sum(residual**2) / free))


def _tolerances(shooting: Shooting) -> tuple[float, float]:
    """Return the tolerances of the end of a replay and of times of one impact, s."""
    step = float(np.median(np.diff(shooting.record.time)))
    period = 2.0 * np.pi / shooting.rate
    return max(_SAMPLES * step, _PART * period), _SAME * period


def revise(course: Course, problem: Problem) -> Revised:
    """
    Revise and fit a course until it does not change, or for `_MOST_ROUNDS` rounds.

    Raises
    ------
    UnfitRecordError
        If rounds end with flights that contradict the others, though many were left out.
    """
    shooting = problem(course)
    tolerance, same = _tolerances(shooting)
    memory = Memory(same)
    course, least_chi = _first_fit(course, problem)
    undone = contrary = 0
    gains_now: dict[int, float] = {}
    kept: Revised | None = None
    seen: Counter[object] = Counter()
    for number in range(_MOST_ROUNDS):
        turn = ReplayedCourse(course, shooting, memory, gains_now, tolerance)
        proposed = turn.revise()
        if kept and not turn.changed and proposed.structure == course.structure:
            kept = kept._replace(why_cut=turn.why_cut)
            gains_now = {} if kept.solution.broken < _EXACT else unmet(shooting, kept.solution)
            if not gains_now:
                break
            continue
        state = proposed.structure, tuple(gains_now)
        seen[state] += 1
        if kept and seen[state] > _MOST_REPEATS:
            break  # the the rounds alternate
        shooting = problem(proposed)
        shooting, solution, gains = without_contradictions(
            problem, shooting, turn.why_cut, softly=True
        )
        contrary += bool(to_release(gains, CONTRADICTION))
        cut_again = shooting.course.begins & ~proposed.begins
        memory.cuts += [(time, 1) for time in shooting.course.time[cut_again].tolist()]
        proposed = shooting.course
        chi = chi_of(shooting, solution)
        worse = chi > _WORSE * max(1.0, least_chi)
        if worse and turn.risky and undone < _MOST_UNDONE:
            shooting, gains_now = problem(course), {}
            memory.cuts += [(time, 2) for time in turn.risky]
            undone += 1
            continue
        course = shooting.course_of(solution.unknowns)
        least_chi = min(least_chi, chi)
        gains_now = to_release(gains, MOST_GAIN)
        if solution.broken > 1.0 and not gains_now:
            gains_now = unmet(shooting, solution)
        kept = Revised(course, shooting, solution, gains, turn.why_cut)
        if contrary >= _MOST_CONTRARY:
            raise UnfitRecordError(
                f'flights contradict each other, whichever of them are left out: {WRONG_RIG}'
            )
        if course.flies.mean() < _HOPELESS * (number >= _EARLY) or not course.flies.any():
            break
    assert kept is not None
    return kept


def unmet(shooting: Shooting, solution: FitSolution) -> dict[int, float]:
    """Return the flight with the largest violation of a law of m, to be cut; none if M has it."""
    laws = np.abs(solution.equations.condition)
    flight = int(shooting.law_flights[int(laws.argmax())])
    return {flight: 1e3 * float(laws.max())} if flight >= 0 else {}


def _first_fit(course: Course, problem: Problem) -> tuple[Course, float]:
    """Return the course with exact laws if they fit, or the same course, and its chi."""
    shooting = problem(course)
    u = shooting.start()
    used = max(1, int(shooting.motion(u)[1].sum()))
    residual = shooting.residual(u)[0][: len(shooting.record.time)]
    chi = float(np.sqrt(np.sum(residual**2) / used))
    shooting, solution, _ = without_contradictions(problem, shooting, {}, softly=False)
    exact = chi_of(shooting, solution)
    if exact < _WORSE * chi and solution.broken < 1.0:
        return shooting.course_of(solution.unknowns), min(exact, chi)
    return course, min(exact, chi)
