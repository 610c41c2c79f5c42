"""Stepped sine: its steps, their instants, and the motion of a rig and its base through them."""

import json
import math

import numpy as np
import pytest
from motion.random_rigs import rows, without_mode
from rigs import TABLE

from impact_damper_ros import EventKind, InitialConditions, Outcome, Rig, RigParameters
from impact_damper_ros.rig.stepped_sine import (
    FirstAngle,
    SteppedSine,
    rig_at,
    step_count,
    stepped_sine,
)

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


def frequency_after(rig, step):
    return rig_at(rig, step).first_harmonic[1]


def turned(got, want):
    assert [math.sin(a) for a in got] == pytest.approx([math.sin(a) for a in want], abs=1e-12)


@pytest.mark.parametrize(
    ('mode', 'frequencies'),
    [('up', UP), ('down', UP[::-1]), ('up_down', UP + UP[-2::-1]), ('off', [1.0])],
)
def test_the_frequencies_of_a_sweep(mode, frequencies):
    """The last step up is shorter, and down goes through the same ones."""
    rig = SWEPT.replace(sweep_mode=mode)
    assert step_count(rig) == len(frequencies) - 1
    assert [frequency_after(rig, k) for k in range(len(frequencies))] == frequencies
    # The last one holds.
    assert frequency_after(rig, len(frequencies) + 5) == frequencies[-1]


def test_a_whole_number_of_steps_ends_with_the_last():
    rig = SWEPT.replace(sweep_low=0.5, sweep_high=1.5, sweep_step=0.01)
    assert step_count(rig) == 100
    assert frequency_after(rig, 100) == 1.5
    assert step_count(rig.replace(sweep_step=7.0)) == 1


def test_a_notch_is_a_power_of_the_frequency_between_its_points():
    """And constant below the first and above the last one."""
    notch = {'sweep_notch_frequencies': [0.9, 1.0, 1.2], 'sweep_notch_factors': [1.0, 0.2, 0.6]}
    rig = SWEPT.replace(sweep_step=0.05, force_amplitudes=3.0, **notch)
    found = {
        frequency_after(rig, k): rig_at(rig, k).force_amplitudes[0] / 3.0
        for k in range(step_count(rig) + 1)
    }
    assert len(found) == 11
    for frequency, factor in found.items():
        if frequency < 1.0:
            share = math.log(max(frequency, 0.9) / 0.9) / math.log(1.0 / 0.9)
            expected = 0.2**share
        else:
            share = math.log(min(frequency, 1.2)) / math.log(1.2)
            expected = 0.2 * 3.0**share
        assert factor == pytest.approx(expected, rel=1e-12)


def test_the_first_angle_goes_on_through_a_step():
    rig = RigParameters(force_frequencies=0.5 * math.tau)
    angle = FirstAngle.of(rig, 2.0, 0.25 * math.tau)
    assert angle.at(5.0) == pytest.approx(0.25 + 3.0 * 0.5)
    later = angle.after_step(5.0, rig.replace(force_frequencies=2.0 * math.tau))
    assert (later.at(5.0), later.at(5.5)) == pytest.approx((angle.at(5.0), angle.at(5.0) + 1.0))


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'start': 0.1}, r'sweep.step is 2, from 0.3\d* s to 0.3\d* s: it must be the one at'),
        ({'step': 3}, 'sweep.due is 0.3'),
        ({'due': 12.0}, r'sweep.due is 12.0 s: it must be at most'),
        (
            {'due': -1e300},
            r'sweep.step is 2, from 0.2 s to -1e\+300 s: it must be the one at time',
        ),
        ({'due': math.nan}, 'sweep.step is 2, from 0.2 s to nan s'),
        ({'due': 'soon'}, 'snapshot is not complete'),
        ({'due': 0.2}, r'sweep.step is 2, from 0.2 s to 0.2 s: it must be the one at time'),
    ],
)
def test_a_snapshot_has_the_step_of_its_instant(values, words):
    rig = Rig(SWEPT)
    rig.advance(0.25)
    held = rig.snapshot()
    assert (held['sweep']['step'], held['sweep']['due']) == (2, pytest.approx(0.3))
    Rig.restore(held)
    with pytest.raises(ValueError, match=words):
        Rig.restore({**held, 'sweep': {**held['sweep'], **values}})


@pytest.mark.parametrize('start', [0.0, 1e6 / 3])
def test_steps_are_at_exact_instants(start):
    """Start + n dwell, rounded once, however far along."""
    rig = Rig(SWEPT.replace(sweep_step=0.005), time=start)
    assert rig.force_frequency == 0.8
    events = rig.advance(start + 200.0)
    assert [e.time for e in events] == [start + k * 0.1 for k in range(1, 101)]
    assert {e.kind for e in events} == {STEP}
    assert rig.force_frequency == 1.3
    assert rig.parameters.force_frequencies == (1.0,)
    for e in events:
        assert e.primary_velocity_before == e.primary_velocity_after
        assert e.impulse == 0.0


