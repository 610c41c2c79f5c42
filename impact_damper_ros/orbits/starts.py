# SPDX-License-Identifier: Apache-2.0
"""
Starts of the boundary-value problem, from the equations of N impacts in k cycles of the force.

Bapat (1995), equations (3)-(15), derived again. Between impacts the damper mass has constant
acceleration, so that the displacements X_i and instants t_i of the impacts give its velocities;
momentum and restitution then give those of the primary mass before and after each impact; and
its closed-form flight must lead from each impact to the next. These are 2N equations. For fixed
instants they are linear in X_1 .. X_N and in the cosine and sine of the force's phase at the
first impact: an N-impact motion has only N-1 non-linear unknowns.

The linear part leaves, for fixed instants, vectors (X_1, .., X_N, C, S, W) that satisfy it up to a
factor; the force then asks for C^2 + S^2 = W^2. For N = 1 these vectors span a plane and the
condition is a quadratic. For N = 2 they are one vector for each alpha_2, and the condition is one
equation for alpha_2: the paper's (16), in a form without poles. Where the equations lose rank, as
in the symmetric motion of a symmetric rig, it is a quadratic again. These are all starts that
there are; for more impacts there are many systematic ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from math import inf
from typing import Any

import numpy as np

from impact_damper_ros.motion.compiled import kernel
from impact_damper_ros.motion.transition import rebound_slopes
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arguments import OrbitError, check_forcing, check_stops
from .closed_flights import (
    AHEAD,
    BEST,
    BEST_DERIVATIVE,
    DERIVATIVE,
    SPACE,
    SPAN,
    STEP,
    VALUE,
    Problem,
    longest_part,
    set_rig,
    solve_linear,
    spread,
    unit_of,
    write_equations,
)
from .flights import machine_of
from .periodic_problem import PeriodicProblem, Solution, call_kernel, impact_nodes
from .response import Array, forced_response, free_response


class ImpactEquations:
    """
    The 2N equations of one stop sequence.

    Parameters
    ----------
    parameters : RigParameters
        The rig, driven by one harmonic.
    stops : tuple of int
        Stops hit in one period, in order.
    cycles : int
        Period k in cycles of the force.

    Attributes
    ----------
    impacts : int
        Number of impacts N.
    period : float
        Period of the motion, s.
    length, rate : float
        Scales of displacement (m) and frequency (rad/s), by which residuals are divided.
    air, accelerations : ndarray, shape (N,)
        Acceleration of m in the flight after each impact: by the air, and in all.
    pushes : ndarray, shape (N,)
        Constant acceleration of M by friction and air in that flight.

    Raises
    ------
    OrbitError
        If the rig or the sequence is outside the theory; with friction also if a flight returns
        to the stop it came from, since friction reverses within it.
    """

    def __init__(self, parameters: RigParameters, stops: tuple[int, ...], cycles: int) -> None:
        check_forcing(parameters)
        check_stops(parameters, stops)
        constants, lines = machine_of(parameters)
        self.parameters = parameters
        self.stops = stops
        self.cycles = cycles
        self.impacts = len(stops)
        self.frequency = parameters.first_harmonic[1]
        self.phase = parameters.first_harmonic[2]
        self.cycle = math.tau / self.frequency
        self.period = cycles * self.cycle
        # The paper's lambda of the flight after each impact; 0 if it returns to the same stop
        self.directions = tuple(a - b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
        if constants.grip > 0.0 and 0 in self.directions:
            raise OrbitError(
                f'stop sequence {",".join(map(str, stops))} with friction '
                f'{parameters.friction:g}: a flight that returns to the same stop reverses, and '
                'friction with it; use find_orbits'
            )
        mass_ratio = constants.mass_ratio
        first = np.array(stops) == 1
        restitution = np.where(first, constants.restitution_1, constants.restitution_2)
        # M's velocity before an impact from those of m just after and just before it, and what of
        # the relative velocity before it is added to that
        self._slide, stay = rebound_slopes(constants.share, restitution)
        self._from_after: Array = np.array(1.0 / (1.0 - self._slide - stay))
        self._from_before: Array = 1.0 - self._from_after
        direction = np.array(self.directions)
        self.air: Array = np.where(first, -constants.air, constants.air)
        self.accelerations: Array = constants.slope - direction * constants.grip + self.air
        self.pushes: Array = mass_ratio * (direction * constants.grip - self.air)
        self._next = np.roll(np.arange(self.impacts), -1)
        self._last = np.roll(np.arange(self.impacts), 1)
        offsets = np.where(first, constants.half_gap, -constants.half_gap)
        self._travel: Array = offsets[self._next] - offsets
        self._oscillator = constants.free
        self._stiffness = constants.free.omega_squared
        self._force = lines[0].force
        self.rate = math.sqrt(self._stiffness)
        swing = abs(self._force) / self._stiffness
        fall = float(np.max(np.abs(self.accelerations))) / self.frequency**2
        self.length = max(swing, fall, float(np.max(np.abs(self._travel))))

    def durations(self, instants: Array) -> Array:
        """Return the durations of the flights between instants that rise within one period, s."""
        lasts: Array = instants[..., self._next] - instants
        lasts[..., -1] += self.period
        return lasts

    def _velocities(
        self, x: Array, lasts: Array, constant: Array | float
    ) -> tuple[Array, Array, Array]:
        """
        Return the velocity of M before and after each impact, and of m after it, from X there.

        They are linear in X but for a part that does not depend on it, which is multiplied by
        `constant`.
        """
        mean = (x[..., self._next] - x + constant * self._travel) / lasts
        half = constant * 0.5 * self.accelerations * lasts
        damper, arriving = mean - half, (mean + half)[..., self._last]
        before = self._from_after * damper + self._from_before * arriving
        return before, before + self._slide * (arriving - before), damper

    def linear_system(self, instants: Array) -> Array:
        """
        Return the equations for fixed instants after the first impact, (..., N), s.

        Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of
        the force's phase at the first impact; displacements first, then velocities over the
        natural frequency.
        """
        n = self.impacts
        lasts = self.durations(instants)
        free = self._oscillator
        less, impulse, slope = (
            part[..., None, :] for part in free_response(free.decay, free.frequency, lasts)
        )
        # One for each X alone, and the constant part
        x, constant = np.eye(n + 1, n), np.eye(n + 1)[:, n:]
        before, after, _ = self._velocities(x, lasts[..., None, :], constant)
        pushed = x - constant * self.pushes / self._stiffness
        place = x[:, self._next] - x - less * pushed - impulse * after
        speed = before[..., self._next] - slope * after + self._stiffness * impulse * pushed
        columns = np.concatenate([place, speed / self.rate], axis=-1)
        x_forced, v_forced = forced_response(free.decay, free.frequency, self.frequency, lasts)
        turn = -self._force * np.exp(1j * self.frequency * instants)
        forced = np.concatenate([turn * x_forced, turn * v_forced / self.rate], axis=-1)
        rows = np.empty((*lasts.shape[:-1], 2 * n, n + 3))
        rows[..., :n] = columns[..., :n, :].swapaxes(-1, -2)
        rows[..., n], rows[..., n + 1] = forced.imag, forced.real
        rows[..., n + 2] = columns[..., n, :]
        return rows

    def states(self, x: Array, instants: Array) -> Array:
        """Return the states just after the impacts as `PeriodicProblem` has them, (..., N, 4)."""
        _, velocity, damper = self._velocities(x, self.durations(instants), 1.0)
        return np.stack([x, velocity, np.zeros_like(x), damper - velocity], axis=-1)

    def columns(self) -> Array:
        """Return what `write_velocities` needs of each impact, shape (N, 5)."""
        parts = self._travel, 0.5 * self.accelerations, self._from_after, self._from_before
        return np.stack([*parts, self._slide], axis=-1)


#: Residual of a start that has converged; Newton's method does the rest.
_REACHED = 1e-10
_MOST_STEPS = 40
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-11, 1e5
_DIVERGED = 1e12


@kernel
def write_velocities(problem: Problem, impacts: Any) -> None:
    """Let the velocities at the place be those that displacements and instants ask for."""
    place, table = problem.place, problem.table
    count = len(problem.nodes)
    spread(problem)
    speed = unit_of(problem, 1)
    for j in range(count):
        last, after = (j - 1 if j > 0 else count - 1), (j + 1) % count
        travel, half, from_after, from_before, slide = impacts[j]
        span = table[j, SPAN]
        damper = (table[after, 0] - table[j, 0] + travel) / span - half * span
        span = table[last, SPAN]
        arriving = (table[j, 0] - table[last, 0] + impacts[last, 0]) / span
        arriving += impacts[last, 1] * span
        before = from_after * damper + from_before * arriving
        velocity = before + slide * (arriving - before)
        place[4 * j + 1] = velocity / speed
        place[4 * j + 2] = (damper - velocity) / speed


@kernel
def keep(problem: Problem, count: int) -> float:
    """Keep the place, its residual and its derivative; return the sum of the squares."""
    cost = 0.0
    for i in range(count):
        problem.vectors[BEST, i] = problem.place[i]
        problem.vectors[AHEAD, i] = problem.vectors[VALUE, i]
        cost += problem.vectors[VALUE, i] * problem.vectors[VALUE, i]
        for k in range(count):
            problem.matrices[BEST_DERIVATIVE, i, k] = problem.matrices[DERIVATIVE, i, k]
    return cost


@kernel
def write_damped_step(problem: Problem, damping: float, count: int) -> None:
    """Write the step of damped least squares from what is kept."""
    vectors, space = problem.vectors, problem.matrices[SPACE]
    jacobian = problem.matrices[BEST_DERIVATIVE]
    size = 0.0
    for i in range(count):
        vectors[VALUE, i] = 0.0
        for k in range(count):
            vectors[VALUE, i] -= jacobian[k, i] * vectors[AHEAD, k]
            space[i, k] = 0.0
    # Row by row, as most entries of a long motion are zero
    for row in range(count):
        for i in range(count):
            if jacobian[row, i] != 0.0:
                size += jacobian[row, i] * jacobian[row, i]
                for k in range(count):
                    space[i, k] += jacobian[row, i] * jacobian[row, k]
    for i in range(count):
        space[i, i] += damping * size / count
    solve_linear(space, problem.lead, vectors[VALUE], vectors[STEP], count)


@kernel
def approach(problem: Problem, impacts: Any) -> float:
    """
    Bring a start close to a root by damped least squares (Levenberg and Marquardt).

    After each step the velocities are those that the impact equations have at its displacements
    and instants, which saves a third of the steps. Returned is the largest residual.
    """
    place, vectors = problem.place, problem.vectors
    count = len(place) - 1
    write_equations(problem, True)
    cost = keep(problem, count)
    damping = _DAMPING
    steps = 0
    # A start that has diverged, to two impacts at once, or is stuck is dropped.
    while (
        steps < _MOST_STEPS and _REACHED * _REACHED < cost < _DIVERGED and damping < _MOST_DAMPING
    ):
        steps += 1
        write_damped_step(problem, damping, count)
        for i in range(count):
            place[i] = vectors[BEST, i]
        spread(problem)
        part = longest_part(problem)
        for i in range(count):
            place[i] += part * vectors[STEP, i]
        write_velocities(problem, impacts)
        write_equations(problem, True)
        there = 0.0
        for i in range(count):
            there += vectors[VALUE, i] * vectors[VALUE, i]
        if there < cost:
            cost = keep(problem, count)
            damping = max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
    residual = 0.0
    for i in range(count):
        place[i] = vectors[BEST, i]
        residual = max(residual, abs(vectors[AHEAD, i]))
    return residual if cost < _DIVERGED else inf


@kernel
def approach_roots(problem: Problem, impacts: Any, starts: Any, residuals: Any) -> int:
    """Bring starts close to roots, each by `approach`."""
    set_rig(problem.moving.constants, problem.moving.lines, problem.rig)
    count = len(problem.place) - 1
    for s in range(len(starts)):
        for i in range(count):
            problem.place[i] = starts[s, i]
        residuals[s] = approach(problem, impacts)
        for i in range(count):
            starts[s, i] = problem.place[i]
    return len(starts)


def impact_problem(equations: ImpactEquations) -> PeriodicProblem:
    """Return the boundary-value problem for which these equations provide the starts."""
    return PeriodicProblem(equations.parameters, impact_nodes(equations.stops), equations.cycles)


def _solved(equations: ImpactEquations, starts: Iterable[tuple[Array, Array]]) -> list[Solution]:
    """Return the solutions that Newton's method leads to from X and instants."""
    problem = impact_problem(equations)
    solutions = (problem.solve(equations.states(x, t), t) for x, t in starts)
    return [solution for solution in solutions if solution is not None]


