"""A run before observers is the run without them, and they see all of it."""

import pytest
from rigs import HORIZONTAL

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    Observer,
    Rig,
    RunawayError,
    TimedChange,
    run,
)

CONTROL = GapControlParameters()


class Diary(Observer):
    def __init__(self, rig, ticks=()):
        self.rig, self.stops = rig, ticks
        self.events, self.looks, self.changes = [], [], []

    def ticks(self):
        return iter(self.stops)

    def take_events(self, events):
        self.events += events

    def take_change(self, time_ns, values, events):
        assert self.rig.parameters.gap == values['gap']
        self.changes.append((time_ns, values, self.rig.time))
        super().take_change(time_ns, values, events)

    def look_at(self, instant):
        assert self.rig.time == instant
        self.looks.append(instant)


def test_observers_see_all_and_alter_nothing():
    change = TimedChange(50_000_000_000, {'gap': 30.0}, HORIZONTAL.replace(gap=30.0), CONTROL)
    rig = Rig(HORIZONTAL)
    often, plain = Diary(rig, (0.0, 0.7, 50.0, 79.9, 90.0)), Diary(rig, (0.7, 3.0))
    run(rig, 80.0, [often, plain], [change])
    alone = Rig(HORIZONTAL)
    events = alone.advance(50.0) + alone.change(change.parameters) + alone.advance(80.0)
    assert len(events) > 5
    assert often.events == plain.events == events
    assert rig.snapshot() == alone.snapshot()
    # Each sees the rig wherever it stops, once, and not beyond the end
    assert often.looks == plain.looks == [0.0, 0.7, 3.0, 50.0, 79.9, 80.0]
    assert often.changes == [(50_000_000_000, {'gap': 30.0}, 50.0)]


class Sampled(Observer):
    def __init__(self, *instants):
        self.wanted, self.rows, self.blocks = instants, [], 0

    def instants(self):
        return iter(self.wanted)

    def take_samples(self, samples):
        self.blocks += 1
        self.rows += samples.tolist()


@pytest.mark.parametrize('compiled', [False, True])
def test_samples_between_the_stops_are_those_of_a_rig_that_stops(compiled):
    """At the instant of a change they are taken after it; each observer gets its own."""
    wide = HORIZONTAL.replace(gap=30.0, angle=0.1, gravity=9.81)
    change = TimedChange(50_000_000_000, {'gap': 30.0}, wide, CONTROL)
    rig, alone = Rig(HORIZONTAL, compiled=compiled), Rig(HORIZONTAL)
    many = Sampled(*(0.5 * k for k in range(10_000)))
    few, diary = Sampled(3.0, 50.0, 50.0, 79.9), Diary(rig, (60.0,))
    run(rig, 80.0, [few, diary, many], [change])
    expected = {}
    for instant in sorted({*many.wanted, *few.wanted}):
        if instant <= 80.0:
            alone.advance(instant)
            if instant == 50.0:
                alone.change(wide)
            expected[instant] = tuple(alone.sample())
    assert [row[0] for row in many.rows] == [0.5 * k for k in range(161)]
    assert many.rows == [expected[row[0]] for row in many.rows]
    assert few.rows == [expected[time] for time in few.wanted]
    # Blocks before and after the change and the stop, and a sample at 0, 50, 60 and 80 s
    assert many.blocks == 7
    assert rig.snapshot() == alone.snapshot()


@pytest.mark.parametrize('begun', [False, True])
def test_a_run_goes_on_from_where_the_rig_is(begun):
    """What is due at its start, here an impact, is no part of one that has begun already."""
    initial = InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=1.0)
    rig = Rig(HORIZONTAL, initial)
    first = Diary(rig)
    run(rig, 0.0, [first], begun=begun)
    assert len(first.events) == (0 if begun else 1)
    run(rig, 45.0, [first], begun=begun)
    run(rig, 60.0, [first], begun=begun)
    assert first.events == Rig(HORIZONTAL, initial).advance(60.0)
    assert first.looks == [0.0, 0.0, 45.0, 45.0, 60.0]


def test_the_observers_have_seen_the_events_of_a_rig_that_has_too_many():
    hammering = HORIZONTAL.replace(gap=1e-6, restitution_1=1.0, restitution_2=1.0)
    rig = Rig(hammering)
    diary = Diary(rig)
    with pytest.raises(RunawayError, match='the rig had 2000 events'):
        run(rig, 100.0, [diary], most_in_period=2000)
    assert len(diary.events) == 2000


def test_changes_of_one_instant_are_made_one_after_the_other():
    """Also at the start of a run; and those that follow are not lost."""
    wide, rough = HORIZONTAL.replace(gap=30.0), HORIZONTAL.replace(gap=30.0, friction=0.01)
    last = HORIZONTAL.replace(gap=20.0)
    changes = [
        TimedChange(0, {'gap': 30.0}, wide, CONTROL),
        TimedChange(0, {'gap': 30.0, 'friction': 0.01}, rough, CONTROL),
        TimedChange(2 * 10**9, {'gap': 20.0}, last, CONTROL),
    ]
    rig = Rig(HORIZONTAL)
    diary = Diary(rig)
    run(rig, 5.0, [diary], changes)
    assert [time_ns for time_ns, _, _ in diary.changes] == [0, 0, 2 * 10**9]
    assert rig.parameters == last
