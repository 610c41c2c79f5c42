"""
The messages of one chunk of an MCAP file, and whether they are those that the file says.

Nothing is expanded beyond the size that is declared, and nothing beyond `LARGEST_CHUNK`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection
from itertools import pairwise
from typing import BinaryIO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.opcode import Opcode

from impact_damper_ros.rig.shown import shown

from .errors import RecordingError
from .mcap_records import (
    CHUNK,
    HEAD,
    LENGTH,
    LONGEST_DESCRIPTIONS,
    MESSAGE,
    Block,
    RawMessage,
    Scan,
    note_description,
)

__all__ = ['LARGEST_CHUNK', 'jump_text', 'plain_content', 'read_block']

#: Bytes of a chunk, as it stands in the file and expanded, or of a message, that are read.
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
    """
    Return the messages of a block in file order; schemas and channels go into `scan`.

    Of a block that is not whole, the messages that are.

    Parameters
    ----------
    scan : Scan
        The file; takes note of what is wrong with a block when it is read for the first time.
    stream : file
        The same, opened.
    block : Block
        One of its blocks.
    channels : collection of int, optional
        Those whose messages are wanted; all if not given.

    Raises
    ------
    RecordingError
        If the block is damaged, or larger than any that is read.
    """
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
    """Expand a zstd frame as far as it goes, to little more than `size` bytes."""
    reader = zstandard.ZstdDecompressor().stream_reader(packed)
    pieces, length = [], 0
    while length <= size and (piece := reader.read(min(_PIECE, size + 1 - length))):
        pieces.append(piece)
        length += len(piece)
    return b''.join(pieces)


def plain_content(content: bytes) -> bytes:
    """
    Return a message as it was sent: rosbag2 may compress each one by itself.

    Raises
    ------
    ValueError
        If it is damaged, or larger than any that is read.
    """
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


# What a block holds against what the file says of it


def _topic(scan: Scan, channel: int) -> str:
    known = scan.channels.get(channel)
    return known.topic if known is not None else f'channel {channel}'


def _check_publish_time(scan: Scan, channel: int, stamp_ns: int, publish_ns: int) -> None:
    if publish_ns != stamp_ns and scan.own:
        scan.fault(
            'publish time',
            f'a message of {_topic(scan, channel)} is logged at {stamp_ns} ns and published at '
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
                    text = jump_text(_topic(scan, channel), before, after)
                    scan.fault(f'number {channel}', text)


def jump_text(topic: str, before: int, after: int) -> str:
    """Say that a message of one number is followed by one of another, which is not the next."""
    if after > before:
        missing = after - before - 1
        text = f'{missing} message{" is" if missing == 1 else "s are"} missing'
    else:
        text = 'messages are there twice, or not in their order'
    if before < 0:
        return f'message {after} of {topic} is the first: {text}'
    return f'message {before} of {topic} is followed by {after}: {text}'


def _check_index(
    scan: Scan, stream: BinaryIO, block: Block, entries: dict[int, list[int]]
) -> None:
    """Hold the index of a chunk against what is in it."""
    where = f'the chunk at byte {block.offset - HEAD.size}'
    stamps = [stamp for held in entries.values() for stamp in held[::3]]
    if stamps and (min(stamps), max(stamps)) != (block.start_ns, block.end_ns):
        scan.fault(
            'chunk times',
            f'{where} says that its stamps are {block.start_ns} to {block.end_ns} ns, and has '
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
    for channel in sorted({*listed, *entries}):
        held = entries.get(channel, [])
        there = sorted(zip(held[::3], held[1::3], strict=True))
        if sorted(listed.get(channel, [])) != there:
            text = f'its index lists {len(listed.get(channel, []))} of them'
            if len(listed.get(channel, [])) == len(there):
                text = 'its index lists others'
            scan.fault(
                'chunk index',
                f'{where} holds {len(there)} messages of {_topic(scan, channel)}, and {text}',
            )
