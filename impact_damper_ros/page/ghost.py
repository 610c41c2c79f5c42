"""The what-if beside a recording: another rig on the same history, from a process of its own."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import impact_damper_ros

from .motion import SAMPLE_COLUMNS, Motion, Rows
from .recorded import MOST_SAMPLES

__all__ = ['Ghost']


_PROCESS = 'impact_damper_ros.page.what_if_process'
_LONGEST_LINE = 8 * 1024 * 1024


class Ghost:
    """
    Another rig.

    Parameters
    ----------
    path : Path
        The recording.
    values : mapping
        The parameters that are held.
    tell : callable
        Takes the messages for the page.
    """

    def __init__(
        self, path: Path, values: Mapping[str, Any], tell: Callable[[dict[str, Any]], None]
    ) -> None:
        self.motion = Motion(MOST_SAMPLES, 1)
        self._values = dict(values)
        self._tell = tell
        self._process: asyncio.subprocess.Process | None = None
        self._task = asyncio.ensure_future(self._run(path))

    def state(self, time: float) -> Rows | None:
        """Return where it is at an instant; None where it is not known (yet)."""
        samples = self.motion.samples
        if not len(samples) or not samples[0, 0] <= time <= samples[-1, 0] + 0.1:
            return None
        place = int(np.searchsorted(samples[:, 0], time, side='right')) - 1
        row: Rows = samples[place, 1:]
        return row

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

    async def _run(self, path: Path) -> None:
        root = str(Path(impact_damper_ros.__file__).parents[1])
        search = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
        process = self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, '-m', _PROCESS),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': search},
            limit=_LONGEST_LINE,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        request = json.dumps({'path': str(path), 'values': self._values})
        process.stdin.write(f'{request}\n'.encode())
        self._say('computing')
        try:
            while line := await process.stdout.readline():
                if line.startswith(b'{'):
                    end = json.loads(line)
                    self._say(str(end['text']), on=bool(end['ok']), done=True)
                else:
                    rows = np.frombuffer(base64.b64decode(line))
                    self._take(rows.reshape(-1, len(SAMPLE_COLUMNS)))
                    self._say('computing')
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    def _take(self, rows: Rows) -> None:
        end = self.motion.end
        self.motion.add_samples(rows[rows[:, 0] > (-math.inf if math.isnan(end) else end)])

    def close(self) -> None:
        """End the process."""
        self._task.cancel()
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