def test_a_sweep_is_a_series_of_changes():
    """Of the first frequency alone, at the same instants: the phases are continuous."""
    own = {'force_amplitudes': [1, 1], 'force_frequencies': [1, 3], 'force_phases': [0, 0]}
    rig = SWEPT.replace(**own, multisine_level=0.1, multisine_lines=3, sweep_dwell=0.37)
    swept = Rig(rig.replace(sweep_mode='up_down', sweep_step=0.01))
    hand = Rig(rig.replace(sweep_mode='off', force_frequencies=[0.8, 3]))
    for k in range(1, 101):
        (event,) = swept.advance(k * 0.37)
        assert event.kind == STEP
        hand.advance(k * 0.37)
        frequency = frequency_after(swept.parameters, k)
        assert swept.force_frequency == frequency
        hand.change(hand.parameters.replace(force_frequencies=[frequency, 3]))
        a, b = swept.sample(), hand.sample()
        assert (a.x, a.primary_velocity) == pytest.approx((b.x, b.primary_velocity), abs=1e-13)
    turned(swept.snapshot()['origin']['angles'], hand.snapshot()['origin']['angles'])
    assert swept.advance(60.0) == []
    assert swept.force_frequency == 0.8


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
    assert len(rig.advance(11.5)) == 2
    rig.change(rig.parameters.replace(gap=1e4))
    assert rig.advance(14.0) == []


def test_the_budget_of_events_holds_across_steps():
    """Steps count; the rig stops short of one it may not have any more, and goes on from there."""
    rig = SWEPT.replace(sweep_step=0.005)
    run = Rig(rig)
    stretch = run.run(20.0, [0.0, 0.7, 0.71, 9.0], most_events=7)
    assert stretch.outcome == Outcome.TOO_MANY_EVENTS
    assert stretch.reason.startswith('7 events from 0.0 s to 0.8 s')
    assert stretch.event_count == len(stretch.events) == 7
    assert stretch.samples['time'].tolist() == [0.0, 0.7, 0.71]
    assert run.time == 0.8
    rest = run.run(20.0)
    assert rest.event_count == 100 - 7
    alone = Rig(rig)
    assert rows(alone.advance(20.0)) == without_mode(stretch.events) + without_mode(rest.events)
    assert run.snapshot() == alone.snapshot()
    silent = Rig(rig)
    assert silent.run(20.0, record=False).event_count == 100
    assert silent.snapshot() == alone.snapshot()


