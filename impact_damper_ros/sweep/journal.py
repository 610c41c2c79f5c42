# SPDX-License-Identifier: Apache-2.0
"""The journal of a sweep: the rows that are done, in SQLite, so that a sweep can be resumed."""

from __future__ import annotations

import errno
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Self

#: The columns of one rig, for JSON.
Row = dict[str, Any]

_TABLES = """\
CREATE TABLE sweep (inputs TEXT);
CREATE TABLE rigs (point INTEGER PRIMARY KEY, columns TEXT) WITHOUT ROWID;
CREATE TABLE chains (chain INTEGER PRIMARY KEY, place INTEGER, state TEXT) WITHOUT ROWID;
"""


#: Errors of the disk: what SQLite calls them, and the system.
_DISK = {
    sqlite3.SQLITE_FULL: (errno.ENOSPC, 'No space left on device'),
    sqlite3.SQLITE_READONLY: (errno.EACCES, ''),
    sqlite3.SQLITE_CANTOPEN: (errno.EACCES, ''),
    sqlite3.SQLITE_IOERR: (errno.EIO, ''),
}


class Progress(NamedTuple):
    """How far a chain of rigs has come."""

    place: int = 0  # number of its rigs that are done
    state: dict[str, Any] | None = None  # from which the next one starts


_BEGINNING = Progress()


class JournalError(ValueError):
    """A journal from which this sweep cannot continue; the message gives reason and remedy."""


def journal_path(output: Path) -> Path:
    """Return the name of the journal that belongs to a table."""
    return output.with_name(output.name + '.part')


def delete_journal(output: Path) -> None:
    """Delete the journal of a table, and what a killed process may have left beside it."""
    place = journal_path(output)
    for path in (place, place.with_name(place.name + '-journal')):
        path.unlink(missing_ok=True)


def differences(stored: Any, asked: Any, name: str = '') -> list[str]:
    """Return a line for each value in which two sets of inputs differ."""
    if isinstance(stored, dict) and isinstance(asked, dict):
        return [
            line
            for key in {**stored, **asked}
            for line in differences(
                stored.get(key), asked.get(key), f'{name}.{key}' if name else str(key)
            )
        ]
    if stored == asked:
        return []
    return [f'{name}: {_brief(stored)} there, {_brief(asked)} here']


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:45] + ' ... ' + text[-12:]


class Journal:
    """
    The journal of one sweep, locked by this process.

    `path` is its file, made if there is none; without, it is in memory. `anew` discards a journal
    of other inputs. Raises `JournalError` if the journal is of a sweep with other inputs or in
    use, and OSError if it cannot be written.
    """

    def __init__(self, path: Path | None, inputs: dict[str, Any], *, anew: bool = False) -> None:
        self._path = path
        place = ':memory:' if path is None else str(path)
        with self._errors():
            self._base = sqlite3.connect(place, timeout=0.0, isolation_level=None)
        try:
            with self._errors():
                self._open(inputs, anew=anew)
        except BaseException:
            self._base.close()
            raise

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Report what SQLite reports as what it is to the user."""
        try:
            yield
        except sqlite3.DatabaseError as error:
            code = getattr(error, 'sqlite_errorcode', 0) & 0xFF
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise JournalError(
                    f'{self._path} is in use by another sweep with this output: wait for it, or '
                    'give another --output'
                ) from None
            # Without a code a text could not be decoded
            if code in (0, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR):
                raise JournalError(
                    f'{self._path} is not the journal of a sweep, or damaged ({error}): move it '
                    'away, or give another --output'
                ) from error
            if code not in _DISK:
                raise
            number, text = _DISK[code]
            raise OSError(number, text or str(error), str(self._path)) from error

    def _open(self, inputs: dict[str, Any], *, anew: bool) -> None:
        base = self._base
        # The lock of the first transaction is kept until the end
        base.execute('PRAGMA locking_mode = EXCLUSIVE')
        base.execute('PRAGMA synchronous = FULL')
        base.execute('BEGIN EXCLUSIVE')
        stored = None
        if base.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]:
            stored = json.loads(base.execute('SELECT inputs FROM sweep').fetchone()[0])
            differing = differences(stored, inputs)
            if differing and not anew:
                count = base.execute('SELECT count(*) FROM rigs').fetchone()[0]
                raise JournalError(
                    f'{self._path} holds {count} rigs of a sweep with other inputs:\n  '
                    + '\n  '.join(differing[:12])
                    + '\ngive the command it began with, another --output, or --overwrite it'
                )
            if differing:
                for name in ('sweep', 'rigs', 'chains'):
                    base.execute(f'DROP TABLE {name}')
                stored = None
        if stored is None:
            for line in _TABLES.splitlines():
                base.execute(line)
            base.execute('INSERT INTO sweep VALUES (?)', (json.dumps(inputs),))
        base.execute('COMMIT')

    def add(
        self,
        rows: Sequence[tuple[int, Row]],
        chain: int | None = None,
        done: Progress = _BEGINNING,
    ) -> None:
        """Add rigs, and the progress of their chain; all are on disk once this returns."""
        with self._errors():
            self._base.execute('BEGIN')
            try:
                self._base.executemany(
                    'INSERT OR REPLACE INTO rigs VALUES (?, ?)',
                    [(point, json.dumps(row, separators=(',', ':'))) for point, row in rows],
                )
                if chain is not None:
                    self._base.execute(
                        'INSERT OR REPLACE INTO chains VALUES (?, ?, ?)',
                        (chain, done.place, json.dumps(done.state)),
                    )
                self._base.execute('COMMIT')
            except BaseException:
                if self._base.in_transaction:
                    self._base.execute('ROLLBACK')
                raise

    def points(self) -> set[int]:
        """Return the numbers of the rigs that are done."""
        return {point for (point,) in self._base.execute('SELECT point FROM rigs')}

    def chains(self) -> dict[int, Progress]:
        """Return the progress of each chain that has been begun."""
        rows = self._base.execute('SELECT chain, place, state FROM chains')
        return {chain: Progress(place, json.loads(state)) for chain, place, state in rows}

    def rows(self) -> Iterator[Row]:
        """Yield the columns of all rigs that are done, in order."""
        for (columns,) in self._base.execute('SELECT columns FROM rigs ORDER BY point'):
            yield json.loads(columns)

    def close(self) -> None:
        """Close and unlock the file, which stays."""
        self._base.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
