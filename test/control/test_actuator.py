"""The account of energy: stops that are moved do no work on m, and what they spend is right."""

import pytest
from rig.energy import Account

from control.controlled_rigs import TRIAL, control, random_controlled_rig
from impact_damper_ros.control import Action, Rig
from impact_damper_ros.rig import EventKind

SEEDS = range(10)


@pytest.mark.parametrize('seed', SEEDS)
def test_energy_is_balanced_over_a_run(seed):
    """Work of the force and losses, by quadrature: nothing is left for the stops."""
    rig = random_controlled_rig(f'e{seed}', air_force=0.0)
    account = Account(rig)
    moves = 0
    for k in range(1, 9):
        account.advance(2.0 * k)
        moves += sum(record.action is Action.COMMAND for record in rig.records)
    assert account.imbalance < 1e-9
    assert rig.snapshot()['gap_control']['state']['observer']['crossed'] is not None


def test_a_stop_that_is_closed_meets_m_and_stands():
    rig = Rig(TRIAL, control=control('timed', actuator_speed=8.0))
    events = rig.advance(300.0)
    touched = [e for e in events if e.kind is EventKind.STOP_TOUCHED]
    assert len(touched) > 50
    for event in touched:
        # The impact, if any, is of m against a stop at rest in M.
        hit = [e for e in events if e.kind is EventKind.IMPACT and e.time == event.time]
        for impact in hit:
            w = impact.damper_velocity_before - impact.primary_velocity_before
            v = impact.damper_velocity_after - impact.primary_velocity_after
            assert v == pytest.approx(-0.5 * w, rel=1e-9)


def test_each_start_of_a_stop_is_paid_for():
    speed, mass = 8.0, 0.3
    rig = Rig(TRIAL, control=control('timed', actuator_speed=speed, actuator_mass=mass))
    rig.advance(200.0)
    starts = [0, 0]
    velocities = [0.0, 0.0]
    for record in rig.records:
        for i, velocity in enumerate((record.velocity_1, record.velocity_2)):
            assert velocity in (0.0, speed, -speed)
            starts[i] += velocity not in (0.0, velocities[i])
            velocities[i] = velocity
    assert min(starts) > 50
    quantum = 0.5 * mass * speed**2
    assert rig.energies == pytest.approx([quantum * n for n in starts], rel=1e-12)
    last = rig.records[-1]
    assert (last.energy_1, last.energy_2) == rig.energies


def test_stops_that_move_at_once_spend_nothing():
    rig = Rig(TRIAL, control=control('timed'))
    rig.advance(200.0)
    assert rig.energies == (0.0, 0.0)
    assert {(r.velocity_1, r.velocity_2) for r in rig.records} == {(0.0, 0.0)}


@pytest.mark.parametrize('seed', range(6))
def test_stops_stay_within_their_range(seed):
    rig = random_controlled_rig(f'r{seed}')
    control_ = rig.control
    for _ in range(10):
        rig.advance(rig.time + 3.0)
        for record in rig.records:
            if record.action is Action.COMMAND:
                low, high = record.target_2, record.target_1
                gap = rig.parameters.gap
                assert max(high, -low) <= max(0.5 * control_.gap_max, 0.5 * gap) * (1 + 1e-12)
