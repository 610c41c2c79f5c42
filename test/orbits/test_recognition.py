"""Impacts that repeat are recognised as what they are, and matched with motions of the theory."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from rigs import FRICTION

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits, orbit_near
from impact_damper_ros.orbits.recognition import (
    RECOGNISED,
    SETTLED_DRIFT,
    ImpactTable,
    Rhythm,
    approaches,
    find_recurrence,
    period_distances,
    rhythm_of,
)
from impact_damper_ros.rig import EventKind, RigParameters


def repeating(phases, x, cycles, periods, wobble=lambda _: 0.0):
    """Return instants and X of a motion that repeats, but for `wobble(period)`."""
    instants = [k * cycles + p + wobble(k) for k in range(periods) for p in phases]
    return instants, [value + wobble(k) for k in range(periods) for value in x]


def impacts_after(rig, cycles):
    """Return the impacts of a run from rest and their instants in cycles of the force."""
    cycle = math.tau / rig.force_frequencies[0]
    events = Rig(rig).advance(cycles * cycle)
    impacts = [event for event in events if event.kind is EventKind.IMPACT]
    return impacts, [event.time / cycle for event in impacts]


@pytest.mark.parametrize(
    ('rig', 'stops', 'cycles'),
    [
        (RigParameters(gravity=0.0), (1, 2), 1),
        (FRICTION, (1, 2), 1),
        (RigParameters(gravity=0.0, gap=18.0, force_frequencies=1.02), (1, 1, 2), 1),
        (RigParameters(gravity=0.0, gap=8.0, force_frequencies=1.02), (1, 1, 2, 2), 1),
    ],
)
def test_the_simulator_settles_into_the_rhythm_of_the_theory(rig, stops, cycles):
    impacts, instants = impacts_after(rig, 400)
    found = rhythm_of(instants, [e.stop for e in impacts], [e.x for e in impacts], 10.0)
    assert (found.stops, found.cycles) == (stops, cycles)
    assert found.settled
    assert found.phases[0] == instants[found.first] % 1.0
    assert found.x[-1] == impacts[found.first + found.impacts - 1].x
    orbit = orbit_near(rig, impacts[-1], instants[-1], cycles)
    assert orbit.stable
    turned, apart = Rhythm.of(orbit).turned_to(found)
    assert turned.stops == stops
    assert max(apart) < 1e-6
    if len(stops) == 2:
        theory = find_orbits(rig, stops, cycles).orbits[0]
        assert max(Rhythm.of(theory).turned_to(found)[1]) < 1e-6


def test_the_transient_is_recognised_before_it_has_settled():
    impacts, instants = impacts_after(FRICTION, 100)
    stops, x = [e.stop for e in impacts], [e.x for e in impacts]
    found = rhythm_of(instants, stops, x, 5.07)
    assert (found.stops, found.cycles, found.settled) == ((1, 2), 1, False)
    assert SETTLED_DRIFT < found.drift < RECOGNISED
    assert rhythm_of(instants[:40], stops[:40], x[:40], 5.07) is None


def test_a_settled_motion_of_many_cycles():
    phases, x = (0.25, 0.7, 2.1), (1.0, 2.0, -1.5)
    instants, positions = repeating(phases, x, 3, 9)
    found = rhythm_of(instants, [1, 1, 2] * 9, positions, 2.0)
    assert (found.stops, found.cycles) == ((1, 1, 2), 3)
    assert found.phases == pytest.approx(phases)
    assert found.x == x
    assert rhythm_of(instants, [1, 1, 2] * 9, positions, 2.0, most_cycles=2) is None


@pytest.mark.parametrize(
    ('wobble', 'cycles'),
    [
        # Two periods that differ for good, and two that come to be the same.
        (lambda k: 4e-3 * (-1) ** k, 2),
        (lambda k: 4e-3 * (-0.97) ** k, 1),
        (lambda k: 4e-3 * 0.9**k, 1),
    ],
    ids=['doubled', 'about to double', 'settling'],
)
def test_a_doubled_period_is_told_from_a_slow_approach(wobble, cycles):
    for periods in (8, 31, 60):
        instants, x = repeating((0.2, 0.7), (1.0, -1.0), 1, periods, wobble)
        found = rhythm_of(instants, [1, 2] * periods, x, 1.0)
        assert (found.cycles, found.impacts) == (cycles, 2 * cycles)
        assert found.settled == (found.drift < SETTLED_DRIFT)


def test_the_decay_is_the_factor_per_period():
    instants, x = repeating((0.2, 0.7), (1.0, -1.0), 1, 20, lambda k: 1e-2 * 0.8**k)
    found = rhythm_of(instants, [1, 2] * 20, x, 1.0)
    assert found.decay == pytest.approx(0.8, abs=1e-6)


def test_no_rhythm_where_there_is_none():
    dice = random.Random(7)
    instants = sorted(dice.uniform(0.0, 200.0) for _ in range(400))
    stops = [dice.choice((1, 2)) for _ in instants]
    x = [dice.uniform(-1.0, 1.0) for _ in instants]
    assert rhythm_of(instants, stops, x, 1.0) is None
    assert rhythm_of([], [], [], 1.0) is None
    assert rhythm_of([0.5], [1], [0.0], 0.0) is None


def test_counting_from_another_impact_changes_nothing():
    one = Rhythm((1, 1, 2), 2, (0.9, 1.1, 1.9), (1.0, 0.5, -1.0), 1.0)
    turns = list(one.turns())
    assert [turn.stops for turn in turns] == [(1, 1, 2), (1, 2, 1), (2, 1, 1)]
    for turn in turns:
        assert 0.0 <= turn.phases[0] < 1.0
        back, apart = turn.turned_to(one)
        assert back.stops == one.stops
        assert back.phases == pytest.approx(one.phases)
        assert max(apart) < 1e-12


def test_how_far_two_rhythms_are_apart():
    one = Rhythm((1, 2), 1, (0.999, 0.5), (1.0, -1.0), 2.0)
    other = Rhythm((2, 1), 1, (0.502, 0.003), (-1.1, 1.0), 2.0)
    turned, apart = one.turned_to(other)
    assert (turned.stops, turned.phases, turned.x) == ((2, 1), (0.5, 0.999), (-1.0, 1.0))
    # 0.999 and 0.003 are 0.004 of a cycle apart; X at stop 2 by a twentieth of the largest |X|.
    assert apart.phase == pytest.approx(0.004)
    assert apart.x == pytest.approx(0.05)
    assert one.turned_to(Rhythm((1, 1), 1, (0.0, 0.5), (1.0, 1.0), 2.0)) is None
    assert one.turned_to(Rhythm((1, 2), 2, (0.0, 0.5), (1.0, 1.0), 2.0)) is None


def test_the_last_period_begins_where_stop_1_follows_stop_2():
    instants, x = repeating((0.1, 0.4, 0.6, 0.8), (1.0, 2.0, -1.0, -2.0), 1, 6)
    found = rhythm_of(instants[:-1], ([1, 1, 2, 2] * 6)[:-1], x[:-1], 2.0)
    assert found.stops == (1, 1, 2, 2)
    assert all(b > a for a, b in pairwise(found.phases))


@pytest.mark.parametrize(
    ('factor', 'periods', 'expected'), [(0.9, 20, True), (1.1, 20, False), (0.9, 10, False)]
)
def test_an_approach_is_seen_over_twelve_periods(factor, periods, expected):
    """Distances of periods that spiral in, or out, from 0.01 at the end."""

    def wobble(k):
        return 0.01 * factor ** (k - periods) if factor > 1.0 else 0.01 * factor**k

    instants, x = repeating((0.2, 0.7), (1.0, -1.0), 1, periods, wobble)
    stops = [1, 2] * periods
    rhythm = rhythm_of(instants, stops, x, 1.0)
    distances = period_distances(instants, stops, x, rhythm)
    last = abs(wobble(periods - 1) - wobble(periods - 2))
    assert distances[-1] == pytest.approx(last, rel=1e-9)
    assert distances[-1] / distances[-2] == pytest.approx(factor, rel=1e-9)
    assert len(distances) == min(18, periods - 1)
    assert approaches(distances) is expected


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
