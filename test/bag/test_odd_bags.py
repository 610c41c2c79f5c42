"""Bags that other recorders write, or that a power cut leaves, through the commands."""

import contextlib
import json
import re
import shutil
import struct

import lz4.frame
import pytest
from bag import ros2_bags, samples
from bag.alterations import (
    chunks_of,
    cut,
    definition_of,
    kind_of,
    records,
    rewritten,
    with_records,
    write_file,
)
from bag.recorded_rig import RecordedRig
from mcap.reader import make_reader
from mcap.writer import CompressionType

from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run


@pytest.fixture(scope='module')
def messages():
    return RecordedRig(rate=200.0).start().run(400).messages


def command(main, capsys, *arguments):
    """Run a command; return its exit code and what it prints."""
    code = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    assert 'Traceback' not in captured.err
    return code, captured.out + captured.err


def is_identical(path, capsys):
    code, text = command(replay_run, capsys, path)
    assert code == 0, text
    assert 'verdict     identical' in text


def stored(path):
    """Return type, topic, sequence, both times and content of what a file holds, in its order."""
    (file,) = path.glob('*.mcap') if path.is_dir() else [path]
    with file.open('rb') as stream:
        return [
            (s.name if s else '', c.topic, m.sequence, m.log_time, m.publish_time, m.data)
            for s, c, m in make_reader(stream).iter_messages(log_time_order=False)
        ]


# Of other recorders


@pytest.mark.parametrize(
    'options',
    [
        {'use_chunking': False},
        {'profile': ''},
        {'kinds': lambda topic: kind_of(topic).replace('/msg/', '/')},
        {'definition': lambda _: b''},
    ],
    ids=['fastwrite', 'no_profile', 'short_types', 'no_text'],
)
@pytest.mark.parametrize('finished', [True, False])
def test_files_of_other_recorders(tmp_path, messages, options, finished, capsys):
    path = write_file(tmp_path / 'run.mcap', messages, **options)
    if finished:
        is_identical(path, capsys)
    else:
        rewritten(path, cut(0.5))
        code, text = command(replay_run, capsys, path)
        assert (code, 'identical as far as it could be compared' in text) == (3, True)
    code, text = command(recover_run, capsys, path)
    assert (code, 'nothing was lost' in text) == (0, finished)
    saved = stored(tmp_path / 'run_recovered')
    assert saved == [(kind_of(t), t, 5, s, s - 777, c) for t, c, s in messages[: len(saved)]]
    assert len(saved) == len(messages) if finished else len(saved) > len(messages) // 4


def test_topics_without_a_type_are_named(tmp_path, messages, capsys):
    path = write_file(tmp_path / 'run.mcap', messages, schemas=False)
    code, text = command(replay_run, capsys, path)
    assert code == 2
    assert '/snapshot of no type' in text


@pytest.mark.parametrize('first', [True, False])
def test_two_types_on_one_topic(tmp_path, messages, first, capsys):
    """Another program publishes notes on the topic of the joint states."""
    note = samples.serialise(samples.STRING, samples.make(samples.STRING, 'a note'))

    def add(writer):
        text = definition_of(samples.STRING)
        schema = writer.register_schema(samples.STRING, 'ros2msg', text)
        channel = writer.register_channel('/joint_states', 'cdr', schema)
        stamp = messages[0 if first else -1][2]
        writer.add_message(channel, stamp, note, stamp)

    path = write_file(tmp_path / 'run.mcap', messages, extra=add, extra_first=first)
    is_identical(path, capsys)
    code, text = command(recover_run, capsys, path)
    assert (code, 'nothing was lost' in text) == (0, True)
    assert stored(tmp_path / 'run_recovered') == stored(path)
    is_identical(tmp_path / 'run_recovered', capsys)
    topics = RunReader(tmp_path / 'run_recovered').topics
    assert topics['/joint_states', samples.STRING].message_count == 1


def test_recovery_names_what_is_not_a_message(tmp_path, messages, capsys):
    def add(writer):
        writer.add_attachment(11, 22, 'photo.jpg', 'image/jpeg', b'\xff\xd8' * 5000)
        writer.add_metadata('operator', {'name': 'A', 'room': '12'})

    directory = tmp_path / 'run'
    directory.mkdir()
    path = write_file(directory / 'run_0.mcap', messages, extra=add)
    (directory / 'note.txt').write_text('the third one')
    before = stored(path)
    # A record of a kind of its own, which only its maker can copy
    rewritten(path, with_records(lambda found: [found[0], (0x90, b'mine'), *found[1:]]))
    code, text = command(recover_run, capsys, directory)
    assert code == 0
    assert 'not copied: the file note.txt beside the bag' in text
    assert 'not copied: 3 records of other programs, such as attachments (mcap recover' in text
    assert stored(tmp_path / 'run_recovered') == before


# The files of a directory


