# SPDX-License-Identifier: Apache-2.0
"""
One MCAP file of a bag, finished, cut short or damaged, as the `mcap` library reads it.

Opening a file walks through its records once: the checksums of data and summary are compared then,
the counts of its statistics when all its messages were read. Nothing is expanded beyond its
declared size and beyond `LARGEST`. The format: https://mcap.dev/spec
"""

from __future__ import annotations

import os
import stat
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC

from impact_damper_ros.parameters.quoting import counted, shown

from .errors import RecordingError

MAGIC = MCAP0_MAGIC
#: Largest record, and largest content of a chunk or of a compressed message, bytes.
LARGEST = 128 * 1024 * 1024
_LIMIT = f'at most {LARGEST} bytes are read'
#: Messages of a chunk: in a full one they have 128 bytes each.
_MOST_MESSAGES = LARGEST // 128
#: Bytes that are expanded at once.
_PIECE = 1024 * 1024
#: How a message begins that rosbag2 has compressed by itself. No encapsulation of CDR does.
ZSTD = b'\x28\xb5\x2f\xfd'

#: Opcode and length of a record.
_HEAD = struct.Struct('<BQ')
#: Channel, sequence, log time and publish time.
_MESSAGE = struct.Struct('<HIQQ')
#: First and last stamp, size, checksum, and length of the compression's name.
_CHUNK = struct.Struct('<QQQII')
#: Opcode, length of the rest, places of the summary and of its offsets.
_FOOTER = struct.Struct('<BQQQ')
_END_LENGTH = _FOOTER.size + 4 + len(MAGIC)


