"""A bag is held against what it says of itself: what is missing is reported, nothing else is."""

import contextlib
import random
import struct

import pytest
import yaml
from bag import ros2_bags, samples
from bag.alterations import altered, chunks_of, edited, rewritten, without_chunk, write, write_file
from bag.recorded_rig import NOTES, RecordedRig, renamed
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType
from replay.test_replay import replayed
from rosbags.rosbag2 import CompressionMode

from impact_damper_ros.bag import RecordingError, RunReader
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.replay.findings import ReplayVerdict


@pytest.fixture(scope='module')
def messages():
    """Return a run of 3 s."""
    return RecordedRig(rate=200.0).start().run(600).messages


@pytest.fixture(scope='module')
def bag(messages, tmp_path_factory):
    return write(tmp_path_factory.mktemp('bags') / 'run', messages)


def and_summary_unchecked(change):
    """Return a change after which the checksum of the summary is not given."""

    def both(found):
        changed = change(found) or found
        edited(Opcode.FOOTER, 16, '<I', 0)(changed)
        return changed

    return both


@pytest.mark.parametrize(('number', 'listing'), [(1, False), (3, True), (-1, True)])
def test_a_chunk_removed(bag, tmp_path, number, listing, capsys):
    change = and_summary_unchecked(without_chunk(number))
    cut = altered(bag, tmp_path / 'bag', change, listing=listing)
    assert replay_run([str(cut)]) == 3
    text = capsys.readouterr().out
    assert 'the bag is not complete: its statistics count 1,639 messages, not 1,' in text
    assert 'the bag is not complete: the checksum of its data does not match' in text
    if number == -1 and listing:
        assert compare_run([str(cut)]) == 3
        assert 'its statistics count 1,639 messages, not 1,' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (
            and_summary_unchecked(edited(Opcode.STATISTICS, 0, '<Q', 5)),
            'its statistics count 5 messages, not 1,639',
        ),
        (
            and_summary_unchecked(edited(Opcode.STATISTICS, 48, '<Q', 4444)),
            'metadata.yaml counts 1,639 messages in all',
        ),
        (edited(Opcode.STATISTICS, 0, '<Q', 5), 'the checksum of its summary does not match'),
        (edited(Opcode.HEADER, 12, '<B', 0x4A), 'the checksum of its data does not match'),
    ],
)
def test_what_the_file_says_is_checked(bag, tmp_path, change, words):
    run = RunReader(altered(bag, tmp_path / 'bag', change))
    with contextlib.suppress(RecordingError):
        list(run)
    faults = run.faults()
    assert any(words in fault for fault in faults), faults
    assert all(fault.startswith('the bag is not complete: ') for fault in faults)


def test_any_flipped_bit_is_noticed(bag, tmp_path):
    """Of header, metadata, chunks and indexes; the summary repeats what is in them."""
    (path,) = bag.glob('*.mcap')
    content = path.read_bytes()
    dice, hurt = random.Random(8), tmp_path / 'hurt.mcap'
    summary = content.rindex(struct.pack('<BQ', Opcode.DATA_END, 4))
    for _ in range(150):
        at = dice.randrange(summary)
        held = bytearray(content)
        held[at] ^= 1 << dice.randrange(8)
        hurt.write_bytes(held)
        try:
            run = RunReader(hurt)
            list(run)
        except RecordingError:
            continue
        assert run.faults() or not run.complete, at


