"""Advances that are interrupted, and taken back: the motion is that of one which is not."""

import json
import random

import pytest

from impact_damper_ros.control import GapControlParameters, Rig
from impact_damper_ros.rig import InitialConditions, RigParameters, RunawayError, load_parameters

BENCH = load_parameters('bench_rig')[0]
#: m flies from stop to stop ever faster than anybody could follow: 1e18 impacts per second.
ENDLESS = RigParameters(gap=1e-9, restitution_1=1.0, restitution_2=1.0, gravity=0.0)
FAST = InitialConditions(initial_damper_velocity=1e9)

CASES = {
    'impacts': (BENCH, {}, 3.0),
    'chatter and rest': (BENCH.replace(angle=0.3), {}, 3.0),
    # Without friction: m that sticks is known to stick for ever.
    'a long search': (BENCH.replace(stiffness=1e12, gap=1.0, friction=0.0), {}, 0.03),
    'many harmonics': (
        BENCH.replace(multisine_level=1.0, multisine_low=300.0, multisine_high=900.0),
        {},
        0.5,
    ),
    'amplitude law': (
        BENCH,
        {'gap_control': 'amplitude', 'actuator_delay': 0.01, 'actuator_speed': 0.5},
        3.0,
    ),
    'timed law': (BENCH, {'gap_control': 'timed', 'gap_control_rate': 200.0}, 3.0),
}


def rigs(case):
    parameters, control, duration = CASES[case]
    law = GapControlParameters(**control)
    return *(Rig(parameters, control=law) for _ in range(2)), duration


@pytest.mark.parametrize('case', CASES)
def test_an_interrupted_advance_goes_on_as_if_nothing_had_been(case):
    whole, cut, duration = rigs(case)
    rng = random.Random(7)
    interruptions = 0
    for k in range(1, 11):
        instant = duration * k / 10
        events, records = whole.advance(instant), whole.records
        mark = cut.mark()
        cut.advance(instant + 0.1 * duration, interrupted=lambda: rng.random() < 0.01)
        cut.go_back(mark)
        in_parts, recorded = [], []
        while cut.time < instant:
            in_parts += cut.advance(instant, interrupted=lambda: rng.random() < 0.5)
            recorded += cut.records
            interruptions += cut.time < instant
        assert in_parts == events
        assert recorded == records
        assert cut.sample() == whole.sample()
    assert interruptions > 3
    assert json.dumps(cut.snapshot()) == json.dumps(whole.snapshot())


def test_an_interrupted_preview_is_the_beginning_of_the_whole_one():
    whole, cut, _ = rigs('a long search')
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
    """The next event is a thousand stretches of the search away."""
    parameters, _, _ = CASES['a long search']
    whole, cut = Rig(parameters), Rig(parameters)
    whole.advance(0.05)
    calls = 0
    while cut.time < 0.05:
        cut.advance(0.05, interrupted=lambda: True)
        calls += 1
    assert calls > 100
    assert cut.snapshot() == whole.snapshot()


def test_a_rig_with_endless_events_can_be_taken_back():
    rig = Rig(ENDLESS, FAST)
    before = json.dumps(rig.snapshot())
    mark = rig.mark()
    with pytest.raises(RunawayError, match='give a wider gap, a restitution below 1') as caught:
        rig.advance(0.1)
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) < 300
    rig.go_back(mark)
    assert json.dumps(rig.snapshot()) == before
    rig.change(ENDLESS.replace(gap=1.0, restitution_1=0.5))
    rig.reset()
    assert rig.advance(0.01) == []
