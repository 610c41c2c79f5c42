"""What the comparison measures, each against a closed form or a case with a known answer."""

import math

import numpy as np
import pytest
from compare.recorded import HORIZONTAL, INCLINED, OFF_RESONANCE, metered, recorded

from impact_damper_ros.compare.flight_check import check_intervals
from impact_damper_ros.compare.measured_motion import energy_balance, turning_points
from impact_damper_ros.compare.motion_kind import largest_exponent
from impact_damper_ros.compare.periodic_motion import decay_rate
from impact_damper_ros.compare.recorded_stretch import ForceClock, knots_of
from impact_damper_ros.orbits.irregularity import zero_one_test
from impact_damper_ros.orbits.recognition import ImpactTable, find_recurrence
from impact_damper_ros.rig import RigParameters


def table_of(phase, value):
    """Return impacts on alternating stops whose states are all the same number."""
    count = len(phase)
    stop = np.where(np.arange(count) % 2 == 0, 1.0, 2.0)
    return ImpactTable.of(np.asarray(phase), stop, value, value, value, 1.0)


def test_a_period_and_how_it_is_approached():
    n = np.arange(400)
    settled = find_recurrence(table_of(0.5 * n, np.cos(np.pi * n)))
    assert (settled.cycles, settled.impacts, settled.at_floor) == (1, 2, True)
    shrinking = np.cos(np.pi * n) + 0.2 * 0.98**n
    found = find_recurrence(table_of(0.5 * n, shrinking))
    assert (found.cycles, found.impacts) == (1, 2)
    assert found.factor == pytest.approx(0.98**2, rel=1e-3)
    # The distance from the limit, by geometric series
    assert found.remaining == pytest.approx(0.2 * 0.98**387, rel=0.2)
    doubled = np.cos(np.pi * n) + 1e-4 * np.cos(np.pi * (n // 2))
    found = find_recurrence(table_of(0.5 * n, doubled))
    assert (found.cycles, found.impacts) == (2, 4)
    slow_doubling = np.cos(np.pi * n) + 0.1 * (-0.98) ** (n // 2)
    assert find_recurrence(table_of(0.5 * n, slow_doubling)).cycles == 1


def test_no_period():
    n = np.arange(2000)
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    assert find_recurrence(table_of(0.5 * n, np.cos(math.tau * golden * n))) is None
    draw = np.random.default_rng(3)
    assert find_recurrence(table_of(0.5 * n, draw.normal(size=2000))) is None
    # It leaves a motion that is not stable.
    assert (
        find_recurrence(table_of(0.5 * n[:120], np.cos(np.pi * n[:120]) + 1e-9 * 1.1 ** n[:120]))
        is None
    )
    assert find_recurrence(table_of([0.0, 0.5], np.ones(2))) is None


def test_the_decay_of_a_linear_map():
    angle, factor = 0.4, 0.93
    turn = factor * np.array(
        [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    )
    mixed = np.random.default_rng(5).normal(size=(3, 8))
    state, rows = np.array([1e-3, 2e-3, 3e-3]), []
    for _ in range(200):
        rows.append(state @ mixed)
        state = np.array([*(turn @ state[:2]), 0.5 * state[2]])
    found = decay_rate(np.array(rows) + 7.0, 1e-12)
    assert found.factor == pytest.approx(factor, rel=1e-6)
    assert found.angle == pytest.approx(angle, rel=1e-6)
    assert found.stop - found.start > 100
    assert math.isnan(decay_rate(np.array(rows)[:4], 1e-12).factor)


def test_the_zero_one_test():
    logistic = np.empty(600)
    logistic[0] = 0.3
    for i in range(599):
        logistic[i + 1] = 3.97 * logistic[i] * (1.0 - logistic[i])
    assert zero_one_test(logistic) > 0.95
    assert abs(zero_one_test(np.cos(np.arange(600) * 0.618 * math.tau))) < 0.1
    assert math.isnan(zero_one_test(logistic[:50]))


def test_the_exponent_of_a_periodic_motion_is_that_of_its_multipliers():
    _, impacts, clock = recorded(INCLINED, 400, per_cycle=4)
    found = largest_exponent(clock, impacts[len(impacts) // 2 :])
    assert found.exponent == pytest.approx(math.log(0.94107), abs=0.006)
    assert largest_exponent(clock, impacts[:10]) is None


def test_the_exponent_against_two_neighbouring_runs():
    """Two simulated runs part as fast as the exponent along one of them says."""
    rig = OFF_RESONANCE.replace(gap=20.0)
    _, impacts, clock = recorded(rig, 700, per_cycle=4)
    exponent = largest_exponent(clock, impacts[200:])
    assert 0.2 < exponent.exponent < 0.5
    assert exponent.error < 0.08


def test_turning_points_of_a_cubic():
    # s^3 - s: its rate 3 s^2 - 1 changes sign at s = 1 / sqrt 3, after a step of 2.
    intervals, out = turning_points(
        np.array([2.0, 1.0]), np.array([0.0, 1.0]), np.array([-0.5, 1.0]), np.array([1.0, 1.0])
    )
    assert intervals.tolist() == [0]
    assert out == pytest.approx([-2.0 / (3.0 * math.sqrt(3.0))])


def test_energy_of_a_resonant_oscillator():
    """Without impacts: F sin t on X = -A cos t gives pi F A in a cycle, all to the dashpot."""
    rig = RigParameters(damping=0.1, gap=1e6, gravity=0.0, damper_mass=1e-9)
    step = math.tau / 100
    time = np.arange(0, 501) * step
    x, velocity = -10.0 * np.cos(time), 10.0 * np.sin(time)
    zero = np.zeros_like(time)
    states, impacts, _ = recorded(rig, 1, None)
    states = type(states)(time, x, velocity, zero, zero, x + 5e5, x - 5e5, velocity, velocity)
    clock = ForceClock(rig, 0.0, (0.0,))
    balance = energy_balance(clock, knots_of(rig, states, impacts[:0], 0), 5)
    assert balance.force == pytest.approx(5 * math.pi * 10.0, rel=1e-6)
    assert balance.dashpot == pytest.approx(5 * math.pi * 10.0, rel=1e-6)
    assert abs(balance.residual) < balance.tolerance < 1e-4
    assert (balance.air, balance.friction, balance.impacts) == (0.0, 0.0, 0.0)


def test_energy_of_a_run_with_everything():
    rig = INCLINED.replace(air_force=0.02, damping=0.05)
    states, impacts, clock = recorded(rig, 60, per_cycle=80)
    balance = energy_balance(clock, knots_of(rig, states, impacts, 0), 60)
    parts = (balance.force, balance.air, balance.dashpot, balance.friction, balance.impacts)
    assert min(parts) > 0.1
    assert abs(balance.residual) < balance.tolerance < 1e-4 * balance.force
    # Wrong numbers do not balance.
    other = ForceClock(rig.replace(stiffness=1.01), 0.0, (0.0,))
    wrong = energy_balance(other, knots_of(rig, states, impacts, 0), 60)
    assert abs(wrong.residual) > 10.0 * wrong.tolerance


@pytest.mark.parametrize(
    'rig',
    [
        HORIZONTAL,
        HORIZONTAL.replace(damping=0.0),
        INCLINED.replace(air_force=0.01),
        HORIZONTAL.replace(
            force_amplitudes=(1.0, 0.5), force_frequencies=(1.0, 7.3), force_phases=(0.2, 0.4)
        ),
        HORIZONTAL.replace(multisine_level=0.5, multisine_low=0.5, multisine_high=1.5),
    ],
    ids=['resonance', 'undamped', 'friction and air', 'two harmonics', 'multisine'],
)
def test_flights_are_those_of_the_simulator(rig):
    states, impacts, clock = recorded(rig, 60)
    if rig.multisine_level:
        clock = ForceClock(rig, 0.0, (0.0,) * len(rig.harmonics[0]))
    knots = knots_of(rig, states, impacts, 0)
    found = check_intervals(clock, knots)
    assert found.plain.mean() > 0.95
    assert found.sound[found.plain].all()
    # From one joint state to the next nothing is rounded.
    between = found.plain & (knots.stop[1:] == 0.0) & (knots.stop[:-1] == 0.0)
    assert np.abs(found.residuals[between]).max() < 2e-12


def test_memory_of_long_stretches_is_bounded(monkeypatch):
    """All is checked and counted; of joint states the last ones are kept."""
    module = 'impact_damper_ros.compare.bag_stretches'
    monkeypatch.setattr(f'{module}._MOST_STATES', 1000)
    monkeypatch.setattr(f'{module}._FIRST_IMPACTS', 20)
    monkeypatch.setattr(f'{module}._LAST_IMPACTS', 50)
    states, impacts, clock = recorded(INCLINED, 200)
    stretch, search = metered(states, impacts, clock, part=200)
    assert (stretch.state_count, stretch.impact_count) == (len(states), len(impacts))
    assert search.intervals == len(states) + len(impacts) - 1
    assert 1000 <= len(stretch.states) < 1400
    assert stretch.states.time[-1] == states.time[-1]
    assert 70 <= len(stretch.impacts) < 110
    # Those in between are left out.
    steps = np.diff(np.searchsorted(impacts.time, stretch.impacts.time))
    assert (steps > 1).sum() == 1
    assert 0 < np.argmax(steps) + 1 < 40
    assert len(stretch.envelope.time) <= 2000
    assert stretch.envelope.high.max() == states.x.max()
