# SPDX-License-Identifier: Apache-2.0
"""CSV tables of impacts and states, the same from every command; 17 digits."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol

from impact_damper_ros.outputs import draft_of
from impact_damper_ros.rig import Event, EventKind

IMPACT_COLUMNS = (
    'time',
    'stop',
    'x',
    'primary_velocity_before',
    'primary_velocity_after',
    'damper_velocity_before',
    'damper_velocity_after',
)


def row(values: Sequence[object]) -> str:
    """Return one line; floats keep all their digits."""
    return ','.join(f'{v:.17g}' if isinstance(v, float) else str(v) for v in values) + '\n'


def impact_rows(events: Sequence[Event]) -> str:
    """Return the lines of the impacts among some events, and of rests, which end chatters."""
    return ''.join(
        row([getattr(event, column) for column in IMPACT_COLUMNS])
        for event in events
        if event.kind in (EventKind.IMPACT, EventKind.REST)
    )


class CsvTable(Protocol):
    """What rows are written to."""

    def write(self, rows: str, /) -> object:
        """Write some rows."""


#: Rows, or blocks of rows, that are written together.
_ROWS = 100


class _File:
    """
    A table in a file; a full disk is reported with its name.

    An older file is replaced at the end, and kept if the table cannot be written. Without one the
    table grows in its place, by whole rows, so that as much of it as can be is there whatever
    happens.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._draft = draft_of(path) if path.exists() else path
        self._failed = False
        self._waiting: list[str] = []
        self._stream = self._draft.open('wb', buffering=0)

    def write(self, rows: str) -> None:
        self._waiting.append(rows)
        if len(self._waiting) >= _ROWS:
            self._flush()

    def _flush(self) -> None:
        """Write the rows that wait; where not all of them fit, none is cut."""
        rows, done = ''.join(self._waiting).encode(), 0
        self._waiting = []
        try:
            while done < len(rows):
                done += self._stream.write(rows[done:])
        except OSError as error:
            error.filename = str(self._path)
            self._failed = True
            # Not of a pipe
            with suppress(OSError):
                whole = rows.rfind(b'\n', 0, done) + 1
                self._stream.truncate(self._stream.tell() - done + whole)
            raise

    def close(self) -> None:
        try:
            self._flush()
        finally:
            self._stream.close()
            if self._draft != self._path:
                with suppress(OSError):
                    if self._failed:
                        self._draft.unlink()
                    else:
                        self._draft.replace(self._path.resolve())


def open_table(path: Path | None, columns: Sequence[str], stack: ExitStack) -> CsvTable | None:
    """Open a table, if one is asked for, and write its head; - stands for standard output."""
    if path is None:
        return None
    table: CsvTable = sys.stdout
    if str(path) != '-':
        file = _File(path)
        stack.callback(file.close)
        table = file
    table.write(row(columns))
    return table
