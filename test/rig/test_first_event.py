"""The certified first event and the passages of X: dense search, closed forms, all rounds-off."""

import math
import random
from collections import Counter
from itertools import pairwise
from math import inf, nextafter

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters
from impact_damper_ros.rig.first_event import falling_root, keeps_sign
from impact_damper_ros.rig.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    begin_flight,
)
from impact_damper_ros.rig.run import ALL_STEPS, find_event
from rig.flights import Case, claimed_first, fault, grazing_case, random_case
from rig.random_rigs import random_rig

EPS = 2.0**-52


@pytest.mark.parametrize(('made', 'count'), [(random_case, 150), (grazing_case, 110)])
def test_none_is_missed_and_none_is_false(made, count):
    """To some round-offs of positions and velocities, against a search with 110 digits."""
    rng = random.Random(42)
    kinds = Counter()
    for _ in range(count):
        case = made(rng)
        claim = claimed_first(case)
        assert fault(case, claim) == '', case
        kinds[claim[0]] += 1
    assert min(kinds[kind] for kind in (NO_EVENT, CONTACT_1, CONTACT_2, REVERSAL)) > 10


def test_the_check_would_notice():
    """A claim that is late or early is false, and one of nothing a miss."""
    rng = random.Random(9)
    for _ in range(12):
        case = random_case(rng)
        kind, time = claimed_first(case)
        if kind != NO_EVENT and time < 0.7 * case.horizon:
            assert fault(case, (kind, 1.001 * time))
            assert fault(case, (kind, 0.999 * time))
            assert fault(case, (NO_EVENT, case.horizon)).startswith('missed')


def test_how_far_it_is_searched_at_a_time_does_not_matter():
    rng = random.Random(4)
    for _ in range(60):
        case = grazing_case(rng)
        one, other = case.flight(), case.flight()
        find_event(*one, case.horizon)
        for limit in [*sorted(rng.uniform(0.0, case.horizon) for _ in range(5)), case.horizon]:
            other[2].steps = rng.randrange(3)
            while not find_event(*other, limit):
                other[2].steps = 1
        one[2].steps = other[2].steps = 0
        assert one[2] == other[2]


def test_what_keeps_its_sign_does():
    """Quartics: their fourth derivative is the bound. It may say no, but never a wrong yes."""
    rng = np.random.default_rng(1)
    s = np.linspace(0.0, 1.0, 2001)
    basis = np.array([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3])
    certain = unsure = 0
    for _ in range(4000):
        # Bernstein coefficients of a cubic, of any size beside what the fourth derivative takes
        f_a, c_1, c_2, f_b = 10.0 ** rng.uniform(-4, 1, 4) * rng.choice([-1, 1, 1, 1, 1], 4)
        f_a = rng.choice([0.0, f_a])
        cubic = np.array([f_a, c_1, c_2, f_b]) @ basis
        quartic = cubic - (s * (1 - s)) ** 2
        ends = f_a, 3 * (c_1 - f_a), f_b, 3 * (f_b - c_2)
        if keeps_sign(*ends, 1.0, 24.0):
            certain += 1
            assert (quartic[1:] > 0.0).all()
        else:
            # It does say yes where there is room.
            unsure += (quartic[1:] > 0.0).all()
            lift = 12.0 + max(0.0, -f_a, -c_1, -c_2, -f_b)
            ends = f_a + lift, 3 * (c_1 - f_a), f_b + lift, 3 * (f_b - c_2)
            assert keeps_sign(*ends, 1.0, 24.0)
    assert certain > 300
    assert unsure < certain


@pytest.mark.parametrize('slopes', [(-1.0, -1.2), (-1e-9, -2.0), (0.0, -1.5), (-3.0, -0.1)])
def test_a_guess_of_a_root_is_that_of_the_cubic(slopes):
    d_a, d_b = slopes
    f_a, f_b = 0.6, -0.4
    guess = falling_root(f_a, d_a, f_b, d_b, 1.0)
    c_2, c_3 = 3.0 * (f_b - f_a) - 2.0 * d_a - d_b, d_a + d_b - 2.0 * (f_b - f_a)
    assert f_a + guess * (d_a + guess * (c_2 + guess * c_3)) == pytest.approx(0.0, abs=0.02)


def first(clearance_1, clearance_2, until=99.0, direction=0, support=None, **values):
    """Return the first event of a flight over X'' + X = 0; on a support, that is all there is."""
    force = values.pop('force', (0.0, 1.0, 0.0))
    given = {
        'x': 0.0,
        'velocity': 0.0,
        'relative_velocity': 0.0,
        'pull': 0.0,
        'zeta': 0.0,
        **values,
    }
    case = Case(
        1.0,
        y=0.0,
        half_gap=9.0,
        push=0.0,
        harmonics=(force,),
        one_sided=False,
        slide=direction,
        horizon=until,
        **given,
    )
    flight = case.flight()
    run = flight[2]
    run.clearance_1, run.clearance_2, run.steps = clearance_1, clearance_2, ALL_STEPS
    if support is not None:
        run.mode = int(Mode.STICK)
    run.released = support is None and run.relative_velocity == run.relative_acceleration == 0.0
    begin_flight(*flight)
    if support is not None:
        run.support_low, run.support_high = support
    find_event(*flight, until)
    return run.kind, run.tau if run.kind and run.tau <= until else until


