# SPDX-License-Identifier: Apache-2.0
"""The search for motions of impacts only: the starts of `impact_equations`, solved."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.kernels import on_threads
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arclength import VIABLE
from .arguments import OrbitError, check_forcing, check_stops
from .closed_flights import BEST_DERIVATIVE
from .flights import machine_of
from .kernel_tasks import APPROACH_ROOTS, FIND_ROOTS, FIND_STARTS, LINEAR_SYSTEM
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

    def linear_system(self, instants: Array) -> Array:
        """
        Return the equations for fixed instants after the first impact, (N,), s.

        Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of
        the force's phase at the first impact; displacements first, then velocities over the
        natural frequency.
        """
        self.problem.place[3:-1:4] = self.frequency * instants
        self.problem.compute(LINEAR_SYSTEM, True, 0.0, 0.0)
        rows = self.problem.matrix(BEST_DERIVATIVE)[: 2 * self.impacts, : self.impacts + 3]
        return rows.copy()


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


_POINTS_PER_CYCLE = 400
_MOST_POINTS = 100_000
#: Places of a scan that are computed at once: few enough for Ctrl-C.
_PART = 20_000


class _Part(NamedTuple):
    """Some of the starts: places of a scan, or numbers of instants if the scan has no points."""

    equations: ImpactEquations
    first: int
    end: int
    points: int = 0


def _scan_parts(equations: ImpactEquations) -> list[_Part]:
    """Return the parts of a scan for all motions with one or two impacts, of a constant R."""
    if equations.impacts == 1:
        return [_Part(equations, 0, 1, 1)]
    ratio = max(1.0, equations.parameters.omega / equations.frequency)
    points = min(_MOST_POINTS, math.ceil(_POINTS_PER_CYCLE * equations.cycles * ratio))
    end = points + 24
    ends = {first: min(first + _PART + 2, end) for first in range(0, end - 2, _PART)}
    return [_Part(equations, first, last, points) for first, last in ends.items()]


#: Starts that are computed at once, times the cube of the unknowns: short enough for Ctrl-C.
_MOST_AT_ONCE = 2_000_000
#: Least number of parts for threads.
_PARTS = 4
#: First number of rows for the roots of a part of a scan.
_ROOM = 64


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


def _starts(part: _Part) -> Array:
    """Return the starts of a part, each with its residual."""
    like = part.equations
    # Each thread has its problem.
    problem = PeriodicProblem(like.parameters, like.problem.nodes, like.cycles)
    width = 4 * like.impacts + 1
    if not part.points:
        rows = np.zeros((part.end - part.first, width))
        rows[:, 3:-1:4] = like.frequency * _instants(like, range(part.first, part.end))
        problem.compute(APPROACH_ROOTS, True, 0.0, 0.0, rows)
        return rows
    count, room = _ROOM, 0
    while count > room:
        room = count
        rows = np.zeros((room + 1, width))
        rows[-1, 0] = part.points
        _, count = problem.compute(FIND_STARTS, True, part.first, part.end, rows)
    return rows[:count]


def impact_roots(
    equations: ImpactEquations, starts: int | None = None, *, viable: bool = False
) -> tuple[list[Solution], int]:
    """
    Find motions of one stop sequence, also those that the rig cannot perform.

    Parameters
    ----------
    equations : ImpactEquations
        The equations. Where R falls with the speed, starts are motions of rigs with constant R.
    starts : int, optional
        Number of systematic starts; if not given, the equations of one or two impacts are
        scanned, and all their motions are found.
    viable : bool, optional
        Whether motions that the rig cannot perform are left out.

    Returns
    -------
    roots, converged : list of Solution, int
        The motions, and how many of the systematic starts converged.
    """
    rigs, size = _with_constant_restitution(equations), 4 * equations.impacts
    most = max(1, _MOST_AT_ONCE // size**3)
    if starts is None:
        parts = [part for rig in rigs for part in _scan_parts(rig)]
    else:
        share = max(1, min(most, math.ceil(starts / len(rigs)), math.ceil(starts / _PARTS)))
        firsts = range(0, starts, share)
        parts = [
            _Part(rigs[k % len(rigs)], first, min(first + share, starts))
            for k, first in enumerate(firsts)
        ]
    begun = np.concatenate([np.zeros((0, size + 1)), *on_threads(_starts, parts)])
    problem, count = equations.problem, 0
    rows = problem.rows_of_roots(len(begun))
    rows[:, : size + 1] = begun
    for first in range(0, len(rows), most):
        _, count = problem.compute(FIND_ROOTS, True, first, count, rows[: first + most])
    kept = [row for row in rows[:count] if row[size + VIABLE] > 0.0 or not viable]
    converged = 0 if starts is None else int((begun[:, -1] <= REACHED).sum())
    return [problem.solution_of(row) for row in kept], converged
