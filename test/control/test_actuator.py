"""The actuators: commands in their order, no work on m, and what the starts of stops spend."""

import math
import random

import pytest
from hypothesis import given, settings, strategies as st
from motion.energy import Account
from motion.random_rigs import rig_of

from control.controlled_rigs import TRIAL, control
from impact_damper_ros import Action, EventKind, GapControlParameters, Order, Rig, RigParameters
from impact_damper_ros.control.actuator import (
    commands_full,
    next_command,
    note_velocity,
    order_stops,
    start_command,
)
from impact_damper_ros.control.controller import control_of


@pytest.mark.parametrize('kind', ['amplitude', 'timed'])
@settings(max_examples=5)
@given(seed=st.integers(0, 10**9))
def test_the_stops_do_no_work_and_stay_within_their_range(kind, seed):
    """Work of the force and losses, by quadrature: nothing is left for the stops."""
    rig = rig_of(kind, seed, [0.0], air_force=0.0)
    account = Account(rig)
    for _ in range(6):
        account.advance(rig.time + 2.0)
        for record in rig.acts:
            if record.action is Action.COMMAND:
                widest = 0.5 * max(rig.control.gap_max, rig.parameters.gap)
                assert max(record.target_1, -record.target_2) <= widest * (1 + 1e-12)
    assert account.imbalance < 1e-9


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
    for record in rig.acts:
        for i, velocity in enumerate((record.velocity_1, record.velocity_2)):
            assert velocity in (0.0, speed, -speed)
            starts[i] += velocity not in (0.0, velocities[i])
            velocities[i] = velocity
    assert min(starts) > 50
    quantum = 0.5 * mass * speed**2
    assert rig.energies == pytest.approx([quantum * n for n in starts], rel=1e-12)
    last = rig.acts[-1]
    assert (last.energy_1, last.energy_2) == rig.energies


def test_stops_that_move_at_once_spend_nothing():
    rig = Rig(TRIAL, control=control('timed'))
    rig.advance(200.0)
    assert rig.energies == (0.0, 0.0)
    assert {(r.velocity_1, r.velocity_2) for r in rig.acts} == {(0.0, 0.0)}


def actuators_of(**values):
    """Return a control of stops at 1 and -1, and its actuators."""
    there = control_of(control('timed', **values), TRIAL.replace(gap=2.0))
    return there, there.actuators


def test_commands_wait_for_the_delay_in_order():
    there, actuators = actuators_of(actuator_delay=0.5, actuator_speed=2.0, actuator_mass=0.1)
    order_stops(there, 1.0, 0.5, math.nan, math.nan)
    order_stops(there, 1.2, 1.0, -0.6, math.nan)
    # One that is to be given later does not hold up the next.
    order_stops(there, 1.1, math.nan, -0.7, math.nan)
    assert [command.time for command in there.waiting] == [1.5, 1.6, 1.7]
    assert next_command(there) == 1.5
    assert start_command(there, 1.0, -1.0)[:2] == (0.5, pytest.approx(math.nan, nan_ok=True))
    assert (actuators.velocity_1, actuators.velocity_2) == (-2.0, 0.0)
    # 0.1 s later it has come 0.2 m far; the other one starts.
    assert start_command(there, 0.8, -1.0)[:2] == (pytest.approx(math.nan, nan_ok=True), -0.7)
    assert (actuators.velocity_1, actuators.velocity_2) == (-2.0, 2.0)
    # Turned round on its way: paid for once more; the other goes on as it is.
    assert start_command(there, 0.6, -0.8)[:2] == (1.0, -0.6)
    assert (actuators.velocity_1, actuators.velocity_2) == (2.0, 2.0)
    spent = actuators.energy_1, actuators.energy_2
    assert spent == pytest.approx([2 * 0.5 * 0.1 * 4.0, 0.5 * 0.1 * 4.0])
    assert next_command(there) == math.inf
    # Stop 1 meets m, goes on, and meets it again; a start behind m is paid for, too.
    for velocity in (0.0, 2.0, 0.0):
        note_velocity(there, 1, velocity)
    spent = spent[0] + 0.2, spent[1]
    assert (actuators.energy_1, actuators.energy_2) == pytest.approx(spent)
    assert (actuators.commanded_1, actuators.commanded_2) == (1.0, -0.7)
    assert (actuators.velocity_1, actuators.velocity_2) == (0.0, 2.0)
    # Of two commands in the same direction the first is paid for, by either stop.
    order_stops(there, 2.0, 1.5, -1.5, math.nan)
    order_stops(there, 2.1, 2.0, -2.0, math.nan)
    for place in (0.9, 1.0):
        start_command(there, place, -place)
    assert (actuators.energy_1, actuators.energy_2) == pytest.approx([v + 0.2 for v in spent])


def test_no_command_is_lost_however_many_wait():
    """Against a list that is sorted; the ring begins anywhere, and is enlarged on the way."""
    rng = random.Random(1)
    there, _ = actuators_of()
    expected = []
    largest = 0
    for k in range(2000):
        if commands_full(there):
            there = there.with_more_room()
        if rng.random() < (0.6 if k % 400 < 200 else 0.35):
            issue, target = round(rng.uniform(0.0, 3.0), 1), float(k)
            order_stops(there, issue, target, math.nan, math.nan)
            expected = sorted([*expected, (issue, target)], key=lambda command: command[0])
        elif expected:
            assert next_command(there) == expected[0][0]
            assert start_command(there, 0.0, 0.0)[0] == expected.pop(0)[1]
        assert [(command.time, command.stop_1) for command in there.waiting] == expected
        largest = max(largest, len(expected))
    assert largest > 30


@pytest.mark.parametrize(
    ('fault', 'stops'),
    [
        ('none', (12.0, -12.0)),
        ('stuck', (10.0, -10.0)),
        ('slow', (10.2, -10.2)),
        ('stop_1_only', (12.0, -10.0)),
        ('stop_2_only', (10.0, -12.0)),
    ],
)
def test_faults_of_the_actuators(fault, stops):
    control = GapControlParameters(
        gap_control='external', actuator_speed=2.0, actuator_fault=fault
    )
    rig = Rig(RigParameters(gap=20.0), control=control)
    rig.order(Order(15.0, -15.0))
    rig.advance(1.0)
    assert rig.stops == pytest.approx(stops, rel=1e-15)
