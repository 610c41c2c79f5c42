# SPDX-License-Identifier: Apache-2.0
"""
One SQLite file of a bag (``.db3``), finished, cut short or damaged, read as an MCAP file is.

It is opened read-only and immutable, so that nothing is left beside it. What it costs to read is
bounded by its size: SQLite carries out what a file asks for (views, columns that are computed).
"""

from __future__ import annotations

import os
import sqlite3
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Metadata

from impact_damper_ros.parameters.quoting import shown

from .errors import RecordingError
from .mcap_file import LARGEST, LATEST_STAMP, Block, StoredMessage, open_file
from .topics import Channel, definition, full_type

MAGIC = b'SQLite format 3\0'
HEAD = 100
#: Messages of a block.
_BLOCK = 1000
#: Rows between which messages are searched.
_FIRST_ROW, _LAST_ROW = -(2**63), 2**40
#: Instructions of SQLite's machine between two looks at the budget, and the budget: a row takes
#: some 20 of them, and at least as many bytes.
_STEPS = 10_000
_LEAST_BUDGET, _EACH_BYTE = 10_000_000, 10


def pages_of(head: bytes) -> tuple[int, int]:
    """Return the size of a page and the number of pages, given the head of a file."""
    page, pages = struct.unpack_from('>H10xI', head.ljust(HEAD, b'\0'), 16)
    return 65536 if page == 1 else page, pages