_POINTS_PER_CYCLE = 400
_MOST_POINTS = 100_000
_BISECTIONS = 12
_CLOSER_LOOKS = 5
_LOOKS = 33


def _plane_meets_cone(basis: Array) -> Iterator[Array]:
    """Yield the vectors of a plane with C^2 + S^2 = W^2, divided by W."""
    form = basis[:, -3:] @ np.diag([1.0, 1.0, -1.0]) @ basis[:, -3:].T
    angle = 0.5 * math.atan2(2.0 * form[0, 1], form[0, 0] - form[1, 1])
    mean = 0.5 * (form[0, 0] + form[1, 1])
    reach = math.hypot(0.5 * (form[0, 0] - form[1, 1]), form[0, 1])
    # mean + reach cos 2(t - angle) = 0; a near miss counts as touching, Newton decides.
    if reach == 0.0 or abs(mean) > 1.0001 * reach:
        return
    opening = 0.5 * math.acos(min(1.0, max(-1.0, -mean / reach)))
    for t in (angle + opening, angle - opening):
        vector = math.cos(t) * basis[0] + math.sin(t) * basis[1]
        if abs(vector[-1]) > 1e-12 * float(np.abs(vector).max()):
            yield vector / vector[-1]


def _scaled(equations: ImpactEquations, rows: Array) -> Array:
    """Return the rows for displacements in units of the length scale, and of similar size."""
    rows = rows.copy()
    rows[..., : equations.impacts] *= equations.length
    rows /= np.abs(rows).max(axis=-1, keepdims=True)
    return rows


