# SPDX-License-Identifier: Apache-2.0
"""Recording of a run in progress, without delaying it."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .bag_file import BagFile
from .errors import RecordingError
from .topics import Topic


def create_run_directory(parent: Path | str, when: float | None = None) -> Path:
    """
    Make a new directory ``run_<YYYYmmdd_HHMMSS>`` in local time, and return its path.

    A name that is taken gets a number (``run_20250131_120000_2``). The directory is made by a call
    that fails if it exists, so two recorders that start in the same second never share one.
    """
    parent = Path(parent)
    stem = time.strftime('run_%Y%m%d_%H%M%S', time.localtime(when))
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        cause = 'it is a file, not a directory'
        remedy = 'move that file away, or set bag_directory to another path'
        raise RecordingError('record to', parent, cause, remedy) from None
    except OSError as error:
        raise RecordingError.from_os_error('record to', parent, error) from error
    directory = parent / stem
    for number in count(2):
        try:
            directory.mkdir()
            break
        except FileExistsError:
            directory = parent / f'{stem}_{number}'
        except OSError as error:
            raise RecordingError.from_os_error('record to', directory, error) from error
    return directory


#: Shortest file, ns: each begins with a description of its topics.
_SHORTEST_NS = 10**9
#: Times per flush period that the writer thread looks at an empty queue.
_POLLS = 10
#: Number of waiting messages that are written before the next flush.
_MANY = 1000
#: Messages taken from the queue between two looks at the clock.
_BATCH = 500
#: Places in the queue that must be free for the first messages of a file.
_ROOM = 100


class RunWriter:
    """
    Writes a run to a rosbag2 bag, in a thread of its own.

    `write` only appends to a queue. The writer thread empties it and hands whole chunks to the
    operating system, so that a process killed at any instant loses at most the last
    `flush_period` of the run; a second thread forces them to the disk every `sync_period`, so that
    a power cut loses little more, and a slow disk delays neither the flushes nor the run.

    A long run goes to several files. The caller decides where one ends, since each file begins
    with everything that a reader needs who has this file alone: see `split_due` and `split`.

    Parameters
    ----------
    directory : Path or str
        Directory of the bag; made if absent, must not hold a bag already. See
        `create_run_directory`.
    topics : sequence of Topic
        The topics to record.
    flush_period : float, default 0.5
        Longest time, in seconds, that a message may stay in memory.
    sync_period : float, default 5.0
        Time, in seconds, between two forced writes to the disk.
    custom : mapping of str to str, optional
        Notes for the bag's ``custom_data``.
    queue_limit : int, default 200000
        Messages that may wait; more are dropped and counted. A run that is simulated as fast as
        possible should pause while `backlog` is large.
    on_error : callable, optional
        Called from any thread once `error` is set; its exceptions are ignored.
    max_size : int, default 0
        Bytes of a file after which `split_due` asks for the next one, though not within a second;
        0 for no limit. Messages that wait are assumed to be compressed as those in the file are.
    max_duration : float, default 0.0
        Time from the first stamp of a file, in seconds, after which `split_due` asks for the next
        one; 0 for no limit.

    Attributes
    ----------
    error : RecordingError or None
        Why the recording ended early; None if it did not.
    dropped : int
        Messages that were offered and are not in the bag.
    drop_reason : str
        Why the first of them was dropped.

    Raises
    ------
    RecordingError
        If the bag cannot be made: no permission, disk full, a file in the way. Later failures are
        never raised, see `error`.
    ValueError
        If two topics have the same name, or no definition of a topic's type is shipped.
    """

    def __init__(
        self,
        directory: Path | str,
        topics: Sequence[Topic],
        *,
        flush_period: float = 0.5,
        sync_period: float = 5.0,
        custom: Mapping[str, str] | None = None,
        queue_limit: int = 200_000,
        on_error: Callable[[], object] = lambda: None,
        max_size: int = 0,
        max_duration: float = 0.0,
    ) -> None:
        if len({topic.name for topic in topics}) < len(topics):
            raise ValueError('two topics have the same name; each may be given once')
        channels = [topic.channel() for topic in topics]
        self._file = BagFile(Path(directory), channels, custom or {})
        self._channels = {topic.name: index for index, topic in enumerate(topics)}
        self._poll_period = flush_period / _POLLS
        # A message waits for the rest of a flush interval; two looks at the queue are kept in
        # reserve for a busy machine.
        self._flush_interval = flush_period - 2 * self._poll_period
        self._sync_period = sync_period
        # Topic, content and stamp; no topic where a new file begins
        self._queue: deque[tuple[str | None, bytes, int]] = deque()
        self._queue_limit = queue_limit
        self._max_size = max_size
        self._max_duration_ns = round(max_duration * 1e9)
        # Begin of the present file for the threads that write; the file may still wait in the
        # queue
        self._begun_ns: int | None = None
        # Numbers of files that were requested, and that have been begun
        self._asked = self._begun = 0
        self._accepting = True
        self._lock = threading.Lock()
        self.dropped = 0
        self.drop_reason = ''
        self._on_error = on_error
        self.error: RecordingError | None = None
        self._closing = threading.RLock()
        self._closed = False
        self._stop = threading.Event()
        # Set to wake the thread that empties the queue
        self._wake = threading.Event()
        self._threads = [
            threading.Thread(target=self._write_loop, name='run_writer', daemon=True),
            threading.Thread(target=self._sync_loop, name='run_sync', daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @classmethod
    def new_run(cls, parent: Path | str, topics: Sequence[Topic], **options: Any) -> Self:
        """
        Start recording to a new directory ``parent/run_<date>_<time>``, with the same options.

        Raises
        ------
        RecordingError
            If it cannot be made; then no empty directory is left behind.
        """
        directory = create_run_directory(parent)
        try:
            return cls(directory, topics, **options)
        except Exception:
            with suppress(OSError):
                directory.rmdir()
            raise

    @property
    def directory(self) -> Path:
        """The bag."""
        return self._file.directory

    @property
    def path(self) -> Path:
        """The MCAP file being written."""
        return self._file.path

    @property
    def message_count(self) -> int:
        """Number of messages in the bag, once it is closed."""
        return self._file.message_count

    @property
    def splits(self) -> bool:
        """Whether a file has a limit."""
        return bool(self._max_size or self._max_duration_ns)

    @property
    def splitting(self) -> bool:
        """Whether a requested file has not been begun yet."""
        return self._asked > self._begun and self.error is None

    @property
    def backlog(self) -> int:
        """Number of messages that wait to be written."""
        return len(self._queue)

    def write(self, topic: str, content: bytes, stamp_ns: int) -> bool:
        """
        Queue a message; never blocks, never raises.

        Parameters
        ----------
        topic : str
            Name of one of the topics.
        content : bytes
            The message, serialised in CDR.
        stamp_ns : int
            Its stamp in nanoseconds.

        Returns
        -------
        bool
            False if the message was dropped (recording ended, or too many waiting).
        """
        queue = self._queue
        if self._accepting and len(queue) < self._queue_limit:
            queue.append((topic, content, stamp_ns))
            if len(queue) == _MANY:
                self._wake.set()
            return True
        if self._accepting:
            self._drop(f'more than {self._queue_limit} messages waited for the disk')
        else:
            self._drop('the recording had ended')
        return False

    def split_due(self, stamp_ns: int) -> bool:
        """
        Return whether the present file has reached a limit; never blocks, never raises.

        Only the thread that writes may call this and `split`.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the last message; the first file begins at the stamp of the first call.
        """
        if self._begun_ns is None:
            self._begun_ns = stamp_ns
        if self._max_duration_ns and stamp_ns - self._begun_ns >= self._max_duration_ns:
            return True
        # The size of a file that has not been begun is unknown. Its first messages may be larger
        # than the limit.
        return (
            self._max_size > 0
            and self._asked == self._begun
            and stamp_ns - self._begun_ns >= _SHORTEST_NS
            and self._file.expected_size(len(self._queue)) >= self._max_size
        )

    def split(self, stamp_ns: int) -> bool:
        """
        Begin a new file with the next message; never blocks, never raises.

        Parameters
        ----------
        stamp_ns : int
            Stamp with which the new file begins.

        Returns
        -------
        bool
            False if that is not possible at present (recording ended, or too many waiting).
        """
        if not self._accepting or len(self._queue) > self._queue_limit - _ROOM:
            return False
        self._begun_ns = stamp_ns
        self._asked += 1
        self._queue.append((None, b'', stamp_ns))
        self._wake.set()
        return True

    def close(self) -> None:
        """
        Write the queued messages and finish the bag; see `error`.

        May be called more than once, from any thread, and after an error; raises nothing.
        """
        with self._closing:
            if not self._closed:
                self._closed = True
                self._accepting = False
                self._end()
                for thread in self._threads:
                    thread.join()
                self._finish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _drop(self, reason: str, number: int = 1) -> None:
        if number:
            with self._lock:
                self.dropped += number
                self.drop_reason = self.drop_reason or reason

    def _end(self) -> None:
        self._stop.set()
        self._wake.set()

    def _fail(self, error: Exception) -> None:
        """Keep the first error and accept no more messages."""
        self._accepting = False
        if self.error is None:
            if isinstance(error, OSError):
                error = RecordingError.from_os_error('continue recording to', self.path, error)
            elif not isinstance(error, RecordingError):
                cause = f'{type(error).__name__}: {error}'
                error = RecordingError('continue recording to', self.path, cause)
            self.error = error
            with suppress(Exception):
                self._on_error()
        self._end()

    def _finish(self) -> None:
        try:
            if self.error is None:
                self._note_dropped()
                self._file.finish()
        except Exception as error:
            self._fail(error)
        if self.error is not None:
            self._drop('the recording had ended', self._file.abandon())
        self._discard()

    def _note_dropped(self) -> None:
        """Note the number of dropped messages in the bag."""
        if self.dropped:
            self._file.custom['dropped'] = str(self.dropped)

    def _discard(self) -> None:
        while self._queue:
            self._drop('the recording had ended', int(self._queue.popleft()[0] is not None))

    def _write_loop(self) -> None:
        try:
            # The first messages are written at the next poll, so that a process killed soon after
            # its start leaves a recording.
            flushed = time.monotonic() - self._flush_interval
            dirty = stopping = False
            while not stopping and self.error is None:
                # The queue is emptied seldom: each time the thread that moves a rig has to wait.
                left = flushed + self._flush_interval - time.monotonic()
                self._wake.wait(left if left > 0.0 else self._poll_period)
                self._wake.clear()
                stopping = self._stop.is_set()
                waiting = True
                while waiting:
                    dirty = self._take(min(len(self._queue), _BATCH)) or dirty
                    if dirty and time.monotonic() - flushed >= self._flush_interval:
                        self._file.flush()
                        flushed, dirty = time.monotonic(), False
                    waiting = bool(self._queue)
        except Exception as error:
            self._fail(error)

    def _take(self, number: int) -> bool:
        """Move messages from the queue to the file; return whether there was any."""
        added = False
        for _ in range(number):
            topic, content, stamp_ns = self._queue.popleft()
            if topic is None:
                self._note_dropped()
                self._file.next_file()
                self._begun += 1
            else:
                self._file.add(self._channels[topic], content, stamp_ns)
                added = True
        return added

    def _sync_loop(self) -> None:
        synced = self._file.path, self._file.size
        while not self._stop.wait(self._sync_period):
            try:
                if (self._file.path, self._file.size) != synced:
                    synced = self._file.path, self._file.size
                    self._file.sync()
            except Exception as error:
                self._fail(error)
