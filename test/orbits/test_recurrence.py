"""A motion that repeats is recognised on a section of its states, and one that does not is not."""

import math

import numpy as np
import pytest

from impact_damper_ros import Rhythm, Section, find_period
from impact_damper_ros.orbits.recurrence import LONGEST_PERIOD


def impacts(phase, value):
    """Return a section at impacts on alternating stops, whose states are all the same number."""
    stop = 1 + np.arange(len(phase)) % 2
    return Section.of_impacts(phase, stop, value, value, value)


N = np.arange(400)
ALTERNATING = np.cos(np.pi * N)


def test_a_period_of_impacts_within_the_rounding_of_their_numbers():
    found = find_period(impacts(0.5 * N, ALTERNATING), 0.0, 1e-12)
    assert (found.cycles, found.rows) == (1, 2)
    assert found.at_floor
    assert found.settled
    assert found.repeated == len(found.distance) == 199


def test_a_period_that_is_approached():
    found = find_period(impacts(0.5 * N, ALTERNATING + 0.2 * 0.98**N), 1e-9, 1e-12)
    assert (found.cycles, found.settled, found.approaches) == (1, False, True)
    assert found.factor == pytest.approx(0.98**2, rel=1e-3)
    # The distance from the limit, by geometric series
    assert found.remaining == pytest.approx(0.2 * 0.98**387, rel=0.2)


@pytest.mark.parametrize(
    ('wobble', 'cycles'),
    [
        # Two periods that differ for good, and two that come to be the same
        (lambda k: 4e-3 * (-1.0) ** k, 2),
        (lambda k: 4e-3 * (-0.97) ** k, 1),
        (lambda k: 4e-3 * 0.9**k, 1),
    ],
    ids=['doubled', 'about to double', 'settling'],
)
@pytest.mark.parametrize('periods', [8, 60])
def test_a_doubled_period_is_distinguished_from_a_slow_approach(wobble, cycles, periods):
    k = np.arange(2 * periods) // 2
    phase = np.ravel(np.arange(periods)[:, None] + np.array([0.2, 0.7])) + wobble(k)
    found = find_period(impacts(phase, np.tile([1.0, -1.0], periods) + wobble(k)), 1e-4, near=1e-2)
    assert (found.cycles, found.rows) == (cycles, 2 * cycles)
    assert found.settled == (found.level < 1e-4)


def test_a_slowly_shrinking_free_vibration_is_no_period_of_its_own():
    """It turns once in four cycles: after four the states are close to what they were."""
    n = np.arange(400.0)
    states = np.stack([np.exp(-1e-3 * n) * np.cos(0.5 * np.pi * n), 0.0 * n], axis=-1)
    for size in (1.0, 1e-3, 1e-6):
        found = find_period(Section.stroboscopic(1.0 + size * states), 1e-8)
        assert found is None or not (found.settled and found.cycles == 4)


def test_a_long_period_of_states_once_in_a_cycle():
    states = np.random.default_rng(5).normal(size=(11, 4))
    section = Section.stroboscopic(np.tile(states, (4, 1)), [1.0, 2.0, 1.0, 2.0])
    found = find_period(section, 1e-9)
    assert (found.cycles, found.rows, found.level) == (11, 11, 0.0)
    assert find_period(section, 1e-9, longest=10) is None


def test_no_period():
    n = np.arange(2000)
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    assert find_period(impacts(0.5 * n, np.cos(math.tau * golden * n)), 1e-8) is None
    draw = np.random.default_rng(3)
    assert find_period(impacts(0.5 * n, draw.normal(size=2000)), 1e-8) is None
    # It leaves a motion that is not stable
    leaving = ALTERNATING[:120] + 1e-9 * 1.1 ** N[:120]
    assert find_period(impacts(0.5 * N[:120], leaving), 0.0, 1e-12) is None
    assert find_period(impacts([0.0, 0.5], np.ones(2)), 1e-8) is None
    # The right instants and places, but other stops
    stops = draw.integers(1, 3, size=400)
    assert find_period(Section.of_impacts(0.5 * N, stops, ALTERNATING), 1e-8) is None
    assert LONGEST_PERIOD == 16


def test_how_far_two_motions_are_apart():
    one = Rhythm((1, 2), 1, (0.999, 0.5), (1.0, -1.0), 2.0)
    other = Rhythm((2, 1), 1, (0.502, 0.003), (-1.1, 1.0), 2.0)
    turned, apart = one.nearest_turn(other)
    assert (turned.stops, turned.phases, turned.x) == ((2, 1), (0.5, 0.999), (-1.0, 1.0))
    # 0.999 and 0.003 are 0.004 of a cycle apart; X at stop 2 by a twentieth of the largest |X|
    assert apart.phase == pytest.approx(0.004)
    assert apart.x == pytest.approx(0.05)
    assert one.distance(other) == max(apart) == pytest.approx(other.distance(one))
    assert one.distance(Rhythm((1, 1), 1, (0.0, 0.5), (1.0, 1.0), 2.0)) == math.inf
    assert one.distance(Rhythm((1, 2), 2, (0.0, 0.5), (1.0, 1.0), 2.0)) == math.inf


def test_counting_from_another_impact_changes_nothing():
    one = Rhythm((1, 1, 2), 2, (0.9, 1.1, 1.9), (1.0, 0.5, -1.0), 1.0)
    for impact, stops in enumerate([(1, 1, 2), (1, 2, 1), (2, 1, 1)]):
        turn = one.begun_at(impact)
        assert turn.stops == stops
        assert 0.0 <= turn.phases[0] < 1.0
        assert one.distance(turn) < 1e-12
