"""Recording while the run goes on: queue, flushes, kill -9, several writers at once."""

from __future__ import annotations

import contextlib
import signal
import struct
import textwrap
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from bag import samples
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from running import Running, until

from impact_damper_ros.bag import RecordingError, RunReader, RunWriter, Topic, run_writer
from impact_damper_ros.bag.run_writer import create_run_directory

NOTE = Topic('/note', samples.STRING)


def salvaged(path):
    """Return the messages that the stream reader of `mcap` finds in a file that grows."""
    messages = []
    with path.open('rb') as stream, contextlib.suppress(EndOfFile, struct.error):
        messages.extend(r for r in StreamReader(stream).records if isinstance(r, Message))
    return messages


def at_once(count, work):
    """Let so many threads work at once, each with its number."""
    barrier = threading.Barrier(count)

    def run(number):
        barrier.wait()
        work(number)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_the_first_messages_do_not_wait(tmp_path, monkeypatch):
    """No flush interval has passed, nor ever will: the clock stands still."""
    monkeypatch.setattr(run_writer, 'time', SimpleNamespace(monotonic=lambda: 5.0))
    with RunWriter(tmp_path / 'bag', [NOTE]) as writer:
        writer.write('/note', samples.snapshot(1), 1)
        until(lambda: len(salvaged(writer.path)) == 1)


class StepTime:
    """
    A clock, and an event whose time-outs move it on, for the threads of a writer.

    Each step of the time a message is written, and noted which ones are not in the file although
    they were written a flush period before.
    """

    STEP = 0.02
    FOREVER = 1e6

    def __init__(self, period):
        self.now = 0.0
        self.period = period
        self.written: list[float] = []
        self.late: list[tuple[float, int]] = []
        self.writer: RunWriter | None = None
        self._set = threading.Event()
        self._ready = threading.Event()

    def begin(self, writer):
        self.writer = writer
        self._ready.set()

    def monotonic(self):
        return self.now

    def set(self):
        self._set.set()

    def is_set(self):
        return self._set.is_set()

    def clear(self):
        """Remain set: it also stands for the event that ends the writer."""

    def wait(self, timeout):
        if timeout < self.FOREVER:
            self._ready.wait()
            until = self.now + timeout
            while (following := len(self.written) * self.STEP) < until:
                self.now = following
                self._step()
            self.now = until
        else:
            self._set.wait()
        return self._set.is_set()

    def _step(self):
        assert self.writer is not None
        due = sum(moment + self.period <= self.now for moment in self.written)
        present = len(salvaged(self.writer.path))
        if present < due:
            self.late.append((self.now, due - present))
        stamp = len(self.written)
        self.writer.write('/note', samples.snapshot(stamp), stamp)
        self.written.append(self.now)
        if len(self.written) > 100:
            self.set()


@pytest.mark.parametrize('period', [0.05, 0.5])
def test_no_message_waits_longer_than_the_flush_period(tmp_path, monkeypatch, period):
    """Every message is in the file one flush period after it was written."""
    time = StepTime(period)
    threads = SimpleNamespace(
        Event=lambda: time,
        **{name: getattr(threading, name) for name in ('Lock', 'RLock', 'Thread')},
    )
    monkeypatch.setattr(run_writer, 'time', time)
    monkeypatch.setattr(run_writer, 'threading', threads)
    with RunWriter(
        tmp_path / 'bag', [NOTE], flush_period=period, sync_period=StepTime.FOREVER
    ) as writer:
        time.begin(writer)
        time._set.wait()
    assert writer.error is None
    assert len(time.written) > 100
    assert time.late == []


def test_close_is_idempotent_and_says_what_the_bag_holds(tmp_path):
    writer = RunWriter(tmp_path / 'bag', samples.TOPICS)
    messages = samples.run(300)
    for message in messages:
        writer.write(*message)
    writer.close()
    assert (writer.error, writer.message_count, writer.dropped) == (None, len(messages), 0)
    assert writer.path == tmp_path / 'bag' / 'bag_0.mcap'
    content = writer.path.read_bytes()
    assert not writer.write('/snapshot', b'', 0)
    writer.close()
    assert writer.dropped == 1
    assert writer.drop_reason == 'the recording had ended'
    assert writer.path.read_bytes() == content


