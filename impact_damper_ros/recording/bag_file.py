"""
One bag: a directory with an MCAP file as rosbag2 writes it, and its ``metadata.yaml``.

Everything here is done at once in the calling thread; `RunWriter` adds the queue.

A chunk reaches the file only as a whole, in one system call per flush, so a process killed with
``kill -9`` leaves whole records behind (what was handed to the kernel survives the process). The
chunks are compressed with zstd: on joint states it costs 0.5 µs per message and saves 60 % of the
size; rosbag2's default (no compression, no checksum) is faster to write in C++ but cannot tell a
damaged chunk from a whole one, and its ``fastwrite`` preset leaves no index to play by time.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.writer import LIBRARY_IDENTIFIER

from impact_damper_ros import __version__

from .bag_metadata import FILE_NAME, BagMetadata, sync_directory
from .chunk_writer import ChunkWriter
from .errors import RecordingError
from .topic import Channel

__all__ = ['BagFile', 'BagSummary']

PROFILE = 'ros2'
LIBRARY = f'impact_damper_ros/{__version__} {LIBRARY_IDENTIFIER}'

#: Bytes of messages after which a chunk is closed without waiting for the next flush.
_CHUNK_SIZE = 768 * 1024
#: Bytes of finished chunks that are handed over without waiting for a flush.
_PENDING_LIMIT = 4 * 1024 * 1024


class _RecordFile:
    """
    The output stream of the MCAP writer: a file that always ends where a flush ended.

    Python's own buffered file would keep the rest of a failed write and try it again on closing.
    Here a failed flush is undone: the file is cut back to the end of the last good one.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY | getattr(os, 'O_CLOEXEC', 0)
        self._descriptor = os.open(path, flags, 0o644)
        self._pending = bytearray()
        self.committed = 0
        self.closed = False

    @property
    def pending(self) -> int:
        return len(self._pending)

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


@dataclass(frozen=True)
class BagSummary:
    """
    What a bag holds.

    Attributes
    ----------
    directory, file : Path
        The bag, and the MCAP file in it.
    counts : mapping of str to int
        Messages per topic.
    start_ns, end_ns : int or None
        Earliest and latest stamp; None without messages.
    dropped : int
        Messages that were offered and are not in the bag.
    error : RecordingError or None
        Why the recording ended early; None if the bag is complete.
    """

    directory: Path
    file: Path
    counts: Mapping[str, int] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None
    dropped: int = 0
    error: RecordingError | None = None

    @property
    def complete(self) -> bool:
        """Whether the bag is finished, with index and ``metadata.yaml``."""
        return self.error is None

    @property
    def message_count(self) -> int:
        """Number of messages in the bag."""
        return sum(self.counts.values())

    @property
    def duration(self) -> float:
        """Time from the earliest to the latest stamp, in seconds."""
        return ((self.end_ns or 0) - (self.start_ns or 0)) / 1e9


