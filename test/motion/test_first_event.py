"""The certified first event: against the oracle's dense search, and where it is known exactly."""

import math
from math import inf, nextafter

import numpy as np
import pytest

from impact_damper_ros import EventKind, InitialConditions, Mode, Rig, RigParameters
from impact_damper_ros.motion.certificate import falling_root, falls, keeps_sign, turned_root
from impact_damper_ros.motion.first_event import APPROACH, CLEAR, TURN, Point, way_between
from impact_damper_ros.motion.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    begin_flight,
    motion_at,
    starting_motion,
)
from impact_damper_ros.motion.next_event import ALL_STEPS, next_event
from impact_damper_ros.motion.oscillator import free_bound
from impact_damper_ros.motion.state import Moving
from motion.break_contact import (
    GENERATORS,
    TOLERANCE,
    claims,
    compiled_find_all,
    flights_of,
    launchable,
    plain,
    plain_find_all,
    trial,
)
from oracle.dense_check import check
from oracle.flight_cases import FlightCases

EPS = 2.0**-52


@pytest.mark.parametrize(
    ('name', 'count', 'find'),
    [('random', 1_000, plain_find_all), ('near-grazing', 3_000, compiled_find_all)],
)
def test_none_is_missed_and_none_is_false(name, count, find):
    verdict = trial(name, count, 42, find)
    assert len(verdict.status) > 0.97 * count
    assert verdict.missed == 0
    assert verdict.false == 0
    hits = verdict.residual[np.isfinite(verdict.margin) | (verdict.residual > 0)]
    assert np.median(hits) < 1.0
    assert np.quantile(verdict.residual, 0.99) < 32.0


def test_the_check_would_notice():
    """A claim that is late is a miss, or false like one that is early."""
    cases = launchable(GENERATORS['random'](300, np.random.default_rng(9)))
    kind, tau = claims(cases)
    event = kind != NO_EVENT
    late = check(cases, kind, np.where(event, tau * 1.3, tau), TOLERANCE, 'position')
    early = check(cases, kind, np.where(event, tau * 0.99, tau), TOLERANCE, 'position')
    none = check(cases, np.zeros_like(kind), cases.horizon, TOLERANCE, 'position')
    within = event & (tau < 0.7 * cases.horizon)
    assert late.missed + late.false > 0.95 * event.sum()
    assert early.false > 0.95 * event.sum()
    assert none.missed > 0.95 * within.sum()


def test_how_far_it_is_searched_at_a_time_does_not_matter():
    cases = launchable(GENERATORS['near-grazing'](100, np.random.default_rng(4)))
    rng = np.random.default_rng(5)
    whole, pieces = (
        [Moving(*flight, []) for flight in zip(*plain(*flights_of(cases)), strict=True)]
        for _ in range(2)
    )
    for one, other, horizon in zip(whole, pieces, cases.horizon.tolist(), strict=True):
        for flight in (one, other):
            begin_flight(flight)
        next_event(one, horizon)
        for limit in [*np.sort(rng.uniform(0, horizon, 5)).tolist(), horizon]:
            other.run.steps = int(rng.integers(3))
            while not next_event(other, limit):
                other.run.steps = 1
        one.run.steps = other.run.steps = 0
        assert one.run == other.run


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


def test_what_falls_does():
    """Waves beside the bound of their second derivative, at any phase; as above."""
    rng = np.random.default_rng(2)
    s = np.linspace(0.0, 1.0, 401)
    certain = below = 0
    for frequency, phase, offset in rng.uniform((0.5, 0.0, -1.5), (9.0, math.tau, 1.5), (6000, 3)):
        wave = offset + np.cos(frequency * s + phase)
        falling = (wave < 0.0).all()
        below += falling
        if falls(wave[0], wave[-1], 1.0, frequency**2):
            assert falling
            certain += 1
    assert certain > 0.2 * below


@pytest.mark.parametrize('slopes', [(-1.0, -1.2), (-1e-9, -2.0), (0.0, -1.5), (-3.0, -0.1)])
def test_a_guess_of_a_root_is_that_of_the_cubic(slopes):
    d_a, d_b = slopes
    f_a, f_b = 0.6, -0.4
    guess = falling_root(f_a, d_a, f_b, d_b, 1.0)
    c_2, c_3 = 3.0 * (f_b - f_a) - 2.0 * d_a - d_b, d_a + d_b - 2.0 * (f_b - f_a)
    assert f_a + guess * (d_a + guess * (c_2 + guess * c_3)) == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(('start', 'speed'), [(0.0, 1.0), (0.0, 1e-9), (0.3, 0.5), (0.3, -0.5)])