#: Clearances and motion, and what happens first.
EXACT = {
    'fall': ((9.0, 9.0), {'pull': 2.0}, CONTACT_1, 3.0),
    'rebound': ((0.0, 9.0), {'relative_velocity': -1.0, 'pull': 2.0}, CONTACT_1, 1.0),
    'small rebound': ((0.0, 9.0), {'relative_velocity': -1e-12, 'pull': 2.0}, CONTACT_1, 1e-12),
    'tiny rebound': ((0.0, 9.0), {'relative_velocity': -1e-100, 'pull': 2.0}, CONTACT_1, 1e-100),
    # Y' = 1 - 2 t, and with X = cos t also Y' = 1/2 + sin t
    'reversal': (
        (9.0, 9.0),
        {'relative_velocity': 1.0, 'pull': -2.0, 'direction': 1},
        REVERSAL,
        0.5,
    ),
    'reversal of a wave': (
        (99.0, 9.0),
        {'x': 1.0, 'relative_velocity': 0.5, 'direction': 1},
        REVERSAL,
        7 * math.pi / 6,
    ),
    # X'' = -sin t
    'support up': (
        (9.0, 9.0),
        {'velocity': 1.0, 'support': (-inf, 0.5)},
        RELEASE_UP,
        7 * math.pi / 6,
    ),
    'support down': (
        (9.0, 9.0),
        {'velocity': 1.0, 'support': (-0.5, inf)},
        RELEASE_DOWN,
        math.pi / 6,
    ),
    'support holds': ((9.0, 9.0), {'velocity': 1.0, 'support': (-1.001, 1.001)}, NO_EVENT, 99.0),
}


@pytest.mark.parametrize('case', EXACT)
def test_where_it_is_known(case):
    clearances, values, kind, tau = EXACT[case]
    assert first(*clearances, **values) == (kind, pytest.approx(tau, rel=8 * EPS))


@pytest.mark.parametrize('speed', [1e-12, 1e-15, 1e-30, 1e-120])
def test_rebound_of_any_smallness_on_a_moving_stop(speed):
    """Y'' and Y''' of the moving M give the time back to relative round-off."""
    shaken = {'x': 0.3, 'velocity': 0.7, 'zeta': 0.01, 'force': (1.0, 1.3, math.asin(0.6))}
    kind, tau = first(0.0, 9.0, relative_velocity=-speed, pull=3.0, **shaken)
    press = 3.0 - (0.6 - 2 * 0.01 * 0.7 - 0.3)
    assert (kind, tau) == (CONTACT_1, pytest.approx(2 * speed / press, rel=4 * EPS + speed))


@pytest.mark.parametrize('delta', [0.0, 1e-15, 1e-12, 1e-9, 1e-4])
def test_grazing_of_a_parabola(delta):
    """Up to a height of 1: a stop within it is hit at the first of two near roots."""
    kind, tau = first(0.0, 1.0 - delta, relative_velocity=-2.0, pull=2.0)
    if delta > 1e-12:
        assert (kind, tau) == (CONTACT_2, pytest.approx(1 - math.sqrt(delta), rel=1e-10))
    beyond = first(0.0, 1.0 + max(delta, 1e-14), relative_velocity=-2.0, pull=2.0)
    assert beyond == (CONTACT_1, pytest.approx(2.0, rel=4 * EPS))


@pytest.mark.parametrize('clearance', [2.0, nextafter(2.0, 3.0), nextafter(2.0, 1.0)])
def test_exact_double_root_does_not_hang(clearance):
    """Y = 1 - cos t: a crest of 2 at t = pi."""
    kind, tau = first(clearance, 9.0, until=3.0 * math.pi, x=1.0)
    if kind != NO_EVENT:
        assert kind == CONTACT_1
        assert min(abs(tau - math.pi), abs(tau - 3 * math.pi)) < 1e-6


def test_released_motion_is_found_by_the_jerk():
    """X = sin t: Y = t - sin t starts with speed and acceleration zero."""
    kind, tau = first(1.0, 0.0, velocity=1.0)
    assert kind == CONTACT_1
    assert tau - math.sin(tau) == pytest.approx(1.0, rel=8 * EPS)
    # With friction the speed 1 - cos t touches zero again at 2 pi.
    kind, tau = first(99.0, 0.0, velocity=1.0, direction=1, until=200.0)
    if kind == REVERSAL:
        turns = round(tau / (2 * math.pi))
        assert turns >= 1
        assert tau == pytest.approx(2 * math.pi * turns, abs=1e-5)
    else:
        assert tau - math.sin(tau) == pytest.approx(99.0)


