"""The rig to the last bit: cut up, interrupted, restored, taken back, compiled."""

import math
import random
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from motion.random_rigs import KINDS, act, random_initial, rig_of, rows, through_json, without_mode

from impact_damper_ros import EventKind, Mode, Outcome, Rig
from impact_damper_ros.motion.event import events_of_table

SEEN = {}


def advance_in_pieces(rig, end, events, rng):
    """Let a rig go to an instant by steps of all kinds; return it, its events and its acts."""
    cuts = [rng.uniform(rig.time, end) for _ in range(rng.choice([0, 1, 7]))]
    cuts += rng.sample([e.time for e in events], min(3, len(events)))
    cuts += [math.nextafter(cut, -math.inf) for cut in cuts[-2:]]
    got, acts = [], []
    for cut in [*sorted(cut for cut in cuts if cut >= rig.time), end]:
        mark = rig.mark()
        if rng.random() < 0.3:
            rig.advance(cut + rng.expovariate(2.0))
            rig.go_back(mark)
        while True:
            interrupted = (lambda: rng.random() < 0.5) if rng.random() < 0.5 else None
            most = rng.choice([1, 2, math.inf])
            if most < math.inf:
                new = events_of_table(rig.run(cut, most_events=most).events)
            else:
                new = rig.advance(cut, interrupted=interrupted)
            got += new
            acts += rig.acts
            if rig.time == cut and len(new) < most:
                break
        assert len(got) == sum(e.time <= cut for e in events)
        if rng.random() < 0.3:
            rig = through_json(rig)
    return rig, got, acts


@pytest.mark.parametrize('kind', KINDS)
@given(seed=st.integers(0, 10**9))
def test_however_it_is_run(kind, seed):
    """In pieces, or as a run, plain or compiled: events, acts, samples, modes and snapshots."""
    rng = random.Random(seed)
    whole = rig_of(kind, seed)
    whole.compiled = False
    pieces, plain, compiled = (through_json(whole) for _ in range(3))
    compiled.compiled_kernel = find_spec('numba') is not None
    for _ in range(5):
        begun, end = whole.time, whole.time + rng.choice([0.0, 0.31, rng.expovariate(0.7)])
        events, acts = whole.advance(end), whole.acts
        SEEN.setdefault(kind, set()).update([whole.mode, *(e.kind for e in events)])
        pieces, got, recorded = advance_in_pieces(pieces, end, events, rng)
        assert got == events
        assert recorded == acts
        assert pieces.sample() == whole.sample()
        instants = [begun, *sorted(rng.uniform(begun, end) for _ in range(4)), end]
        one, other = (rig.run(end, instants) for rig in (plain, compiled))
        assert one.samples[-1].tolist() == tuple(whole.sample())
        assert without_mode(one.events) == rows(events)
        assert one.event_count <= len(events)
        assert (one.outcome, one.reason, one.time) == (Outcome.COMPLETE, '', end)
        assert one.time_in_mode.sum() == pytest.approx(end - begun, abs=1e-12)
        assert one[:3] == other[:3]
        for a, b in zip(one[3:], other[3:], strict=True):
            assert np.array_equal(a, b)
        assert {str(rig.snapshot()) for rig in (pieces, plain, compiled)} == {
            str(whole.snapshot())
        }
        if rng.random() < 0.3:
            compiled = through_json(compiled)
        found, *others = act(kind, rng, (whole, pieces, plain, compiled))
        SEEN[kind].update(e.kind for e in found[0])
        assert others == [found] * 3


@pytest.mark.parametrize('kind', KINDS)
@settings(max_examples=5)
@given(seed=st.integers(0, 10**9))
def test_a_reset_begins_anew(kind, seed):
    """As a new rig of that time does: nothing is left of what was before."""
    rng = random.Random(seed)
    rig = rig_of(kind, seed)
    for _ in range(3):
        rig.advance(rig.time + rng.expovariate(0.5))
        act(kind, rng, [rig])
    initial = random_initial(rng, rig.parameters)
    rig.reset(initial)
    new = Rig(rig.parameters, initial, rig.time, rig.control, rig.own_law)
    assert rig.snapshot() == new.snapshot()
    end = rig.time + 5.0
    assert (rig.advance(end), rig.acts) == (new.advance(end), new.acts)
    assert rig.snapshot() == new.snapshot()


def test_much_was_seen():
    if set(SEEN) < set(KINDS):
        pytest.skip('not all kinds of rigs ran in this process')
    seen = set().union(*SEEN.values())
    assert seen >= set(EventKind) | set(Mode) - {Mode.CHATTER_1, Mode.CHATTER_2}
