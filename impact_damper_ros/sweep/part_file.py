# SPDX-License-Identifier: Apache-2.0
"""
The rigs of a sweep that are done, in lines appended to a file beside its table.

The first line holds the inputs of the sweep. Each further line holds some rigs, as lists of number
and columns, and the state from which the next rig of their chain starts. Columns that are arrays
are their bytes, in hexadecimal.
"""

from __future__ import annotations

import fcntl
import json
import os
import stat
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.plain import differences

from .grid import present_inputs
from .steady_state import Row
from .table import MetadataError

#: The entries of a `snapshot` on which the future of a run depends.
State = dict[str, Any]
_MOST_LINES = 12
#: Time from one flush to the disk to the next, s.
_SYNC_SECONDS = 0.5


def other_inputs(stored: dict[str, Any], asked: dict[str, Any]) -> str:
    """Return a line for each of the first values in which two sets of inputs differ."""
    return '\n'.join(
        f'  {name}: {_brief(there)} there, {_brief(here)} here'
        for name, there, here in differences(stored, asked)[:_MOST_LINES]
    )


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:45] + ' ... ' + text[-12:]


def part_path(output: Path) -> Path:
    """Return the name of the file with the finished rigs of a table."""
    return output.with_name(output.name + '.part')


class PartFile:
    """
    The finished rigs of a sweep, in a file that is locked by this process.

    Parameters
    ----------
    path : Path or None
        The file, made if absent; with None the rigs are in memory only.
    inputs : dict
        The inputs of the sweep.
    anew : bool
        Whether to discard a file of another sweep.

    Attributes
    ----------
    rows : dict of int to Row
        The columns of each rig, by its number.

    Raises
    ------
    MetadataError
        If the file has another sweep, is no such file, or is in use.
    OSError
        If the file cannot be written.
    """

    def __init__(self, path: Path | None, inputs: dict[str, Any], *, anew: bool = False) -> None:
        self.rows: dict[int, Row] = {}
        self._states: dict[int, State | None] = {}
        self._path = path
        self._file: int | None = None
        self._sync_from = 0.0
        if path is None:
            return
        self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
        try:
            self._lock(self._file)
            self._open(inputs, anew=anew)
        except BaseException:
            self.close()
            raise

    def _lock(self, file: int) -> None:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            raise MetadataError(
                f'{self._path} is not an ordinary file: move it away, or give another --output'
            )
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise MetadataError(
                f'{self._path} is in use by another sweep with this output: wait for it, or '
                'give another --output'
            ) from None

    def _open(self, inputs: dict[str, Any], *, anew: bool) -> None:
        """Read the file, without a line that was cut off; begin a new one."""
        assert self._file is not None
        assert self._path is not None
        head, content = _line(inputs), self._path.read_bytes()
        if head.startswith(content):
            content = b''
        *lines, rest = content.split(b'\n')
        try:
            stored = json.loads(lines[0]) if content else inputs
            if 'axes' not in stored:
                raise ValueError('no inputs')
            stored = present_inputs(stored)
            rigs = [json.loads(line, object_hook=_from_bytes) for line in lines[1:]]
            for rows, state in rigs:
                self.rows |= dict(rows)
                self._states[rows[-1][0]] = state
        except (ValueError, TypeError, LookupError) as error:
            if not anew:
                raise MetadataError(
                    f'{self._path} does not hold the rigs of a sweep, or is damaged ({error}): '
                    'give another --output, or --overwrite it'
                ) from error
            stored = {}
        differing = other_inputs(stored, json.loads(head))
        if differing and not anew:
            raise MetadataError(
                f'{self._path} holds {len(self.rows)} rigs of a sweep with other inputs:\n'
                f'{differing}\ngive the command it began with, another --output, or --overwrite it'
            )
        if differing or not content:
            self.rows, self._states = {}, {}
            os.ftruncate(self._file, 0)
            self._append(head)
        elif rest:
            os.ftruncate(self._file, len(content) - len(rest))

    def add(self, rows: Sequence[tuple[int, Row]], state: State | None) -> None:
        """Add rigs, and the state after the last of them; a power cut loses half a second."""
        self._append(_line([rows, state]))
        self.rows |= dict(rows)
        self._states[rows[-1][0]] = state

    def left_of(self, chain: Sequence[int]) -> tuple[Sequence[int], State | None]:
        """Return the rigs of a chain that are not done, and the state from which they start."""
        done = sum(row in self.rows for row in chain)
        return chain[done:], self._states.get(chain[done - 1]) if done else None

    def _append(self, line: bytes) -> None:
        if self._file is not None:
            while line:
                line = line[os.write(self._file, line) :]
            if time.monotonic() >= self._sync_from:
                os.fsync(self._file)
                self._sync_from = time.monotonic() + _SYNC_SECONDS

    def delete(self) -> None:
        """Delete the file, after its table was written."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close and unlock the file, which stays."""
        if self._file is not None:
            with suppress(OSError):
                os.fsync(self._file)
            os.close(self._file)
            self._file = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _line(content: Any) -> bytes:
    return json.dumps(content, separators=(',', ':'), default=_as_bytes).encode() + b'\n'


def _as_bytes(array: NDArray[Any]) -> dict[str, str]:
    """Return an array as entries for JSON: numbers as text would cost a tenth of a rig's time."""
    return {array.dtype.str: array.tobytes().hex()}


def _from_bytes(entries: dict[str, Any]) -> Any:
    """Return the array of entries by `_as_bytes`, and other entries unchanged."""
    kind, content = next(iter(entries.items()), ('', ''))
    if kind[:1] not in ('<', '>', '|'):
        return entries
    return np.frombuffer(bytes.fromhex(content), kind)