def test_support_that_just_touches_does_not_hang():
    kind, tau = first(9.0, 9.0, velocity=1.0, support=(-1.0, 1.0))
    assert kind in (NO_EVENT, RELEASE_UP, RELEASE_DOWN)
    assert kind == NO_EVENT or abs(math.cos(tau)) < 1e-6


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
    motion = Rig(RigParameters(**rig), InitialConditions(**initial))
    events = motion.advance(2000.0 if 'damping' in rig else 20.0)
    assert len(events) < 3000
    times = [e.time for e in events]
    assert times == sorted(times)
    assert all(map(math.isfinite, motion.sample()))


def test_fall_without_force():
    """G sin(angle) alone: M stays still until the first impact."""
    event = Rig(RigParameters(force_amplitudes=[0.0], angle=0.3)).advance(5.0)[0]
    assert event.kind == EventKind.IMPACT
    assert event.time == pytest.approx(math.sqrt(37.0 / (9.81 * math.sin(0.3))), rel=4 * EPS)
    assert event.x == 0.0


def test_all_rest_stays_at_rest():
    rig = Rig(RigParameters(force_amplitudes=[0.0], gravity=0.0))
    assert rig.advance(1e5) == []
    assert rig.mode == Mode.FREE
    assert rig.sample()[1:] == (0.0, 0.0, 0.0, 0.0, 18.5, -18.5, 0.0, 0.0)


def idle(_seen, _memory):
    """Leave both stops alone: the passages are reported all the same."""
    return math.nan, math.nan


def watched(parameters, initial=None, until=30.0):
    """Return the passages of a rig, and its other events."""
    events = Rig(parameters, initial, law=idle).advance(until, 3000)
    passages = [e for e in events if e.kind is EventKind.CROSSING]
    return passages, [e for e in events if e.kind is not EventKind.CROSSING]


@pytest.mark.parametrize('seed', range(25))
def test_they_are_where_x_changes_its_sign_and_nowhere_else(seed):
    parameters, initial = random_rig(seed)
    passages, others = watched(parameters, initial)
    plain = Rig(parameters, initial)
    end = max([30.0] if len(passages) + len(others) < 3000 else [e.time for e in others[-1:]])
    # Watching leaves the motion alone
    assert [e for e in plain.advance(end) if e.time <= end] == [e for e in others if e.time <= end]
    scale = max(1e-9, *(abs(e.x) for e in others), 0.0) if others else 1.0
    times = [e.time for e in passages if e.time <= end]
    assert times == sorted(times)
    assert all(abs(e.x) <= 1e-12 * (scale + abs(e.primary_velocity_after)) for e in passages)
    knots = [0.0, *times, end]
    grid = np.concatenate([np.linspace(a, b, 41)[1:-1] for a, b in pairwise(knots) if b > a])
    samples = Rig(parameters, initial).run(end, grid, record=False).samples['x']
    interval = np.searchsorted(times, grid)
    for k in np.unique(interval):
        x = samples[interval == k]
        clear = x[np.abs(x) > 1e-9 * scale]
        assert (clear > 0.0).all() or (clear < 0.0).all()
        assert (
            not len(clear)
            or k == 0
            or math.copysign(1.0, clear[0])
            == math.copysign(1.0, passages[k - 1].primary_velocity_after)
        )


@pytest.mark.parametrize('depth', [1e-3, 1e-6, 1e-9])
def test_two_passages_close_together(depth):
    """X dips a little below zero and comes back."""
    turn = InitialConditions(initial_primary_position=2.0)
    rig = RigParameters(
        gravity=0.0,
        gap=1e3,
        damping=0.0,
        force_amplitudes=1.0 + depth,
        force_frequencies=0.0,
        force_phases=-math.pi / 2.0,
    )
    # About -(1 + depth) with amplitude 3 + depth: no dip there; mirror it to have one at zero
    rig = rig.replace(force_phases=math.pi / 2.0)
    passages, _ = watched(rig, turn, 6.2)
    # X = c + (2 - c) cos t with c = 1 + depth: lowest at pi, 2 c - 2 = 2 depth above zero
    assert passages == []
    rig = rig.replace(force_amplitudes=1.0 - depth)
    passages, _ = watched(rig, turn, 6.2)
    assert len(passages) == 2
    centre, swing = 1.0 - depth, 1.0 + depth
    expected = math.acos(-centre / swing)
    assert passages[0].time == pytest.approx(expected, abs=1e-12 / math.sqrt(depth))
    assert passages[1].time == pytest.approx(math.tau - expected, abs=1e-12 / math.sqrt(depth))


@pytest.mark.parametrize(
    ('x', 'velocity', 'first'),
    [(1.0, 0.0, math.pi / 2), (-1.0, 0.0, math.pi / 2), (0.0, 1.0, math.pi)],
)
def test_the_start_at_zero_is_no_passage(x, velocity, first):
    free = RigParameters(gravity=0.0, gap=1e3, damping=0.0, force_amplitudes=0.0)
    start = InitialConditions(initial_primary_position=x, initial_primary_velocity=velocity)
    passages, _ = watched(free, start, 10.0)
    assert [e.time for e in passages] == pytest.approx(
        [first + k * math.pi for k in range(len(passages))], abs=1e-13
    )
    assert len(passages) == 3
