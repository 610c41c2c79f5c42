# SPDX-License-Identifier: Apache-2.0
"""
Display frames: the part of a motion since the last frame of a page.

The layout is little endian: a header of 32 bytes (kind, flags, the number of rows of each of the
`TABLES`; end, wall time), then these rows as float32. Instants count from the end of the frame.
The samples go on to the first one after the end, if there is one: the page draws the rig between
the two.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from .motion import (
    ACT_COLUMNS,
    IMPACT_COLUMNS,
    MEASURED_COLUMNS,
    SAMPLE_COLUMNS,
    MotionHistory,
    Rows,
    between,
)

PAUSED, REPLACE, REPLACE_GHOST = 1, 2, 4
HEADER = struct.Struct('<BB6Hxxdd')
_KIND = 3
#: Tables of a frame, in their order, with their columns; the last two are those of a what-if.
TABLES = {
    'samples': SAMPLE_COLUMNS,
    'impacts': IMPACT_COLUMNS,
    'measured': MEASURED_COLUMNS,
    'acts': ACT_COLUMNS,
    'ghost_samples': SAMPLE_COLUMNS,
    'ghost_impacts': IMPACT_COLUMNS,
}
#: Layout of a frame for pages: place of the counts of rows, and places of the two instants, as
#: numbers of 2 and 8 bytes.
LAYOUT = {
    'kind': _KIND,
    'header': HEADER.size,
    'counts': 2,
    'instants': HEADER.size - 16,
    'flags': {'paused': PAUSED, 'replace': REPLACE, 'replace_ghost': REPLACE_GHOST},
    'tables': TABLES,
}
#: Lengths of a window, s.
_WINDOWS = 0.05, 300.0
#: Most rows of a kind in a frame.
_MOST = 60_000


class _Sent:
    """The part of a motion that a page has already."""

    def __init__(self) -> None:
        self.begin(math.nan)

    def begin(self, start: float) -> None:
        """Start again."""
        self._sample, self._others = start, [start, start, start]

    def take(self, motion: MotionHistory, end: float) -> list[Rows]:
        """Return the samples, impacts, measurements and acts that are new up to an instant."""
        times = motion.samples[:, 0]
        first = int(np.searchsorted(times, self._sample, side='right'))
        samples = motion.samples[first : int(np.searchsorted(times, end, side='right')) + 1]
        if len(samples):
            self._sample = float(samples[-1, 0])
        parts = [samples[-_MOST:]]
        for n, rows in enumerate((motion.impacts, motion.measured, motion.acts)):
            # Impacts may come after the sample that follows them.
            new = between(rows, self._others[n], max(self._sample, end)) if len(rows) else rows
            if len(new):
                self._others[n] = float(new[-1, 0])
            parts.append(new[-_MOST:])
        return parts


class PageView:
    """
    The part of a motion that one page shows, and the part that it has already.

    `window` is the length of the shown part, s.
    """

    def __init__(self, window: float = 30.0) -> None:
        self.window = min(max(window, _WINDOWS[0]), _WINDOWS[1])
        self._own, self._others = _Sent(), _Sent()
        self._ghost: MotionHistory | None = None
        # End and flags of the last frame, and number of corrected samples by then
        self._last = math.nan, 0
        self._corrections = 0

    def begin_again(self) -> None:
        """Let the next frame replace everything that the page has."""
        self._last = math.nan, 0

    def frame(
        self,
        motion: MotionHistory,
        end: float,
        epoch: float,
        flags: int = 0,
        ghost: MotionHistory | None = None,
    ) -> bytes | None:
        """
        Return a frame with everything new up to an instant; None if there is nothing new.

        `epoch` is the wall time of the instant, `ghost` a second rig, as far as it is known.
        """
        last = end, flags
        start = end - self.window
        # The page is too far behind, or ahead after a jump back, or has a sample that was
        # corrected.
        behind = not start <= self._last[0] <= end
        if behind or motion.corrections != self._corrections:
            self._corrections = motion.corrections
            flags |= REPLACE
            self._own.begin(start)
        if flags & REPLACE or ghost is not self._ghost:
            flags |= REPLACE_GHOST
            self._others.begin(start)
        parts = self._own.take(motion, end)
        parts += self._others.take(ghost, end)[:2] if ghost is not None else [np.empty((0, 0))] * 2
        if self._last == last and not flags & REPLACE_GHOST and not any(map(len, parts)):
            return None
        self._last, self._ghost = last, ghost
        content = [HEADER.pack(_KIND, flags, *map(len, parts), end, epoch)]
        for rows in parts:
            rows = rows.copy()
            rows[:, :1] -= end
            content.append(rows.astype('<f4').tobytes())
        return b''.join(content)
