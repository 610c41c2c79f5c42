"""The certified first event: its cubic, and whole flights against the oracle's dense search."""

import itertools
import math
from math import inf

import numpy as np
import pytest

from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters, Simulator
from impact_damper_ros.rig.certificate import safe_step
from impact_damper_ros.rig.contact import first_event
from impact_damper_ros.rig.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    Flight,
    motion_at,
)
from impact_damper_ros.rig.oscillator import acceleration_at, make_oscillator
from oracle.dense_check import check
from rig.break_contact import GENERATORS, TOLERANCE, claims, flight_of, launchable, trial

EPS = 2.0**-52


def cubics(count, seed):
    """Return coefficients of h_0 + h_1 u + h_2 u^2/2 - B u^3/6 over many scales."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-12, 4, (count, 4))
    sign = rng.choice([-1.0, 0.0, 1.0], (count, 4), p=[0.45, 0.1, 0.45])
    h = size * sign
    return np.abs(h[:, 0]), h[:, 1], h[:, 2], np.maximum(size[:, 3], 1e-12)


def near_double_roots(count, seed):
    """Return cubics that touch zero at u = 1 to a relative 1e-16..1e-1, before they fall."""
    rng = np.random.default_rng(seed)
    far = 1.0 + 10.0 ** rng.uniform(-3, 2, count)
    # B/6 (u - 1)^2 (far - u), lifted by a little
    sixth = 10.0 ** rng.uniform(-6, 6, count)
    h_0, h_1 = far, -(2 * far + 1)
    h_2 = 2 * (far + 2)
    h_0 = h_0 * (1 + rng.choice([-1, 0, 1], count) * 10.0 ** rng.uniform(-16, -1, count))
    return sixth * np.abs(h_0), sixth * h_1, sixth * h_2, 6 * sixth


def value(h_0, h_1, h_2, bound, u):
    h_0, h_1, h_2, bound, u = (np.longdouble(v) for v in (h_0, h_1, h_2, bound, u))
    terms = (h_0, h_1 * u, h_2 * u * u / 2, -bound * u**3 / 6)
    return sum(terms), sum(map(abs, terms))


def first_root(h_0, h_1, h_2, bound):
    """Return the first positive root, by the sign between the extrema, in 80 bits."""
    real = np.longdouble
    h_0, h_1, h_2, bound = (real(v) for v in (h_0, h_1, h_2, bound))

    def h(u):
        return h_0 + u * (h_1 + u * (h_2 / 2 - u * bound / 6))

    square = h_2 * h_2 + 2 * bound * h_1
    nodes = [real(0)]
    if square > 0:
        root = np.sqrt(square)
        # Both extrema without cancellation
        q = h_2 + root if h_2 >= 0 else h_2 - root
        nodes += sorted(u for u in (q / bound, -2 * h_1 / q if q else real(0)) if u > 0)
    last = max(nodes[-1], real(1e-30))
    while h(last) > 0:
        last *= 2
    nodes.append(last)
    for low, high in itertools.pairwise(nodes):
        if h(high) <= 0 and high > low:
            if h(low) <= 0:
                return low
            for _ in range(200):
                middle = (low + high) / 2
                if middle in (low, high):
                    break
                low, high = (middle, high) if h(middle) > 0 else (low, middle)
            return high
    return nodes[-1]


class TestSafeStep:
    @pytest.mark.parametrize(('make', 'seed'), [(cubics, 1), (near_double_roots, 2)])
    def test_is_positive_up_to_the_step(self, make, seed):
        """No root lies before the step: values at many points of it, in 80 bits."""
        h = make(20_000, seed)
        horizon = 10.0 ** np.random.default_rng(seed).uniform(-6, 6, 20_000)
        steps = np.array([safe_step(*map(float, row)) for row in zip(*h, horizon, strict=True)])
        assert (steps >= 0).all()
        assert (steps <= horizon).all()
        for share in (*np.linspace(0, 1, 41), *(1 - 0.5 ** np.arange(2, 40))):
            got, size = value(*h, steps * share)
            assert (got >= -4 * EPS * size).all()

    @pytest.mark.parametrize(('make', 'seed'), [(cubics, 3), (near_double_roots, 4)])
    def test_against_bisection(self, make, seed):
        """A lower bound of the first root, and tight wherever the root is simple."""
        h = make(10_000, seed)
        loose = 0
        for row in zip(*map(np.ndarray.tolist, h), strict=True):
            root = first_root(*row)
            step = safe_step(*row, 1e30)
            slope = row[1] + root * (row[2] - root * np.longdouble(row[3]) / 2)
            doubt = 8 * EPS * value(*row, root)[1]  # of the root, in terms of the function
            bend = abs(row[2] - root * np.longdouble(row[3]))
            if slope < 0 and doubt < 1e-6 * -slope * root and slope**2 > 8 * bend * doubt:
                blur = doubt / -slope + root * 1e-15
                assert step <= root + blur
                if step < root * (1 - 3e-12) - blur:
                    # Allowed only where the cubic touches zero to round-off.
                    got, size = value(*row, step)
                    loose += abs(got) > 8 * EPS * size
        assert loose == 0

    def test_against_numpy_roots(self):
        for row in zip(*map(np.ndarray.tolist, cubics(2000, 5)), strict=True):
            h_0, h_1, h_2, bound = row
            if h_0 == 0.0:
                continue
            roots = np.roots([-bound / 6, h_2 / 2, h_1, h_0])
            real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
            if len(real) and np.abs(np.diff(np.sort(real))).min(initial=inf) > 1e-3 * real.min():
                assert safe_step(*row, 1e30) <= real.min() * (1 + 1e-5)

    def test_horizon_and_zero_bound(self):
        assert safe_step(1.0, -1.0, 0.0, 1e-30, 0.5) == 0.5
        assert safe_step(1.0, 1.0, 1.0, 0.0, 7.0) == 7.0
        assert safe_step(1.0, 0.0, 0.0, 0.0, 7.0) == 7.0
        assert safe_step(0.0, 0.0, 1.0, 0.0, 7.0) == 7.0
        assert safe_step(0.0, 0.0, 0.0, 0.0, 7.0) == 7.0
        assert safe_step(1.0, -1.0, 0.0, 0.0, 7.0) == pytest.approx(1.0, rel=2e-12)
        assert safe_step(1.0, -2.0, 1.0, 0.0, 7.0) <= 1.0

    def test_just_left_the_stop(self):
        """Zero clearance and a positive rate of any smallness: the step is the way back."""
        for exponent in range(-300, 1, 20):
            rate = 10.0**exponent
            assert safe_step(0.0, rate, -1.0, 1.0, 1e3) == pytest.approx(
                min(2 * rate, -1.5 + math.sqrt(2.25 + 6 * rate)) if rate > 1e-3 else 2 * rate,
                rel=1e-2,
            )
        assert safe_step(0.0, 0.0, -1.0, 1.0, 1.0) == 0.0
        assert safe_step(0.0, -1.0, 5.0, 1.0, 1.0) == 0.0


class TestFirstEvent:
    @pytest.mark.parametrize('name', GENERATORS)
    def test_none_is_missed_and_none_is_false(self, name):
        verdict = trial(name, 10_000, 42)
        assert len(verdict.status) > 9900
        assert verdict.missed == 0
        assert verdict.false == 0
        hits = verdict.residual[np.isfinite(verdict.margin) | (verdict.residual > 0)]
        assert np.median(hits) < 1.0
        assert np.quantile(verdict.residual, 0.99) < 32.0

    def test_the_check_would_notice(self):
        """A claim that is late is a miss, or false like one that is early."""
        cases = launchable(GENERATORS['random'](500, np.random.default_rng(9)))
        kind, tau = claims(cases)
        event = kind != NO_EVENT
        late = check(cases, kind, np.where(event, tau * 1.3, tau), TOLERANCE, 'position')
        early = check(cases, kind, np.where(event, tau * 0.99, tau), TOLERANCE, 'position')
        none = check(cases, np.zeros_like(kind), cases.horizon, TOLERANCE, 'position')
        within = event & (tau < 0.7 * cases.horizon)
        assert late.missed + late.false > 0.95 * event.sum()
        assert early.false > 0.95 * event.sum()
        assert none.missed > 0.95 * within.sum()

    def test_nodes_do_not_depend_on_the_limits(self):
        cases = launchable(GENERATORS['near-grazing'](300, np.random.default_rng(4)))
        rng = np.random.default_rng(5)
        for i in range(len(cases)):
            flight, horizon = flight_of(cases, i), float(cases.horizon[i])
            whole = first_event(flight, 0.0, horizon)
            node, found = 0.0, NO_EVENT
            for limit in [*np.sort(rng.uniform(0, horizon, 5)).tolist(), horizon]:
                found, node = first_event(flight, node, limit)
                if found != NO_EVENT:
                    break
            assert (found, node) == whole or (found == NO_EVENT == whole[0] and node >= whole[1])


def still_oscillator(force=0.0, frequency=1.0, decay=0.0):
    return make_oscillator(1.0, 1.0, 2 * decay, (force,), (frequency,))


def flight(oscillator, x, velocity, speed, damper_acceleration, clearance_1, clearance_2, **more):
    sines = (more.pop('sine', 0.0),)
    acceleration = acceleration_at(oscillator, 0.0, sines, x, velocity)
    fields = {
        'oscillator': oscillator,
        'constant': 0.0,
        'sines': sines,
        'cosines': (more.pop('cosine', 1.0),),
        'x': x,
        'velocity': velocity,
        'acceleration': acceleration,
        'relative_velocity': speed,
        'relative_acceleration': damper_acceleration - acceleration,
        'clearance_1': clearance_1,
        'clearance_2': clearance_2,
        'joint': False,
        'direction': 0,
        'arrival': inf,
        'slope': 0.0,
        'support_low': -inf,
        'support_high': inf,
    }
    return Flight(**{**fields, **more})


class TestSpecialCases:
    def test_parabola(self):
        """M still: a fall from rest and a flight up and back."""
        o = still_oscillator()
        assert first_event(flight(o, 0.0, 0.0, 0.0, 2.0, 9.0, 9.0), 0.0, 99.0) == (
            CONTACT_1,
            pytest.approx(3.0, rel=4 * EPS),
        )
        for speed in (1.0, 1e-6, 1e-12, 1e-100):
            kind, tau = first_event(flight(o, 0.0, 0.0, -speed, 2.0, 0.0, 9.0), 0.0, 99.0)
            assert (kind, tau) == (CONTACT_1, pytest.approx(speed, rel=4 * EPS))

    @pytest.mark.parametrize('speed', [1e-12, 1e-15, 1e-30, 1e-120])
    def test_rebound_of_any_smallness_on_a_moving_stop(self, speed):
        """Y'' and Y''' of the moving M give the time back to relative round-off."""
        o = still_oscillator(1.0, 1.3, 0.01)
        launch = flight(o, 0.3, 0.7, -speed, 3.0, 0.0, 9.0, sine=0.6, cosine=0.8)
        kind, tau = first_event(launch, 0.0, 99.0)
        assert kind == CONTACT_1
        assert tau == pytest.approx(2 * speed / launch.relative_acceleration, rel=4 * EPS + speed)

    @pytest.mark.parametrize('delta', [0.0, 1e-15, 1e-12, 1e-9, 1e-4])
    def test_grazing_of_a_parabola(self, delta):
        """Up to a height of 1: a stop within it is hit at the first of two near roots."""
        o = still_oscillator()
        launch = flight(o, 0.0, 0.0, -2.0, 2.0, 0.0, 1.0 - delta)
        kind, tau = first_event(launch, 0.0, 99.0)
        if delta > 1e-14:
            assert (kind, tau) == (CONTACT_2, pytest.approx(1 - math.sqrt(delta), rel=1e-10))
        missed = flight(o, 0.0, 0.0, -2.0, 2.0, 0.0, 1.0 + max(delta, 1e-14))
        assert first_event(missed, 0.0, 99.0) == (CONTACT_1, pytest.approx(2.0, rel=4 * EPS))

    def test_exact_double_root_does_not_hang(self):
        """X = cos t, m starts where the crest of M just touches the stop."""
        o = still_oscillator()
        for clearance in (2.0, math.nextafter(2.0, 3.0), math.nextafter(2.0, 1.0)):
            # Y = 1 - cos t: a crest of 2 at t = pi
            launch = flight(o, 1.0, 0.0, 0.0, 0.0, clearance, 9.0)
            kind, tau = first_event(launch, 0.0, 3.0 * math.pi)
            assert kind in (NO_EVENT, CONTACT_1)
            if kind == CONTACT_1:
                assert min(abs(tau - math.pi), abs(tau - 3 * math.pi)) < 1e-7

    def test_reversal_of_friction(self):
        """Y' = sin t - c: down to zero at asin c, before any stop."""
        o = still_oscillator()
        launch = flight(o, 0.0, 0.0, 1.0, -2.0, 9.0, 9.0, direction=1)
        assert first_event(launch, 0.0, 99.0) == (REVERSAL, pytest.approx(0.5, rel=4 * EPS))
        # X = cos t: Y' = 0.5 + sin t first vanishes at 7 pi / 6.
        launch = flight(o, 1.0, 0.0, 0.5, 0.0, 99.0, 9.0, direction=1)
        assert first_event(launch, 0.0, 99.0) == (
            REVERSAL,
            pytest.approx(7 * math.pi / 6, rel=8 * EPS),
        )

    def test_released_motion_is_found_by_the_jerk(self):
        """X = sin t: Y = t - sin t starts with speed and acceleration zero."""
        o = still_oscillator()
        launch = flight(o, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0)
        assert launch.relative_acceleration == 0.0
        kind, tau = first_event(launch, 0.0, 99.0)
        # Y = t - sin t = 1
        assert kind == CONTACT_1
        assert tau - math.sin(tau) == pytest.approx(1.0, rel=8 * EPS)
        # With friction the speed 1 - cos t touches zero again at 2 pi.
        launch = flight(o, 0.0, 1.0, 0.0, 0.0, 99.0, 0.0, direction=1)
        kind, tau = first_event(launch, 0.0, 99.0)
        if kind == REVERSAL:
            turns = round(tau / (2 * math.pi))
            assert turns >= 1
            assert tau == pytest.approx(2 * math.pi * turns, abs=1e-6)
        else:
            assert tau - math.sin(tau) == pytest.approx(99.0)

    def test_support_gives_way_at_its_root(self):
        """X'' = -sin t: a need of 0.5 is passed at 7 pi/6, of -0.5 at pi/6."""
        o = still_oscillator()
        held = {'joint': True, 'support_low': -inf, 'support_high': 0.5}
        launch = flight(o, 0.0, 1.0, 0.0, 0.0, 9.0, 9.0, **held)
        assert first_event(launch, 0.0, 99.0) == (RELEASE_UP, pytest.approx(7 * math.pi / 6))
        held = {'joint': True, 'support_low': -0.5, 'support_high': inf}
        launch = flight(o, 0.0, 1.0, 0.0, 0.0, 9.0, 9.0, **held)
        assert first_event(launch, 0.0, 99.0) == (RELEASE_DOWN, pytest.approx(math.pi / 6))
        held = {'joint': True, 'support_low': -1.001, 'support_high': 1.001}
        launch = flight(o, 0.0, 1.0, 0.0, 0.0, 9.0, 9.0, **held)
        assert first_event(launch, 0.0, 99.0)[0] == NO_EVENT

    def test_support_that_just_touches_does_not_hang(self):
        o = still_oscillator()
        held = {'joint': True, 'support_low': -1.0, 'support_high': 1.0}
        kind, tau = first_event(flight(o, 0.0, 1.0, 0.0, 0.0, 9.0, 9.0, **held), 0.0, 99.0)
        assert tau > 99.0 or abs(math.cos(tau)) < 1e-7
        assert kind in (NO_EVENT, RELEASE_UP, RELEASE_DOWN)

    def test_nodes_are_few(self):
        """A flight that stays clear takes steps of the order of the period."""
        o = still_oscillator(1.0, 1.02, 0.005)
        launch = flight(o, 3.0, 0.0, 0.1, 0.0, 1e6, 1e6)
        node, nodes = 0.0, 0
        while node < 200.0:
            _, node = first_event(launch, node, node)
            nodes += 1
        assert nodes <= 110
        assert motion_at(launch, node).travel < 1e6


BALANCED = [
    # No force: nothing moves, or M stays still, or it dies out.
    ({'force_amplitudes': [0.0], 'gravity': 0.0}, {}),
    ({'force_amplitudes': [0.0], 'angle': 0.3}, {}),
    ({'force_amplitudes': [0.0]}, {'initial_damper_velocity': 1.0}),
    ({'force_amplitudes': [0.0], 'damping': 1.0}, {'initial_primary_position': 30.0}),
    ({'force_frequencies': [0.0]}, {}),
    # Force and its rate are zero at first, in the gap and on either stop.
    *(
        (
            {
                'force_amplitudes': pair,
                'force_frequencies': [1.0, 2.0],
                'force_phases': [phase] * 2,
            },
            {'initial_damper_offset': offset},
        )
        for pair, phase in (
            ([2.0, -1.0], 0.0),
            ([-2.0, 1.0], 0.0),
            ([1.0, -1.0], math.pi / 2),
            ([-1.0, 1.0], math.pi / 2),
        )
        for offset in (0.0, 18.5, -18.5)
    ),
    # m needs exactly the grip that it has.
    *(
        (
            {
                'force_amplitudes': [sign * 1.042, -sign * 0.521],
                'force_frequencies': [1.0, 2.0],
                'force_phases': [math.pi / 2] * 2,
                'damping': 0.0,
                'friction': 0.5,
                'gravity': 1.0,
            },
            {},
        )
        for sign in (1, -1)
    ),
    (
        {'force_amplitudes': [0.0], 'friction': math.tan(0.3), 'angle': 0.3, 'damping': 0.2},
        {'initial_primary_position': 1.0},
    ),
]


@pytest.mark.parametrize(('rig', 'initial'), BALANCED)
def test_exactly_balanced_starts_do_not_loop(rig, initial):
    motion = Simulator(RigParameters(**rig), InitialConditions(**initial))
    events = motion.advance(2000.0 if 'damping' in rig else 20.0)
    assert len(events) < 3000
    times = [e.time for e in events]
    assert times == sorted(times)
    sample = motion.sample()
    assert all(map(math.isfinite, sample))


def test_fall_without_force():
    """G sin(angle) alone: M stays still until the first impact."""
    rig = Simulator(RigParameters(force_amplitudes=[0.0], angle=0.3))
    event = rig.advance(5.0)[0]
    assert event.kind == EventKind.IMPACT
    assert event.time == pytest.approx(math.sqrt(37.0 / (9.81 * math.sin(0.3))), rel=4 * EPS)
    assert event.x == 0.0


def test_all_rest_stays_at_rest():
    rig = Simulator(RigParameters(force_amplitudes=[0.0], gravity=0.0))
    assert rig.advance(1e5) == []
    assert rig.mode == Mode.FREE
    assert rig.sample()[1:] == (0.0, 0.0, 0.0, 0.0, 18.5, -18.5, 0.0, 0.0)
