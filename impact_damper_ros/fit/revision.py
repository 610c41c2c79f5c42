# SPDX-License-Identifier: Apache-2.0
"""
The course revised until the exact engine computes it again.

In each round every flight is replayed by the engine (`replayed_course`), and what follows from it
is fitted, without flights that contradict the others (`contradictions`). A round that makes the
fit worse is undone. What was cut by the parameters of early rounds is tried again in another pass,
since they are better by then.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from .contradictions import MOST_GAIN, gains_of, to_release, without_contradictions
from .course import Course
from .gauss_newton import Solution, solve
from .relaxation import Problem
from .replayed_course import Memory, ReplayedCourse
from .shooting import Shooting
from .vibration import Array

#: Rounds of a pass, and passes.
_MOST_ROUNDS, _MOST_PASSES = 6, 3
#: Steps in which what alternates is left out at the end.
_MOST_SETTLED = 10
#: Least part of the flights that must be used, that from which on no other pass is made, and that
#: below which nothing helps after so many rounds.
LEAST_USED, _ENOUGH, _HOPELESS, _EARLY = 0.75, 0.93, 0.5, 2
#: Least part of the flights of a pass that another pass may improve.
_PROMISING = 0.75
#: Largest law, in standard deviations of the data, that counts as exact.
EXACT = 5e-2
#: Rise of chi that undoes a round, and how often that is done.
_WORSE, _MOST_UNDONE = 1.15, 3
#: Rounds that may begin with one course; what is cut twice at an instant stays cut.
_MOST_REPEATS = 3
#: A replay ends at the impact if it is there within this many samples or this part of a period,
#: or within this many deviations of a measured time.
_SAMPLES, _PART, _DEVIATIONS = 1.2, 0.025, 4.0
#: An impact slower than this part of the median one may be none.
_GRAZING = 0.02
#: Times of one impact are this close between rounds, in natural periods.
_SAME = 0.05


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
    doubtful : int
        How many of them obey the laws, but are left out by `without_doubtful`.
    """

    course: Course
    shooting: Shooting
    solution: Solution
    gains: Array
    unchanged: bool
    rounds: int
    why_cut: dict[int, str]
    doubtful: int = 0

    @property
    def chi(self) -> float:
        """Root of the mean square of the residuals of the data, in standard deviations."""
        return chi_of(self.shooting, self.solution)

    def without_doubtful(self) -> Revised:
        """
        Leave out flights whose course is another one for parameters near the fitted ones.

        Where m hardly reverses the instant is held, and an impact that may be none demands that m
        touches the stop exactly; both would say more of the parameters than is known. Where the
        motion begins anew at an impact that was not measured, m may as well stick before the next
        one: its velocity is free, so that any reversal fits, and friction on M is a guess.
        """
        course, shooting = self.course.copy(), self.shooting
        u, why_cut = self.solution.unknowns, dict(self.why_cut)
        alpha = shooting.parts(u)[0][shooting.alpha_column[shooting.impacts]]
        inner = ~course.begins
        speed = np.where(inner, np.abs(alpha * shooting.jumps(u)), np.inf)
        grazes = speed < _GRAZING * np.median(speed[inner]) if inner.any() else course.begins
        grazes &= course.measured < 0
        held = np.array([bool(flags.any()) for flags in course.held], bool)
        doubtful = np.flatnonzero(course.flies & (held | grazes[1:] | grazes[:-1]))
        for k in map(int, doubtful):
            course.leave_out(k)
            why_cut[k + 1] = 'm hardly reverses in it' if held[k] else 'm hardly touches a stop'
        timed = len(shooting.impact_times) > 0
        guessed = 0
        for k in range(len(course) - 1):
            free = course.flies[k] and course.begins[k] and course.measured[k] < 0
            if free and (timed or len(course.reversals[k])):
                course.leave_out(k)
                why_cut[k + 1] = 'the motion of m before it is not known'
                guessed += 1
        return self._replace(course=course, why_cut=why_cut, doubtful=len(doubtful) + guessed)


def chi_of(shooting: Shooting, solution: Solution) -> float:
    """Return the root of the mean square of the residuals of the data."""
    n = len(shooting.record.time)
    residual = solution.equations.residual[:n]
    used = int(shooting.motion(solution.unknowns)[1].sum())
    free = max(1, used - shooting.freedom)
    return float(np.sqrt(residual @ residual / free))