def test_a_guess_of_a_root_after_a_crest_is_that_of_the_cubic(start, speed):
    bend, third = -3.0, 0.2

    def cubic(t):
        return start + t * (speed + t * (0.5 * bend + t * third))

    guess = turned_root(start, speed, bend, cubic(1.0), 1.0)
    assert cubic(1.0) < 0.0 < guess < 1.0
    assert cubic(guess) == pytest.approx(0.0, abs=0.02 * (start + abs(speed)))


def point_of(moving, motion, time):
    """Return a motion as a point of the grid."""
    offset = motion.x - moving.run.constant / moving.constants.free.omega_squared
    speed = motion.relative_velocity
    return Point(time, offset, motion.x, motion.velocity, motion.travel, speed)


@pytest.mark.parametrize('name', GENERATORS)
def test_what_is_certain_in_a_step_holds(name):
    """Approaches of one stop, single turns and steps clear of both, at many instants within."""
    cases = launchable(GENERATORS[name](500, np.random.default_rng(6)))
    seen, bent = dict.fromkeys(range(4), 0), 0
    for flight in zip(*plain(*flights_of(cases)), strict=True):
        moving = Moving(*flight, [])
        begin_flight(moving)
        run, oscillator = moving.run, moving.constants.free
        start = starting_motion(moving)
        free = free_bound(oscillator, start.x_3, start.x_4)
        if start.relative_velocity == 0.0 and start.relative_2 == 0.0:
            continue
        a = point_of(moving, start, 0.0)
        for k in range(3):
            t_a, t_b = k * oscillator.step, (k + 1) * oscillator.step
            b = point_of(moving, motion_at(moving, t_b), t_b)
            way, side, *_ = way_between(moving, free, a, b)
            within = [motion_at(moving, t_a + s * (t_b - t_a)) for s in np.linspace(0, 1, 41)]
            most = max(abs(m.velocity) + abs(m.relative_velocity) for m in within)
            far = max(abs(m.x) + abs(m.travel) for m in within)
            speeds = np.array([side * m.relative_velocity for m in within])
            beyond = np.array([side * m.travel for m in within])
            clearances = (run.clearance_1, run.clearance_2)[:: int(side)]
            seen[way] += 1
            if way == APPROACH:
                assert (speeds > -1e-13 * most).all()
            elif way == TURN:
                after = np.argmax(speeds > 1e-13 * most)
                assert after > 0
                assert (speeds[:after] < 1e-13 * most).all()
                assert (speeds[after:] > -1e-13 * most).all()
                bent += (np.diff(speeds) < -1e-13 * most).any()
            if way in (CLEAR, TURN):
                assert (clearances[1] + beyond > -1e-13 * far).all()
            if way == CLEAR:
                assert (clearances[0] - beyond > -1e-13 * far).all()
            a = b
    assert min(seen.values()) > 20
    # Single reversals by the sign of Y''', while Y'' changes its own
    assert bent > 2


NOTHING = ('x0', 'v0', 'y0', 'w0', 'gz', 'zeta', 'const_acc')


def first(clearance_1, clearance_2, until=99.0, direction=0, support=None, **values):
    """Return the first event of a flight over X'' + X = 0; on a support, that is all there is."""
    force = values.pop('force', (0.0, 1.0, 0.0))
    numbers = {**dict.fromkeys(NOTHING, 0.0), 'omega0': 1.0, 'half_gap': 9.0, **values}
    arrays = {name: np.array([value]) for name, value in numbers.items()}
    names = ('force_acc', 'force_freq', 'force_phase0')
    arrays |= {name: np.array([[value]]) for name, value in zip(names, force, strict=True)}
    flags = {'one_sided': np.array([False]), 'watch_reversal': np.array([direction != 0])}
    slide = np.array([direction], dtype=np.int8)
    flights = plain(*flights_of(FlightCases(**arrays, **flags, slide=slide)))
    ((rig, lines, run, waves),) = zip(*flights, strict=True)
    flight = Moving(rig, lines * 2, run, waves, [])
    run.clearance_1, run.clearance_2, run.steps = clearance_1, clearance_2, ALL_STEPS
    if support is not None:
        run.mode = int(Mode.STICK)
    begin_flight(flight)
    if support is not None:
        run.support_low, run.support_high = support
    next_event(flight, until)
    return run.kind, run.tau if run.kind and run.tau <= until else until


