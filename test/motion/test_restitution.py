"""Restitution that falls with the speed: the law, the last bounces, and the oracle."""

import itertools
import math
import random
from types import SimpleNamespace

import numpy as np
import pytest

from impact_damper_ros import (
    EventKind,
    InitialConditions,
    Outcome,
    Rig,
    RigParameters,
    run_ensemble,
)
from impact_damper_ros.motion.impact import bounce, chatter_duration
from oracle.hybrid_oracle import DEFAULTS, INITIAL_DEFAULTS, mp, run as run_precisely

from .random_rigs import random_rig
from .test_transition import BOUNCING_BALL

EPS = 2.0**-52


def law(speed, exponent):
    """Return what `bounce` needs of a rig."""
    return SimpleNamespace(
        restitution_slowness=1.0 / speed if speed else 0.0, restitution_exponent=exponent
    )


def precise_law(coefficient, speed, exponent):
    """Return R(v) in 110 digits."""
    return lambda v: coefficient * (1 + v / mp.mpf(speed)) ** -mp.mpf(exponent)


def test_law_and_its_slope():
    rng = np.random.default_rng(5)
    for _ in range(200):
        speed, v = (10.0 ** rng.uniform(-6, 6, 2)).tolist()
        exponent, coefficient = rng.uniform(0, 0.999), rng.uniform(0, 1)
        R, step = precise_law(coefficient, speed, exponent), v * mp.mpf(10) ** -20
        restitution, slope = bounce(law(speed, exponent), coefficient, v)
        assert restitution == pytest.approx(float(R(mp.mpf(v))), rel=4 * EPS)
        low, high = v - step, v + step
        derivative = (high * R(high) - low * R(low)) / (high - low)
        assert slope == pytest.approx(float(derivative), rel=8 * EPS)


def test_restitution_never_rises_and_the_speed_after_an_impact_does():
    speeds = np.concatenate([[0.0], np.logspace(-9, 9, 400)])
    for exponent, v_c in itertools.product((0.0, 0.25, 0.999), (1e-6, 1.0, 1e9)):
        restitution, slope = bounce(law(v_c, exponent), 1.0, speeds)
        assert restitution[0] == 1.0
        assert (np.diff(restitution) <= 0.0).all()
        assert (np.diff(restitution * speeds) > 0.0).all()
        assert (slope > 0.0).all()


def test_a_constant_restitution_keeps_its_bits():
    speeds = np.array([0.0, 0.3, 1e7])
    for coefficient in (0.0, 0.1, 0.75, 1.0):
        for exponent in (0.0, 0.25):
            assert bounce(law(0.0, exponent), coefficient, speeds) == (coefficient, coefficient)
    events = [
        Rig(RigParameters(gap=7.0, restitution_exponent=p)).run(60.0).events for p in (0.0, 0.9)
    ]
    assert events[0].tobytes() == events[1].tobytes()


@pytest.mark.parametrize('stop', [1, 2])
def test_an_impact_obeys_the_law(stop):
    """In momentum, energy and impulse as well; a speed of M does not enter."""
    half = 1.0 if stop == 1 else -1.0
    for velocity, relative, mu in itertools.product(
        (-3.0, 0.0, 2.0), (1e-3, 1.0, 40.0), (0.1, 2.0)
    ):
        p = RigParameters(
            damper_mass=mu,
            gap=2.0,
            restitution_1=0.9,
            restitution_2=0.8,
            restitution_speed=0.5,
            restitution_exponent=0.4,
        )
        (e, *_) = Rig(
            p,
            InitialConditions(
                initial_primary_velocity=velocity,
                initial_damper_offset=half,
                initial_damper_velocity=velocity + half * relative,
            ),
        ).advance(0.0)
        R = (0.9 if stop == 1 else 0.8) * (1.0 + relative / 0.5) ** -0.4
        before = e.damper_velocity_before - e.primary_velocity_before
        after = e.damper_velocity_after - e.primary_velocity_after
        assert after == pytest.approx(-R * before, rel=1e-12)
        momentum = e.primary_velocity_before + mu * e.damper_velocity_before
        assert e.primary_velocity_after + mu * e.damper_velocity_after == pytest.approx(
            momentum, abs=1e-14 * (abs(velocity) + relative)
        )
        assert e.impulse == pytest.approx(mu / (1.0 + mu) * (1.0 + R) * relative, rel=1e-12)


@pytest.mark.parametrize(
    ('coefficient', 'share'), [(0.3, 0.0), (0.8, 0.0), (0.8, 0.6), (1.0, 0.6)]
)
def test_the_change_over_the_last_bounces_is_within_its_bound(coefficient, share):
    """The closed form has R at speed 0; the relative error is below (R(0) - R(v)) left/first."""
    up, down, v_c, exponent = mp.mpf(1 + share), mp.mpf(1 - share), 1.0, 0.25
    R = precise_law(coefficient, v_c, exponent)
    for speed in (1e-9, 1e-6, 1e-3):
        v, flights = mp.mpf(speed), []
        while not flights or flights[-1] > flights[0] * mp.mpf(10) ** -30:
            flights.append(v * (1 / up + 1 / mp.sqrt(up * down)))
            arriving = v * mp.sqrt(down / up)
            v = R(arriving) * arriving
        left = chatter_duration(speed, 1.0, share, coefficient)
        least, _ = bounce(law(v_c, exponent), coefficient, speed)
        spread = (coefficient - least) * left / float(flights[0])
        error = float((left - sum(flights)) / sum(flights))
        assert -1e-14 < error <= spread + 1e-14
        assert error > 0.1 * spread - 1e-14


