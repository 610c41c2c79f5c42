"""The quick search: points, what is certain between them, and roots; against slower ways."""

import math

import numpy as np
import pytest

from impact_damper_ros.rig.certificate import keeps_sign
from impact_damper_ros.rig.contact import flight_end
from impact_damper_ros.rig.flight import NO_EVENT, motion_at
from impact_damper_ros.rig.roots import (
    Relative,
    acceleration_of,
    base_point,
    contact_root,
    falling_root,
    jerk_of,
    last_step,
    next_point,
)
from oracle.flight_generators import near_grazing_flights, random_flights
from rig.break_contact import flight_of, launchable

FLIGHTS = launchable(random_flights(400, np.random.default_rng(4)))


def polynomial(coefficients, t):
    """Return value and first derivative of a polynomial, lowest coefficient first."""
    p = np.polynomial.Polynomial(coefficients)
    return p(t), p.deriv()(t)


def test_grid_points_are_the_closed_form():
    for i in range(200):
        flight = flight_of(FLIGHTS, i)
        oscillator = flight.oscillator
        rest = flight.constant / oscillator.omega_squared
        base = 0.0 if i % 2 else 0.7 / oscillator.fastest
        point = base_point(flight, base, motion_at(flight, base))
        for k in range(1, oscillator.grid.points + 1):
            point = next_point(oscillator, point)
            motion = motion_at(flight, base + k * oscillator.grid.step)
            scale = abs(motion.x) + abs(flight.x) + abs(rest) + abs(motion.velocity)
            assert point.offset + rest == pytest.approx(motion.x, abs=1e-12 * scale)
            assert point.velocity == pytest.approx(
                motion.velocity, abs=1e-12 * scale * oscillator.fastest
            )
            x_2 = acceleration_of(oscillator, point)
            x_3 = jerk_of(oscillator, point, x_2)
            terms = scale + abs(motion.x_2) + abs(flight.acceleration)
            assert x_2 == pytest.approx(motion.x_2, abs=1e-11 * terms * oscillator.fastest**2)
            assert x_3 == pytest.approx(motion.x_3, abs=1e-11 * terms * oscillator.fastest**3)


def test_what_keeps_its_sign_does():
    """Quartics: their fourth derivative is the bound. It may say no, but never a wrong yes."""
    rng = np.random.default_rng(1)
    s = np.linspace(0.0, 1.0, 2001)
    certain = 0
    for _ in range(4000):
        c = rng.normal(size=5) * [1.0, 3.0, 3.0, 2.0, 2.0]
        if rng.random() < 0.3:
            c[0] = 0.0
        (f_a, f_b), (d_a, d_b) = polynomial(c, np.array([0.0, 1.0]))
        if keeps_sign(f_a, d_a, f_b, d_b, 1.0, 24.0 * abs(c[4]), 0.0):
            certain += 1
            assert (polynomial(c, s[1:])[0] > 0.0).all()
        elif f_a > 0.0:
            # It does say yes where there is room.
            lifted = f_a + 12.0, f_b + 12.0
            assert (
                keeps_sign(lifted[0], d_a, lifted[1], d_b, 1.0, 24.0 * abs(c[4]), 0.0)
                or (polynomial(c, s)[0] + 12.0).min() < 9.0
            )
    assert certain > 300


@pytest.mark.parametrize('start', [1.0, 0.0])
def test_falling_root_is_that_of_the_cubic(start):
    for fall in (1.0, 0.2):
        c = [0.5, -start, -fall, 0.0]
        guess = falling_root(0.5, -start, *polynomial(c, 1.0), 1.0)
        if polynomial(c, 1.0)[0] <= 0.0:
            assert polynomial(c, guess)[0] == pytest.approx(0.0, abs=0.1)


def test_last_step():
    rng = np.random.default_rng(2)
    for _ in range(200):
        c = rng.normal(size=6)
        root = rng.uniform(-1.0, 1.0) / 150.0
        c[1] = -1.0 - abs(c[1])
        c[0] = -sum(c[n] * root**n for n in range(1, 6))
        derivatives = [c[n] * math.factorial(n) for n in range(6)]
        step, exact = last_step(*derivatives, 1.0, 1.0 / 128.0)
        assert exact == (abs(step) <= 1.0 / 128.0)
        if exact:
            assert step == pytest.approx(root, abs=2e-17)


