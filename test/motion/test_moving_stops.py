"""Stops that move relative to M: where they meet m, and that they never do work."""

import math
import random
from collections import Counter
from math import inf

import pytest
from hypothesis import given, strategies as st
from rigs import BENCH, STILL

from impact_damper_ros import EventKind, InitialConditions, Mode, Rig, RigParameters
from motion.energy import Account
from motion.random_rigs import random_command, random_rig, rig_of, through_json
from oracle.hybrid_oracle import DEFAULTS
from oracle.moving_stops import first_meeting

EPS = 2.0**-52
ARRIVED, TOUCHED, IMPACT = EventKind.STOP_ARRIVED, EventKind.STOP_TOUCHED, EventKind.IMPACT
REST, RELEASE, STARTED = EventKind.REST, EventKind.RELEASE, EventKind.STOP_STARTED


def stop_velocities(rig):
    """Return the velocities of stop 1 and stop 2 relative to M."""
    sample = rig.sample()
    return tuple(v - sample.primary_velocity for v in sample[7:9])


def targets(rig):
    """Return the positions Y to which the stops move, or at which they are."""
    run = rig.state().run
    return run.target_1, run.target_2


def thrown(offset, velocity, parameters=STILL):
    return Rig(
        parameters,
        InitialConditions(initial_damper_offset=offset, initial_damper_velocity=velocity),
    )


def to(rig, side, place, speed=inf):
    """Move the stop on one side, mirrored."""
    return rig.move_stops(*((place, None) if side > 0 else (None, -place)), speed)


def near(rig, side):
    return rig.stops[0] if side > 0 else -rig.stops[1]


def told(events):
    return [(e.kind, e.stop, pytest.approx(e.time, rel=4 * EPS)) for e in events]


PULLED = {'gravity': 2.0, 'angle': math.pi / 2}
PULLED_AWAY = {'gravity': 2.0, 'angle': -math.pi / 2}
#: Rig, place and velocity of m, then start, target and speed of a stop; what happens until when,
#: and where the stop is then, and how fast.
ONE_STOP = {
    'arrives': ({}, (0.0, 0.0), (1.0, 3.0, 0.3), [(ARRIVED, 1.0 + 2.0 / 0.3)], 9.0, 3.0, 0.0),
    # It stands when m hits it, and follows m back.
    'm comes': (
        {},
        (0.0, 1.0),
        (0.0, -3.0, 1.5),
        [(TOUCHED, 2.0), (IMPACT, 2.0), (ARRIVED, 2.0 + 5.0 / 0.75)],
        9.0,
        -3.0,
        0.0,
    ),
    'on its way after m': (
        {},
        (0.0, 1.0),
        (0.0, -3.0, 1.5),
        [(TOUCHED, 2.0), (IMPACT, 2.0)],
        2.5,
        1.625,
        -0.75,
    ),
    'overtakes m': (
        {},
        (4.0, -1.0),
        (0.0, -4.0, 1.25),
        [(TOUCHED, 4.0), (ARRIVED, 8.0)],
        8.5,
        -4.0,
        0.0,
    ),
    'as fast as m': (
        {},
        (5.0, -1.0),
        (0.0, -2.0, 1.0),
        [(TOUCHED, 0.0), (ARRIVED, 7.0)],
        7.5,
        -2.0,
        0.0,
    ),
    'm stands': ({}, (1.0, 0.0), (0.0, 0.0, 2.0), [(TOUCHED, 2.0), (REST, 2.0)], 9.0, 1.0, 0.0),
    'm sticks': (
        {'friction': 5.0, 'gravity': 1.0},
        (0.0, 0.0),
        (3.0, -1.0, 0.7),
        [(TOUCHED, 3.0 + 5.0 / 0.7)],
        20.0,
        0.0,
        0.0,
    ),
    # Pulled away from the stop with 2: 5 - 3 t = 4 - t^2, and from t = 1.5 on m is faster than 3.
    'm outruns it': (
        PULLED_AWAY,
        (4.0, 0.0),
        (0.0, -3.0, 3.0),
        [(TOUCHED, 1.5 - math.sqrt(1.25)), (STARTED, 1.5)],
        2.5,
        -1.25,
        -3.0,
    ),
    # Pulled to the stop with 2: 5 - t = 4 - 3 t + t^2; m rebounds faster than the stop is.
    'm rebounds faster': (
        PULLED,
        (4.0, -3.0),
        (0.0, -4.0, 1.0),
        [(kind, 1.0 + math.sqrt(2.0)) for kind in (TOUCHED, IMPACT, STARTED)],
        2.5,
        2.5,
        -1.0,
    ),
    # Thrown off by its weight once the support is gone, m falls w t behind: g t^2/2 = w t.
    'm chases it': (
        PULLED,
        (5.0, 0.0),
        (1.0, 20.0, 3.0),
        [(RELEASE, 1.0), (TOUCHED, 4.0), (IMPACT, 4.0), (STARTED, 4.0), (ARRIVED, 6.0)],
        6.2,
        20.0,
        0.0,
    ),
    'friction holds m': (
        {'gravity': 1.0, 'friction': 0.5, 'angle': 0.3},
        (5.0, 0.0),
        (0.0, 6.0, 1.0),
        [(ARRIVED, 1.0)],
        9.0,
        6.0,
        0.0,
    ),
    'm rests, slow': (PULLED, (5.0, 0.0), (0.0, 1.0, 1e-3), [(TOUCHED, 0.0)], 3.0, 5.0, 0.0),
    'm rests, fast': (PULLED, (5.0, 0.0), (0.0, 1.0, 1e3), [(TOUCHED, 0.0)], 3.0, 5.0, 0.0),
    'm rests, at once': (PULLED, (5.0, 0.0), (0.0, 1.0, inf), [(TOUCHED, 0.0)], 3.0, 5.0, 0.0),
    'at once': ({}, (0.0, 1.0), (1.0, 3.0, inf), [(ARRIVED, 1.0)], 2.0, 3.0, 0.0),
    'm comes, at once': (
        {},
        (0.0, 1.0),
        (1.0, -2.0, inf),
        [(TOUCHED, 1.0), (IMPACT, 1.0), (ARRIVED, 5.0)],
        5.5,
        -2.0,
        0.0,
    ),
    'past m, at once': (
        {},
        (0.0, -1.0),
        (1.0, -2.0, inf),
        [(TOUCHED, 1.0)],
        1.5,
        -1.5,
        -1.0,
    ),
}


