"""
The process that runs another rig on the history of a recorded one.

It reads one request from its standard input, a JSON object with the path of the bag and the values
that are held. It writes the motion as it is computed: lines of base64, each some rows of float64,
with ``I`` before impacts and ``S`` before samples. The last line is a JSON object with the result.
"""

from __future__ import annotations

import base64
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay.recorded_run import RecordedRun
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.replayed_rig import setting_of
from impact_damper_ros.replay.what_if import WhatIf
from impact_damper_ros.rig import INITIAL_SPECS, Event, EventKind, RunawayError

_NICENESS = 10
_PERIOD_S = 0.2


def _write(line: str) -> None:
    sys.stdout.write(f'{line}\n')
    sys.stdout.flush()


class _Rows:
    """Buffer of rows, written at intervals."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[float, ...]]] = {'I': [], 'S': []}
        self._due = time.monotonic() + _PERIOD_S

    def add(self, events: list[Event], sample: tuple[float, ...]) -> None:
        """Add a sample, and the events before it."""
        self._waiting['I'] += [_impact(e) for e in events if e.kind is EventKind.IMPACT]
        self._waiting['S'].append(sample)
        if time.monotonic() > self._due:
            self.write()

    def write(self) -> None:
        # The impacts before a sample must arrive before it.
        for kind, rows in self._waiting.items():
            if rows:
                _write(kind + base64.b64encode(np.array(rows).tobytes()).decode())
                rows.clear()
        self._due = time.monotonic() + _PERIOD_S


def _impact(event: Event) -> tuple[float, ...]:
    """Return an impact as `motion.IMPACT_COLUMNS`, without the phase."""
    return (
        *(event.time, event.stop, event.x, event.primary_velocity_after),
        *(event.damper_velocity_after, event.impulse, float('nan'), event.y),
        *(event.primary_velocity_before, event.damper_velocity_before),
    )


def _run(path: Path, values: dict[str, Any]) -> str:
    """Run the rig; return a text on how it started."""
    replay = Replay(RecordedRun(path), adopt=True)
    known = setting_of(replay.recorded.start.state).as_dict()
    strange = [name for name in values if name not in known and name not in INITIAL_SPECS]
    if strange:
        raise ValueError(f'{strange[0][:80]} is not a parameter of the rig or of its control')
    held = {name: value for name, value in values.items() if name in known}
    held_initial = {name: value for name, value in values.items() if name in INITIAL_SPECS}
    rows = _Rows()
    other: WhatIf | None = None
    try:
        for tick in replay.ticks():
            if other is None:
                initial = replay.replayed.first_initial
                other = WhatIf(replay.recorded.start, initial, held, held_initial)
            sample, events = other.follow(tick)
            x, x_velocity, z, z_velocity, stop_1, stop_2, velocity_1, velocity_2 = sample[1:]
            rig = other.rig.parameters
            if rig.one_sided:
                stop_2 = velocity_2 = float('nan')
            rows.add(
                events,
                (
                    *(tick.time_ns / 1e9, x, x_velocity, z, z_velocity),
                    *(stop_1, velocity_1, stop_2, velocity_2, rig.angle, float('nan')),
                ),
            )
    finally:
        rows.write()
    if other is None:
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
