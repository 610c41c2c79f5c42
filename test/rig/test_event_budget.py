"""The budget of events, and advances that are interrupted and taken back."""

import math
import random
import re

import pytest

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    Outcome,
    Rig,
    RigParameters,
    RunawayError,
    load_parameters,
)
from impact_damper_ros.rig.event_budget import EndlessEventsError, EventBudget, fastest_rate
from rig.endless_rigs import ENDLESS, RUNAWAY

MOST = 700


def run_until_stopped(budget, rig):
    events = []
    try:
        for portion in budget.portions(rig, 10.0):
            events += portion
    except EndlessEventsError as error:
        return events, error
    raise AssertionError


@pytest.mark.parametrize('name', ENDLESS)
@pytest.mark.parametrize('law', ['none', 'timed'])
def test_a_rig_is_stopped_at_an_event(name, law):
    parameters, initial = ENDLESS[name]
    control = GapControlParameters(gap_control=law if law != 'none' else 'off')
    rig = Rig(parameters, initial) if law == 'none' else Rig(parameters, initial, control=control)
    events, error = run_until_stopped(EventBudget(MOST, 'do something'), rig)
    assert isinstance(error, RunawayError)
    # Under control, events at the instant of a sample belong to it.
    assert MOST <= len(events) <= MOST + 10
    assert events[-1].time == pytest.approx(rig.time, abs=1e-12)
    assert rig.time < 1e-2
    said = re.fullmatch(
        r'the rig had (\d+) events from 0 s to (\S+) s, the last in mode (.+): do something',
        str(error),
    )
    assert int(said[1]) == len(events)
    assert float(said[2]) == pytest.approx(rig.time, rel=1e-8)
    assert said[3] == rig.mode.name.lower().replace('_', ' ')


@pytest.mark.parametrize('step', [1e-6, 3.3e-7, 7e-6])
def test_the_steps_of_a_run_do_not_matter(step):
    parameters, initial = ENDLESS['weight']
    rig, budget = Rig(parameters, initial), EventBudget(MOST)

    def run():
        for k in range(1, 1000):
            budget.advance(rig, k * step)

    with pytest.raises(EndlessEventsError):
        run()
    assert rig.time == pytest.approx(MOST * 1e-8, rel=3e-3)


def test_a_long_run_may_have_more_if_they_come_one_by_one():
    rig, plain = (Rig(RigParameters(gravity=0.0)) for _ in range(2))
    budget = EventBudget(20)
    events = [e for k in range(1, 41) for e in budget.advance(rig, 25.0 * k)]
    assert events == plain.advance(1000.0)
    assert len(events) > 200


def test_a_rig_that_chatters_in_each_cycle_is_within_the_budget():
    chattering = RigParameters(
        angle=math.pi / 2,
        one_sided=True,
        gravity=1.0,
        restitution_1=0.7,
        force_amplitudes=1.3,
        force_frequencies=10.0,
        damping=0.1,
        damper_mass=0.01,
        gap=0.1,
    )
    rig = Rig(chattering)
    events = EventBudget(200).advance(rig, 60.0)
    assert rig.time == 60.0
    assert len(events) > 600
    assert sum(e.kind is EventKind.REST for e in events) > 20


def test_a_change_of_the_rig_counts_anew():
    parameters, initial = ENDLESS['weight']
    rig, budget = Rig(parameters, initial), EventBudget(MOST)
    with pytest.raises(EndlessEventsError):
        budget.advance(rig, 1.0)
    first = rig.time
    rig.change(parameters.replace(damping=0.5))
    with pytest.raises(EndlessEventsError, match=rf'had {MOST} events from {first:.9g} s'):
        budget.advance(rig, 1.0)


LEVEL = RigParameters(gravity=0.0)
CONTROLS = [None, GapControlParameters(gap_control='timed')]
WAYS = [Rig.advance, Rig.run]


@pytest.mark.parametrize('go', WAYS)
@pytest.mark.parametrize('control', CONTROLS)
def test_a_number_of_events_is_rounded_up(go, control):
    """A fraction of an event left over once kept a rig from ever coming back."""
    stops = []
    for most in (14.67, 15, 14):
        rig = Rig(LEVEL, control=control)
        go(rig, 500.0, most_events=most)
        stops.append(rig.time)
    assert stops[0] == stops[1] < 500.0
    assert stops[2] <= stops[1]
    go(rig, 500.0, most_events=math.inf)
    assert rig.time == 500.0


@pytest.mark.parametrize(
    ('changes', 'rate'),
    [
        ({}, 1.0),
        ({'stiffness': 16.0}, 4.0),
        ({'force_frequencies': 9.0}, 9.0),
        ({'force_frequencies': 9.0, 'force_amplitudes': 0.0}, 1.0),
        ({'multisine_level': 1.0, 'multisine_high': 12.0}, 12.0),
    ],
)
def test_the_fastest_of_spring_and_force(changes, rate):
    assert fastest_rate(RigParameters(**changes)) == pytest.approx(rate)


#: The next event is a thousand stretches of the search away.
LONG_SEARCH = load_parameters('bench_rig')[0].replace(stiffness=1e12, gap=1.0, friction=0.0)


def test_an_interrupted_preview_is_the_beginning_of_the_whole_one():
    whole, cut = Rig(LONG_SEARCH), Rig(LONG_SEARCH)
    rng = random.Random(7)
    lengths = set()
    for k in range(1, 40):
        for rig in (whole, cut):
            rig.advance(k * 1e-3)
        times = [(k + i) * 1e-3 for i in range(20)]
        seen = cut.preview(times, lambda: rng.random() < 0.01)
        assert seen == whole.preview(times)[: len(seen)]
        lengths.add(len(seen))
    assert len(lengths) > 3


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
    with pytest.raises(RunawayError, match='give a wider gap, a restitution below 1'):
        rig.advance(0.1)
    rig.go_back(mark)
    assert rig.snapshot() == before
    outcome = rig.run(0.1)
    assert (outcome.outcome, 'less elastic' in outcome.reason) == (Outcome.RUNAWAY, True)
    rig.change(parameters.replace(gap=1.0, restitution_1=0.5))
    rig.reset()
    assert rig.advance(0.01) == []
