"""Stops that move relative to M: where they meet m, and that they never do work."""

import math
import random
from collections import Counter
from math import inf

import pytest

from impact_damper_ros.rig import (
    EventKind,
    InitialConditions,
    Mode,
    ParameterError,
    RigParameters,
    Simulator,
)
from impact_damper_ros.rig.simulator import ARITHMETIC
from oracle.hybrid_oracle import DEFAULTS
from oracle.moving_stops import first_meeting
from rig.energy import Account
from rig.random_rigs import random_command, random_rig, through_json

EPS = 2.0**-52
ARRIVED, TOUCHED, IMPACT = EventKind.STOP_ARRIVED, EventKind.STOP_TOUCHED, EventKind.IMPACT
# No force, M still and heavy: m moves as a free body until it touches something.
QUIET = RigParameters(
    primary_mass=1e9, stiffness=1e9, damper_mass=1.0, gap=10.0, gravity=0.0, force_amplitudes=[0.0]
)


def targets(rig):
    """Return the positions Y to which the stops move, or at which they are."""
    origin = rig.state().origin
    return origin.target_1, origin.target_2


def thrown(offset, velocity, parameters=QUIET):
    return Simulator(
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


@pytest.mark.parametrize('side', [1, -1])
class TestOneStop:
    """`side` mirrors: 1 for stop 1, -1 for stop 2."""

    def test_it_arrives_at_an_exact_instant(self, side):
        rig, stop = thrown(0.0, 0.0), 1 if side > 0 else 2
        rig.advance(1.0)
        assert to(rig, side, 3.0, 0.3) == []
        assert targets(rig) == ((3.0, -5.0) if side > 0 else (5.0, -3.0))
        assert rig.stop_velocities == ((-0.3, 0.0) if side > 0 else (0.0, 0.3))
        assert rig.advance(2.0) == []
        assert near(rig, side) == pytest.approx(4.7, rel=2 * EPS)
        (event,) = rig.advance(9.0)
        assert told([event]) == [(ARRIVED, stop, 1.0 + 2.0 / 0.3)]
        assert near(rig, side) == 3.0
        assert rig.stop_velocities == (0.0, 0.0)

    def test_it_comes_up_to_m_that_moves_outwards(self, side):
        """The stop stands when m hits it: the rebound is that of a standing stop."""
        rig, stop = thrown(0.0, side * 1.0), 1 if side > 0 else 2
        to(rig, side, -3.0, 1.5)
        touched, hit = rig.advance(2.5)
        assert told([touched, hit]) == [(TOUCHED, stop, 2.0), (IMPACT, stop, 2.0)]
        assert touched.y == hit.y == pytest.approx(side * 2.0)
        assert touched.damper_velocity_after == touched.damper_velocity_before == side * 1.0
        assert hit.damper_velocity_after == pytest.approx(side * -0.75, rel=1e-8)
        assert hit.impulse == pytest.approx(1.75, rel=1e-8)
        assert near(rig, side) == pytest.approx(2.0, rel=2 * EPS)
        assert targets(rig) == rig.stops
        # It stays for good.
        assert all(e.stop == 3 - stop for e in rig.advance(11.0))
        assert near(rig, side) == pytest.approx(2.0, rel=2 * EPS)

    def test_it_overtakes_m_that_moves_inwards(self, side):
        """It is faster than m, and lets m go on as if nothing had happened."""
        rig, stop = thrown(side * 4.0, side * -1.0), 1 if side > 0 else 2
        to(rig, side, -4.0, 1.25)
        (touched,) = rig.advance(4.5)
        assert told([touched]) == [(TOUCHED, stop, 4.0)]
        assert near(rig, side) == pytest.approx(0.0, abs=1e-15)
        assert rig.sample().damper_velocity == side * -1.0
        assert rig.sample().z == side * -0.5

    def test_it_comes_up_to_m_that_stands(self, side):
        rig, stop = thrown(side * 1.0, 0.0), 1 if side > 0 else 2
        to(rig, side, 0.0, 2.0)
        touched, rest = rig.advance(9.0)
        assert told([touched, rest]) == [(TOUCHED, stop, 2.0), (EventKind.REST, stop, 2.0)]
        assert near(rig, side) == pytest.approx(1.0, rel=2 * EPS)
        assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)

    def test_sticking_m_is_touched_in_joint_motion(self, side):
        rough = RigParameters(gap=10.0, friction=5.0, gravity=1.0, force_amplitudes=[0.1])
        rig, stop = Simulator(rough), 1 if side > 0 else 2
        rig.advance(3.0)
        assert rig.mode == Mode.STICK
        to(rig, side, -1.0, 0.7)
        (touched,) = rig.advance(20.0)
        assert told([touched]) == [(TOUCHED, stop, 3.0 + 5.0 / 0.7)]
        assert near(rig, side) == pytest.approx(0.0, abs=1e-15)
        assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)

    def test_m_chases_a_receding_stop(self, side):
        """Thrown off by its weight once the support is gone, m falls w t behind."""
        pulled = QUIET.replace(gravity=2.0, angle=side * math.pi / 2)
        rig, stop = thrown(side * 5.0, 0.0, pulled), 1 if side > 0 else 2
        rig.advance(1.0)
        (release,) = to(rig, side, 20.0, 3.0)
        assert (release.kind, release.stop, release.time) == (EventKind.RELEASE, stop, 1.0)
        events = rig.advance(4.2)
        # g t^2/2 = w t
        assert [(e.kind, e.stop) for e in events] == [(TOUCHED, stop), (IMPACT, stop)]
        assert events[0].time == events[1].time == pytest.approx(4.0, rel=1e-8)
        assert near(rig, side) == pytest.approx(14.0, rel=1e-8)
        assert abs(events[1].damper_velocity_before) == pytest.approx(6.0, rel=1e-8)
        assert abs(events[1].damper_velocity_after) == pytest.approx(4.5, rel=1e-8)

    def test_friction_holds_m_whose_support_leaves(self, side):
        rough = QUIET.replace(gravity=1.0, friction=0.5, angle=side * 0.3)
        rig = thrown(side * 5.0, 0.0, rough)
        assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)
        assert to(rig, side, 6.0, 1.0) == []
        assert rig.mode == Mode.STICK
        (event,) = rig.advance(9.0)
        assert event.kind == ARRIVED

    def test_closing_onto_m_at_rest_is_over_at_once(self, side):
        pulled = QUIET.replace(gravity=2.0, angle=side * math.pi / 2)
        rig, stop = thrown(side * 5.0, 0.0, pulled), 1 if side > 0 else 2
        for speed in (1e-3, 1e3, inf):
            (event,) = to(rig, side, 1.0, speed)
            assert (event.kind, event.stop) == (TOUCHED, stop)
            assert near(rig, side) == 5.0
            assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)
        assert rig.advance(3.0) == []

    def test_at_once(self, side):
        """Past m, the stop goes up to m: hit, or passed by."""
        stop = 1 if side > 0 else 2
        rig = thrown(0.0, side * 1.0)
        rig.advance(1.0)
        (event,) = to(rig, side, 3.0)
        assert (event.kind, event.stop, near(rig, side)) == (ARRIVED, stop, 3.0)
        touched, hit = to(rig, side, -2.0)
        assert told([touched, hit]) == [(TOUCHED, stop, 1.0), (IMPACT, stop, 1.0)]
        assert near(rig, side) == 1.0
        rig = thrown(0.0, side * -1.0)
        rig.advance(1.0)
        (touched,) = to(rig, side, -2.0)
        assert told([touched]) == [(TOUCHED, stop, 1.0)]
        assert rig.sample().damper_velocity == side * -1.0
        assert near(rig, side) == -1.0
        # It does not follow m, as one does that a change of the gap has sent there.
        assert rig.advance(1.5) == []
        assert near(rig, side) == -1.0

    def test_a_new_command_replaces_the_old_one(self, side):
        rig, stop = thrown(0.0, 0.0), 1 if side > 0 else 2
        to(rig, side, 1.0, 1.0)
        rig.advance(1.0)
        assert to(rig, side, 8.0, 2.0) == []
        assert told(rig.advance(9.0)) == [(ARRIVED, stop, 3.0)]
        (event,) = to(rig, side, 8.0, 0.1)
        assert (event.kind, event.time) == (ARRIVED, 9.0)

    def test_samples_show_its_velocity(self, side):
        """That of M while it stands, its own one besides while it moves, Z' while it follows m."""
        heavy = QUIET.replace(stiffness=1.0, damping=0.0)
        rig = Simulator(
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
        rig.change(QUIET.replace(restitution_1=0.5))
        assert near(rig, side) == 4.0
        rig.advance(2.0)
        assert near(rig, side) == 3.0
        rig.change(QUIET.replace(gap=12.0))
        assert rig.stops == targets(rig) == (6.0, -6.0)
        assert rig.stop_velocities == (0.0, 0.0)
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
    assert kinds[:2] == [(TOUCHED, 1), (IMPACT, 1)]
    assert events[0].time == pytest.approx(4.0)
    # m returns with 0.1875 and stop 2 comes at 1 from -1.
    assert kinds[2:4] == [(TOUCHED, 2), (IMPACT, 2)]
    assert events[2].time == pytest.approx(4.0 + 2.0 / 1.1875, rel=1e-8)
    width = 0.1875 * 2.0 / 1.1875
    assert rig.stops[0] - rig.stops[1] == pytest.approx(width, rel=1e-8)
    impacts = [e for e in events if e.kind == IMPACT][2:]
    assert len(impacts) >= 1
    assert all(abs(e.damper_velocity_after) < 0.15 for e in impacts)


def test_m_between_two_stops_with_no_room_cannot_move():
    """Driven hard, the clamped mass goes with M as one."""
    rig = Simulator(RigParameters(gap=4.0, gravity=0.0, force_frequencies=[1.3]))
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
    same = Simulator(
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


@pytest.mark.parametrize(
    ('stops', 'speed', 'name', 'words'),
    [
        ((math.nan, None), 1.0, 'stop_1', ['nan', 'from -1e+09 to 1e+09 m']),
        ((None, -2e9), 1.0, 'stop_2', ['-2000000000.0 m', 'from -1e+09 to 1e+09 m']),
        ((1.0, None), 0.0, 'speed', ['0.0 m/s', 'inf for at once']),
        ((1.0, None), math.nan, 'speed', ['nan']),
        ((1.0, None), -inf, 'speed', ['-inf']),
    ],
)
def test_bad_commands_change_nothing(stops, speed, name, words):
    rig = thrown(0.0, 1.0)
    before = rig.snapshot()
    with pytest.raises(ParameterError) as caught:
        rig.move_stops(*stops, speed)
    assert caught.value.name == name
    assert all(word in str(caught.value) for word in words)
    assert rig.snapshot() == before


def test_a_one_sided_rig_has_no_stop_2():
    rig = Simulator(RigParameters(one_sided=True, gravity=0.0))
    with pytest.raises(ParameterError, match='one-sided'):
        rig.move_stops(1.0, -1.0)
    rig.move_stops(-30.0, None, 2.0)
    assert rig.advance(40.0)[0].kind in (TOUCHED, ARRIVED)


def lively(seed):
    """Return a random rig, with as few elastic stops as exercise does not hang on."""
    parameters, initial = random_rig(f'stops {seed}')
    if parameters.restitution_1 == 1.0:
        parameters = parameters.replace(restitution_1=0.9)
    return parameters, initial


def check_place(rig):
    """Check that m is between the stops."""
    sample, (stop_1, stop_2) = rig.sample(), rig.stops
    y = sample.z - sample.x
    blur = 16 * EPS * (abs(sample.x) + abs(sample.z) + abs(stop_1) + abs(stop_2) + 1.0)
    assert y <= stop_1 + blur
    assert rig.parameters.one_sided or y >= stop_2 - blur


SEEN = set()


@pytest.mark.parametrize('seed', range(60))
def test_no_stop_ever_does_work(seed):
    """Energy of M and m = work of the force less dashpot, friction, air and impacts; 1e-10."""
    rng = random.Random(seed)
    rig = Simulator(*lively(seed))
    account = Account(rig)
    for _ in range(10):
        events = account.advance(rig.time + rng.choice([0.0, 1e-9, rng.uniform(0, 1.5)]))
        check_place(rig)
        assert account.imbalance < 1e-10
        new = rig.move_stops(*random_command(rng, rig))
        account.impacts(new)
        check_place(rig)
        assert account.imbalance < 1e-10
        for e in new + events:
            SEEN.add(e.kind)
            if e.kind != IMPACT:
                assert e.primary_velocity_before == e.primary_velocity_after
                speed = pytest.approx(e.damper_velocity_before, rel=8 * EPS, abs=1e-12)
                assert e.damper_velocity_after == speed


def test_all_kinds_of_events_were_seen():
    if SEEN:
        assert set(EventKind) - {EventKind.CROSSING, EventKind.FREQUENCY_STEP} <= SEEN


@pytest.mark.parametrize('seed', range(40))
def test_each_movement_ends_with_one_event(seed):
    rng = random.Random(seed)
    rig = Simulator(*lively(seed))
    moving = set()

    def take(events):
        for e in events:
            if e.kind in (ARRIVED, TOUCHED):
                assert e.stop in moving
                moving.discard(e.stop)

    for _ in range(12):
        command = random_command(rng, rig)
        moving |= {stop for stop, place in zip((1, 2), command, strict=False) if place is not None}
        take(rig.move_stops(*command))
        take(rig.advance(rig.time + rng.uniform(0, 0.8)))
        for stop, velocity in zip((1, 2), rig.stop_velocities, strict=True):
            assert (velocity != 0.0) == (stop in moving)


@pytest.mark.parametrize('seed', range(40))
def test_runs_may_be_cut_up_anywhere(seed):
    """Events, samples and snapshots are the same bits, however a run is cut and restored."""
    rng = random.Random(seed)
    whole = Simulator(*lively(seed))
    pieces, got, want = through_json(whole), [], []
    for _ in range(12):
        want += whole.advance(whole.time + rng.uniform(0, 0.8))
        while pieces.time < whole.time and rng.random() < 0.8:
            got += pieces.advance(min(whole.time, pieces.time + rng.uniform(0, 0.3)))
            pieces.sample()
            if rng.random() < 0.3:
                pieces = through_json(pieces)
        got += pieces.advance(whole.time)
        assert pieces.snapshot() == whole.snapshot()
        assert pieces.sample() == whole.sample()
        assert pieces.stop_velocities == whole.stop_velocities
        command = random_command(rng, whole)
        want += whole.move_stops(*command)
        got += pieces.move_stops(*command)
    assert got == want


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
        rig = Simulator(parameters, initial)
        rig.move_stops(*places)
        if rig.time or rig.snapshot()['origin']['last_stop']:
            continue
        rig.move_stops(*targets, speed)
        velocities = rig.stop_velocities
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


OLD = {
    'format': 1,
    'time': 20.25,
    'origin': {
        'time': 20.018625743109535,
        'time_low': -3.2959746043559335e-16,
        'mode': 1,
        'x': -3.1686732817369077,
        'velocity': 4.997233051156855,
        'relative_velocity': 2.8556272738384476,
        'clearance_1': 2.0,
        'clearance_2': 0.0,
        'stop_1': 1.0,
        'stop_2': -1.0,
        'angles': [1.1690698215707749, 2.615737227388275],
        'last_stop': 2,
        'released': False,
        'chatter_left': 0.0,
    },
    'unreported': [],
    'parameters': {
        'primary_mass': 1.0,
        'stiffness': 1.0,
        'damping': 0.1,
        'damper_mass': 0.042,
        'gap': 2.0,
        'restitution_1': 0.75,
        'restitution_2': 0.75,
        'angle': 0.6,
        'friction': 0.1,
        'gravity': 1.0,
        'air_force': 0.0,
        'one_sided': False,
        'force_amplitudes': [1.0, 0.5],
        'force_frequencies': [1.0, 1.7],
        'force_phases': [0.0, 0.4],
    },
}


def test_a_snapshot_of_version_0_1_goes_on_as_it_did():
    """Same events as the version that wrote it, to round-off, which this motion doubles each s."""
    rig = Simulator.restore(OLD)
    assert targets(rig) == (1.0, -1.0)
    events = rig.advance(30.0)
    assert [(e.kind.name, e.time) for e in events[:4]] == [
        ('IMPACT', pytest.approx(float.fromhex('0x1.4e4f9421859d9p+4'), rel=8 * EPS)),
        ('REVERSAL', pytest.approx(float.fromhex('0x1.55d9a9b285bc1p+4'), rel=8 * EPS)),
        ('IMPACT', pytest.approx(float.fromhex('0x1.5c9f184c5258ap+4'), rel=8 * EPS)),
        ('REVERSAL', pytest.approx(float.fromhex('0x1.61070a9f88c95p+4'), rel=8 * EPS)),
    ]
    last = [
        '0x1.e000000000000p+4',
        '0x1.b9d39141a2b7dp-2',
        '-0x1.d505b433e3d4bp+2',
        '0x1.6576070ca8fa7p+0',
        '-0x1.de0cef2b1ea7dp+2',
        '0x1.6e74e45068adfp+0',
        '-0x1.2316375f2ea42p-1',
    ]
    expected = [float.fromhex(value) for value in last]
    assert list(rig.sample()[:7]) == pytest.approx(expected, rel=2048 * EPS)
    assert rig.snapshot()['arithmetic'] == ARITHMETIC
    assert through_json(rig).snapshot() == rig.snapshot()