@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize('case', ONE_STOP)
def test_one_stop(case, side):
    """
    `side` mirrors: 1 for stop 1, -1 for stop 2. Each rebound is that of a standing stop.

    The other stop is on its way from m all the time.
    """
    changes, thrown_with, (start, target, speed), expected, until, place, rate = ONE_STOP[case]
    parameters = STILL.replace(**changes)
    rig = thrown(
        *(side * v for v in thrown_with), parameters.replace(angle=side * parameters.angle)
    )
    to(rig, -side, 20.0, 0.01)
    rig.advance(start)
    events = to(rig, side, target, speed)
    own = 0 if side > 0 else 1
    if not events:
        outwards = 1 if target > 5.0 else -1
        assert stop_velocities(rig)[own] == side * outwards * speed
    events += rig.advance(until)
    stop = 1 if side > 0 else 2
    want = [(kind, stop, pytest.approx(time, rel=1e-8)) for kind, time in expected]
    assert [(e.kind, e.stop, e.time) for e in events] == want
    assert near(rig, side) == pytest.approx(place, rel=1e-8, abs=1e-12)
    assert stop_velocities(rig)[own] == pytest.approx(side * rate, rel=1e-8, abs=1e-12)
    assert stop_velocities(rig)[1 - own] == pytest.approx(-0.01 * side)
    assert near(rig, -side) == pytest.approx(5.0 + 0.01 * until)
    assert targets(rig)[own] == side * target
    if expected[-1][0] == REST:
        assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)
    for e in events:
        before = e.damper_velocity_before - e.primary_velocity_before
        after = e.damper_velocity_after - e.primary_velocity_after
        assert after == pytest.approx((-0.75 if e.kind == IMPACT else 1.0) * before, rel=1e-8)


