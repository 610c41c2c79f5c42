"""
Display frames: what is new of a motion, decimated to what a screen shows.

The layout is little endian: a header of 32 bytes (kind, flags, counts of columns, impacts and
samples; end, start of the columns, wall time), the state of the rig now, that of a ghost if there
is one, then columns, impacts and samples as float32. Instants count from the end of the frame.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from .motion import Motion, Rows

PAUSED, GHOST, REPLACE = 1, 2, 4
_HEADER = struct.Struct('<BBHHHddd')
_KIND = 1
_COLUMNS_WIDTH, _IMPACTS_WIDTH, _SAMPLES_WIDTH = 8, 8, 6
#: Longest window, s, and most columns in it.
MOST_WINDOW = 300.0
_LEAST_WINDOW = 0.05
_MOST_COLUMNS = 4096
_MOST_IMPACTS = 4096
#: Samples for the phase portrait in a frame, and at first.
_SAMPLES, _FIRST_SAMPLES = 64, 512


class View:
    """
    What one page shows of a motion, and how much of it the page has already.

    Parameters
    ----------
    window : float, optional
        Length of the traces, s.
    width : int, optional
        Columns in them: pixels.
    """

    def __init__(self, window: float = 30.0, width: int = 1000) -> None:
        self.window = min(max(window, _LEAST_WINDOW), MOST_WINDOW)
        self._column = self.window / min(max(width, 16), _MOST_COLUMNS)
        # Number of the first column not yet sent, and the end of the last frame
        self._next = 0
        self._sent = math.nan
        # The last impact sent: one may come after the sample that follows it.
        self._hit = math.nan

    def begin_again(self) -> None:
        """Let the next frame replace all that the page has."""
        self._sent = math.nan

    def wants(self, end: float) -> bool:
        """Return whether a frame up to an instant has anything new."""
        return self._sent != end

    def frame(
        self,
        motion: Motion,
        end: float,
        epoch: float,
        flags: int = 0,
        ghost: Rows | None = None,
        state: Rows | None = None,
    ) -> bytes:
        """
        Return what the page lacks up to an instant.

        Parameters
        ----------
        motion : Motion
            The motion; it has a sample at or before that instant.
        end : float
            The instant, s.
        epoch : float
            Wall time of it, s.
        flags : int, optional
            `PAUSED`, if it is.
        ghost : ndarray, optional
            State of another rig, as in `SAMPLE_COLUMNS` without the time.
        state : ndarray, optional
            That of this one; the last sample, if it is not given.
        """
        start = end - self.window
        # Too far behind, or ahead after a jump back
        if not start <= self._sent <= end:
            flags |= REPLACE
            self._next = math.floor(start / self._column) + 1
            self._sent = self._hit = start
        if ghost is not None:
            flags |= GHOST
        # The last column is complete with the first sample after it.
        last = math.floor(end / self._column)
        columns, begun = self._columns(motion, last, end)
        impacts = motion.impacts_between(self._hit, end)[-_MOST_IMPACTS:]
        if len(impacts):
            self._hit = float(impacts[-1, 0])
        samples = motion.samples_between(self._sent, end)
        samples = samples[-_FIRST_SAMPLES:] if flags & REPLACE else _thinned(samples)
        self._next, self._sent = max(self._next, last), end
        if state is None:
            state = motion.samples_between(-math.inf, end)[-1, 1:]
        head = _HEADER.pack(
            *(_KIND, flags, len(columns), len(impacts), len(samples)),
            *(end, begun, epoch),
        )
        parts = [state]
        if ghost is not None:
            parts.append(ghost)
        parts += [columns, _impacts(impacts, end), _samples(samples, end)]
        return head + b''.join(part.astype('<f4').tobytes() for part in parts)

    def _columns(self, motion: Motion, last: int, end: float) -> tuple[Rows, float]:
        """Return the columns up to one, with the extremes of X and Z, and where they begin."""
        rows = motion.samples_between((self._next - 1) * self._column, end)
        numbers = np.floor(rows[:, 0] / self._column)
        new = (numbers >= self._next) & (numbers < last)
        rows, numbers = rows[new], numbers[new]
        if not len(rows):
            return np.empty((0, _COLUMNS_WIDTH)), end
        firsts = np.flatnonzero(np.diff(numbers, prepend=-math.inf))
        lasts = np.append(firsts[1:], len(rows)) - 1
        starts = numbers[firsts] * self._column
        x, z = rows[:, 1], rows[:, 3]
        columns = np.column_stack(
            [
                *(np.minimum.reduceat(x, firsts), np.maximum.reduceat(x, firsts)),
                *(np.minimum.reduceat(z, firsts), np.maximum.reduceat(z, firsts)),
                *(rows[lasts, 5] - x[lasts], rows[lasts, 7] - x[lasts]),
                *(starts - end, starts + self._column - end),
            ]
        )
        return columns, float(starts[0])


def _thinned(samples: Rows) -> Rows:
    """Return samples, evenly thinned out to as many as a frame may have."""
    step = -(-len(samples) // _SAMPLES) or 1
    return samples[::-step][::-1]


def _impacts(rows: Rows, end: float) -> Rows:
    places = rows[:, [0, 1, 2, 3, 4, 5, 6, 7]].reshape(-1, _IMPACTS_WIDTH)
    places[:, 0] -= end
    return places


def _samples(rows: Rows, end: float) -> Rows:
    places = rows[:, [0, 1, 2, 3, 4, 10]].reshape(-1, _SAMPLES_WIDTH)
    places[:, 0] -= end
    return places
