"""Parameter changes in flight: exact, at one instant, and as the design defines them."""

import math
import random

import pytest

from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters, Simulator
from rig.random_rigs import random_parameters, random_rig, run, through_json

EPS = 2.0**-52
# No force, M still and heavy: m moves as a free body until it touches something.
QUIET = RigParameters(
    primary_mass=1e6, stiffness=1e6, damper_mass=1.0, gap=10.0, gravity=0.0, force_amplitudes=[0.0]
)


def thrown(offset, velocity, parameters=QUIET):
    return Simulator(
        parameters,
        InitialConditions(initial_damper_offset=offset, initial_damper_velocity=velocity),
    )


def y_of(rig):
    sample = rig.sample()
    return sample.z - sample.x


@pytest.mark.parametrize('side', [1, -1])
class TestGap:
    """`side` mirrors: 1 for stop 1, -1 for stop 2."""

    def test_opening_is_immediate(self, side):
        rig = thrown(0.0, side)
        rig.advance(3.0)
        assert rig.change(QUIET.replace(gap=16.0)) == []
        assert rig.stops == (8.0, -8.0)
        (event,) = rig.advance(9.0)
        assert (event.kind, event.stop) == (EventKind.IMPACT, 1 if side > 0 else 2)
        assert event.time == pytest.approx(8.0, rel=2 * EPS)

    def test_closing_short_of_m(self, side):
        rig = thrown(0.0, side)
        rig.advance(1.0)
        assert rig.change(QUIET.replace(gap=4.0)) == []
        assert rig.stops == (2.0, -2.0)
        assert rig.advance(3.0)[0].time == pytest.approx(2.0, rel=2 * EPS)

    def test_closing_onto_m_that_moves_outwards(self, side):
        """The stop comes up to m and is hit there; then it follows m inwards."""
        rig = thrown(0.0, side)
        rig.advance(3.0)
        (hit,) = rig.change(QUIET.replace(gap=4.0))
        assert (hit.kind, hit.stop, hit.time) == (EventKind.IMPACT, 1 if side > 0 else 2, 3.0)
        assert hit.y == pytest.approx(3.0 * side, rel=EPS)
        M, m = 1e6, 1.0
        momentum = M * hit.primary_velocity_after + m * hit.damper_velocity_after
        assert momentum == pytest.approx(m * side, rel=1e-9)
        speed = hit.damper_velocity_after - hit.primary_velocity_after
        assert speed == pytest.approx(-0.75 * side, rel=4 * EPS)
        assert hit.impulse == pytest.approx(1.75 / (1 + 1e-6), rel=4 * EPS)
        rig.advance(3.6)
        near = rig.stops[0] if side > 0 else rig.stops[1]
        assert near == pytest.approx(side * (3.0 - 0.75 * 0.6), rel=1e-6)
        assert near == pytest.approx(y_of(rig), rel=1e-14)
        (arrived,) = rig.advance(6.0)
        assert (arrived.kind, arrived.stop) == (EventKind.STOP_ARRIVED, 1 if side > 0 else 2)
        assert arrived.time == pytest.approx(3.0 + 1.0 / 0.75, rel=1e-5)
        assert arrived.y == 2.0 * side
        assert rig.stops == (2.0, -2.0)

    def test_closing_onto_m_that_moves_inwards(self, side):
        """The stop follows without doing work: m flies as if it were not there."""
        rig, free = thrown(4.0 * side, -side), thrown(4.0 * side, -side)
        rig.advance(0.5)
        assert rig.change(QUIET.replace(gap=4.0)) == []
        assert rig.stops == pytest.approx((3.5, -2.0) if side > 0 else (2.0, -3.5), rel=EPS)
        events = []
        for k in range(5, 40):
            events += rig.advance(k / 10)
            free.advance(k / 10)
            assert rig.sample().z == pytest.approx(free.sample().z, abs=1e-14)
            assert rig.sample().x == pytest.approx(free.sample().x, abs=1e-14)
            assert rig.sample().damper_velocity == free.sample().damper_velocity
        (arrived,) = events
        assert arrived.kind == EventKind.STOP_ARRIVED
        assert arrived.time == pytest.approx(2.0, rel=2 * EPS)
        assert arrived.damper_velocity_before == arrived.damper_velocity_after == -side
        # It arrived in time for the other stop, which was closed at once.
        (hit,) = rig.advance(6.5)
        assert (hit.kind, hit.stop, hit.y) == (EventKind.IMPACT, 2 if side > 0 else 1, -2.0 * side)
        assert hit.time == pytest.approx(6.0, rel=2 * EPS)

    def test_closing_onto_m_at_rest(self, side):
        """M rests on a stop that would close: the stop stays, and follows when m is thrown off."""
        pressed = RigParameters(
            gap=10.0,
            angle=side * math.pi / 2,
            gravity=1.0,
            damping=0.1,
            force_amplitudes=[1.0, 1.0],
            force_frequencies=[1.3, 1.31],
            force_phases=[0.0, math.pi],
        )
        rig = Simulator(pressed, InitialConditions(initial_damper_offset=5.0 * side))
        mode = Mode.REST_1 if side > 0 else Mode.REST_2
        assert rig.advance(10.0) == []
        assert rig.mode == mode
        assert rig.change(pressed.replace(gap=9.0)) == []
        assert rig.mode == mode
        assert y_of(rig) == pytest.approx(5.0 * side, rel=4 * EPS)
        assert max(rig.stops[0], -rig.stops[1]) == 5.0
        release = rig.advance(300.0)[0]
        assert release.kind == EventKind.RELEASE
        rig = Simulator(pressed, InitialConditions(initial_damper_offset=5.0 * side))
        rig.advance(10.0)
        rig.change(pressed.replace(gap=9.0))
        rig.advance(release.time)
        kinds = set()
        while EventKind.STOP_ARRIVED not in kinds and rig.time < 300.0:
            kinds |= {e.kind for e in rig.advance(rig.time + 0.01)}
            stop = rig.stops[0] if side > 0 else -rig.stops[1]
            assert 4.5 <= stop <= 5.0
        assert EventKind.STOP_ARRIVED in kinds
        assert rig.stops == (4.5, -4.5)

    def test_reversing_while_the_stop_follows(self, side):
        """M turns back onto the following stop: it comes to rest on it."""
        pulled = QUIET.replace(stiffness=1e12, gravity=1.0, angle=side * math.pi / 2)
        rig = thrown(4.0 * side, -side, pulled)
        assert rig.change(pulled.replace(gap=2.0)) == []
        events = rig.advance(1.5)
        assert [e.kind for e in events] == [EventKind.REST]
        assert events[0].time == pytest.approx(1.0, rel=1e-5)
        assert events[0].y == pytest.approx(3.5 * side, rel=1e-5)
        assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)
        near = rig.stops[0] if side > 0 else rig.stops[1]
        assert near == pytest.approx(3.5 * side, rel=1e-5)
        # Turned over, m leaves, and the stop follows to its place.
        rig.change(pulled.replace(gap=2.0, angle=-side * math.pi / 2))
        kinds = [e.kind for e in rig.advance(rig.time + 2.6)]
        assert [k for k in kinds if k != EventKind.RELEASE] == [EventKind.STOP_ARRIVED]
        assert rig.stops == (1.0, -1.0)

    def test_opening_again_while_the_stop_follows(self, side):
        rig = thrown(4.0 * side, -side)
        rig.change(QUIET.replace(gap=2.0))
        rig.advance(0.5)
        assert rig.change(QUIET) == []
        assert rig.stops == (5.0, -5.0)
        (hit,) = rig.advance(9.0)
        assert (hit.kind, hit.y) == (EventKind.IMPACT, -5.0 * side)
        assert hit.time == pytest.approx(9.0, rel=2 * EPS)

    def test_closing_further_while_the_stop_follows(self, side):
        rig = thrown(4.0 * side, -side)
        rig.change(QUIET.replace(gap=6.0))
        rig.advance(0.5)
        rig.change(QUIET.replace(gap=2.0))
        (arrived,) = rig.advance(4.5)
        assert arrived.kind == EventKind.STOP_ARRIVED
        assert arrived.time == pytest.approx(3.0, rel=2 * EPS)

    def test_sticking_m_holds_the_stop(self, side):
        """Friction holds m in the gap: the stop waits at it, as for m at rest."""
        rough = RigParameters(gap=10.0, friction=5.0, gravity=1.0, force_amplitudes=[0.1])
        rig = Simulator(rough, InitialConditions(initial_damper_offset=4.0 * side))
        assert rig.advance(3.0) == []
        assert rig.mode == Mode.STICK
        assert rig.change(rough.replace(gap=2.0)) == []
        assert y_of(rig) == pytest.approx(4.0 * side, rel=4 * EPS)
        assert max(rig.stops[0], -rig.stops[1]) == 4.0
        assert rig.advance(30.0) == []


