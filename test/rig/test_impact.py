"""Restitution, and the closed form of the end of a chatter."""

import math

import mpmath
import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters
from impact_damper_ros.rig.transition import (
    CHATTER_HEIGHT,
    CHATTER_INSTANT_TOLERANCE,
    CHATTER_SPAN,
    CHATTER_TOLERANCE,
    chatter_duration,
    may_complete,
)

mp = mpmath.mp.clone()
mp.dps = 60
EPS = 2.0**-52


def impact(mu, restitution, velocity, relative, stop=1):
    """Return the impact of m on a stop it is on, at a start."""
    (event, *_) = Rig(
        RigParameters(
            damper_mass=mu, restitution_1=restitution, restitution_2=restitution, gap=2.0
        ),
        InitialConditions(
            initial_primary_velocity=velocity,
            initial_damper_offset=1.0 if stop == 1 else -1.0,
            initial_damper_velocity=velocity + relative,
        ),
    ).advance(0.0)
    assert (event.kind, event.stop) == (EventKind.IMPACT, stop)
    return event


def states(count, seed):
    """Return mass ratio, R, velocity, relative velocity and stop over wide ranges."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        restitution = rng.choice([0.0, 1.0, 0.75, 0.5, rng.random(), rng.random()])
        relative = abs(rng.normal()) * 10.0 ** rng.uniform(-6, 6)
        stop = int(rng.choice([1, 2]))
        velocity = rng.normal() * 10.0 ** rng.uniform(-6, 6)
        sign = 1.0 if stop == 1 else -1.0
        yield 10.0 ** rng.uniform(-9, 9), float(restitution), velocity, sign * relative, stop


def test_momentum_restitution_and_energy():
    """Also by equations (10) and (11) of Bapat (1995); the loss of energy is exact."""
    for mu, R, v, u, stop in states(1000, 1):
        e = impact(mu, R, v, u, stop)
        z = mp.mpf(e.damper_velocity_before)
        u = z - v
        x_a = ((1 - mp.mpf(mu) * R) * v + mu * (1 + mp.mpf(R)) * z) / (1 + mp.mpf(mu))
        z_a = ((1 + mp.mpf(R)) * v + (mp.mpf(mu) - R) * z) / (1 + mp.mpf(mu))
        fast = abs(v) + 2 * abs(float(u))
        V, W = mp.mpf(e.primary_velocity_after), mp.mpf(e.damper_velocity_after)
        assert abs(V - x_a) <= 4 * EPS * fast
        assert abs(W - z_a) <= 6 * EPS * fast
        assert abs(W - V + R * u) <= 6 * EPS * fast
        assert abs(V + mu * W - v - mu * z) <= 6 * EPS * (1 + mu) * fast
        loss = (mp.mpf(v) ** 2 + mu * z**2 - V**2 - mu * W**2) / 2
        exact = mp.mpf(mu) / (1 + mp.mpf(mu)) * (1 - mp.mpf(R) ** 2) * u**2 / 2
        assert abs(loss - exact) <= 8 * EPS * (1 + mu) * fast**2
        assert e.impulse == pytest.approx(
            float(mu / (1 + mp.mpf(mu)) * (1 + R) * abs(u)), rel=1e-9
        )


@pytest.mark.parametrize(
    ('given', 'velocities'),
    [
        # Plastic: one common velocity; equal masses, elastic: exchanged; m cannot move M;
        # M bounces off m with twice its velocity.
        ((1.0, 0.0, 3.0, 2.0), (4.0, 4.0)),
        ((1.0, 1.0, 0.0, 1.0), (1.0, 0.0)),
        ((1e-9, 0.75, 1.0, 5.0), (1.0, -2.75)),
        ((1e9, 1.0, 0.0, 1.0), (2.0, 1.0)),
    ],
)
def test_limits(given, velocities):
    event = impact(*given)
    after = event.primary_velocity_after, event.damper_velocity_after
    assert after == pytest.approx(velocities, abs=1e-8)


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