@pytest.mark.parametrize('side', [1, -1])
class TestCommands:
    def test_samples_show_its_velocity(self, side):
        """That of M while it stands, its own one besides while it moves, Z' while it follows m."""
        heavy = STILL.replace(stiffness=1.0, damping=0.0)
        rig = Rig(
            heavy,
            InitialConditions(
                initial_primary_velocity=0.5,
                initial_damper_offset=side * 4.0,
                initial_damper_velocity=0.5 - side * 1.0,
            ),
        )

        def velocities():
            sample = rig.sample()
            pair = sample.stop_1_velocity, sample.stop_2_velocity
            # M does not change its velocity in this time.
            assert sample.primary_velocity == pytest.approx(0.5, rel=1e-8)
            return pair if side > 0 else pair[::-1]

        assert velocities() == (0.5, 0.5)
        rig.change(heavy.replace(gap=2.0))
        assert near(rig, side) == 4.0
        for time in (0.0, 1.0, 2.999):
            rig.advance(time)
            near_by, other = velocities()
            assert near_by == rig.sample().damper_velocity
            assert near_by == pytest.approx(0.5 - side * 1.0, rel=1e-8)
            assert other == rig.sample().primary_velocity
        (event,) = rig.advance(3.001)
        assert event.kind is ARRIVED
        assert velocities() == (rig.sample().primary_velocity,) * 2
        to(rig, side, 6.0, 0.125)
        rig.advance(3.5)
        near_by, other = velocities()
        assert near_by == rig.sample().primary_velocity + side * 0.125
        assert other == rig.sample().primary_velocity

    def test_a_change_of_the_gap_ends_it(self, side):
        rig = thrown(0.0, 0.0)
        to(rig, side, 1.0, 1.0)
        rig.advance(1.0)
        # Anything else leaves it as it is.
        rig.change(STILL.replace(restitution_1=0.5))
        assert near(rig, side) == 4.0
        rig.advance(2.0)
        assert near(rig, side) == 3.0
        rig.change(STILL.replace(gap=12.0))
        assert rig.stops == targets(rig) == (6.0, -6.0)
        assert stop_velocities(rig) == (0.0, 0.0)
        to(rig, side, 1.0, 1.0)
        rig.reset()
        assert rig.stops == targets(rig) == (6.0, -6.0)
        assert rig.advance(9.0) == []


def test_both_stops_close_on_m():
    """They come up to m one after the other; what is left of its motion ends in M."""
    rig = thrown(0.0, 0.25)
    rig.move_stops(-4.0, 4.0, 1.0)
    events = rig.advance(9.0)
    kinds = [(e.kind, e.stop) for e in events]
    assert kinds == [(TOUCHED, 1), (IMPACT, 1), (TOUCHED, 2), (IMPACT, 2), (REST, 2)]
    assert events[0].time == pytest.approx(4.0)
    # m returns with 0.1875, followed by stop 1, and stop 2 comes at 1 from -1.
    assert events[2].time == pytest.approx(4.0 + 2.0 / 1.1875, rel=1e-8)
    place = 1.0 - 0.1875 * 2.0 / 1.1875
    assert rig.stops == pytest.approx((place, place), rel=1e-8)
    assert rig.stops[0] == rig.stops[1]


def test_m_between_two_stops_with_no_room_cannot_move():
    """Driven hard, the clamped mass goes with M as one."""
    rig = Rig(RigParameters(gap=4.0, gravity=0.0, force_frequencies=[1.3]))
    rig.advance(2.0)
    speed = rig.sample().damper_velocity - rig.sample().primary_velocity
    assert speed != 0.0
    account = Account(rig)
    events = rig.move_stops(-3.0, 3.0)
    account.impacts(events)
    assert Counter(e.kind for e in events) == {TOUCHED: 2, IMPACT: 1, EventKind.REST: 1}
    assert rig.stops[0] == rig.stops[1]
    # The plastic impact has taken it all.
    momentum = 1.0 * events[2].primary_velocity_before + 0.042 * events[2].damper_velocity_before
    assert events[2].primary_velocity_after == pytest.approx(momentum / 1.042, rel=1e-14)
    assert events[2].impulse == pytest.approx(0.042 / 1.042 * abs(speed), rel=1e-12)
    joint = RigParameters(primary_mass=1.042, gravity=0.0, force_frequencies=[1.3], gap=1e6)
    same = Rig(
        joint.replace(force_phases=[1.3 * 2.0]),
        InitialConditions(
            initial_primary_position=rig.sample().x,
            initial_primary_velocity=rig.sample().primary_velocity,
        ),
    )
    assert account.advance(40.0) == []
    same.advance(38.0)
    assert rig.sample().x == pytest.approx(same.sample().x, rel=1e-11)
    assert account.imbalance < 1e-12
    # Let go on one side, it leaves as soon as it is not pressed to the other.
    rig.move_stops(3.0, None, 1.0)
    assert EventKind.IMPACT in {e.kind for e in rig.advance(60.0)}