@pytest.mark.parametrize('side', [1, -1])
def test_a_contact_from_the_series_around_a_point_is_that_of_the_closed_form(side):
    """Wherever the root is between half a step before and after the point, or further away."""
    rng = np.random.default_rng(7)
    found = 0
    for i in range(300):
        flight = flight_of(FLIGHTS, i)
        oscillator = flight.oscillator
        step = oscillator.grid.step
        point = base_point(flight, 0.0, motion_at(flight, 0.0))
        for _ in range(2):
            point = next_point(oscillator, point)
        base = 2.0 * step
        there_at = motion_at(flight, base)
        there = Relative(base, there_at.x, there_at.travel, there_at.relative_velocity)
        tau = base + step * rng.uniform(-0.6, 0.6)
        motion = motion_at(flight, tau)
        if side * motion.relative_velocity <= 0.3:
            continue
        clearance = side * motion.travel
        stopped = flight._replace(
            clearance_1=clearance if side > 0 else math.inf,
            clearance_2=clearance if side < 0 else math.inf,
        )
        guess = tau - base + 1e-3 * step * rng.uniform(-1.0, 1.0)
        end = contact_root(
            stopped, side, point, there, there_at.relative_2, guess, tau - step, tau + step
        )
        if abs(tau - base) > 0.55 * step and end.kind == NO_EVENT:
            continue
        found += 1
        scale = abs(flight.x) + abs(motion.x) + abs(motion.travel) + abs(motion.velocity) + 1.0
        assert end.kind == (1 if side > 0 else 2)
        assert end.tau == pytest.approx(tau, abs=1e-13 * scale)
        assert end.x == pytest.approx(motion.x, abs=1e-13 * scale)
        assert end.travel == pytest.approx(motion.travel, abs=1e-13 * scale)
        fast = 1e-13 * scale * (1.0 + oscillator.fastest)
        assert end.velocity == pytest.approx(motion.velocity, abs=fast)
        assert end.relative_velocity == pytest.approx(motion.relative_velocity, abs=fast)
        assert end.slope == pytest.approx(-side * end.relative_velocity, rel=1e-6)
        # Not where it is asked for: no answer
        assert (
            contact_root(
                stopped,
                side,
                point,
                there,
                there_at.relative_2,
                guess,
                tau + step,
                tau + 2.0 * step,
            ).kind
            == NO_EVENT
        )
    assert found > 60


def is_graze(flight, tau):
    """Return whether m comes so near a stop, and no nearer, that round-off decides on a touch."""
    motion = motion_at(flight, tau)
    scale = abs(flight.x) + abs(motion.x) + abs(motion.travel)
    error = 64.0 * np.finfo(float).eps * scale
    gap = min(flight.clearance_1 - motion.travel, flight.clearance_2 + motion.travel)
    overshoot = motion.relative_velocity**2 / (2.0 * abs(motion.relative_2) or math.inf)
    return abs(gap) < error and overshoot < error


def test_the_quick_search_finds_what_certified_steps_find():
    quick = grazes = 0
    for cases in (FLIGHTS, launchable(near_grazing_flights(300, np.random.default_rng(5)))):
        for i in range(len(cases)):
            flight = flight_of(cases, i)
            grid = flight.oscillator.grid._replace(points=0)
            slow = flight._replace(oscillator=flight.oscillator._replace(grid=grid))
            limit = float(cases.horizon[i])
            found, expected = flight_end(flight, 0.0, limit), flight_end(slow, 0.0, limit)
            first = min(found.tau, expected.tau)
            if first > limit:
                continue
            if is_graze(flight, first):
                # Either search may miss it, or find it as far off as the root of round-off.
                grazes += 1
                continue
            assert found.kind == expected.kind
            if found.kind != NO_EVENT:
                quick += found.slope != 0.0
                # The slower m is, the less exactly its arrival is known.
                assert found.tau == pytest.approx(expected.tau, rel=1e-6)
                if abs(found.slope) > 0.1:
                    assert found.tau == pytest.approx(expected.tau, rel=1e-11, abs=1e-13)
    assert quick > 200
    assert grazes < 50
