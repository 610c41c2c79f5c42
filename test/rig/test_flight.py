"""The closed form of a flight against 50-digit arithmetic, and the bounds of its derivatives."""

import itertools
import math
import random
from math import cos, inf, sin

import mpmath
import numpy as np
import pytest

from impact_damper_ros.rig.flight import Flight, motion_at
from impact_damper_ros.rig.oscillator import acceleration_at, derivative_bound, make_oscillator

mp = mpmath.mp.clone()
mp.dps = 50
EPS = 2.0**-52
ZETAS = (0.0, 1e-9, 0.005, 0.3, 0.9, 0.9999)


def make_flight(oscillator, constant, phases, x, velocity, speed, damper_acceleration):
    sines = tuple(sin(p) for p in phases)
    acceleration = acceleration_at(oscillator, constant, sines, x, velocity)
    return Flight(
        oscillator=oscillator,
        constant=constant,
        sines=sines,
        cosines=tuple(cos(p) for p in phases),
        x=x,
        velocity=velocity,
        acceleration=acceleration,
        relative_velocity=speed,
        relative_acceleration=damper_acceleration - acceleration,
        clearance_1=inf,
        clearance_2=inf,
        joint=False,
        direction=0,
        arrival=inf,
        slope=0.0,
        support_low=-inf,
        support_high=inf,
    )


class Exact:
    """
    Particular and homogeneous solution, in 50 digits, from the very floats of a flight.

    The relative acceleration at the start is the flight's own float, as everything else.
    """

    def __init__(self, flight):
        o, f = flight.oscillator, flight
        self.f = f
        self.a, self.square = mp.mpf(o.decay), mp.mpf(o.omega_squared)
        # The damped frequency is a rounded float of the oscillator; the exact one is meant.
        self.b = mp.sqrt(self.square - self.a**2)
        self.terms = []
        for harmonic, s, c in zip(o.harmonics, f.sines, f.cosines, strict=True):
            W, turn = mp.mpf(harmonic.frequency), mp.mpc(c, s)
            below = mp.mpc(self.square - W * W, 2 * self.a * W)
            self.terms.append((harmonic.force * turn, W, below, below == 0))
        x_p, v_p = self.particular(mp.mpf(0))
        self.x_h, self.v_h = f.x - x_p, f.velocity - v_p

    def particular(self, t):
        x, v = mp.mpf(self.f.constant) / self.square, mp.mpf(0)
        for turn, W, below, resonant in self.terms:
            e = turn * mp.expj(W * t)
            if resonant:  # t / (2 i W) e^{iWt} solves it, undamped
                x += (e * t / (2j * W)).imag
                v += (e / (2j * W) + e * t / 2).imag
            else:
                x += (e / below).imag
                v += (1j * W * e / below).imag
        return x, v

    def drive(self, t):
        return sum((turn * mp.expj(W * t)).imag for turn, W, _, _ in self.terms)

    def __call__(self, t):
        """Return X, X', X'', travel and relative velocity."""
        t, f = mp.mpf(t), self.f
        decay, s, c = mp.exp(-self.a * t), mp.sin(self.b * t), mp.cos(self.b * t)
        x, v = self.particular(t)
        impulse = decay * s / self.b
        x += self.x_h * (decay * c + self.a * impulse) + self.v_h * impulse
        v += self.v_h * (decay * c - self.a * impulse) - self.square * self.x_h * impulse
        x_2 = f.constant + self.drive(t) - 2 * self.a * v - self.square * x
        gz = mp.mpf(f.relative_acceleration) + mp.mpf(f.acceleration)
        # The start's acceleration is a rounded float: what it misses moves m with M.
        true = f.constant + self.drive(mp.mpf(0)) - 2 * self.a * f.velocity - self.square * f.x
        gz -= f.acceleration - true
        travel = (f.relative_velocity + mp.mpf(f.velocity)) * t + gz * t * t / 2 - (x - f.x)
        return x, v, x_2, travel, f.relative_velocity + gz * t - (v - f.velocity)


def scales(flight, t):
    """Return the sizes of displacement and velocity that round-off is measured by."""
    o = flight.oscillator
    omega = math.sqrt(o.omega_squared)
    length, speed = abs(flight.x) + abs(flight.velocity) * min(t, 1 / o.frequency), 0.0
    pulls = [abs(flight.constant)] + [abs(one.force) for one in o.harmonics]
    fast = [0.0, *(one.frequency for one in o.harmonics)]
    turns = 1 + max(omega, *(one.frequency for one in o.harmonics if one.force)) * t
    for pull, W in zip(pulls, fast, strict=True):
        near = math.hypot(o.decay, W - o.frequency)
        reach = min(t * t / 2, t / o.frequency, 2 / (o.frequency * near) if near else inf)
        length += pull * reach
        speed += pull * min(t, 2 * omega / (o.frequency * near) if near else inf)
    speed += omega * abs(flight.x) + abs(flight.velocity)
    gz = abs(flight.relative_acceleration + flight.acceleration)
    drift = abs(flight.relative_velocity) + abs(flight.velocity)
    return length * turns + drift * t + gz * t * t / 2, speed * turns + drift + gz * t


