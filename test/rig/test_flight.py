"""The closed form of a flight against the oracle, and the bounds of its derivatives."""

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from impact_damper_ros.rig.first_event import next_point
from impact_damper_ros.rig.flight import motion_at, starting_motion
from impact_damper_ros.rig.oscillator import POINTS, free_bound
from oracle.precise_motion import mp
from rig.flights import EPS, random_case


def cases(count, seed):
    rng = random.Random(seed)
    return [random_case(rng) for _ in range(count)]


def errors(case, t, size):
    """Return the errors of X, X', Y - Y(origin) and Y' at an instant, over round-off of a size."""
    motion, time = motion_at(*case.flight(), t), mp.mpf(t)
    exact = [*case.primary().derivatives(time)[:2], *case.relative().derivatives(time)[:2]]
    exact[2] -= mp.mpf(case.y)
    found = (motion.x, motion.velocity, motion.travel, motion.relative_velocity)
    return [
        float(abs(mp.mpf(got) - want)) / (EPS * unit)
        for got, want, unit in zip(found, exact, size * 2, strict=True)
    ]


@pytest.mark.parametrize(('phases', 'harmonics'), [((-2, 0), 1), ((0, 2), 1), ((-1, 1), 7)])
def test_closed_form(phases, harmonics):
    """To round-off of positions and velocities, and the square of how fast the drive is."""
    rng = random.Random(1)
    given = cases(200, 1)
    for case, other in zip(given, given[1:] + given[:1], strict=True):
        unit = case.omega**2 * other.half_gap, case.omega, 1.0
        more = [tuple(rng.uniform(0.1, 3.0) * u for u in unit) for _ in range(harmonics - 1)]
        full = replace(case, harmonics=(*case.harmonics, *more))
        t = 10 ** rng.uniform(*phases) / full.fastest
        ratio = full.fastest / full.omega
        assert max(errors(full, t, full.size(t))) < 10.0 * ratio**2


def test_short_flights_keep_relative_accuracy():
    """A rebound of any smallness: displacement and speed to a relative round-off."""
    rng = random.Random(2)
    for case in cases(200, 2):
        t = 10 ** rng.uniform(-60, -2) / case.fastest
        run = case.flight()[2]
        strength = case.omega**2 * abs(case.x) + 2 * case.zeta * case.omega * abs(case.velocity)
        strength += abs(case.push) + abs(case.pull) + sum(abs(row[0]) for row in case.harmonics)
        speed = abs(run.relative_velocity) + strength * t
        assert max(errors(case, t, (speed * t, speed))[2:]) < 3.0


@pytest.mark.parametrize('decay', [0.0, 1e-12])
def test_resonance(decay):
    """Where the particular and the homogeneous part of the textbook form cancel."""
    still = dict.fromkeys(('x', 'velocity', 'y', 'relative_velocity', 'pull', 'push'), 0.0)
    case = replace(
        cases(1, 3)[0], omega=1.0, zeta=decay, half_gap=1e9, harmonics=((1.0, 1.0, 0.0),), **still
    )
    for t in (0.1, 1.0, 10.0, 1e3, 1e5):
        motion = motion_at(*case.flight(), t)
        allowed = 4 * EPS * t + decay * t * t
        assert motion.x == pytest.approx((math.sin(t) - t * math.cos(t)) / 2, abs=allowed)
        assert motion.velocity == pytest.approx(t * math.sin(t) / 2, abs=allowed)


@pytest.mark.parametrize('omega', [0.6875, 1.125, 2.25])
def test_a_long_free_vibration_keeps_its_phase(omega):
    """To round-off of X, not of the phase, which is a thousand times as large."""
    still = dict.fromkeys(('velocity', 'y', 'relative_velocity', 'pull', 'push'), 0.0)
    # Their squares are floats, the damped frequency is none.
    given = {'omega': omega, 'zeta': 2.0**-14, 'x': 1.0, 'harmonics': ((0.0, 1.0, 0.0),)}
    case = replace(cases(1, 3)[0], **given, **still)
    for t in (1e3, 12345.6, 7e4):
        want = case.primary().derivatives(mp.mpf(t))[0]
        assert abs(mp.mpf(motion_at(*case.flight(), t).x) - want) < 8 * EPS


def test_at_the_origin_nothing_is_rounded():
    for case in cases(50, 4):
        flight = case.flight()
        run = flight[2]
        start = (run.x, run.velocity, 0.0, run.relative_velocity)
        start += (run.relative_acceleration, run.acceleration)
        assert tuple(motion_at(*flight, 0.0))[:6] == start
        assert starting_motion(*flight) == pytest.approx(motion_at(*flight, 0.0), rel=1e-14)


def test_derivatives_are_those_of_the_motion():
    """And the grid has the points of the closed form."""
    rng = random.Random(5)
    for case in cases(60, 5):
        rig, lines, run, waves = case.flight()
        exact, free = case.primary(), rig.free
        base = rng.choice([0.0, 10 ** rng.uniform(-2, 1)]) / free.fastest
        motion = motion_at(rig, lines, run, waves, base)
        offset, velocity = motion.x - run.constant / free.omega_squared, motion.velocity
        force = abs(case.push) + abs(case.pull) + sum(abs(row[0]) for row in case.harmonics)
        force += free.omega_squared * abs(case.x) + 2 * free.decay * abs(case.velocity)
        for k in range(POINTS + 1):
            want = [float(v) for v in exact.derivatives(mp.mpf(base + k * free.step))]
            unit = max(abs(want[0]), abs(want[1]) / free.fastest, force / free.omega_squared)
            if k == 0:
                found = [motion.x, motion.velocity, *motion[5:]]
            else:
                steps = free.x_x, free.x_v, free.v_x, free.v_v
                offset, velocity = next_point(lines, 0, waves, offset, velocity, *steps)
                found = [offset + run.constant / free.omega_squared, velocity]
            for order, (got, value) in enumerate(zip(found, want, strict=False)):
                assert abs(got - value) <= 1e-11 * unit * free.fastest**order


def test_bounds_hold_over_a_search():
    """X''' to X^(5) and their rates stay below what is derived at its start; and not by much."""
    rng = random.Random(6)
    tight = []
    for case in cases(60, 6):
        flight = case.flight()
        free = flight[0].free
        first = rng.choice([0.0, 10 ** rng.uniform(-2, 1)]) / free.fastest
        end = first + POINTS * free.step
        motions = [motion_at(*flight, float(t)) for t in np.linspace(first, end, 400)]
        for k, drive, rate in (
            (6, free.bound_3, free.rate_3),
            (7, free.bound_4, free.rate_4),
            (8, free.bound_5, free.rate_5),
        ):
            bound = free_bound(free, *motions[0][k : k + 2])
            values = np.array([motion[k] for motion in motions])
            slopes = np.abs(np.diff(values)) * 399 / (end - first)
            assert np.abs(values).max() <= (bound + drive) * (1 + 1e-9)
            assert slopes.max() <= (math.sqrt(free.omega_squared) * bound + rate) * (1 + 1e-6)
            tight.append(np.abs(values).max() / (bound + drive))
    assert np.median(tight) > 0.1
