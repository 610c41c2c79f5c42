"""Restitution of a bouncing ball, with its slope over speed."""

import numpy as np
import pytest

from impact_damper_ros.fit.rebounds import ReboundError, fit_rebounds

G = 9.81


def bounces(count, law, speed=2.5, deviation=0.0, seed=0):
    """Return times of the bounces of a ball whose restitution is a law of its speed."""
    times = [0.1]
    for _ in range(count - 1):
        times.append(times[-1] + 2.0 * speed / G)
        speed *= law(speed)
    return np.array(times) + np.random.default_rng(seed).normal(0.0, deviation, count)


def test_restitution_of_a_ping_pong_ball_falls_with_its_speed():
    """Without noise exactly; with 0.1 ms the intervals hold."""
    true = fit_rebounds(bounces(12, lambda v: 0.92 - 0.03 * v), G)
    assert true.slope.value == pytest.approx(-0.03, abs=1e-9)
    assert true.restitution.value == pytest.approx(0.92 - 0.03 * true.mean_speed, abs=1e-9)
    held = 0
    for seed in range(40):
        found = fit_rebounds(bounces(12, lambda v: 0.92 - 0.03 * v, 2.5, 1e-4, seed), G)
        low, high = found.slope.interval
        held += low < -0.03 < high
        assert found.deviation == pytest.approx(1e-4, rel=0.8)
    # 38 of 40 are expected
    assert held >= 33


def test_a_missing_bounce_is_noticed():
    times = bounces(10, lambda _: 0.7)
    with pytest.raises(ReboundError, match='is missing'):
        fit_rebounds(np.delete(times, 4))
    with pytest.raises(ReboundError, match='4 bounces were measured'):
        fit_rebounds(times[:4])
    with pytest.raises(ReboundError, match='do not rise'):
        fit_rebounds(times[::-1])
