# SPDX-License-Identifier: Apache-2.0
"""
From a first course to one that nearly obeys the laws of m, which are imposed in steps.

At first M alone obeys its laws, and those of m are soft. Flights that break the laws by much,
since an impact was missed or m sticks, are fitted to M alone, and then cut out. Without measured
impact times weak impacts, and the weaker of two that are closer than the samples, are taken for
noise; and the course begins with the impact before the first one whose bounces the record shows.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .course import Course, Flags, reversals
from .first_course import check_impacts
from .gauss_newton import System, solve
from .reversals import expected_reversals
from .shooting import Shooting
from .vibration import Array

#: Deviations of the laws, one after the other, in those of the data.
_STAGES = (100.0, 10.0, 1.0)
#: Deviation of the laws from which on flights that break them are cut.
_CUT = 10.0
_STEPS = 15
#: Jumps below this many standard deviations are noise; impacts closer than this many samples one.
_WEAK, _CLOSE = 4.0, 1.6
#: A jump of this many standard deviations has visible bounces at a restitution of 1/4; the first
#: one is sought in this part of the record.
_CLEAR, _FIRST = 4.0 * _WEAK, 0.2
#: A flight breaks its laws by this many standard deviations, and this many times the median.
_BROKEN, _TIMES_MEDIAN = 4.0, 5.0

Problem = Callable[[Course], Shooting]


def relax(course: Course, problem: Problem, *, timed: bool) -> Course:
    """Return the course with the laws of m nearly imposed."""
    broken = np.zeros(len(course), bool)  # by the impact at which the flight starts
    weak = np.zeros(len(course), bool)
    jump = deviation = np.zeros(len(course))
    for soft in _STAGES:
        if soft < _STAGES[0] and not timed:
            weak[[0, -1]] = False
            if soft == _STAGES[1]:
                weak[: _unclear(jump, deviation)] = True
            if weak.any():
                course, broken = course.select(~weak), broken[~weak]
                check_impacts(len(course))
        shooting = problem(course)
        vibration = shooting.vibration(course.shared)
        expected = expected_reversals(course, shooting.unknowns, vibration)
        bad = ~expected.possible | broken[:-1]
        course.turns, course.held = expected.reversals, expected.held
        course.after = [reversals(len(times)) for times in course.turns]
        course.begins[1:] = bad & (soft < _CUT)
        course.lawless = bad & (soft >= _CUT)
        course.lawless[0] = soft >= _CUT
        for k in np.flatnonzero(course.lawless):
            course.held[k] = np.ones(len(course.turns[k]), bool)
        _begin_parts(course, shooting)
        shooting = problem(course)
        solution = solve(shooting, shooting.start(), soft=soft, most=_STEPS)
        course = shooting.course_of(solution.unknowns)
        jump, deviation = _jumps(shooting, solution.unknowns, soft)
        inner = ~course.begins
        course.stop[inner] = np.where(jump[inner] > 0.0, 1, -1)
        if soft >= 1.0:
            broken |= _breaking(shooting, solution.unknowns, soft, len(course))
        weak = inner & (np.abs(jump) < _WEAK * deviation)
        close = np.flatnonzero(
            np.diff(course.time) < _CLOSE * np.median(np.diff(shooting.record.time))
        )
        weaker = np.abs(jump[close]) < np.abs(jump[close + 1])
        weak[np.where(weaker, close, close + 1)] = True
    course.lawless[:] = False
    return course


def _begin_parts(course: Course, shooting: Shooting) -> None:
    """Give m the velocity of its arrival where the motion begins anew."""
    unknowns, gap = shooting.unknowns, shooting.unknowns.value(course.shared, 'gap')
    grip = unknowns.value(course.shared, 'grip')
    for k in np.flatnonzero(course.begins[:-1]):
        span = course.time[k + 1] - course.time[k]
        pull = unknowns.slope + course.stop[k] * (grip - unknowns.air)
        way = course.x[k + 1] - course.x[k] + 0.5 * gap * (course.stop[k + 1] - course.stop[k])
        course.damper_velocity[k] = way / span - 0.5 * pull * span


def _jumps(shooting: Shooting, u: Array, soft: float) -> tuple[Array, Array]:
    """Return the jump of X' at each impact, and its standard deviation; 0 where a part begins."""
    system = System(shooting.equations(u, soft), 1e-9)
    return shooting.jumps(u), system.deviations(shooting.jump_rates(u))


def _unclear(jump: Array, deviation: Array) -> int:
    """Return the number of first impacts without visible bounces."""
    clear = np.flatnonzero(jump[1:] ** 2 > (_CLEAR * deviation[1:]) ** 2)
    return int(clear[0]) if len(clear) and clear[0] < _FIRST * len(jump) else 0


def _breaking(shooting: Shooting, u: Array, soft: float, impacts: int) -> Flags:
    """Return which flights break soft laws, by the impact at which they start."""
    flights = shooting.law_flights
    rows = np.flatnonzero(flights >= 0)
    laws = np.abs(shooting.residual(u)[1][rows]) / soft
    worst = np.zeros(impacts)
    np.maximum.at(worst, flights[rows], laws)
    used = worst[np.unique(flights[rows])]
    limit = max(_BROKEN, _TIMES_MEDIAN * float(np.median(used))) if len(used) else _BROKEN
    breaking: Flags = worst > limit
    return breaking