def shaken(**more):
    """Return a rig on the way, m in flight."""
    parameters = RigParameters(
        **{'angle': 0.6, 'gravity': 1.0, 'friction': 0.1, 'gap': 8.0, 'damping': 0.1, **more}
    )
    rig = Simulator(parameters)
    rig.advance(20.0)
    return rig


@pytest.mark.parametrize(
    'change',
    [
        {'angle': -0.3},
        {'gravity': 4.0},
        {'stiffness': 2.5},
        {'primary_mass': 3.0},
        {'angle': 0.1, 'gravity': 2.0, 'stiffness': 0.5},
    ],
)
def test_lab_position_is_continuous(change):
    """X and Z shift by the change of the static deflection; Y and the velocities do not."""
    rig = shaken()
    before, old = rig.sample(), rig.parameters
    assert rig.change(old.replace(**change)) == []
    after, new = rig.sample(), rig.parameters
    lab = (old.static_deflection, new.static_deflection)
    assert before.x + lab[0] == pytest.approx(after.x + lab[1], rel=8 * EPS)
    assert before.z + lab[0] == pytest.approx(after.z + lab[1], rel=8 * EPS)
    assert after.primary_velocity == before.primary_velocity
    assert after.damper_velocity == pytest.approx(before.damper_velocity, rel=4 * EPS)
    assert after.z - after.x == pytest.approx(before.z - before.x, rel=8 * EPS)