def check_place(rig):
    """Check that m is between the stops."""
    sample, (stop_1, stop_2) = rig.sample(), rig.stops
    y = sample.z - sample.x
    blur = 16 * EPS * (abs(sample.x) + abs(sample.z) + abs(stop_1) + abs(stop_2) + 1.0)
    assert y <= stop_1 + blur
    assert rig.parameters.one_sided or y >= stop_2 - blur


@given(seed=st.integers(0, 10**9))
def test_a_change_of_the_gap_is_a_command_to_both_stops(seed):
    """One rule: the same motion, to the last bit, whether m comes up to a stop or leaves it."""
    rig, rng = rig_of('stops', seed, one_sided=False), random.Random(seed)
    rig.advance(rig.time + rng.uniform(0.0, 5.0))
    changed, commanded = through_json(rig), through_json(rig)
    half = 0.5 * rig.parameters.gap * rng.uniform(0.01, 1.5)
    told = changed.change(rig.parameters.replace(gap=2.0 * half))
    commanded.move_stops(half, -half)
    assert changed.stops == commanded.stops
    # What is exactly there at once is not reported of a change.
    rest = [event for event in told if event.kind is not ARRIVED]
    assert {event.kind for event in rest} <= {TOUCHED, IMPACT, REST, RELEASE, STARTED}
    assert changed.snapshot()['origin'] == commanded.snapshot()['origin']
    assert changed.advance(rig.time + 9.0) == commanded.advance(rig.time + 9.0)
    assert changed.stops == commanded.stops


@given(seed=st.integers(0, 10**9))
def test_no_stop_ever_does_work(seed):
    """Energy of M and m = work of the force less dashpot, friction, air and impacts; 1e-10."""
    rng = random.Random(seed)
    rig, moving, held = rig_of('stops', seed, [0.0]), set(), set()
    account = Account(rig)
    for _ in range(8):
        command = random_command(rng, rig)
        new = rig.move_stops(*command)
        account.impacts(new)
        sent = {stop for stop, place in zip((1, 2), command, strict=False) if place is not None}
        moving, held = moving | sent, held - sent
        events = account.advance(rig.time + rng.choice([0.0, 1e-9, rng.uniform(0, 1.5)]))
        assert account.imbalance < 1e-10
        check_place(rig)
        for e in new + events:
            # Stops are on their way, held up, or there.
            if e.kind in (ARRIVED, TOUCHED):
                assert e.stop in moving | held
                moving.discard(e.stop)
                held.discard(e.stop)
            if e.kind == TOUCHED:
                held.add(e.stop)
            elif e.kind == STARTED:
                held.remove(e.stop)
                moving.add(e.stop)
            if e.kind != IMPACT:
                assert e.primary_velocity_before == e.primary_velocity_after
                speed = pytest.approx(e.damper_velocity_before, rel=8 * EPS, abs=1e-12)
                assert e.damper_velocity_after == speed
        for rate in stop_velocities(rig):
            assert abs(rate) <= command[2] * (1.0 + 1e-9) or moving or held
        places = zip((1, 2), rig.stops, targets(rig), strict=True)
        assert all(here == target or stop in moving | held for stop, here, target in places)


KINDS = {
    'contact 1': (EventKind.STOP_TOUCHED, 1),
    'contact 2': (EventKind.STOP_TOUCHED, 2),
    'reversal': (EventKind.REVERSAL, 0),
    'arrived 1': (ARRIVED, 1),
    'arrived 2': (ARRIVED, 2),
}