def test_a_signal_leaves_a_long_run_where_it_was(monkeypatch):
    """Not with the frequency of one instant and the motion of another."""
    run = Rig(SWEPT)
    run.run(0.05)
    before = run.snapshot(), run.force_frequency

    def ring(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr('impact_damper_ros.rig.rig_state.constants_of', ring)
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


# A base of constant acceleration: its displacement changes with the frequency


SHAKEN = TABLE.replace(
    gap=0.016,
    base_amplitudes=2.0,
    base_frequencies=1.0,
    base_phases=0.7,
    sweep_mode='up_down',
    sweep_low=40.0,
    sweep_high=80.0,
    sweep_step=3.0,
    sweep_dwell=0.7,
)


def test_a_dashpot_releases_m_where_the_velocity_of_the_base_jumps():
    """C b' steps with the frequency, and with it what m needs from its support."""
    rig = RigParameters(
        friction=0.4,
        gravity=1.0,
        gap=1000.0,
        damping=1.0,
        force_amplitudes=0.0,
        base_amplitudes=1.0,
        base_quantity='displacement',
        sweep_mode='up',
        sweep_low=0.5,
        sweep_high=3.0,
        sweep_step=1.0,
        sweep_dwell=5.0,
    )

    def at_the_step(parameters):
        events = Rig(parameters).advance(5.5)
        return [event.kind for event in events if event.time == 5.0]

    assert at_the_step(rig) == [EventKind.FREQUENCY_STEP, EventKind.RELEASE]
    # Held by more, m stays where it is, and without a dashpot nothing jumps.
    assert at_the_step(rig.replace(friction=4.0)) == [EventKind.FREQUENCY_STEP]
    assert at_the_step(rig.replace(damping=0.0)) == [EventKind.FREQUENCY_STEP]


def shaken(quantity, compiled=False, **more):
    rig = SHAKEN.replace(base_quantity=quantity, **more)
    if quantity != 'acceleration':
        size = 2.0 / 60.0 ** {'velocity': 1, 'displacement': 2}[quantity]
        rig = rig.replace(base_amplitudes=size)
    return Rig(rig, compiled=compiled)


@pytest.mark.parametrize('quantity', ['acceleration', 'velocity'])
def test_steps_of_a_base_wait_for_an_upward_zero(quantity):
    """B is continuous, and its displacement is that of the constant level at each frequency."""
    rig = shaken(quantity)
    power = {'acceleration': 2, 'velocity': 1}[quantity]
    level = rig.parameters.base_amplitudes[0]
    found = []
    while len(found) < 28:
        before = rig.sample()
        events = rig.run(rig.time + 0.01).events
        times = events['time'][events['kind'] == STEP].tolist()
        found += [(time, rig.force_frequency) for time in times]
        # b never moves faster than b' allows: it does not jump
        moved = rig.sample().base - before.base
        assert abs(moved) < 1.01 * 0.01 * level / 40.0 ** (power - 1)
    times, frequencies = np.array(found).T
    ways = [*range(43, 80, 3), 80.0, *range(79, 39, -3)]
    assert frequencies.tolist() == [float(w) for w in ways]
    assert step_count(rig.parameters) == len(ways) == 28
    present = np.array([40.0, *frequencies])
    # At each step b is zero and rises: the angles from step to step are whole turns.
    phase = 0.7 - {'acceleration': math.pi, 'velocity': 0.5 * math.pi}[quantity]
    turns = np.cumsum(np.diff(times, prepend=0.0) * present[:-1]) + phase
    assert np.abs(np.remainder(turns + math.pi, math.tau) - math.pi).max() < 1e-9
    # Not before the dwell is over, and within a cycle after it
    late = times - 0.7 * np.arange(1, 29)
    assert np.all(late >= -1e-12)
    assert np.all(late < math.tau / present[:-1])
    rig.advance(30.0)
    xs = [rig.run(30.0 + k * 0.001).time and rig.sample().base for k in range(200)]
    assert max(map(abs, xs)) == pytest.approx(level / 40.0**power, rel=1e-3)


def test_steps_of_a_base_are_changes_at_their_instants():
    """The same motion as with changes by hand, at the instants that the schedule gives."""
    swept = shaken('acceleration')
    hand = Rig(rig_at(swept.parameters, 0).replace(sweep_mode='off'))
    for step in stepped_sine(swept.parameters, swept.sweep):
        swept.advance(step.time)
        hand.advance(step.time)
        hand.change(step.parameters.replace(sweep_mode='off'))
        a, b = swept.sample(), hand.sample()
        assert (a.x, a.base, a.z) == pytest.approx((b.x, b.base, b.z), abs=1e-12)
    assert swept.time > 19.6
    assert swept.run(40.0).event_count == hand.run(40.0).event_count


def test_a_base_of_constant_displacement_steps_when_its_time_has_come():
    events = shaken('displacement').advance(20.0)
    assert [e.time for e in steps(events)] == [k * 0.7 for k in range(1, 29)]


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize('quantity', ['acceleration', 'displacement'])
def test_a_sweep_goes_on_from_a_snapshot(quantity, compiled):
    """In the middle of a step, and just at one; however the run is divided."""
    if compiled:
        pytest.importorskip('numba')
    whole = shaken(quantity, compiled)
    events = whole.run(25.0).events
    parts = shaken(quantity, compiled)
    times = [0.3, 0.71, float(events[events['kind'] == STEP][4]['time']), 11.1, 25.0]
    found = []
    for time in times:
        found.append(parts.run(time).events)
        parts = Rig.restore(json.loads(json.dumps(parts.snapshot())), compiled=compiled)
    assert np.concatenate(found).tobytes() == events.tobytes()
    assert parts.sample() == whole.sample()


def test_a_change_in_a_sweep_of_a_base_leaves_its_step_alone():
    """The step that is under way takes its time, and the next one is at a zero of the new b."""
    rig = shaken('acceleration')
    rig.advance(5.0)
    frequency, before = rig.force_frequency, rig.sample()
    rig.change(rig.parameters.replace(gap=0.02, stiffness=21000.0))
    assert rig.sample().base == pytest.approx(before.base, rel=1e-12)
    assert rig.force_frequency == frequency
    (event,) = steps(rig.advance(5.7))
    assert 5.6 <= event.time < 5.6 + math.tau / frequency
    larger = rig.parameters.replace(base_amplitudes=3.0)
    wait = rig.wait_for_change(larger)
    assert 0.0 < wait < math.tau / rig.force_frequency
    rig.advance(rig.time + wait)
    assert rig.sample().base == pytest.approx(0.0, abs=1e-14)
    rig.change(larger)
    assert rig.sample().base == pytest.approx(0.0, abs=1e-13)


def test_steps_shorter_than_a_cycle_are_taken_together():
    """The rate of the sweep is kept."""
    rig = shaken('acceleration', sweep_mode='up', sweep_step=0.05, sweep_dwell=0.01)
    times = [step.time for step in stepped_sine(rig.parameters, rig.sweep)]
    assert len(times) < 100
    assert times[-1] == pytest.approx(8.0, abs=0.1)
    for time in (1.0, 3.0, 7.0):
        rig.advance(time)
        assert rig.force_frequency == pytest.approx(40.0 + 5.0 * time, abs=0.8)


def test_short_steps_of_a_base_do_not_depend_on_when_they_began():
    """Those shorter than a cycle are taken together."""
    rig = SHAKEN.replace(sweep_dwell=0.02)

    def steps_from(start):
        sweep, taken = SteppedSine(start, 0, start + 0.02), []
        while sweep.due < math.inf:
            taken.append((sweep.step, pytest.approx(sweep.due - start, abs=1e-9)))
            sweep = sweep.following(rig)
        return taken

    taken = steps_from(0.0)
    assert [step for step, _ in taken[:4]] == [0, 1, 8, 13]
    assert [(step, due.expected) for step, due in steps_from(1000.0)] == taken
