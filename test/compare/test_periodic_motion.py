"""A recorded motion that repeats, against sequences with a known answer."""

import math

import numpy as np
import pytest

from impact_damper_ros.compare.periodic_motion import decay_rate
from impact_damper_ros.orbits.recognition import ImpactTable, find_recurrence


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
