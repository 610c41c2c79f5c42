# SPDX-License-Identifier: Apache-2.0
"""The search for motions of impacts only: the starts of `impact_equations`, solved."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.motion.kernels import on_threads
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arclength import FIND_STARTS, LINEAR_SYSTEM
from .arguments import OrbitError, check_forcing, check_stops
from .closed_flights import BEST_DERIVATIVE
from .flights import machine_of
from .periodic_problem import PeriodicProblem, Solution, impact_nodes
from .response import Array
from .variable_projection import REACHED


class ImpactEquations:
    """
    The 2N equations of one stop sequence, of impacts with a constant restitution.

    Parameters
    ----------
    parameters : RigParameters
        The rig, driven by one harmonic; where its restitution falls with the speed, the equations
        have that of slow impacts.
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
    frequency, phase : float
        Frequency and phase of the force, rad/s and rad.

    Raises
    ------
    OrbitError
        If the rig or the sequence is outside the theory; with friction also if a flight returns
        to the stop it came from, since friction reverses within it.

    Examples
    --------
    >>> equations = ImpactEquations(RigParameters(gravity=0.0), (1, 2), 1)
    >>> equations.impacts, round(equations.period, 6)
    (2, 6.283185)
    """

    def __init__(self, parameters: RigParameters, stops: tuple[int, ...], cycles: int) -> None:
        check_forcing(parameters)
        check_stops(parameters, stops)
        self.parameters = parameters
        self.stops = stops
        self.cycles = cycles
        self.impacts = len(stops)
        _, self.frequency, self.phase = parameters.first_harmonic
        returns = any(a == b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
        if machine_of(parameters).constants.grip > 0.0 and returns:
            raise OrbitError(
                f'stop sequence {",".join(map(str, stops))} with friction '
                f'{parameters.friction:g}: a flight that returns to the same stop reverses, and '
                'friction with it; use find_orbits'
            )
        self.problem = PeriodicProblem(parameters, impact_nodes(stops), cycles)
        self.period = self.problem.period

    def _set_instants(self, instants: Array) -> None:
        self.problem.place[3:-1:4] = self.frequency * instants

    def linear_system(self, instants: Array) -> Array:
        """
        Return the equations for fixed instants after the first impact, (N,), s.

        Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of
        the force's phase at the first impact; displacements first, then velocities over the
        natural frequency.
        """
        self._set_instants(instants)
        self.problem.compute(LINEAR_SYSTEM, True, 0.0, 0.0)
        rows = self.problem.matrix(BEST_DERIVATIVE)[: 2 * self.impacts, : self.impacts + 3]
        return rows.copy()

    def states(self, x: Array, instants: Array) -> Array:
        """Return the states just after the impacts in the form of `PeriodicProblem`, (N, 4)."""
        self._set_instants(instants)
        self.problem.place[:-1:4] = x / self.problem.length
        self.problem.compute(LINEAR_SYSTEM, True, 1.0, 0.0)
        place = self.problem.place[:-1].reshape(-1, 4)
        speed = float(self.problem.units[1])
        return np.stack([x, speed * place[:, 1], 0.0 * x, speed * place[:, 2]], axis=-1)


def _find(equations: ImpactEquations, first: int, end: int, points: int = 0) -> Array:
    """Return the starts of a part of the scan, as places."""
    problem, room = equations.problem, _ROOM
    while True:
        rows = np.zeros((room + 1, len(problem.place)))
        rows[-1, 0] = points
        _, count = problem.compute(FIND_STARTS, True, first, end, rows)
        if count <= room:
            return rows[:count, :-1]
        room = count


#: Step of R from one rig with constant R to the next.
_STEP = 0.05


def _with_constant_restitution(equations: ImpactEquations) -> list[ImpactEquations]:
    """Return the equations of rigs with constant R, from R at speed 0 down, where R falls."""
    rig = equations.parameters
    if not rig.restitution_slowness:
        return [equations]
    most = max(rig.restitution_1, rig.restitution_2)
    levels = max(1, math.ceil(most / _STEP))
    return [
        ImpactEquations(
            rig.replace(
                restitution_1=rig.restitution_1 * (1.0 - k / levels),
                restitution_2=rig.restitution_2 * (1.0 - k / levels),
                restitution_speed=0.0,
            ),
            equations.stops,
            equations.cycles,
        )
        for k in range(levels)
    ]


def _solve(equations: ImpactEquations, starts: Array) -> list[Solution]:
    """Return the solutions to which Newton's method converges from places."""
    solutions = (equations.problem.solve_from(start) for start in starts)
    return [solution for solution in solutions if solution is not None]


