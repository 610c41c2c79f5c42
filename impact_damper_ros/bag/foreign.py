# SPDX-License-Identifier: Apache-2.0
"""
Files of a bag that are not plain MCAP: compressed by zstd as a whole, or SQLite databases.

They are converted into temporary MCAP files, which are deleted with the reader.
"""

from __future__ import annotations

import json
import shlex
import shutil
import sqlite3
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap.writer import CompressionType, Writer

from impact_damper_ros.parameters.quoting import shown

from .errors import RecordingError
from .mcap_file import LARGEST, MAGIC, open_file
from .topics import definition

#: Bytes to which the compressed files of a bag may expand in all.
MOST_EXPANDED = 8 * 1024**3
#: Bytes that are left free on the disk.
_SPARE = 256 * 1024**2
_PIECE = 1024 * 1024
_ZSTD = b'\x28\xb5\x2f\xfd'
_SQLITE = b'SQLite format 3\0'
#: Longest wait of SQLite, s.
_DB_TIMEOUT_S = 5.0
_LATEST_STAMP = 2**63 - 1


class Unpacked:
    """The files of one bag as plain MCAP files."""

    def __init__(self) -> None:
        self._directory: Path | None = None
        self._left = MOST_EXPANDED
        self._count = 0

    def file(self, path: Path) -> Path:
        """Return the plain MCAP file of a bag's file: itself, or an expanded copy."""
        plain = path
        try:
            with open_file(path) as stream:
                head = stream.read(len(_SQLITE))
                if head.startswith(_ZSTD):
                    stream.seek(0)
                    plain = self._expanded(path, stream)
            if plain is not path:
                with plain.open('rb') as stream:
                    head = stream.read(len(_SQLITE))
            return self._of_database(path, plain) if head == _SQLITE else plain
        except OSError as error:
            raise RecordingError.from_os_error('expand', path, error) from error

    def _new_file(self) -> tuple[Path, int]:
        """Return the path of a new temporary file, and how long it may become."""
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='impact_damper_bag_'))
            weakref.finalize(self, shutil.rmtree, self._directory, ignore_errors=True)
        self._count += 1
        free = shutil.disk_usage(self._directory).free - _SPARE
        return self._directory / f'{self._count}.mcap', max(0, min(self._left, free))

    def _expanded(self, path: Path, stream: BinaryIO) -> Path:
        copy, limit = self._new_file()
        try:
            size = zstandard.get_frame_parameters(stream.read(_PIECE)).content_size
            if size == zstandard.CONTENTSIZE_UNKNOWN:
                size = limit
            if size > limit:
                raise _too_large(path, f'{size} bytes are declared', limit)
            stream.seek(0)
            reader = zstandard.ZstdDecompressor().stream_reader(stream)
            length = 0
            with copy.open('wb') as output:
                while piece := reader.read(_PIECE):
                    if not length and not piece.startswith((MAGIC[: len(piece)], _SQLITE)):
                        cause = 'its compressed content is not a file of a bag'
                        raise RecordingError('read', path, cause)
                    length += len(piece)
                    if length > size:
                        raise _too_large(path, f'it expands to more than {size} bytes', limit)
                    output.write(piece)
            self._left -= length
        except zstandard.ZstdError as error:
            cause = f'its compression is damaged: {error}'
            raise RecordingError('expand', path, cause) from error
        return copy

    def _of_database(self, path: Path, database: Path) -> Path:
        """Convert an SQLite file of rosbag2 into an MCAP file."""
        copy, limit = self._new_file()
        try:
            address = f'{database.absolute().as_uri()}?mode=ro'
            with (
                closing(sqlite3.connect(address, _DB_TIMEOUT_S, uri=True)) as connection,
                copy.open('wb') as output,
            ):
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
                writer = Writer(output, compression=CompressionType.NONE)
                writer.start('ros2', 'rosbag2 sqlite3')
                channels = dict(_database_channels(connection, writer))
                query = 'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'
                for topic, stamp, content in connection.execute(query):
                    if not isinstance(content, bytes) or not isinstance(stamp, int):
                        raise sqlite3.DatabaseError(f'a message is {shown(content)}, not bytes')
                    if not 0 <= stamp <= _LATEST_STAMP or topic not in channels:
                        text = f'a message of topic {shown(topic)} is stamped {stamp} ns'
                        raise sqlite3.DatabaseError(text)
                    writer.add_message(channels[topic], stamp, content, stamp)
                    if output.tell() > limit:
                        raise _too_large(path, f'its messages are more than {limit} bytes', limit)
                writer.finish()  # type: ignore[no-untyped-call]
                self._left -= output.tell()
        except (sqlite3.Error, LookupError, OverflowError, ValueError) as error:
            cause = f'it is stored in SQLite, and cannot be read: {error}'
            raise RecordingError('read', path, cause, _conversion(path)) from error
        return copy


def _database_channels(
    connection: sqlite3.Connection, writer: Writer
) -> Iterator[tuple[Any, int]]:
    """Register the topics; yield the number of each in the database and in the MCAP file."""
    schemas: dict[str, int] = {}
    rows = connection.execute('SELECT * FROM topics')
    names = [column[0] for column in rows.description]
    for row in rows:
        topic = dict(zip(names, row, strict=True))
        kind = str(topic['type'])
        if kind not in schemas:
            with suppress(ValueError):
                schemas[kind] = writer.register_schema(kind, 'ros2msg', definition(kind).encode())
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind, '', b'')
        yield (
            topic['id'],
            writer.register_channel(
                str(topic['name']),
                str(topic.get('serialization_format', 'cdr')),
                schemas[kind],
                {
                    'offered_qos_profiles': str(topic.get('offered_qos_profiles', '')),
                    'topic_type_hash': str(topic.get('type_description_hash', '')),
                },
            ),
        )


def _too_large(path: Path, what: str, limit: int) -> RecordingError:
    cause = (
        f'{what}; {limit} can be used here (at most {MOST_EXPANDED} for a bag, and what is free '
        f'in {tempfile.gettempdir()})'
    )
    remedy = 'set TMPDIR to a directory with more space, or expand or convert it beforehand'
    return RecordingError('expand', path, cause, remedy)


def _conversion(path: Path) -> str:
    """Return the command that converts the bag of a file."""
    bag = path.absolute().parent
    options = {'uri': f'{bag.name}_mcap', 'storage_id': 'mcap', 'all_topics': True}
    text = shlex.quote(json.dumps({'output_bags': [options]}))
    return (
        f'convert it with ROS 2: echo {text} > to_mcap.yaml && '
        f'ros2 bag convert -i {shlex.quote(str(path.parent))} -o to_mcap.yaml'
    )
