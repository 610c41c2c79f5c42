"""Parameter changes in flight: exact, at one instant, and as the design defines them."""

import math
import random

import pytest
from hypothesis import example, given, strategies as st
from motion.random_rigs import random_change, random_rig, run, through_json
from rigs import STILL

from impact_damper_ros import EventKind, InitialConditions, Mode, Rig, RigParameters

EPS = 2.0**-52
IMPACT, ARRIVED = EventKind.IMPACT, EventKind.STOP_ARRIVED


def mirrored(side, parameters, offset=0.0, velocity=0.0):
    """Return a rig with m thrown towards stop 1, or for -1 towards stop 2, under its weight."""
    return Rig(
        parameters.replace(angle=side * parameters.angle),
        InitialConditions(
            initial_damper_offset=side * offset, initial_damper_velocity=side * velocity
        ),
    )


def y_of(rig):
    sample = rig.sample()
    return sample.z - sample.x


@pytest.mark.parametrize('side', [1, -1])
@pytest.mark.parametrize(
    ('place', 'changes', 'end', 'expected'),
    [
        # It follows m without doing work; the other stop was closed at once.
        (4.0, {0.5: 4.0}, 6.5, [(ARRIVED, 1, 2.0), (IMPACT, 2, 6.0)]),
        (4.0, {0.0: 2.0, 0.5: 10.0}, 9.5, [(IMPACT, 2, 9.0)]),
        (4.0, {0.0: 6.0, 0.5: 2.0}, 4.5, [(ARRIVED, 1, 3.0)]),
    ],
    ids=['closing', 'opening on the way', 'closing on the way'],
)
def test_gap_while_m_moves_inwards(place, changes, end, expected, side):
    """What holds of commands to both stops, one after another (test_moving_stops), too."""
    rig, told = mirrored(side, STILL, place, -1.0), []
    for time, gap in changes.items():
        told += rig.advance(time)
        told += rig.change(rig.parameters.replace(gap=gap))
    told += rig.advance(end)
    stop = {1: (0, 1, 2), -1: (0, 2, 1)}[side]
    want = [(kind, stop[n], pytest.approx(t, rel=1e-8)) for kind, n, t in expected]
    assert [(e.kind, e.stop, e.time) for e in told] == want
    assert rig.stops == (0.5 * gap, -0.5 * gap)


@pytest.mark.parametrize('side', [1, -1])
def test_reversing_while_the_stop_follows(side):
    """M turns back onto the following stop and rests on it; turned over, both go on."""
    pulled = STILL.replace(stiffness=1e12, gravity=1.0, angle=math.pi / 2)
    rig = mirrored(side, pulled, 4.0, -1.0)
    assert rig.change(rig.parameters.replace(gap=2.0)) == []
    (event,) = rig.advance(1.5)
    assert (event.kind, event.time) == (EventKind.REST, pytest.approx(1.0, rel=1e-8))
    assert event.y == pytest.approx(3.5 * side, rel=1e-8)
    assert rig.mode == (Mode.REST_1 if side > 0 else Mode.REST_2)
    rig.change(rig.parameters.replace(angle=-side * math.pi / 2))
    kinds = [e.kind for e in rig.advance(rig.time + 2.6)]
    assert [k for k in kinds if k != EventKind.RELEASE] == [ARRIVED]
    assert rig.stops == (1.0, -1.0)


def shaken():
    """Return a rig on the way, m in flight."""
    rig = Rig(RigParameters(angle=0.6, gravity=1.0, friction=0.1, gap=8.0, damping=0.1))
    rig.advance(20.0)
    return rig


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


def test_the_force_goes_on_from_its_angles():
    """Amplitude and phase act at once; an added harmonic starts at its phase."""
    rig, angles = Rig(RigParameters(gap=1e6, gravity=0.0, damping=0.0)), [0.0]
    for amplitudes, frequencies, phases in (
        ([1.0], [1.7], [0.0]),
        ([1.0], [0.4], [0.0]),
        ([3.0], [0.4], [1.0]),
        ([1.0, 2.0, 4.0], [1.0, 3.0, 5.0], [0.0, 0.5, -1.0]),
        ([1.0, 2.0], [1.0, 2.9], [0.0, 0.5]),
        # The third one starts anew.
        ([1.0, 2.0, 4.0], [1.0, 3.0, 5.0], [0.0, 0.5, -1.0]),
    ):
        before = rig.parameters.force_frequencies
        rig.advance(rig.time + 2.3)
        angles = [a + 2.3 * w for a, w in zip(angles, before, strict=True)]
        names = ('force_amplitudes', 'force_frequencies', 'force_phases')
        changed = dict(zip(names, (amplitudes, frequencies, phases), strict=True))
        rig.change(rig.parameters.replace(**changed))
        angles = [*angles, 0.0, 0.0][: len(phases)]
        rows = zip(amplitudes, angles, phases, strict=True)
        want = sum(f * math.sin(a + p) for f, a, p in rows) - rig.sample().x
        assert acceleration(rig) == pytest.approx(want, abs=1e-5)


