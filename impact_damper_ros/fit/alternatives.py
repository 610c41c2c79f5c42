# SPDX-License-Identifier: Apache-2.0
"""
What the model leaves out, and whether the data ask for it.

For each further parameter, zero in the model, one Gauss-Newton step gives its value and standard
deviation without a fit of its own: a score test. Restitution over the speed of impact and K and C
over the amplitude say where a wrong model fails; force and sensor, whether they are as described.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .gauss_newton import Solution, System
from .shooting import Shooting
from .vibration import Array

_STEP = 1e-6


class Alternative(NamedTuple):
    """
    A further parameter that the model does not have.

    Attributes
    ----------
    name : str
        What it is.
    value, standard_deviation : float
        As one step from the fit gives it.
    unit : str
        Of both.
    meaning : str
        What it says if it is not zero.
    """

    name: str
    value: float
    standard_deviation: float
    unit: str
    meaning: str

    @property
    def z(self) -> float:
        """The value in standard deviations."""
        return self.value / self.standard_deviation if self.standard_deviation else 0.0


class _Column(NamedTuple):
    name: str
    unit: str
    meaning: str
    residual: Array
    condition: Array


def alternatives(shooting: Shooting, solution: Solution, chi: float) -> list[Alternative]:
    """Return what one step gives for each further parameter."""
    equations = solution.equations
    system = System(equations, 1e-11)
    _, multipliers = system.step(equations)
    found = []
    for column in _columns(shooting, solution):
        information = system.information(column.residual, column.condition)
        if not information > 0.0:
            continue
        score = column.residual @ equations.residual + multipliers @ column.condition
        deviation = chi / np.sqrt(information)
        found.append(
            Alternative(
                column.name,
                float(-score / information),
                float(deviation),
                column.unit,
                column.meaning,
            )
        )
    return found


def _columns(shooting: Shooting, solution: Solution) -> Iterator[_Column]:
    """Yield the derivatives of residuals and conditions by each further parameter."""
    yield from _of_m(shooting, solution)
    yield from _of_force(shooting, solution)


def _of_m(shooting: Shooting, solution: Solution) -> Iterator[_Column]:
    """Yield restitution over the speed of impact and, if it is one, of stop 2 less that of 1."""
    unknowns, u = shooting.unknowns, solution.unknowns
    shared, _ = shooting.parts(u)
    ends = shooting.ends
    jump = np.zeros(shooting.count_of_nodes)
    jump[shooting.impacts] = shooting.jumps(u)
    alpha = shared[shooting.alpha_column]
    speed = np.abs(alpha * jump)[ends]
    hit = shooting.kind[ends] != 0
    by_alpha = solution.equations.condition_rates[:, list(set(unknowns.alpha_columns()))]
    both = np.asarray(by_alpha.sum(axis=1)).ravel()
    by_restitution = -unknowns.share * alpha[ends] ** 2
    still = np.zeros(len(solution.equations.residual))

    def spread(factor: Array) -> Array:
        rows = both.copy()
        rows[: 5 * len(ends)] *= np.repeat(by_restitution * factor, 5)
        rows[5 * len(ends) :] = 0.0
        return rows

    if hit.any():
        middle = speed[hit].mean()
        yield _Column(
            'restitution over impact speed',
            's/m',
            'restitution depends on the speed of impact',
            still,
            spread(np.where(hit, speed - middle, 0.0)),
        )
    if not unknowns.separate and {1, -1} <= set(shooting.kind[ends].tolist()):
        yield _Column(
            'restitution_2 less restitution_1',
            '',
            'the stops have different restitution, which --also restitution_2 fits',
            still,
            spread(np.where(shooting.kind[ends] == -1, 1.0, 0.0)),
        )


def _of_force(shooting: Shooting, solution: Solution) -> Iterator[_Column]:
    """Yield the force, relative, and its delay."""
    u, equations = solution.unknowns, solution.equations
    rig = shooting.unknowns.rig
    if not any(rig.force_amplitudes):
        return
    larger = rig.replace(force_amplitudes=tuple(f * (1 + _STEP) for f in rig.force_amplitudes))
    delay = _STEP / shooting.rate
    later = rig.replace(
        force_phases=tuple(
            p - w * delay for w, p in zip(rig.force_frequencies, rig.force_phases, strict=True)
        )
    )
    changes = [
        (
            'force amplitude',
            '',
            larger,
            _STEP,
            'the force is not as large as described, or M not as heavy',
        ),
        (
            'force delay',
            's',
            later,
            delay,
            'the force comes at another time than described, which --also force_delay fits',
        ),
    ]
    for name, unit, other, step, meaning in changes:
        if name == 'force delay' and 'force_delay' in shooting.unknowns.extras:
            continue
        varied = copy.copy(shooting)
        varied.unknowns = shooting.unknowns._replace(rig=other)
        residual, condition = varied.residual(u)
        yield _Column(
            name,
            unit,
            meaning,
            (residual - equations.residual) / step,
            (condition - equations.condition) / step,
        )
