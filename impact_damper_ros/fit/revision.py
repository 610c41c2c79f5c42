# SPDX-License-Identifier: Apache-2.0
"""
The course revised until the exact engine computes it again.

In each round every flight is replayed by the engine (`replayed_course`), and what follows from it
is fitted, without flights that contradict the others (`contradictions`). A round that makes the
fit worse is undone.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import numpy as np

from .contradictions import MOST_GAIN, to_release, without_contradictions
from .course import Course
from .gauss_newton import Solution
from .relaxation import Problem
from .replayed_course import Memory, ReplayedCourse
from .shooting import Shooting
from .vibration import Array

MOST_ROUNDS = 10
#: Largest law, in standard deviations of the data, that counts as exact.
EXACT = 5e-2
#: Rise of chi that undoes a round, and how often that is done.
_WORSE, _MOST_UNDONE = 1.15, 3
#: Rounds that may begin with one course; what is cut twice at an instant stays cut.
_MOST_REPEATS = 3
#: A replay ends at the impact if it is there within this many samples or this part of a period,
#: or within this many deviations of a measured time.
_SAMPLES, _PART, _DEVIATIONS = 1.2, 0.025, 4.0
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


def revised(course: Course, problem: Problem, *, report: bool = False) -> Revised:
    """Revise and fit a course until nothing changes, or for `MOST_ROUNDS` rounds."""
    shooting = problem(course)
    step = float(np.median(np.diff(shooting.record.time)))
    period = 2.0 * np.pi / shooting.rate
    tolerance = max(_SAMPLES * step, _PART * period)
    memory = Memory(_SAME * period)
    course, least_chi = _first_fit(course, problem)
    undone = 0
    gains_now: dict[int, float] = {}
    kept: Revised | None = None
    seen: Counter[object] = Counter()
    for number in range(MOST_ROUNDS):
        turn = ReplayedCourse(course, shooting, memory, gains_now, tolerance)
        proposed = turn.revise()
        if kept and not turn.log and proposed.structure == course.structure:
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
        gains_now = to_release(gains, MOST_GAIN)
        if solution.broken > 1.0 and not gains_now:
            gains_now = _unmet(shooting, solution)
        kept = Revised(course, shooting, solution, gains, False, number + 1, turn.why_cut)
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
