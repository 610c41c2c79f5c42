# SPDX-License-Identifier: Apache-2.0
"""
Flights that contradict all others, by Lagrange multipliers or by their residuals.

They are cut before anything is replayed, since they would spoil the parameters, and with these the
replay of every other flight.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .course import Course
from .gauss_newton import FitSolution, gains_of_release, solve
from .shooting import Shooting
from .vibration import Array

Problem = Callable[[Course], Shooting]

#: A fall of the sum of squares beyond which the laws of a flight are not believed.
MOST_GAIN = 20.0
#: Fall of the sum of squares at which a fit with soft laws ends, and most steps of it.
_ROUGH, _ROUGH_STEPS = 1.0, 12
#: Most steps of a fit with exact laws, and the fall of the sum of squares at which it ends, as a
#: later round continues it.
_STEPS, _FAIR = 15, 0.5
#: Median of the square of a normal variable; residuals of a flight that are too large, in standard
#: deviations of their sum of squares.
_MEDIAN, _LARGE = 0.4549, 6.0
#: Fall of the sum of squares for which a flight is cut before any replay, and most rounds of cuts.
CONTRADICTION, _MOST_RELEASES = 100.0, 6


def contradiction_of(gain: float) -> str:
    """Return why a flight is left out that raises chi squared by a gain."""
    return f'it contradicts the other flights: chi squared is {gain:.0f} smaller without it'


def gains_of(shooting: Shooting, solution: FitSolution) -> Array:
    """
    Return the misfit of each flight: the larger of that of its laws and that of its residuals.

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


def to_release(gains: Array, limit: float) -> dict[int, float]:
    """Return the flights whose laws are not believed, the worst ones of neighbours."""
    chosen: dict[int, float] = {}
    order = np.argsort(gains)[::-1][:3]
    top = float(gains[order[0]]) if len(order) else 0.0
    for k in map(int, order):
        if gains[k] > max(limit, 0.5 * top) and not {k - 1, k + 1} & set(chosen):
            chosen[k] = float(gains[k])
    return chosen


def _solve(shooting: Shooting, *, softly: bool = True) -> FitSolution:
    """Return the fit of a course, which begins with soft laws or at once."""
    u = shooting.start()
    if softly:
        u = solve(shooting, u, soft=1.0, most=_ROUGH_STEPS, least_gain=_ROUGH).unknowns
    return solve(shooting, u, most=_STEPS, least_gain=_FAIR)


def without_contradictions(
    problem: Problem, shooting: Shooting, why_cut: dict[int, str], *, softly: bool
) -> tuple[Shooting, FitSolution, Array]:
    """
    Fit a course, and cut flights that contradict all others; `softly` at first with soft laws.

    The result is the equations of the course, their solution and the misfit of each flight.
    """
    solution = _solve(shooting, softly=softly)
    gains = gains_of(shooting, solution)
    for _ in range(_MOST_RELEASES):
        chosen = to_release(gains, CONTRADICTION)
        if not chosen:
            break
        course = shooting.course_of(solution.unknowns)
        for k, gain in chosen.items():
            course.leave_out(k)
            why_cut[k + 1] = contradiction_of(gain)
        shooting = problem(course)
        solution = _solve(shooting)
        gains = gains_of(shooting, solution)
    return shooting, solution, gains