def test_the_bag_is_what_metadata_yaml_lists(tmp_path, messages, capsys):
    bag = ros2_bags.write_bag(tmp_path / 'bag', messages, files=2)
    shutil.copy(bag / 'bag_0.mcap', bag / 'bag_0 (copy).mcap')
    (bag / '._bag_1.mcap').write_bytes(b'Mac OS X')
    is_identical(bag, capsys)
    code, text = command(recover_run, capsys, bag)
    assert code == 0
    assert f'saved {len(messages)} messages' in text
    assert 'not copied: the file bag_0 (copy).mcap beside the bag' in text


def test_hidden_files_are_no_part_of_a_bag(tmp_path, messages, capsys):
    bag = ros2_bags.write_bag(tmp_path / 'bag', messages)
    (bag / '._bag_0.mcap').write_bytes(b'Mac OS X')
    (bag / 'metadata.yaml').unlink()
    code, text = command(replay_run, capsys, bag)
    assert code == 3
    assert 'identical as far as it could be compared' in text


# Cut and damaged


def test_a_tail_of_zeros_loses_what_a_cut_loses(tmp_path, messages, capsys):
    """After a power cut the length of a file may be there, and not its content."""
    path = write_file(tmp_path / 'whole.mcap', messages)
    content = path.read_bytes()
    for part in (3, 5, 8):
        cut = len(content) * part // 10
        for name, held in (
            (f'cut_{part}', content[:cut]),
            (f'zeros_{part}', content[:cut] + bytes(20_000)),
        ):
            (tmp_path / f'{name}.mcap').write_bytes(held)
            code, text = command(replay_run, capsys, tmp_path / f'{name}.mcap')
            assert (code, 'identical as far as it could be compared' in text) == (3, True)
            assert command(recover_run, capsys, tmp_path / f'{name}.mcap')[0] == 0
        saved = [stored(tmp_path / f'{name}_{part}_recovered') for name in ('cut', 'zeros')]
        assert saved[0] == saved[1] == stored(path)[: len(saved[0])]
        assert len(saved[0]) > len(messages) * (part - 2) // 10


def unpacks(chunk):
    """Return whether the LZ4 of a chunk can be unpacked, whatever comes out."""
    head = struct.calcsize('<QQQI') + len(b'....lz4') + struct.calcsize('<Q')
    with contextlib.suppress(RuntimeError):
        lz4.frame.decompress(chunk[head:])
        return True
    return False


@pytest.mark.parametrize('compression', list(CompressionType))
def test_a_damaged_chunk_is_saved_in_part(tmp_path, messages, compression, capsys):
    path = tmp_path / 'run.mcap'
    ros2_bags.write_file(path, messages, sorted({topic for topic, *_ in messages}), compression)
    chunks = chunks_of(records(path.read_bytes()))

    def hurt(found):
        """Of LZ4 where it still unpacks: other damage of its one block loses the whole chunk."""
        opcode, held = found[chunks[1]]
        for place in range(len(held) * 6 // 10, len(held) - 8):
            changed = held[:place] + b'\xff' * 8 + held[place + 8 :]
            if compression is not CompressionType.LZ4 or unpacks(changed):
                break
        found[chunks[1]] = opcode, changed

    rewritten(path, with_records(hurt))
    code, text = command(recover_run, capsys, path)
    assert code == 0
    assert re.search(r'fault: the chunk at byte \d+ is damaged \(.*\); \d+ of its messages', text)
    (doubtful,) = re.findall(r'some may be altered: (\d+) messages', text)
    saved = {
        (topic, content, stamp)
        for _, topic, _, stamp, _, content in stored(tmp_path / 'run_recovered')
    }
    assert len(saved - set(messages)) <= int(doubtful)
    lost = len(set(messages) - saved)
    assert lost < len(messages) // len(chunks)
    if compression is CompressionType.NONE:
        assert lost <= 2


def test_stamps_beyond_those_of_ros(tmp_path, messages, capsys):
    """In place of a traceback of numpy: the stamp is named, and the rest saved."""
    far = [*messages]
    topic, content, _ = far[100]
    far[100] = topic, content, 2**63
    path = write_file(tmp_path / 'run.mcap', far)
    code, text = command(replay_run, capsys, path)
    assert code == 3
    assert 'a message is stamped 9223372036854775808 ns; stamps end at' in text
    code, text = command(recover_run, capsys, path)
    assert (code, f'saved {len(messages) - 1} messages' in text) == (0, True)


def test_findings_of_a_reader_of_json(tmp_path, messages, capsys):
    """The same messages give the same findings in every form."""
    arrived = ros2_bags.joined(messages, 0)
    found = []
    for number, bag in enumerate(
        (
            ros2_bags.write_bag(tmp_path / 'a', arrived),
            ros2_bags.write_bag(tmp_path / 'b', arrived, files=3),
            ros2_bags.write_bag(tmp_path / 'c', arrived, compression=CompressionType.LZ4),
            write_file(tmp_path / 'e.mcap', arrived, use_chunking=False),
        )
    ):
        result = tmp_path / f'{number}.json'
        assert command(replay_run, capsys, bag, '--json', result)[0] == 0
        held = json.loads(result.read_text())
        found.append({key: value for key, value in held.items() if key != 'bag'})
    assert all(held == found[0] for held in found)