@pytest.mark.parametrize(
    ('R', 'v_c', 'exponent'), [(0.6, 3.0, 0.25), (0.6, 1e-4, 0.25), (0.4, 0.1, 0.9)]
)
def test_rest_is_where_the_bounces_end(R, v_c, exponent):
    params = {
        **BOUNCING_BALL,
        'damper_mass': 1e-4,
        'restitution_1': R,
        'restitution_speed': v_c,
        'restitution_exponent': exponent,
    }
    rest = next(e for e in Rig(RigParameters(**params)).advance(20.0) if e.kind is EventKind.REST)
    precise = run_precisely(params, rest.time + 1e-3)
    true = next(event for event in precise.events if event.kind == 'rest')
    assert abs(true.time - mp.mpf(rest.time)) < 1e-12
    fastest = max(abs(event.primary_velocity_after) for event in precise.events)
    assert abs(true.x - mp.mpf(rest.x)) < 1e-12 * fastest


def test_bounces_that_are_elastic_at_no_speed_have_no_end():
    """They die like 1/n: v_c/v grows by p at each; the event budget ends the run."""
    v_c, p = 2.0, 0.25
    rig = Rig(
        RigParameters(
            **{**BOUNCING_BALL, 'damper_mass': 1e-9, 'restitution_1': 1.0, 'damping': 0.0},
            restitution_speed=v_c,
            restitution_exponent=p,
        )
    )
    result = rig.run(1e6, most_events=2000)
    assert result.outcome is Outcome.TOO_MANY_EVENTS
    events = result.events
    assert set(events['kind'].tolist()) == {EventKind.IMPACT}
    speeds = events['damper_velocity_before'] - events['primary_velocity_before']
    slownesses = v_c / speeds
    assert (slownesses[-1] - slownesses[-1001]) / 1000 == pytest.approx(p, rel=1e-2)


def falling_rig(seed):
    """Return a random rig whose restitution falls with the speed, and its initial conditions."""
    rng = random.Random(f'restitution {seed}')
    p, initial = random_rig(f'restitution {seed}')
    upright = math.cos(p.angle) < 1e-5
    return p.replace(
        friction=0.0 if upright else p.friction,
        restitution_1=min(p.restitution_1, 0.9),
        restitution_2=min(p.restitution_2, 0.9),
        restitution_speed=10.0 ** rng.uniform(-2, 2),
        restitution_exponent=rng.choice([0.25, rng.uniform(0.0, 0.999)]),
    ), initial


def compared_with_oracle(seed, most=12):
    """
    Compare the events of a random rig with those of the oracle; return how many.

    The same rig with all inputs changed by 1e-25 shows how much round-off has grown at an event.
    """
    p, initial = falling_rig(seed)
    held = {**p.as_dict(), **initial.as_dict()}
    share, runs = mp.mpf(10) ** -25, []
    for factor in (mp.mpf(1), 1 + share):
        params, start = (
            {n: held[n] * factor if isinstance(held[n], float) else held[n] for n in names}
            for names in (DEFAULTS, INITIAL_DEFAULTS)
        )
        # m that starts on a stop still does
        if 2.0 * abs(initial.initial_damper_offset) == p.gap:
            start['initial_damper_offset'] = (
                mp.sign(initial.initial_damper_offset) * params['gap'] / 2
            )
        runs.append(run_precisely(params, 30.0, start, max_events=most).events)
    changed = dict(zip(map(id, runs[0]), runs[1], strict=False))
    events = Rig(p, initial).run(30.0, most_events=1000).events
    left = list(runs[0])
    for count, got in enumerate(events):
        kind = EventKind(got['kind']).name.lower()
        # The last bounces, of which the oracle may have many
        while left and kind == 'rest' != left[0].kind and got['time'] - 1e-5 < left[0].time:
            assert left[0].stop in (0, got['stop'])
            del left[0]
        if not left:
            return count
        want = left.pop(0)
        growth = abs(changed[id(want)].time - want.time) / share if id(want) in changed else mp.inf
        if growth * EPS > 1e-6:
            return count
        assert (kind, got['stop']) == (want.kind, want.stop)
        blur = 64 * EPS * float(growth + want.time) + 1e-12 * (kind == 'rest')
        assert abs(want.time - mp.mpf(float(got['time']))) <= blur
    assert not left
    return len(events)


def test_compiled_rigs_and_ensembles_have_the_same_bits():
    pytest.importorskip('numba')
    speeds = [0.0, 1e-6, 0.3, 5.0, 1e9]
    common = RigParameters(gap=7.0, friction=0.1, angle=0.2, restitution_exponent=0.4)
    results = [
        [Rig(common.replace(restitution_speed=v), compiled=c).run(90.0, [80.0]) for v in speeds]
        for c in (False, True)
    ]
    both = run_ensemble(common, {'restitution_speed': speeds}, 90.0, [80.0])
    assert len({result.events.tobytes() for result in results[0]}) == len(speeds)
    for plain, fast, row in zip(*results, both.samples, strict=True):
        assert plain.events.tobytes() == fast.events.tobytes()
        assert plain.samples.tobytes() == fast.samples.tobytes() == row.tobytes()


def test_events_of_random_rigs_are_those_of_the_oracle():
    assert sum(compared_with_oracle(seed) for seed in range(8)) > 60
