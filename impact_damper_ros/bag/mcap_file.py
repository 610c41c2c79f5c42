# SPDX-License-Identifier: Apache-2.0
"""
One MCAP file of a bag, finished, cut short or damaged.

Opening a file passes from record to record, and where the length of one is wrong, goes on to the
chunks that the summary lists. The messages are in blocks, which are read one by one; a chunk is
expanded to `LARGEST` at most. The records are those of the `mcap` library; its readers end at the
first damage, and take five times as long. The format: https://mcap.dev/spec
"""

from __future__ import annotations

import os
import shlex
import stat
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel as McapChannel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

from impact_damper_ros.parameters.quoting import plural, quote

from .errors import RecordingError
from .topics import Channel, full_type

MAGIC = MCAP0_MAGIC
#: Largest record, and largest content of a chunk, bytes.
LARGEST = 128 * 1024 * 1024
#: Bytes that are read, expanded or taken together as one block.
_PIECE = 1024 * 1024
#: First bytes of a file or a message that rosbag2 has compressed; no encapsulation of CDR has
#: them.
ZSTD = b'\x28\xb5\x2f\xfd'
_SQLITE = b'SQLite format 3\0'
LATEST_STAMP = 2**63 - 1

#: Opcode and length of a record.
_HEAD = struct.Struct('<BQ')
#: Channel, sequence, log time and publish time of a message.
_MESSAGE = struct.Struct('<HIQQ')
#: First and last stamp, size, checksum, and length of the compression's name of a chunk.
_CHUNK = struct.Struct('<QQQII')
#: A footer with its head: places of summary and offsets, and checksum.
_FOOTER = struct.Struct('<BQQQI')
#: The records that describe a file, and those that a chunk may hold.
_RECORDS: dict[int, Any] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: McapChannel,
    Opcode.STATISTICS: Statistics,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
_IN_CHUNKS = frozenset(map(int, (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)))
_DAMAGE = (
    *(ValueError, ArithmeticError, MemoryError, RuntimeError, struct.error),
    *(McapError, zstandard.ZstdError),
)

#: A message: number of its channel, sequence, log time, publish time, content.
StoredMessage = tuple[int, int, int, int, bytes]


def not_plain(path: Path, what: str) -> RecordingError:
    """Return the error for a file of a bag that another program must convert first."""
    bag = path.parent if (path.parent / 'metadata.yaml').exists() else path
    remedy = (
        f'convert the bag: rosbags-convert --src {shlex.quote(str(bag))} --dst NEW '
        '--dst-storage mcap (pip install rosbags), or ros2 bag convert'
    )
    return RecordingError('read', path, f'{what}; plain MCAP is read', remedy)


@dataclass(slots=True)
class Block:
    """A part of a file that holds messages: a chunk, or messages outside of any chunk."""

    position: int  # its place in the file
    length: int  # of the part that is present
    start_ns: int  # earliest stamp
    end_ns: int  # latest stamp
    chunked: bool = False
    whole: bool = True  # false for the chunk in the middle of which a file was cut
    #: Number of its messages, and of messages of undescribed channels, once it was read
    count: int | None = None
    strange: int = 0
    index: ChunkIndex | None = None  # entry of the summary for a chunk, if there is one


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | getattr(os, 'O_CLOEXEC', 0))
    except OSError as error:
        raise RecordingError.from_os_error('read', path, error) from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        cause = 'it is a directory, a pipe or a device, not a regular file'
        raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')
    return os.fdopen(descriptor, 'rb')


