"""
The what-if beside a recording: another rig with the same history, from a child process.

The process reads one request from its standard input, a JSON object with the path of the bag and
the values that are held. It writes the motion as it is computed: lines of base64, each some rows
of float64, with ``I`` before impacts and ``S`` before samples. The last line is a JSON object with
the result.
"""

from __future__ import annotations

import base64
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay import RecordedRun, Replay, Setting, WhatIf
from impact_damper_ros.rig import INITIAL_SPECS, RunawayError

from .child import Child
from .motion import IMPACT_COLUMNS, SAMPLE_COLUMNS, Era, Motion, Rows

_MOST_SAMPLES, _MOST_IMPACTS = 2_000_000, 1_000_000
_NICENESS = 10


class WhatIfMotion:
    """
    The motion of the other rig, as far as it has been computed.

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
        self.motion = Motion(_MOST_SAMPLES, _MOST_IMPACTS)
        self._values = dict(values)
        self._tell = tell
        self._done = False
        self._child = Child((sys.executable, '-m', __name__), self._take, self._end)
        self._child.send({'path': str(path), 'values': self._values})
        self._say('computing')

    def _say(self, text: str, *, on: bool = True, done: bool = False) -> None:
        samples = self.motion.samples
        until = float(samples[-1, 0]) if len(samples) else None
        message = {'on': on, 'until': until, 'done': done, 'text': text, 'values': self._values}
        self._tell({'type': 'what_if', **message})

    def _take(self, line: bytes) -> None:
        if line.startswith(b'{'):
            end = json.loads(line)
            self._done = True
            self._say(end['text'], on=end['ok'], done=True)
            return
        numbers = np.frombuffer(base64.b64decode(line[1:]))
        if line.startswith(b'I'):
            self.motion.add_impacts(numbers.reshape(-1, len(IMPACT_COLUMNS)))
        else:
            self.motion.add_samples(numbers.reshape(-1, len(SAMPLE_COLUMNS)))
            self._say('computing')

    def _end(self) -> None:
        if not self._done:
            self._say('the process of the what-if ended early: try it again', on=False, done=True)

    async def close(self) -> None:
        """End the process."""
        await self._child.close()


def _write(line: str) -> None:
    sys.stdout.write(f'{line}\n')
    sys.stdout.flush()


def _write_rows(kind: str, rows: Rows) -> None:
    if len(rows):
        _write(kind + base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode())


def _run(path: Path, values: dict[str, Any]) -> str:
    """Run the rig; return a text on how it started."""
    replay = Replay(RecordedRun(path))
    known = Setting.of(replay.start.state).as_dict()
    strange = [name for name in values if name not in known and name not in INITIAL_SPECS]
    if strange:
        raise ValueError(f'{strange[0][:80]} is not a parameter of the rig or of its control')
    held = {name: value for name, value in values.items() if name in known}
    held_initial = {name: value for name, value in values.items() if name in INITIAL_SPECS}
    other = WhatIf(replay.start, held, held_initial)
    found = 0
    for part in replay:
        # The rows of a part are of the rig before the command at its end.
        era = Era(0, 0, other.rig.parameters, None)
        samples, events = other.follow(part)
        # The impacts before a sample must arrive before it.
        _write_rows('I', era.impact_rows(events))
        _write_rows('S', era.sample_rows(samples))
        found += len(samples)
    if not found:
        return 'the recording holds no motion'
    start = 'its initial conditions' if other.from_initial else 'the recorded state'
    return f'computed from {start}'


def main() -> None:
    """Process the request."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICENESS)
    request = json.loads(sys.stdin.readline())
    try:
        text, ok = _run(Path(request['path']), dict(request['values'])), True
    except (RecordingError, RunawayError, ArithmeticError, ValueError, TypeError) as error:
        text, ok = str(error), False
    _write(json.dumps({'ok': ok, 'text': text}))


if __name__ == '__main__':
    main()
