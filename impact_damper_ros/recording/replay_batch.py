"""
Many recorded joint states and impacts replayed at once, where nothing is done to the rig.

Only whether all of them come out bit for bit is found out here; what differs, and where, is left
to `replay`, which goes through them one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import Event, EventKind, Sample, Simulator
from impact_damper_ros.rig.long_run import Events, LongRun, Outcome
from impact_damper_ros.rig.published import IMPACT_JOINTS, JOINTS, impact_numbers, state_numbers
from impact_damper_ros.rig.snapshot import Snapshot

from .joint_state_columns import JointStateColumns

__all__ = ['BatchReplay', 'Recorded']

_Ints = NDArray[np.int64]


class Recorded(NamedTuple):
    """Serialised messages of one topic, and the stamp of each, ns."""

    stamps_ns: list[int]
    contents: list[bytes]


class BatchReplay:
    """
    Replays batches of messages.

    Parameters
    ----------
    version : int
        Format of the messages, see `rig.published.FORMAT`.
    compiled : bool
        Whether to run compiled code, which takes some seconds to load or longer to compile.
    """

    def __init__(self, version: int, *, compiled: bool) -> None:
        self._version = version
        self._compiled = compiled
        self._states = JointStateColumns(JOINTS, (4, 4, 0))
        self._impacts = JointStateColumns(IMPACT_JOINTS, (2, 2, 2))

    def reproduces(
        self, state: Snapshot, offset_ns: int, states: Recorded, impacts: Recorded | None
    ) -> Simulator | None:
        """
        Run a rig through recorded joint states.

        Parameters
        ----------
        state : Snapshot
            The rig before them.
        offset_ns : int
            Stamp of rig time 0.
        states : Recorded
            The joint states, in the order of time.
        impacts : Recorded or None
            All impacts up to the last of them; None if impacts are not recorded.

        Returns
        -------
        Simulator or None
            The rig at the last joint state; None if anything differs, or cannot be read.
        """
        stamps_ns = np.array(states.stamps_ns, dtype=np.int64)
        instants = (stamps_ns - offset_ns) / 1e9
        if not (np.diff(stamps_ns) > 0).all() or instants[0] <= state.time:
            return None
        run = LongRun.restore(state.as_dict(), compiled=self._compiled)
        stretch = run.advance(float(instants[-1]), instants)
        rest = state.parameters.static_deflection
        if stretch.outcome is not Outcome.COMPLETE:
            return None
        columns: list[Any] = [stretch.samples[name] for name in Sample._fields]
        parts = state_numbers(Sample(*columns), rest, self._version)
        numbers = np.column_stack([column for part in parts for column in part])
        if not _all_equal(self._states, states, ('',), stamps_ns, numbers):
            return None
        if impacts is not None and not self._hit(stretch.impacts(), impacts, offset_ns, rest):
            return None
        return run.simulator()

    def _hit(self, rows: Events, impacts: Recorded, offset_ns: int, rest: float) -> bool:
        """Return whether the impacts are those recorded."""
        events = [_event(row) for row in rows]
        if len(events) != len(impacts.contents):
            return False
        if not events:
            return True
        stamps_ns = np.array([offset_ns + round(e.time * 1e9) for e in events], dtype=np.int64)
        if stamps_ns.tolist() != impacts.stamps_ns:
            return False
        numbers = np.array(
            [sum(impact_numbers(event, rest, self._version), ()) for event in events]
        )
        frames = tuple(f'stop_{event.stop}' for event in events)
        return _all_equal(self._impacts, impacts, frames, stamps_ns, numbers)


def _event(row: np.void) -> Event:
    values = row.item()
    return Event(values[0], EventKind(values[8]), values[9], *values[1:8])


def _all_equal(
    columns: JointStateColumns,
    recorded: Recorded,
    frames: Sequence[str],
    stamps_ns: _Ints,
    numbers: NDArray[np.float64],
) -> bool:
    """Return whether messages hold these frames, one or one each, stamps and numbers."""
    table = columns.read(recorded.contents)
    if table.unreadable or not np.array_equal(table.stamps_ns, stamps_ns):
        return False
    found = [columns.frames[number] for number in table.frames]
    if found != list(frames) * (len(found) // len(frames)):
        return False
    # As integers, in which 0.0 and -0.0 differ
    return np.array_equal(table.numbers.view(np.int64), numbers.view(np.int64))