class SqliteFile:
    """The usable content of an SQLite file; `source` is the file that `path` is a copy of."""

    own, profile, others = False, 'ros2', 0

    def __init__(self, path: Path, source: Path) -> None:
        self.path, self.source = path, source
        self.blocks: list[Block] = []  # `position` is the first row, `length` the number of rows
        self.channels: dict[int, Channel] = {}  # by number
        self.counts: Counter[int] = Counter()  # messages by channel
        self.metadata: list[Metadata] = []
        self._faults: list[str] = []
        self.finished, self.unusable = True, 0
        self._damaged, self._skipped = False, 1
        self._size = self._measured()
        self._budget, self._interrupt = 0, KeyboardInterrupt()
        with self.opened() as connection:
            self._check_tables(connection)
            self.channels = dict(_channels(connection))
            after: int | None = _FIRST_ROW
            while after is not None:
                after = self._find_blocks(connection, after)

    def _measured(self) -> int:
        """Return the size; note whether pages are missing or half written."""
        with open_file(self.path) as stream:
            page, pages = pages_of(stream.read(HEAD))
            size = stream.seek(0, os.SEEK_END)
        if size < page * pages:
            self.finished = False
            self._faults.append(f'it ends after {size} of {page * pages} bytes')
        journal = self.source.with_name(f'{self.source.name}-journal')
        if journal.exists() and journal.stat().st_size:
            # SQLite may delete any file that a journal names: it is left alone.
            self.finished = False
            self._faults.append(f'it was cut in a change that {journal.name} would undo')
        return size

    def faults(self) -> Iterator[str]:
        """Yield what is wrong with the file."""
        yield from self._faults

    def attachments(self, _: object) -> Iterator[Attachment | str]:
        """Yield nothing: there are none in SQLite."""
        yield from ()

    @contextmanager
    def opened(self) -> Iterator[sqlite3.Connection]:
        """Yield the open database."""
        address = f'{self.path.absolute().as_uri()}?mode=ro&immutable=1'
        try:
            with closing(sqlite3.connect(address, uri=True)) as connection:
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST)
                self._budget = _LEAST_BUDGET + _EACH_BYTE * self._size
                connection.set_progress_handler(self._spend, _STEPS)
                connection.execute('PRAGMA trusted_schema=OFF')
                # A file that was cut is refused otherwise.
                connection.execute('PRAGMA writable_schema=ON')
                yield connection
        except (sqlite3.Error, LookupError, OverflowError, UnicodeDecodeError) as error:
            self._refuse_interruption(error)
            cause = f'it is stored in SQLite, and cannot be read: {error}'
            remedy = 'sqlite3 FILE .recover may make a new one'
            raise RecordingError('read', self.source, cause, remedy) from error

    def _spend(self) -> bool:
        """Return whether a query has to end; Python handles Ctrl-C here."""
        try:
            self._budget -= _STEPS
            return self._budget < 0
        except KeyboardInterrupt as error:
            self._interrupt = error
            return True

    def _refuse_interruption(self, error: Exception) -> None:
        """Raise what has interrupted a query, if that is the error."""
        if getattr(error, 'sqlite_errorcode', 0) != sqlite3.SQLITE_INTERRUPT:
            return
        if self._budget >= 0:
            raise self._interrupt from error
        cause = 'it takes much more work to read than its size accounts for'
        raise RecordingError('read', self.source, cause) from error

    def _check_tables(self, connection: sqlite3.Connection) -> None:
        for name in ('topics', 'messages'):
            query = 'SELECT type, sql FROM sqlite_master WHERE name = ?'
            kind, text = connection.execute(query, [name]).fetchone() or ('', '')
            columns = connection.execute(f'PRAGMA table_xinfo({name})').fetchall()
            plain = kind == 'table' and not str(text).upper().startswith('CREATE VIRTUAL')
            if not plain or any(column[-1] for column in columns):
                raise sqlite3.DatabaseError(f'it has no table {name}, or not a plain one')

    def _find_blocks(self, connection: sqlite3.Connection, after: int) -> int | None:
        """
        Divide the messages after a row into blocks, and count them.

        Return a row beyond the damage that ends this; None if there is none.
        """
        # The end of a long message may be damaged, too.
        content = '' if self.finished else ', data'
        query = f'SELECT rowid, topic_id, timestamp{content} FROM messages WHERE rowid > ?'
        block, row = None, after
        try:
            for row, topic, stamp, *_ in connection.execute(f'{query} ORDER BY rowid', [after]):
                if topic not in self.channels or not _is_stamp(stamp):
                    self._note(f'a message of topic {shown(topic)} is stamped {shown(stamp)} ns')
                    continue
                self.counts[topic] += 1
                if block is None or row - block.position >= _BLOCK:
                    block = Block(row, 1, stamp, stamp)
                    self.blocks.append(block)
                block.length = row - block.position + 1
                block.start_ns = min(stamp, block.start_ns)
                block.end_ns = max(stamp, block.end_ns)
        except sqlite3.DatabaseError as error:
            self._refuse_interruption(error)
            self._note(f'it is damaged: {error}')
            if row == after:
                # Twice as far each time
                self._skipped *= 2
            else:
                self._skipped = 1
            beyond = max(row, 0) + self._skipped
            return beyond if beyond < _LAST_ROW else None
        return None

    def _note(self, fault: str) -> None:
        """Note the first of the faults of the messages."""
        if not self._damaged:
            self._faults.append(fault)
        self._damaged, self.finished = True, False

    def read(
        self,
        connection: sqlite3.Connection,
        block: Block,
        channels: Collection[int] | None = None,
    ) -> tuple[list[StoredMessage], str]:
        """Return the messages of a block, in the order of the file, and what is wrong with it."""
        query = (
            'SELECT topic_id, timestamp, data FROM messages WHERE rowid BETWEEN ? AND ? '
            'ORDER BY rowid'
        )
        found: list[StoredMessage] = []
        fault, left = '', self._size
        try:
            last = block.position + block.length - 1
            for topic, stamp, content in connection.execute(query, (block.position, last)):
                if topic not in self.channels or not _is_stamp(stamp):
                    continue
                if not isinstance(content, bytes):
                    fault = f'a message is {shown(content)}, not bytes'
                elif channels is None or topic in channels:
                    found.append((topic, 0, stamp, stamp, content))
                    left -= len(content)
                if left < 0:
                    raise sqlite3.DatabaseError('its messages are larger than the file')
        except sqlite3.DatabaseError as error:
            self._refuse_interruption(error)
            fault = str(error)
        return found, fault and f'row {block.position} or one after it is damaged ({fault})'


def _is_stamp(stamp: object) -> bool:
    return isinstance(stamp, int) and 0 <= stamp <= LATEST_STAMP


def _channels(connection: sqlite3.Connection) -> Iterator[tuple[int, Channel]]:
    """Yield number and description of each topic; columns differ between versions of rosbag2."""
    rows = connection.execute('SELECT * FROM topics')
    names = [column[0] for column in rows.description]
    for row in rows:
        topic: dict[str, Any] = dict(zip(names, row, strict=True))
        kind, schema = full_type(str(topic['type'])), b''
        with suppress(ValueError):
            schema = definition(kind).encode()
        metadata = {
            'offered_qos_profiles': str(topic.get('offered_qos_profiles', '')),
            'topic_type_hash': str(topic.get('type_description_hash', '')),
        }
        encoding = str(topic.get('serialization_format', 'cdr'))
        schema_encoding = 'ros2msg' if schema else ''
        channel = Channel(str(topic['name']), kind, schema, metadata, schema_encoding, encoding)
        yield topic['id'], channel
