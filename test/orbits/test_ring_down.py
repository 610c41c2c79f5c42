"""Ring-downs against closed forms, and their passages against the simulator."""

import math

import numpy as np
import pytest

from impact_damper_ros import InitialConditions, Rig, RigParameters
from impact_damper_ros.orbits.flight_arrays import run_flights
from impact_damper_ros.orbits.ring_down import (
    middle_of,
    recorded_ring_down,
    release_start,
    ring_down,
)

W = 20.0 * math.pi
RIG = RigParameters(
    primary_mass=5.0,
    stiffness=5.0 * W**2,
    damping=2.0 * 0.005 * 5.0 * W,
    damper_mass=0.3,
    gap=0.004,
    restitution_1=0.5,
    restitution_2=0.5,
)


def test_without_the_damper_the_dashpot_takes_all():
    found = ring_down(RIG.replace(damper_mass=1e-9, gap=10.0), 0.03, releases=3)
    assert found.loss == pytest.approx(found.dashpot_loss, rel=1e-6)
    assert found.zeta == pytest.approx(RIG.zeta / RIG.eta, rel=1e-6)
    for run in found.runs:
        assert np.diff(run.time) == pytest.approx(math.tau / (W * RIG.eta), rel=1e-9)
        assert run.velocity[-1] > 0.01 * 0.03 * W


def test_passages_are_those_of_the_simulator():
    found = ring_down(RIG, 0.02, releases=2)
    for k, run in enumerate(found.runs):
        rig = Rig(found.parameters, release_start(found.parameters, 0.02, math.tau * k / 2))
        samples = rig.run(float(run.time[-1]), run.time).samples
        assert samples['x'] == pytest.approx(0.0, abs=1e-12)
        assert samples['primary_velocity'] == pytest.approx(run.velocity, rel=1e-9)


def test_a_stuck_damper_is_a_heavier_mass():
    """Between two close stops m rides along, and the structure rings down as one of M + m."""
    found = ring_down(RIG.replace(gap=1e-9, friction=50.0), 1e-4, releases=1)
    both = RIG.primary_mass + RIG.damper_mass
    zeta = RIG.damping / (2.0 * math.sqrt(RIG.stiffness * both))
    assert found.zeta == pytest.approx(zeta / math.sqrt(1.0 - zeta**2), rel=1e-9)


def test_coulomb_friction_takes_the_same_length_from_each_cycle():
    """A light m that slides far takes 4 m gamma g/K from the amplitude in each cycle."""
    rig = RIG.replace(damping=0.0, damper_mass=0.01, friction=0.01, gap=1e3)
    found = ring_down(rig, 0.2, releases=1, most_cycles=20)
    lost = 4.0 * 0.01 * 0.01 * 9.81 / rig.stiffness
    # Released where M is at rest, m stays nearly so.
    assert -np.diff(found.runs[0].velocity) / W == pytest.approx(lost, rel=0.03)


def test_vertical_rigs_have_one_maximum_above_1_g():
    rig = RIG.replace(angle=0.5 * math.pi, friction=0.0, gap=0.03, damping=0.6)
    found = ring_down(rig, 0.05)
    assert middle_of(rig) == pytest.approx(0.3 * 9.81 / rig.stiffness)
    curve = found.curve()
    quiet = curve['acceleration'] < 0.8
    assert quiet.any()
    # Below 1 g m rests on its stop: the dashpot of a mass M + m.
    both = 0.6 / (2.0 * math.sqrt(rig.stiffness * 5.3))
    assert curve['median'][quiet] == pytest.approx(-math.expm1(-4.0 * math.pi * both), rel=1e-4)
    best = curve['acceleration'][np.argmax(curve['median'])]
    assert best > 1.0
    assert curve['median'].max() > 3.0 * found.dashpot_loss


def test_the_loss_of_two_impacts_per_cycle():
    """At the best amplitude of a level rig the loss comes near the bound, and is not above it."""
    rig = RIG.replace(damper_mass=0.05, damping=0.0, gap=0.02)
    found = ring_down(rig, 0.02)
    mass_ratio = 0.01
    assert found.bound == pytest.approx(8.0 * mass_ratio / (1.0 + mass_ratio) * 1.5 / 0.5)
    assert 0.7 * found.bound < found.curve()['median'].max() < 1.05 * found.bound


@pytest.mark.parametrize(
    ('zeta', 'amplitude', 'remedy'),
    [
        *((0.005, amplitude, 'give a positive number') for amplitude in (0.0, -1.0, math.nan)),
        (0.005, math.inf, 'give a positive number'),
        (0.6, 1e-6, r'less damping \(the damping ratio is 0.6, and above 0.59 '),
        (0.999, 1.0, r'less damping \(the damping ratio is 0.999'),
    ],
)
def test_refusals(zeta, amplitude, remedy):
    rig = RigParameters.of_structure(primary_mass=5.0, natural_frequency=10.0, damping_ratio=zeta)
    with pytest.raises(ValueError, match=remedy):
        ring_down(rig, amplitude)


@pytest.mark.parametrize(('zeta', 'cycles'), [(0.585, 1), (0.595, None)])
def test_the_damping_at_which_no_cycle_is_left(zeta, cycles):
    """exp(-2 pi zeta/eta) is 1 % at 0.5912, whatever the amplitude; a recorded one needs two."""
    rig = RigParameters.of_structure(
        primary_mass=5.0, natural_frequency=10.0, damping_ratio=zeta, gap=1.0, force_amplitudes=0.0
    )
    if cycles:
        assert {len(run.loss) for run in ring_down(rig, 0.01).runs} == {cycles}
    else:
        with pytest.raises(ValueError, match='no cycle of M ends above 1 %'):
            ring_down(rig, 0.01)
    start = InitialConditions(initial_primary_position=0.01)
    assert recorded_ring_down(run_flights(Rig(rig, start), 3.0)) is None
