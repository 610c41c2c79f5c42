"""The closed form of a flight against the oracle, and the bounds of its derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from impact_damper_ros.motion.flight import begin_flight, motion_at, starting_motion
from impact_damper_ros.motion.oscillator import (
    POINTS,
    free_bound,
    oscillators,
    set_oscillator,
)
from impact_damper_ros.motion.state import Moving
from impact_damper_ros.motion.waves import next_point, sine_and_cosine
from motion.break_contact import flights_of, launchable, plain
from oracle.flight_cases import EPS, REAL, exact_motion, precise, round_off
from oracle.flight_generators import random_flights
from oracle.precise_motion import mp

RNG = np.random.default_rng
NAMES = 'x', 'velocity', 'travel', 'relative_velocity'


def begun(cases):
    """Return the oracle's flights, as arguments of kernels."""
    flights = [Moving(*flight, []) for flight in zip(*plain(*flights_of(cases)), strict=True)]
    for flight in flights:
        begin_flight(flight)
    return flights


def many_harmonics(cases, count):
    """Return flights with the harmonics of some others besides."""
    names = ('force_acc', 'force_freq', 'force_phase0')
    units = (cases.omega0**2, cases.omega0, np.ones(len(cases)))
    columns = {}
    for name, unit in zip(names, units, strict=True):
        values = getattr(cases, name)
        own = values / unit[:, None]
        others = [np.roll(own, k, axis=0) * unit[:, None] for k in range(1, count)]
        columns[name] = np.hstack([values, *others])
    return launchable(replace(cases, **columns, slide=np.zeros(0)))


def errors(cases, t, unit):
    """Return the errors of the motion at one instant of each flight, in round-offs."""
    index = np.arange(len(cases))
    travel, speed, _ = precise(cases, index, t)
    length_unit, speed_unit = round_off(cases, index, t, unit)
    wide = t.astype(REAL)
    x = cases.x0 + (cases.w0 + cases.v0.astype(REAL)) * wide + cases.gz * wide**2 / 2 - travel
    velocity = cases.v0.astype(REAL) + cases.w0 + cases.gz * wide - speed
    found = [motion_at(flight, tau) for flight, tau in zip(begun(cases), t.tolist(), strict=True)]
    exact = dict(zip(NAMES, (x, velocity, travel, speed), strict=True))
    units = dict(zip(NAMES, (length_unit, speed_unit) * 2, strict=True))
    return {
        name: np.abs([getattr(motion, name) for motion in found] - exact[name]) / units[name]
        for name in NAMES
    }


@pytest.mark.parametrize(('phases', 'harmonics'), [((-2, 0), 1), ((0, 2), 1), ((-1, 1), 7)])
def test_closed_form(phases, harmonics):
    """To round-off of positions and velocities, and the square of how fast the drive is."""
    rng = RNG(1)
    cases = many_harmonics(random_flights(2000, rng), harmonics)
    t = 10 ** rng.uniform(*phases, len(cases)) / cases.fastest
    ratio = cases.fastest / cases.omega0
    for error in errors(cases, t, 'position').values():
        assert (error / ratio**2).max() < 10.0


def test_short_flights_keep_relative_accuracy():
    """A rebound of any smallness: displacement and speed to a relative round-off."""
    rng = RNG(2)
    cases = random_flights(2000, rng)
    t = 10 ** rng.uniform(-150, -2, len(cases)) / cases.fastest
    found = errors(cases, t, 'local')
    assert found['travel'].max() < 3.0
    assert found['relative_velocity'].max() < 3.0


@pytest.mark.parametrize('decay', [0.0, 1e-12])
def test_resonance(decay):
    """Where the particular and the homogeneous part of the textbook form cancel."""
    cases = random_flights(1, RNG(3))
    one = {'force_acc': [[1.0]], 'force_freq': [[1.0]], 'force_phase0': [[0.0]], 'omega0': [1.0]}
    zero = {name: [0.0] for name in ('x0', 'v0', 'y0', 'w0', 'gz', 'const_acc')}
    given = {**one, **zero, 'zeta': [decay], 'half_gap': [1e9]}
    cases = replace(cases, **{name: np.array(value) for name, value in given.items()})
    (flight,) = begun(cases)
    for t in (0.1, 1.0, 10.0, 1e3, 1e5):
        motion = motion_at(flight, t)
        allowed = 4 * EPS * t + decay * t * t
        assert motion.x == pytest.approx((math.sin(t) - t * math.cos(t)) / 2, abs=allowed)
        assert motion.velocity == pytest.approx(t * math.sin(t) / 2, abs=allowed)