def revised(course: Course, problem: Problem) -> Revised:
    """Revise and fit a course in passes, until nothing changes or a pass does not improve it."""
    found, rounds = _passed(course, problem), 0
    for _ in range(_MOST_PASSES - 1):
        used = int(found.course.flies.sum())
        part = used / (len(found.course) - 1)
        if part < _PROMISING or (found.unchanged and part >= _ENOUGH):
            break
        rounds += found.rounds
        again = _passed(found.course, problem)
        if (again.unchanged, int(again.course.flies.sum())) <= (found.unchanged, used):
            break
        found = again
    found = found._replace(rounds=rounds + found.rounds)
    for _ in range(_MOST_SETTLED):
        if found.unchanged or found.course.flies.mean() < _HOPELESS:
            break
        found = _settled(found, problem)
    return found


def _settled(found: Revised, problem: Problem) -> Revised:
    """Leave out the flights in which rounds alternate: those that the engine does not confirm."""
    course, shooting = found.course.copy(), found.shooting
    tolerance, same = _tolerances(shooting)
    turn = ReplayedCourse(course, shooting, Memory(same), {}, tolerance)
    wrong = [k for k in map(int, np.flatnonzero(course.flies)) if not turn.confirms(k)]
    solution, why_cut = found.solution, dict(found.why_cut)
    if not wrong and solution.broken < EXACT:
        return found._replace(unchanged=True, gains=gains_of(shooting, solution))
    for k in wrong or _unmet(shooting, solution):
        course.leave_out(k)
        why_cut[k + 1] = 'the engine does not arrive as measured'
    shooting = problem(course)
    solution = solve(shooting, shooting.start())
    course = shooting.course_of(solution.unknowns)
    gains = gains_of(shooting, solution)
    return found._replace(
        course=course, shooting=shooting, solution=solution, gains=gains, why_cut=why_cut
    )


def _tolerances(shooting: Shooting) -> tuple[float, float]:
    """Return how far a replay may end from an impact, and how close times of one impact are, s."""
    step = float(np.median(np.diff(shooting.record.time)))
    period = 2.0 * np.pi / shooting.rate
    return max(_SAMPLES * step, _PART * period), _SAME * period


def _passed(course: Course, problem: Problem) -> Revised:
    """Revise and fit a course until nothing changes, or for `_MOST_ROUNDS` rounds."""
    shooting = problem(course)
    tolerance, same = _tolerances(shooting)
    memory = Memory(same)
    course, least_chi = _first_fit(course, problem)
    undone = 0
    gains_now: dict[int, float] = {}
    kept: Revised | None = None
    seen: Counter[object] = Counter()
    for number in range(_MOST_ROUNDS):
        turn = ReplayedCourse(course, shooting, memory, gains_now, tolerance)
        proposed = turn.revise()
        if kept and not turn.changed and proposed.structure == course.structure:
            kept = kept._replace(rounds=number, why_cut=turn.why_cut)
            if kept.solution.broken < EXACT:
                return kept._replace(unchanged=True)
            gains_now = _unmet(kept.shooting, kept.solution)
            if not gains_now:
                return kept
            continue
        state = proposed.structure, tuple(gains_now)
        seen[state] += 1
        if kept and seen[state] > _MOST_REPEATS:
            break  # rounds alternate
        shooting = problem(proposed)
        shooting, solution, gains = without_contradictions(
            problem, shooting, turn.why_cut, softly=True
        )
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
            gains_now = _unmet(shooting, solution)
        kept = Revised(course, shooting, solution, gains, False, number + 1, turn.why_cut)
        if course.flies.mean() < _HOPELESS * (number >= _EARLY) or not course.flies.any():
            break
    assert kept is not None
    return kept


def _unmet(shooting: Shooting, solution: Solution) -> dict[int, float]:
    """Return the flight whose laws are met least, to be cut; none if it is no law of m."""
    laws = np.abs(solution.equations.condition)
    flight = int(shooting.law_flights[int(laws.argmax())])
    return {flight: 1e3 * float(laws.max())} if flight >= 0 else {}


def _first_fit(course: Course, problem: Problem) -> tuple[Course, float]:
    """Return the course with exact laws if they fit, or as it is, and the chi of it."""
    shooting = problem(course)
    u = shooting.start()
    used = max(1, int(shooting.motion(u)[1].sum()))
    residual = shooting.residual(u)[0][: len(shooting.record.time)]
    chi = float(np.sqrt(residual @ residual / used))
    shooting, solution, _ = without_contradictions(problem, shooting, {}, softly=False)
    exact = chi_of(shooting, solution)
    if exact < _WORSE * chi and solution.broken < 1.0:
        return shooting.course_of(solution.unknowns), min(exact, chi)
    return course, min(exact, chi)
