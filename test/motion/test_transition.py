"""Impacts, and the end of a chatter: closed forms, and the oracle, which resolves every bounce."""

import math
import random
from itertools import product

import numpy as np
import pytest

from impact_damper_ros import EventKind, InitialConditions, Mode, Rig, RigParameters
from impact_damper_ros.motion.impact import (
    CHATTER_HEIGHT,
    CHATTER_INSTANT_TOLERANCE,
    CHATTER_SPAN,
    CHATTER_TOLERANCE,
    chatter_duration,
    may_complete,
)
from oracle.hybrid_oracle import mp, run as run_precisely

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


@pytest.mark.parametrize(
    ('restitution', 'share'),
    [*product((0.0, 0.5, 0.95), (0.0, 1e-6, 0.3, 0.9, 0.999)), (1.0, 0.5)],
)
def test_chatter_duration(restitution, share):
    """With and without friction, of a speed and a pull of any size."""
    rng = np.random.default_rng(int(1e6 * share) + int(100 * restitution))
    for speed, press in (10.0 ** rng.uniform(-9, 3, (3, 2))).tolist():
        grip = share * press
        want = summed(speed, press, grip, restitution)
        got = chatter_duration(speed, press, grip, restitution)
        down_is_known_to = EPS / (1 - share)
        assert got == pytest.approx(float(want), rel=8 * EPS + 4 * down_is_known_to)


@pytest.mark.parametrize(
    ('press', 'grip', 'restitution'),
    [(-1.0, 0.0, 0.5), (0.0, 0.0, 0.5), (1.0, 1.0, 0.5), (1.0, 2.0, 0.5), (1.0, 0.0, 1.0)],
)
def test_no_chatter(press, grip, restitution):
    """M is pulled off, or held by friction, or bounces for ever."""
    assert chatter_duration(1e-9, press, grip, restitution) == math.inf


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
        ({'spread': CHATTER_TOLERANCE}, 'spread'),
    ],
    ids=['change of the press', 'instant of rest', 'span', 'height', 'change of restitution'],
)
def test_completed_only_within_the_tolerances(limit, changed):
    """Each of the five conditions decides where the others hold."""
    given = {'duration': 1e-3, 'speed': 1e-9, 'press': 2.0, 'grip': 0.5}
    given |= {'jerk': 0.0, 'omega': 1e-6, 'gap': 2.0, 'spread': 0.0, **limit}
    assert may_complete(**{**given, changed: given[changed] * 0.999})
    assert not may_complete(**{**given, changed: given[changed] * 1.001})


UNFORCED = {'gravity': 9.81, 'angle': math.pi / 2, 'force_amplitudes': (0.0,)}
BOUNCING_BALL = {**UNFORCED, 'damping': 0.02, 'gap': 2.0, 'restitution_1': 0.6, 'one_sided': True}
LIGHT = {
    'a millionth of M': {**BOUNCING_BALL, 'damper_mass': 1e-6},
    'a ten thousandth of M': {**BOUNCING_BALL, 'damper_mass': 1e-4},
    'on the bench rig': {
        **UNFORCED,
        'primary_mass': 2.0,
        'stiffness': 1974.0,
        'damping': 1.26,
        'damper_mass': 1e-6,
        'gap': 0.024,
        'restitution_1': 0.7,
    },
}


def pressed_rig(seed):
    """Return a rig whose weight brings m to rest on stop 1."""
    rng = random.Random(f'end of a chatter {seed}')
    return {
        'primary_mass': rng.uniform(0.5, 3.0),
        'stiffness': 10 ** rng.uniform(-1.0, 3.0),
        'damping': rng.choice([0.0, 0.02, 0.3]),
        'damper_mass': 10 ** rng.uniform(-6.0, 0.5),
        'gap': 10 ** rng.uniform(-1.5, 1.0),
        'restitution_1': rng.uniform(0.2, 0.6),
        'angle': rng.choice([math.pi / 2, rng.uniform(0.5, 1.5)]),
        'friction': rng.choice([0.0, 0.2]),
        'gravity': rng.choice([1.0, 9.81]),
        'force_amplitudes': (rng.choice([0.0, rng.uniform(0.0, 0.1)]),),
        'force_frequencies': (rng.uniform(0.3, 3.0),),
    }


