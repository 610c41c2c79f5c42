"""Long runs under control: those of the controlled rig, to the last bit, and of `LongRun`."""

import random

import numpy as np
import pytest
from rig.random_rigs import random_rig

from control.controlled_rigs import TRIAL, control, one_form_of_the_loop, random_controlled_rig
from impact_damper_ros.control import ControlledRig
from impact_damper_ros.control.controlled_run import ControlledRun
from impact_damper_ros.rig import EventKind, InitialConditions, Mode, RigParameters, Simulator
from impact_damper_ros.rig.long_run import _MOST_IN_TUPLES, EVENT_TYPE, LongRun, Outcome

#: Bounces on elastic stops under gravity, ever faster.
ENDLESS = (
    RigParameters(restitution_1=1.0, angle=1.0, force_amplitudes=[0.0]),
    InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=-1e-5),
)
#: Each number of harmonics has a loop of its own, which takes long to compile.
ONE_HARMONIC = {'force_amplitudes': [1.0], 'force_frequencies': [0.9], 'force_phases': [0.1]}


def rows(events):
    names = [name for name in EVENT_TYPE.names if name != 'mode']
    return [tuple(getattr(event, name) for name in names) for event in events]


def without_mode(table):
    return [tuple(row)[:-1] for row in table.tolist()]


@pytest.mark.parametrize('seed', range(25))
def test_it_has_the_motion_of_the_controlled_rig(seed, monkeypatch):
    rng = random.Random(seed)
    rig = random_controlled_rig(seed, **ONE_HARMONIC, restitution_1=0.7)
    if rig.control.gap_control == 'predictive':
        one_form_of_the_loop(monkeypatch)
    run = ControlledRun.restore(rig.snapshot())
    assert run.control == rig.control
    for _ in range(3):
        begun, end = rig.time, rig.time + rng.uniform(0.0, 4.0)
        instants = [begun, *sorted(rng.uniform(begun, end) for _ in range(4)), end]
        events, samples = [], []
        for instant in instants:
            events += rig.advance(instant)
            samples.append(tuple(rig.sample()))
        stretch = run.advance(end, instants)
        assert stretch.outcome is Outcome.COMPLETE
        assert stretch.reason == ''
        assert stretch.samples.tolist() == samples
        assert without_mode(stretch.events) == rows(events)
        # A transition may be reported as more than one event
        assert stretch.event_count <= len(events)
        assert stretch.time_in_mode.sum() == pytest.approx(end - begun, abs=1e-12)
        assert run.snapshot() == rig.snapshot()
        assert (run.time, run.mode) == (rig.time, rig.mode)
        if rng.random() < 0.5:
            changed = rig.parameters.replace(gap=rig.parameters.gap * 1.1)
            other = rig.control.replace(gap_control_smoothing=0.2)
            assert run.change(changed, other) == rig.change(changed, other)


@pytest.mark.parametrize('law', ['off', 'amplitude', 'timed', 'predictive'])
def test_any_number_of_harmonics(law, monkeypatch):
    """With arrays in place of tuples, the same bits."""
    one_form_of_the_loop(monkeypatch)
    parameters = TRIAL.replace(multisine_level=10.0, multisine_lines=_MOST_IN_TUPLES, gap=10.0)
    run = ControlledRun(parameters, control=control(law))
    rig = ControlledRig(parameters, control=control(law))
    instants = np.linspace(0.0, 60.0, 40)
    stretch = run.advance(60.0, instants)
    events, samples = [], []
    for instant in instants:
        events += rig.advance(instant)
        samples.append(tuple(rig.sample()))
    assert stretch.samples.tolist() == samples
    assert without_mode(stretch.events) == rows(events)
    assert len(events) > 10
    assert run.snapshot() == rig.snapshot()


def test_modes_without_control_are_those_of_a_long_run():
    """After each event, and the time spent in each."""
    seen = set()
    for seed in range(30):
        parameters, initial = random_rig(f'account {seed}', **ONE_HARMONIC, restitution_1=0.7)
        run, other = ControlledRun(parameters, initial), LongRun(parameters, initial)
        for end in (0.7, 0.7, 9.0):
            stretch, expected = run.advance(end, [end]), other.advance(end, [end])
            assert stretch.events.tolist() == expected.events.tolist()
            assert stretch.samples.tolist() == expected.samples.tolist()
            assert stretch.time_in_mode == pytest.approx(expected.time_in_mode, abs=1e-12)
            seen |= set(np.flatnonzero(stretch.time_in_mode).tolist())
    assert seen >= {Mode.SLIDE_DOWN, Mode.SLIDE_UP, Mode.STICK, Mode.REST_1}


def test_the_budget_of_events():
    parameters, initial = ENDLESS
    run = ControlledRun(parameters, initial, control('amplitude'))
    stretch = run.advance(10.0, [0.0, 10.0], most_events=500)
    assert stretch.outcome is Outcome.TOO_MANY_EVENTS
    assert stretch.event_count == len(stretch.events) == 500
    assert len(stretch.samples) == 1
    assert run.time == stretch.time == stretch.events['time'][-1] < 10.0
    assert 'allow more events, or make the stops less elastic' in stretch.reason
    # It goes on from there, on the way of the rig that was never stopped
    later = run.advance(2.0 * run.time, most_events=100_000)
    alone = ControlledRig(parameters, initial, control=control('amplitude'))
    assert rows(alone.advance(run.time)) == without_mode(stretch.events) + without_mode(
        later.events
    )
    assert run.snapshot() == alone.snapshot()


@pytest.mark.parametrize('most', [1, 2, 7])
def test_the_simulator_stops_after_so_many_events(most):
    """And goes on as if it had not, crossings included."""
    whole, pieces = Simulator(TRIAL), Simulator(TRIAL)
    expected, got = [], []
    while whole.time < 150.0:
        expected += whole.advance_to_crossing(150.0)
    while pieces.time < 150.0:
        new = pieces.advance_to_crossing(150.0, most)
        assert len(new) <= most + 1
        if new and pieces.time < 150.0:
            assert pieces.time == new[-1].time
        got += new
    assert got == expected
    assert {event.kind for event in got} == {EventKind.IMPACT, EventKind.CROSSING}
    assert pieces.snapshot() == whole.snapshot()


def test_a_runaway_is_an_outcome(monkeypatch):
    """As of a long run; the limit is lowered to meet one."""
    monkeypatch.setattr('impact_damper_ros.rig.run_loop.MOST_AT_ONCE', 50)
    monkeypatch.setattr('impact_damper_ros.rig.run_loop.least_step', lambda _horizon: 1.0)
    stretch = ControlledRun(*ENDLESS, control('amplitude'), compiled=False).advance(10.0)
    assert stretch.outcome is Outcome.RUNAWAY
    assert 'events without end at' in stretch.reason
