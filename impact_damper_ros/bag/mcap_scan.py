"""
The usable part of an MCAP file, be it finished, cut short or damaged.

Nothing is decompressed beyond the declared size and beyond `LARGEST_CHUNK`.

The readers of the `mcap` library require a finished file, or return a record that was cut in the
middle as a whole one. Here every record is checked against the size of the file before it is read.
The format: https://mcap.dev/spec
"""

from __future__ import annotations

import os
import stat
import struct
import zlib
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Header, Metadata, Schema, Statistics

from impact_damper_ros.rig.quoting import shown

from .errors import RecordingError

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
    """A message as stored in the file."""

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
    """The head of a chunk, and the place of its record in the file."""

    position: int
    length: int
    start_ns: int
    end_ns: int
    compression: str
    compressed_size: int
    size: int


@dataclass(frozen=True, slots=True)
class Block:
    """A part of the file that holds messages: a chunk, or a message outside of any chunk."""

    #: Of the record's content in the file, as far as it is there.
    offset: int
    length: int
    #: Earliest and latest stamp.
    start_ns: int
    end_ns: int
    whole: bool = True  # false for the last chunk of a file that was cut in the middle of it
    chunk: bool = True  # false for a message on its own (rosbag2's ``fastwrite``)


@dataclass
class Scan:
    """The usable content of an MCAP file."""

    path: Path  # the file
    source: Path  # the file as the user knows it, where `path` is an expanded copy of it
    size: int  # its length in bytes
    #: ``'ros2'``, if written by ROS 2, and what wrote it.
    profile: str = ''
    library: str = ''
    blocks: list[Block] = field(default_factory=list)  # where the messages are, in file order
    #: By id.
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    #: Messages per channel id, without those of damaged blocks.
    counts: dict[int, int] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)  # the metadata records
    finished: bool = False  # whether the file has its footer and the magic at its end
    unusable: int = 0  # bytes at the end that belong to no whole record
    #: The message index records by the block that they follow.
    indexes: dict[int, list[IndexPart]] = field(default_factory=dict)
    heads: list[ChunkHead] = field(default_factory=list)  # the whole chunks
    statistics: Statistics | None = None  # the counts in the summary
    #: The places of the chunks in the summary.
    chunk_indexes: list[ChunkIndex] = field(default_factory=list)
    footer: Footer | None = None  # where the summary is
    data_end: tuple[int, int] | None = None  # where the data ends, and its checksum or 0
    attachments: int = 0  # number of attachments
    #: The faults so far: the first case of each kind, and how many there are.
    faults: dict[str, tuple[str, int]] = field(default_factory=dict)
    #: First and last sequence number by channel of the blocks that were read whole.
    numbers: dict[int, dict[int, tuple[int, int]]] = field(default_factory=dict)
    description_size: int = 0

    @property
    def own(self) -> bool:
        """Whether this package has written the file."""
        return self.library.startswith('impact_damper_ros/')

    def topic_of(self, channel: int) -> str:
        """Return the topic of a channel, or its number in words if it is not described."""
        known = self.channels.get(channel)
        return known.topic if known is not None else f'channel {channel}'

    def may_hold(self, block: Block, channels: Collection[int]) -> bool:
        """Return whether a block may hold messages of channels, by its index if it has one."""
        parts = self.indexes.get(block.offset) if self.finished else None
        return parts is None or any(part.channel in channels for part in parts)

    def fault(self, kind: str, text: str) -> None:
        """Note a fault: the first of each kind is kept, the others are counted."""
        first, count = self.faults.get(kind, (text, 0))
        self.faults[kind] = first, count + 1


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


def note_description(scan: Scan, opcode: int, content: bytes) -> bool:
    """Take a record that is no message and no chunk; return whether it could be read."""
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


#: Largest chunk, compressed or not, or message that is read, in bytes.
LARGEST_CHUNK = 128 * 1024 * 1024
_LIMIT = f'at most {LARGEST_CHUNK} bytes are read'
#: Messages of a chunk: in a full one they have 128 bytes each.
_MOST_MESSAGES = LARGEST_CHUNK // 128
#: Bytes that are expanded at once.
_PIECE = 1024 * 1024
#: How a message begins that rosbag2 has compressed by itself. No encapsulation of CDR does.
_ZSTD = b'\x28\xb5\x2f\xfd'


