"""Documents of earlier formats, by made-up ones: there is none before that of version 1.0."""

import asyncio
import json

import pytest
from bag import samples
from bag.recorded_rig import CONTROL, NOTES, requested_run
from page.fake_rig import FakeLink
from page.served import in_loop

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.messages import STRING, String, decode, encode
from impact_damper_ros.compare.comparison import compare_bag
from impact_damper_ros.page.live import LiveRig
from impact_damper_ros.parameters.upgrades import FormatError, newest, upgrade
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from impact_damper_ros.rig import snapshot

THIS = newest(snapshot.UPGRADES)


def upgraded_from_made_up(document):
    """
    Return a document of the present format from one of a made-up format before it.

    That has the gap in mm, no last stop of a rig that has hit none, and in the message of a
    snapshot the stamp of rig time 0 in two numbers.
    """
    state = document['state']
    parameters = {**state['parameters'], 'gap': state['parameters']['gap'] / 1000.0}
    origin = {'last_stop': 0, **state['origin']}
    document = {**document, 'state': {**state, 'parameters': parameters, 'origin': origin}}
    if 'stamp_offset' in document:
        seconds, rest = document.pop('stamp_offset')
        document['stamp_offset_ns'] = seconds * 10**9 + rest
    return document


def earlier(document, number=THIS):
    """Return the same in the made-up format."""
    state = json.loads(json.dumps(document['state']))
    state['format'] = number
    state['parameters']['gap'] *= 1000.0
    if state['origin']['last_stop'] == 0:
        del state['origin']['last_stop']
    document = {**document, 'state': state}
    if 'stamp_offset_ns' in document:
        document['stamp_offset'] = divmod(document.pop('stamp_offset_ns'), 10**9)
    return document


def with_snapshots(messages, alter):
    """Return messages with altered snapshots."""
    found = []
    for topic, content, stamp in messages:
        if topic == '/snapshot':
            held = alter(json.loads(decode(STRING, content).data))
            text = samples.make(samples.STRING, json.dumps(held))
            content = samples.serialise(samples.STRING, text)
        found.append((topic, content, stamp))
    return found


def of_format(number):
    def alter(document):
        return {**document, 'state': {**document['state'], 'format': number}}

    return alter


@pytest.fixture
def later_version(monkeypatch):
    """Let this be a version with one format more."""
    upgrades = (*snapshot.UPGRADES, upgraded_from_made_up)
    monkeypatch.setattr(snapshot, 'UPGRADES', upgrades)
    return newest(upgrades)


def test_steps_of_a_chain_are_taken_from_the_format_of_the_document():
    chain = [lambda document, k=k: {**document, str(k): len(document)} for k in (1, 2, 3)]
    assert newest(chain) == 4
    assert upgrade({}, 1, chain) == {'1': 0, '2': 1, '3': 2}
    assert upgrade({}, 3, chain) == {'3': 0}
    assert upgrade({'a': 1}, 4, chain) == {'a': 1}
    for number in (0, 5, -1, True, 1.0, '1', None):
        with pytest.raises(FormatError, match='this version reads formats 1 to 4'):
            upgrade({}, number, chain)
    with pytest.raises(FormatError, match=r'of format 2; this version reads format 1$'):
        upgrade({}, 2, ())


@pytest.mark.parametrize('control', [None, CONTROL])
def test_a_bag_of_an_earlier_format_is_a_bag_as_any_other(tmp_path, later_version, control):
    run = requested_run(3) if control is None else requested_run(3, control=control)
    bags = [
        samples.record(tmp_path / name, with_snapshots(run.messages, alter), custom=NOTES)
        for name, alter in (('earlier', earlier), ('present', of_format(later_version)))
    ]
    old, new = (Replay(RecordedRun(bag)).run() for bag in bags)
    assert old == new
    assert old.verdict is ReplayVerdict.IDENTICAL
    assert old.samples > 100
    first, second = (compare_bag(bag).as_dict() for bag in bags)
    assert first.pop('bag') != second.pop('bag')
    assert first == second


def test_a_state_that_was_kept_in_python_is_restored(later_version):
    rig = Rig(RigParameters(gap=37.0))
    rig.advance(30.0)
    kept = earlier({'state': rig.snapshot()})['state']
    assert kept['format'] == later_version - 1
    again = Rig.restore(kept)
    assert again.snapshot() == rig.snapshot()
    assert again.advance(60.0) == rig.advance(60.0)


@in_loop
async def test_the_page_shows_a_node_of_an_earlier_version(later_version):
    link = FakeLink()
    (content,) = link.messages['snapshot']
    held = earlier(json.loads(decode(STRING, content).data))
    link.messages['snapshot'] = [encode(String(json.dumps(held)))]
    live = LiveRig(link, dict)
    live.tick()
    assert live.state['format'] == later_version
    assert live.values['gap'] == pytest.approx(link.rig.parameters.gap)
    await asyncio.sleep(0.0)
    await live.close()


@pytest.mark.parametrize('number', [0, THIS + 1, -1, None, '1'])
def test_other_formats_are_refused(tmp_path, number):
    messages = requested_run(1).messages
    bag = samples.record(
        tmp_path / 'bag', with_snapshots(messages, of_format(number)), custom=NOTES
    )
    with pytest.raises(RecordingError, match='; this version reads format') as caught:
        RecordedRun(bag)
    assert 'that recorded the bag, or a later one' in str(caught.value)


def test_a_later_snapshot_of_another_format_leaves_the_rest(tmp_path):
    messages = requested_run(1).messages
    *_, last = (k for k, message in enumerate(messages) if message[0] == '/snapshot')
    messages[last:] = with_snapshots(messages[last:], of_format(THIS + 1))
    findings = Replay(RecordedRun(samples.record(tmp_path / 'bag', messages, custom=NOTES))).run()
    assert findings.verdict is ReplayVerdict.PARTIAL
    assert f'of format {THIS + 1}' in findings.faults[0]