def _start(equations: ImpactEquations, vector: Array, offsets: Array) -> tuple[Array, Array]:
    """Return displacements and instants of a vector with W = 1."""
    n = equations.impacts
    phase = math.atan2(vector[-2], vector[-3]) - equations.phase
    return vector[:n] * equations.length, offsets + phase / equations.frequency


def one_impact_roots(equations: ImpactEquations) -> list[Solution]:
    """Find all motions with one impact in a period: none, one or two."""
    offsets = np.zeros(1)
    rows = _scaled(equations, equations.linear_system(offsets))
    basis = np.linalg.svd(rows)[2][-2:]
    return _solved(equations, (_start(equations, v, offsets) for v in _plane_meets_cone(basis)))


def _symmetric_starts(equations: ImpactEquations) -> Iterator[tuple[Array, Array]]:
    """
    Yield the motions whose second half mirrors the first: X_2 = -X_1 half a period later.

    The force must have changed sign by then, hence an odd number of cycles.
    """
    parameters = equations.parameters
    restitutions = parameters.restitution_1 == parameters.restitution_2
    mirrored = np.all(equations.accelerations == -equations.accelerations[::-1])
    if equations.stops not in ((1, 2), (2, 1)) or equations.cycles % 2 == 0:
        return
    if not (restitutions and mirrored):
        return
    offsets = np.array([0.0, 0.5 * equations.period])
    rows = _scaled(equations, equations.linear_system(offsets))
    reduced = rows[[0, 2]][:, 1:].copy()
    reduced[:, 0] = rows[[0, 2], 0] - rows[[0, 2], 1]
    for vector in _plane_meets_cone(np.linalg.svd(reduced)[2][-2:]):
        yield _start(equations, np.concatenate([vector[:1], -vector[:1], vector[1:]]), offsets)


