"""Passages of X through zero: none missed, none made up, and the motion left alone."""

import itertools
import math
import random
from math import inf

import numpy as np
import pytest

from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters, Simulator
from impact_damper_ros.rig.crossing import first_crossing, starting_side
from oracle.first_root import polish
from oracle.precise_motion import Harmonic, Motion, Oscillator, mp
from rig.random_rigs import random_command, random_rig, through_json

EPS = 2.0**-52
CROSSING = EventKind.CROSSING
# Never hits anything
FREE = RigParameters(gap=1e9, gravity=0.0)


def crossings(rig, until, most=10_000):
    """Advance from passage to passage, and return all events."""
    events = []
    while rig.time < until and len(events) < most:
        new = rig.advance_to_crossing(until)
        events += new
        if new and new[-1].kind == CROSSING:
            assert rig.time == new[-1].time
        else:
            assert rig.time == until
    return events


def instants(events):
    return [e.time for e in events if e.kind == CROSSING]


def precise_crossings(parameters, initial, until, step=0.002):
    """Return the roots of X from a closed form with 110 digits; found by its signs."""
    p = parameters
    rows = zip(p.force_amplitudes, p.force_frequencies, p.force_phases, strict=True)
    oscillator = Oscillator(
        mp.mpf(p.primary_mass),
        mp.mpf(p.damping),
        mp.mpf(p.stiffness),
        [Harmonic(*map(mp.mpf, row)) for row in rows],
    )
    motion = Motion(
        oscillator,
        mp.mpf(0),
        mp.mpf(initial.initial_primary_position),
        mp.mpf(initial.initial_primary_velocity),
        mp.mpf(0),
    )
    taus = np.arange(step / 2, until, step)
    signs = np.sign(motion.grid(taus, 0))
    return [
        polish(motion.derivatives, mp.mpf(taus[k]), mp.mpf(taus[k + 1]))
        for k in np.flatnonzero(signs[:-1] != signs[1:])
    ]


@pytest.mark.parametrize('seed', range(12))
def test_roots_of_a_closed_form(seed):
    """The instants are those of multiprecision to round-off of X over X', and of the time."""
    rng = random.Random(f'roots {seed}')
    count = rng.choice([1, 1, 3])
    parameters = FREE.replace(
        damping=rng.choice([0.0, 0.01, 0.5]),
        force_amplitudes=[rng.uniform(0.1, 2.0) for _ in range(count)],
        force_frequencies=[rng.choice([1.0, rng.uniform(0.2, 6.0)]) for _ in range(count)],
        force_phases=[rng.uniform(-3.0, 3.0) for _ in range(count)],
    )
    initial = InitialConditions(
        initial_primary_position=rng.uniform(-3, 3), initial_primary_velocity=rng.uniform(-3, 3)
    )
    rig = Simulator(parameters, initial)
    events = crossings(rig, 50.0)
    exact = precise_crossings(parameters, initial, 50.0)
    assert len(events) == len(exact) > 5
    for event, root in zip(events, exact, strict=True):
        size = 10.0 + abs(event.primary_velocity_after)
        allowed = 4 * EPS * event.time + 64 * EPS * size / abs(event.primary_velocity_after)
        assert abs(event.time - float(root)) <= allowed
        assert abs(event.x) <= 64 * EPS * size * max(1.0, event.time)
        assert event.primary_velocity_before == event.primary_velocity_after


@pytest.mark.parametrize('seed', range(20))
def test_watching_leaves_the_motion_alone(seed):
    """Events, samples and snapshots have the bits that they have without it."""
    parameters, initial = random_rig(f'cross {seed}')
    plain, watched = Simulator(parameters, initial), Simulator(parameters, initial)
    want = []
    while plain.time < 8.0 and len(want) < 1000:
        want += plain.advance(plain.time + 0.5)
    events = crossings(watched, plain.time)
    assert [e for e in events if e.kind != CROSSING] == want
    assert watched.snapshot() == plain.snapshot()
    assert watched.sample() == plain.sample()
    times = [e.time for e in events]
    assert times == sorted(times)
    passed = instants(events)
    assert len(set(passed)) == len(passed)
    # X has one sign between two of them.
    look = Simulator(parameters, initial)
    for before, after in zip([0.0, *passed], [*passed, plain.time], strict=True):
        signs = set()
        for k in range(1, 60):
            look.advance(before + (after - before) * k / 60)
            signs.add(math.copysign(1.0, look.sample().x))
        assert len(signs) == 1


