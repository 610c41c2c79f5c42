"""Bags of `ros2 bag record`: joined late, split, compressed by chunk, remapped."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from bag import ros2_bags, samples
from bag.recorded_rig import CONTROL, RecordedRig, renamed
from mcap.writer import CompressionType
from replay.test_replay import places, replayed
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from impact_damper_ros import run
from impact_damper_ros.bag import RunReader
from impact_damper_ros.bag.messages import header_ns
from impact_damper_ros.bag.rig_recorder import RigRecorder
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.replay.findings import ReplayVerdict


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Record 4 s of a rig with some 300 impacts a second, by the package itself."""
    rig = RecordedRig().rig
    directory = tmp_path_factory.mktemp('bags') / 'run'
    parts = (rig.parameters, RecordedRig().initial, rig.control)
    values = {name: v for part in parts for name, v in part.as_dict().items()}
    recorder = RigRecorder(directory, rig, values, 200.0, 4.0)
    run(rig, 4.0, [recorder])
    recorder.close()
    return directory


@pytest.fixture(scope='module')
def messages(bag):
    """Return its messages, as on a machine whose clock is not at zero."""
    moved = []
    for topic, kind, stamp, content in RunReader(bag):
        if kind == samples.STRING:
            text = content[8:-1].replace(
                b'"stamp_offset_ns": 0', f'"stamp_offset_ns": {samples.START}'.encode()
            )
            content = samples.serialise(kind, samples.make(kind, text.decode()))
        else:
            now = divmod(header_ns(content) + samples.START, 10**9)
            content = content[:4] + b''.join(n.to_bytes(4, 'little') for n in now) + content[12:]
        moved.append((topic, content, stamp + samples.START))
    return moved


@pytest.fixture(scope='module')
def controlled():
    rig = RecordedRig(control=CONTROL).start().run(1400)
    return rig.messages


def counts(messages, *topics):
    return [len(places(messages, topic)) for topic in topics]


