"""
The work of a sweep: rigs in a row in any process, and the journal of what is done.

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
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import impact_damper_ros
from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.control.controlled_run import ControlledRun
from impact_damper_ros.orbits.settling import EndlessEventsError, Settling
from impact_damper_ros.rig import InitialConditions, ParameterError, RigParameters
from impact_damper_ros.rig.long_run import LongRun

from .columns import Row, failed_row, row_of
from .plan import Target, varied, varied_control
from .steady_state import steady_state

__all__ = [
    'Block',
    'Done',
    'Journal',
    'JournalError',
    'WrongVersionError',
    'differences',
    'journal_path',
    'rig_row',
    'run_block',
]


Snapshot = dict[str, Any]
Settings = tuple[tuple[Target, float], ...]


class WrongVersionError(RuntimeError):
    """The work is done by another version of the package than the one that planned it."""


@dataclass(frozen=True)
class Block:
    """
    Rigs that one worker runs in a row.

    Attributes
    ----------
    version : str
        Version of the package that planned it.
    parameters, initial : RigParameters, InitialConditions
        The rig, but for what is varied.
    settling : Settling
        How it is watched.
    control : GapControlParameters
        The gap control, but for what is varied.
    points : tuple of (int, Settings)
        Rows, and what takes which value there.
    followed : bool
        Whether each rig starts from the last state of the one before.
    state : dict or None
        The last state of the rig before the first one, if there was one.
    seconds : float
        After this time no further rig is begun.
    """

    version: str
    parameters: RigParameters
    initial: InitialConditions
    settling: Settling
    control: GapControlParameters
    points: tuple[tuple[int, Settings], ...]
    followed: bool
    state: Snapshot | None
    seconds: float


class Done(NamedTuple):
    """
    One rig that has been run.

    Attributes
    ----------
    point : int
        Its row.
    row : Row
        What it does.
    state : dict or None
        The state from which the next rig starts, if that is followed.
    """

    point: int
    row: Row
    state: Snapshot | None


def _continued(state: Snapshot, parameters: RigParameters) -> LongRun:
    """Return a rig that takes over the state of another one; its time begins anew."""
    run = LongRun.restore(state)
    run.change(parameters)
    snapshot = run.snapshot()
    origin = dict(snapshot['origin'])
    # A flight begins at the change, since the rig is another one
    origin['time'] -= snapshot['time']
    return LongRun.restore({**snapshot, 'time': 0.0, 'origin': origin})


def _controlled(
    parameters: RigParameters,
    initial: InitialConditions,
    control: GapControlParameters,
    state: Snapshot | None,
) -> ControlledRun:
    """Return a rig under control; one that takes over a state goes on in its time."""
    if state is None:
        return ControlledRun(parameters, initial, control)
    run = ControlledRun.restore(state)
    run.change(parameters, control)
    return run


def rig_row(
    parameters: RigParameters,
    initial: InitialConditions,
    settings: Sequence[tuple[Target, float]],
    settling: Settling,
    state: Snapshot | None = None,
    control: GapControlParameters | None = None,
) -> tuple[Row, Snapshot | None]:
    """Run one rig of a sweep."""
    try:
        rig, begun = varied(parameters, initial, settings)
        run: LongRun | ControlledRun
        if control is not None and control.active:
            run = _controlled(rig, begun, varied_control(control, settings), state)
        else:
            run = LongRun(rig, begun) if state is None else _continued(state, rig)
        row, last = row_of(steady_state(run, settling), rig), run.snapshot()
        if isinstance(run, ControlledRun):
            # The section does not tell what the control knows
            row['state'] = json.dumps(last, separators=(',', ':'))
        return row, last
    except (ParameterError, EndlessEventsError) as error:
        return failed_row(str(error)), None
    except (ArithmeticError, ValueError, RuntimeError, AssertionError) as error:
        # One rig that meets a fault must not be the end of all the others
        return failed_row(f'{type(error).__name__}: {error}'), None


def run_block(block: Block) -> list[Done]:
    """Run rigs until all are done or the time is up; at least one."""
    if block.version != impact_damper_ros.__version__:
        raise WrongVersionError(
            f'a worker has version {impact_damper_ros.__version__} of impact_damper_ros, the '
            f'sweep is of version {block.version}: install the same version everywhere'
        )
    until = time.monotonic() + block.seconds
    done: list[Done] = []
    state = block.state
    for point, settings in block.points:
        row, last = rig_row(
            *(block.parameters, block.initial, settings, block.settling, state, block.control)
        )
        if block.followed and last is not None:
            state = last
        done.append(Done(point, row, state if block.followed else None))
        if time.monotonic() >= until:
            break
    return done


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