class McapFile:
    """The usable content of an MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.profile = self.library = ''
        self.blocks: list[Block] = []  # in file order
        self.channels: dict[int, Channel] = {}  # by number
        self.counts: Mapping[int, int] = {}  # messages by channel
        self.metadata: list[Metadata] = []
        self.others = 0  # attachments, and records of kinds that the format does not know
        self.finished = False  # whether the file ends with footer and magic
        self.framed = 0  # end of the last whole record before a break
        self.unusable = 0  # bytes that belong to no whole record
        self._schemas: dict[int, Schema] = {}
        self._described: set[tuple[int, bytes]] = set()
        self._indexes: list[ChunkIndex] = []
        self._statistics: Statistics | None = None
        self._faults: list[str] = []
        try:
            with self.open() as stream:
                self._open(stream)
                self._count(stream)
        except OSError as error:
            raise RecordingError.from_os_error('read', path, error) from error

    @property
    def own(self) -> bool:
        """Whether this package has written the file."""
        return self.library.startswith('impact_damper_ros/')

    def open(self) -> BinaryIO:
        """Return the open file, for `read`."""
        return open_file(self.path)

    def faults(self) -> Iterator[str]:
        """Yield the contradictions within the file, once all its blocks were read."""
        yield from self._faults
        counts = [block.count for block in self.blocks]
        if self._statistics is not None and None not in counts:
            stated, there = self._statistics.message_count, sum(count or 0 for count in counts)
            if stated != there:
                yield f'its statistics count {stated:,} messages, not {there:,}'
        if strange := sum(block.strange for block in self.blocks):
            yield f'{plural(strange, "message", ",")} of undescribed channels, left out'

    # Opening

    def _open(self, stream: BinaryIO) -> None:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        magic = stream.read(len(_SQLITE))
        if not magic:
            cause = 'the file is empty (0 bytes): the recording ended before anything was written'
            raise RecordingError('read', self.path, cause)
        if magic == _SQLITE:
            raise not_plain(self.path, 'it is stored in SQLite')
        if magic.startswith(ZSTD):
            raise not_plain(self.path, 'it is compressed as a file')
        if not MAGIC.startswith(magic[: len(MAGIC)]):
            cause = 'it is not an MCAP file (it does not start with the MCAP magic bytes)'
            remedy = 'name a bag directory or a .mcap file'
            raise RecordingError('read', self.path, cause, remedy)
        self.framed = self._pass_records(stream, len(MAGIC), size)
        self.unusable = size - self.framed
        summary = 0 if self.finished else _summary_start(stream, size)
        if summary > self.framed:
            self._pass_records(stream, summary, size)
        self._use_indexes(stream)
        if self.finished and self.unusable:
            behind = [block.position for block in self.blocks if block.position >= self.framed]
            self.unusable = min([*behind, summary]) - self.framed
            self._faults.append(
                f'the record at byte {self.framed} is damaged (its kind or its length is wrong)'
            )
        if not self.finished and self.blocks and self.blocks[-1].chunked:
            # A power cut may leave zeros where data was not written.
            self.blocks[-1].whole = False

    def _use_indexes(self, stream: BinaryIO) -> None:
        """Take place, times and compression of the chunks from the summary."""
        blocks = {block.position: block for block in self.blocks}
        for index in self._indexes:
            begin, of = index.chunk_start_offset, index.chunk_length
            times = index.message_start_time, index.message_end_time
            stream.seek(begin + _HEAD.size)
            stated = _CHUNK.unpack(stream.read(_CHUNK.size).ljust(_CHUNK.size))[:2]
            # Behind a hole the chunks are at other places. One of the two times may be damaged.
            if stated[0] == times[0] or stated[1] == times[1]:
                blocks[begin] = Block(begin, of, *times, chunked=True, index=index)
        self.blocks, end = [], 0
        for position in sorted(blocks):
            block = blocks[position]
            if block.index is not None:
                end = position + block.length
                for before in self.blocks[-1:]:
                    before.length = min(before.length, position - before.position)
            elif position < end:
                continue
            self.blocks.append(block)

    def _pass_records(self, stream: BinaryIO, position: int, size: int) -> int:
        """Note the records from a place on; return the end of the last whole one."""
        of_data: dict[int, Channel] = {}
        while True:
            stream.seek(position)
            head = stream.read(_HEAD.size)
            # A record of kind 0 does not exist: that part of the file was never written.
            if len(head) < _HEAD.size or not head[0]:
                return position
            opcode, length = _HEAD.unpack(head)
            end = position + _HEAD.size + length
            if opcode == Opcode.CHUNK:
                self._take_chunk(stream, position, min(end, size) - position)
            if end > size:
                return position
            if opcode == Opcode.MESSAGE:
                self._take_message(stream, position, length)
            elif opcode == Opcode.ATTACHMENT or opcode > max(Opcode):
                self.others += 1
            elif opcode in _RECORDS:
                try:
                    record = _record(opcode, _read_limited(stream, length))
                except _DAMAGE as error:
                    text = f'the record at byte {position} is damaged ({_reason(error)})'
                    self._faults.append(text)
                    record = None
                if isinstance(record, DataEnd):
                    if record.data_section_crc not in (0, _checksum(stream, 0, position)):
                        self._faults.append('the checksum of its data does not match')
                    of_data = dict(self.channels)
                elif isinstance(record, Footer):
                    self.finished = stream.read() == MAGIC
                    # The checksum covers the footer up to the checksum.
                    begin, crc_at = record.summary_start, end - 4
                    if record.summary_crc not in (0, _checksum(stream, begin, crc_at)):
                        self._faults.append('the checksum of its summary does not match')
                        self.channels, self._statistics, self._indexes = of_data, None, []
                    return size if self.finished else end
                else:
                    self._take(record)
            position = end

    def _take_chunk(self, stream: BinaryIO, position: int, length: int) -> None:
        head = stream.read(_CHUNK.size)
        if len(head) == _CHUNK.size:
            start, end, *_ = _CHUNK.unpack(head)
            self.blocks.append(Block(position, length, start, end, chunked=True))

    def _take_message(self, stream: BinaryIO, position: int, length: int) -> None:
        """Note a message outside of any chunk; consecutive messages are one block."""
        head = stream.read(_MESSAGE.size)
        if min(length, len(head)) < _MESSAGE.size:
            return
        stamp_ns, length = _MESSAGE.unpack(head)[2], length + _HEAD.size
        last = self.blocks[-1] if self.blocks else Block(0, 0, 0, 0)
        if last.chunked or last.position + last.length != position or last.length > _PIECE:
            self.blocks.append(Block(position, length, stamp_ns, stamp_ns))
        else:
            last.length += length
            last.start_ns, last.end_ns = min(stamp_ns, last.start_ns), max(stamp_ns, last.end_ns)

    def _take(self, record: Any) -> None:
        """Note a record that describes the file."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, McapChannel):
            schema = self._schemas.get(record.schema_id) or Schema(0, b'', '', '')
            self.channels[record.id] = Channel(
                topic=record.topic,
                type=full_type(schema.name),
                schema=schema.data,
                metadata=record.metadata,
                schema_encoding=schema.encoding,
                message_encoding=record.message_encoding,
            )
        elif isinstance(record, Header):
            self.profile, self.library = record.profile, record.library
        elif isinstance(record, Metadata):
            self.metadata.append(record)
        elif isinstance(record, ChunkIndex):
            self._indexes.append(record)
        elif isinstance(record, Statistics):
            self._statistics = record

    def _count(self, stream: BinaryIO) -> None:
        """Count the messages by the statistics, or where these cannot be right by reading."""
        listed = {} if self._statistics is None else self._statistics.channel_message_counts
        described = any(listed.values()) and self.channels.keys() >= listed.keys()
        if self.finished and described and not self._faults:
            self.counts = listed
            return
        usable, counts = [], Counter[int]()
        for block in self.blocks:
            messages, fault = self.read(stream, block)
            if messages:
                stamps = [stamp for _, _, stamp, *_ in messages]
                block.start_ns, block.end_ns = min(stamps), max(stamps)
                counts.update(channel for channel, *_ in messages)
            if messages or fault:
                usable.append(block)
        self.blocks, self.counts = usable, counts

    # Reading

    def read(
        self, stream: BinaryIO, block: Block, channels: Collection[int] | None = None
    ) -> tuple[list[StoredMessage], str]:
        """Return the whole messages of a block, in file order, and its faults."""
        stream.seek(block.position)
        records, fault = b'', ''
        try:
            records = _read_limited(stream, block.length)
            if block.chunked:
                records, fault = _expanded_chunk(records[_HEAD.size :], block)
        except _DAMAGE as error:
            fault = _reason(error)
        messages, wrong = self._messages(block, records, channels)
        if messages and messages[0][-1].startswith(ZSTD):
            raise not_plain(self.path, 'its messages are compressed one by one')
        fault = fault or wrong
        kind = 'chunk' if block.chunked else 'message'
        return messages, fault and f'the {kind} at byte {block.position} is damaged ({fault})'

    def _messages(
        self, block: Block, records: bytes, channels: Collection[int] | None
    ) -> tuple[list[StoredMessage], str]:
        # The library's own splitting takes 2 s longer for an hour of joint states at 200 Hz.
        found: list[StoredMessage] = []
        low, high, count, strange = LATEST_STAMP, 0, 0, 0
        position, end, message, fault = 0, len(records), int(Opcode.MESSAGE), ''
        while position + _HEAD.size <= end:
            opcode, length = _HEAD.unpack_from(records, position)
            start = position + _HEAD.size
            if opcode not in _IN_CHUNKS or start + length > end:
                break
            position = start + length
            if opcode != message:
                fault = self._describe(opcode, records[start:position]) or fault
                continue
            if length < _MESSAGE.size:
                fault = f'a message of {length} bytes is too short'
                break
            channel, sequence, stamp_ns, publish_ns = _MESSAGE.unpack_from(records, start)
            if stamp_ns > LATEST_STAMP:
                fault = f'a message is stamped {stamp_ns} ns; stamps end at {LATEST_STAMP} ns'
                continue
            count += 1
            if channels is None or channel in channels:
                content = records[start + _MESSAGE.size : position]
                found.append((channel, sequence, stamp_ns, publish_ns, content))
            if channel not in self.channels:
                strange += 1
            if stamp_ns < low:
                low = stamp_ns
            if stamp_ns > high:
                high = stamp_ns
        if block.whole and position != end:
            fault = fault or 'a record in it is cut, or of a kind that a chunk cannot have'
        if count and not block.start_ns <= low <= high <= block.end_ns and block.whole:
            fault = fault or 'its time range does not match its messages'
        block.count, block.strange = count, strange
        return found, fault

    def _describe(self, opcode: int, content: bytes) -> str:
        """Take the first description of a schema or a channel; return its fault."""
        key = opcode, content[:2]
        if key in self._described:
            return ''
        self._described.add(key)
        try:
            record = _record(opcode, content)
        except _DAMAGE as error:
            return f'a description in it is damaged: {_reason(error)}'
        if not isinstance(record, McapChannel) or record.id not in self.channels:
            self._take(record)
        return ''