@pytest.mark.parametrize('late', [0, 17, 1000])
@pytest.mark.parametrize('run', ['messages', 'controlled'])
def test_joined_so_many_impacts_late(tmp_path, run, late, request):
    messages = request.getfixturevalue(run)
    impacts = places(messages, '/impacts')
    stamp = messages[impacts[min(late, len(impacts) * 3 // 4)]][2] if late else 0
    arrived = ros2_bags.joined(messages, stamp)
    findings = replayed(ros2_bags.write_bag(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences[:1]
    assert findings.faults == findings.remarks == []
    lost = findings.missing_impacts, findings.missing_samples, findings.missing_gap_control
    assert lost == (0, 0, 0)
    found = [findings.samples, findings.impacts, findings.gap_control]
    assert found == counts(arrived, '/joint_states', '/impacts', '/gap_control')
    assert (findings.gap_control > 30) is (run == 'controlled')


@pytest.mark.parametrize('first', ['/impacts', '/joint_states'])
def test_topics_joined_one_after_the_other(tmp_path, messages, first):
    """Discovery may take longer for one topic than for another."""
    begun, later = samples.START + 10**9, samples.START + 3 * 10**9
    topics = {'/impacts': later, '/joint_states': later, first: begun}
    arrived = ros2_bags.joined(messages, begun, topics=topics)
    findings = replayed(ros2_bags.write_bag(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.IDENTICAL
    assert findings.missing_impacts == 0
    assert findings.impacts == counts(arrived, '/impacts')[0]
    assert findings.remarks == []


@pytest.mark.parametrize('lost', [1, 500])
def test_what_a_recorder_loses_in_a_row_is_counted(tmp_path, messages, lost):
    hits = places(messages, '/impacts')[200 : 200 + lost]
    kept = [m for i, m in enumerate(messages) if i not in hits]
    arrived = ros2_bags.joined(kept, samples.START + 10**8)
    findings = replayed(ros2_bags.write_bag(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences[:1]
    assert findings.missing_impacts == lost


def test_an_altered_impact_of_a_late_recorder_is_still_found(tmp_path, messages):
    arrived = ros2_bags.joined(messages, samples.START + 2 * 10**9)
    place = places(arrived, '/impacts')[100]
    topic, content, stamp = arrived[place]
    arrived[place] = (topic, content[:-1] + bytes([content[-1] ^ 1]), stamp)
    findings = replayed(ros2_bags.write_bag(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.DIFFERENT
    assert findings.by_topic == {'/impacts': 1}


FORMS = {
    'split': {'files': 4},
    'chunk_lz4': {'compression': CompressionType.LZ4, 'files': 2},
}


@pytest.mark.parametrize('form', FORMS)
def test_split_and_compressed_bags(tmp_path, messages, form, capsys):
    arrived = ros2_bags.joined(messages, samples.START + 2 * 10**9)
    bag = ros2_bags.write_bag(tmp_path / 'bag', arrived, **FORMS[form])
    result = tmp_path / 'result.json'
    assert replay_run([str(bag), '--json', str(result)]) == 0
    held = json.loads(result.read_text())
    assert (held['verdict'], held['faults'], held['remarks']) == ('identical', [], [])
    assert held['compared']['impacts'] == counts(arrived, '/impacts')[0]
    assert recover_run([str(bag), '--output', str(tmp_path / 'saved')]) == 0
    text = capsys.readouterr().out
    assert 'bag is complete' in text
    again = [(r.topic, r.content, r.stamp_ns) for r in RunReader(tmp_path / 'saved')]
    assert again == arrived
    assert replay_run([str(tmp_path / 'saved'), '--quiet']) == 0


@pytest.mark.parametrize(
    ('mode', 'storage', 'words'),
    [
        (
            CompressionMode.NONE,
            StoragePlugin.SQLITE3,
            'it is stored in SQLite; plain MCAP is read',
        ),
        (CompressionMode.FILE, StoragePlugin.MCAP, 'it is compressed as a file; plain'),
        (CompressionMode.FILE, StoragePlugin.SQLITE3, 'it is compressed as a file; plain'),
        (CompressionMode.MESSAGE, StoragePlugin.MCAP, 'its messages are compressed one by one;'),
    ],
    ids=['sqlite', 'file', 'sqlite file', 'message'],
)
def test_other_forms_are_refused_with_the_command_that_converts_them(
    tmp_path, messages, mode, storage, words, capsys
):
    arrived = ros2_bags.joined(messages[:900], 0)
    ros2_bags.write_by_rosbags(tmp_path / 'bag', arrived, mode, storage)
    for command, code in ((replay_run, 2), (recover_run, 1)):
        assert command([str(tmp_path / 'bag')]) == code
        (line,) = capsys.readouterr().err.splitlines()
        assert words in line
    options = shlex.split(line.partition('rosbags-convert ')[2].partition(' (pip')[0])
    source, target, to = options[1], options[3], options[5]
    assert (options[::2], target, to) == (['--src', '--dst', '--dst-storage'], 'NEW', 'mcap')
    program = Path(sys.executable).with_name('rosbags-convert')
    words = [program, '--src', source, '--dst', tmp_path / 'new', '--dst-storage', to]
    subprocess.run(words, check=True, capture_output=True)
    assert replayed(tmp_path / 'new').verdict is ReplayVerdict.IDENTICAL
    assert [(r.topic, r.content, r.stamp_ns) for r in RunReader(tmp_path / 'new')] == arrived


@pytest.mark.parametrize(
    'remapped',
    [
        {'/impacts': '/lab/hits'},
        {'/impacts': '/hits', '/gap_control': '/acts'},
        {'/snapshot': '/restart_point'},
        {'/joint_states': '/rig/motion'},
    ],
)
def test_remapped_topics_are_named_by_the_snapshots(tmp_path, controlled, remapped):
    arrived = renamed(ros2_bags.joined(controlled, samples.START), remapped)
    findings = replayed(ros2_bags.write_bag(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences[:1]
    assert [findings.impacts, findings.gap_control] == counts(
        controlled, '/impacts', '/gap_control'
    )


def test_a_recorder_that_runs_by_the_rig_s_clock(tmp_path, messages):
    """Its stamps are those of the ticks; the snapshot's is its own."""
    tick = 5_000_000
    arrived = [(t, c, s - (s - samples.START) % tick) for t, c, s in messages]
    ros2_bags.write_bag(tmp_path / 'bag', arrived)
    assert replayed(tmp_path / 'bag').verdict is ReplayVerdict.IDENTICAL
