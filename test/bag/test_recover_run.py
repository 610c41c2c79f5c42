"""Salvage: whatever the cut, all that is whole is saved, and only that."""

import contextlib
import random

import pytest
from bag import samples
from bag.alterations import cut, placed, rewritten, write, write_file
from hypothesis import given, strategies as st
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.writer import CompressionType
from rosbags.rosbag2 import Reader

from impact_damper_ros.bag import RecordingError, RunReader, bag_file, recover_run
from impact_damper_ros.cli import recover_run as command


@pytest.fixture(scope='module')
def messages():
    return samples.run(200)


@pytest.fixture(scope='module')
def finished(tmp_path_factory, messages):
    """Make a bag of chunks of 40 messages each, the same at every run."""
    directory = tmp_path_factory.mktemp('bags') / 'run_7'
    write(directory, messages, every=40, notes={'note': 'kept'})
    return directory / 'run_7_0.mcap'


def cut_file(tmp_path, content, name='cut.mcap'):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def check(content, size, tmp_path, messages):
    """Recover a file cut at `size` and compare with what the chunks before it held."""
    ends = [end for opcode, _, end in placed(content) if opcode == Opcode.CHUNK]
    expected = messages[: min(40 * sum(end <= size for end in ends), len(messages))]
    path = cut_file(tmp_path, content[:size], f'cut_{size}.mcap')
    output = tmp_path / f'cut_{size}_recovered'
    if not expected:
        with pytest.raises(RecordingError):
            recover_run(path)
        assert not output.exists()
    else:
        recovery = recover_run(path)
        assert recovery.output == output
        assert recovery.message_count == len(expected)
        assert recovery.was_complete == (size == len(content))
        run = RunReader(output)
        read = [(r.topic, r.content, r.stamp_ns) for r in run]
        assert read == sorted(expected, key=lambda message: message[2])
        assert run.complete
        assert run.custom['note'] == 'kept'
        whole = max(end for _, _, end in placed(content) if end <= size)
        unusable = 0 if size == len(content) else size - whole
        assert recovery.unusable == unusable
        for file in output.iterdir():
            file.unlink()
        output.rmdir()
    assert path.read_bytes() == content[:size]
    assert sorted(tmp_path.iterdir()) == [path]
    path.unlink()


def test_cuts_at_every_border(finished, tmp_path, messages):
    """At the end of each record, one byte before and after, and in its head."""
    content = finished.read_bytes()
    sizes = {0, 1, 7, 8, 9, len(content) - 1, len(content)}
    chunks = [(start, end) for opcode, start, end in placed(content) if opcode == Opcode.CHUNK]
    for _, start, end in placed(content):
        # Between the second chunk and the last one, and in the summary, it is always the same.
        if not chunks[1][1] < start < chunks[-1][0] and end <= chunks[-1][1]:
            sizes |= {start + 1, start + 8, start + 9, start + 10, end - 1, end, end + 1}
    sizes |= set(random.Random(2).sample(range(chunks[-1][1], len(content)), 10))
    for size in sorted(sizes):
        check(content, size, tmp_path, messages)


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('chunked', [True, False])
def test_cut_in_a_large_chunk(tmp_path, compression, chunked):
    """Where the format allows, messages before the cut are saved out of the last chunk itself."""
    path = tmp_path / 'other.mcap'
    noise = random.Random(3)
    contents = [noise.randbytes(1000) for _ in range(1000)]
    write_file(
        path,
        [('/a', content, stamp) for stamp, content in enumerate(contents)],
        sent=lambda stamp: stamp,
        compression=compression,
        use_chunking=chunked,
        chunk_size=2**30,
    )
    rewritten(path, cut(0.6))
    recovery = recover_run(path)
    # zstd and lz4 give up whole blocks only (of 128 and 64 kB).
    assert 400 < recovery.message_count < 610
    records_ = list(RunReader(recovery.output))
    assert [r.stamp_ns for r in records_] == list(range(recovery.message_count))
    assert [r.content for r in records_] == contents[: recovery.message_count]
    assert list(RunReader(path)) == records_


def test_a_hole_in_the_middle(finished, tmp_path, messages):
    """After a power cut a page may be zero: that chunk is lost, those after it are not."""
    content = bytearray(finished.read_bytes())
    chunks = [(s, e) for opcode, s, e in placed(content) if opcode == Opcode.CHUNK]
    start, end = chunks[3]
    content[start + 200 : end] = bytes(end - start - 200)
    path = cut_file(tmp_path, bytes(content[: chunks[-1][0]]))
    recovery = recover_run(path)
    kept = messages[: 40 * 3] + messages[40 * 4 : 40 * (len(chunks) - 1)]
    assert recovery.message_count == len(kept)
    assert recovery.unusable == end - start
    read = [(r.topic, r.content, r.stamp_ns) for r in RunReader(recovery.output)]
    assert read == sorted(kept, key=lambda message: message[2])


def test_messages_that_random_damage_may_have_altered_are_counted(finished, tmp_path, messages):
    content = finished.read_bytes()
    known = set(messages)
    chance, doubts = random.Random(5), 0
    for number in range(60):
        hurt = bytearray(content[: chance.randrange(8, len(content))])
        for _ in range(chance.randrange(1, 4)):
            hurt[chance.randrange(len(hurt))] = chance.randrange(256)
        path = cut_file(tmp_path, bytes(hurt), f'hurt_{number}.mcap')
        try:
            recovery = recover_run(path)
        except RecordingError:
            continue
        saved = {(r.topic, r.content, r.stamp_ns) for r in RunReader(recovery.output)}
        assert len(saved - known) <= recovery.doubtful
        doubts += recovery.doubtful
    assert doubts > 100