_ROOM = 64
_POINTS_PER_CYCLE = 400
_MOST_POINTS = 100_000
#: Places of a scan that are computed at once: few enough for Ctrl-C.
_PART = 20_000


def _is_symmetric(equations: ImpactEquations) -> bool:
    """Return whether the second half of a motion of two impacts may mirror the first."""
    constants = machine_of(equations.parameters).constants
    if equations.stops not in ((1, 2), (2, 1)) or equations.cycles % 2 == 0:
        return False
    return constants.restitution_1 == constants.restitution_2 and constants.slope == 0.0


def few_impact_roots(equations: ImpactEquations) -> list[Solution]:
    """
    Find all motions with one or two impacts in a period.

    For two impacts the condition of the equations is scanned over the whole period. Every
    candidate is a start of Newton's method. Where R falls with the speed, the scans are of rigs
    with constant R.
    """
    rigs = _with_constant_restitution(equations)
    return _solve(equations, np.concatenate([_starts_of(one) for one in rigs]))


def _starts_of(equations: ImpactEquations) -> Array:
    """Return all starts with one or two impacts in a period, of a constant R."""
    if equations.impacts == 1:
        return _find(equations, 0, 0)
    ratio = max(1.0, equations.parameters.omega / equations.frequency)
    points = min(_MOST_POINTS, math.ceil(_POINTS_PER_CYCLE * equations.cycles * ratio))
    end = points + 24
    starts = [_find(equations, 0, -1)] if _is_symmetric(equations) else []
    starts += [
        _find(equations, first, min(first + _PART + 2, end), points)
        for first in range(0, end - 2, _PART)
    ]
    return np.concatenate(starts)


_CLOSE = 1e-6
#: Starts that are computed at once, times the cube of the unknowns: short enough for Ctrl-C.
_MOST_AT_ONCE = 2_000_000
#: Least number of parts for threads.
_PARTS = 8


def _instants(equations: ImpactEquations, numbers: range) -> Array:
    """
    Return some of the instants that cover a period evenly, given their numbers.

    The gaps between impacts are spacings of sorted points of a Kronecker sequence, the phase of
    the first impact is another of its coordinates.
    """
    n, period = equations.impacts, equations.period
    # The generalised golden ratio gives the most evenly spread of such sequences.
    golden = 2.0
    for _ in range(64):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    steps = golden ** -np.arange(1.0, n + 1)
    points = (0.5 + np.outer(np.array(numbers) + 1, steps)) % 1.0
    offsets = np.zeros((len(numbers), n))
    offsets[:, 1:] = np.sort(points[:, 1:], axis=-1) * period
    # Two impacts at once have no equations.
    least = 1e-3 * period
    offsets += least * np.arange(n)
    offsets *= period / (period + least * (n + 1))
    instants: Array = offsets + points[:, :1] * equations.problem.cycle
    return instants


def many_impact_roots(equations: ImpactEquations, starts: int) -> tuple[list[Solution], int]:
    """Find motions of one stop sequence from systematic starts; return also how many converged."""
    if not starts:
        return [], 0
    size = len(equations.problem.place) - 1
    rows = np.zeros((starts, size + 1))
    rows[:, 3:-1:4] = equations.frequency * _instants(equations, range(starts))
    rigs = _with_constant_restitution(equations)
    share = min(max(1, _MOST_AT_ONCE // size**3), math.ceil(starts / len(rigs)))
    at_once = min(share, math.ceil(starts / _PARTS))

    def approach(first: int) -> None:
        like = rigs[first // share % len(rigs)]
        # Each thread has its problem.
        own = ImpactEquations(like.parameters, like.stops, like.cycles)
        own.problem.compute(FIND_STARTS, True, 0.0, 0.0, rows[first : first + at_once])

    on_threads(approach, range(0, starts, at_once))
    unknowns, residuals = rows[:, :size], rows[:, size]
    # Of the starts that came to the same place one is polished.
    keys: dict[tuple[int, ...], int] = {}
    places = unknowns.reshape(starts, -1, 4)
    phases = places[..., 3] / math.tau
    phases -= np.floor(phases[:, :1])
    close = (residuals < _CLOSE) & np.isfinite(unknowns).all(axis=-1)
    for s in np.flatnonzero(close):
        place = np.concatenate([phases[s], places[s, :, 0]])
        keys.setdefault(tuple(np.round(place * 1e5).astype(int)), int(s))
    solutions = _solve(equations, unknowns[list(keys.values())])
    return solutions, int((residuals <= REACHED).sum())