def read_block(
    scan: Scan, stream: BinaryIO, block: Block, channels: Collection[int] | None = None
) -> list[RawMessage]:
    """Return the whole messages of a block in file order; schemas and channels go into `scan`."""
    try:
        if block.length > LARGEST_CHUNK:
            raise ValueError(f'it is {block.length} bytes long; {_LIMIT}')
        stream.seek(block.offset)
        content = stream.read(block.length)
        if not block.chunk:
            channel, sequence, stamp_ns, publish_ns = MESSAGE.unpack_from(content)
            if block.offset not in scan.numbers:
                scan.numbers[block.offset] = {channel: (sequence, sequence)}
                _check_publish_time(scan, channel, stamp_ns, publish_ns)
            return [RawMessage(channel, sequence, stamp_ns, content[MESSAGE.size :])]
        records = _decompress(content, whole=block.whole)
        return _messages(scan, stream, block, records, channels)
    except (ValueError, struct.error, RuntimeError, zstandard.ZstdError) as error:
        what = 'chunk' if block.chunk else 'message'
        cause = f'the {what} at byte {block.offset - HEAD.size} is damaged ({error})'
        remedy = 'recover_run saves the rest of the bag'
        raise RecordingError('read', scan.source, cause, remedy) from error


def _decompress(content: bytes, *, whole: bool) -> bytes:
    _, _, size, checksum, name_length = CHUNK.unpack_from(content)
    name_end = CHUNK.size + name_length
    compression = content[CHUNK.size : name_end]
    (length,) = LENGTH.unpack_from(content, name_end)
    if size > LARGEST_CHUNK:
        raise ValueError(f'{size} bytes are declared; {_LIMIT}')
    packed = content[name_end + LENGTH.size :][:length]
    if compression == b'':
        records = packed
    elif compression == b'zstd':
        records = _expanded(packed, size)
    elif compression == b'lz4':
        records = bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, size + 1))
    else:
        raise ValueError(f'unknown compression {shown(compression)}')
    if len(records) > size:
        raise ValueError(f'more than the {size} bytes declared')
    if whole and len(records) != size:
        raise ValueError(f'{len(records)} bytes instead of {size}')
    if whole and checksum and zlib.crc32(records) != checksum:
        raise ValueError('the checksum does not match')
    return records


def _expanded(packed: bytes, size: int) -> bytes:
    """Decompress a zstd frame as far as possible, to little more than `size` bytes."""
    reader = zstandard.ZstdDecompressor().stream_reader(packed)
    pieces, length = [], 0
    while length <= size and (piece := reader.read(min(_PIECE, size + 1 - length))):
        pieces.append(piece)
        length += len(piece)
    return b''.join(pieces)


def plain_content(content: bytes) -> bytes:
    """Return a message as it was sent: rosbag2 may compress each one by itself."""
    if content[:4] != _ZSTD:
        return content
    try:
        size = zstandard.get_frame_parameters(content).content_size
        if size == zstandard.CONTENTSIZE_UNKNOWN:
            size = LARGEST_CHUNK
        if size > LARGEST_CHUNK:
            raise ValueError(f'{size} bytes are declared; {_LIMIT}')
        plain = _expanded(content, size)
    except zstandard.ZstdError as error:
        raise ValueError(f'it is compressed and damaged: {error}') from error
    if len(plain) > size:
        raise ValueError(f'it expands to more than {size} bytes')
    return plain


def _messages(
    scan: Scan,
    stream: BinaryIO,
    block: Block,
    records: bytes,
    channels: Collection[int] | None,
) -> list[RawMessage]:
    messages = []
    # Stamp, place in the chunk and sequence number of each message in turn, by channel
    entries: dict[int, list[int]] = {}
    new = block.offset not in scan.numbers
    position = count = 0
    while position + HEAD.size <= len(records):
        opcode, length = HEAD.unpack_from(records, position)
        begin, start = position, position + HEAD.size
        position = start + length
        if position > len(records):
            break
        if opcode == Opcode.MESSAGE:
            channel, sequence, stamp_ns, publish_ns = MESSAGE.unpack_from(records, start)
            if length < MESSAGE.size:
                raise ValueError('a message is shorter than its head')
            count += 1
            if count > _MOST_MESSAGES:
                raise ValueError(f'it holds more than {_MOST_MESSAGES} messages')
            if new:
                entries.setdefault(channel, []).extend((stamp_ns, begin, sequence))
                if publish_ns != stamp_ns:
                    _check_publish_time(scan, channel, stamp_ns, publish_ns)
            if channels is None or channel in channels:
                content = records[start + MESSAGE.size : position]
                messages.append(RawMessage(channel, sequence, stamp_ns, content))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            if new:
                scan.description_size += length
            if scan.description_size > LONGEST_DESCRIPTIONS:
                raise ValueError(f'more than {LONGEST_DESCRIPTIONS} bytes of schemas')
            if not note_description(scan, opcode, records[start:position]):
                raise ValueError('a schema or channel cannot be read')
    if block.whole and position != len(records):
        raise ValueError('the last record is cut')
    if new and block.whole:
        scan.numbers[block.offset] = {
            channel: (held[2], held[-1]) for channel, held in entries.items()
        }
        _check_index(scan, stream, block, entries)
        _check_numbers(scan, entries)
    return messages


