"""
The journal of a sweep: what is done so far, on disk, until the table is written.

A text file with one JSON object in each line: first the inputs of the sweep, then a rig in each.
Lines are only ever added. Of a line that a power cut or a full disk has left unfinished nothing
is taken; the rig is run again.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .sweep_columns import Row
from .sweep_work import Done, Snapshot

__all__ = ['Journal', 'JournalError', 'differences', 'journal_path']

#: Seconds between two orders to the disk to keep what was written.
_SYNC = 2.0


class JournalError(ValueError):
    """A journal that this sweep cannot go on from; the message says why, and the remedy."""


def journal_path(output: Path) -> Path:
    """Return where the journal of a table is."""
    return output.with_name(output.name + '.part')


def differences(stored: Any, asked: Any, name: str = '') -> list[str]:
    """Return in which values two sets of inputs differ, in words."""
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
    The journal of one sweep, held by one process.

    Parameters
    ----------
    path : Path
        Where it is; made if it is not there.
    inputs : dict
        The inputs of the sweep.
    anew : bool, optional
        Whether the journal of a sweep with other inputs may be thrown away.

    Attributes
    ----------
    points : dict of int to int
        The rigs that are done, and where in the file each of them is.
    states : dict of int to dict
        States after rigs that are followed, as far as another rig may still start from them.

    Raises
    ------
    JournalError
        If it belongs to a sweep with other inputs, is damaged, or held by another process.
    OSError
        If it cannot be written.
    """

    def __init__(self, path: Path, inputs: dict[str, Any], *, anew: bool = False) -> None:
        self.path = path
        self.points: dict[int, int] = {}
        self.states: dict[int, Snapshot] = {}
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
                f'{self.path} is in use: another sweep is writing this output; wait for it, or '
                'give another --output'
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
            # New, or to be; or its very first line was not finished
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
        sound = self._file.tell()
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
            self.points[point] = sound
            if state is not None:
                self.states[point] = state
            sound += len(line)
        self._file.truncate(sound)
        self._file.seek(0, os.SEEK_END)

    def _write(self, entries: Sequence[dict[str, Any]]) -> list[int]:
        """Write lines; return where each begins."""
        begins = [self._file.seek(0, os.SEEK_END)]
        lines = [(json.dumps(one, separators=(',', ':')) + '\n').encode() for one in entries]
        begins += [begins[0] + length for length in accumulate(map(len, lines))]
        self._file.write(b''.join(lines))
        self._file.flush()
        return begins[:-1]

    def _sync(self) -> None:
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def add(self, done: Sequence[Done]) -> None:
        """
        Write rigs; once this returns, no end of this process can lose them.

        Raises
        ------
        OSError
            If there is no room.
        """
        entries: list[dict[str, Any]] = [{'point': one.point, 'row': one.row} for one in done]
        if done and done[-1].state is not None:
            # A worker stops at any rig; only from the last one another goes on
            entries[-1]['state'] = done[-1].state
            self.states[done[-1].point] = done[-1].state
        begins = self._write(entries)
        self.points.update(zip((one.point for one in done), begins, strict=True))
        if time.monotonic() - self._synced > _SYNC:
            self._sync()

    def row(self, point: int) -> Row:
        """Return what a rig that is done does."""
        self._file.seek(self.points[point])
        row: Row = json.loads(self._file.readline())['row']
        return row

    def close(self) -> None:
        """Let go of the journal, which stays."""
        if not self._file.closed:
            self._sync()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except OSError:
            # The disk is full: what led here says so
            if error is None:
                raise
