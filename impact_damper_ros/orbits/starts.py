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

import numpy as np

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arguments import OrbitError, check_forcing, check_stops
from .flights import machine_of
from .response import Array, forced_response, free_response
from .segments import Segments, Solution, impact_nodes, solve


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
        # M's velocities at an impact from those of m just after and just before it
        self._before_from_after = (1.0 + mass_ratio) / (1.0 + restitution)
        self._before_from_before = (restitution - mass_ratio) / (1.0 + restitution)
        self._after_from_after = (1.0 - mass_ratio * restitution) / (1.0 + restitution)
        self._after_from_before = (1.0 + mass_ratio) * restitution / (1.0 + restitution)
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
        before = self._before_from_after * damper + self._before_from_before * arriving
        after = self._after_from_after * damper + self._after_from_before * arriving
        return before, after, damper

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
        """Return the states just after the impacts as `Segments` has them, (..., N, 4)."""
        _, velocity, damper = self._velocities(x, self.durations(instants), 1.0)
        return np.stack([x, velocity, np.zeros_like(x), damper - velocity], axis=-1)


#: Residual of a start that has converged; Newton's method does the rest.
_REACHED = 1e-10


def impact_problem(equations: ImpactEquations) -> Segments:
    """Return the boundary-value problem for which these equations provide the starts."""
    nodes = impact_nodes(equations.stops)
    return Segments(equations.parameters, nodes, equations.cycles)


def approach_roots(
    equations: ImpactEquations, problem: Segments, unknowns: Array, steps: int = 40
) -> tuple[Array, Array]:
    """
    Bring many starts close to roots by damped least squares (Levenberg and Marquardt).

    All starts advance at once: 600 of them take 0.2 s for four impacts, 10 s one by one with
    `scipy.optimize.root`. After each step the velocities are those that the impact equations
    have at its displacements and instants, which saves a third of the steps. Returns the
    unknowns and their largest residual.
    """
    unknowns = unknowns.copy()
    value, jacobian = problem.residual(unknowns)
    cost = np.einsum('si,si->s', value, value)
    damping = np.full(len(unknowns), 1e-3)
    identity = np.eye(unknowns.shape[1])
    for _ in range(steps):
        # A start that has diverged, to two impacts at once, or is stuck is dropped.
        active = (cost > _REACHED**2) & (cost < 1e12) & (damping < 1e5)
        if not active.any():
            break
        k = np.flatnonzero(active)
        j = jacobian[k]
        turned = j.swapaxes(1, 2)
        normal = turned @ j
        slope = turned @ value[k, :, None]
        size = np.einsum('sjj->s', normal) / len(identity)
        normal += (damping[k] * size)[:, None, None] * identity
        step = np.asarray(-np.linalg.solve(normal, slope)[..., 0], np.float64)
        there = unknowns[k] + problem.longest_part(unknowns[k], step)[:, None] * step
        states, instants = problem.motion(there)
        there = problem.unknowns(equations.states(states[..., 0], instants), instants)
        value_new, jacobian_new = problem.residual(there)
        cost_new = np.einsum('si,si->s', value_new, value_new)
        better = cost_new < cost[k]
        kept = k[better]
        unknowns[kept] = there[better]
        value[kept], jacobian[kept] = value_new[better], jacobian_new[better]
        cost[kept] = cost_new[better]
        damping[k] = np.where(better, np.maximum(damping[k] * 0.1, 1e-11), damping[k] * 10.0)
    return unknowns, np.abs(value).max(axis=-1)


def _solved(equations: ImpactEquations, starts: Iterable[tuple[Array, Array]]) -> list[Solution]:
    """Return the solutions that Newton's method leads to from X and instants."""
    problem = impact_problem(equations)
    solutions = (solve(problem, equations.states(x, t), t) for x, t in starts)
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
#: Starts that are computed at once, times the impacts squared, as the size of a derivative.
_MOST_NUMBERS = 2**18


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
    problem = impact_problem(equations)
    at_once = max(1, _MOST_NUMBERS // equations.impacts**2)
    reached = []
    for first in range(0, starts, at_once):
        numbers = range(first, min(first + at_once, starts))
        x, instants = _systematic_starts(equations, numbers)
        unknowns = problem.unknowns(equations.states(x, instants), instants)
        reached.append(approach_roots(equations, problem, unknowns))
    unknowns, residuals = (np.concatenate(part) for part in zip(*reached, strict=True))
    close = residuals < _CLOSE
    # One of each group of starts that came to the same place is polished
    keys: dict[tuple[int, ...], int] = {}
    states, instants = problem.motion(unknowns)
    phases = instants / equations.cycle
    phases -= np.floor(phases[:, :1])
    finite = np.isfinite(unknowns).all(axis=-1)
    for s in np.flatnonzero(close & finite):
        place = np.concatenate([phases[s], states[s, :, 0] / equations.length])
        keys.setdefault(tuple(np.round(place * 1e5).astype(int)), int(s))
    solved = (solve(problem, states[s], instants[s]) for s in keys.values())
    solutions = [solution for solution in solved if solution is not None]
    return solutions, int((residuals <= _REACHED).sum())
