"""A bag is held against what it says of itself: what is missing is reported, nothing else is."""

import struct
import zlib

import pytest
import yaml
from bag import ros2_bags, samples
from bag.recorded_rig import NOTES, RecordedRig
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.writer import Writer as Ros2Writer
from replay.test_replay import places, replayed
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as PeerWriter

from impact_damper_ros.bag import RunReader, bag_file
from impact_damper_ros.bag.bag_file import BagFile
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.replay.findings import ReplayVerdict

CHANNELS = {topic.name: index for index, topic in enumerate(samples.CONTROLLED)}


@pytest.fixture(scope='module')
def messages():
    """Return a run of 3 s."""
    return RecordedRig(rate=200.0).start().run(600).messages


def write(directory, messages, *, every=250, **options):
    """Write the node's own bag, with a chunk of so many messages each."""
    bag = BagFile(directory, [topic.channel() for topic in samples.CONTROLLED], NOTES, **options)
    for number, (topic, content, stamp, *rest) in enumerate(messages):
        bag.add(CHANNELS[topic], content, stamp, *rest)
        if number % every == every - 1:
            bag.flush()
    bag.finish()
    return directory


@pytest.fixture(scope='module')
def bag(messages, tmp_path_factory):
    return write(tmp_path_factory.mktemp('bags') / 'run', messages)


def records(content):
    """Return the records of an MCAP file as opcode and content, by the format's definition."""
    found, position = [], 8
    while position < len(content) - 8:
        opcode, length = struct.unpack_from('<BQ', content, position)
        found.append((opcode, content[position + 9 : position + 9 + length]))
        position += 9 + length
    return found


def of_records(found):
    parts = [struct.pack('<BQ', opcode, len(held)) + held for opcode, held in found]
    return b'\x89MCAP0\r\n' + b''.join(parts) + b'\x89MCAP0\r\n'


def altered(bag, directory, change, *, listing=True):
    """Copy a bag with other records."""
    directory.mkdir()
    (path,) = bag.glob('*.mcap')
    found = records(path.read_bytes())
    (directory / path.name).write_bytes(of_records(change(found) or found))
    if listing:
        (directory / 'metadata.yaml').write_bytes((bag / 'metadata.yaml').read_bytes())
        return directory
    return directory / path.name


def without_chunk(number):
    def change(found):
        chunks = [i for i, (opcode, _) in enumerate(found) if opcode == Opcode.CHUNK]
        end = first = chunks[number]
        while found[end + 1][0] == Opcode.MESSAGE_INDEX:
            end += 1
        return found[:first] + found[end + 1 :]

    return change


def edited(opcode, at, layout, value, number=0):
    """Return a change that puts a value into the record of a kind."""

    def change(found):
        which = [i for i, (code, _) in enumerate(found) if code == opcode][number]
        held = bytearray(found[which][1])
        struct.pack_into(layout, held, at, value)
        found[which] = (opcode, bytes(held))

    return change


@pytest.mark.parametrize('number', [1, 3, -1], ids=['second', 'fourth', 'last'])
@pytest.mark.parametrize('listing', [True, False], ids=['bag', 'file'])
def test_a_chunk_removed(bag, tmp_path, number, listing, capsys):
    cut = altered(bag, tmp_path / 'bag', without_chunk(number), listing=listing)
    assert replay_run([str(cut)]) == 3
    text = capsys.readouterr().out
    assert 'the bag is not whole: its statistics count 601 messages on /joint_states' in text
    assert 'its summary lists a chunk at byte' in text
    if listing:
        assert 'metadata.yaml counts 601 messages on /joint_states' in text