@pytest.mark.parametrize('seed', range(20))
def test_runs_may_be_cut_up_anywhere(seed):
    """Each passage is met once, by whoever watches then, restored or not."""
    rng = random.Random(seed)
    parameters, initial = random_rig(f'cross {seed}')
    whole, pieces = Simulator(parameters, initial), Simulator(parameters, initial)
    want, got = [], []
    for _ in range(6):
        want += crossings(whole, whole.time + 1.0, 500)
        while pieces.time < whole.time:
            end = min(whole.time, pieces.time + rng.choice([0.0, 1e-9, rng.uniform(0, 0.5)]))
            got += pieces.advance_to_crossing(end)
            if rng.random() < 0.3:
                pieces = through_json(pieces)
        got += pieces.advance_to_crossing(whole.time)
        assert pieces.snapshot() == whole.snapshot()
        command = random_command(rng, whole)
        assert pieces.move_stops(*command) == whole.move_stops(*command)
    assert got == want


@pytest.mark.parametrize('seed', range(20))
def test_acting_at_a_passage_does_not_meet_it_again(seed):
    """The controller's use: a new flight begins where X is zero but for round-off."""
    rng = random.Random(f'act {seed}')
    parameters, initial = random_rig(f'cross {seed}', restitution_1=0.7)
    rig, passed = Simulator(parameters, initial, time=rng.choice([0.0, 1e6 / 3])), []
    start, side = rig.time, 0
    while rig.time < start + 12.0 and len(passed) < 200:
        events = rig.advance_to_crossing(start + 12.0)
        if events and events[-1].kind == CROSSING:
            passed.append(rig.time)
            # From one side to the other, in turns
            heading = math.copysign(1, events[-1].primary_velocity_after)
            assert heading != side
            side = heading
            first, second, _ = random_command(rng, rig)
            rig.move_stops(first, second, rng.choice([inf, 0.5]))
            if rng.random() < 0.5:
                rig.change(rig.parameters.replace(restitution_2=rng.random()))
            if rng.random() < 0.3:
                rig = through_json(rig)
    assert len(set(passed)) == len(passed)
    assert all(b - a > 1e-6 for a, b in itertools.pairwise(passed))


def test_in_every_mode():
    """Sticking, resting, sliding and in flight; M passes zero in all of them."""
    seen = set()
    for seed in range(40):
        rig = Simulator(*random_rig(f'modes {seed}'))
        while rig.time < 15.0 and len(seen) < 8:
            events = rig.advance_to_crossing(min(15.0, rig.time + 1.0))
            if events and events[-1].kind == CROSSING:
                seen.add(rig.mode)
            if len(events) > 300:
                break
    assert seen >= {
        Mode.FREE,
        Mode.SLIDE_DOWN,
        Mode.SLIDE_UP,
        Mode.STICK,
        Mode.REST_1,
        Mode.REST_2,
    }


def test_in_the_last_bounces_of_a_chatter():
    """Where M passes zero during a chatter that is not resolved any more."""
    found = 0
    for seed in range(100):
        rig = Simulator(*random_rig(seed))
        events = []
        while rig.time < 10.0 and len(events) < 300:
            events += rig.advance(rig.time + 0.5)
        for event in events:
            if event.kind != EventKind.REST or event.time == 0.0:
                continue
            before = Simulator(*random_rig(seed))
            before.advance(event.time - 1e-9)
            if before.mode not in (Mode.CHATTER_1, Mode.CHATTER_2):
                continue
            # The same rig with its equilibrium moved to where M is just then
            state = before.snapshot()
            sample = before.sample()
            middle = sample.x + 0.5e-9 * sample.primary_velocity
            state['origin']['x'] -= middle
            moved = Simulator.restore(state)
            found += 1
            (crossing,) = (e for e in moved.advance_to_crossing(event.time) if e.kind == CROSSING)
            assert event.time - 1e-9 < crossing.time < event.time
            break
    assert found >= 3


