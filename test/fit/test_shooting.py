"""The equations of the fit: the engine's motion obeys them, and their derivatives are right."""

import numpy as np
import pytest

from impact_damper_ros.fit.gauss_newton import System
from impact_damper_ros.fit.shooting import Shooting
from impact_damper_ros.fit.unknowns import EXTRAS, Unknowns

from .random_rigs import DEVIATION, measure, random_rig, true_course


@pytest.mark.parametrize('sticks', [False, True])
@pytest.mark.parametrize('quantity', ['displacement', 'velocity', 'acceleration'])
def test_the_exact_motion_obeys_all_laws_and_derivatives_are_those_of_differences(
    quantity, sticks
):
    rng = np.random.default_rng(101)
    rig = random_rig(rng).replace(air_force=0.02, angle=0.01, restitution_speed=0.3)
    if sticks:
        rig = rig.replace(friction=0.1)
    measurement = measure(rig, rng, impacts=30, quantity=quantity)
    unknowns = Unknowns(rig, True, EXTRAS)
    record, course = true_course(unknowns, measurement)
    assert any((ways == 0).any() for ways in course.after) == sticks
    times = measurement.record.impact_times
    shooting = Shooting(record, measurement.deviation, unknowns, course, times, DEVIATION)
    u = shooting.start()
    # In standard deviations of the data
    assert np.abs(shooting.residual(u)[1]).max() < 1e-6
    if quantity != 'acceleration':
        data = shooting.residual(u)[0][: len(record.time)]
        assert np.sqrt(np.mean(data**2)) == pytest.approx(1.0, abs=0.15)
    # Also with parts that begin anew, and reversals that are held
    course.begins[[5, 6, 20]] = True
    for k in range(12, 18):
        course.held[k][:] = True
    shooting = Shooting(record, measurement.deviation, unknowns, course, times, DEVIATION)
    u = shooting.start()
    speed = rig.gap * shooting.rate
    sizes = np.concatenate(
        [
            np.abs(course.shared) + 1e-3,
            np.tile(
                [1.0 / shooting.rate, rig.gap, speed, speed, rig.gap], shooting.count_of_nodes
            ),
        ]
    )
    u += 1e-4 * sizes * rng.normal(size=len(u))
    for soft in (0.0, 7.0):
        shooting.frictionless = soft == 0.0
        equations = shooting.equations(u, soft)
        for _ in range(3):
            way, step = sizes * rng.normal(size=len(u)), 1e-6
            after, before = (shooting.residual(u + sign * step * way, soft) for sign in (1, -1))
            for k, found in enumerate(equations.changes(way)):
                wanted = (after[k] - before[k]) / (2.0 * step)
                np.testing.assert_allclose(found, wanted, atol=3e-6 * np.abs(wanted).max())


def test_a_step_and_the_covariance_are_those_of_the_whole_system():
    rng = np.random.default_rng(101)
    rig = random_rig(rng)
    measurement = measure(rig, rng, impacts=20)
    unknowns = Unknowns(rig, True, EXTRAS)
    record, course = true_course(unknowns, measurement)
    course.begins[[5, 6, 12]] = True
    times = measurement.record.impact_times
    shooting = Shooting(record, measurement.deviation, unknowns, course, times, DEVIATION)
    equations = shooting.equations(
        shooting.start() * (1.0 + 1e-6 * rng.normal(size=shooting.size))
    )
    columns = zip(*map(equations.changes, np.eye(equations.size)), strict=True)
    rates, laws = (np.array(part).T for part in columns)
    # Least squares in the null space of the conditions, which repeat each other in places
    start = -np.linalg.pinv(laws, rcond=1e-12) @ equations.condition
    _, singular, ways = np.linalg.svd(laws)
    ways = ways[int((singular > 1e-12 * singular[0]).sum()) :].T
    scale = np.linalg.norm(rates @ ways, axis=0)
    inner = rates @ ways / scale
    wanted = start - ways / scale @ np.linalg.pinv(inner) @ (equations.residual + rates @ start)
    system = System(equations, 1e-13)
    step, _ = system.step(equations)
    shared = slice(shooting.count)
    deviations = np.sqrt(
        np.diag(ways / scale @ np.linalg.pinv(inner.T @ inner) @ (ways / scale).T)
    )
    found = np.sqrt(np.diag(system.covariance(np.arange(shooting.count))))
    np.testing.assert_allclose(found, deviations[shared], rtol=1e-3)
    assert np.abs((step - wanted)[shared] / deviations[shared]).max() < 1e-3
    assert np.abs(laws @ step + equations.condition).max() < 1e-6
