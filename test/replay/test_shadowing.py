"""Runs recorded where the sine rounds differently, which no replay reproduces bit for bit."""

import math

import pytest
from bag import samples
from bag.recorded_rig import LIVELY, NOTES, RecordedRig
from replay.test_replay import places, replayed

from impact_damper_ros import InitialConditions
from impact_damper_ros.replay import ReplayVerdict

RIGS = {
    'chaotic': LIVELY.replace(gap=0.013, gravity=0.0),
    'sticking': LIVELY.replace(angle=0.3, friction=0.4),
    'chatter': LIVELY.replace(angle=1.2, restitution_1=0.6),
}


def rounded_otherwise(x):
    """Return a sine whose last bit is off, now and then."""
    sine = math.sin(x)
    return math.nextafter(sine, math.inf) if math.frexp(sine)[0] % 1e-3 < 5e-4 else sine


@pytest.fixture
def elsewhere(monkeypatch):
    """Record on another machine."""
    with monkeypatch.context() as there:
        for module in ('flight', 'state', 'oscillator'):
            there.setattr(f'impact_damper_ros.motion.{module}.sin', rounded_otherwise)
        there.setattr('bag.recorded_rig.mathematics', lambda: 1)
        yield lambda rig: there.undo() or rig


def record(rig, before=500, after=700):
    rig = RecordedRig(rig, InitialConditions(initial_primary_position=0.004)).start().run(before)
    return rig.run(after, ('change', {'damping': 1.0}))


@pytest.mark.parametrize('name', RIGS)
def test_agrees_within_round_off(tmp_path, elsewhere, monkeypatch, name):
    rig = elsewhere(record(RIGS[name], 200, 300))
    bag = rig.save(tmp_path / 'bag')
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences[:1]
    counts = [len(places(rig.messages, topic)) for topic in ('/joint_states', '/impacts')]
    assert [findings.samples, findings.impacts] == counts
    assert findings.undecided <= 0.02 * counts[1]
    assert 'round differently: held against the replay within round-off' in findings.remarks[-1]
    # Nothing of that would agree to the last bit.
    monkeypatch.setattr('impact_damper_ros.replay.replay.mathematics', lambda: 1)
    assert replayed(bag).divergence.samples > 100


def altered(message, place):
    """Return a message with a number off by a thousandth, and that number."""
    topic, content, stamp = message
    parts = samples.numbers(content)
    which = [(part, i) for part in parts for i in range(len(part))]
    part, i = which[place]
    part[i] *= 1.001
    return (topic, samples.with_numbers(content, stamp, *parts), stamp), part[i]


def test_one_altered_number_is_found(tmp_path, elsewhere):
    """Of joint states all in one bag, each in a message of its own; an impact has consequences."""
    whole = elsewhere(record(RIGS['chaotic'])).messages
    messages, expected = list(whole), set()
    for half in (100, 600):
        for number in range(10):
            at = places(whole, '/joint_states')[half + 30 * number]
            messages[at], value = altered(whole[at], number)
            expected |= {whole[at][2]} if value else set()
    findings = replayed(samples.record(tmp_path / 'states', messages, custom=NOTES))
    assert {difference.stamp_ns for difference in findings.differences} == expected
    assert len(expected) == findings.difference_count > 14
    at = places(whole, '/impacts')[20]
    for number in range(6):
        part = whole[: at + 100]
        part[at], _ = altered(whole[at], number)
        findings = replayed(samples.record(tmp_path / str(number), part, custom=NOTES))
        assert findings.first.stamp_ns >= whole[at][2]
    part = [*whole[:at], *whole[at + 1 : at + 100]]
    findings = replayed(samples.record(tmp_path / 'gone', part, custom=NOTES))
    assert (findings.first.quantity, findings.first.recorded) == ('impact', None)
    assert findings.difference_count == 1
