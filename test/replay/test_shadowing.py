"""Runs recorded where the sine rounds differently, which no replay reproduces bit for bit."""

import math

import pytest
from bag import samples
from bag.recorded_rig import LIVELY, NOTES, RecordedRig
from replay.test_replay import places, replayed

from impact_damper_ros.replay import ReplayVerdict
from impact_damper_ros.rig import InitialConditions

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
            there.setattr(f'impact_damper_ros.rig.{module}.sin', rounded_otherwise)
        there.setattr('bag.recorded_rig.mathematics', lambda: 1)
        yield lambda rig: there.undo() or rig


def record(rig):
    rig = RecordedRig(rig, InitialConditions(initial_primary_position=0.004)).start().run(500)
    return rig.run(700, ('change', {'damping': 1.0}))


@pytest.mark.parametrize('name', RIGS)
def test_agrees_within_round_off(tmp_path, elsewhere, monkeypatch, name):
    rig = elsewhere(record(RIGS[name]))
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


def test_one_altered_number_is_found(tmp_path, elsewhere):
    messages = elsewhere(record(RIGS['chaotic'])).messages
    missed = []
    for topic, number in (('/joint_states', 450), ('/joint_states', 900), ('/impacts', 60)):
        place = places(messages, topic)[number]
        _, content, stamp = messages[place]
        parts = samples.numbers(content)
        for part in parts:
            for i, value in enumerate(part):
                part[i] = 1.001 * value
                changed = (topic, samples.with_numbers(content, stamp, *parts), stamp)
                part[i] = value
                altered = [*messages[:place], changed, *messages[place + 1 :]]
                directory = tmp_path / f'{topic[1:]}_{number}_{id(part)}_{i}'
                findings = replayed(samples.record(directory, altered, custom=NOTES))
                if value and not findings.difference_count:
                    missed.append((topic, number, i, value))
    assert missed == []
    gone = places(messages, '/impacts')[33]
    findings = replayed(
        samples.record(tmp_path / 'gone', messages[:gone] + messages[gone + 1 :], custom=NOTES)
    )
    assert (findings.first.quantity, findings.first.recorded) == ('impact', None)
    assert findings.difference_count == 1