# Checks of a block


def _check_publish_time(scan: Scan, channel: int, stamp_ns: int, publish_ns: int) -> None:
    if publish_ns != stamp_ns and scan.own:
        scan.fault(
            'publish time',
            f'a message of {scan.topic_of(channel)} is logged at {stamp_ns} ns and published at '
            f'{publish_ns} ns, which are the same in a bag of this package',
        )


def _check_numbers(scan: Scan, entries: dict[int, list[int]]) -> None:
    """Check that the messages of this package's own bags are counted without a gap."""
    if not scan.own:
        return
    for channel, held in entries.items():
        numbers = held[2::3]
        if numbers[-1] - numbers[0] != len(numbers) - 1 or sorted(numbers) != numbers:
            for before, after in pairwise(numbers):
                if after != before + 1:
                    text = jump_text(scan.topic_of(channel), before, after)
                    scan.fault(f'number {channel}', text)


def jump_text(topic: str, before: int, after: int) -> str:
    """Return the text for two successive messages whose numbers are not consecutive."""
    if after > before:
        missing = after - before - 1
        text = f'{missing} message{" is" if missing == 1 else "s are"} missing'
    else:
        text = 'messages are duplicated or out of order'
    if before < 0:
        return f'message {after} of {topic} is the first: {text}'
    return f'message {before} of {topic} is followed by {after}: {text}'


def _check_index(
    scan: Scan, stream: BinaryIO, block: Block, entries: dict[int, list[int]]
) -> None:
    """Compare the index of a chunk with its messages."""
    where = f'the chunk at byte {block.offset - HEAD.size}'
    stamps = [stamp for held in entries.values() for stamp in held[::3]]
    if stamps and (min(stamps), max(stamps)) != (block.start_ns, block.end_ns):
        scan.fault(
            'chunk times',
            f'{where} declares stamps from {block.start_ns} to {block.end_ns} ns, and has '
            f'{min(stamps)} to {max(stamps)} ns',
        )
    parts = scan.indexes.get(block.offset)
    if parts is None:
        return
    listed: dict[int, list[tuple[int, int]]] = {}
    for channel, _, start, length in parts:
        stream.seek(start)
        numbers = struct.unpack(f'<{length // 8}Q', stream.read(length))
        pairs = zip(numbers[::2], numbers[1::2], strict=True)
        listed.setdefault(channel, []).extend(pairs)
    # A file that was cut may end within the indexes of its last chunk.
    cut = not scan.finished and block is scan.blocks[-1]
    for channel in sorted(listed if cut else {*listed, *entries}):
        held = entries.get(channel, [])
        there = sorted(zip(held[::3], held[1::3], strict=True))
        if sorted(listed.get(channel, [])) != there:
            text = f'its index lists {len(listed.get(channel, []))} of them'
            if len(listed.get(channel, [])) == len(there):
                text = 'its index lists others'
            scan.fault(
                'chunk index',
                f'{where} holds {len(there)} messages of {scan.topic_of(channel)}, and {text}',
            )


_INDEX = struct.Struct('<HI')
_DATA_END = struct.Struct('<I')

#: A longer record counts as damage (a run's largest are chunks of less than 1 MiB).
_LONGEST_RECORD = 2**31


def scan_file(path: Path, source: Path | None = None) -> Scan:
    """
    Walk through the records of a file and note where its messages are.

    The chunks of a finished file are skipped: its index lists their content. Those of any other
    are read through, one at a time.
    """
    try:
        with open_file(path) as stream:
            scan = Scan(path, source or path, stream.seek(0, 2))
            stream.seek(0)
            _check_magic(scan, stream.read(len(MAGIC)))
            end = _walk(scan, stream)
            stream.seek(end)
            if scan.finished and stream.read(len(MAGIC) + 1) == MAGIC:
                end = scan.size
            else:
                scan.finished = False
            scan.unusable = scan.size - end
            _learn_topics(scan, stream)
    except OSError as error:
        raise RecordingError.from_os_error('read', source or path, error) from error
    return scan