def read_by_others(path):
    """Return how many messages `mcap` or `rosbags` reads, whichever reads more."""
    counts = [0, 0]
    with contextlib.suppress(Exception), path.open('rb') as stream:
        for _ in SeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False):
            counts[0] += 1
    with contextlib.suppress(Exception), Reader(path) as reader:
        for _ in reader.messages():
            counts[1] += 1
    return max(counts)


@given(data=st.data())
def test_other_readers_read_no_more_of_damaged_bytes(finished, tmp_path_factory, data):
    """Of one altered bit anywhere, or in the head of a record; what is lost is counted once."""
    content = bytearray(finished.read_bytes())
    heads = [(start, min(start + 44, end)) for _, start, end in placed(content)]
    begin, end = data.draw(st.sampled_from([(0, len(content)), *heads]))
    at = data.draw(st.integers(begin, end - 1))
    content[at] ^= 1 << data.draw(st.integers(0, 7))
    path = cut_file(tmp_path_factory.mktemp('hurt'), content)
    saved = 0
    with contextlib.suppress(RecordingError):
        recovery = recover_run(path)
        saved = recovery.message_count
        assert recovery.unusable <= len(content)
    assert saved >= read_by_others(path)


def test_each_byte_of_the_heads_of_records(finished, tmp_path, messages):
    """All messages are saved whatever bit of a head is altered, but for those of the file."""
    content = finished.read_bytes()
    path = tmp_path / 'hurt.mcap'
    dice = random.Random(4)
    places_ = [start + k for _, start, _ in placed(content) for k in range(9)]
    for at in dice.sample(places_, 80):
        hurt = bytearray(content)
        hurt[at] ^= 1 << dice.randrange(8)
        path.write_bytes(hurt)
        reader = RunReader(path)
        assert reader.message_count == len(messages), at
        assert reader.faults() or not reader.complete, at


def test_a_directory_without_metadata(finished, tmp_path, messages):
    bag = tmp_path / 'run_7'
    bag.mkdir()
    (bag / finished.name).write_bytes(finished.read_bytes())
    assert not RunReader(bag).complete
    recovery = recover_run(bag)
    assert recovery.output == tmp_path / 'run_7_recovered'
    assert not recovery.was_complete
    assert [path.name for path in bag.iterdir()] == [finished.name]
    names = sorted(path.name for path in recovery.output.iterdir())
    assert names == ['metadata.yaml', 'run_7_recovered_0.mcap']
    notes = {'recovered_from': 'run_7', 'lost_bytes': '0', 'doubtful': '0'}
    assert RunReader(recovery.output).custom == {'note': 'kept', **notes}
    (bag / 'metadata.yaml').write_bytes(b'\0\0\0')
    assert recover_run(bag, tmp_path / 'again').message_count == len(messages)


def test_channels_keep_their_description(finished, tmp_path):
    path = cut_file(tmp_path, finished.read_bytes()[:-1])
    recover_run(path)
    with Reader(finished.parent) as before, Reader(tmp_path / 'cut_recovered') as after:
        for old, new in zip(before.connections, after.connections, strict=True):
            assert (old.topic, old.msgtype, old.digest, old.msgdef, old.ext, old.msgcount) == (
                (new.topic, new.msgtype, new.digest, new.msgdef, new.ext, new.msgcount)
            )


def test_nothing_is_overwritten(finished, tmp_path):
    path = cut_file(tmp_path, finished.read_bytes())
    first = recover_run(path)
    content = {file.name: file.read_bytes() for file in first.output.iterdir()}
    with pytest.raises(RecordingError, match='it exists already; give another'):
        recover_run(path)
    assert {file.name: file.read_bytes() for file in first.output.iterdir()} == content
    (tmp_path / 'empty').mkdir()
    with pytest.raises(RecordingError, match='it exists already'):
        recover_run(path, tmp_path / 'empty')
    with pytest.raises(RecordingError, match='its name is not text in UTF-8'):
        recover_run(path, tmp_path / 'a\udcff')
    assert not [file for file in tmp_path.iterdir() if 'a' in file.name and 'cut' not in file.name]


def test_nothing_half_made_is_left(finished, tmp_path, monkeypatch):
    path = cut_file(tmp_path, finished.read_bytes())

    def fail(*_):
        raise OSError(5, 'Input/output error')

    monkeypatch.setattr(bag_file.BagMetadata, 'write', fail)
    with pytest.raises(RecordingError, match='Input/output error'):
        recover_run(path)
    assert list(tmp_path.iterdir()) == [path]


def test_command_reports_what_was_saved(finished, tmp_path, capsys):
    content = finished.read_bytes()
    chunks = [end for opcode, _, end in placed(content) if opcode == Opcode.CHUNK]
    path = cut_file(tmp_path, content[: chunks[4] + 100])
    assert command.main([str(path)]) == 0
    text = capsys.readouterr().out
    assert 'saved 200 messages over 0.' in text
    assert str(tmp_path / 'cut_recovered') in text
    assert 'bytes not usable: ' in text
    for topic in samples.TOPICS:
        assert topic.name in text
    assert f'stamps {samples.START} to' in text


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (b'', 'the file is empty (0 bytes)'),
        (b'\x89MCAP', 'no complete message was found in it'),
        (b'not a bag', 'it is not an MCAP file'),
        (None, 'there is no such file or directory'),
    ],
)
def test_command_with_nothing_to_save(tmp_path, content, words, capsys):
    path = tmp_path / 'bag.mcap'
    if content is not None:
        path.write_bytes(content)
    assert command.main([str(path)]) == 1
    captured = capsys.readouterr()
    assert captured.out == ''
    assert words in captured.err
    assert not (tmp_path / 'bag_recovered').exists()
