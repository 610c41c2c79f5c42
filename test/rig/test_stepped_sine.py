"""Stepped sine: exact instants, continuous phase, up and down through the same frequencies."""

import math
import random

import numpy as np
import pytest

from impact_damper_ros.control import Outcome, Rig
from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters
from impact_damper_ros.rig.forcing import frequency_at, frequency_steps
from rig.random_rigs import random_rig, rows, through_json, without_mode

STEP = EventKind.FREQUENCY_STEP
SWEPT = RigParameters(
    gravity=0.0,
    gap=1e6,
    damping=0.1,
    sweep_mode='up',
    sweep_low=0.8,
    sweep_high=1.3,
    sweep_step=0.2,
    sweep_dwell=0.1,
)
UP = [0.8, 1.0, 0.8 + 2 * 0.2, 1.3]


def steps(events):
    return [e for e in events if e.kind == STEP]


@pytest.mark.parametrize(
    ('mode', 'frequencies'),
    [('up', UP), ('down', UP[::-1]), ('up_down', UP + UP[-2::-1]), ('off', [1.0])],
)
def test_the_frequencies_of_a_sweep(mode, frequencies):
    """The last step up is shorter, and down goes through the same ones."""
    rig = SWEPT.replace(sweep_mode=mode)
    assert frequency_steps(rig) == len(frequencies) - 1
    assert [frequency_at(rig, k) for k in range(len(frequencies))] == frequencies
    # The last one holds.
    assert frequency_at(rig, len(frequencies) + 5) == frequencies[-1]


def test_a_whole_number_of_steps_ends_with_the_last():
    rig = SWEPT.replace(sweep_low=0.5, sweep_high=1.5, sweep_step=0.01)
    assert frequency_steps(rig) == 100
    assert frequency_at(rig, 100) == 1.5
    assert frequency_steps(rig.replace(sweep_step=7.0)) == 1


@pytest.mark.parametrize('start', [0.0, 1e6 / 3])
def test_steps_are_at_exact_instants(start):
    """Start + n dwell, rounded once, however far along."""
    rig = Rig(SWEPT.replace(sweep_step=0.0005), time=start)
    assert rig.force_frequency == 0.8
    events = rig.advance(start + 200.0)
    assert [e.time for e in events] == [start + k * 0.1 for k in range(1, 1001)]
    assert {e.kind for e in events} == {STEP}
    assert rig.force_frequency == 1.3
    assert rig.parameters.force_frequencies == (1.0,)
    for e in events:
        assert e.primary_velocity_before == e.primary_velocity_after
        assert e.impulse == 0.0


def test_a_sweep_is_a_series_of_changes():
    """Of the frequency alone, at the same instants: the phase is continuous."""
    swept = Rig(SWEPT.replace(sweep_mode='up_down', sweep_step=0.01, sweep_dwell=0.37))
    hand = Rig(SWEPT.replace(sweep_mode='off', force_frequencies=[0.8]))
    for k in range(1, 101):
        (event,) = swept.advance(k * 0.37)
        assert event.kind == STEP
        hand.advance(k * 0.37)
        frequency = frequency_at(swept.parameters, k)
        assert swept.force_frequency == frequency
        hand.change(hand.parameters.replace(force_frequencies=[frequency]))
        a, b = swept.sample(), hand.sample()
        assert (a.x, a.primary_velocity) == pytest.approx((b.x, b.primary_velocity), abs=1e-13)
    assert swept.advance(60.0) == []
    assert swept.force_frequency == 0.8


def test_fine_steps_are_a_chirp():
    """The phase is the integral of the frequency; the remainder vanishes with the step."""
    angles = []
    for fine in (1e-2, 1e-3):
        rate = 0.01
        rig = Rig(SWEPT.replace(sweep_step=fine, sweep_dwell=fine / rate))
        rig.advance(40.0)
        origin = rig.snapshot()['origin']
        angles.append(origin['angles'][0] + rig.force_frequency * (40.0 - origin['time']))
    exact = 0.8 * 40.0 + rate * 40.0**2 / 2
    # Half a step behind on the way
    for fine, angle in zip((1e-2, 1e-3), angles, strict=True):
        assert math.remainder(angle - (exact - fine / 2 * 40.0), math.tau) == pytest.approx(
            0.0, abs=1e-10
        )


def test_the_response_curve_of_the_linear_rig():
    """At the end of each dwell the amplitude is that of the theory, up and down."""
    rig = Rig(SWEPT.replace(sweep_mode='up_down', sweep_step=0.1, sweep_dwell=300.0, damping=0.2))
    for k in range(11):
        frequency = rig.force_frequency
        rig.advance((k + 1) * 300.0 - math.tau / frequency)
        largest = 0.0
        for j in range(400):
            rig.advance((k + 1) * 300.0 - math.tau / frequency * (1 - (j + 1) / 401))
            largest = max(largest, abs(rig.sample().x))
        theory = SWEPT.replace(damping=0.2, force_frequencies=[frequency]).response_amplitude
        assert largest == pytest.approx(theory, rel=1e-4)
        rig.advance((k + 1) * 300.0)