@pytest.mark.parametrize(
    ('field', 'value', 'words'),
    [
        (('message_count',), 5, 'metadata.yaml counts 5 messages in all'),
        (('relative_file_paths',), ['a_0.mcap'], "lists 'a_0.mcap', not there"),
        (('relative_file_paths',), ['a.mcap', 'b.mcap', 'c.mcap'], "'a.mcap' and 2 more, not"),
        (('relative_file_paths',), ['run_0.mcap', 'run_1.mcap'], "lists 'run_1.mcap', not there"),
    ],
)
def test_what_metadata_yaml_says_is_checked(bag, tmp_path, field, value, words):
    changed = altered(bag, tmp_path / 'bag', lambda found: found)
    content = yaml.safe_load((changed / 'metadata.yaml').read_text())
    held = content['rosbag2_bagfile_information']
    for name in field[:-1]:
        held = held[name]
    held[field[-1]] = value
    (changed / 'metadata.yaml').write_text(yaml.safe_dump(content))
    findings = replayed(changed)
    assert findings.verdict is ReplayVerdict.PARTIAL
    assert any(words in fault for fault in findings.faults), findings.faults
    assert len(findings.faults) == 1


# No false alarms


def faults_of(bag):
    run = RunReader(bag)
    assert sum(1 for _ in run) == run.message_count > 0
    return run.faults() + run.remarks()


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('index', [IndexType.ALL, IndexType.NONE])
@pytest.mark.parametrize('crcs', [True, False])
def test_files_of_mcap(messages, tmp_path, compression, index, crcs):
    path = tmp_path / 'other.mcap'
    for chunked in (True, False):
        arrived = ros2_bags.joined(messages[:600], 0)
        write_file(
            path,
            # Not in the order of their stamps
            arrived[::-1],
            definition=lambda _: b'',
            extra=lambda writer: writer.add_attachment(1, 1, 'note', 'text/plain', b'kept'),
            chunk_size=20_000,
            compression=compression,
            index_types=index,
            use_chunking=chunked,
            enable_crcs=crcs,
            enable_data_crcs=crcs,
            use_statistics=crcs,
            use_summary_offsets=not crcs,
        )
        assert faults_of(path) == []
        assert [(r.topic, r.content, r.stamp_ns) for r in RunReader(path)] == arrived
        if crcs:
            rewritten(path, lambda content: content.replace(b'kept', b'lost'))
            assert any('checksum of its data' in fault for fault in RunReader(path).faults())


@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.STORAGE])
def test_bags_of_rosbags(messages, tmp_path, mode):
    arrived = ros2_bags.joined(messages[:3000], 0)
    ros2_bags.write_by_rosbags(tmp_path / 'bag', arrived, mode)
    assert faults_of(tmp_path / 'bag') == []
    assert [(r.topic, r.content, r.stamp_ns) for r in RunReader(tmp_path / 'bag')] == arrived
    assert replayed(tmp_path / 'bag').verdict is ReplayVerdict.IDENTICAL


