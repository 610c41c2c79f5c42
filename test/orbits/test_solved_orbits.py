"""Motions from their events: against the simulator, and from the motions of a simpler rig."""

import pytest
from rigs import FRICTION, INCLINED, VERTICAL

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits, settle
from impact_damper_ros.orbits.search import carried_over, settled_orbits
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters


@pytest.mark.filterwarnings('error')
def test_a_chatter_that_ends_in_rest_is_found_without_friction():
    """Its impacts up to the rest are counted; the impact equations alone do not have it."""
    rig = VERTICAL.replace(restitution_1=0.2, force_amplitudes=6.0)
    found = find_orbits(rig, (1,) * 12, 5, starts=0)
    (orbit,) = found.orbits
    assert (orbit.stable, orbit.viable) == (True, True)
    assert [event.kind for event in orbit.events] == [EventKind.RELEASE, EventKind.REST]
    assert found.report.simulated_converged > 0
    events = Rig(rig).advance(700 * orbit.cycle)
    (rest,) = [event for event in events if event.kind is EventKind.REST][-1:]
    assert rest.time / orbit.cycle % 1.0 == pytest.approx(orbit.events[1].phase % 1.0, abs=1e-6)
    impacts = [event for event in events if event.kind is EventKind.IMPACT]
    x = [event.x for event in impacts if rest.time - orbit.period < event.time <= rest.time]
    turned = [list(orbit.x[i:] + orbit.x[:i]) for i in range(12)]
    assert any(x == pytest.approx(each, rel=1e-4) for each in turned)


def test_newton_converges_quadratically():
    found = settled_orbits(FRICTION.replace(gap=16.0), 1)
    orbit = next(orbit for orbit in found if orbit is not None and orbit.stable)
    history = [value for value in orbit.residual_history if value > 1e-13]
    assert len(history) <= 8
    assert history[-1] < 1e3 * history[-2] ** 2 + 1e-13


def test_nodes_are_read_anew_where_the_rig_cannot_perform_a_solution():
    """Of 15 starts from simulation 14 converge; with the first nodes kept it would be two."""
    report = find_orbits(FRICTION.replace(gap=12.0, friction=2.0), (1, 2)).report
    assert report.simulated_converged > 10


def test_a_motion_is_carried_to_friction_step_by_step():
    level = INCLINED.replace(gap=16.0)
    start = find_orbits(level, (1, 1, 2), simulate=False).orbits[0]
    orbit = carried_over(start, level.replace(friction=0.5))
    assert orbit is not None
    assert orbit.parameters.friction == 0.5
    expected = find_orbits(level.replace(friction=0.5), (1, 1, 2)).orbits[0]
    assert orbit.x_max == pytest.approx(expected.x_max, rel=1e-10)


SEVERAL = RigParameters(
    damping=0.1,
    gap=12.0,
    gravity=0.3,
    angle=0.2,
    friction=0.1,
    force_amplitudes=(1.0, 0.3, 0.2),
    force_frequencies=(1.02, 2.04, 3.06),
    force_phases=(0.4, 1.0, -2.0),
)


@pytest.mark.parametrize('friction', [0.0, 0.1])
def test_several_harmonics_with_a_common_period(friction):
    rig = SEVERAL.replace(friction=friction)
    start = InitialConditions(initial_primary_position=1.0)
    rhythm = settle(Rig(rig, start), tolerance=1e-11).rhythm
    found = find_orbits(rig, rhythm.stops, rhythm.cycles)
    assert found.report.method == 'events'
    assert min(orbit.distance(rhythm) for orbit in found.orbits if orbit.stable) < 1e-9