@pytest.mark.parametrize('depth', [1e-6, 1e-9, 1e-11])
def test_two_passages_close_together(depth):
    """X = cos t - 1 + depth: below zero for a moment at its lowest."""
    rig = Simulator(
        FREE.replace(
            damping=0.0,
            force_amplitudes=[-(1.0 - depth), 0.0],
            force_frequencies=[0.0, 1.0],
            force_phases=[math.pi / 2, 0.0],
        ),
        InitialConditions(initial_primary_position=2.0 - (2.0 - 2.0 * depth)),
    )
    # X'' + X = -(1 - depth): X = -(1 - depth) + (1 + depth) cos t ... touches at t = 0 mod 2 pi
    events = crossings(rig, 6.0)
    amplitude = 2.0 - (2.0 - 2.0 * depth) + (1.0 - depth)
    want = math.acos((1.0 - depth) / amplitude)
    assert instants(events) == pytest.approx([want], rel=1e-9 + 1e-15 / depth)
    events = crossings(rig, 7.0)
    around = [2 * math.pi - want, 2 * math.pi + want]
    assert instants(events) == pytest.approx(around, rel=1e-9)


def test_a_touch_of_zero_is_no_passage():
    """X = 1 - cos t."""
    rig = Simulator(
        FREE.replace(
            damping=0.0,
            force_amplitudes=[1.0],
            force_frequencies=[0.0],
            force_phases=[math.pi / 2],
        )
    )
    assert rig.advance_to_crossing(30.0) == []
    assert rig.time == 30.0


def test_the_start_from_rest_is_no_passage():
    """X = (sin t - t cos t)/2 in the undamped rig: it leaves zero by its jerk."""
    rig = Simulator(FREE.replace(damping=0.0))
    (event,) = rig.advance_to_crossing(5.0)
    assert event.time == pytest.approx(4.493409457909064, rel=4 * EPS)
    # From above, as the first lobe is positive
    assert event.primary_velocity_after < 0.0


def test_m_at_rest_does_not_pass():
    rig = Simulator(FREE.replace(force_amplitudes=[0.0]))
    assert rig.advance_to_crossing(1e3) == []
    assert rig.time == 1e3


def test_an_impact_at_the_very_passage():
    """The events of the instant come first, and the passage is not lost."""
    base = RigParameters(
        gravity=0.0, damping=0.0, damper_mass=1e-9, gap=2.0, force_amplitudes=[0.0]
    )
    for nudge in range(-6, 7):
        # X = -cos t passes zero at pi/2 with velocity 1; m arrives there at stop 1.
        speed = 2.0 / (math.pi / 2) + nudge * 2.0**-51
        rig = Simulator(
            base,
            InitialConditions(
                initial_primary_position=-1.0,
                initial_damper_offset=0.0,
                initial_damper_velocity=speed,
            ),
        )
        events = crossings(rig, 2.0)
        kinds = [e.kind for e in events]
        assert sorted(kinds) == [EventKind.IMPACT, CROSSING]
        assert events[0].time == pytest.approx(events[1].time, abs=1e-13)
        assert [e.time for e in events] == sorted(e.time for e in events)


def test_a_shift_of_the_equilibrium_is_no_passage():
    rig = Simulator(FREE.replace(gravity=1.0), InitialConditions(initial_primary_position=0.1))
    rig.advance(0.1)
    rig.change(rig.parameters.replace(angle=0.5))
    assert rig.sample().x < 0.0
    assert instants(rig.advance_to_crossing(0.2)) == []


def test_the_side_at_the_start_is_the_first_derivative_that_tells():
    for values, side in (((1e-3, -1.0), 1), ((0.0, -1.0), -1), ((0.0, 0.0), 1)):
        x, velocity = values
        rig = Simulator(
            FREE,
            InitialConditions(initial_primary_position=x, initial_primary_velocity=velocity),
        )
        assert starting_side(rig._flight, 0) == side
        assert starting_side(rig._flight, -side) == -side


def test_nodes_do_not_depend_on_the_limit():
    rig = Simulator(FREE, InitialConditions(initial_primary_position=1.0))
    whole = first_crossing(rig._flight, 1, 0.0, 50.0)
    node = 0.0
    for k in range(1000):
        found = first_crossing(rig._flight, 1, node, 0.05 * k)
        node = found[2]
        if found[0]:
            break
    assert found == whole
