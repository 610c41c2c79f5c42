"""How fast a recorded motion approaches a periodic one, from a map with a known answer."""

import math

import numpy as np
import pytest

from impact_damper_ros.compare.periodic_motion import decay_rate


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
