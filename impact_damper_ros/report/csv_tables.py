# SPDX-License-Identifier: Apache-2.0
"""CSV tables of impacts and states, the same from every command, with 17 digits."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Protocol

from impact_damper_ros.motion.event import Event, EventKind
from impact_damper_ros.outputs import whole

IMPACT_COLUMNS = (
    'time',
    'stop',
    'x',
    'primary_velocity_before',
    'primary_velocity_after',
    'damper_velocity_before',
    'damper_velocity_after',
    'kind',
)


def row(values: Iterable[object]) -> str:
    """Return one line; floats keep all their digits."""
    return ','.join(f'{v:.17g}' if isinstance(v, float) else str(v) for v in values) + '\n'


def csv_text(columns: Mapping[str, Iterable[object]]) -> str:
    """Return columns by their titles as CSV."""
    return ''.join(map(row, [columns, *zip(*columns.values(), strict=True)]))


def impact_rows(events: Sequence[Event]) -> str:
    """Return the lines of the impacts among some events, and of rests, which end chatters."""
    return ''.join(
        row([getattr(event, column) for column in IMPACT_COLUMNS[:-1]] + [event.kind.name.lower()])
        for event in events
        if event.kind in (EventKind.IMPACT, EventKind.REST)
    )


class CsvTable(Protocol):
    """A table to which rows are written."""

    def write(self, rows: str, /) -> object:
        """Write some rows."""


#: Blocks of rows that are written together.
_BLOCKS = 100


class _Rows:
    """Rows of a file, written in blocks; a full disk cuts no row."""

    def __init__(self, stream: FileIO, path: Path) -> None:
        self._stream, self._path = stream, path
        self._waiting: list[str] = []

    def write(self, rows: str) -> None:
        self._waiting.append(rows)
        if len(self._waiting) >= _BLOCKS:
            self.flush()

    def flush(self) -> None:
        rows, done = ''.join(self._waiting).encode(), 0
        self._waiting = []
        try:
            while done < len(rows):
                done += self._stream.write(rows[done:])
        except OSError as error:
            error.filename = str(self._path)
            # A pipe cannot be cut back.
            with suppress(OSError):
                complete = rows.rfind(b'\n', 0, done) + 1
                self._stream.truncate(self._stream.tell() - done + complete)
            raise


@contextmanager
def _file(path: Path) -> Iterator[CsvTable]:
    """Write a table into a file, by whole rows; one that ends early stays at `part_of` it."""
    with whole(path, part=True) as draft, draft.open('wb', buffering=0) as stream:
        table = _Rows(stream, path)
        try:
            yield table
        finally:
            table.flush()


def open_table(path: Path | None, columns: Sequence[str], stack: ExitStack) -> CsvTable | None:
    """Open a table, if a path is given, and write its head; - stands for standard output."""
    if path is None:
        return None
    table: CsvTable = sys.stdout if str(path) == '-' else stack.enter_context(_file(path))
    table.write(row(columns))
    return table
