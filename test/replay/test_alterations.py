"""What is wrong in a log is noticed, or its topic is named; what is right is not doubted."""

from functools import cache

import pytest
from bag import samples
from bag.alterations import altered_message, numbers_of, rearranged, recorded_otherwise, wrong_bags
from bag.recorded_rig import (
    CONTROL,
    NOTES,
    RecordedRig,
    ordered_run,
    random_excitation,
    random_run,
    requested_run,
)
from hypothesis import given, strategies as st
from replay.test_replay import replayed

from impact_damper_ros.bag import RecordingError, recover_run
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.compare import Verdict
from impact_damper_ros.compare.comparison import compare_bag
from impact_damper_ros.compare.result import LogVerdict
from impact_damper_ros.replay.findings import ReplayVerdict

NOTICED = ReplayVerdict.DIFFERENT, ReplayVerdict.PARTIAL
KINDS = {
    'requests': lambda: random_run(3, 120),
    'excitation': lambda: requested_run(5, random_excitation),
    'control': lambda: requested_run(3, ticks=90, control=CONTROL),
    'orders': lambda: ordered_run(1),
}
#: Topics whose numbers a replay compares
TOPICS = '/joint_states', '/impacts', '/gap_control', '/snapshot'


@cache
def messages_of(name):
    return KINDS[name]().messages


def is_noticed(bag, topic=''):
    """Return whether a replay says that something is wrong, or that it does not look there."""
    try:
        findings = replayed(bag)
    except RecordingError:
        return True
    return findings.verdict in NOTICED or topic in findings.unchecked


@given(
    name=st.sampled_from(sorted(KINDS)),
    topic=st.sampled_from(TOPICS),
    factor=st.sampled_from((1e-3, 1e300)),
    which=st.integers(0, 10**6),
    number=st.integers(0, 10**6),
)
def test_an_altered_number(tmp_path_factory, name, topic, factor, which, number):
    """Of one message, by a thousandth or to 1e300; of acts where the rig has some."""
    messages = list(messages_of(name))
    held = [i for i, m in enumerate(messages) if m[0] == topic]
    if not held:
        return
    at = held[which % len(held)]
    places = numbers_of(messages[at])
    place = places[number % len(places)]
    messages[at] = altered_message(messages[at], place, factor)
    bag = samples.record(tmp_path_factory.mktemp('bags') / 'bag', messages, custom=NOTES)
    assert is_noticed(bag), place


@pytest.mark.parametrize('elsewhere', [False, True])
@pytest.mark.parametrize('topic', [*TOPICS, '/parameter_events'])
def test_rearranged_messages(tmp_path, monkeypatch, topic, elsewhere):
    """Also in a bag of another machine."""
    if elsewhere:
        monkeypatch.setattr('impact_damper_ros.replay.replay.mathematics', lambda: 1)
    messages = messages_of('control')
    for number, (what, held) in enumerate(rearranged(topic, messages)):
        bag = samples.record(tmp_path / str(number), held, custom=NOTES)
        assert is_noticed(bag, topic), what
        if what in ('missing', 'twice') and topic != '/parameter_events':
            assert compare_run([str(bag), '--quiet']) in (1, 3), what


@pytest.mark.parametrize('topic', TOPICS)
def test_a_topic_that_is_not_there(tmp_path, topic):
    """With its channel; the notes name it. What the rig did is not missing in it."""
    messages = [m for m in messages_of('control') if m[0] != topic]
    topics = [t for t in samples.CONTROLLED if t.name != topic]
    bag = samples.record(tmp_path / 'bag', messages, topics, custom=NOTES)
    if topic in ('/impacts', '/gap_control'):
        assert replayed(bag).verdict is ReplayVerdict.PARTIAL
    else:
        with pytest.raises(RecordingError):
            replayed(bag)


def test_wrong_bags(tmp_path):
    for number, (what, held) in enumerate(wrong_bags(messages_of('control'))):
        assert is_noticed(samples.record(tmp_path / str(number), held, custom=NOTES)), what


def test_a_recovered_bag(tmp_path):
    bag = samples.record(tmp_path / 'bag', messages_of('requests'), custom=NOTES)
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 2 // 3])
    assert is_noticed(recover_run(bag).output)


def test_recorded_otherwise(tmp_path):
    for number, (what, held) in enumerate(recorded_otherwise(messages_of('control'))):
        findings = replayed(samples.record(tmp_path / str(number), held, custom=NOTES))
        assert findings.verdict is ReplayVerdict.IDENTICAL, what
        assert findings.unchecked == ('/diagnostics', '/parameter_events')


UNALTERED = {
    'requests': lambda: random_run(30, 600),
    'quiet': lambda: RecordedRig().start().run(800).run(800, ('change', {'gap': 0.012})),
}


@pytest.mark.parametrize('name', UNALTERED)
def test_nothing_is_doubted(tmp_path, name):
    comparison = compare_bag(UNALTERED[name]().save(tmp_path / 'bag'))
    assert comparison.faults == ()
    assert len(comparison.stretches) > 1
    for stretch in comparison.stretches:
        assert stretch.verdict is not Verdict.DIFFERS, stretch.sentence
        assert stretch.log is LogVerdict.REPRODUCED
