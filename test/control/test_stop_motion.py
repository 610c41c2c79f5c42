"""The account of energy: stops that are moved do no work on m, and what they spend is right."""

import math
import random

import pytest
from rig.energy import Account, energy

from control.controlled_rigs import TRIAL, control, random_controlled_rig
from impact_damper_ros.control import Action, Rig
from impact_damper_ros.rig import EventKind

SEEDS = range(10)


class ControlledAccount(Account):
    """The account of a rig under control."""

    def advance(self, time):
        done = self.rig.advance(self.rig.time)
        self.impacts(done)
        events = Rig.restore(self.rig.snapshot()).advance(time)
        for end in [*(e.time for e in events), time]:
            if end > self.rig.time:
                done += self._smooth(end)
        return done


@pytest.mark.parametrize('seed', SEEDS)
def test_energy_is_balanced_over_a_run(seed):
    """Work of the force and losses, by quadrature: nothing is left for the stops."""
    rig = random_controlled_rig(f'e{seed}', air_force=0.0)
    account = ControlledAccount(rig)
    moves = 0
    for k in range(1, 9):
        account.advance(2.0 * k)
        moves += sum(record.action is Action.COMMAND for record in rig.records)
    assert account.imbalance < 1e-9
    assert rig.snapshot()['gap_control']['state']['observer']['crossed'] is not None


@pytest.mark.parametrize('seed', SEEDS)
def test_each_command_leaves_the_energy_as_it_is(seed):
    """At the instant of a command no energy appears; at most m hits the stop that stands."""
    rig = random_controlled_rig(f'm{seed}')
    rng = random.Random(seed)
    plain = Rig(rig.parameters)
    moved = hits = 0
    for _ in range(200):
        rig.advance(rig.time + rng.expovariate(8.0))
        state = {k: v for k, v in rig.snapshot().items() if k != 'gap_control'}
        plain = Rig.restore(state)
        before = plain.sample()
        targets = [rng.uniform(-1.0, 1.0) * rig.parameters.gap for _ in range(2)]
        if rig.parameters.one_sided:
            targets[1] = None
        events = plain.move_stops(*targets, speed=rng.choice([0.5, 5.0, math.inf]))
        after = plain.sample()
        lost = 0.0
        for event in events:
            if event.kind is EventKind.IMPACT:
                hits += 1
                w = event.damper_velocity_before - event.primary_velocity_before
                v = event.damper_velocity_after - event.primary_velocity_after
                mass = rig.parameters.damper_mass / (1.0 + rig.parameters.mass_ratio)
                lost += 0.5 * mass * (w * w - v * v)
                assert lost >= -1e-12
        scale = abs(energy(rig.parameters, before)) + lost + 1.0
        balance = energy(rig.parameters, before) - energy(rig.parameters, after) - lost
        assert abs(balance) < 1e-11 * scale
        moved += before[5:] != after[5:]
    assert moved > 5


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
