"""
An MCAP file in chunks, written with as little Python as can be for each message.

The file is the one that ``mcap.writer.Writer`` makes of the same calls, byte for byte (a test
holds one against the other). That one takes several times as long for a message, all of it with
the interpreter's lock held, for which the thread that moves a rig has to wait. Here a message is
one packed header and a reference to its content; everything else is done once per chunk, most of
it without the lock.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel as McapChannel,
)
from mcap.records import (
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

__all__ = ['ChunkWriter', 'Output']

_COMPRESSION = 'zstd'
_MESSAGE_CODE = int(Opcode.MESSAGE)
# Opcode and length of the rest; channel, sequence, log time and publish time
_MESSAGE = struct.Struct('<BQHIQQ')
_MESSAGE_FIELDS = _MESSAGE.size - struct.calcsize('<BQ')
# Opcode and length of the rest; channel, and length of the entries
_INDEX = struct.Struct('<BQHI')
_INDEX_FIELDS = _INDEX.size - struct.calcsize('<BQ')
_FOOTER_HEAD = struct.Struct('<BQQQ')
_FOOTER_LENGTH = 8 + 8 + 4


class Output(Protocol):
    """What a file is written to."""

    def write(self, content: bytes, /) -> object:
        """Append to it."""

    def tell(self) -> int:
        """Return its length."""

    def flush(self) -> object:
        """Hand over what has been appended."""


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    content: bytes = builder.end()  # type: ignore[no-untyped-call]
    return content


class ChunkWriter:
    """
    Write an MCAP file with zstd-compressed chunks and an index.

    Parameters
    ----------
    output : Output
        Where to.
    chunk_size : int
        Bytes of messages after which a chunk is closed.
    profile, library : str
        For the header.
    """

    def __init__(self, output: Output, chunk_size: int, profile: str, library: str) -> None:
        self._output = output
        self._chunk_size = chunk_size
        # Kept: making one anew for each chunk would take and touch a megabyte of memory each time.
        self._compressor = zstandard.ZstdCompressor()
        self._schemas: list[Schema] = []
        self._channels: list[McapChannel] = []
        # Records for the summary, as bytes: there are thousands in a long run.
        self._chunks: list[bytes] = []
        self._metadata: list[MetadataIndex] = []
        # Messages by channel, in the order in which the channels had their first ones
        self._counts: dict[int, int] = {}
        self._first = self._last = 0
        self._begin_chunk()
        output.write(MCAP0_MAGIC)
        output.write(_bytes_of(Header(profile, library)))

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        # Stamp and offset of each message in turn, by channel
        self._entries: dict[int, list[int]] = {}

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record at once."""
        offset = self._output.tell()
        content = _bytes_of(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=offset, length=len(content), name=name))
        self._output.write(content)

    def register_schema(self, name: str, encoding: str, content: bytes) -> int:
        """Put a schema into the present chunk; return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=content, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._append(schema)
        return schema.id

    def register_channel(
        self, topic: str, message_encoding: str, schema: int, metadata: Mapping[str, str]
    ) -> int:
        """Put a channel with the schema of a number into the present chunk; return its own."""
        channel = McapChannel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=message_encoding,
            schema_id=schema,
            metadata=dict(metadata),
        )
        self._channels.append(channel)
        self._append(channel)
        return channel.id

    def _append(self, record: McapRecord) -> None:
        content = _bytes_of(record)
        self._parts.append(content)
        self._size += len(content)
        if self._size > self._chunk_size:
            self._close_chunk()

    def add_message(self, channel: int, stamp_ns: int, content: bytes, sequence: int) -> None:
        """Put a message into the present chunk; its stamp is both log time and publish time."""
        length = len(content)
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = []
        entries += stamp_ns, self._size
        self._parts += (
            _MESSAGE.pack(
                _MESSAGE_CODE, _MESSAGE_FIELDS + length, channel, sequence, stamp_ns, stamp_ns
            ),
            content,
        )
        self._size += _MESSAGE.size + length
        if self._size > self._chunk_size:
            self._close_chunk()

    def flush(self) -> None:
        """Close the present chunk and hand everything over."""
        self._close_chunk()
        self._output.flush()

    def _close_chunk(self) -> None:
        """Write the present chunk with its index, unless there is no message in it."""
        if not self._entries:
            return
        first = min(min(entries[::2]) for entries in self._entries.values())
        last = max(max(entries[::2]) for entries in self._entries.values())
        self._first = min(first, self._first) if self._counts else first
        self._last = max(last, self._last)
        content = b''.join(self._parts)
        compressed = self._compressor.compress(content)
        record = _bytes_of(
            Chunk(
                compression=_COMPRESSION,
                data=compressed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(content),
                uncompressed_size=len(content),
            )
        )
        start = self._output.tell()
        self._output.write(record)
        offsets = {}
        indices: list[bytes] = []
        offset = start + len(record)
        for channel, entries in self._entries.items():
            length = 8 * len(entries)
            offsets[channel] = offset
            offset += _INDEX.size + length
            indices += (
                _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX_FIELDS + length, channel, length),
                struct.pack(f'<{len(entries)}Q', *entries),
            )
            self._counts[channel] = self._counts.get(channel, 0) + len(entries) // 2
        self._output.write(b''.join(indices))
        index = _bytes_of(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=len(record),
                message_index_offsets=offsets,
                message_index_length=offset - start - len(record),
                compression=_COMPRESSION,
                compressed_size=len(compressed),
                uncompressed_size=len(content),
            )
        )
        self._chunks.append(index)
        self._begin_chunk()

    def finish(self) -> None:
        """Close the present chunk and write summary and footer; does not flush."""
        self._close_chunk()
        self._output.write(_bytes_of(DataEnd(0)))
        start = self._output.tell()
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._first,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )
        groups = (
            (Opcode.SCHEMA, _bytes_of(*self._schemas)),
            (Opcode.CHANNEL, _bytes_of(*self._channels)),
            (Opcode.STATISTICS, _bytes_of(statistics)),
            (Opcode.CHUNK_INDEX, b''.join(self._chunks)),
            (Opcode.ATTACHMENT_INDEX, b''),
            (Opcode.METADATA_INDEX, _bytes_of(*self._metadata)),
        )
        offsets: list[McapRecord] = []
        offset = start
        for opcode, content in groups:
            length = len(content)
            offsets.append(
                SummaryOffset(group_opcode=opcode, group_start=offset, group_length=length)
            )
            offset += length
        parts = [content for _, content in groups]
        summary = b''.join((*parts, _bytes_of(*offsets)))
        head = _FOOTER_HEAD.pack(Opcode.FOOTER, _FOOTER_LENGTH, start, offset)
        crc = zlib.crc32(head, zlib.crc32(summary))
        self._output.write(summary)
        self._output.write(
            _bytes_of(Footer(summary_start=start, summary_offset_start=offset, summary_crc=crc))
        )
        self._output.write(MCAP0_MAGIC)
