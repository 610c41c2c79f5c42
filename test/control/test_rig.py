"""The rig to the last bit: cut up, interrupted, restored, taken back, previewed, compiled."""

import math
import os
import random

import pytest
from rig.random_rigs import (
    random_change,
    random_command,
    random_rig,
    rows,
    through_json,
    without_mode,
)

from control import laws
from control.controlled_rigs import random_control
from impact_damper_ros.control import Order, Outcome, Rig
from impact_damper_ros.rig import EventKind, Mode

KINDS = ('free', 'stops', 'swept', 'multisine', 'off', 'amplitude', 'timed', 'predictive', 'own')
KINDS += ('external',)
#: Modes and kinds of events that were seen, by the way the rig went.
SEEN = {}
RAN = set()


def lively(kind, seed):
    """Return a rig that sees much; elastic stops would keep it busy for ever."""
    rng = random.Random(f'{kind} {seed}')
    parameters, initial = random_rig(f'{kind} {seed}')
    parameters = parameters.replace(restitution_1=min(0.9, parameters.restitution_1))
    if kind == 'predictive':
        # What the law foresees depends on the stop that was hit last.
        parameters = parameters.replace(air_force=rng.choice([0.0, 0.1]))
    elif kind == 'swept':
        parameters = parameters.replace(
            sweep_mode=rng.choice(['up', 'down', 'up_down']),
            sweep_low=0.5,
            sweep_high=2.5,
            sweep_step=rng.choice([0.05, 0.3]),
            sweep_dwell=rng.choice([0.05, 0.31]),
        )
    elif kind == 'multisine':
        parameters = parameters.replace(multisine_level=0.4, multisine_lines=8)
    control = law = None
    if kind in ('amplitude', 'timed', 'predictive', 'own', 'external'):
        mode = 'timed' if kind == 'own' else kind
        control = random_control(rng, gap_control=mode)
        if kind == 'own':
            control = control.replace(gap_min=1e-3, gap_max=1e3)
    if kind == 'own':
        numba = pytest.importorskip('numba')
        law = numba.njit(laws.push)
    return Rig(parameters, initial, rng.choice([0.0, 1234.5]), control, law)


def act(kind, rng, rigs):
    """Let the same happen to all the rigs; return the events and the records of each."""
    rig = rigs[0]
    other = 'command' if kind in ('stops', 'swept') else 'control'
    if rig.control.gap_control == 'external' and rng.random() < 0.8:
        low, high = 0.5 * rig.control.gap_min, 0.5 * rig.control.gap_max
        stop_1, stop_2 = (rng.choice([math.nan, rng.uniform(low, high)]) for _ in range(2))
        if rig.parameters.one_sided:
            stop_2 = math.nan
        speeds = rng.choice([(math.nan, 2.0), (0.5, 0.5), (math.nan, math.nan)])
        order = Order(stop_1, -stop_2, *speeds, rng.choice([math.nan, 0.0, rng.gauss(0.0, 1.0)]))
        return [(rig.order(order), [str(record) for record in rig.records]) for rig in rigs]
    chosen = rng.choice(['nothing', 'change', other])
    if chosen == 'change':
        changed = random_change(rng, rig.parameters)
        if kind == 'swept':
            changed = rig.parameters.replace(sweep_dwell=rng.choice([0.05, 0.31]))
        changed = changed.replace(restitution_1=min(0.9, changed.restitution_1))
        return [(rig.change(changed), rig.records) for rig in rigs]
    if chosen == 'command':
        command = random_command(rng, rig)
        return [(rig.move_stops(*command), rig.records) for rig in rigs]
    if chosen == 'control' and rig.control.active and rng.random() < 0.5:
        other = random_control(rng, gap_control=rng.choice(['off', rig.control.gap_control]))
        if kind == 'own':
            other = other.replace(gap_min=1e-3, gap_max=1e3)
        return [(rig.change(rig.parameters, other), rig.records) for rig in rigs]
    return [([], []) for _ in rigs]