def test_lab_position_of_an_impact_that_a_reset_begins_with():
    """It is reported after a change at the same instant, from which on X counts."""
    rig = shaken()
    half = 0.5 * rig.parameters.gap
    rig.reset(
        InitialConditions(
            initial_primary_position=0.25,
            initial_damper_offset=half,
            initial_damper_velocity=1.0,
        )
    )
    before = rig.parameters
    after = before.replace(angle=-0.3, stiffness=2.5)
    rig.change(after)
    (event,) = (e for e in rig.advance(rig.time) if e.kind is EventKind.IMPACT)
    place = 0.25 + before.static_deflection
    assert event.x + after.static_deflection == pytest.approx(place, rel=8 * EPS)
    assert event.y == half


def acceleration(rig):
    """Return X'' by a second difference, from one side."""
    other = through_json(rig)
    h, v = 1e-4, []
    for k in range(3):
        other.advance(rig.time + k * h)
        v.append(other.sample().primary_velocity)
    return (-3 * v[0] + 4 * v[1] - v[2]) / (2 * h)


def test_frequency_keeps_the_phase():
    """The force does not jump: its angle goes on from where it was, at the new rate."""
    rig = Simulator(RigParameters(gap=1e6, gravity=0.0, force_frequencies=[1.7]))
    rig.advance(23.0)
    before = acceleration(rig)
    rig.change(rig.parameters.replace(force_frequencies=[0.4]))
    assert acceleration(rig) == pytest.approx(before, abs=1e-6)
    # The same as a rig that had the phase 1.7 * 23 - 0.4 * 23 from the start
    sample = rig.sample()
    other = Simulator(
        RigParameters(gap=1e6, gravity=0.0, force_frequencies=[0.4], force_phases=[1.7 * 23.0]),
        InitialConditions(
            initial_primary_position=sample.x, initial_primary_velocity=sample.primary_velocity
        ),
    )
    rig.advance(60.0)
    other.advance(37.0)
    assert rig.sample().x == pytest.approx(other.sample().x, rel=1e-12)