def test_up_and_down_differ_where_two_motions_are_stable():
    """On the way up m does not reach the stops; on the way down it hits them twice a cycle."""
    parameters = RigParameters(
        gravity=0.0,
        gap=37.0,
        sweep_mode='up_down',
        sweep_low=0.92,
        sweep_high=1.02,
        sweep_step=0.02,
        sweep_dwell=4000.0,
    )
    rig, seen = Rig(parameters), {}
    for step in range(frequency_steps(parameters) + 1):
        frequency, end = rig.force_frequency, (step + 1) * 4000.0
        rig.advance(end - 200.0)
        largest, hits = 0.0, 0
        while rig.time < end - 1.0:
            hits += sum(e.kind == EventKind.IMPACT for e in rig.advance(rig.time + 0.1))
            largest = max(largest, abs(rig.sample().x))
        seen.setdefault(round(frequency, 9), []).append((largest, hits))
        rig.advance(end)
    for frequency in (0.92, 0.94):
        (up, none), (down, hits) = seen[frequency]
        free = parameters.replace(force_frequencies=[frequency]).response_amplitude
        assert none == 0
        assert up == pytest.approx(free, rel=3e-3)
        assert down > 1.7 * up
        assert hits == pytest.approx(2.0 * 199.0 * frequency / math.tau, abs=1.1)
    # Nearer to resonance there is one motion.
    (up, _), (down, _) = seen[1.0]
    assert up == pytest.approx(down, rel=1e-3)


def test_changes_on_the_way():
    """Those of the sweep start it anew; others leave it where it is, and so does time."""
    rig = Rig(SWEPT)
    rig.advance(0.25)
    assert rig.force_frequency == 0.8 + 2 * 0.2
    rig.change(rig.parameters.replace(gap=1e5, force_amplitudes=[2.0]))
    assert rig.force_frequency == 0.8 + 2 * 0.2
    assert [e.time for e in rig.advance(0.28)] == []
    rig.change(rig.parameters.replace(sweep_dwell=0.05))
    assert rig.force_frequency == 0.8
    assert [e.time for e in rig.advance(0.4)] == [0.28 + 0.05, 0.28 + 2 * 0.05]
    rig.change(rig.parameters.replace(sweep_mode='off'))
    assert rig.force_frequency == 1.0
    assert rig.advance(9.0) == []
    rig.change(rig.parameters.replace(sweep_mode='down', sweep_dwell=0.5))
    assert rig.force_frequency == 1.3
    assert [e.time for e in rig.advance(10.0)] == [9.5, 10.0]
    rig.reset()
    assert rig.force_frequency == 1.3
    assert [e.time for e in rig.advance(10.6)] == [10.5]


def test_other_harmonics_and_the_multisine_are_left_alone():
    rig = Rig(
        SWEPT.replace(
            force_amplitudes=[1, 1],
            force_frequencies=[1, 3],
            force_phases=[0, 0],
            multisine_level=0.1,
            multisine_lines=3,
        )
    )
    rig.advance(0.75)
    origin = rig.snapshot()['origin']
    since = 0.75 - origin['time']
    want = [0.1 * (0.8 + 1.0 + 1.2) + 0.45 * 1.3, 0.75 * 3.0]
    want += [0.75 * w for w in rig.parameters.harmonics[1][2:]]
    frequencies = (rig.force_frequency, *rig.parameters.harmonics[1][1:])
    got = [a + w * since for a, w in zip(origin['angles'], frequencies, strict=True)]
    assert got == pytest.approx(want, abs=1e-13)


def swept_rig(seed):
    # One harmonic, or nine: loops are compiled for one, and for any number of more than eight.
    rng = random.Random(seed)
    drive = {'force_amplitudes': [1.0], 'force_frequencies': [0.9], 'force_phases': [0.1]}
    parameters, initial = random_rig(f'sweep {seed}', **drive)
    return (
        parameters.replace(
            restitution_1=min(0.9, parameters.restitution_1),
            sweep_mode=rng.choice(['up', 'down', 'up_down']),
            sweep_low=0.5,
            sweep_high=2.5,
            sweep_step=rng.choice([0.05, 0.3]),
            sweep_dwell=rng.choice([0.05, 0.31]),
            multisine_level=rng.choice([0.0, 0.2]),
            multisine_lines=8,
        ),
        initial,
    )


@pytest.fixture(params=[False, True], ids=['plain', 'compiled'])
def compiled(request):
    if request.param:
        pytest.importorskip('numba')
    return request.param


