# SPDX-License-Identifier: Apache-2.0
"""The approach of motions with many impacts: its gradient and its displacements."""

import numpy as np
import pytest

from impact_damper_ros import RigParameters
from impact_damper_ros.orbits.closed_flights import DERIVATIVE, set_rig
from impact_damper_ros.orbits.impact_equations import set_coefficients
from impact_damper_ros.orbits.starts import ImpactEquations
from impact_damper_ros.orbits.variable_projection import keep, project

RIGS = {
    'horizontal': RigParameters(gravity=0.0),
    'tilted': RigParameters(angle=0.5, gravity=1.0, gap=20.0, force_frequencies=(1.02,)),
    'air': RigParameters(gravity=0.0, air_force=0.01, restitution_2=0.5, gap=8.0),
}


@pytest.fixture(autouse=True)
def plain_python(monkeypatch):
    """Let the kernels run as they are, uncompiled."""
    monkeypatch.setattr('impact_damper_ros.orbits.periodic_problem.has_numba', lambda: False)
    monkeypatch.setattr('impact_damper_ros.orbits.flights.has_numba', lambda: False)
    monkeypatch.setattr('impact_damper_ros.motion.kernels.has_numba', lambda: False)


def _set_up(problem):
    """Set the constants of the rig, and what is asked of each impact."""
    moving = problem.arrays.moving
    set_rig(moving.constants, moving.lines, problem.rig)
    set_coefficients(problem.arrays)


def _sum_of_squares(equations, angles):
    """Return the sum of the squares of what the best displacements leave."""
    equations.problem.place[3:-1:4] = angles
    return project(equations.problem.arrays)[0]


@pytest.mark.parametrize('stops', [(1, 2, 2), (1, 2, 1, 2), (1, 1, 2, 2)])
@pytest.mark.parametrize('rig', RIGS)
def test_the_gradient_is_that_of_the_least_squares(rig, stops):
    equations = ImpactEquations(RIGS[rig], stops, 2)
    problem, count = equations.problem, len(stops)
    _set_up(problem)
    rng = np.random.default_rng(5)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi * 2, count))
    _sum_of_squares(equations, angles)
    keep(problem.arrays)
    downhill = problem.matrix(DERIVATIVE)[:count, 0]
    for k, step in enumerate(1e-6 * np.eye(count)):
        ahead, back = (_sum_of_squares(equations, angles + sign * step) for sign in (1, -1))
        assert -2.0 * downhill[k] == pytest.approx((ahead - back) / 2e-6, rel=1e-5, abs=1e-9)


def test_displacements_are_those_of_the_linear_system():
    equations = ImpactEquations(RIGS['tilted'], (1, 1, 2), 1)
    problem = equations.problem
    _set_up(problem)
    angles = np.array([0.3, 2.0, 4.4])
    phase = 0.3 + equations.phase
    system = equations.linear_system((angles - angles[0]) / equations.frequency)
    known = system[:, 3:] @ (np.cos(phase), np.sin(phase), 1.0)
    # The flight from stop 1 to stop 1 is asked for its mean velocity.
    span = (angles[1] - angles[0]) / equations.frequency
    weights = np.where(np.arange(6) == 0, 1.0 / (equations.parameters.omega * span), 1.0)
    best, *_ = np.linalg.lstsq(weights[:, None] * system[:, :3], -weights * known)
    _sum_of_squares(equations, angles)
    assert problem.place[:-1:4] * problem.length == pytest.approx(best, rel=1e-9)
