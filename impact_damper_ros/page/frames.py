"""
Display frames: the new part of a motion, decimated to the resolution of a screen.

The layout is little endian: a header of 36 bytes (kind, flags, counts of columns, impacts and
samples, of a ghost's columns and samples; end, start of the columns, wall time), then float32: the
state of the rig now, that of the ghost if it is known, columns, impacts and samples, and those
columns and samples of the ghost. Instants count from the end of the frame.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from .measures import state_at
from .motion import MotionHistory, Rows

PAUSED, GHOST, REPLACE, REPLACE_GHOST = 1, 2, 4, 8
_HEADER = struct.Struct('<BBHHHHHddd')
_KIND = 1
_COLUMNS_WIDTH, _IMPACTS_WIDTH, _SAMPLES_WIDTH = 8, 8, 6
#: Longest window, s, and most columns in it.
MOST_WINDOW = 300.0
_LEAST_WINDOW = 0.05
_MOST_COLUMNS = 4096
_MOST_IMPACTS = 4096
#: Samples for the phase portrait in a frame, and at first.
_SAMPLES, _FIRST_SAMPLES = 64, 512
#: Time after its last sample for which the state of a ghost is still shown, s.
_GHOST_HELD = 0.1


class _Trace:
    """
    The part of a motion that a page has already.

    Parameters
    ----------
    column : float
        Length of a column, s.
    """

    def __init__(self, column: float) -> None:
        self._column = column
        # Number of the first column not yet taken
        self._next = 0
        #: The end of the last frame
        self.sent = math.nan

    def begin(self, start: float) -> None:
        """Start again with the first whole column."""
        self._next = math.floor(start / self._column) + 1
        self.sent = start

    def take(self, motion: MotionHistory, until: float, *, behind: bool) -> tuple[Rows, Rows]:
        """
        Return the columns and some samples that are new up to an instant.

        For a page that is `behind` these are the newest samples, otherwise evenly spaced ones.
        """
        # The last column is complete with the first sample after it.
        last = math.floor(until / self._column)
        columns = self._columns(motion, last, until)
        samples = motion.samples_between(self.sent, until)
        samples = samples[-_FIRST_SAMPLES:] if behind else _thinned(samples)
        self._next, self.sent = max(self._next, last), until
        return columns, samples[:, [0, 1, 2, 3, 4, 10]]

    def _columns(self, motion: MotionHistory, last: int, until: float) -> Rows:
        """Return the columns up to one, with the extremes of X and Z."""
        rows = motion.samples_between((self._next - 1) * self._column, until)
        numbers = np.floor(rows[:, 0] / self._column)
        new = (numbers >= self._next) & (numbers < last)
        rows, numbers = rows[new], numbers[new]
        if not len(rows):
            return np.empty((0, _COLUMNS_WIDTH))
        firsts = np.flatnonzero(np.diff(numbers, prepend=-math.inf))
        lasts = np.append(firsts[1:], len(rows)) - 1
        starts = numbers[firsts] * self._column
        x, z = rows[:, 1], rows[:, 3]
        return np.column_stack(
            [
                *(np.minimum.reduceat(x, firsts), np.maximum.reduceat(x, firsts)),
                *(np.minimum.reduceat(z, firsts), np.maximum.reduceat(z, firsts)),
                *(rows[lasts, 5] - x[lasts], rows[lasts, 7] - x[lasts]),
                *(starts, starts + self._column),
            ]
        )


class View:
    """
    The window that one page shows of a motion, and the part of it that the page has already.

    Parameters
    ----------
    window : float, optional
        Length of the traces, s.
    width : int, optional
        Columns in them: pixels.
    """

    def __init__(self, window: float = 30.0, width: int = 1000) -> None:
        self.window = min(max(window, _LEAST_WINDOW), MOST_WINDOW)
        column = self.window / min(max(width, 16), _MOST_COLUMNS)
        self._trace, self._ghost_trace = _Trace(column), _Trace(column)
        # The ghost of the last frame
        self._ghost: MotionHistory | None = None
        # The last impact sent: one may come after the sample that follows it.
        self._hit = math.nan

    def begin_again(self) -> None:
        """Let the next frame replace everything that the page has."""
        self._trace.sent = math.nan

    def wants(self, end: float, ghost: MotionHistory | None = None) -> bool:
        """Return whether a frame up to an instant would contain anything new."""
        if self._trace.sent != end or ghost is not self._ghost:
            return True
        # A ghost may be computed while the motion is paused.
        return ghost is not None and min(ghost.end, end) > self._ghost_trace.sent

    def frame(
        self,
        motion: MotionHistory,
        end: float,
        epoch: float,
        flags: int = 0,
        ghost: MotionHistory | None = None,
        state: Rows | None = None,
    ) -> bytes:
        """
        Return a frame with everything new up to an instant.

        Parameters
        ----------
        motion : MotionHistory
            The motion; it has a sample at or before that instant.
        end : float
            The instant, s.
        epoch : float
            Wall time of it, s.
        flags : int, optional
            `PAUSED`, if it is.
        ghost : MotionHistory, optional
            The motion of a second rig, as far as it is known.
        state : ndarray, optional
            State of this one, as in `SAMPLE_COLUMNS` without the time; the last sample, if it is
            not given.
        """
        start, before = end - self.window, self._trace.sent
        # Too far behind, or ahead after a jump back
        if not start <= before <= end:
            flags |= REPLACE
            self._hit = start
            self._trace.begin(start)
        elif ghost is not self._ghost:
            flags |= REPLACE_GHOST
        if flags & (REPLACE | REPLACE_GHOST):
            self._ghost = ghost
            self._ghost_trace.begin(start)
        columns, samples = self._trace.take(motion, end, behind=bool(flags & REPLACE))
        impacts = motion.impacts_between(self._hit, end)[-_MOST_IMPACTS:]
        if len(impacts):
            self._hit = float(impacts[-1, 0])
        if state is None:
            state = motion.samples_between(-math.inf, end)[-1, 1:]
        states = [state]
        ghost_columns, ghost_samples = np.empty((0, _COLUMNS_WIDTH)), np.empty((0, _SAMPLES_WIDTH))
        if ghost is not None and len(ghost.samples):
            if ghost.samples[0, 0] <= end <= ghost.end + _GHOST_HELD:
                flags |= GHOST
                states.append(state_at(ghost, end))
            trace = self._ghost_trace
            until = max(min(ghost.end, end), trace.sent)
            behind = bool(flags & (REPLACE | REPLACE_GHOST)) or not trace.sent >= before
            ghost_columns, ghost_samples = trace.take(ghost, until, behind=behind)
        begun = float(columns[0, 6]) if len(columns) else end
        counts = map(len, (columns, impacts, samples, ghost_columns, ghost_samples))
        head = _HEADER.pack(_KIND, flags, *counts, end, begun, epoch)
        parts = [
            *states,
            _since(columns, end, 6, 7),
            _since(impacts[:, :_IMPACTS_WIDTH], end, 0),
            _since(samples, end, 0),
            _since(ghost_columns, end, 6, 7),
            _since(ghost_samples, end, 0),
        ]
        return head + b''.join(part.astype('<f4').tobytes() for part in parts)


def _since(rows: Rows, end: float, *columns: int) -> Rows:
    """Return rows with the instants in some columns counted from the end of the frame."""
    rows = rows.copy()
    rows[:, columns] -= end
    return rows


def _thinned(samples: Rows) -> Rows:
    """Return evenly spaced samples, as many as a frame may have."""
    step = -(-len(samples) // _SAMPLES) or 1
    return samples[::-step][::-1]
