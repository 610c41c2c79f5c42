"""Runs: what they report, when they end, and how they are divided."""

import math

import numpy as np
import pytest
from motion.random_rigs import through_json

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Outcome,
    Rig,
    RigParameters,
    RunawayError,
)
from impact_damper_ros.rig.snapshot import LATEST


@pytest.mark.parametrize('start', [0.0, -LATEST, LATEST])
def test_an_impact_at_the_start_is_reported_once(start):
    """Also across a snapshot, so that a recording that begins with it can be replayed."""
    initial = InitialConditions(initial_damper_offset=18.5, initial_damper_velocity=1.0)
    rig = Rig(RigParameters(gravity=0.0), initial, time=start)
    other = through_json(rig)
    (first,) = rig.advance(start)
    assert (first.kind, first.time, first.stop) == (EventKind.IMPACT, start, 1)
    assert first.damper_velocity_before == 1.0
    assert rig.advance(start) == []
    assert other.advance(start) == [first]


def test_modes_are_timed_from_where_a_run_begins():
    """Also in the middle of a flight that an advance has begun."""
    rig = Rig(RigParameters(gravity=0.0))
    for tick in range(2001):
        rig.advance(0.025 * tick)
    assert rig.run(60.0).time_in_mode.sum() == pytest.approx(10.0, abs=1e-12)


@pytest.mark.parametrize('compiled', [False, True], ids=['plain', 'compiled'])
@pytest.mark.parametrize(
    ('changes', 'kept'),
    [
        ({'gap': 24.0}, None),
        ({'gap': 10.0}, None),
        ({'gap': 5.0, 'air_force': 0.3, 'restitution_1': 1.0, 'restitution_2': 1.0}, None),
        ({'gap': 24.0}, GapControlParameters(gap_control='timed', gap_control_rate=2.0)),
    ],
    ids=['periodic', 'chaotic', 'endless', 'controlled'],
)
def test_run_until_the_motion_comes_back(changes, kept, compiled):
    """As if it were looked at from outside, every 50 cycles."""
    rig = RigParameters(gravity=0.0, force_frequencies=1.02, **changes)
    cycle, most = math.tau / 1.02, 3000
    start = InitialConditions(initial_primary_position=1.0)
    one, other = (Rig(rig, start, control=kept, compiled=compiled) for _ in range(2))
    cycles = events = 0
    error = None
    while cycles < 170:
        counts = np.arange(cycles + 1.0, min(cycles + 50, 170) + 1.0)
        run = other.run(counts[-1] * cycle, counts * cycle, most_events=most - events)
        events += run.event_count
        if run.outcome is not Outcome.COMPLETE:
            error = run.reason
            break
        cycles = int(counts[-1])
        x, v = run.samples['x'], run.samples['primary_velocity']
        y, u = run.samples['z'] - x, run.samples['damper_velocity'] - v
        states = np.column_stack([x, v / 1.02, y, u / 1.02])
        near = np.abs(states[-17:-1] - states[-1]).max(axis=1).min()
        if near <= 2e-3 * (np.abs(x).max() + np.ptp(y)):
            break
    if error is not None:
        with pytest.raises(RunawayError) as refused:
            one.run_until_return(cycle, 1.02, 170, 2e-3, most_events=most)
        assert str(refused.value) == error
    else:
        found = one.run_until_return(cycle, 1.02, 170, 2e-3, most_events=most)
        assert found == (cycles, events)
        assert (cycles < 170) == (changes['gap'] == 24.0)
    assert one.sample() == other.sample()
