"""What a snapshot may hold: each wrong entry is named in one line, with what is allowed."""

import json
import struct

import pytest
from bag.alterations import write
from bag.recorded_rig import RecordedRig
from hypothesis import given, strategies as st
from replay.test_replay import replayed
from rigs import LIVELY

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay import command
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from impact_damper_ros.report.replay_report import findings_json, findings_text


@pytest.fixture(scope='module')
def messages():
    """Return a run with two changes."""
    rig = RecordedRig(rate=50.0).start().run(9, ('change', {'friction': 0.1}))
    return rig.run(9, ('change', {'gap': 0.009})).messages


def with_snapshots(directory, messages, change, number=None):
    """Write a bag with other texts of its snapshots, or of one of them."""
    changed, count = [], 0
    for topic, content, stamp in messages:
        if topic == '/snapshot':
            if number in (None, count):
                text = change(content[8:-1].decode()).encode('utf-8', 'surrogatepass')
                content = b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0'
            count += 1
        changed.append((topic, content, stamp))
    return write(directory, changed)


def put(path, value):
    """Return a change of a snapshot that puts a value at a path."""

    def change(text):
        held = part = json.loads(text)
        *names, last = path.split('.')
        for name in names:
            part = part[name]
        part[last] = value
        return json.dumps(held)

    return change


WRONG = [
    (lambda _: '[' * 100_000, 'it is nested too deep'),
    (lambda t: t.replace('"x": 0.0', '"x": NaN'), 'NaN is no number of JSON'),
    (put('state.origin.x', None), 'origin.x is None: give a number from'),
    (put('state.origin.velocity', '1.0'), "origin.velocity is '1.0': give a number"),
    (put('state.origin.mode', 99), 'origin.mode is 99: give a whole number from 0 to'),
    (put('state.origin.angles', []), 'origin.angles has 0 entries, the force has 1'),
    (put('state.time', 1e9), 'its state is of rig time 1000000000.0 s, the message of 0.0 s'),
    (put('state.parameters.gap', 'x' * 10**5), 'gap is '),
    (put('state.parameters.gap', -1.0), 'gap is -1.0'),
    (put('state.sweep.step', -(2**62)), 'sweep.step is -4611686018427387904: give a whole'),
    (put('state.sweep.due', 5.0), 'sweep.due is 5.0 s at step 0 of 0'),
    (put('state.origin.velocity', 1e300), 'origin.velocity is 1e+300: give a number'),
    (put('state.format', [2]), 'is of format [2]; this version reads format'),
    (put('stamp_offset_ns', '5'), "stamp_offset_ns is '5'"),
    (
        lambda t: put('time_ns', 1)(put('stamp_offset_ns', -command._LATEST_NS + 1)(t)),
        'stamps of ROS end at',
    ),
    (put('rate', 0.0), 'rate is 0.0: give a number from 1e-12 to'),
    (put('reason', ['start']), "reason is ['start']: it must be a text"),
    (put('run', 1.5), 'run is 1.5: it must be a text'),
    (put('node', 5), 'node is 5: it must be a text'),
    (put('topics', {'joint_states': 5}), 'topics is '),
]


@pytest.mark.parametrize(('change', 'words'), WRONG, ids=range(len(WRONG)))
def test_snapshots(tmp_path, messages, change, words):
    path = with_snapshots(tmp_path / 'bag', messages, change)
    with pytest.raises(RecordingError) as caught:
        RecordedRun(path)
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 3000


def test_flights_that_end_before_or_take_hours_to_search(tmp_path, messages, monkeypatch):
    monkeypatch.setattr(command, '_MOST_LOOKS', 2000)
    quiet = RecordedRig(LIVELY.replace(gap=100.0), rate=50.0).start().run(20).messages
    for name, run, words in (
        ('over', messages, 'ends at -999999'),
        ('long', quiet, 'takes too long'),
    ):
        path = with_snapshots(tmp_path / name, run, put('state.origin.time', -1e9))
        with pytest.raises(RecordingError, match=words):
            replayed(path)


def numbers(held, path=''):
    """Yield the paths of all numbers in objects of JSON."""
    for name, entry in held.items():
        if isinstance(entry, dict):
            yield from numbers(entry, f'{path}{name}.')
        elif isinstance(entry, int | float):
            yield f'{path}{name}'


RIG = RecordedRig(rate=50.0).start().run(9, ('change', {'friction': 0.1}))
TEXTS = [content[8:-1] for topic, content, _ in RIG.messages if topic == '/snapshot']


@given(path=st.sampled_from(sorted(numbers(json.loads(TEXTS[-1])))))
@pytest.mark.parametrize('elsewhere', [False, True])
def test_numbers_beyond_those_of_floats(tmp_path_factory, elsewhere, path):
    """10^400 in a snapshot in the midst: a fault or a difference with its values, no error."""
    directory = tmp_path_factory.mktemp('bags')
    bag = with_snapshots(directory / 'bag', RIG.messages, put(path, 10**400), len(TEXTS) - 1)
    with pytest.MonkeyPatch.context() as patch:
        if elsewhere:
            patch.setattr('impact_damper_ros.replay.replay.mathematics', lambda: 1)
        recorded = RecordedRun(bag)
        findings = Replay(recorded).run()
    assert findings.verdict in (ReplayVerdict.PARTIAL, ReplayVerdict.DIFFERENT)
    assert max(map(len, findings_text(findings, recorded).splitlines())) < 3000
    json.dumps(findings_json(findings, recorded), allow_nan=False)
