"""
Finding the usable part of an MCAP file, be it finished, cut short or damaged.

The readers of the `mcap` library want a finished file, or hand out a record that was cut in the
middle as if it were whole. Here every record is checked against the size of the file before it is
read. The format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema

from .errors import RecordingError

__all__ = ['Block', 'RawMessage', 'Scan', 'read_block', 'scan_file']

MAGIC = b'\x89MCAP0\r\n'

_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_CHUNK = struct.Struct('<QQQII')
_LENGTH = struct.Struct('<Q')
_INDEX = struct.Struct('<HI')

#: A longer record is taken for damage (a run's largest are chunks of less than 1 MiB).
_LONGEST_RECORD = 2**31


class RawMessage(NamedTuple):
    """A message as it stands in the file."""

    channel: int
    sequence: int
    stamp_ns: int
    content: bytes


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
    size : int
        Its length in bytes.
    profile : str
        ``'ros2'``, if written by ROS 2.
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
    """

    path: Path
    size: int
    profile: str = ''
    blocks: list[Block] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    metadata: list[Metadata] = field(default_factory=list)
    finished: bool = False
    unusable: int = 0


def scan_file(path: Path) -> Scan:
    """
    Walk through the records of a file and note where its messages are.

    The chunks of a finished file are skipped: its index tells what they hold. Those of any other
    are read through, one at a time.

    Raises
    ------
    RecordingError
        If the file is empty, cannot be read or is not an MCAP file.
    """
    try:
        with path.open('rb') as stream:
            scan = Scan(path, stream.seek(0, 2))
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
        raise RecordingError.from_os_error('read', path, error) from error
    return scan


def _check_magic(scan: Scan, magic: bytes) -> None:
    if not magic:
        cause = 'the file is empty (0 bytes): the recording ended before anything was written'
        raise RecordingError('read', scan.path, cause)
    if magic != MAGIC and not MAGIC.startswith(magic):
        cause = 'it is not an MCAP file (it does not start with the MCAP magic bytes)'
        raise RecordingError('read', scan.path, cause, 'name a bag directory or a .mcap file')


def _walk(scan: Scan, stream: BinaryIO) -> int:
    """Note all whole records; return where the last of them ends."""
    position = min(len(MAGIC), scan.size)
    while not scan.finished:
        stream.seek(position)
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return position
        opcode, length = _HEAD.unpack(head)
        start = position + _HEAD.size
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
        if length < _MESSAGE.size:
            return False
        channel, _, stamp, _ = _MESSAGE.unpack(stream.read(_MESSAGE.size))
        scan.blocks.append(Block(start, length, stamp, stamp, chunk=False))
        scan.counts[channel] = scan.counts.get(channel, 0) + 1
    elif opcode == Opcode.FOOTER:
        scan.finished = True
    elif opcode == Opcode.MESSAGE_INDEX:
        if length < _INDEX.size:
            return False
        channel, content = _INDEX.unpack(stream.read(_INDEX.size))
        scan.counts[channel] = scan.counts.get(channel, 0) + content // 16
    elif opcode in (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
        return _note_description(scan, opcode, stream.read(length))
    return True


def _note_description(scan: Scan, opcode: int, content: bytes) -> bool:
    stream = ReadDataStream(BytesIO(content))
    try:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            scan.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            scan.channels[channel.id] = channel
        elif opcode == Opcode.HEADER:
            scan.profile = Header.read(stream).profile
        elif opcode == Opcode.METADATA:
            scan.metadata.append(Metadata.read(stream))
    except Exception:  # whatever damage makes the library raise
        return False
    return True


def _note_chunk(scan: Scan, stream: BinaryIO, start: int, length: int, *, whole: bool) -> None:
    head = stream.read(_CHUNK.size)
    if len(head) == _CHUNK.size and length >= _CHUNK.size:
        start_ns, end_ns, *_ = _CHUNK.unpack(head)
        scan.blocks.append(Block(start, length, start_ns, end_ns, whole=whole))


def _learn_topics(scan: Scan, stream: BinaryIO) -> None:
    """Read the chunks through, where the index does not tell every channel and count."""
    counted = bool(scan.counts) or not scan.blocks
    if scan.finished and counted and scan.channels.keys() >= scan.counts.keys():
        return
    scan.counts.clear()
    usable = []
    for block in scan.blocks:
        try:
            messages = read_block(scan, stream, block)
        except RecordingError:  # met again, and told, by whoever reads the messages
            usable.append(block)
            continue
        for message in messages:
            scan.counts[message.channel] = scan.counts.get(message.channel, 0) + 1
        if messages:
            stamps = [message.stamp_ns for message in messages]
            usable.append(replace(block, start_ns=min(stamps), end_ns=max(stamps)))
    scan.blocks = usable


def read_block(scan: Scan, stream: BinaryIO, block: Block) -> list[RawMessage]:
    """
    Return the messages of a block in file order; schemas and channels go into `scan`.

    Of a block that is not whole, the messages that are.

    Raises
    ------
    RecordingError
        If the block is damaged.
    """
    stream.seek(block.offset)
    content = stream.read(block.length)
    if not block.chunk:
        channel, sequence, stamp_ns, _ = _MESSAGE.unpack_from(content)
        return [RawMessage(channel, sequence, stamp_ns, content[_MESSAGE.size :])]
    try:
        records = _decompress(content, whole=block.whole)
        return list(_messages(scan, records, whole=block.whole))
    except (ValueError, struct.error, RuntimeError, zstandard.ZstdError) as error:
        cause = f'the chunk at byte {block.offset - _HEAD.size} is damaged ({error})'
        remedy = 'recover_run saves the rest of the bag'
        raise RecordingError('read', scan.path, cause, remedy) from error


def _decompress(content: bytes, *, whole: bool) -> bytes:
    _, _, size, checksum, name_length = _CHUNK.unpack_from(content)
    name_end = _CHUNK.size + name_length
    compression = content[_CHUNK.size : name_end]
    (length,) = _LENGTH.unpack_from(content, name_end)
    packed = content[name_end + _LENGTH.size :][:length]
    if compression == b'':
        records = packed
    elif compression == b'zstd':
        records = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    elif compression == b'lz4':
        records = bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed))
    else:
        raise ValueError(f'unknown compression {compression!r}')
    if whole and len(records) != size:
        raise ValueError(f'{len(records)} bytes instead of {size}')
    if whole and checksum and zlib.crc32(records) != checksum:
        raise ValueError('the checksum does not match')
    return records


def _messages(scan: Scan, records: bytes, *, whole: bool) -> list[RawMessage]:
    messages = []
    position = 0
    while position + _HEAD.size <= len(records):
        opcode, length = _HEAD.unpack_from(records, position)
        start = position + _HEAD.size
        position = start + length
        if position > len(records):
            break
        if opcode == Opcode.MESSAGE:
            channel, sequence, stamp_ns, _ = _MESSAGE.unpack_from(records, start)
            content = records[start + _MESSAGE.size : position]
            messages.append(RawMessage(channel, sequence, stamp_ns, content))
        elif not _note_description(scan, opcode, records[start:position]):
            raise ValueError('a schema or channel cannot be read')
    if whole and position != len(records):
        raise ValueError('the last record is cut')
    return messages