def test_one_sided_both_ways():
    """Without stop 2, m flies on; when the stop comes back it comes up to m."""
    rig = mirrored(1, STILL.replace(one_sided=True), 0.0, -1.0)
    assert rig.advance(8.0) == []
    assert y_of(rig) == pytest.approx(-8.0, rel=EPS)
    (hit,) = rig.change(STILL)
    assert (hit.kind, hit.stop) == (EventKind.IMPACT, 2)
    assert hit.y == pytest.approx(-8.0, rel=EPS)
    (arrived,) = rig.advance(12.5)
    assert (arrived.kind, arrived.stop, arrived.y) == (EventKind.STOP_ARRIVED, 2, -5.0)
    assert arrived.time == pytest.approx(8.0 + 3.0 / 0.75, rel=1e-5)
    rig.change(STILL.replace(one_sided=True))
    rig = mirrored(1, STILL, 0.0, -1.0)
    rig.advance(4.0)
    assert rig.change(STILL.replace(one_sided=True)) == []
    assert rig.advance(40.0) == []
    assert y_of(rig) == pytest.approx(-40.0, rel=2 * EPS)


def test_one_sided_while_resting_on_stop_2():
    upside = STILL.replace(angle=-math.pi / 2, gravity=1.0)
    rig = mirrored(1, upside, -5.0)
    assert rig.mode == Mode.REST_2
    rig.advance(1.0)
    rig.change(upside.replace(one_sided=True))
    assert rig.mode == Mode.FREE
    rig.advance(3.0)
    assert y_of(rig) == pytest.approx(-7.0, rel=1e-5)


@given(seed=st.integers(0, 10**9))
@example(2869)
@example(3323)
@example(4879)
@example(5369)
@example(6203)
@example(6217)
def test_changes_keep_the_state(seed):
    """Y, the velocities and places in the laboratory are continuous but for an impact."""
    rng = random.Random(f'journey {seed}')
    parameters, initial = random_rig(seed, damping=0.1)
    rig, events = Rig(parameters, initial), []
    for _ in range(20):
        new = run(rig, rig.time + rng.choice([0.01, rng.uniform(0, 3)]), 300)
        before, old = rig.sample(), rig.parameters
        hits = rig.change(random_change(rng, rig.parameters))
        sample, (stop_1, stop_2), half = rig.sample(), rig.stops, rig.parameters.gap / 2
        y = sample.z - sample.x
        lab = old.static_deflection, rig.parameters.static_deflection
        blur = 8 * EPS * (sum(map(abs, (sample.x, sample.z, *lab))) + stop_1)
        if not hits:
            assert y == pytest.approx(before.z - before.x, abs=2 * blur + 1e-14 * abs(before.x))
            assert sample.x + lab[1] == pytest.approx(before.x + lab[0], abs=blur)
            assert sample[2:5:2] == pytest.approx(before[2:5:2], rel=1e-13, abs=1e-13)
        # No stop is passed; one is beyond its place only where m holds it back.
        assert half <= stop_1
        assert y <= stop_1 + blur
        assert stop_1 == half or y == pytest.approx(stop_1, abs=blur)
        if not rig.parameters.one_sided:
            assert stop_2 - blur <= y
            assert stop_2 <= -half
            assert stop_2 == -half or y == pytest.approx(stop_2, abs=blur)
        assert all(map(math.isfinite, sample))
        events += [*new, *hits]
    times = [e.time for e in events]
    assert times == sorted(times)


def test_change_while_sticking():
    rough = RigParameters(gap=10.0, friction=5.0, gravity=1.0, angle=0.5, force_amplitudes=[0.1])
    rig = Rig(rough)
    rig.advance(5.0)
    assert rig.mode == Mode.STICK
    rig.change(rough.replace(friction=0.1))
    assert rig.mode == Mode.SLIDE_DOWN
    assert rig.advance(20.0)[0].kind in (EventKind.IMPACT, EventKind.STICK, EventKind.REVERSAL)
    rig = Rig(rough)
    rig.advance(5.0)
    rig.change(rough.replace(friction=0.0))
    assert rig.mode == Mode.FREE


@pytest.mark.parametrize('closing', [1e-9, 1e-4, 0.03, 0.3])
@pytest.mark.parametrize('side', [1, -1])
def test_stop_that_follows_a_release_arrives_in_time(side, closing):
    """The jerk alone throws m off; the stop goes with it just as far as it was asked to."""
    pressed = RigParameters(
        gap=2.0, angle=side * math.pi / 2, gravity=0.3, damping=0.1, force_amplitudes=[side * 1.0]
    )
    rig = Rig(pressed, InitialConditions(initial_damper_offset=side * 1.0))
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
    before = Rig(pressed, InitialConditions(initial_damper_offset=side * 1.0))
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
    rig = Rig(
        RigParameters(restitution_1=1.0, angle=1.0, force_amplitudes=[0.0]),
        InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=-speed),
    )
    assert len(rig.advance(1.0)) < 10
    assert rig.mode == Mode.REST_1