def _check_magic(scan: Scan, magic: bytes) -> None:
    if not magic:
        cause = 'the file is empty (0 bytes): the recording ended before anything was written'
        raise RecordingError('read', scan.source, cause)
    if magic != MAGIC and not MAGIC.startswith(magic):
        cause = 'it is not an MCAP file (it does not start with the MCAP magic bytes)'
        raise RecordingError('read', scan.source, cause, 'name a bag directory or a .mcap file')


def _walk(scan: Scan, stream: BinaryIO) -> int:
    """Note all whole records; return where the last of them ends."""
    position = min(len(MAGIC), scan.size)
    while not scan.finished:
        stream.seek(position)
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            return position
        opcode, length = HEAD.unpack(head)
        start = position + HEAD.size
        end = start + length
        # Opcodes from 0x80 are private to some application, and skipped.
        if opcode == 0 or Opcode.DATA_END < opcode < 0x80 or length > _LONGEST_RECORD:
            return position
        if end > scan.size:
            if opcode == Opcode.CHUNK:
                _note_chunk(scan, stream, start, scan.size - start, whole=False)
            return position
        if opcode == Opcode.CHUNK:
            _note_chunk(scan, stream, start, length, whole=True)
        elif not _note(scan, opcode, stream, start, length):
            return position
        position = end
    return position


def _note(scan: Scan, opcode: int, stream: BinaryIO, start: int, length: int) -> bool:
    """Take in a record other than a chunk; return whether it is sound."""
    if opcode == Opcode.MESSAGE:
        if length < MESSAGE.size:
            return False
        channel, _, stamp, _ = MESSAGE.unpack(stream.read(MESSAGE.size))
        scan.blocks.append(Block(start, length, stamp, stamp, chunk=False))
        scan.counts[channel] = scan.counts.get(channel, 0) + 1
    elif opcode == Opcode.MESSAGE_INDEX:
        if length < _INDEX.size:
            return False
        channel, content = _INDEX.unpack(stream.read(_INDEX.size))
        if content % 16 or content > length - _INDEX.size:
            return False
        scan.counts[channel] = scan.counts.get(channel, 0) + content // 16
        if scan.blocks:
            parts = scan.indexes.setdefault(scan.blocks[-1].offset, [])
            position = start - HEAD.size
            parts.append(IndexPart(channel, position, start + _INDEX.size, content))
    elif opcode == Opcode.DATA_END:
        if length < _DATA_END.size:
            return False
        scan.data_end = start - HEAD.size, *_DATA_END.unpack(stream.read(_DATA_END.size))
    elif opcode == Opcode.ATTACHMENT:
        scan.attachments += 1
    elif opcode in _DESCRIPTIONS:
        scan.finished = opcode == Opcode.FOOTER
        scan.description_size += length
        if scan.description_size > LONGEST_DESCRIPTIONS:
            return False
        return note_description(scan, opcode, stream.read(length))
    return True


_DESCRIPTIONS = (
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.METADATA,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.FOOTER,
)


def _note_chunk(scan: Scan, stream: BinaryIO, start: int, length: int, *, whole: bool) -> None:
    head = stream.read(min(length, CHUNK.size + 64))
    if len(head) < CHUNK.size:
        return
    start_ns, end_ns, size, _, name_length = CHUNK.unpack_from(head)
    scan.blocks.append(Block(start, length, start_ns, end_ns, whole=whole))
    name_end = CHUNK.size + name_length
    if whole and name_end + LENGTH.size <= len(head):
        compression = head[CHUNK.size : name_end].decode(errors='replace')
        (compressed,) = LENGTH.unpack_from(head, name_end)
        position = start - HEAD.size
        scan.heads.append(
            ChunkHead(
                position, length + HEAD.size, start_ns, end_ns, compression, compressed, size
            )
        )


def _learn_topics(scan: Scan, stream: BinaryIO) -> None:
    """Read all chunks if the index does not list every channel and count."""
    counted = bool(scan.counts) or not scan.blocks
    if scan.finished and counted and scan.channels.keys() >= scan.counts.keys():
        expected = scan.statistics
        if expected is None or expected.message_count == sum(scan.counts.values()):
            return
    scan.counts.clear()
    usable = []
    for block in scan.blocks:
        try:
            messages = read_block(scan, stream, block)
        except RecordingError:  # reported again when the messages are read
            usable.append(block)
            continue
        for message in messages:
            scan.counts[message.channel] = scan.counts.get(message.channel, 0) + 1
        if messages:
            stamps = [message.stamp_ns for message in messages]
            usable.append(replace(block, start_ns=min(stamps), end_ns=max(stamps)))
    scan.blocks = usable