# All intervals are narrowed at once: one look at 33 instants costs little more than at one. With
# `scipy.optimize.brentq` and `minimize_scalar`, one interval at a time, a scan takes 2 to 4 times
# as long (15 to 26 ms for one cycle).


def _look(equations: ImpactEquations, second: Array) -> tuple[Array, Array, Array]:
    """
    Return the condition C^2 + S^2 - W^2 at some second instants.

    As well the last two singular vectors and the smallest singular value there.
    """
    offsets = np.stack([np.zeros_like(second), second], axis=-1)
    _, values, vectors = np.linalg.svd(_scaled(equations, equations.linear_system(offsets)))
    last = vectors[:, -1]
    return last[:, 2] ** 2 + last[:, 3] ** 2 - last[:, 4] ** 2, vectors[:, -2:], values[:, -1]


def _between(equations: ImpactEquations, left: Array, right: Array) -> Array:
    """Bisect all intervals at whose ends the condition differs in sign."""
    sign = np.sign(_look(equations, left)[0])
    for _ in range(_BISECTIONS):
        middle = 0.5 * (left + right)
        same = np.sign(_look(equations, middle)[0]) == sign
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    return 0.5 * (left + right)


def _closer(
    equations: ImpactEquations, left: float, right: float, index: int
) -> Iterator[tuple[float, Array]]:
    """
    Narrow an interval around the least |condition| (index 0) or singular value (index 2).

    Yields the instant reached and the condition's values on the way, as (instant, [a, b]) where
    it changes sign between a and b, and finally (instant, []).
    """
    best = 0.5 * (left + right)
    for _ in range(_CLOSER_LOOKS):
        grid = np.linspace(left, right, _LOOKS)
        values = _look(equations, grid)
        if index == 0:
            crossing = np.flatnonzero(np.diff(np.sign(values[0])) != 0)
            if len(crossing):
                for i in crossing:
                    yield best, grid[i : i + 2]
                return
        j = int(np.argmin(np.abs(values[index])))
        best = float(grid[j])
        left, right = float(grid[max(j - 1, 0)]), float(grid[min(j + 1, _LOOKS - 1)])
    yield best, np.empty(0)


