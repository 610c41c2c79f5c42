"""Restitution, and the closed form of the end of a chatter."""

import math

import mpmath
import numpy as np
import pytest

from impact_damper_ros.rig.transition import (
    CHATTER_HEIGHT,
    CHATTER_INSTANT_TOLERANCE,
    CHATTER_SPAN,
    CHATTER_TOLERANCE,
    chatter_duration,
    may_complete,
    rebound,
)

mp = mpmath.mp.clone()
mp.dps = 60
EPS = 2.0**-52


def states(count=2000, seed=1):
    """Return (mass ratio, R, velocity, relative velocity) over wide ranges."""
    rng = np.random.default_rng(seed)
    ratio = 10.0 ** rng.uniform(-9, 9, count)
    restitution = rng.choice([0.0, 1.0, 0.75, 0.5], count)
    restitution = np.where(rng.random(count) < 0.5, rng.random(count), restitution)
    velocity, relative = rng.normal(size=(2, count)) * 10.0 ** rng.uniform(-6, 6, (2, count))
    return zip(*map(np.ndarray.tolist, (ratio, restitution, velocity, relative)), strict=True)


def test_momentum_restitution_and_energy():
    """M V + m v is kept, the relative velocity is -R times, the loss is exact."""
    for mu, R, v, u in states():
        after, relative = rebound(v, u, R, mu)
        assert relative == -R * u
        w_before, w_after = mp.mpf(v) + u, mp.mpf(after) + relative
        momentum = mp.mpf(v) + mu * w_before
        fast = abs(v) + 2 * abs(u)
        assert abs(after + mu * w_after - momentum) <= 4 * EPS * (1 + mu) * fast
        loss = (mp.mpf(v) ** 2 + mu * w_before**2 - mp.mpf(after) ** 2 - mu * w_after**2) / 2
        exact = mp.mpf(mu) / (1 + mp.mpf(mu)) * (1 - mp.mpf(R) ** 2) * mp.mpf(u) ** 2 / 2
        assert abs(loss - exact) <= 4 * EPS * (1 + mu) * fast**2
        assert loss >= -4 * EPS * (1 + mu) * fast**2


def test_agrees_with_the_paper():
    """Equations (10) and (11) of Bapat (1995)."""
    for mu, R, v, u in states(500, 2):
        after, relative = rebound(v, u, R, mu)
        z = mp.mpf(v) + u
        x_a = ((1 - mp.mpf(mu) * R) * v + mu * (1 + mp.mpf(R)) * z) / (1 + mp.mpf(mu))
        z_a = ((1 + mp.mpf(R)) * v + (mp.mpf(mu) - R) * z) / (1 + mp.mpf(mu))
        assert abs(after - x_a) <= 4 * EPS * (abs(v) + 2 * abs(u))
        assert abs(after + relative - z_a) <= 6 * EPS * (abs(v) + 2 * abs(u))


def test_limits():
    assert rebound(3.0, -2.0, 0.0, 1.0) == (2.0, 0.0)  # plastic: one common velocity
    assert rebound(0.0, 1.0, 1.0, 1.0) == (1.0, -1.0)  # equal masses, elastic: exchanged
    heavy = rebound(1.0, 5.0, 0.75, 1e-300)  # m cannot move M
    assert heavy == (1.0, -3.75)
    light = rebound(0.0, 1.0, 1.0, 1e9)  # M bounces off m with twice its velocity
    assert light[0] == pytest.approx(2.0, rel=1e-8)
    assert rebound(1.5, 0.0, 0.75, 0.1)[0] == 1.5


def test_elastic_impact_twice_is_none():
    for mu, _, v, u in states(200, 3):
        once = rebound(v, u, 1.0, mu)
        back = rebound(*once, 1.0, mu)
        assert back[0] == pytest.approx(v, abs=8 * EPS * (abs(v) + 2 * abs(u)))
        assert back[1] == u


def summed(speed, press, grip, restitution):
    """Sum the flights of a chatter one by one, in 60 digits."""
    up, down = mp.mpf(press) + grip, mp.mpf(press) - grip
    v, total = mp.mpf(speed), mp.mpf(0)
    for _ in range(200_000):
        rise = v / up
        height = v * rise / 2
        fall = mp.sqrt(2 * height / down)
        total += rise + fall
        v = restitution * down * fall
        if rise + fall < mp.mpf(10) ** -22 * total:
            return total
    raise AssertionError('the sum did not converge')


@pytest.mark.parametrize('restitution', [0.0, 0.1, 0.5, 0.75, 0.95])
@pytest.mark.parametrize('share', [0.0, 1e-6, 0.3, 0.9, 0.999])
def test_chatter_duration(restitution, share):
    """With and without friction, of a speed and a pull of any size."""
    rng = np.random.default_rng(int(1e6 * share) + int(100 * restitution))
    for speed, press in (10.0 ** rng.uniform(-9, 3, (3, 2))).tolist():
        grip = share * press
        want = summed(speed, press, grip, restitution)
        got = chatter_duration(speed, press, grip, restitution)
        down_is_known_to = EPS / (1 - share)
        assert got == pytest.approx(float(want), rel=8 * EPS + 4 * down_is_known_to)


def test_bouncing_ball():
    """Without friction: 2 v/(g (1 - R))."""
    assert chatter_duration(1.0, 2.0, 0.0, 0.75) == pytest.approx(4.0, rel=2 * EPS)


@pytest.mark.parametrize(
    ('press', 'grip', 'restitution'),
    [(-1.0, 0.0, 0.5), (0.0, 0.0, 0.5), (1.0, 1.0, 0.5), (1.0, 2.0, 0.5), (1.0, 0.0, 1.0)],
)
def test_no_chatter(press, grip, restitution):
    """M is pulled off, or held by friction, or bounces for ever."""
    assert chatter_duration(1e-9, press, grip, restitution) == math.inf


def test_friction_ends_even_an_elastic_chatter():
    assert chatter_duration(1.0, 1.0, 0.5, 1.0) == pytest.approx(
        float(summed(1.0, 1.0, 0.5, 1.0)), rel=1e-14
    )


@pytest.mark.parametrize(
    ('limit', 'changed'),
    [
        ({'jerk': 1.5 * CHATTER_TOLERANCE / 1e-3}, 'jerk'),
        (
            {'duration': 1e-5, 'jerk': 1.5 * CHATTER_INSTANT_TOLERANCE / 1e-10, 'omega': 1.0},
            'jerk',
        ),
        ({'omega': CHATTER_SPAN / 1e-3}, 'omega'),
        ({'speed': math.sqrt(2.0 * CHATTER_HEIGHT * 2.0 * 2.5)}, 'speed'),
    ],
    ids=['change of the press', 'instant of rest', 'span', 'height'],
)
def test_completed_only_within_the_tolerances(limit, changed):
    """Each of the four conditions decides where the others hold."""
    given = {'duration': 1e-3, 'speed': 1e-9, 'press': 2.0, 'grip': 0.5}
    given |= {'jerk': 0.0, 'omega': 1e-6, 'gap': 2.0, **limit}
    assert may_complete(**{**given, changed: given[changed] * 0.999})
    assert not may_complete(**{**given, changed: given[changed] * 1.001})