@dataclass(slots=True)
class Block:
    """A record that holds messages: a chunk, or a message outside of any chunk."""

    position: int  # of the record in the file
    length: int  # of what is there of it
    start_ns: int  # earliest stamp
    end_ns: int  # latest stamp
    whole: bool = True  # false for the chunk in the middle of which a file was cut
    counts: Counter[int] | None = None  # messages by channel; None until it is read


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
    """The usable content of an MCAP file; `source` is the file that `path` is a copy of."""

    def __init__(self, path: Path, source: Path) -> None:
        self.path, self.source = path, source
        self.profile = self.library = ''
        self.blocks: list[Block] = []  # in file order
        self.schemas: dict[int, Schema] = {}  # by id
        self.channels: dict[int, Channel] = {}  # by id
        self.counts: Mapping[int, int] = {}  # messages by channel
        self.metadata: list[Metadata] = []
        self.finished = False  # whether it ends with footer and magic
        self.unusable = 0  # bytes at the end that belong to no whole record
        #: Stamp of the first message of a topic that comes after a later one, of those read
        self.disordered_ns: int | None = None
        self._statistics: Statistics | None = None
        self._faults: list[str] = []
        try:
            with open_file(path) as stream:
                self._open(stream)
                self._count(stream)
        except OSError as error:
            raise RecordingError.from_os_error('read', source, error) from error

    @property
    def own(self) -> bool:
        """Whether this package has written the file."""
        return self.library.startswith('impact_damper_ros/')

    def faults(self) -> Iterator[str]:
        """Yield where the file contradicts itself, once all its blocks were read."""
        yield from self._faults
        said, read = self._statistics, [block.counts for block in self.blocks]
        if said is None or not self.finished or None in read:
            return
        listed, there = map(self._by_topic, (said.channel_message_counts, _sum(read)))
        yield from miscounts('its statistics count', listed, said.message_count, there)

    def _by_topic(self, counts: Mapping[int, int]) -> Counter[str]:
        """Return the messages of each topic, of which there may be several channels."""
        found: Counter[str] = Counter()
        for number, count in counts.items():
            channel = self.channels.get(number)
            found[channel.topic if channel else f'channel {number}'] += count
        return found

    # Opening

    def _open(self, stream: BinaryIO) -> None:
        magic = stream.read(len(MAGIC))
        if not magic:
            cause = 'the file is empty (0 bytes): the recording ended before anything was written'
            raise RecordingError('read', self.source, cause)
        if not MAGIC.startswith(magic):
            cause = 'it is not an MCAP file (it does not start with the MCAP magic bytes)'
            raise RecordingError(
                'read', self.source, cause, 'name a bag directory or a .mcap file'
            )
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        position = min(len(MAGIC), size)
        data_end, footer = 0, None
        try:
            for record in self._records(stream):
                begin, position = position, stream.tell()
                if isinstance(record, DataEnd):
                    data_end = position
                elif isinstance(record, Footer):
                    footer = record
                else:
                    self._take(record, begin, position - begin)
            # The library reads the magic after the footer
            self.finished = stream.tell() == size
            position = stream.tell()
        except OSError:
            raise
        except RecordLengthLimitExceeded as error:
            self._faults.append(f'{error}; the rest is not read')
        except Exception:  # whatever a cut or damage makes the library raise
            self._take_cut_chunk(stream, position, size - position)
        self.unusable = size - position
        if self.finished and footer is not None:
            self._check_summary(stream, data_end, size - _END_LENGTH, footer)

    def _records(self, stream: BinaryIO) -> Iterator[McapRecord]:
        reader = _RecordReader(
            stream, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST
        )
        try:
            yield from reader.records
        except CRCValidationError as error:
            self._faults.append('the checksum of its data does not match')
            yield error.record
            yield from _records_from(stream)

    def _take(self, record: McapRecord, position: int, length: int) -> None:
        """Note a record that is whole."""
        if isinstance(record, Chunk):
            start, end = record.message_start_time, record.message_end_time
            self.blocks.append(Block(position, length, start, end))
        elif isinstance(record, Message):
            self.blocks.append(Block(position, length, record.log_time, record.log_time))
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Header):
            self.profile, self.library = record.profile, record.library
        elif isinstance(record, Metadata):
            self.metadata.append(record)
        elif isinstance(record, Statistics):
            self._statistics = record

    def _take_cut_chunk(self, stream: BinaryIO, position: int, length: int) -> None:
        """Note the chunk in the middle of which the file ends, if it does."""
        stream.seek(position)
        head = stream.read(_HEAD.size + _CHUNK.size)
        if len(head) == _HEAD.size + _CHUNK.size and head[0] == Opcode.CHUNK:
            start, end, *_ = _CHUNK.unpack_from(head, _HEAD.size)
            self.blocks.append(Block(position, length, start, end, whole=False))

    def _check_summary(self, stream: BinaryIO, begin: int, end: int, footer: Footer) -> None:
        if not footer.summary_start:
            return
        stream.seek(begin)
        places = footer.summary_start, footer.summary_offset_start
        head = _FOOTER.pack(Opcode.FOOTER, _FOOTER.size + 4 - _HEAD.size, *places)
        crc = zlib.crc32(head, zlib.crc32(stream.read(max(0, end - begin))))
        if footer.summary_start != begin:
            at = footer.summary_start
            self._faults.append(f'its footer places the summary at byte {at}, not {begin}')
        elif footer.summary_crc not in (0, crc):
            self._faults.append('the checksum of its summary does not match')

    def _count(self, stream: BinaryIO) -> None:
        """Count the messages: as the statistics do, or where these cannot be by reading them."""
        listed = {} if self._statistics is None else self._statistics.channel_message_counts
        if self.finished and any(listed.values()) and self.channels.keys() >= listed.keys():
            self.counts = listed
            return
        usable = []
        for block in self.blocks:
            try:
                stamps = [stamp for _, stamp, _ in self.read(stream, block)]
            except RecordingError:  # raised again when the messages are read
                stamps = [block.start_ns, block.end_ns]
            if stamps:
                block.start_ns, block.end_ns = min(stamps), max(stamps)
                usable.append(block)
        self.blocks = usable
        self.counts = _sum([block.counts for block in usable])

    # Reading

    def read(
        self, stream: BinaryIO, block: Block, channels: Collection[int] | None = None
    ) -> list[tuple[int, int, bytes]]:
        """Return channel, stamp and content of the whole messages of a block, in file order."""
        try:
            stream.seek(block.position)
            if block.whole:
                record = next(_records_from(stream), None)
            else:
                record = _cut_chunk(stream.read(min(block.length, LARGEST)))
            if isinstance(record, Message):
                block.counts = Counter([record.channel_id])
                return [(record.channel_id, record.log_time, record.data)]
            if not isinstance(record, Chunk):
                raise ValueError('it is no chunk')
            return self._messages(block, _expanded_chunk(record, whole=block.whole), channels)
        except _DAMAGE as error:
            cause = f'the chunk at byte {block.position} is damaged ({error})'
            remedy = 'recover_run saves the rest of the bag'
            raise RecordingError('read', self.source, cause, remedy) from error

    def _messages(
        self, block: Block, records: bytes, channels: Collection[int] | None
    ) -> list[tuple[int, int, bytes]]:
        # The library's own splitting takes 2 s longer for an hour of joint states at 200 Hz.
        found: list[tuple[int, int, bytes]] = []
        counts: dict[int, int] = {}
        latest: dict[int, int] = {}
        position, end, message = 0, len(records), int(Opcode.MESSAGE)
        while position + _HEAD.size <= end:
            opcode, length = _HEAD.unpack_from(records, position)
            start = position + _HEAD.size
            position = start + length
            if position > end:
                position = start - _HEAD.size
                break
            if opcode == message:
                channel, _, stamp_ns, _ = _MESSAGE.unpack_from(records, start)
                if stamp_ns < latest.get(channel, 0) and self.disordered_ns is None:
                    self.disordered_ns = stamp_ns
                latest[channel] = stamp_ns
                counts[channel] = counts.get(channel, 0) + 1
                if channels is None or channel in channels:
                    found.append((channel, stamp_ns, records[start + _MESSAGE.size : position]))
                    if len(found) > _MOST_MESSAGES:
                        raise ValueError(f'it holds more than {_MOST_MESSAGES} messages')
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._describe(opcode, records[start:position])
        if block.whole and position != end:
            raise ValueError('the last record is cut')
        block.counts = Counter(counts)
        return found

    def _describe(self, opcode: int, content: bytes) -> None:
        """Take a schema or a channel that the summary does not have."""
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas.setdefault(schema.id, schema)
        else:
            channel = Channel.read(stream)
            self.channels.setdefault(channel.id, channel)