def _reason(error: BaseException) -> str:
    """Return why a record cannot be read; errors of `mcap` may have no text."""
    return str(error) or f'{type(error).__name__} of mcap'


def _summary_start(stream: BinaryIO, size: int) -> int:
    """Return the place of the summary by the footer at the end of a file; 0 if there is none."""
    tail = _FOOTER.size + len(MAGIC)
    stream.seek(max(0, size - tail))
    footer = stream.read(_FOOTER.size)
    if len(footer) < _FOOTER.size or stream.read() != MAGIC:
        return 0
    opcode, length, start, *_ = _FOOTER.unpack(footer)
    return int(start) if (opcode, length) == (Opcode.FOOTER, 20) and start < size else 0


def _record(opcode: int, content: bytes) -> Any:
    return _RECORDS[opcode].read(ReadDataStream(BytesIO(content)))


def _read_limited(stream: BinaryIO, length: int) -> bytes:
    if length > LARGEST:
        raise ValueError(f'it has {length} bytes; at most {LARGEST} are read')
    return stream.read(length)


def _checksum(stream: BinaryIO, begin: int, end: int) -> int:
    """Return the checksum of a part of a file."""
    stream.seek(begin)
    crc = 0
    for place in range(begin, end, _PIECE):
        crc = zlib.crc32(stream.read(min(_PIECE, end - place)), crc)
    return crc