def two_impact_roots(equations: ImpactEquations) -> list[Solution]:
    """
    Find all motions with two impacts in a period.

    The condition is scanned over the whole period: for sign changes, and for minima of its
    modulus, which may hide two roots side by side or a double one. Where the linear equations
    come close to losing rank, the plane they nearly leave is searched too. Every candidate is
    a start of Newton's method.
    """
    ratio = max(1.0, equations.rate / equations.frequency)
    points = min(_MOST_POINTS, math.ceil(_POINTS_PER_CYCLE * equations.cycles * ratio))
    even = (np.arange(points) + 0.5) / points
    edge = even[0] * 0.5 ** np.arange(12, 0, -1)
    second = equations.period * np.concatenate([edge, even, 1.0 - edge[::-1]])
    condition, _, rank = _look(equations, second)
    starts = list(_symmetric_starts(equations))
    crossing = np.flatnonzero(np.diff(np.sign(condition)) != 0)
    lefts, rights = list(second[crossing]), list(second[crossing + 1])
    tangents: list[float] = []
    size = np.abs(condition)
    low = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    for i in low:
        if condition[i - 1] * condition[i + 1] > 0.0 and condition[i] * condition[i + 1] > 0.0:
            for best, bracket in _closer(equations, second[i - 1], second[i + 1], 0):
                if len(bracket):
                    lefts.append(bracket[0])
                    rights.append(bracket[1])
                else:
                    tangents.append(best)
    roots = _between(equations, np.array(lefts), np.array(rights)) if lefts else np.empty(0)
    roots = np.concatenate([roots, tangents])
    for root, (_, vector) in zip(roots, _look(equations, roots)[1], strict=True):
        if abs(vector[-1]) > 1e-12:
            starts.append(_start(equations, vector / vector[-1], np.array([0.0, root])))
    for i in np.flatnonzero((rank[1:-1] <= rank[:-2]) & (rank[1:-1] <= rank[2:])) + 1:
        best = [b for b, _ in _closer(equations, second[i - 1], second[i + 1], 2)][-1]
        basis = _look(equations, np.array([best]))[1][0]
        starts += [_start(equations, v, np.array([0.0, best])) for v in _plane_meets_cone(basis)]
    return _solved(equations, starts)


