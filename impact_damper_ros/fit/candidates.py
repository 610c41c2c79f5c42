# SPDX-License-Identifier: Apache-2.0
"""
What may be wrong with a model or a file, judged by what each explains.

Near a fit one Gauss-Newton step gives the value and standard deviation of each further parameter,
zero in the model, without a fit of its own: a score test. Far from one, `misreading` compares how
well the motion of M is made of free vibrations if its sensor or the force is in another unit.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .first_course import COARSE, scanned
from .gauss_newton import Solution, System
from .partition import Record
from .shooting import Shooting
from .unknowns import CONSTANTS, later, scaled_constant
from .vibration import Array

_STEP = 1e-6
#: What the motion may be too small or too large by, and the sentence that says so.
_MISREADINGS = {
    -1.0: 'the sensor or the force is the other way round: reverse the sign of one of them',
    9.80665: 'the motion is 9.81 times too small: g were taken for m/s^2',
    1.0 / 9.80665: 'the motion is 9.81 times too large: m/s^2 were taken for g',
    25.4: 'the motion is 25.4 times too small: inches were taken for millimetres',
    1.0 / 25.4: 'the motion is 25.4 times too large: millimetres were taken for inches',
    10.0: 'the motion is 10 times too small: centimetres were taken for millimetres',
    0.1: 'the motion is 10 times too large: millimetres were taken for centimetres',
    1e3: 'the motion is 1000 times too small: check its unit',
    1e-3: 'the motion is 1000 times too large: check its unit',
    2.0
    ** -0.5: 'the force is 1.41 times as large as the file says, as if its rms were given for the '
    'amplitude',
    2.0**0.5: 'the force is 0.707 times as large as the file says, as if its amplitude were given '
    'for the rms',
}
#: Part of the cost that another unit must save.
_SAVED = 0.15


class Candidate(NamedTuple):
    """
    A further parameter that the model does not have.

    Attributes
    ----------
    name : str
        What it is.
    value, standard_deviation : float
        As one step from the fit gives it; the latter with what the file leaves open.
    unit : str
        Of both.
    meaning : str
        What it says if it is not zero.
    explained : float
        By how much chi squared falls with it.
    """

    name: str
    value: float
    standard_deviation: float
    unit: str
    meaning: str
    explained: float = 0.0

    @property
    def z(self) -> float:
        """The value in standard deviations."""
        return self.value / self.standard_deviation if self.standard_deviation else 0.0


class Column(NamedTuple):
    """Derivatives of residuals and conditions by a parameter, and how far it is known before."""

    name: str
    unit: str
    meaning: str
    residual: Array
    condition: Array
    uncertainty: float = 0.0


def candidates(shooting: Shooting, solution: Solution, chi: float) -> list[Candidate]:
    """Return what one step gives for each further parameter, that which explains most first."""
    equations = solution.equations
    system = System(equations, 1e-11)
    _, multipliers = system.step(equations)
    found = []
    for column in (*constants_of(shooting, solution), *_of_laws(shooting, solution)):
        (information,), _ = system.profile(column.residual[:, None], column.condition[:, None])
        if not information > 0.0:
            continue
        score = column.residual @ equations.residual + multipliers @ column.condition
        own, value = chi / float(np.sqrt(information[0])), float(-score / information[0])
        found.append(
            Candidate(
                column.name,
                value,
                float(np.hypot(own, column.uncertainty)),
                column.unit,
                column.meaning,
                (value / own) ** 2,
            )
        )
    return sorted(found, key=lambda one: -one.explained)


def _of_laws(shooting: Shooting, solution: Solution) -> Iterator[Column]:
    """Yield parameters that depend on what the model takes to be constant, and the delay."""
    unknowns, u, equations = shooting.unknowns, solution.unknowns, solution.equations
    shared, states = shooting.parts(u)
    ends, n = shooting.ends, len(shooting.record.time)
    jump = np.zeros(shooting.count_of_nodes)
    jump[shooting.impacts] = shooting.jumps(u)
    alpha = shared[shooting.alpha_column]
    speed = np.abs(alpha * jump)[ends]
    hit = shooting.kind[ends] != 0

    def spread(
        columns: list[int], at_end: Array, of_node: Array | None = None, size: float = 1.0
    ) -> tuple[Array, Array]:
        """Return derivatives by a parameter that is larger by factors, after nodes or at ends."""
        condition = equations.condition_rates[:, columns].sum(axis=1)
        rows = np.asarray(condition, float).ravel()
        rows[: 5 * len(ends)] *= np.repeat(at_end, 5)
        others = rows[5 * len(ends) :]
        residual = np.zeros(len(equations.residual))
        others[len(shooting.firsts) :] = 0.0
        if of_node is None:
            others[:] = 0.0
            return residual, size * rows
        others[: len(shooting.firsts)] *= of_node[shooting.firsts]
        by = np.asarray(equations.residual_rates[:, columns].sum(axis=1), float).ravel()[:n]
        node = np.searchsorted(states[:, 0], shooting.record.time, side='right') - 1
        residual[:n] = by * of_node[np.clip(node, 0, len(of_node) - 1)]
        return size * residual, size * rows

    alphas = list(set(unknowns.alpha_columns()))
    by_restitution = -unknowns.share * alpha[ends] ** 2
    if hit.any():
        middle = speed[hit].mean()
        yield Column(
            'restitution over impact speed',
            's/m',
            'restitution depends on the speed of impact',
            *spread(alphas, by_restitution * np.where(hit, speed - middle, 0.0)),
        )
    if not unknowns.separate and {1, -1} <= set(shooting.kind[ends].tolist()):
        yield Column(
            'restitution_2 less restitution_1',
            '',
            'the stops have different restitution, which --also restitution_2 fits',
            *spread(alphas, by_restitution * (shooting.kind[ends] == -1)),
        )
    squares = states[:, 1] ** 2 + (states[:, 2] / shooting.rate) ** 2
    size = squares / squares.mean() - 1.0
    stiffness = unknowns.value(shared, 'stiffness')
    yield Column(
        'stiffness over square of amplitude',
        '',
        'the spring is not linear',
        *spread([0], size[ends - 1], size, stiffness),
    )
    span = shooting.record.time[-1] - shooting.record.time[0]
    late = (states[:, 0] - states[:, 0].mean()) / span
    gap = unknowns.value(shared, 'gap')
    yield Column(
        'change of the gap',
        '',
        'the gap changes over the record',
        *spread([unknowns.column('gap')], late[ends], late, gap),
    )
    if 'force_delay' not in unknowns.extras and any(unknowns.rig.force_amplitudes):
        delay = _STEP / shooting.rate
        yield Column(
            'force delay',
            's',
            'the force comes at another time than described, which --also force_delay fits',
            *_varied(shooting, solution, later(unknowns.rig, delay), delay),
        )


def constants_of(shooting: Shooting, solution: Solution) -> list[Column]:
    """Return derivatives by the relative changes of masses and level of the excitation."""
    unknowns, found = shooting.unknowns, []
    for name, constant in CONSTANTS.items():
        other = scaled_constant(unknowns.rig, name, _STEP)
        if other is not None:
            uncertainty = unknowns.uncertain.get(name, constant.uncertainty)
            varied = _varied(shooting, solution, other, _STEP)
            found.append(Column(name, '', constant.meaning, *varied, uncertainty))
    return found


def _varied(
    shooting: Shooting, solution: Solution, rig: RigParameters, step: float
) -> tuple[Array, Array]:
    """Return derivatives by a difference of the rig."""
    varied = copy.copy(shooting)
    varied.unknowns = shooting.unknowns._replace(rig=rig)
    residual, condition = varied.residual(solution.unknowns)
    equations = solution.equations
    return (residual - equations.residual) / step, (condition - equations.condition) / step


def misreading(record: Record, rig: RigParameters, deviation: float) -> str:
    """Return the unit or sign with which the motion is made of far fewer vibrations, or ''."""
    damping = max(rig.damping, 1e-6 * rig.stiffness / rig.omega)

    def cost(factor: float) -> float:
        driven = scaled_constant(rig, 'force_amplitudes', 1.0 / factor - 1.0) or rig
        driven = scaled_constant(driven, 'base_amplitudes', 1.0 / factor - 1.0) or driven
        return scanned(record, driven, (rig.stiffness, damping), deviation, COARSE)[0]

    costs = {factor: cost(factor) for factor in (1.0, *_MISREADINGS)}
    best = min(costs, key=costs.__getitem__)
    return _MISREADINGS[best] if costs[best] < (1.0 - _SAVED) * costs[1.0] else ''