def test_long_runs_sweep_as_the_simulator_does(compiled):
    """Samples, events and snapshots to the last bit, at and between the steps."""
    modes, kinds = set(), set()
    for seed in range(40):
        rng = random.Random(seed)
        rig = Rig(*swept_rig(seed))
        run = Rig(*swept_rig(seed), compiled=compiled)
        for _ in range(5):
            # Some advances end, and some samples lie, at the very instant of a step
            dwell = rig.parameters.sweep_dwell
            end = rng.choice([dwell * (1 + int(rig.time / dwell)), rig.time + rng.uniform(0, 2)])
            end = max(end, rig.time)
            instants = {rig.time, *(rng.uniform(rig.time, end) for _ in range(4)), end}
            instants |= {t for k in range(90) if rig.time <= (t := k * dwell) <= end}
            events, samples = [], []
            begun = rig.time
            for instant in sorted(instants):
                events += rig.advance(instant)
                samples.append(tuple(rig.sample()))
            stretch = run.run(end, sorted(instants))
            assert stretch.outcome == Outcome.COMPLETE
            assert stretch.samples.tolist() == samples
            assert without_mode(stretch.events) == rows(events)
            assert run.snapshot() == rig.snapshot()
            assert run.force_frequency == rig.force_frequency
            assert stretch.time_in_mode.sum() == pytest.approx(end - begun, abs=1e-12)
            modes |= set(stretch.events['mode'].tolist())
            kinds |= set(stretch.events['kind'].tolist())
            if rng.random() < 0.3:
                run = Rig.restore(through_json(rig).snapshot(), compiled=compiled)
            elif rng.random() < 0.3:
                rig = Rig.restore(run.snapshot())
            command = rig.parameters.replace(sweep_dwell=rng.choice([0.05, 0.31]))
            if rng.random() < 0.3:
                assert run.change(command) == rig.change(command)
    assert modes >= {Mode.FREE, Mode.SLIDE_DOWN, Mode.SLIDE_UP, Mode.STICK, Mode.REST_1}
    assert kinds >= {EventKind.IMPACT, EventKind.REST, EventKind.STICK, EventKind.RELEASE, STEP}


def test_time_in_mode_across_steps(compiled):
    """What lies between the events, whatever the sweep cuts it into."""
    parameters = SWEPT.replace(
        angle=math.pi / 4, gravity=1.0, friction=0.5, gap=37.0, sweep_mode='up_down'
    )
    run = Rig(parameters, compiled=compiled)
    parts = [run.run(t) for t in (0.15, 0.7, 40.0)]
    events = np.concatenate([part.events for part in parts])
    release = events['time'][events['kind'] == EventKind.RELEASE]
    stick = events['time'][events['kind'] == EventKind.STICK]
    assert len(release) == len(stick) > 1
    spent = sum(part.time_in_mode for part in parts)
    assert spent[Mode.STICK] == pytest.approx(release.sum() - stick.sum(), rel=1e-12)


def test_the_budget_of_events_holds_across_steps(compiled):
    """Steps count; the rig stops short of one it may not have any more, and goes on from there."""
    rig = SWEPT.replace(sweep_step=0.0005)
    run = Rig(rig, compiled=compiled)
    stretch = run.run(200.0, [0.0, 0.7, 0.71, 9.0], most_events=7)
    assert stretch.outcome == Outcome.TOO_MANY_EVENTS
    assert stretch.reason.startswith('7 events from 0.0 s to 0.8 s')
    assert stretch.event_count == len(stretch.events) == 7
    assert stretch.samples['time'].tolist() == [0.0, 0.7, 0.71]
    assert run.time == 0.8
    rest = run.run(200.0)
    assert rest.event_count == 1000 - 7
    alone = Rig(rig)
    assert rows(alone.advance(200.0)) == without_mode(stretch.events) + without_mode(rest.events)
    assert run.snapshot() == alone.snapshot()
    silent = Rig(rig, compiled=compiled)
    assert silent.run(200.0, record=False).event_count == 1000
    assert silent.snapshot() == alone.snapshot()


def test_a_signal_leaves_a_long_run_where_it_was(compiled, monkeypatch):
    """Not with the frequency of one instant and the motion of another."""
    run = Rig(SWEPT, compiled=compiled)
    run.run(0.05)
    before = run.snapshot(), run.force_frequency

    def ring(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr('impact_damper_ros.control.rig.constants_of', ring)
        with pytest.raises(KeyboardInterrupt):
            run.run(0.15)
    assert (run.snapshot(), run.force_frequency) == before
    alone = Rig(SWEPT)
    alone.advance(0.2)
    run.run(0.2)
    assert run.snapshot() == alone.snapshot()


def test_m_at_rest_stays_at_rest():
    """A step of the frequency is no change of the force at its instant: nothing is released."""
    pressed = SWEPT.replace(
        gap=2.0, gravity=1.0, angle=math.pi / 2, force_amplitudes=[0.01], sweep_dwell=0.01
    )
    rig = Rig(pressed, InitialConditions(initial_damper_offset=1.0))
    assert {e.kind for e in rig.advance(0.5)} == {STEP}
