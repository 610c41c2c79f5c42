"""Joint states and impacts of a bag, collected and put in the order of rig time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.recording.joint_state_columns import JointStateColumns

__all__ = ['BagRows', 'Rows']

#: Rig times in ns, stops (0 for joint states) and numbers of messages.
Rows = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


class BagRows:
    """
    The messages of one topic.

    Parameters
    ----------
    columns : JointStateColumns
        Reads them.

    Attributes
    ----------
    unreadable : list of str
        Why some could not be read; the first ones.
    unreadable_count, not_numbers, misplaced : int
        Messages that could not be read; that hold something that is no finite number; that came
        after a later one had been handed on, or twice.
    """

    def __init__(self, columns: JointStateColumns) -> None:
        self.unreadable: list[str] = []
        self.unreadable_count = self.not_numbers = self.misplaced = 0
        self._columns = columns
        self._contents: list[bytes] = []
        self._offset_ns = 0
        self._time = np.empty(0, dtype=np.int64)
        self._stop = np.empty(0)
        self._numbers = np.empty((0, 0))
        self._taken_ns: int | None = None

    @property
    def unread(self) -> int:
        """Number of messages that wait to be read."""
        return len(self._contents)

    def put(self, content: bytes, offset_ns: int) -> None:
        """Take a message; rig time is its stamp less the offset."""
        if offset_ns != self._offset_ns:
            self.read()
            self._offset_ns = offset_ns
        self._contents.append(content)

    def read(self) -> None:
        """Read the messages that wait."""
        contents, self._contents = self._contents, []
        if not contents:
            return
        table = self._columns.read(contents)
        self.unreadable_count += len(table.unreadable)
        self.unreadable += [reason for _, reason in table.unreadable[: 3 - len(self.unreadable)]]
        finite = np.isfinite(table.numbers).all(axis=1)
        self.not_numbers += int((~finite).sum())
        stops = np.array([_stop_of(frame) for frame in self._columns.frames] or [0.0])
        time = table.stamps_ns[finite] - self._offset_ns
        stop = stops[table.frames[finite]]
        numbers = table.numbers[finite]
        if len(self._time):
            time = np.concatenate([self._time, time])
            stop = np.concatenate([self._stop, stop])
            numbers = np.concatenate([self._numbers, numbers])
        order = np.argsort(time, kind='stable')
        time, stop, numbers = time[order], stop[order], numbers[order]
        keep = np.ones(len(time), dtype=np.bool_)
        # Chatters may have several impacts in a nanosecond, but never the same one twice.
        same = time[1:] == time[:-1]
        impacts = bool(stops.any())
        if impacts:
            same &= (numbers[1:] == numbers[:-1]).all(axis=1)
        keep[1:] &= ~same
        if self._taken_ns is not None:
            keep &= time >= self._taken_ns + (not impacts)
        self.misplaced += int((~keep).sum())
        self._time, self._stop, self._numbers = time[keep], stop[keep], numbers[keep]

    def take(self, until_ns: int | None) -> Rows:
        """Hand out the rows read up to an instant, inclusive; all of them if it is None."""
        count = len(self._time)
        if until_ns is not None:
            count = int(np.searchsorted(self._time, until_ns, side='right'))
        rows = self._time[:count], self._stop[:count], self._numbers[:count]
        self._time, self._stop = self._time[count:], self._stop[count:]
        self._numbers = self._numbers[count:]
        if count:
            self._taken_ns = int(rows[0][-1])
        return rows

    def drop(self, instant_ns: int) -> None:
        """Leave out a row of an instant: it may be from before or after what happened there."""
        kept = self._time != instant_ns
        self._time, self._stop = self._time[kept], self._stop[kept]
        self._numbers = self._numbers[kept]

    def faults(self) -> list[str]:
        """Return what was wrong with the messages."""
        found = []
        if self.unreadable_count:
            first = self.unreadable[0]
            found.append(f'that cannot be read: {self.unreadable_count} (the first: {first})')
        if self.not_numbers:
            found.append(f'with NaN or infinite numbers, left out: {self.not_numbers}')
        if self.misplaced:
            found.append(f'with stamps from before others, or twice, left out: {self.misplaced}')
        return found


def _stop_of(frame: str) -> float:
    """Return the stop that the frame of an impact names; 0 for joint states."""
    return {'stop_1': 1.0, 'stop_2': 2.0}.get(frame, 0.0)
