# SPDX-License-Identifier: Apache-2.0
"""
The what-if of a recording: another rig with the same history, computed in a thread.

The thread hands over impacts and samples as they are computed, and at last the totals.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS
from impact_damper_ros.replay import RecordedRun, Replay, Setting
from impact_damper_ros.replay.what_if import WhatIf
from impact_damper_ros.report.run_pair import RunPair
from impact_damper_ros.rig.runaway import RunawayError

from .motion import MOST_IMPACTS, MOST_SAMPLES, MotionHistory, Stretch


class WhatIfMotion:
    """
    The motion of the other rig, as far as it has been computed.

    `values` are the overridden parameters; `send` is called with each message for the page.
    """

    def __init__(
        self, path: Path, values: Mapping[str, Any], send: Callable[[dict[str, Any]], None]
    ) -> None:
        self.motion = MotionHistory(MOST_SAMPLES, MOST_IMPACTS)
        self._values = dict(values)
        self._send = send
        # The totals of both rigs, once they are known
        self._totals: dict[str, Any] = {}
        self._parts: SimpleQueue[tuple[str, Any]] = SimpleQueue()
        self._closed = False
        threading.Thread(target=self._compute, args=(path,), daemon=True).start()
        self._report('computing')

    def _compute(self, path: Path) -> None:
        for part in _compute_run(path, self._values):
            if self._closed:
                break
            self._parts.put(part)

    def _report(self, text: str, *, on: bool = True, done: bool = False) -> None:
        samples = self.motion.samples
        until = float(samples[-1, 0]) if len(samples) else None
        self._send(
            {
                'type': 'what_if',
                'on': on,
                'until': until,
                'done': done,
                'text': text,
                'values': self._values,
                'totals': self._totals,
            }
        )

    def tick(self) -> None:
        """Take the computed rows."""
        while not self._parts.empty():
            kind, content = self._parts.get()
            if kind == 'end':
                ok, text, self._totals = content
                self._report(text, on=ok, done=True)
            elif kind == 'impacts':
                self.motion.add_impacts(content)
            else:
                self.motion.add_samples(content)
                self._report('computing')

    def close(self) -> None:
        """End the computation."""
        self._closed = True


def _compute_run(path: Path, values: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Run the rig; yield impacts, samples, and at last its start and the totals of both rigs."""
    try:
        replay = Replay(RecordedRun(path))
        known = Setting.of(replay.start.state).as_dict()
        strange = [name for name in values if name not in known and name not in INITIAL_SPECS]
        if strange:
            raise ValueError(f'{strange[0][:80]} is not a parameter of the rig or of its control')
        held = {name: value for name, value in values.items() if name in known}
        held_initial = {name: value for name, value in values.items() if name in INITIAL_SPECS}
        other = WhatIf(replay.start, held, held_initial, compiled=replay.recorded.is_long)
        runs = RunPair(replay.start, other, values)
        found = 0
        for part in replay:
            # The rows of a part are of the rig before the command at its end.
            stretch = Stretch(0, 0, other.rig.parameters, None)
            followed = other.follow(part)
            runs.take(part, followed)
            # The impacts before a sample must arrive before it.
            yield 'impacts', stretch.impact_rows(followed.events)
            yield 'samples', stretch.sample_rows(followed.samples)
            found += len(followed.samples)
        runs.finish()
        text, totals = 'the recording holds no motion', {}
        if found:
            start = 'its initial conditions' if other.from_initial else 'the recorded state'
            text, totals = f'computed from {start}', runs.as_json()
            totals = {name: totals[name] for name in ('recorded', 'what_if')}
        yield 'end', (True, text, totals)
    except (RecordingError, RunawayError, ArithmeticError, ValueError, TypeError) as error:
        yield 'end', (False, str(error), {})