def test_a_comparison_reports_a_chunk_removed(bag, tmp_path, capsys):
    cut = altered(bag, tmp_path / 'bag', without_chunk(-1))
    assert compare_run([str(cut)]) == 3
    text = capsys.readouterr().out
    assert 'the bag is not whole: its statistics count 601 messages on /joint_states' in text
    assert 'its summary lists a chunk at byte' in text
    assert 'metadata.yaml counts 601 messages on /joint_states' in text


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (edited(Opcode.STATISTICS, 0, '<Q', 5), 'its statistics count 5 messages in all'),
        (edited(Opcode.STATISTICS, 22, '<I', 77), 'its statistics count 77 chunks'),
        (edited(Opcode.STATISTICS, 26, '<Q', 5), 'its statistics give stamps from 5 to '),
        (edited(Opcode.STATISTICS, 48, '<Q', 4444), 'its statistics count 4,444 messages on '),
        (edited(Opcode.STATISTICS, 14, '<I', 3), 'its statistics count 3 attachments'),
        (edited(Opcode.CHUNK_INDEX, 0, '<Q', 5, 2), 'its summary describes the chunk at byte'),
        (edited(Opcode.CHUNK_INDEX, 16, '<Q', 5, 2), 'its summary lists a chunk at byte 5'),
        (edited(Opcode.CHUNK_INDEX, 24, '<Q', 5, 2), 'its summary describes the chunk at byte'),
        (edited(Opcode.CHUNK_INDEX, 38, '<Q', 5, 2), 'are not where it names them'),
        (edited(Opcode.MESSAGE_INDEX, 6, '<Q', 5, 4), 'and its index lists others'),
        (edited(Opcode.CHUNK, 0, '<Q', 5, 2), 'declares stamps from 5 to'),
        (edited(Opcode.FOOTER, 0, '<Q', 99), 'its footer places the summary at byte 99'),
        (edited(Opcode.FOOTER, 16, '<I', 99), 'the checksum of its summary does not match'),
        (edited(Opcode.DATA_END, 0, '<I', 99), 'the checksum of its data does not match'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_what_the_file_says_is_checked(bag, tmp_path, change, words):
    findings = replayed(altered(bag, tmp_path / 'bag', change))
    assert findings.verdict is ReplayVerdict.PARTIAL
    assert any(words in fault for fault in findings.faults), findings.faults
    assert all(fault.startswith('the bag is not whole: ') for fault in findings.faults)


def test_a_shortened_index_is_found(bag, tmp_path):
    def change(found):
        which = [i for i, (code, _) in enumerate(found) if code == Opcode.MESSAGE_INDEX][4]
        held = found[which][1]
        (length,) = struct.unpack_from('<I', held, 2)
        found[which] = (found[which][0], held[:2] + struct.pack('<I', length - 16) + held[6:-16])

    faults = replayed(altered(bag, tmp_path / 'bag', change)).faults
    assert any('of them' in fault and 'its index lists' in fault for fault in faults)


def test_a_file_that_ends_within_the_indexes_of_a_chunk_is_only_cut(bag, tmp_path):
    (path,) = bag.glob('*.mcap')
    content, ends = path.read_bytes(), [8]
    found = records(content)
    for _, held in found:
        ends.append(ends[-1] + 9 + len(held))
    codes = [code for code, _ in found]
    # Up to the chunk, and a bit further into each of its indexes
    chunk = len(codes) - 1 - codes[::-1].index(Opcode.CHUNK)
    indexes = codes[chunk:].count(Opcode.MESSAGE_INDEX)
    assert indexes > 1
    cut = tmp_path / 'run_0.mcap'
    for index in range(indexes + 1):
        for more in (0, 5):
            cut.write_bytes(content[: ends[chunk + 1 + index] + more])
            (fault,) = replayed(cut).faults
            assert 'the bag is not complete' in fault


@pytest.mark.parametrize(
    ('field', 'value', 'words'),
    [
        (('message_count',), 5, 'metadata.yaml counts 5 messages in all'),
        (('version',), 4, 'is said to be of version 4, and has the fields of 9'),
        (('version',), 'x', "is said to be of version 'x'"),
        (('storage_identifier',), 'sqlite3', "'sqlite3' stores the bag, its files are .mcap"),
        (
            ('topics_with_message_count', 0, 'topic_metadata', 'offered_qos_profiles'),
            [{'history': 'keep_last', 'depth': 10, 'reliability': 'best_effort'}],
            'metadata.yaml gives /joint_states another quality of service than the file',
        ),
        (('duration', 'nanoseconds'), 5, 'and lasts 5 ns; it begins at'),
        (('starting_time', 'nanoseconds_since_epoch'), 5, 'says that it begins at 5 ns'),
        (('files', 0, 'message_count'), 5, 'metadata.yaml counts 5 messages in run_0.mcap'),
        (('topics_with_message_count', 0, 'message_count'), 5, 'metadata.yaml counts 5 messages'),
        (('relative_file_paths',), ['a_0.mcap'], 'the bag is not complete'),
        (('relative_file_paths',), ['run_0.mcap', 'run_1.mcap'], 'the bag is not complete'),
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


def test_samples_taken_out_with_consistent_statistics(messages, tmp_path):
    """In the middle, at the beginning, at the end: whatever is counted agrees."""
    for name, begin, end in (('middle', 0.75, 2.0), ('head', -1, 1.25), ('tail', 1.75, 4)):
        kept = [
            m
            for m in messages
            if m[0] != '/joint_states' or not begin < (m[2] - samples.START) / 1e9 < end
        ]
        findings = replayed(write(tmp_path / name, kept))
        assert findings.verdict is ReplayVerdict.PARTIAL
        (fault,) = findings.faults
        lost = len(messages) - len(kept)
        assert abs(lost - int(fault.split()[5].replace(',', ''))) <= 20, fault


def test_a_topic_taken_out_with_consistent_statistics(messages, tmp_path):
    topics = [topic for topic in samples.CONTROLLED if topic.name != '/impacts']
    kept = [m for m in messages if m[0] != '/impacts']
    findings = replayed(samples.record(tmp_path / 'bag', kept, topics, custom=NOTES))
    assert findings.verdict is ReplayVerdict.PARTIAL
    (fault,) = findings.faults
    assert fault.endswith('its notes name the topic /impacts, which is not in it')


@pytest.mark.parametrize('numbers', ['gap', 'twice', 'disorder', 'between chunks'])
def test_messages_of_the_node_are_counted_on(messages, tmp_path, numbers):
    counts, numbered = {}, []
    for topic, content, stamp in messages[:2000]:
        counts[topic] = counts.get(topic, -1) + 1
        numbered.append((topic, content, stamp, counts[topic]))
    which = places(numbered, '/joint_states')[300:]
    changes = {
        'gap': lambda n: n + 7,
        'twice': lambda n: n - 1,
        'disorder': lambda n: n ^ 1,
        'between chunks': lambda n: n + 7,
    }
    if numbers == 'between chunks':
        which = [place for place in which if place >= 1000]
    for place in which:
        numbered[place] = (*numbered[place][:3], changes[numbers](numbered[place][3]))
    findings = replayed(write(tmp_path / 'bag', numbered))
    assert findings.verdict is ReplayVerdict.PARTIAL
    fault, *_ = findings.faults
    first = min(numbered[place][3] for place in which[:2])
    if numbers in ('gap', 'between chunks'):
        assert f'message {first - 8} of /joint_states is followed by {first}: 7 mess' in fault
    else:
        assert 'of /joint_states is followed by' in fault


def test_the_time_of_publishing_is_that_of_logging(messages, tmp_path):
    path = tmp_path / 'own.mcap'
    for shift in (0, 3):
        with path.open('wb') as stream:
            writer = Writer(stream)
            writer.start('ros2', bag_file.LIBRARY)
            writer.add_metadata(
                'rosbag2', {'serialized_metadata': yaml.safe_dump({'custom_data': NOTES})}
            )
            channels, counts = {}, {}
            for number, (topic, content, stamp) in enumerate(messages[:500]):
                if topic not in channels:
                    kind = ros2_bags.kind_of(topic)
                    schema = writer.register_schema(kind, 'ros2msg', b'')
                    channels[topic] = writer.register_channel(topic, 'cdr', schema)
                counts[topic] = counts.get(topic, -1) + 1
                published = stamp + shift * (number == 200)
                writer.add_message(channels[topic], stamp, content, published, counts[topic])
            writer.finish()
        faults = replayed(path).faults
        assert len(faults) == (shift > 0), faults
    assert 'is logged at' in faults[0]
    assert faults[0].endswith('which are the same in a bag of this package')


def test_dropped_messages_are_noted_in_the_bag(messages, tmp_path):
    """As many as did not fit into the queue; the reader accounts for them."""
    writer = samples.RunWriter(tmp_path / 'bag', samples.CONTROLLED, custom=NOTES, queue_limit=400)
    writer._flush_interval = writer._poll_period = 0.05
    while writer.dropped == 0:
        for message in messages:
            writer.write(*message)
    summary = writer.close()
    assert summary.dropped > 0
    run = RunReader(tmp_path / 'bag')
    assert run.dropped == summary.dropped
    assert f'it has dropped {summary.dropped:,} messages' in run.remarks()[0]
    list(run)
    assert run.faults() == []


# No false alarms


def faults_of(bag):
    run = RunReader(bag)
    assert sum(1 for _ in run) == run.message_count > 0
    return run.faults() + run.remarks()


def test_a_whole_bag_has_no_faults(bag, tmp_path):
    assert faults_of(bag) == []
    assert faults_of(next(bag.glob('*.mcap'))) == []
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.IDENTICAL
    assert findings.faults == findings.remarks == []
    assert recover_run([str(bag), '--output', str(tmp_path / 'copy')]) == 0
    assert faults_of(tmp_path / 'copy') == []


@pytest.mark.parametrize('share', [0.37, 0.5, 0.77, 0.9, 0.995])
def test_a_cut_bag_has_no_fault_but_that(bag, tmp_path, share):
    content = next(bag.glob('*.mcap')).read_bytes()
    path = tmp_path / 'cut.mcap'
    path.write_bytes(content[: int(len(content) * share)])
    assert faults_of(path) == []
    (fault,) = replayed(path).faults
    assert 'the bag is not complete' in fault
    assert recover_run([str(path)]) == 0
    assert faults_of(tmp_path / 'cut_recovered') == []
    assert replayed(tmp_path / 'cut_recovered').verdict is ReplayVerdict.IDENTICAL


def test_several_files_of_the_node_recovered_into_one(messages, tmp_path):
    """Each file counts its messages anew, or goes on from the one before."""
    half = len(messages) // 2
    parts = messages[:half], messages[half:]
    for name, going_on in (('anew', False), ('on', True)):
        counts = {}
        (tmp_path / name).mkdir()
        for number, part in enumerate(parts):
            if not going_on:
                counts = {}
            numbered = []
            for topic, content, stamp in part:
                counts[topic] = counts.get(topic, -1) + 1
                numbered.append((topic, content, stamp, counts[topic]))
            write(tmp_path / f'{name}_{number}', numbered)
            (path,) = (tmp_path / f'{name}_{number}').glob('*.mcap')
            path.rename(tmp_path / name / f'run_{number}.mcap')
        assert faults_of(tmp_path / name) == []
        assert recover_run([str(tmp_path / name)]) == 0
        assert faults_of(tmp_path / f'{name}_recovered') == []
        assert replayed(tmp_path / f'{name}_recovered').verdict is ReplayVerdict.IDENTICAL


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize(
    'index', [IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE]
)
@pytest.mark.parametrize('crcs', [True, False])
def test_files_of_mcap(messages, tmp_path, compression, index, crcs):
    path = tmp_path / 'other.mcap'
    for chunked in (True, False):
        with path.open('wb') as stream:
            writer = Writer(
                stream,
                chunk_size=20_000,
                compression=compression,
                index_types=index,
                use_chunking=chunked,
                enable_crcs=crcs,
                enable_data_crcs=crcs,
                use_statistics=crcs,
                use_summary_offsets=not crcs,
            )
            writer.start('ros2', 'other')
            channels = {}
            for topic, content, stamp in ros2_bags.joined(messages[:600], 0):
                if topic not in channels:
                    schema = writer.register_schema(ros2_bags.kind_of(topic), 'ros2msg', b'')
                    channels[topic] = writer.register_channel(topic, 'cdr', schema)
                writer.add_message(channels[topic], stamp, content, stamp - 5000)
            writer.add_attachment(1, 1, 'note', 'text/plain', b'kept')
            writer.finish()
        assert faults_of(path) == []
        if crcs:
            content = bytearray(path.read_bytes())
            content[content.index(b'kept')] ^= 1
            path.write_bytes(content)
            assert any('checksum of its data' in fault for fault in RunReader(path).faults())


@pytest.mark.parametrize(
    ('mode', 'storage'),
    [
        (mode, storage)
        for mode in CompressionMode
        for storage in StoragePlugin
        if mode is not CompressionMode.STORAGE or storage is StoragePlugin.MCAP
    ],
)
def test_bags_of_rosbags(messages, tmp_path, mode, storage):
    writer = PeerWriter(tmp_path / 'bag', version=9, storage_plugin=storage)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    arrived = ros2_bags.joined(messages[:3000], 0)
    with writer:
        connections = {
            topic: writer.add_connection(topic, ros2_bags.kind_of(topic), typestore=samples.STORE)
            for topic in sorted({topic for topic, *_ in arrived})
        }
        for topic, content, stamp in arrived:
            writer.write(connections[topic], stamp, content)
    assert faults_of(tmp_path / 'bag') == []
    assert [(r.topic, r.content, r.stamp_ns) for r in RunReader(tmp_path / 'bag')] == arrived
    assert replayed(tmp_path / 'bag').verdict is ReplayVerdict.IDENTICAL


def test_a_file_of_mcap_ros2_support(tmp_path):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = Ros2Writer(stream)
        schema = writer.register_msgdef('std_msgs/msg/String', 'string data')
        for stamp in range(1000):
            writer.write_message('/text', schema, {'data': 'x'}, stamp, stamp, 0)
        writer.finish()
    assert faults_of(path) == []


@pytest.mark.parametrize('form', [{'files': 3}, {'file_zstd': True}, {'message_zstd': True}])
def test_bags_of_ros2_bag_record(messages, tmp_path, form):
    arrived = ros2_bags.joined(messages, samples.START + 10**9)
    assert faults_of(ros2_bags.write_bag(tmp_path / 'bag', arrived, **form)) == []


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


def test_checksums_are_those_of_the_format(bag):
    """The summary's checksum by its definition, on a file of this package."""
    content = next(bag.glob('*.mcap')).read_bytes()
    start, _, crc = struct.unpack('<QQI', content[-28:-8])
    assert zlib.crc32(content[start:-12]) == crc
