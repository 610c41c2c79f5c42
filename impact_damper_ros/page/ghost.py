"""The what-if beside a recording: a second rig with the same history, from a child process."""

from __future__ import annotations

import base64
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .child import Child
from .motion import IMPACT_COLUMNS, SAMPLE_COLUMNS, MotionHistory
from .recorded import MOST_IMPACTS, MOST_SAMPLES

_PROCESS = 'impact_damper_ros.page.what_if_process'


class Ghost:
    """
    A second rig.

    Parameters
    ----------
    path : Path
        The recording.
    values : mapping
        The parameters that are held.
    tell : callable
        Called with each message for the page.
    """

    def __init__(
        self, path: Path, values: Mapping[str, Any], tell: Callable[[dict[str, Any]], None]
    ) -> None:
        self.motion = MotionHistory(MOST_SAMPLES, MOST_IMPACTS)
        self._values = dict(values)
        self._tell = tell
        self._done = False
        self._child = Child((sys.executable, '-m', _PROCESS), self._take, self._end)
        self._child.send({'path': str(path), 'values': self._values})
        self._say('computing')

    def _say(self, text: str, *, on: bool = True, done: bool = False) -> None:
        samples = self.motion.samples
        until = float(samples[-1, 0]) if len(samples) else None
        start = float(samples[0, 0]) if len(samples) else None
        self._tell(
            {
                'type': 'what_if',
                'on': on,
                't0': start,
                'until': until,
                'done': done,
                'text': text,
                'values': self._values,
            }
        )

    def _take(self, line: bytes) -> None:
        if line.startswith(b'{'):
            end = json.loads(line)
            self._done = True
            self._say(str(end['text']), on=bool(end['ok']), done=True)
            return
        numbers = np.frombuffer(base64.b64decode(line[1:]))
        if line.startswith(b'I'):
            self.motion.add_impacts(numbers.reshape(-1, len(IMPACT_COLUMNS)))
            return
        rows = numbers.reshape(-1, len(SAMPLE_COLUMNS))
        known = self.motion.end
        self.motion.add_samples(rows[rows[:, 0] > (-math.inf if math.isnan(known) else known)])
        self._say('computing')

    def _end(self) -> None:
        if not self._done:
            self._say('the process of the what-if ended early: try it again', on=False, done=True)

    async def close(self) -> None:
        """End the process."""
        await self._child.close()
