"""Passages of X through zero, as a rig under control reports them."""

import math
from itertools import pairwise

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters
from rig.random_rigs import random_rig


def idle(_seen, _memory):
    """Leave both stops alone: the passages are reported all the same."""
    return math.nan, math.nan


def watched(parameters, initial=None, until=30.0):
    """Return the passages of a rig, and its other events."""
    events = Rig(parameters, initial, law=idle).advance(until, 3000)
    passages = [e for e in events if e.kind is EventKind.CROSSING]
    return passages, [e for e in events if e.kind is not EventKind.CROSSING]


@pytest.mark.parametrize('seed', range(25))
def test_they_are_where_x_changes_its_sign_and_nowhere_else(seed):
    parameters, initial = random_rig(seed)
    passages, others = watched(parameters, initial)
    plain = Rig(parameters, initial)
    end = max([30.0] if len(passages) + len(others) < 3000 else [e.time for e in others[-1:]])
    # Watching leaves the motion alone
    assert [e for e in plain.advance(end) if e.time <= end] == [e for e in others if e.time <= end]
    scale = max(1e-9, *(abs(e.x) for e in others), 0.0) if others else 1.0
    times = [e.time for e in passages if e.time <= end]
    assert times == sorted(times)
    assert all(abs(e.x) <= 1e-12 * (scale + abs(e.primary_velocity_after)) for e in passages)
    knots = [0.0, *times, end]
    grid = np.concatenate([np.linspace(a, b, 41)[1:-1] for a, b in pairwise(knots) if b > a])
    samples = Rig(parameters, initial).run(end, grid, record=False).samples['x']
    interval = np.searchsorted(times, grid)
    for k in np.unique(interval):
        x = samples[interval == k]
        clear = x[np.abs(x) > 1e-9 * scale]
        assert (clear > 0.0).all() or (clear < 0.0).all()
        assert (
            not len(clear)
            or k == 0
            or math.copysign(1.0, clear[0])
            == math.copysign(1.0, passages[k - 1].primary_velocity_after)
        )


@pytest.mark.parametrize('depth', [1e-3, 1e-6, 1e-9])
def test_two_passages_close_together(depth):
    """X dips a little below zero and comes back."""
    turn = InitialConditions(initial_primary_position=2.0)
    rig = RigParameters(
        gravity=0.0,
        gap=1e3,
        damping=0.0,
        force_amplitudes=1.0 + depth,
        force_frequencies=0.0,
        force_phases=-math.pi / 2.0,
    )
    # About -(1 + depth) with amplitude 3 + depth: no dip there; mirror it to have one at zero
    rig = rig.replace(force_phases=math.pi / 2.0)
    passages, _ = watched(rig, turn, 6.2)
    # X = c + (2 - c) cos t with c = 1 + depth: lowest at pi, 2 c - 2 = 2 depth above zero
    assert passages == []
    rig = rig.replace(force_amplitudes=1.0 - depth)
    passages, _ = watched(rig, turn, 6.2)
    assert len(passages) == 2
    centre, swing = 1.0 - depth, 1.0 + depth
    expected = math.acos(-centre / swing)
    assert passages[0].time == pytest.approx(expected, abs=1e-12 / math.sqrt(depth))
    assert passages[1].time == pytest.approx(math.tau - expected, abs=1e-12 / math.sqrt(depth))


@pytest.mark.parametrize(
    ('x', 'velocity', 'first'),
    [(1.0, 0.0, math.pi / 2), (-1.0, 0.0, math.pi / 2), (0.0, 1.0, math.pi)],
)
def test_the_start_at_zero_is_no_passage(x, velocity, first):
    free = RigParameters(gravity=0.0, gap=1e3, damping=0.0, force_amplitudes=0.0)
    start = InitialConditions(initial_primary_position=x, initial_primary_velocity=velocity)
    passages, _ = watched(free, start, 10.0)
    assert [e.time for e in passages] == pytest.approx(
        [first + k * math.pi for k in range(len(passages))], abs=1e-13
    )
    assert len(passages) == 3
