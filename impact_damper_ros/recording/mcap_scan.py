"""
Finding the usable part of an MCAP file, be it finished, cut short or damaged.

The readers of the `mcap` library want a finished file, or hand out a record that was cut in the
middle as if it were whole. Here every record is checked against the size of the file before it is
read. The format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from .errors import RecordingError
from .mcap_block import LARGEST_CHUNK, jump_text, plain_content, read_block
from .mcap_records import (
    CHUNK,
    HEAD,
    LENGTH,
    LONGEST_DESCRIPTIONS,
    MAGIC,
    MESSAGE,
    Block,
    ChunkHead,
    IndexPart,
    RawMessage,
    Scan,
    note_description,
    open_file,
)

__all__ = [
    'LARGEST_CHUNK',
    'MAGIC',
    'Block',
    'RawMessage',
    'Scan',
    'jump_text',
    'open_file',
    'plain_content',
    'read_block',
    'scan_file',
]

_INDEX = struct.Struct('<HI')
_DATA_END = struct.Struct('<I')

#: A longer record is taken for damage (a run's largest are chunks of less than 1 MiB).
_LONGEST_RECORD = 2**31


def scan_file(path: Path, source: Path | None = None) -> Scan:
    """
    Walk through the records of a file and note where its messages are.

    The chunks of a finished file are skipped: its index tells what they hold. Those of any other
    are read through, one at a time.

    Parameters
    ----------
    path : Path
        The file.
    source : Path, optional
        The file to be named in messages, if `path` is an expanded copy of it.

    Raises
    ------
    RecordingError
        If the file is empty, cannot be read or is not an MCAP file.
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
    """Read the chunks through, where the index does not tell every channel and count."""
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
        except RecordingError:  # met again, and told, by whoever reads the messages
            usable.append(block)
            continue
        for message in messages:
            scan.counts[message.channel] = scan.counts.get(message.channel, 0) + 1
        if messages:
            stamps = [message.stamp_ns for message in messages]
            usable.append(replace(block, start_ns=min(stamps), end_ns=max(stamps)))
    scan.blocks = usable