def test_frequency_swept_in_many_steps_is_a_chirp():
    rig, angle = Simulator(RigParameters(gap=1e6, gravity=0.0)), 0.0
    for k in range(200):
        frequency = 1.0 + k / 200
        rig.change(rig.parameters.replace(force_frequencies=[frequency]))
        rig.advance((k + 1) * 0.3)
        angle += frequency * 0.3
    got = rig.snapshot()
    phase = got['origin']['angles'][0] + frequency * (rig.time - got['origin']['time'])
    assert math.sin(phase) == pytest.approx(math.sin(angle), abs=1e-12)


def test_phase_and_amplitude_act_at_once():
    rig = Simulator(RigParameters(gap=1e6, gravity=0.0, damping=0.0))
    rig.advance(10.0)
    x = rig.sample().x
    rig.change(rig.parameters.replace(force_amplitudes=[3.0], force_phases=[1.0]))
    assert acceleration(rig) == pytest.approx(3.0 * math.sin(11.0) - x, abs=1e-6)


def test_number_of_harmonics():
    """One that is added starts at its phase; one that is taken away does not disturb the rest."""
    rig = Simulator(RigParameters(gap=1e6, gravity=0.0, damping=0.0))
    rig.advance(10.0)
    x = rig.sample().x
    three = rig.parameters.replace(
        force_amplitudes=[1.0, 2.0, 4.0],
        force_frequencies=[1.0, 3.0, 5.0],
        force_phases=[0.0, 0.5, -1.0],
    )
    rig.change(three)
    want = math.sin(10.0) + 2 * math.sin(0.5) + 4 * math.sin(-1.0) - x
    assert acceleration(rig) == pytest.approx(want, abs=1e-5)
    rig.advance(12.0)
    x = rig.sample().x
    rig.change(
        three.replace(
            force_amplitudes=[1.0, 2.0], force_frequencies=[1.0, 3.0], force_phases=[0, 0.5]
        )
    )
    assert acceleration(rig) == pytest.approx(math.sin(12.0) + 2 * math.sin(6.5) - x, abs=1e-5)
    # Back again: it starts anew.
    rig.change(three)
    want = math.sin(12.0) + 2 * math.sin(6.5) + 4 * math.sin(-1.0) - x
    assert acceleration(rig) == pytest.approx(want, abs=1e-5)


def test_one_sided_both_ways():
    """Without stop 2, m flies on; when the stop comes back it comes up to m."""
    rig = thrown(0.0, -1.0, QUIET.replace(one_sided=True))
    assert rig.advance(8.0) == []
    assert y_of(rig) == pytest.approx(-8.0, rel=EPS)
    (hit,) = rig.change(QUIET)
    assert (hit.kind, hit.stop) == (EventKind.IMPACT, 2)
    assert hit.y == pytest.approx(-8.0, rel=EPS)
    (arrived,) = rig.advance(12.5)
    assert (arrived.kind, arrived.stop, arrived.y) == (EventKind.STOP_ARRIVED, 2, -5.0)
    assert arrived.time == pytest.approx(8.0 + 3.0 / 0.75, rel=1e-5)
    rig.change(QUIET.replace(one_sided=True))
    rig = thrown(0.0, -1.0)
    rig.advance(4.0)
    assert rig.change(QUIET.replace(one_sided=True)) == []
    assert rig.advance(40.0) == []
    assert y_of(rig) == pytest.approx(-40.0, rel=2 * EPS)


def test_one_sided_while_resting_on_stop_2():
    upside = QUIET.replace(angle=-math.pi / 2, gravity=1.0)
    rig = thrown(-5.0, 0.0, upside)
    assert rig.mode == Mode.REST_2
    rig.advance(1.0)
    rig.change(upside.replace(one_sided=True))
    assert rig.mode == Mode.FREE
    rig.advance(3.0)
    assert y_of(rig) == pytest.approx(-7.0, rel=1e-5)


@pytest.mark.parametrize('seed', range(15))
def test_equal_parameters_change_nothing(seed):
    parameters, initial = random_rig(seed)
    rig, other = Simulator(parameters, initial), Simulator(parameters, initial)
    for k in range(1, 60):
        a, b = rig.advance(k * 0.31), other.advance(k * 0.31)
        assert a == b
        assert other.change(parameters.replace()) == []
        if len(a) > 200:
            break
    assert rig.snapshot() == other.snapshot()