#: Clearances and motion, and what happens first.
EXACT = {
    'fall': ((9.0, 9.0), {'gz': 2.0}, CONTACT_1, 3.0),
    'rebound': ((0.0, 9.0), {'w0': -1.0, 'gz': 2.0}, CONTACT_1, 1.0),
    'small rebound': ((0.0, 9.0), {'w0': -1e-12, 'gz': 2.0}, CONTACT_1, 1e-12),
    'tiny rebound': ((0.0, 9.0), {'w0': -1e-100, 'gz': 2.0}, CONTACT_1, 1e-100),
    # Y' = 1 - 2 t, and with X = cos t also Y' = 1/2 + sin t
    'reversal': ((9.0, 9.0), {'w0': 1.0, 'gz': -2.0, 'direction': 1}, REVERSAL, 0.5),
    'reversal of a wave': (
        (99.0, 9.0),
        {'x0': 1.0, 'w0': 0.5, 'direction': 1},
        REVERSAL,
        7 * math.pi / 6,
    ),
    # X'' = -sin t
    'support up': ((9.0, 9.0), {'v0': 1.0, 'support': (-inf, 0.5)}, RELEASE_UP, 7 * math.pi / 6),
    'support down': ((9.0, 9.0), {'v0': 1.0, 'support': (-0.5, inf)}, RELEASE_DOWN, math.pi / 6),
    'support holds': ((9.0, 9.0), {'v0': 1.0, 'support': (-1.001, 1.001)}, NO_EVENT, 99.0),
}


@pytest.mark.parametrize('case', EXACT)
def test_where_it_is_known(case):
    clearances, values, kind, tau = EXACT[case]
    assert first(*clearances, **values) == (kind, pytest.approx(tau, rel=8 * EPS))


@pytest.mark.parametrize('speed', [1e-12, 1e-15, 1e-30, 1e-120])
def test_rebound_of_any_smallness_on_a_moving_stop(speed):
    """Y'' and Y''' of the moving M give the time back to relative round-off."""
    shaken = {'x0': 0.3, 'v0': 0.7, 'zeta': 0.01, 'force': (1.0, 1.3, math.asin(0.6))}
    kind, tau = first(0.0, 9.0, w0=-speed, gz=3.0, **shaken)
    press = 3.0 - (0.6 - 2 * 0.01 * 0.7 - 0.3)
    assert (kind, tau) == (CONTACT_1, pytest.approx(2 * speed / press, rel=4 * EPS + speed))


@pytest.mark.parametrize('delta', [0.0, 1e-15, 1e-12, 1e-9, 1e-4])
def test_grazing_of_a_parabola(delta):
    """Up to a height of 1: a stop within it is hit at the first of two near roots."""
    kind, tau = first(0.0, 1.0 - delta, w0=-2.0, gz=2.0)
    if delta > 1e-12:
        assert (kind, tau) == (CONTACT_2, pytest.approx(1 - math.sqrt(delta), rel=1e-10))
    beyond = first(0.0, 1.0 + max(delta, 1e-14), w0=-2.0, gz=2.0)
    assert beyond == (CONTACT_1, pytest.approx(2.0, rel=4 * EPS))


@pytest.mark.parametrize('clearance', [2.0, nextafter(2.0, 3.0), nextafter(2.0, 1.0)])
def test_exact_double_root_does_not_hang(clearance):
    """Y = 1 - cos t: a crest of 2 at t = pi."""
    kind, tau = first(clearance, 9.0, until=3.0 * math.pi, x0=1.0)
    if kind != NO_EVENT:
        assert kind == CONTACT_1
        assert min(abs(tau - math.pi), abs(tau - 3 * math.pi)) < 1e-6


def test_released_motion_is_found_by_the_jerk():
    """X = sin t: Y = t - sin t starts with speed and acceleration zero."""
    kind, tau = first(1.0, 0.0, v0=1.0)
    assert kind == CONTACT_1
    assert tau - math.sin(tau) == pytest.approx(1.0, rel=8 * EPS)
    # With friction the speed 1 - cos t touches zero again at 2 pi.
    kind, tau = first(99.0, 0.0, v0=1.0, direction=1, until=200.0)
    if kind == REVERSAL:
        turns = round(tau / (2 * math.pi))
        assert turns >= 1
        assert tau == pytest.approx(2 * math.pi * turns, abs=1e-5)
    else:
        assert tau - math.sin(tau) == pytest.approx(99.0)


def test_support_that_just_touches_does_not_hang():
    kind, tau = first(9.0, 9.0, v0=1.0, support=(-1.0, 1.0))
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
    assert rig.sample()[1:] == (0.0, 0.0, 0.0, 0.0, 18.5, -18.5, *[0.0] * 4)