class BagFile:
    """
    A bag being written.

    Parameters
    ----------
    directory : Path
        Of the bag. Made if absent; must not hold a bag already.
    channels : sequence of Channel
        The topics; later named by their index here.
    custom : mapping of str to str
        Notes for ``metadata.yaml``.
    name : str, optional
        Stem of the MCAP file without its number; the directory's name if not given.

    Raises
    ------
    RecordingError
        If the directory or the file cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        channels: Sequence[Channel],
        custom: Mapping[str, str],
        name: str | None = None,
    ) -> None:
        self.directory = Path(directory)
        self.path = self.directory / f'{name or self.directory.absolute().name}_0.mcap'
        self.channels = tuple(channels)
        self.custom = {str(key): str(value) for key, value in custom.items()}
        self.counts = [0] * len(self.channels)
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if (self.directory / FILE_NAME).exists() or any(self.directory.glob('*.mcap')):
                cause = 'the directory holds a bag already'
                remedy = 'choose another one; nothing is ever overwritten'
                raise RecordingError('record to', self.directory, cause, remedy)
            self._stream = _RecordFile(self.path)
        except OSError as error:
            raise RecordingError.from_os_error('record to', self.path, error) from error
        try:
            self._start()
        except OSError as error:
            self._stream.close()
            with suppress(OSError):
                self.path.unlink()
            raise RecordingError.from_os_error('record to', self.path, error) from error

    def _start(self) -> None:
        self._writer = ChunkWriter(self._stream, _CHUNK_SIZE, PROFILE, LIBRARY)
        # With the topics at the head, even a recording cut before its first chunk tells them.
        self._note_metadata()
        schemas: dict[str, int] = {}
        self._channel_ids: list[int] = []
        for channel in self.channels:
            if channel.type not in schemas:
                schemas[channel.type] = self._writer.register_schema(
                    channel.type, channel.schema_encoding, channel.schema
                )
            channel_id = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                schemas[channel.type],
                channel.metadata(),
            )
            self._channel_ids.append(channel_id)
        self.flush()
        self.sync()
        sync_directory(self.directory)
        sync_directory(self.directory.parent)

    @property
    def size(self) -> int:
        """Bytes handed to the operating system so far."""
        return self._stream.committed

    def metadata(self) -> BagMetadata:
        """Return the metadata of what has been added so far."""
        return BagMetadata(
            file_name=self.path.name,
            channels=self.channels,
            counts=tuple(self.counts),
            start_ns=self.start_ns,
            end_ns=self.end_ns,
            custom=self.custom,
        )

    def _note_metadata(self) -> None:
        content = {'serialized_metadata': self.metadata().serialized()}
        self._writer.add_metadata('rosbag2', content)

    def add(
        self, channel: int, content: bytes, stamp_ns: int, sequence: int | None = None
    ) -> None:
        """
        Add a message to the current chunk.

        Parameters
        ----------
        channel : int
            Index of the channel.
        content : bytes
            The serialised message.
        stamp_ns : int
            Its stamp, 0 to 2**63 - 1; both log time and publish time.
        sequence : int, optional
            Number of the message in its channel; counted from 0 if not given.

        Raises
        ------
        OSError
            If chunks had to be handed over and that fails.
        """
        if sequence is None:
            sequence = self.counts[channel] & 0xFFFFFFFF
        self._writer.add_message(self._channel_ids[channel], stamp_ns, content, sequence)
        self.counts[channel] += 1
        if self.start_ns is None or stamp_ns < self.start_ns:
            self.start_ns = stamp_ns
        if self.end_ns is None or stamp_ns > self.end_ns:
            self.end_ns = stamp_ns
        if self._stream.pending > _PENDING_LIMIT:
            self.flush()

    def flush(self) -> None:
        """
        Close the chunk and hand all that is pending to the operating system.

        Raises
        ------
        OSError
            If that fails; the file then ends with the last good flush.
        """
        self._writer.flush()
        self._commit()

    def _commit(self) -> None:
        self._committed = (list(self.counts), self.start_ns, self.end_ns)

    def sync(self) -> None:
        """Have the operating system write the file to the disk proper (slow)."""
        self._stream.sync()

    def finish(self) -> None:
        """
        Write summary and footer, then, last of all, ``metadata.yaml``.

        Raises
        ------
        OSError
            If that fails; what was flushed before stays salvageable.
        """
        try:
            self._writer.flush()
            self._note_metadata()
            self._writer.finish()
            self._stream.flush()
            self._commit()
            self._stream.sync()
        finally:
            self._stream.close()
        self.metadata().write(self.directory)

    def abandon(self) -> int:
        """
        Close the file as it is, without raising; count only what is in it.

        Returns
        -------
        int
            Number of messages that were added and did not reach the file.
        """
        if not self._stream.closed:
            with suppress(OSError):
                self._stream.sync()
            with suppress(OSError):
                self._stream.close()
        added = sum(self.counts)
        self.counts, self.start_ns, self.end_ns = self._committed
        return added - sum(self.counts)