def note(way, rig, events):
    RAN.add(os.environ['PYTEST_CURRENT_TEST'])
    SEEN.setdefault(way, set()).update([rig.mode, *(e.kind for e in events)])


@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('kind', KINDS)
def test_however_it_is_cut(kind, seed):
    """Events, acts, samples and snapshots: restored, taken back, interrupted, previewed or not."""
    rng = random.Random(f'cut {kind} {seed}')
    whole = lively(kind, seed)
    pieces = through_json(whole)
    for _ in range(12):
        end = whole.time + rng.choice([0.0, 0.31, rng.expovariate(1.0)])
        events, records = whole.advance(end), whole.records
        cuts = [rng.uniform(pieces.time, end) for _ in range(rng.choice([0, 1, 7]))]
        cuts += rng.sample([e.time for e in events], min(3, len(events)))
        cuts += [math.nextafter(cut, -math.inf) for cut in cuts[-2:]]
        got, recorded = [], []
        for cut in [*sorted(cuts), end]:
            if cut < pieces.time:
                continue
            mark, foreseen = pieces.mark(), []
            if rng.random() < 0.3:
                foreseen = pieces.preview([cut])
            if rng.random() < 0.3:
                pieces.advance(cut + rng.expovariate(2.0))
                pieces.go_back(mark)
            while True:
                interrupted = (lambda: rng.random() < 0.5) if rng.random() < 0.5 else None
                most = rng.choice([1, 2, math.inf])
                new = pieces.advance(cut, most, interrupted)
                got += new
                recorded += pieces.records
                if pieces.time == cut and len(new) < most:
                    break
            assert foreseen in ([], [pieces.sample()])
            if rng.random() < 0.3:
                pieces = through_json(pieces)
        note('cut', whole, events)
        assert got == events
        assert recorded == records
        assert pieces.sample() == whole.sample()
        assert pieces.snapshot() == whole.snapshot()
        one, other = act(kind, rng, (whole, pieces))
        note('cut', whole, one[0])
        assert one == other


@pytest.mark.parametrize('compiled', [False, True])
@pytest.mark.parametrize('seed', range(10))
@pytest.mark.parametrize('kind', KINDS)
def test_as_a_whole_run(kind, seed, compiled):
    """Plain and compiled: samples, events, modes and snapshots are those of `advance`."""
    if compiled:
        pytest.importorskip('numba')
    rng = random.Random(f'run {kind} {seed}')
    rig = lively(kind, seed)
    runs = through_json(rig)
    runs.compiled = compiled
    for _ in range(8):
        begun, end = rig.time, rig.time + rng.choice([0.0, 0.31, rng.expovariate(0.5)])
        instants = [begun, *sorted(rng.uniform(begun, end) for _ in range(4)), end]
        events, samples = [], []
        for instant in instants:
            events += rig.advance(instant)
            samples.append(tuple(rig.sample()))
        result = runs.run(end, instants)
        note(f'compiled {compiled}', rig, events)
        assert (result.outcome, result.reason) == (Outcome.COMPLETE, '')
        assert result.samples.tolist() == samples
        assert without_mode(result.events) == rows(events)
        assert result.event_count <= len(events)
        assert result.time_in_mode.sum() == pytest.approx(end - begun, abs=1e-12)
        assert runs.snapshot() == rig.snapshot()
        if rng.random() < 0.3:
            runs = through_json(runs)
        one, other = act(kind, rng, (rig, runs))
        note(f'compiled {compiled}', rig, one[0])
        assert one == other


def test_much_was_seen():
    if len(RAN) < 3 * 10 * len(KINDS):
        pytest.skip('not all of the rigs ran in this process')
    for seen in SEEN.values():
        assert seen >= set(EventKind) | set(Mode) - {Mode.CHATTER_1, Mode.CHATTER_2}