def test_meetings_agree_with_the_oracle():
    """First events of flights between moving stops, against a search with 110 digits."""
    seen = Counter()
    for seed in range(70):
        rng = random.Random(f'meeting {seed}')
        parameters, initial = random_rig(f'meeting {seed}', air_force=0.0, one_sided=False)
        parameters = parameters.replace(
            gap=200.0,
            damping=max(0.01, parameters.damping),
            # Not 90 degrees, where the rig rounds the normal force to 0
            angle=max(-1.5, min(1.5, parameters.angle)),
        )
        velocity = initial.initial_primary_velocity
        initial = InitialConditions(
            **{
                **initial.as_dict(),
                'initial_damper_offset': 0.0,
                'initial_damper_velocity': velocity + rng.choice([-1, 1]) * rng.uniform(0.1, 3.0),
            }
        )
        places = (rng.uniform(0.1, 4.0), -rng.uniform(0.1, 4.0))
        places = (0.0, places[1]) if rng.random() < 0.15 else places
        targets = (rng.uniform(-4.0, 6.0), rng.uniform(-6.0, 4.0))
        speed = 10 ** rng.uniform(-1.0, 0.7)
        rig = Rig(parameters, initial)
        rig.move_stops(*places)
        if rig.time or rig.snapshot()['origin']['last_stop']:
            continue
        rig.move_stops(*targets, speed)
        velocities = stop_velocities(rig)
        if 0.0 in velocities:
            continue
        found = first_meeting(
            {name: value for name, value in parameters.as_dict().items() if name in DEFAULTS},
            initial.as_dict(),
            places,
            velocities,
            targets,
            30.0,
        )
        kind, instant, rate = found
        event = next(e for e in rig.advance(31.0) if e.time > 0.0)
        if kind == 'reversal':
            assert event.kind in (EventKind.REVERSAL, EventKind.STICK)
        else:
            assert (event.kind, event.stop) == KINDS[kind]
        # Round-off of the positions over the rate at which they meet, and of the time
        size = abs(event.x) + abs(event.y) + speed * event.time + 1.0
        allowed = 64 * EPS * (event.time + size / float(rate))
        assert abs(event.time - float(instant)) <= allowed
        seen[kind] += 1
    assert all(seen[kind] >= 3 for kind in KINDS)


def test_a_stop_that_m_outruns_after_a_release_takes_no_speed():
    """It starts where m has become as fast as it is, not at the first look after the release."""
    draw = random.Random(3)
    started = 0
    for _ in range(40):
        rig = Rig(
            BENCH.replace(
                damper_mass=draw.uniform(0.02, 0.3),
                gap=0.04,
                friction=0.0,
                restitution_1=draw.choice([0.0, 0.5]),
                restitution_2=draw.choice([0.0, 0.5]),
                angle=draw.uniform(-0.6, 0.6),
                force_amplitudes=draw.uniform(2.0, 10.0),
            )
        )
        rig.advance(draw.uniform(0.3, 1.0))
        rig.move_stops(draw.uniform(0.005, 0.02), -draw.uniform(0.005, 0.02), 0.03)
        begun = rig.snapshot()
        events = rig.advance(rig.time + 1.0)
        hits = {event.time for event in events if event.kind is IMPACT}
        times = [e.time for e in events if e.kind is STARTED and e.time not in hits]
        instants = [time + late for time in times for late in (-1e-9, 1e-9)]
        samples = Rig.restore(begun).run(rig.time, instants).samples
        speeds = samples['damper_velocity'].reshape(-1, 2)
        assert speeds[:, 0] == pytest.approx(speeds[:, 1], abs=1e-6)
        started += len(times)
    assert started > 40


@pytest.mark.parametrize('side', [1, -1])
def test_m_squeezed_by_the_stop_that_follows_it_has_one_plastic_impact(side):
    """Whatever the round-off of the places: m touches the one stop when it hits the other."""
    draw = random.Random(5)
    for _ in range(200):
        parameters = RigParameters(
            gravity=0.0,
            gap=2.0,
            damping=0.1,
            restitution_1=0.9,
            restitution_2=0.9,
            force_amplitudes=float(side),
            force_frequencies=draw.uniform(0.8, 1.2),
        )
        rig = thrown(0.0, -1.0 * side, parameters)
        rig.advance(0.1)
        other = draw.uniform(0.3, 0.9)
        rig.move_stops(*((-1.5, -other) if side > 0 else (other, 1.5)))
        events = rig.advance(3.0)
        first = next(e.time for e in events if e.kind is IMPACT)
        squeezed = [e for e in events if abs(e.time - first) < 1e-9]
        assert [e.kind for e in squeezed] == [IMPACT, REST]
        hit = squeezed[0]
        assert hit.stop == (2 if side > 0 else 1)
        assert hit.damper_velocity_after == hit.primary_velocity_after
        assert hit.y == -side * other
        assert rig.stops[0] == rig.stops[1]
