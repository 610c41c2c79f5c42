"""Which runs determine what, against fits of rigs that are known."""

import math

import numpy as np
import pytest
from rigs import TABLE

from impact_damper_ros import Rig, load_parameters
from impact_damper_ros.design.bench_plan import planned_run, planned_runs
from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.orbits.flight_regressors import flight_regressors


@pytest.fixture(scope='module')
def rig():
    return TABLE.replace(gap=0.0215)


@pytest.mark.parametrize(
    'values',
    [
        {},
        {'friction': 0.05},
        {'friction': 0.02, 'angle': 0.1},
        {'friction': 0.02, 'air_force': 0.05},
        {'friction': 0.02, 'restitution_2': 0.7},
    ],
)
def test_the_laws_of_flights_give_restitution_friction_and_gap(rig, values):
    """Linear least squares over exact flights return what the rig has."""
    there = rig.replace(**values)
    events = Rig(there).run(6.0).events
    places = np.flatnonzero(events['kind'] == EventKind.IMPACT)
    hits, direct = events[places], np.diff(places) == 1
    jump = hits['primary_velocity_after'] - hits['primary_velocity_before']
    stop = np.where(hits['stop'] == 1, 1.0, -1.0)
    slides = np.sign(hits['damper_velocity_after'] - hits['primary_velocity_after'])[:-1]
    laws = flight_regressors(hits['time'], jump, stop, slides)[direct]
    span = np.diff(hits['time'])
    mass = there.primary_mass / there.damper_mass
    z = hits['primary_velocity_before'][:-1] - mass * jump[:-1]
    push = there.gravity * math.sin(there.angle) - stop[:-1] * there.air_force / there.damper_mass
    other = np.stack(
        [
            hits['primary_velocity_before'][1:] - z - push * span,
            np.diff(hits['x']) - z * span - 0.5 * push * span**2,
        ],
        axis=-1,
    )[direct]
    # Alpha of each stop, as each impact has it
    first, second = (
        laws[..., 0] * (stop[:-1] == own)[direct, None]
        + laws[..., 1] * (stop[1:] == own)[direct, None]
        for own in (1.0, -1.0)
    )
    matrix = np.stack([first, second, laws[..., 2], laws[..., 3]], axis=-1).reshape(-1, 4)
    found = np.linalg.lstsq(matrix, other.ravel(), rcond=None)[0]
    mu = there.mass_ratio
    bounces = (1.0 + mu) / (mu * found[:2]) - 1.0
    assert bounces == pytest.approx([there.restitution_1, there.restitution_2], rel=1e-6)
    grip = there.friction * there.gravity * math.cos(there.angle)
    assert found[2] == pytest.approx(grip, rel=1e-5, abs=1e-8)
    assert found[3] == pytest.approx(there.gap, rel=1e-6)


def test_the_settled_motion_does_not_determine_them_and_the_start_does(rig):
    """Two impacts per cycle are one flight again and again: two laws for three unknowns."""
    alone = planned_run(rig, settled=True)
    assert alone.settled_only
    assert alone.repeats
    assert alone.flights > 150
    assert alone.standard_deviations == (math.inf,) * 3
    start = planned_run(rig).standard_deviations
    assert max(start) < 0.01
    irregular = planned_run(rig.replace(gap=1.1 * rig.gap))
    assert not irregular.repeats
    assert irregular.standard_deviations.restitution < start.restitution


@pytest.mark.parametrize('values', [{}, {'friction': 0.05, 'angle': 0.2, 'restitution_2': 0.8}])
def test_deviations_are_those_of_a_fit_to_measured_flights(rig, values):
    """By least squares: speeds to 1 % of the mean approach, places to 1 % of the gap."""
    there = rig.replace(**values)
    plan = planned_run(there)
    cycle = math.tau / there.first_harmonic[1]
    events = Rig(there).run(100 * cycle).events
    places = np.flatnonzero(events['kind'] == EventKind.IMPACT)
    hits, direct = events[places], np.diff(places) == 1
    assert plan.flights == direct.sum()

    def left(restitution, grip, gap):
        """Return what the laws of the flights, with other values, leave."""
        jump = hits['primary_velocity_after'] - hits['primary_velocity_before']
        stop = np.where(hits['stop'] == 1, 1.0, -1.0)
        slides = np.sign(hits['damper_velocity_after'] - hits['primary_velocity_after'])[:-1]
        laws = flight_regressors(hits['time'], jump, stop, slides)[direct]
        alpha = (1.0 + there.mass_ratio) / (there.mass_ratio * (1.0 + restitution))
        return laws @ [alpha, alpha, grip, gap]

    mean = 0.5 * (there.restitution_1 + there.restitution_2)
    normal = there.gravity * math.cos(there.angle)
    at = np.array([mean, there.friction * normal, there.gap])
    # Per unit of R, of the coefficient of friction, and of the gap over the gap
    steps = np.diag([1e-5, 1e-5 * normal, 1e-5 * there.gap])
    slopes = [(left(*(at + h)) - left(*(at - h))) / 2e-5 for h in steps]
    speed = np.abs(hits['damper_velocity_before'] - hits['primary_velocity_before'])[1:][direct]
    errors = [0.01 * speed.mean(), 0.01 * there.gap]
    matrix = np.stack([(slope / errors).ravel() for slope in slopes], axis=-1)
    expected = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert plan.standard_deviations == pytest.approx(tuple(expected), rel=1e-5)


@pytest.mark.parametrize('values', [{'angle': 0.5 * math.pi, 'gravity': 0.5}, {'gravity': 0.0}])
def test_a_rig_without_a_normal_force_has_no_friction_to_find(values):
    """Restitution and gap are then distinguished, by the settled motion as well."""
    bench, _, _ = load_parameters('bench_rig')
    with_friction = planned_run(bench).standard_deviations
    for settled in (False, True):
        found = planned_run(bench.replace(**values), settled=settled).standard_deviations
        assert found.friction == math.inf
        assert found.restitution < 0.5 * with_friction.restitution
        assert found.relative_gap < 0.002


@pytest.mark.parametrize(
    'values',
    [
        {'force_amplitudes': 0.0, 'multisine_level': 1.0},
        {'force_phases': (0, 0), 'force_amplitudes': (1, 1), 'force_frequencies': (31, 32)},
        {'sweep_mode': 'up'},
    ],
)
def test_a_rig_that_no_sine_shakes_is_refused(values):
    bench, _, _ = load_parameters('bench_rig')
    with pytest.raises(ValueError, match='not shaken by one lasting sine'):
        planned_runs(bench.replace(**values))