_DAMAGE = (
    *(ValueError, ArithmeticError, MemoryError, RuntimeError, struct.error),
    *(McapError, zstandard.ZstdError),
)


class _RecordReader(StreamReader):
    """Reads records, the indexes of messages empty: they are long, and nothing here uses them."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode != Opcode.MESSAGE_INDEX:
            return super()._read_record(opcode, length)
        if len(self._stream.read(length)) < length:
            raise EndOfFile
        return MessageIndex(0, [])


def _records_from(stream: BinaryIO) -> Iterator[McapRecord]:
    """Yield the records from the present place of a file on."""
    reader = _RecordReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=LARGEST)
    return iter(reader.records)


def _cut_chunk(content: bytes) -> Chunk:
    """Return the chunk of which the beginning is there."""
    start, end, size, crc, length = _CHUNK.unpack_from(content, _HEAD.size)
    name = _HEAD.size + _CHUNK.size
    return Chunk(
        compression=content[name : name + length].decode(),
        data=content[name + length + 8 :],
        message_start_time=start,
        message_end_time=end,
        uncompressed_crc=crc,
        uncompressed_size=size,
    )


def _expanded_chunk(chunk: Chunk, *, whole: bool) -> bytes:
    """Return the records of a chunk; of a cut one, as many bytes as there are."""
    size = chunk.uncompressed_size
    if size > LARGEST:
        raise ValueError(f'{size} bytes are declared; {_LIMIT}')
    if chunk.compression == 'zstd':
        records = _expanded(chunk.data, size)
    elif chunk.compression == 'lz4':
        records = bytes(lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1))
    elif chunk.compression == '':
        records = chunk.data
    else:
        raise ValueError(f'unknown compression {shown(chunk.compression)}')
    if len(records) > size:
        raise ValueError(f'more than the {size} bytes declared')
    if whole and len(records) != size:
        raise ValueError(f'{len(records)} bytes instead of {size}')
    if whole and chunk.uncompressed_crc not in (0, zlib.crc32(records)):
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
    if content[:4] != ZSTD:
        return content
    try:
        size = zstandard.get_frame_parameters(content).content_size
        if size == zstandard.CONTENTSIZE_UNKNOWN:
            size = LARGEST
        if size > LARGEST:
            raise ValueError(f'{size} bytes are declared; {_LIMIT}')
        plain = _expanded(content, size)
    except zstandard.ZstdError as error:
        raise ValueError(f'it is compressed and damaged: {error}') from error
    if len(plain) > size:
        raise ValueError(f'it expands to more than {size} bytes')
    return plain


def _sum(counts: Iterable[Counter[int] | None]) -> Counter[int]:
    total: Counter[int] = Counter()
    for held in counts:
        total.update(held or {})
    return total


def miscounts(
    what: str, listed: Mapping[str, int], total: int | None, there: Mapping[str, int]
) -> Iterator[str]:
    """Yield where messages are not counted as they are there: by topic, or else in all."""
    wrong = [n for n in sorted({*listed, *there}) if listed.get(n, 0) != there.get(n, 0)]
    for name in wrong if listed else ():
        said = counted(listed.get(name, 0), 'message', ',')
        yield f'{what} {said} on {name}, not {there.get(name, 0):,}'
    if total not in (None, number := sum(there.values())) and not (wrong and listed):
        yield f'{what} {counted(total or 0, "message", ",")} in all, not {number:,}'