@pytest.mark.parametrize(
    'params',
    [*LIGHT.values(), *(pressed_rig(seed) for seed in range(3))],
    ids=[*LIGHT, *(f'seed {seed}' for seed in range(3))],
)
def test_rest_is_where_the_bounces_end(params):
    """Its instant to 1e-12/omega; X and X' to 1e-12 of the amplitude."""
    p = RigParameters(**params)
    events = Rig(p).advance(20.0)
    rest = next(event for event in events if event.kind is EventKind.REST)
    omega = math.sqrt(p.stiffness / p.primary_mass)
    precise = run_precisely(params, rest.time + 1e-3 / omega)
    true = next(event for event in precise.events if event.kind == 'rest')
    assert abs(true.time - mp.mpf(rest.time)) < 1e-12 / omega
    fastest = max(abs(event.primary_velocity_after) for event in precise.events)
    largest = max(fastest / omega, *(abs(event.x) for event in precise.events))
    # Both at one instant, that of the oracle's rest or just after.
    when = max(mp.mpf(rest.time), true.time)
    x, velocity, _, damper_velocity = precise.state(when)
    assert damper_velocity == velocity
    assert abs(x - mp.mpf(rest.x)) < 1e-12 * largest
    assert abs(velocity - mp.mpf(rest.primary_velocity_after)) < 1e-12 * fastest


@pytest.mark.parametrize('params', LIGHT.values(), ids=LIGHT)
def test_no_bounce_higher_than_a_billionth_of_the_gap_is_left_out(params):
    p = RigParameters(**params)
    impacts = [e for e in Rig(p).advance(20.0) if e.kind is EventKind.IMPACT]
    last = impacts[-1]
    speed = abs(last.damper_velocity_after - last.primary_velocity_after)
    assert speed**2 / (2.0 * p.gravity) < 1e-9 * p.gap


def chatter(params):
    """Return a rig in the middle of a completed chatter, its last impact, and its rest."""
    events = Rig(RigParameters(**params)).advance(20.0)
    rest = next(event for event in events if event.kind is EventKind.REST)
    last = max((e for e in events if e.time < rest.time), key=lambda event: event.time)
    rig = Rig(RigParameters(**params))
    rig.advance(0.5 * (last.time + rest.time))
    assert rig.mode is Mode.CHATTER_1
    return rig, last, rest


@pytest.mark.parametrize('change', [{'damping': 0.021}, {'force_phases': [1.0]}, {'gap': 1.9}])
def test_a_change_within_a_chatter_does_not_hide_its_rest(change):
    """Nor bring it forward: it was at rest at once, and not reported."""
    rig, last, rest = chatter({**BOUNCING_BALL, 'one_sided': False})
    assert rest.time - last.time > 1e-6
    assert rig.change(rig.parameters.replace(**change)) == []
    (event,) = rig.advance(rest.time + 1.0)
    assert (event.kind, event.stop) == (EventKind.REST, 1)
    assert event.time == pytest.approx(rest.time, rel=1e-15)


def test_m_whose_stop_goes_away_within_a_chatter_leaves_it():
    rig, _, _ = chatter({**BOUNCING_BALL, 'one_sided': False})
    assert rig.change(rig.parameters.replace(gap=2.5)) == []
    assert rig.mode is Mode.FREE
    assert rig.advance(20.0)[0].kind is EventKind.IMPACT


def impacts_before_rest(rig):
    """Return how often m hits stop 1 from where it is, a little above it."""
    kinds = [event.kind for event in rig.advance(5.0)]
    return kinds[: kinds.index(EventKind.REST)].count(EventKind.IMPACT)