def test_at_the_origin_nothing_is_rounded():
    for flight in begun(random_flights(50, RNG(4))):
        run = flight.run
        assert tuple(motion_at(flight, 0.0))[:6] == (
            run.x,
            run.velocity,
            0.0,
            run.relative_velocity,
            run.relative_acceleration,
            run.acceleration,
        )


def test_derivatives_are_those_of_the_motion():
    """And the grid has the points of the closed form."""
    rng = RNG(5)
    cases = random_flights(60, rng)
    for i, flight in enumerate(begun(cases)):
        exact, free, run = exact_motion(cases, i), flight.constants.free, flight.run
        base = float(rng.choice([0.0, 10 ** rng.uniform(-2, 1)])) / free.fastest
        motion = motion_at(flight, base)
        offset, velocity = motion.x - run.constant / free.omega_squared, motion.velocity
        for k in range(POINTS + 1):
            derivatives = [float(v) for v in exact.derivatives(mp.mpf(base + k * free.step))]
            strength = max(
                abs(value) / free.fastest**order
                for order, value in enumerate([*derivatives[:2], float(cases.strength[i])])
            )
            if k == 0:
                found = [motion.x, motion.velocity, *motion[5:]]
            else:
                steps = free.x_x, free.x_v, free.v_x, free.v_v
                offset, velocity = next_point(
                    flight.lines, 0, flight.waves, offset, velocity, *steps
                )
                found = [offset + run.constant / free.omega_squared, velocity]
            for order, (got, want) in enumerate(zip(found, derivatives, strict=False)):
                unit = max(strength, float(cases.strength[i]) / free.omega_squared)
                assert abs(got - want) <= 1e-11 * unit * free.fastest**order


def test_bounds_hold_over_a_search():
    """X''' to X^(5) and their rates stay below what is derived at its start; and not by much."""
    rng = RNG(6)
    tight = []
    for flight in begun(random_flights(60, rng)):
        free = flight[0].free
        first = float(rng.choice([0.0, 10 ** rng.uniform(-2, 1)])) / free.fastest
        end = first + POINTS * free.step
        motions = [motion_at(flight, float(t)) for t in np.linspace(first, end, 400)]
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


def test_the_start_of_a_search_is_the_origin():
    for flight in begun(random_flights(20, RNG(7))):
        assert starting_motion(flight) == pytest.approx(motion_at(flight, 0.0), rel=1e-14)


@pytest.mark.parametrize('largest', [7.0, 1e3, 1e6 + 7.0])
def test_sine_and_cosine_of_several_harmonics(largest):
    """As far as phases go, and near multiples of a quarter turn, where one of them vanishes."""
    rng = np.random.default_rng(3)
    quarters = np.round(rng.uniform(-largest, largest, 500) / (0.5 * math.pi)) * 0.5 * math.pi
    for phase in [*rng.uniform(-largest, largest, 2000).tolist(), *quarters.tolist()]:
        exact = mp.sin(mp.mpf(phase)), mp.cos(mp.mpf(phase))
        for value, there in zip(sine_and_cosine(phase), exact, strict=True):
            assert abs(value - there) <= 0.9 * math.ulp(max(abs(value), 1e-3))


def test_constants_of_a_solver_are_those_of_a_run():
    """But for the digits beyond a float's, and those to which the step of a run is rounded."""
    rng = np.random.default_rng(8)
    for damping in (0.0, 0.02, 0.9):
        mass, stiffness = rng.uniform(0.5, 5.0, (2, 1))
        critical = 2.0 * np.sqrt(stiffness * mass)
        rates = np.sqrt(stiffness / mass) * np.array([[0.3, 1.01, 4.0, 50.0]])
        forces = np.array([[1.0, -2.0, 0.4, 0.0]])
        given = mass, stiffness, damping * critical, forces, rates, rng.uniform(0.0, 6.0, (1, 4))
        run = [rows.view(np.recarray)[0] for rows in oscillators(*given)]
        solver = [rows.copy() for rows in run]
        for rows in solver:
            for name in rows.dtype.names:
                if not name.startswith(('force', 'frequency', 'phase', 'base_')):
                    rows[name] = np.nan
        set_oscillator(*solver, mass[0], stiffness[0], damping * critical[0])
        for mine, other in zip(solver, run, strict=True):
            for name in mine.dtype.names:
                assert mine[name] == pytest.approx(other[name], rel=1e-3, abs=1e-6), name
