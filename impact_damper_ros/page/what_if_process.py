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
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay import RecordedRun, Replay, Setting, WhatIf
from impact_damper_ros.replay.rows import Events, Samples, impacts_of
from impact_damper_ros.rig import INITIAL_SPECS, RigParameters, RunawayError

_NICENESS = 10


def _write(line: str) -> None:
    sys.stdout.write(f'{line}\n')
    sys.stdout.flush()


def _write_rows(kind: str, rows: NDArray[np.float64]) -> None:
    if len(rows):
        _write(kind + base64.b64encode(np.ascontiguousarray(rows).tobytes()).decode())


def _impacts(events: Events) -> NDArray[np.float64]:
    """Return impacts as `motion.IMPACT_COLUMNS`, without the phase."""
    hits = impacts_of(events)
    names = (
        *('time', 'stop', 'x', 'primary_velocity_after', 'damper_velocity_after', 'impulse'),
        *('', 'y', 'primary_velocity_before', 'damper_velocity_before'),
    )
    nothing = np.full(len(hits), np.nan)
    return np.column_stack([hits[name] if name else nothing for name in names])


def _samples(samples: Samples, rig: RigParameters) -> NDArray[np.float64]:
    """Return samples as `motion.SAMPLE_COLUMNS`, without the phase."""
    names = (
        *('time', 'x', 'primary_velocity', 'z', 'damper_velocity'),
        *('stop_1', 'stop_1_velocity', 'stop_2', 'stop_2_velocity'),
    )
    rows = np.column_stack([samples[name] for name in names])
    if rig.one_sided:
        rows[:, -2:] = np.nan
    angle, phase = np.full(len(rows), rig.angle), np.full(len(rows), np.nan)
    return np.column_stack([rows, angle, phase])


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
        rig = other.rig.parameters
        samples, events = other.follow(part)
        # The impacts before a sample must arrive before it.
        _write_rows('I', _impacts(events))
        _write_rows('S', _samples(samples, rig))
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