def test_the_cut_does_not_depend_on_the_gap_of_a_rig_with_one_stop():
    """It means nothing there; the time that is left has to be short."""
    counts = set()
    for gap in (1e-3, 1.0, 1e3):
        p = RigParameters(**{**BOUNCING_BALL, 'gap': gap})
        start = InitialConditions(initial_damper_offset=0.5 * gap - 1e-6)
        counts.add(impacts_before_rest(Rig(p, start)))
    assert len(counts) == 1
    assert counts.pop() > 3


def test_the_cut_is_that_of_the_stops_where_they_are():
    values = {**BOUNCING_BALL, 'one_sided': False}
    narrow = Rig(RigParameters(**{**values, 'gap': 1e-3}))
    moved = Rig(RigParameters(**values))
    moved.move_stops(5e-4, -5e-4)
    assert impacts_before_rest(moved) == impacts_before_rest(narrow)


@pytest.mark.parametrize('params', LIGHT.values(), ids=LIGHT)
def test_within_a_chatter_m_is_shown_on_its_stop(params):
    """X' is wrong by its share of the speed with which m left the last impact listed, at most."""
    rig, last, _ = chatter(params)
    sample = rig.sample()
    precise = run_precisely(params, rig.time)
    x, velocity, _, _ = precise.state(mp.mpf(rig.time))
    speed = abs(last.damper_velocity_after - last.primary_velocity_after)
    share = rig.parameters.mass_ratio / (1.0 + rig.parameters.mass_ratio)
    error = abs(velocity - mp.mpf(sample.primary_velocity))
    assert error < 1.001 * share * speed
    assert abs(x - mp.mpf(sample.x)) < share * speed**2 / rig.parameters.gravity
    assert sample.primary_velocity == sample.damper_velocity


#: m on stop 1, which bears it until M has been pushed far enough down.
BORNE = RigParameters(angle=0.1, force_amplitudes=5.0, gap=10.0)


@pytest.mark.parametrize('R', [0.5, 0.999, 1.0 - 1e-10, 1.0 - 1e-11, 1.0])
def test_the_support_of_an_almost_elastic_stop_is_watched(R):
    """Bounces too short to be resolved would go on for seconds."""
    rest = Rig(BORNE, InitialConditions(initial_damper_offset=5.0)).advance(1.0)
    (release,) = [e for e in rest if e.kind is EventKind.RELEASE]
    for speed in (1e-10, 1.5e-11):
        rig = Rig(
            BORNE.replace(restitution_1=R, restitution_2=R),
            InitialConditions(initial_damper_offset=5.0, initial_damper_velocity=speed),
        )
        kinds = [(e.kind, e.time) for e in rig.advance(1.0)]
        assert [kind for kind, _ in kinds] == [EventKind.IMPACT, EventKind.REST, EventKind.RELEASE]
        assert kinds[2][1] == pytest.approx(release.time, rel=1e-9)


def test_a_chatter_that_ends_in_motion_is_a_release():
    """Where its stop ceases to bear m within the last bounces."""
    rest = Rig(BORNE, InitialConditions(initial_damper_offset=5.0))
    (release,) = [e for e in rest.run(1.0).events if e['kind'] == EventKind.RELEASE]
    before = release['time'] - 3e-5
    twin = Rig(BORNE, InitialConditions(initial_damper_offset=5.0))
    sample = twin.run(before, [before]).samples[0]
    R = 1.0 - 2e-5
    rig = Rig(
        BORNE.replace(restitution_1=R, restitution_2=R, force_phases=before),
        InitialConditions(
            initial_primary_position=sample['x'],
            initial_primary_velocity=sample['primary_velocity'],
            initial_damper_offset=5.0,
            initial_damper_velocity=sample['primary_velocity'] + 1e-13,
        ),
    )
    events = rig.run(1e-3).events
    assert events['kind'].tolist() == [EventKind.IMPACT, EventKind.RELEASE]
    assert events['mode'].tolist() == [Mode.CHATTER_1, Mode.FREE]
    assert events['stop'].tolist() == [1, 1]
    assert 2e-5 < events['time'][1] < 1e-4
