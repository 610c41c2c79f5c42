"""
The journal of a sweep: the rows that are done, so that an interrupted sweep can continue.

A text file with one JSON object per line: the inputs of the sweep first, then one rig each. Lines
are only appended. A line that a power cut or a full disk has left unfinished is dropped, and its
rig is run again.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, Self

from .table import Row

#: Period of forced writes to the disk, s.
_SYNC = 2.0


class Done(NamedTuple):
    """A rig that has been run: its number, its columns, and the state for the next rig, if any."""

    point: int
    row: Row
    state: dict[str, Any] | None


class JournalError(ValueError):
    """A journal from which this sweep cannot continue; the message gives reason and remedy."""


def journal_path(output: Path) -> Path:
    """Return the name of the journal that belongs to a table."""
    output = Path(output)
    return output.with_name(output.name + '.part')


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

    Parameters
    ----------
    path : Path
        The file; made if there is none.
    inputs : dict
        The inputs of the sweep, `SweepPlan.inputs`.
    anew : bool, optional
        Whether to discard a journal of a sweep with other inputs.

    Attributes
    ----------
    points : dict of int to int
        The rigs that are done, and the offset of each in the file.
    states : dict of int to dict
        States after rigs from which others may still start.

    Raises
    ------
    JournalError
        If the journal belongs to a sweep with other inputs, is damaged, or is locked by another
        process.
    OSError
        If it cannot be written.
    """

    def __init__(self, path: Path, inputs: dict[str, Any], *, anew: bool = False) -> None:
        path = Path(path)
        self.path = path
        self.points: dict[int, int] = {}
        self.states: dict[int, dict[str, Any]] = {}
        self._file = path.open('a+b')
        try:
            self._lock()
            self._read(inputs, anew)
        except BaseException:
            self._file.close()
            raise
        self._synced = time.monotonic()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise JournalError(
                f'{self.path} is in use by another sweep with this output: wait for it, or give '
                'another --output'
            ) from None

    def _read(self, inputs: dict[str, Any], anew: bool) -> None:
        self._file.seek(0)
        head = self._file.readline()
        stored: Any = None
        if head.endswith(b'\n'):
            try:
                stored = json.loads(head)['inputs']
            except (ValueError, KeyError, TypeError):
                if not anew:
                    raise JournalError(
                        f'{self.path} is not the journal of a sweep: move it away, or give '
                        'another --output'
                    ) from None
        if stored is None or (anew and stored != inputs):
            # A new journal, or one whose first line was left unfinished
            self._file.truncate(0)
            self._write([{'inputs': inputs}])
            self._sync()
            return
        differing = differences(stored, inputs)
        if differing:
            count = sum(1 for _ in self._file)
            raise JournalError(
                f'{self.path} holds {count} rigs of a sweep with other inputs:\n  '
                + '\n  '.join(differing[:12])
                + '\ngive the command it began with, another --output, or --overwrite it'
            )
        end = self._file.tell()
        for number, line in enumerate(self._file, 2):
            if not line.endswith(b'\n'):
                break
            try:
                entry = json.loads(line)
                point, _, state = entry['point'], entry['row'], entry.get('state')
            except (ValueError, KeyError, TypeError):
                raise JournalError(
                    f'{self.path} is damaged in line {number}: delete this line, or the lines '
                    'from there on; their rigs will be run again'
                ) from None
            self.points[point] = end
            if state is not None:
                self.states[point] = state
            end += len(line)
        self._file.truncate(end)
        self._file.seek(0, os.SEEK_END)

    def _write(self, entries: Sequence[dict[str, Any]]) -> list[int]:
        """Append lines; return the offset of each."""
        lines = [(json.dumps(one, separators=(',', ':')) + '\n').encode() for one in entries]
        offsets = list(accumulate(map(len, lines), initial=self._file.seek(0, os.SEEK_END)))
        self._file.write(b''.join(lines))
        self._file.flush()
        return offsets[:-1]

    def _sync(self) -> None:
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def add(self, done: Sequence[Done]) -> None:
        """
        Append rigs; they survive an end of this process once this returns.

        Raises
        ------
        OSError
            If there is no room.
        """
        entries: list[dict[str, Any]] = [{'point': one.point, 'row': one.row} for one in done]
        if done and done[-1].state is not None:
            # A worker may stop after any rig; another worker continues from the last one only
            entries[-1]['state'] = done[-1].state
            self.states[done[-1].point] = done[-1].state
        offsets = self._write(entries)
        self.points.update(zip((one.point for one in done), offsets, strict=True))
        if time.monotonic() - self._synced > _SYNC:
            self._sync()

    def row(self, point: int) -> Row:
        """Return the columns of a rig that is done."""
        self._file.seek(self.points[point])
        row: Row = json.loads(self._file.readline())['row']
        return row

    def close(self) -> None:
        """Close and unlock the file, which stays."""
        if not self._file.closed:
            self._sync()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, *_: object) -> None:
        try:
            self.close()
        except OSError:
            # On a full disk the first error is the one to report
            if error is None:
                raise
