"""The records of an MCAP file as they are taken in: what was found in it, and where."""

from __future__ import annotations

import os
import stat
import struct
from collections.abc import Collection
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Header, Metadata, Schema, Statistics

from .errors import RecordingError

__all__ = [
    'CHUNK',
    'HEAD',
    'LENGTH',
    'LONGEST_DESCRIPTIONS',
    'MAGIC',
    'MESSAGE',
    'Block',
    'ChunkHead',
    'IndexPart',
    'RawMessage',
    'Scan',
    'note_description',
    'open_file',
]

MAGIC = b'\x89MCAP0\r\n'
#: Opcode and length of a record.
HEAD = struct.Struct('<BQ')
#: Channel, sequence, log time and publish time.
MESSAGE = struct.Struct('<HIQQ')
#: First and last stamp, size, checksum, and length of the compression's name.
CHUNK = struct.Struct('<QQQII')
LENGTH = struct.Struct('<Q')
#: Bytes of all schemas, channels and metadata together.
LONGEST_DESCRIPTIONS = 64 * 1024 * 1024


class RawMessage(NamedTuple):
    """A message as it stands in the file."""

    channel: int
    sequence: int
    stamp_ns: int
    content: bytes


class IndexPart(NamedTuple):
    """A message index record: its channel, and where it and its entries are in the file."""

    channel: int
    position: int
    start: int
    length: int


class ChunkHead(NamedTuple):
    """What stands at the head of a chunk, and where its record is in the file."""

    position: int
    length: int
    start_ns: int
    end_ns: int
    compression: str
    compressed_size: int
    size: int


@dataclass(frozen=True, slots=True)
class Block:
    """
    A stretch of the file that holds messages: a chunk, or one message outside of any.

    Attributes
    ----------
    offset, length : int
        Of the record's content in the file, as far as it is there.
    start_ns, end_ns : int
        Earliest and latest stamp.
    whole : bool
        False for the last chunk of a file that was cut in the middle of it.
    chunk : bool
        False for a message on its own (rosbag2's ``fastwrite``).
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int
    whole: bool = True
    chunk: bool = True


@dataclass
class Scan:
    """
    What an MCAP file holds, as far as it can be used.

    Attributes
    ----------
    path : Path
        The file.
    source : Path
        The file as the user knows it, where `path` is an expanded copy of it.
    size : int
        Its length in bytes.
    profile, library : str
        ``'ros2'``, if written by ROS 2, and what wrote it.
    blocks : list of Block
        Where the messages are, in file order.
    schemas, channels : dict
        By id.
    counts : dict of int to int
        Messages per channel id, without those of damaged blocks.
    metadata : list of Metadata
        The metadata records.
    finished : bool
        Whether the file has its footer and the magic at its end.
    unusable : int
        Bytes at the end that belong to no whole record.
    indexes : dict of int to list of IndexPart
        The message index records by the block that they follow.
    heads : list of ChunkHead
        The whole chunks.
    statistics : Statistics or None
        How much the summary says there is.
    chunk_indexes : list of ChunkIndex
        Where the summary says that the chunks are.
    footer : Footer or None
        Where the summary is.
    data_end : (int, int) or None
        Where the data ends, and its checksum, 0 for none.
    attachments : int
        Number of attachments.
    faults : dict of str to list
        What was found wrong so far: the first case of each kind in words, and how many there are.
    numbers : dict of int to dict
        First and last sequence number by channel of the blocks that were read whole.
    """

    path: Path
    source: Path
    size: int
    profile: str = ''
    library: str = ''
    blocks: list[Block] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    finished: bool = False
    unusable: int = 0
    indexes: dict[int, list[IndexPart]] = field(default_factory=dict)
    heads: list[ChunkHead] = field(default_factory=list)
    statistics: Statistics | None = None
    chunk_indexes: list[ChunkIndex] = field(default_factory=list)
    footer: Footer | None = None
    data_end: tuple[int, int] | None = None
    attachments: int = 0
    faults: dict[str, tuple[str, int]] = field(default_factory=dict)
    numbers: dict[int, dict[int, tuple[int, int]]] = field(default_factory=dict)
    description_size: int = 0

    @property
    def own(self) -> bool:
        """Whether this package has written the file."""
        return self.library.startswith('impact_damper_ros/')

    def may_hold(self, block: Block, channels: Collection[int]) -> bool:
        """Return whether a block may hold messages of channels, by its index if it has one."""
        parts = self.indexes.get(block.offset) if self.finished else None
        return parts is None or any(part.channel in channels for part in parts)

    def fault(self, kind: str, text: str) -> None:
        """Note what is wrong; of one kind, the first case is kept and the others are counted."""
        first, count = self.faults.get(kind, (text, 0))
        self.faults[kind] = first, count + 1


def open_file(path: Path) -> BinaryIO:
    """
    Open a file for reading; a pipe or device is not waited for.

    Raises
    ------
    RecordingError
        If it cannot be read, or is no regular file.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | getattr(os, 'O_CLOEXEC', 0))
    except OSError as error:
        raise RecordingError.from_os_error('read', path, error) from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        cause = 'it is a directory, a pipe or a device, not a regular file'
        raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')
    return os.fdopen(descriptor, 'rb')


def note_description(scan: Scan, opcode: int, content: bytes) -> bool:
    """Take in a record that is no message and no chunk; return whether it is sound."""
    stream = ReadDataStream(BytesIO(content))
    try:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            scan.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            scan.channels[channel.id] = channel
        elif opcode == Opcode.HEADER:
            header = Header.read(stream)
            scan.profile, scan.library = header.profile, header.library
        elif opcode == Opcode.METADATA:
            scan.metadata.append(Metadata.read(stream))
        elif opcode == Opcode.STATISTICS:
            scan.statistics = Statistics.read(stream)
        elif opcode == Opcode.CHUNK_INDEX:
            scan.chunk_indexes.append(ChunkIndex.read(stream))
        elif opcode == Opcode.FOOTER:
            scan.footer = Footer.read(stream)
    except Exception:  # whatever damage makes the library raise
        return False
    return True
