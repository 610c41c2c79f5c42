"""Rigs whose events have no end; and advances that are interrupted and taken back."""

import math
import re

import pytest
from control.controlled_rigs import TRIAL, control
from rigs import HORIZONTAL

import impact_damper_ros.rig.rig as rig_module
import impact_damper_ros.rig.run_result as run_result
from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    Outcome,
    Rig,
    RigParameters,
    RunawayError,
    load_parameters,
)
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD
from rig.endless_rigs import ENDLESS, RUNAWAY

MOST = 700


@pytest.mark.parametrize('name', ENDLESS)
@pytest.mark.parametrize('law', ['off', 'timed'])
def test_a_rig_is_stopped_at_an_event(name, law):
    """The error has the events, the mode and the remedy; a later call goes no further."""
    parameters, initial = ENDLESS[name]
    rig = Rig(parameters, initial, control=GapControlParameters(gap_control=law))
    with pytest.raises(RunawayError) as caught:
        rig.advance(10.0, MOST)
    events = caught.value.events
    # Under control, acts at the instant of a sample belong to it.
    assert MOST <= len(events) <= MOST + 10
    assert events[-1].time == pytest.approx(rig.time, abs=1e-12)
    assert rig.time < 1e-2
    words = re.fullmatch(
        r'the rig had (\d+) events from 0 s to (\S+) s, the last in mode (.+): '
        'make the stops less elastic or the gap wider',
        str(caught.value),
    )
    assert MOST <= int(words[1]) <= len(events)
    assert float(words[2]) == pytest.approx(rig.time, rel=1e-8)
    assert words[3] == rig.mode.name.lower().replace('_', ' ')
    with pytest.raises(RunawayError):
        rig.advance(10.0, MOST)


@pytest.mark.parametrize('step', [1e-6, 3.3e-7, 7e-6])
def test_the_steps_of_a_run_do_not_matter(step):
    parameters, initial = ENDLESS['weight']
    rig = Rig(parameters, initial)

    def run():
        for k in range(1, 1000):
            rig.advance(k * step, MOST)

    with pytest.raises(RunawayError):
        run()
    assert rig.time == pytest.approx(MOST * 1e-8, rel=3e-3)


def test_a_long_run_may_have_more_if_they_come_one_by_one():
    rig, plain = (Rig(RigParameters(gravity=0.0)) for _ in range(2))
    events = rig.advance(1000.0, 20)
    assert events == plain.advance(1000.0)
    assert len(events) > 200


def test_the_outcome_of_a_run_says_so():
    run = Rig(*ENDLESS['weight'], compiled=None).run(10.0, record=False, most_events=math.inf)
    assert run.outcome is Outcome.RUNAWAY
    assert run.event_count == MOST_IN_PERIOD
    assert run.reason.startswith(f'the rig had {MOST_IN_PERIOD} events from 0 s to ')


def test_a_change_of_the_rig_counts_anew():
    parameters, initial = ENDLESS['weight']
    rig = Rig(parameters, initial)
    with pytest.raises(RunawayError):
        rig.advance(1.0, MOST)
    first = rig.time
    rig.change(parameters.replace(damping=0.5))
    with pytest.raises(RunawayError, match=rf'had {MOST} events from {first:.9g} s'):
        rig.advance(1.0, MOST)


CONTROLS = [None, GapControlParameters(gap_control='timed')]


@pytest.mark.parametrize('control', CONTROLS)
def test_a_number_of_events_is_rounded_up(control):
    """A fraction of an event left over once kept a rig from ever coming back."""
    stops = []
    for most in (14.67, 15, 14):
        rig = Rig(HORIZONTAL, control=control)
        rig.run(500.0, most_events=most)
        stops.append(rig.time)
    assert stops[0] == stops[1] < 500.0
    assert stops[2] <= stops[1]
    rig.run(500.0, most_events=math.inf)
    assert rig.time == 500.0


#: The next event is a thousand stretches of the search away.
LONG_SEARCH = load_parameters('bench_rig')[0].replace(stiffness=1e12, gap=1.0, friction=0.0)


def test_every_call_gets_on_however_short_it_is():
    whole, cut = Rig(LONG_SEARCH), Rig(LONG_SEARCH)
    whole.advance(0.05)
    calls = 0
    while cut.time < 0.05:
        cut.advance(0.05, interrupted=lambda: True)
        calls += 1
    assert calls > 100
    assert cut.snapshot() == whole.snapshot()


def test_a_rig_with_endless_events_can_be_taken_back():
    parameters, initial = RUNAWAY
    rig = Rig(parameters, initial)
    before, mark = rig.snapshot(), rig.mark()
    with pytest.raises(RunawayError, match='make the stops less elastic'):
        rig.advance(0.1, MOST)
    rig.go_back(mark)
    assert rig.snapshot() == before
    rig.change(parameters.replace(gap=1.0, restitution_1=0.5))
    rig.reset()
    assert rig.advance(0.01) == []


def test_a_run_has_the_acts_of_its_control(monkeypatch):
    """As `advance` has them, plain and compiled, in tables that they do not fit in."""
    control = GapControlParameters(gap_control='timed', actuator_speed=40.0)
    rigs = [Rig(HORIZONTAL, control=control) for _ in range(3)]
    rigs[0].advance(200.0)
    acts = rigs[0].acts
    assert len(acts) > 100
    rigs[1].run(200.0)
    assert rigs[1].acts == acts
    if has_numba():
        for module in (rig_module, run_result):
            monkeypatch.setattr(module, 'FIRST_ROWS', 32)
        rigs[2].compiled = True
        rigs[2].run(200.0)
        assert rigs[2].acts == acts
    rigs[1].run(300.0, record=False)
    assert rigs[1].acts == []


def test_compiled_rigs_advance_compiled(monkeypatch):
    pytest.importorskip('numba')
    calls = []
    go = rig_module.run_compiled
    monkeypatch.setattr(rig_module, 'run_compiled', lambda *a, **k: (calls.append(1), go(*a, **k)))
    rig, plain = Rig(HORIZONTAL, compiled=True), Rig(HORIZONTAL)
    assert rig.advance(300.0) == plain.advance(300.0)
    assert len(calls) == 1
    # Interrupted on the way, it goes on with the same bits.
    while rig.time < 900.0:
        rig.advance(900.0, interrupted=lambda: True)
    plain.advance(900.0)
    assert rig.snapshot() == plain.snapshot()


def test_a_limit_of_events_holds_before_a_command():
    """Both stops arrive at one instant, so that there may be one event more."""
    law = control('timed', actuator_delay=0.1)
    count = Rig(TRIAL, control=law).run(60.0).event_count
    assert count > 50
    counts = [Rig(TRIAL, control=law).run(60.0, most_events=k).event_count for k in range(count)]
    assert {found - k for k, found in enumerate(counts)} == {0, 1}


def stay(_seen, _memory):
    return math.nan, math.nan


def test_passages_of_x_are_reported_where_nothing_else_happens():
    """More of them than a table of a plain run has rows."""
    rig = Rig(HORIZONTAL.replace(gap=1e6), law=stay)
    events = rig.advance(400.0)
    assert {event.kind for event in events} == {EventKind.CROSSING}
    assert len(events) == pytest.approx(400.0 / math.pi, abs=1.5)
