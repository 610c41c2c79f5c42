# SPDX-License-Identifier: Apache-2.0
"""
One bag: a directory with MCAP files as rosbag2 writes them, and their ``metadata.yaml``.

Each file is a complete MCAP file. Only the numbers of the messages continue from file to file.

Everything here is done in the calling thread; `RunWriter` adds the queue.

The `mcap` library writes whole records into memory, which go to the file in one system call per
flush: a process killed with ``kill -9`` leaves whole records behind (bytes that the kernel has
received survive the process). The chunks are compressed with zstd: on joint states it costs 0.5 µs
per message and saves 60 % of the size. Chunks, data and summary have checksums, unlike rosbag2's
own.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from mcap.writer import LIBRARY_IDENTIFIER, Writer

from impact_damper_ros.outputs import sync_directory
from impact_damper_ros.version import VERSION

from .errors import RecordingError
from .metadata import FILE_NAME, BagMetadata, FileInformation, name_in_utf8
from .topics import Channel

PROFILE = 'ros2'
LIBRARY = f'impact_damper_ros/{VERSION} {LIBRARY_IDENTIFIER}'

#: Bytes of messages after which a chunk is closed without waiting for the next flush.
_CHUNK_SIZE = 768 * 1024
#: Assumed bytes of a message in the first file, and the number of messages whose measured size has
#: the same weight as this assumption.
_FIRST_GUESS = 85.0
_GUESSED = 500


class _FlushedFile:
    """
    The output of the MCAP writer: a file that always ends where a flush ended.

    Python's own buffered file would keep the rest of a failed write and try it again on closing.
    Here a failed flush is undone: the file is cut back to the end of the last good one.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, 'O_CLOEXEC', 0)
        self._descriptor = os.open(path, flags, 0o644)
        self._pending = bytearray()
        self.committed = 0
        self.closed = False

    def write(self, content: bytes) -> int:
        self._pending += content
        return len(content)

    def tell(self) -> int:
        return self.committed + len(self._pending)

    def flush(self) -> None:
        if not self._pending:
            return
        if os.fstat(self._descriptor).st_nlink == 0:
            raise FileNotFoundError(None, 'the file was deleted while it was being written')
        with memoryview(self._pending) as view:
            done = 0
            try:
                while done < len(view):
                    done += os.write(self._descriptor, view[done:])
            except OSError:
                with suppress(OSError):
                    os.ftruncate(self._descriptor, self.committed)
                    os.lseek(self._descriptor, self.committed, os.SEEK_SET)
                raise
        self.committed += done
        self._pending.clear()

    def sync(self) -> None:
        os.fsync(self._descriptor)

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            os.close(self._descriptor)