def random_flight(rng, zeta=None, ratios=None, omega=None):
    omega = omega or 10 ** rng.uniform(-2, 3)
    zeta = rng.choice(ZETAS) if zeta is None else zeta
    ratios = ratios or [
        rng.choice([1.0, 10 ** rng.uniform(-2, 2)]) for _ in range(rng.choice([1, 1, 2, 5]))
    ]
    mass = 10 ** rng.uniform(-2, 2)
    oscillator = make_oscillator(
        mass,
        mass * omega * omega,
        2 * zeta * mass * omega,
        tuple(mass * omega * omega * rng.uniform(-1, 1) for _ in ratios),
        tuple(omega * r for r in ratios),
    )
    return make_flight(
        oscillator,
        omega * omega * rng.uniform(-1, 1) * rng.choice([0, 1]),
        [rng.uniform(-3, 3) for _ in ratios],
        rng.uniform(-1, 1) * rng.choice([0, 1, 1]),
        omega * rng.uniform(-1, 1) * rng.choice([0, 1, 1]),
        omega * rng.uniform(-1, 1),
        omega * omega * rng.uniform(-1, 1),
    )


def errors(flight, t):
    exact = Exact(flight)(t)
    motion = motion_at(flight, t)
    length, speed = scales(flight, t)
    got = (motion.x, motion.velocity, motion.travel, motion.relative_velocity)
    want = (exact[0], exact[1], exact[3], exact[4])
    units = (length, speed, length, speed)
    return [float(abs(g - w)) / (EPS * unit) for g, w, unit in zip(got, want, units, strict=True)]


@pytest.mark.parametrize('zeta', ZETAS)
@pytest.mark.parametrize('ratio', [0.0, 1e-3, 0.5, 1.0, 1.0 + 1e-12, 1.0 - 1e-6, 1.02, 3.0])
def test_closed_form(zeta, ratio):
    rng = random.Random(f'{zeta} {ratio}')
    worst = 0.0
    for _ in range(6):
        flight = random_flight(rng, zeta, [ratio])
        omega = math.sqrt(flight.oscillator.omega_squared)
        for t in (10 ** rng.uniform(-6, 0), rng.uniform(0.1, 3), rng.uniform(3, 200)):
            worst = max(worst, *errors(flight, t / omega))
    # Near critical damping 1/b is 70 times 1/omega.
    assert worst < (600 if zeta > 0.99 else 60)


@pytest.mark.parametrize('ratio', [10.0, 30.0, 100.0])
def test_fast_drive(ratio):
    rng = random.Random(ratio)
    worst = 0.0
    for _ in range(30):
        flight = random_flight(rng, rng.choice(ZETAS[:4]), [ratio])
        omega = math.sqrt(flight.oscillator.omega_squared)
        worst = max(worst, *errors(flight, 10 ** rng.uniform(-4, 1) / omega))
    assert worst < 10 * ratio


@pytest.mark.parametrize('harmonics', [3, 20, 50])
def test_many_harmonics(harmonics):
    rng = random.Random(harmonics)
    worst = 0.0
    for _ in range(4):
        ratios = [1.0, *(rng.uniform(0, 3) for _ in range(harmonics - 1))]
        flight = random_flight(rng, 0.005, ratios)
        omega = math.sqrt(flight.oscillator.omega_squared)
        for t in (0.01, 0.5, 7.0):
            worst = max(worst, *errors(flight, t / omega))
    assert worst < 60


def test_resonance_without_damping_grows_linearly():
    oscillator = make_oscillator(1.0, 1.0, 0.0, (1.0,), (1.0,))
    flight = make_flight(oscillator, 0.0, [0.0], 0.0, 0.0, 0.0, 0.0)
    for t in (0.1, 1.0, 10.0, 1e3, 1e5):
        motion = motion_at(flight, t)
        want = (sin(t) - t * cos(t)) / 2
        assert motion.x == pytest.approx(want, abs=4 * EPS * t)
        assert motion.velocity == pytest.approx(t * sin(t) / 2, abs=4 * EPS * t)


def test_light_damping_at_resonance_keeps_its_digits():
    """The particular and the homogeneous part of the textbook form cancel here to 1e-12."""
    oscillator = make_oscillator(1.0, 1.0, 2e-12, (1.0,), (1.0,))
    flight = make_flight(oscillator, 0.0, [0.4], 0.0, 0.0, 0.0, 0.0)
    for t in (0.3, 1.0, 30.0):
        assert max(errors(flight, t)) < 10