def random_change(rng, parameters):
    """Return changed parameters of the kinds a user turns knobs at."""
    fresh = random_parameters(rng)
    names = rng.choice(
        [
            ('gap',),
            ('gap',),
            ('gap',),
            ('angle',),
            ('gravity', 'friction'),
            ('stiffness',),
            ('primary_mass', 'damper_mass'),
            ('restitution_1', 'restitution_2'),
            ('air_force',),
            ('one_sided',),
            ('force_amplitudes', 'force_frequencies', 'force_phases'),
        ]
    )
    return parameters.replace(damping=0.1, **{n: getattr(fresh, n) for n in names})


def journey(seed, on_the_way=None):
    """Run a rig through many changes; return all events and the changes with their instants."""
    rng = random.Random(f'journey {seed}')
    parameters, initial = random_rig(seed, damping=0.1)
    rig, events, log = Simulator(parameters, initial), [], []
    for _ in range(25):
        target = rig.time + rng.choice([0.01, rng.uniform(0, 3)])
        new = run(rig, target, 300)
        events += new
        if new and rng.random() < 0.3:
            # Right at an event, or next to it
            rig = Simulator(parameters, initial)
            for instant, changed in log:
                rig.advance(instant)
                rig.change(changed)
            at = rng.choice(new).time
            events = [e for e in events if e.time <= at]
            rig.advance(at)
        changed = random_change(rng, rig.parameters)
        log.append((rig.time, changed))
        events += rig.change(changed)
        if on_the_way:
            on_the_way(rig)
    return parameters, initial, log, events, rig


@pytest.mark.parametrize('seed', range(30))
def test_replay(seed):
    """A log of changes and instants replays the run bit for bit, however it is sampled."""
    parameters, initial, log, events, rig = journey(seed)
    again, got = Simulator(parameters, initial), []
    rng = random.Random(seed)
    for instant, changed in log:
        while again.time < instant and rng.random() < 0.8:
            got += again.advance(min(instant, again.time + rng.uniform(0, 1)))
            again.sample()
        got += again.advance(instant)
        if rng.random() < 0.3:
            again = through_json(again)
        got += again.change(changed)
        if rng.random() < 0.3:
            again = through_json(again)
    assert got == events
    assert again.snapshot() == rig.snapshot()
    assert again.advance(rig.time + 3.0) == rig.advance(rig.time + 3.0)


@pytest.mark.parametrize('seed', [*range(30), 2869, 3323, 4879, 5369, 6203, 6217])
def test_changes_keep_the_state(seed):
    """Y and the velocities are continuous but for an impact; m is never outside the stops."""
    last = {}

    def look(rig):
        sample, (stop_1, stop_2) = rig.sample(), rig.stops
        y = sample.z - sample.x
        blur = 8 * EPS * (abs(sample.x) + abs(sample.z) + stop_1)
        half = rig.parameters.gap / 2
        assert y <= stop_1 + blur
        assert stop_1 >= half
        if not rig.parameters.one_sided:
            assert y >= stop_2 - blur
            assert stop_2 <= -half
        # A stop is beyond its place only where m holds it back.
        assert stop_1 == half or y == pytest.approx(stop_1, abs=blur)
        assert rig.parameters.one_sided or stop_2 == -half or y == pytest.approx(stop_2, abs=blur)
        assert all(map(math.isfinite, sample))
        last['time'] = rig.time

    _, _, _, events, _ = journey(seed, look)
    times = [e.time for e in events]
    assert times == sorted(times)


def test_change_during_chatter():
    """M in its last bounces is on the stop for a change, which may throw it off."""
    found = 0
    for seed in range(60):
        parameters, initial = random_rig(seed)
        for event in run(Simulator(parameters, initial), 10.0, 300):
            if event.kind != EventKind.REST or event.time == 0.0:
                continue
            rig = Simulator(parameters, initial)
            rig.advance(event.time - 1e-9)
            if rig.mode not in (Mode.CHATTER_1, Mode.CHATTER_2):
                continue
            speed = rig.sample().damper_velocity
            rig.change(parameters.replace(gap=parameters.gap * 2))
            assert rig.mode not in (Mode.CHATTER_1, Mode.CHATTER_2)
            assert rig.sample().damper_velocity == pytest.approx(speed, rel=1e-12, abs=1e-15)
            run(rig, rig.time + 3.0, 300)
            found += 1
            break
    assert found >= 3