def test_many_threads_write_at_once(tmp_path):
    topics = [Topic(f'/topic_{k}', samples.STRING) for k in range(4)]
    count = 2000

    def work(index):
        for k in range(count):
            assert writer.write(topics[index].name, samples.snapshot(k), 4 * k + index)

    with RunWriter(tmp_path / 'bag', topics, flush_period=0.02) as writer:
        at_once(4, work)
    records = list(RunReader(tmp_path / 'bag'))
    assert [record.stamp_ns for record in records] == list(range(4 * count))
    for index, topic in enumerate(topics):
        contents = [record.content for record in records if record.topic == topic.name]
        assert contents == [samples.snapshot(k) for k in range(count)], index


def test_a_full_queue_drops_and_counts(tmp_path):
    writer = RunWriter(tmp_path / 'bag', [NOTE], flush_period=60.0, queue_limit=100)
    accepted = [writer.write('/note', samples.snapshot(k), k) for k in range(150)]
    assert accepted == [True] * 100 + [False] * 50
    assert writer.backlog == 100
    writer.close()
    assert (writer.message_count, writer.dropped, writer.error) == (100, 50, None)
    assert 'more than 100 messages waited' in writer.drop_reason
    run = RunReader(tmp_path / 'bag')
    # The file alone has it, too, in its last metadata
    assert run.dropped == RunReader(run.files[0].path).dropped == 50
    assert 'it has dropped 50 messages' in run.remarks()[0]


def test_two_topics_of_one_name_are_refused(tmp_path):
    with pytest.raises(ValueError, match='same name'):
        RunWriter(tmp_path / 'bag', [NOTE, NOTE])


def test_directories_made_in_one_second_differ(tmp_path):
    made = []

    def make(_):
        made.extend(create_run_directory(tmp_path / 'runs', when=0.0) for _ in range(5))

    at_once(8, make)
    assert len(set(made)) == 40
    assert all(directory.is_dir() for directory in made)
    assert {directory.name[:4] for directory in made} == {'run_'}


def test_two_writers_cannot_share_a_directory(tmp_path):
    """Whichever comes second is told so, also when both come at once."""
    for attempt in range(5):
        directory = tmp_path / f'bag_{attempt}'
        writers = []
        errors = []

        def make(_, directory=directory, writers=writers, errors=errors):
            try:
                writers.append(RunWriter(directory, [NOTE]))
            except RecordingError as error:
                errors.append(error)  # noqa: B023

        at_once(4, make)
        assert (len(writers), len(errors)) == (1, 3)
        assert all('already' in str(error) for error in errors)
        writers[0].write('/note', samples.snapshot(1), 1)
        writers[0].close()
        reader = RunReader(directory)
        assert (reader.complete, reader.message_count) == (True, 1)


WRITER_PROCESS = """
    import sys, time
    from impact_damper_ros.bag import RunWriter
    from bag import samples

    writer = RunWriter(sys.argv[1], samples.TOPICS)
    messages = samples.run(4000)
    start = time.monotonic()
    for message in messages:
        due = start + (message[2] - samples.START) / 1e9
        while (wait := due - time.monotonic()) > 0:
            time.sleep(wait)
        writer.write(*message)
    time.sleep(1000.0)
"""


def test_kill_loses_nothing_that_was_flushed(tmp_path):
    """A process that writes at 200 Hz is killed with -9 while it goes on."""
    script = textwrap.dedent(WRITER_PROCESS)
    bag = tmp_path / 'bag'
    with Running(tmp_path, '-c', script, bag, path=[Path(__file__).parents[1]]) as process:
        (file,) = process.until(lambda: list(bag.glob('*.mcap')))
        process.until(lambda: len(salvaged(file)) >= 420)
    assert process.code == -signal.SIGKILL
    assert not (bag / 'metadata.yaml').exists()

    run = RunReader(bag)
    assert not run.complete
    messages = samples.run(4000)
    kept = list(run)
    assert 420 <= len(kept) == len(salvaged(file))
    expected = sorted(messages[: len(kept)], key=lambda message: message[2])
    assert [(record.topic, record.content, record.stamp_ns) for record in kept] == expected
