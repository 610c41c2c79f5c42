"""Motions from their events: against the simulator, and from the motions of a simpler rig."""

import pytest
from rigs import FRICTION, INCLINED, VERTICAL

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters, find_orbits, settle
from impact_damper_ros.orbits.search import carried_over, settled_orbits
from impact_damper_ros.orbits.solved_orbits import after_impact


@pytest.mark.filterwarnings('error')
def test_a_chatter_that_ends_in_rest_is_found_without_friction():
    """Its impacts up to the rest are counted; the impact equations alone do not have it."""
    rig = VERTICAL.replace(restitution_1=0.2, force_amplitudes=6.0)
    found = find_orbits(rig, (1,) * 12, 5, starts=0)
    (orbit,) = found.orbits
    assert (orbit.stable, orbit.viable) == (True, True)
    assert [event.kind for event in orbit.events] == [EventKind.RELEASE, EventKind.REST]
    assert found.report.converged > 0
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
    """Of 15 starts 14 converge; with the first nodes kept it would be two."""
    report = find_orbits(FRICTION.replace(gap=12.0, friction=2.0), (1, 2)).report
    assert report.converged > 10


def test_a_motion_is_carried_to_friction_step_by_step():
    level = INCLINED.replace(gap=16.0)
    start = find_orbits(level, (1, 1, 2), simulate=False).orbits[0]
    orbit = carried_over(start, level.replace(friction=0.5))
    assert orbit is not None
    assert orbit.parameters.friction == 0.5
    expected = find_orbits(level.replace(friction=0.5), (1, 1, 2)).orbits[0]
    assert orbit.x_max == pytest.approx(expected.x_max, rel=1e-10)


def test_a_stable_motion_beside_an_unstable_one_is_found():
    """Runs from all usual starts settle elsewhere."""
    rig = FRICTION.replace(gravity=2.0, gap=21.25)
    found = find_orbits(rig, (1, 2))
    orbit = found.orbits[0]
    assert (orbit.viable, orbit.stable) == (True, True)
    assert {event.kind for event in orbit.events} == {EventKind.STICK, EventKind.RELEASE}
    assert orbit.x_max == pytest.approx(8.949383, abs=1e-6)
    assert not found.report.complete


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
    assert not found.report.complete
    assert min(orbit.distance(rhythm) for orbit in found.orbits if orbit.stable) < 1e-9


def several(**changes):
    """Return a rig whose force repeats after two cycles of its first harmonic."""
    first = changes.pop('force_frequencies')
    amplitudes = (1.0, changes.pop('second'))
    return RigParameters(
        damping=0.1,
        force_amplitudes=amplitudes,
        force_frequencies=(first, 1.5 * first),
        force_phases=(0.0, 0.3),
        **changes,
    )


@pytest.mark.parametrize(
    ('rig', 'stops', 'expected'),
    [
        # Stable, and with many impacts on its way there; unstable
        (
            several(gravity=1.0, angle=1.2, one_sided=True, force_frequencies=3.0, second=0.1),
            (1, 1),
            ['stable', 'unstable'],
        ),
        (
            several(gravity=0.0, gap=30.0, force_frequencies=1.02, second=0.2),
            (1, 2, 1, 2),
            ['stable', 'unstable'],
        ),
    ],
)
def test_motions_of_one_harmonic_that_repeat_within_the_period_of_several(rig, stops, expected):
    """The second harmonic makes one motion of two periods, or two of it."""
    found = find_orbits(rig, stops, 2)
    assert [orbit.stability for orbit in found.orbits] == expected
    for orbit in found.orbits:
        run = after_impact(orbit, rig)
        hits = run.run(1.01 * orbit.period).impacts()
        assert hits['stop'].tolist() == [*stops[1:], stops[0]]
        instants = [*orbit.instants[1:], orbit.instants[0] + orbit.period]
        assert hits['time'] + orbit.instants[0] == pytest.approx(instants, abs=1e-7)
        assert hits['x'].tolist() == pytest.approx([*orbit.x[1:], orbit.x[0]], rel=1e-7)


def test_a_motion_of_one_harmonic_may_begin_in_any_of_its_cycles():
    """With a second harmonic of twice the period these are different motions."""
    rig = RigParameters(gravity=0.0, force_frequencies=1.02, gap=21.5, damping=0.01)
    doubled = [o for o in find_orbits(rig, (1, 2, 1, 2), 2, starts=400).orbits if o.viable]
    assert [orbit.stable for orbit in doubled] == [True, True]
    both = rig.replace(
        force_amplitudes=(1.0, 1e-4), force_frequencies=(1.02, 0.51), force_phases=(0.0, 0.0)
    )
    found = find_orbits(both, (1, 2, 1, 2), 2, starts=400, simulate=False).orbits
    # Two of each, and three of two periods, which are unstable
    assert [orbit.stability for orbit in found] == ['stable'] * 4 + ['unstable'] * 3
    near = [sum(o.distance(one) < 1e-3 for o in found if o.stable) for one in doubled]
    assert near == [2, 2]
