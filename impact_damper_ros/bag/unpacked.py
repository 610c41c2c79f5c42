# SPDX-License-Identifier: Apache-2.0
"""
Copies of files of a bag that cannot be read where they are.

rosbag2 compresses whole files if asked to, and SQLite leaves what was written last in a file
beside the database (``-wal``) where a recorder was killed.
"""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
import weakref
from contextlib import closing
from pathlib import Path

import zstandard

from .errors import RecordingError
from .mcap_file import MAGIC, ZSTD, most_expanded, open_file
from .sqlite_file import HEAD, MAGIC as SQLITE, pages_of

_PIECE = 1024 * 1024


class Unpacked:
    """The temporary copies of one bag, which are removed with it."""

    def __init__(self) -> None:
        self._directory: Path | None = None
        self._count = 0

    def file(self, path: Path) -> tuple[Path, bool]:
        """Return the plain file of a bag's file, itself or a copy, and whether it is SQLite."""
        plain = path
        try:
            head = _head(path)
            if head.startswith(ZSTD):
                plain = self._expanded(path)
                head = _head(plain)
            is_sqlite = head.startswith(SQLITE)
            wal = path.with_name(f'{path.name}-wal')
            if is_sqlite and wal.exists() and wal.stat().st_size:
                plain = self._checkpointed(plain, wal)
            page, pages = pages_of(head) if is_sqlite else (0, 0)
            size = plain.stat().st_size
            if size < page * pages and size % page:
                # The rest of a page that was cut would be read as zeros.
                plain = self._copied(plain, size - size % page)
        except OSError as error:
            raise RecordingError.from_os_error('expand', path, error) from error
        return plain, is_sqlite

    def _new_file(self) -> Path:
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='impact_damper_bag_'))
            weakref.finalize(self, shutil.rmtree, self._directory, ignore_errors=True)
        self._count += 1
        return self._directory / str(self._count)

    def _expanded(self, path: Path) -> Path:
        copy, length = self._new_file(), 0
        limit = most_expanded(path.stat().st_size)
        try:
            with open_file(path) as stream, copy.open('wb') as output:
                reader = zstandard.ZstdDecompressor().stream_reader(stream)
                while piece := reader.read(_PIECE):
                    if not length and not piece.startswith((MAGIC[: len(piece)], SQLITE)):
                        cause = 'its compressed content is not a file of a bag'
                        raise RecordingError('read', path, cause)
                    length += len(piece)
                    if length > limit:
                        cause = f'it expands to more than {limit} bytes, 100 times its size'
                        raise RecordingError('expand', path, cause)
                    output.write(piece)
        except zstandard.ZstdError as error:
            cause = f'its compression is damaged: {error}'
            raise RecordingError('expand', path, cause) from error
        return copy

    def _checkpointed(self, path: Path, wal: Path) -> Path:
        """Return a copy of a database that has what its write-ahead log holds."""
        copy = self._copied(path)
        shutil.move(self._copied(wal), f'{copy}-wal')
        try:
            with closing(sqlite3.connect(copy)) as connection:
                connection.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        except sqlite3.Error as error:
            cause = f'what {wal.name} holds of it cannot be read: {error}'
            raise RecordingError('read', path, cause) from error
        return copy

    def _copied(self, path: Path, size: int | None = None) -> Path:
        """Return a copy of a file, or of its beginning."""
        copy = self._new_file()
        with open_file(path) as stream, copy.open('wb') as output:
            shutil.copyfileobj(stream, output, _PIECE)
            output.truncate(size)
        return copy


def _head(path: Path) -> bytes:
    with open_file(path) as stream:
        return stream.read(HEAD)