@pytest.mark.parametrize('seed', range(40))
def test_seam_between_series_and_closed_form(seed):
    rng = random.Random(seed)
    flight = random_flight(rng, ratios=[rng.uniform(0, 3), rng.choice([1.0, 2.0])])
    limit = flight.oscillator.taylor_limit
    below, above = motion_at(flight, limit), motion_at(flight, math.nextafter(limit, inf))
    length, speed = scales(flight, limit)
    omega = math.sqrt(flight.oscillator.omega_squared)
    tolerance = (200 if flight.oscillator.frequency < 0.1 * omega else 20) * EPS
    assert abs(below.x - above.x) <= tolerance * length
    assert abs(below.travel - above.travel) <= tolerance * length
    assert abs(below.velocity - above.velocity) <= tolerance * speed
    assert abs(below.relative_velocity - above.relative_velocity) <= tolerance * speed
    for side in (below, above):
        assert max(errors(flight, limit)) < tolerance / EPS
        assert side.relative_2 + side.x_2 == pytest.approx(
            flight.relative_acceleration + flight.acceleration,
            rel=1e-12,
            abs=1e-12 * omega * speed,
        )


@pytest.mark.parametrize('seed', range(30))
def test_derivatives_are_those_of_the_motion(seed):
    rng = random.Random(100 + seed)
    flight = random_flight(rng)
    exact = Exact(flight)
    omega = math.sqrt(flight.oscillator.omega_squared)
    fastest = max(omega, *(one.frequency for one in flight.oscillator.harmonics))
    t = 10 ** rng.uniform(-3, 1) / omega
    motion = motion_at(flight, t)
    step = mp.mpf(10) ** -9 / fastest
    values = [mp.diff(lambda s: exact(s)[2], t, order, h=step) for order in range(5)]
    strength = abs(flight.acceleration) + sum(
        abs(one.force) for one in flight.oscillator.harmonics
    )
    strength += omega * abs(flight.velocity) + omega**2 * abs(flight.x) + omega**2
    for order, want in enumerate(values):
        got = (motion.x_2, motion.x_3, motion.x_4, motion.x_5, motion.x_6)[order]
        size = strength * fastest**order
        assert abs(got - float(want)) <= 1e-10 * size


@pytest.mark.parametrize('seed', range(60))
def test_bounds_hold_over_the_horizon(seed):
    """|X'''| to |X^(5)| stay below what is derived at the start; and the bound is not idle."""
    rng = random.Random(1000 + seed)
    flight = random_flight(rng)
    o = flight.oscillator
    t_0 = rng.choice([0.0, 10 ** rng.uniform(-2, 1) / math.sqrt(o.omega_squared)])
    start = motion_at(flight, t_0)
    bounds = (
        derivative_bound(o, start.x_3, start.x_4, o.bound_3),
        derivative_bound(o, start.x_4, start.x_5, o.bound_4),
        derivative_bound(o, start.x_5, start.x_6, o.bound_5),
    )
    for t in np.linspace(t_0, t_0 + o.horizon, 2001):
        motion = motion_at(flight, float(t))
        for value, bound in zip((motion.x_3, motion.x_4, motion.x_5), bounds, strict=True):
            assert abs(value) <= bound * (1 + 1e-9)


def test_bound_of_the_drive_is_attained_within_reason():
    for zeta, ratio in itertools.product((0.0, 0.1, 0.7), (0.3, 1.0, 3.0)):
        o = make_oscillator(1.0, 1.0, 2 * zeta, (1.0,), (ratio,))
        top = 0.0
        for phase in np.linspace(0, 2 * math.pi, 16):
            flight = make_flight(o, 0.0, [float(phase)], 0.0, 0.0, 0.0, 0.0)
            values = [abs(motion_at(flight, float(t)).x_3) for t in np.linspace(0, 2, 101)]
            start = motion_at(flight, 0.0)
            top = max(top, max(values) / derivative_bound(o, start.x_3, start.x_4, o.bound_3))
        assert 0.1 < top <= 1.0


@pytest.mark.parametrize('exponent', range(-150, -20, 8))
def test_tiny_flights_keep_relative_accuracy(exponent):
    """A rebound of any smallness: travel to a relative 1e-15, speed to that of the rebound."""
    rng = random.Random(exponent)
    flight = random_flight(rng, 0.01, [1.3, 0.4], omega=1.0)
    speed = -(10.0**exponent)
    press = 0.3 + abs(flight.relative_acceleration)
    flight = flight._replace(relative_velocity=speed, relative_acceleration=press)
    back = -2 * speed / press
    for share in (1e-3, 0.3, 0.9, 1.1, 3.0):
        motion, t = motion_at(flight, back * share), mp.mpf(back * share)
        assert motion.travel == pytest.approx(float(speed * t + press * t * t / 2), rel=3e-14)
        assert motion.relative_velocity == pytest.approx(
            float(speed + press * t), rel=0, abs=-4e-15 * speed
        )


def test_at_the_origin_nothing_is_rounded():
    rng = random.Random(3)
    for _ in range(50):
        flight = random_flight(rng)
        motion = motion_at(flight, 0.0)
        assert motion.x == flight.x
        assert motion.velocity == flight.velocity
        assert motion.travel == 0.0
        assert motion.relative_velocity == flight.relative_velocity
        assert motion.relative_2 == flight.relative_acceleration
        assert motion.x_2 == flight.acceleration