class BagFile:
    """A bag being written; its directory must not hold one already."""

    def __init__(
        self,
        directory: Path,
        channels: Sequence[Channel],
        custom: Mapping[str, str],
        name: str | None = None,
        distro: str = '',
    ) -> None:
        self.directory = Path(directory)
        self._stem = name or self.directory.absolute().name
        #: The MCAP file being written
        self.path = self._path(0)
        self.channels = tuple(channels)
        self.custom = {str(key): str(value) for key, value in custom.items()}
        self._distro = distro
        #: Messages by channel, in all files
        self.counts = [0] * len(self.channels)
        # The files before the present one, and messages by channel up to it
        self._files: list[FileInformation] = []
        self._before = list(self.counts)
        self._guess = _FIRST_GUESS
        # Files that are finished, but not forced to the disk yet
        self._finished: deque[_FlushedFile] = deque()
        try:
            name_in_utf8(self._stem)
        except UnicodeDecodeError as error:
            cause = 'its name is not text in UTF-8, as metadata.yaml of a bag has to be'
            raise RecordingError('record to', self.directory, cause, 'choose another') from error
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if (self.directory / FILE_NAME).exists() or any(self.directory.glob('*.mcap')):
                cause = 'the directory holds a bag already'
                remedy = 'choose another one; nothing is ever overwritten'
                raise RecordingError('record to', self.directory, cause, remedy)
            self._open(self.path)
        except OSError as error:
            raise RecordingError.from_os_error('record to', self.path, error) from error
        sync_directory(self.directory.parent)

    def _path(self, number: int) -> Path:
        return self.directory / f'{self._stem}_{number}.mcap'

    def _open(self, path: Path) -> None:
        """Begin a file; nothing is left of it if that fails."""
        stream = _FlushedFile(path)
        try:
            writer = Writer(stream, _CHUNK_SIZE, enable_data_crcs=True)  # type: ignore[arg-type]
            writer.start(PROFILE, LIBRARY)
            # At the head, so that a recording cut before its first chunk names its topics.
            self._note_metadata(writer, FileInformation(path.name), [0] * len(self.channels))
            # The number 0 stands for no schema.
            schemas: dict[tuple[str, str, bytes], int] = {('', '', b''): 0}
            channel_ids: list[int] = []
            for channel in self.channels:
                schema = channel.type, channel.schema_encoding, channel.schema
                if schema not in schemas:
                    schemas[schema] = writer.register_schema(*schema)
                channel_id = writer.register_channel(
                    channel.topic,
                    channel.message_encoding,
                    schemas[schema],
                    dict(channel.metadata),
                )
                channel_ids.append(channel_id)
            writer.flush()  # type: ignore[no-untyped-call]
            if not self._files:
                # The others are forced to the disk by `sync`.
                stream.sync()
                sync_directory(self.directory)
        except OSError:
            stream.close()
            with suppress(OSError):
                path.unlink()
            raise
        self.path, self._stream, self._writer = path, stream, writer
        self._channel_ids = channel_ids
        self._head = stream.committed
        self._first_ns: int | None = None
        self._last_ns: int | None = None
        self._commit()

    @property
    def size(self) -> int:
        """Bytes of the present file handed to the operating system so far."""
        return self._stream.committed

    def expected_size(self, waiting: int) -> float:
        """Return the estimated size of the present file with the waiting messages."""
        count, size = self._committed
        each = (size - self._head + self._guess * _GUESSED) / (
            count - sum(self._before) + _GUESSED
        )
        # The summary repeats schemas and topics.
        return size + self._head + each * (sum(self.counts) - count + waiting)

    @property
    def message_count(self) -> int:
        """Number of messages handed to the operating system."""
        return self._committed[0]

    def _file_information(self) -> FileInformation:
        count = sum(self.counts) - sum(self._before)
        return FileInformation(self.path.name, self._first_ns, self._last_ns, count)

    def metadata(self) -> BagMetadata:
        """Return the metadata of the bag so far."""
        return BagMetadata(
            files=(*self._files, self._file_information()),
            channels=self.channels,
            counts=tuple(self.counts),
            custom=self.custom,
            distro=self._distro,
        )

    def _note_metadata(self, writer: Writer, file: FileInformation, counts: Sequence[int]) -> None:
        """Write the metadata of a file into it, as if it were a bag of its own."""
        metadata = BagMetadata((file,), self.channels, tuple(counts), self.custom, self._distro)
        writer.add_metadata('rosbag2', {'serialized_metadata': metadata.yaml_text()})

    def add(
        self,
        channel: int,
        content: bytes,
        stamp_ns: int,
        *,
        publish_ns: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Add a message to the current chunk; it is published when recorded, and counted."""
        self._writer.add_message(
            self._channel_ids[channel],
            stamp_ns,
            content,
            stamp_ns if publish_ns is None else publish_ns,
            self.counts[channel] & 0xFFFFFFFF if sequence is None else sequence,
        )
        self.counts[channel] += 1
        if self._first_ns is None or stamp_ns < self._first_ns:
            self._first_ns = stamp_ns
        if self._last_ns is None or stamp_ns > self._last_ns:
            self._last_ns = stamp_ns

    def flush(self) -> None:
        """Close the chunk and hand all that is pending to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._commit()

    def _commit(self) -> None:
        self._committed = sum(self.counts), self._stream.committed

    def sync(self) -> None:
        """Force the files to the disk (slow)."""
        if self._finished:
            sync_directory(self.directory)
        while self._finished:
            stream = self._finished.popleft()
            try:
                stream.sync()
            finally:
                stream.close()
        self._stream.sync()

    def next_file(self) -> None:
        """Finish the present file, unless it is empty, and begin a new one."""
        if self.counts == self._before:
            return
        path = self.path
        try:
            self._end_file()
            self._files.append(self._file_information())
            self._guess = (self.size - 2 * self._head) / self._files[-1].message_count
            finished, path = self._stream, self._path(len(self._files))
            try:
                self._open(path)
            except OSError:
                self._files.pop()
                raise
        except OSError as error:
            raise RecordingError.from_os_error('continue recording to', path, error) from error
        self._finished.append(finished)
        self._before = list(self.counts)

    def _end_file(self) -> None:
        """Write summary and footer of the present file."""
        self.flush()
        counts = [count - b for count, b in zip(self.counts, self._before, strict=True)]
        self._note_metadata(self._writer, self._file_information(), counts)
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        self._commit()

    def finish(self) -> None:
        """Write summary and footer, then, last of all, ``metadata.yaml``."""
        try:
            self._end_file()
            self.sync()
        finally:
            self._close()
        self.metadata().write(self.directory)

    def _close(self) -> None:
        for stream in (*self._finished, self._stream):
            with suppress(OSError):
                stream.close()

    def abandon(self) -> int:
        """Close the files as they are, without raising; return the number of messages lost."""
        if not self._stream.closed:
            with suppress(OSError):
                self.sync()
            self._close()
        return sum(self.counts) - self.message_count