_CLOSE = 1e-6
#: Starts that are computed at once, times the cube of the unknowns: not too long for Ctrl-C.
_MOST_AT_ONCE = 2_000_000


def _systematic_starts(equations: ImpactEquations, numbers: range) -> tuple[Array, Array]:
    """
    Return some of the starts that cover the instants evenly, given their numbers.

    The gaps between impacts are spacings of sorted points of a Kronecker sequence, the phase of
    the first impact is another of its coordinates; the displacements solve the linear equations
    best in the sense of least squares.
    """
    n = equations.impacts
    # The generalised golden ratio: the most evenly spread of such sequences
    golden = 2.0
    for _ in range(64):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    steps = golden ** -np.arange(1.0, n + 1)
    points = (0.5 + np.outer(np.array(numbers) + 1, steps)) % 1.0
    offsets = np.zeros((len(numbers), n))
    offsets[:, 1:] = np.sort(points[:, 1:], axis=-1) * equations.period
    # Two impacts at once have no equations
    least = 1e-3 * equations.period
    offsets += least * np.arange(n)
    offsets *= equations.period / (equations.period + least * (n + 1))
    first = points[:, :1] * equations.cycle
    phase = equations.frequency * first[:, 0] + equations.phase
    rows = equations.linear_system(offsets)
    driven = rows[..., n] * np.cos(phase)[:, None] + rows[..., n + 1] * np.sin(phase)[:, None]
    target = -(driven + rows[..., n + 2])
    matrix = rows[..., :n]
    normal = np.einsum('sij,sik->sjk', matrix, matrix) + 1e-12 * np.eye(n)
    x = np.linalg.solve(normal, np.einsum('sij,si->sj', matrix, target)[..., None])[..., 0]
    return x, offsets + first


# A start may have two impacts at once, as at the end of a chatter: it is dropped.
@np.errstate(divide='ignore', invalid='ignore', over='ignore')
def many_impact_roots(equations: ImpactEquations, starts: int) -> tuple[list[Solution], int]:
    """Find motions of one stop sequence from systematic starts; and how many have converged."""
    if not starts:
        return [], 0
    problem, impacts = impact_problem(equations), equations.columns()
    size = problem.layout.unknowns
    at_once = max(1, _MOST_AT_ONCE // size**3)
    unknowns, residuals = np.empty((starts, size)), np.empty(starts)
    for first in range(0, starts, at_once):
        part = slice(first, min(first + at_once, starts))
        x, instants = _systematic_starts(equations, range(part.start, part.stop))
        unknowns[part] = problem.unknowns(equations.states(x, instants), instants)
        call_kernel(approach_roots, problem.arrays, impacts, unknowns[part], residuals[part])
    # One of each group of starts that came to the same place is polished
    keys: dict[tuple[int, ...], int] = {}
    places = unknowns.reshape(starts, -1, 4)
    phases = places[..., 3] / math.tau
    phases -= np.floor(phases[:, :1])
    close = (residuals < _CLOSE) & np.isfinite(unknowns).all(axis=-1)
    for s in np.flatnonzero(close):
        place = np.concatenate([phases[s], places[s, :, 0]])
        keys.setdefault(tuple(np.round(place * 1e5).astype(int)), int(s))
    roots = []
    for place in places[list(keys.values())]:
        instants = place[:, 3] / equations.frequency
        x = place[:, 0] * problem.length
        roots.append(problem.solve(equations.states(x, instants), instants))
    solutions = [solution for solution in roots if solution is not None]
    return solutions, int((residuals <= _REACHED).sum())