# Compression


def _expanded_chunk(content: bytes, block: Block) -> tuple[bytes, str]:
    """
    Return the records of a chunk as far as they can be expanded, and its fault.

    Missing records of a chunk that was cut are no fault.
    """
    *_, size, crc, length = _CHUNK.unpack_from(content)
    begin = _CHUNK.size + length
    if (index := block.index) is not None:
        size, compression = index.uncompressed_size, index.compression
        packed = content[-index.compressed_size :]
    else:
        # The length of the compressed records stands behind the name of the compression.
        compression, packed = content[_CHUNK.size : begin].decode(), content[begin + 8 :]
    if size > LARGEST:
        raise ValueError(f'{size} bytes are declared; at most {LARGEST} are read')
    records, fault = _expand(compression, packed, size, _PIECE)
    if fault and len(records) < size:
        # The records before the damage
        records, fault = _expand(compression, packed, size, 1)
    if len(records) > size:
        raise ValueError(f'more than the {size} bytes declared')
    if len(records) != size:
        fault = (fault or f'{len(records)} bytes instead of {size}') if block.whole else ''
    elif crc not in (0, zlib.crc32(records)):
        fault = 'the checksum does not match'
    return records, fault


def _expand(compression: str, packed: bytes, size: int, step: int) -> tuple[bytes, str]:
    """Expand little more than `size` bytes; return them and the damage that ends them."""
    pieces, length = [], 0
    try:
        for piece in _pieces(compression, packed, step):
            pieces.append(piece)
            length += len(piece)
            if length > size:
                break
    except (zstandard.ZstdError, RuntimeError) as error:
        return b''.join(pieces), str(error)
    return b''.join(pieces), ''


def _pieces(compression: str, packed: bytes, step: int) -> Iterator[bytes]:
    """Yield the expanded bytes; up to `step` bytes before a damage are lost."""
    if compression == 'zstd':
        reader = zstandard.ZstdDecompressor().stream_reader(packed)
        while piece := reader.read(step):
            yield piece
    elif compression == 'lz4':
        expander = lz4.frame.LZ4FrameDecompressor()
        yield expander.decompress(packed, step)
        while not (expander.eof or expander.needs_input):
            yield expander.decompress(b'', step)
    elif compression == '':
        yield packed
    else:
        raise ValueError(f'unknown compression {quote(compression)}')