def test_a_recorder_says_what_it_lost(messages, tmp_path):
    """rosbag2 counts what it receives by file, and what it writes by topic."""
    arrived = ros2_bags.joined(messages, samples.START)
    bag = ros2_bags.write_bag(tmp_path / 'bag', arrived)
    content = yaml.safe_load((bag / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information']['files'][0]['message_count'] += 123
    content['rosbag2_bagfile_information']['duration']['nanoseconds'] += 10**10
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.IDENTICAL
    (remark,) = findings.remarks
    assert remark.endswith('it lost 123 of them')


def test_chunks_that_overlap_in_time_are_put_in_order(tmp_path):
    """In the order of their stamps; those of equal stamps in the order of the chunks' starts."""
    dice = random.Random(4)
    stamps = [dice.randrange(100) for _ in range(1000)]
    rows = [
        ('/snapshot', samples.serialise(samples.STRING, samples.make(samples.STRING, str(i))), s)
        for i, s in enumerate(stamps)
    ]
    read = [(r.topic, r.content, r.stamp_ns) for r in RunReader(write(tmp_path / 'b', rows))]
    chunks = sorted(
        (rows[i : i + 250] for i in range(0, 1000, 250)), key=lambda c: min(m[2] for m in c)
    )
    assert read == sorted([row for chunk in chunks for row in chunk], key=lambda row: row[2])


def test_chunks_that_overlap_in_time_are_not_all_held(tmp_path, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.bag.run_reader._MOST_HELD', 100_000)
    text = samples.serialise(samples.STRING, samples.make(samples.STRING, 'x' * 1000))
    rows = [
        ('/snapshot', text, stamp) for _ in range(10) for stamp in (0, 10**9) for _ in range(9)
    ]
    run = RunReader(write(tmp_path / 'bag', rows, every=18))
    with pytest.raises(RecordingError, match='its chunks overlap so much in time'):
        list(run)


# What cannot be used is named


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('rosbag2_bagfile_information: !!timestamp x', 'is not the metadata of a bag'),
        ('rosbag2_bagfile_information: {relative_file_paths: ["\x1b[31m"]}', 'not the metadata'),
        ('rosbag2_bagfile_information: {relative_file_paths: [5]}', 'are not all texts'),
        ('rosbag2_bagfile_information: {relative_file_paths: 5}', 'is not the metadata'),
        ('#' * 2**24, 'it is 8388609 characters long; at most 8388608 are read'),
        ('\ud800', 'is not the metadata of a bag'),
    ],
    ids=range(6),
)
def test_metadata_yaml(tmp_path, bag, text, words):
    path = altered(bag, tmp_path / 'bag', lambda found: found)
    (path / 'metadata.yaml').write_bytes(text.encode('utf-8', 'surrogatepass'))
    (fault,) = (f for f in RunReader(path).faults() if 'metadata.yaml' in f)
    assert words in fault
    assert replayed(path).verdict is ReplayVerdict.PARTIAL


def test_a_chunk_larger_than_any_is_not_expanded(bag, tmp_path):
    def change(found):
        at = chunks_of(found)[1]
        head = struct.pack('<QQQII', 0, 2**62, 3_900_000_000, 0, 4) + b'zstd'
        found[at] = Opcode.CHUNK, head + struct.pack('<Q', 2) + b'xx'

    run = RunReader(altered(bag, tmp_path / 'bag', change))
    with pytest.raises(RecordingError, match='3900000000 bytes are declared; at most'):
        list(run)


def test_messages_of_channels_that_are_not_described(bag, tmp_path):
    """In a chunk without any, by a number that no channel has."""

    def change(found):
        record = struct.pack('<BQHIQQ', Opcode.MESSAGE, 22, 77, 0, samples.START, 0)
        head = struct.pack('<QQQII', samples.START, samples.START, len(record), 0, 0)
        chunk = Opcode.CHUNK, head + struct.pack('<Q', len(record)) + record
        found[chunks_of(found)[0] : chunks_of(found)[0]] = [chunk, chunk]

    path = altered(bag, tmp_path / 'bag', change)
    run = RunReader(path)
    list(run)
    assert any('2 messages of undescribed channels, left out' in f for f in run.faults())
    assert replayed(path).verdict is ReplayVerdict.PARTIAL


def test_no_escape_sequence_reaches_the_terminal(tmp_path, messages, capsys):
    """Not by the name of a topic or node, of a file, or a text within."""
    names = {
        topic: f'{topic}\x1b[31m\n\u202e' for topic in NOTES.values() if topic != NOTES['node']
    }
    notes = {name: names.get(topic, '/n\x1b]0;x\x07') for name, topic in NOTES.items()}
    topics = [samples.Topic(names.get(t.name, t.name), t.type, t.qos) for t in samples.CONTROLLED]
    changed = renamed([*messages, messages[-1]], names, notes['node'])
    path = samples.record(tmp_path / 'bag\x1b[31m', changed, topics, custom=notes)
    text = ''
    for command in (compare_run, replay_run, recover_run):
        command([str(path)])
        text += ''.join(capsys.readouterr())
    assert {c for c in text if not c.isprintable()} <= {'\n', '\r'}
    assert r'node /n\x1b]0;x\x07' in text
    assert r'messages of /joint_states\x1b[31m\n\u202e that are there twice: 1' in text
