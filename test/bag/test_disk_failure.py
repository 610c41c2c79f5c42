"""What happens when the disk does not play along: said clearly, and nothing flushed is lost."""

import errno
import itertools
import os
import resource
import shutil

import pytest
from bag import samples
from rosbags.rosbag2 import Reader
from running import until
from small_disk import mounted

from impact_damper_ros.bag import (
    RecordingError,
    RunReader,
    RunWriter,
    Topic,
    bag_file,
    recover_run,
)
from impact_damper_ros.bag.run_writer import create_run_directory

NOTE = Topic('/note', samples.STRING)


@pytest.fixture
def small_disk(tmp_path):
    """Mount a file system of 256 kB."""
    with mounted(tmp_path / 'disk', 256) as directory:
        yield directory


def write_until_it_fails(writer):
    """Write incompressible messages until the writer has failed; return how many."""
    stamps = itertools.count()

    def failed():
        for _ in range(5):
            text = samples.make(samples.STRING, os.urandom(512).hex())
            writer.write('/note', samples.serialise(samples.STRING, text), next(stamps))
        return writer.error is not None

    until(failed)
    return next(stamps)


def test_full_disk(small_disk, tmp_path):
    bag = small_disk / 'run'
    told = []
    writer = RunWriter(bag, [NOTE], flush_period=0.05, on_error=lambda: told.append(writer.error))
    count = write_until_it_fails(writer)
    assert told == [writer.error]
    for _ in range(10):
        assert not writer.write('/note', b'', 0)
    writer.close()
    writer.close()

    text = str(writer.error)
    assert str(bag) in text
    assert 'the disk is full' in text
    assert 'choose another directory' in text
    assert not (bag / 'metadata.yaml').exists()
    assert writer.message_count + writer.dropped == count + 10
    assert writer.message_count > 50

    # The file ends with a whole record, and holds what the summary says.
    run = RunReader(bag)
    assert run.unusable == 0
    assert [record.stamp_ns for record in run] == list(range(writer.message_count))
    # The output is on the full disk: an error, and nothing half made left behind.
    with pytest.raises(RecordingError, match='the disk is full'):
        recover_run(bag)
    assert [path.name for path in small_disk.iterdir()] == ['run']
    recovery = recover_run(bag, tmp_path / 'saved')
    assert recovery.message_count == writer.message_count
    with Reader(tmp_path / 'saved') as reader:
        stamps = [stamp for _, stamp, _ in reader.messages()]
    assert stamps == list(range(writer.message_count))


def test_a_file_that_may_not_grow(tmp_path):
    """A limit on the size of files, which needs no rights to set: cut within a write."""
    writer = RunWriter(tmp_path / 'bag', [NOTE], flush_period=0.05)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limits[1]))
    try:
        count = write_until_it_fails(writer)
        writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert 'the file has reached the largest size allowed' in str(writer.error)
    assert writer.message_count + writer.dropped == count
    assert writer.message_count > 20
    run = RunReader(tmp_path / 'bag')
    assert run.unusable == 0
    assert [record.stamp_ns for record in run] == list(range(writer.message_count))


def test_disk_that_fills_up_at_the_very_end(tmp_path, monkeypatch):
    """The summary does not fit any more: all messages are there, the bag is not complete."""
    writer = RunWriter(tmp_path / 'bag', [NOTE], flush_period=0.05)
    for stamp in range(50):
        writer.write('/note', samples.snapshot(stamp), stamp)
    until(lambda: RunReader(tmp_path / 'bag').message_count >= 50)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(bag_file.os, 'write', full)
    writer.close()
    monkeypatch.undo()
    assert 'the disk is full' in str(writer.error)
    assert (writer.message_count, writer.dropped) == (50, 0)
    run = RunReader(tmp_path / 'bag')
    assert (run.message_count, run.complete, run.unusable) == (50, False, 0)


def test_a_write_that_is_done_in_parts(tmp_path, monkeypatch):
    """The kernel may take fewer bytes than it is given."""
    real = os.write
    monkeypatch.setattr(bag_file.os, 'write', lambda fd, content: real(fd, content[:7]))
    bag = samples.record(tmp_path / 'bag', samples.run(20))
    with Reader(bag) as reader:
        assert reader.message_count == len(samples.run(20))
        assert len(list(reader.messages())) == len(samples.run(20))


def test_a_failing_device_while_syncing(tmp_path, monkeypatch):
    writer = RunWriter(tmp_path / 'bag', [NOTE], flush_period=0.02, sync_period=0.05)

    def fail(_):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(bag_file.os, 'fsync', fail)
    write_until_it_fails(writer)
    writer.close()
    assert os.strerror(errno.EIO) in str(writer.error)


def test_directory_is_a_file(tmp_path):
    (tmp_path / 'file').write_text('not a directory')
    with pytest.raises(RecordingError, match='file'):
        RunWriter(tmp_path / 'file', [NOTE])
    with pytest.raises(RecordingError, match='a part of the path is a file'):
        RunWriter(tmp_path / 'file' / 'run', [NOTE])
    with pytest.raises(RecordingError, match='it is a file, not a directory; move'):
        create_run_directory(tmp_path / 'file')
    with pytest.raises(RecordingError, match='a part of the path is a file'):
        create_run_directory(tmp_path / 'file' / 'runs')
    assert (tmp_path / 'file').read_text() == 'not a directory'


@pytest.mark.parametrize(
    ('number', 'words'),
    [
        (errno.EACCES, 'permission is denied; give yourself permission'),
        (errno.EROFS, 'the file system is read-only; choose'),
        (errno.EDQUOT, 'the disk quota is used up; free'),
        (errno.EBUSY, os.strerror(errno.EBUSY)),
    ],
)
def test_error_names_path_cause_and_remedy(tmp_path, monkeypatch, number, words):
    def refuse(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(bag_file._FlushedFile, '__init__', refuse)
    with pytest.raises(RecordingError) as caught:
        RunWriter(tmp_path / 'bag', [NOTE])
    assert str(caught.value).startswith(f"cannot record to '{tmp_path}/bag/bag_0.mcap': {words}")
    assert caught.value.path == tmp_path / 'bag' / 'bag_0.mcap'


def test_directory_vanishes(tmp_path):
    writer = RunWriter(tmp_path / 'bag', [NOTE], flush_period=0.02)
    writer.write('/note', samples.snapshot(1), 1)
    shutil.rmtree(tmp_path / 'bag')
    write_until_it_fails(writer)
    writer.close()
    assert str(tmp_path / 'bag') in str(writer.error)
    assert not (tmp_path / 'bag').exists()