def test_change_while_sticking():
    rough = RigParameters(gap=10.0, friction=5.0, gravity=1.0, angle=0.5, force_amplitudes=[0.1])
    rig = Simulator(rough)
    rig.advance(5.0)
    assert rig.mode == Mode.STICK
    rig.change(rough.replace(friction=0.1))
    assert rig.mode == Mode.SLIDE_DOWN
    assert rig.advance(20.0)[0].kind in (EventKind.IMPACT, EventKind.STICK, EventKind.REVERSAL)
    rig = Simulator(rough)
    rig.advance(5.0)
    rig.change(rough.replace(friction=0.0))
    assert rig.mode == Mode.FREE


def test_closing_gap_is_hit_with_the_right_momentum_on_a_moving_rig():
    rig = shaken(friction=0.0)
    sample = rig.sample()
    y, u = sample.z - sample.x, sample.damper_velocity - sample.primary_velocity
    while u * y <= 0 or abs(y) < 0.5:
        rig.advance(rig.time + 0.05)
        sample = rig.sample()
        y, u = sample.z - sample.x, sample.damper_velocity - sample.primary_velocity
    (hit,) = rig.change(rig.parameters.replace(gap=abs(y)))
    assert hit.stop == (1 if y > 0 else 2)
    assert hit.y == pytest.approx(y, abs=8 * EPS * (abs(sample.x) + abs(sample.z)))
    M, m = rig.parameters.primary_mass, rig.parameters.damper_mass
    before = M * sample.primary_velocity + m * sample.damper_velocity
    after = M * hit.primary_velocity_after + m * hit.damper_velocity_after
    assert after == pytest.approx(before, rel=1e-14)
    assert hit.damper_velocity_after - hit.primary_velocity_after == pytest.approx(-0.75 * u)


@pytest.mark.parametrize('closing', [1e-9, 1e-4, 0.03, 0.3])
@pytest.mark.parametrize('side', [1, -1])
def test_stop_that_follows_a_release_arrives_in_time(side, closing):
    """The jerk alone throws m off; the stop goes with it just as far as it was asked to."""
    pressed = RigParameters(
        gap=2.0, angle=side * math.pi / 2, gravity=0.3, damping=0.1, force_amplitudes=[side * 1.0]
    )
    rig = Simulator(pressed, InitialConditions(initial_damper_offset=side * 1.0))
    while rig.mode not in (Mode.REST_1, Mode.REST_2):
        rig.advance(rig.time + 0.01)
    rig.change(pressed.replace(gap=2.0 - 2.0 * closing))
    half, events, time = rig.parameters.gap / 2, [], rig.time
    while not events or events[-1].kind != EventKind.STOP_ARRIVED:
        assert rig.time < time + 100.0
        events += rig.advance(rig.time + 0.003)
        stop = rig.stops[0] if side > 0 else -rig.stops[1]
        assert half * (1 - 4 * EPS) <= stop <= 1.0
    arrived = events[-1]
    before = Simulator(pressed, InitialConditions(initial_damper_offset=side * 1.0))
    before.advance(time)
    before.change(rig.parameters)
    before.advance(math.nextafter(arrived.time, 0.0))
    speed = abs(arrived.damper_velocity_before - arrived.primary_velocity_before)
    blur = 8 * EPS * (1 + abs(arrived.x) + arrived.time * speed)
    assert abs(y_of(before)) == pytest.approx(half, abs=blur)
    assert y_of(rig) * side < half


@pytest.mark.parametrize('speed', [1e-28, 1e-20, 1e-12])
def test_elastic_stop_and_next_to_no_speed(speed):
    """Bounces too small for time itself: m is at rest."""
    rig = Simulator(
        RigParameters(restitution_1=1.0, angle=1.0, force_amplitudes=[0.0]),
        InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=-speed),
    )
    assert len(rig.advance(1.0)) < 10
    assert rig.mode == Mode.REST_1
