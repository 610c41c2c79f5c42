# SPDX-License-Identifier: Apache-2.0
"""A recording as the source of one page: its motion and changes, its position and speed."""

from __future__ import annotations

import contextlib
import json
import math
import time
import zlib
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.messages import JOINT_STATE, JointStateRows
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay import Command, RecordedRun, Rows
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.theory.documents import answers

from .frames import PAUSED, PageView
from .knobs import as_json, knobs_of, read_values
from .motion import MOST_IMPACTS, MOST_SAMPLES, ForcePhase, MotionHistory, Stretch, measured_rows
from .numbers import numbers_of
from .presets import change_between, preset_with
from .requests import RequestError
from .source import Source
from .what_if import WhatIfMotion

#: Largest number of changes that are marked.
_MOST_CHANGES = 10_000
#: Stretches of a recording of which theory is kept.
_MOST_DOCUMENTS = 64
_SLOWEST, _FASTEST = 0.01, 100.0
_STATUS_PERIOD_S = 1.0
#: The jumps that correspond to services of a live rig.
_STEPS = {'step': 'sample', 'step_to_impact': 'impact'}
_KINDS = {'stretch': ('stretch', 'change', 'reset'), 'change': ('change',)}


class PlayedStretch(NamedTuple):
    """The rig from one change to the next."""

    state: dict[str, Any]  # state in its snapshot
    values: dict[str, Any]  # parameters of rig and control, and initial conditions

    @property
    def rig(self) -> RigParameters:
        """The rig."""
        return Snapshot.from_dict(self.state).parameters


@dataclass(frozen=True)
class Recording:
    """A recording."""

    motion: MotionHistory  # the whole motion
    #: Changes and resets: time, kind, new values, and the preset that the rig then matches
    changes: list[dict[str, Any]]
    remark: str  # missing parts in words; empty without any
    #: The rig after each change, packed: of thousands of them a few are shown.
    packed: list[bytes]
    times: NDArray[np.float64]

    @property
    def start(self) -> float:
        """Rig time of the first sample, s."""
        return float(self.motion.samples[0, 0])

    def number_at(self, time: float) -> int:
        """Return the number of the stretch at an instant."""
        return max(int(np.searchsorted(self.times, time, side='right')) - 1, 0)

    def stretch(self, number: int) -> PlayedStretch:
        """Return a stretch by its number."""
        return PlayedStretch(*json.loads(zlib.decompress(self.packed[number])))


def load_recording(path: Path) -> Recording:
    """Read a bag, whole, cut or recovered; ValueError if it has no motion, or RecordingError."""
    run = RecordedRun(path, purpose='play')
    # Surplus samples are dropped at the end.
    count = run.reader.topics[run.topics.joint_states, JOINT_STATE].message_count
    motion = MotionHistory(max(1, min(count, 2 * MOST_SAMPLES)), MOST_IMPACTS)
    changes: list[dict[str, Any]] = []
    packed: list[bytes] = []
    before: dict[str, Any] = {}
    remarks: list[str] = []
    stretch: Stretch | None = None
    offsets: list[tuple[int, int]] = []
    for item in run.walk():
        if isinstance(item, Rows):
            assert stretch is not None
            motion.add_samples(stretch.samples(item.states))
            motion.add_impacts(stretch.impacts(item.impacts))
            motion.add_acts(stretch.acts(item.acts))
        elif isinstance(item, Command):
            snapshot = Snapshot.from_dict(dict(item.state))
            rig = snapshot.parameters
            stretch = Stretch(item.time_ns, item.offset_ns, rig, ForcePhase(snapshot))
            offsets.append((item.stamp_ns, item.offset_ns))
            control = item.state['gap_control']['parameters']
            values = as_json({**rig.as_dict(), **control, **item.initial.as_dict()})
            kind = 'stretch' if not before else 'reset' if item.resets else 'change'
            change = change_between(before, values, item.time, kind)
            before = values
            if change is not None and len(changes) < _MOST_CHANGES:
                changes.append(change)
                packed.append(zlib.compress(json.dumps([item.state, values]).encode()))
            elif change is not None:
                remarks = [f'only the first {_MOST_CHANGES:,} changes are marked']
        if len(motion.samples) >= MOST_SAMPLES:
            remarks.append(f'only the first {MOST_SAMPLES:,} samples are shown')
            break
    if not len(motion.samples):
        raise ValueError(f'{path.name} holds no joint states of a rig')
    motion.add_measured(_measurements(run, offsets))
    if run.run_count > 1:
        remarks.append(f'the node was restarted: run 1 of {run.run_count} is shown')
    if not run.reader.complete:
        remarks.append('the recording was cut short')
    times = np.array([change['time'] for change in changes])
    return Recording(motion, changes, '; '.join(remarks), packed, times)


def _measurements(run: RecordedRun, offsets: list[tuple[int, int]]) -> NDArray[np.float64]:
    """Return the measurements, given the stamps from which on rig time 0 has each stamp."""
    topic = run.reader.custom.get('measurements') or f'{run.topics.namespace}measurements'
    contents: list[bytes] = []
    # The walk has reported the damage.
    with contextlib.suppress(RecordingError):
        wanted = [(topic, JOINT_STATE)]
        contents.extend(record.content for record in run.reader.messages(wanted))
    rows, readable = JointStateRows(AXIS_JOINTS, (4, 4, 0)).read(contents)
    stamps_ns, offsets_ns = np.array(offsets).T
    rows = rows[readable]
    place = np.searchsorted(stamps_ns, rows['stamp_ns'], side='right') - 1
    return measured_rows(rows, offsets_ns[np.clip(place, 0, None)])


#: One thread computes the theory of recordings.
_THEORY = ThreadPoolExecutor(1, 'theory')


@lru_cache(_MOST_DOCUMENTS)
def _document(packed: bytes) -> str:
    """Return the document of theory for a stretch, given its entry in `Recording.packed`."""
    state, _ = json.loads(zlib.decompress(packed))
    *_, (_, document) = answers(state, None, True)
    return document


class Player(Source):
    """A recording that is played to one page."""

    def __init__(
        self, name: str, path: Path, recorded: Recording, common: Callable[[], dict[str, Any]]
    ) -> None:
        super().__init__(common)
        self._name = name
        self._path = path
        self.recorded = recorded
        self._start, self._end = recorded.start, recorded.motion.end
        self._speed = 1.0
        # Rig time at an instant of the clock
        self._from, self._since = self._start, time.monotonic()
        self._playing = True
        self._ghost: WhatIfMotion | None = None
        self._status_at = -math.inf
        # The theory of the present stretch, until it is shown
        self._asked: Future[str] | None = None
        self._enter(recorded.number_at(self._start))

    def _enter(self, number: int) -> None:
        self._number, self._stretch = number, self.recorded.stretch(number)
        self._rig = self._stretch.rig
        if self._asked is not None:
            self._asked.cancel()
        self._asked = _THEORY.submit(_document, self.recorded.packed[number])
        # The theory of another stretch does not apply.
        self.send_theory({})

    async def close(self) -> None:
        """End the tasks that were started."""
        if self._asked is not None:
            self._asked.cancel()
        if self._ghost is not None:
            self._ghost.close()

    # To the page

    def hello(self) -> dict[str, Any]:
        """Return the first message."""
        return {
            **super().hello(),
            'mode': 'player',
            'bag': self._name,
            'parameters': knobs_of(self._stretch.values),
            'preset': preset_with(self._stretch.values),
            'start': self._start,
            'duration': self._end - self._start,
            'changes': self.recorded.changes,
        }

    def news(self) -> list[dict[str, Any]]:
        """Return the present state."""
        now = self.time
        ended = not self._playing and now >= self._end
        status = {
            'type': 'status',
            'state': 'running' if self._playing else 'ended' if ended else 'paused',
            'text': self.recorded.remark,
            'time': now,
        }
        numbers = numbers_of(self._rig, self.recorded.motion, now)
        return [status, numbers, *self.theory.values()]

    @property
    def time(self) -> float:
        """Rig time now, s."""
        if not self._playing:
            return self._from
        return min(self._from + self._speed * (time.monotonic() - self._since), self._end)

    def tick(self) -> None:
        """Report a change of parameters, and the state at intervals."""
        now = self.time
        if self._playing and now >= self._end:
            self._go_to(self._end, playing=False)
        number, before = self.recorded.number_at(now), self._stretch.values
        if number != self._number:
            played = number == self._number + 1 and self._playing
            self._enter(number)
            change = self.recorded.changes[number]
            values = {n: v for n, v in self._stretch.values.items() if before.get(n, v) != v}
            self.send(
                {**change, 'type': 'parameters', 'kind': 'change', 'values': values}
                | ({} if played else {'time': None})
            )
        if self._asked is not None and self._asked.done():
            self.send_theory(json.loads(self._asked.result()))
            self._asked = None
        if self._ghost is not None:
            self._ghost.tick()
        if time.monotonic() >= self._status_at + _STATUS_PERIOD_S:
            self._send_status()

    def frame(self, view: PageView) -> bytes | None:
        """Return a frame with new rows; None without any."""
        now, flags = self.time, 0 if self._playing else PAUSED
        ghost = self._ghost.motion if self._ghost is not None else None
        return view.frame(self.recorded.motion, now, now, flags, ghost)

    def _send_status(self) -> None:
        self._status_at = time.monotonic()
        for message in self.news()[:2]:
            self.send(message)

    # From the page

    async def handle(self, message: dict[str, Any]) -> dict[str, Any] | None:
        """Process a request."""
        kind = message['type']
        if kind == 'seek':
            self._go_to(message['time'])
        elif kind == 'play':
            self._play(message['speed'])
        elif kind == 'jump':
            self._jump(message['to'], message['direction'])
        elif kind == 'what_if':
            values = read_values(message['values'] or {})
            self._what_if(values)
            return {'ok': True, 'reason': '', 'values': values}
        elif kind == 'service' and message['name'] in _STEPS:
            self._jump(_STEPS[message['name']], 1)
        elif kind == 'service' and message['name'] == 'pause':
            self._play(0.0 if self._playing else self._speed)
        else:
            raise RequestError(
                'this is a recording: run a what-if, or change the parameter of a live rig'
            )
        if kind in ('seek', 'jump'):
            self.send({'type': 'seek_done', 'time': self.time})
        return {'ok': True, 'reason': ''}

    def _go_to(self, instant: float, *, playing: bool | None = None) -> None:
        self._from = min(max(instant, self._start), self._end)
        self._since = time.monotonic()
        if playing is not None:
            self._playing = playing
        self._send_status()

    def _play(self, speed: float) -> None:
        now = self.time
        if speed > 0.0:
            self._speed = min(max(speed, _SLOWEST), _FASTEST)
            # At the end playing starts again from the beginning.
            now = self._start if now >= self._end else now
        self._go_to(now, playing=speed > 0.0)

    def _jump(self, to: str, direction: float) -> None:
        """Go to the next or the previous sample, impact or change, and pause there."""
        if to in ('sample', 'impact'):
            motion = self.recorded.motion
            times = (motion.samples if to == 'sample' else motion.impacts)[:, 0]
        elif to in _KINDS:
            found = [c['time'] for c in self.recorded.changes if c['kind'] in _KINDS[to]]
            times = np.array(found, dtype=float)
        else:
            raise RequestError(f'a recording has no {str(to)[:80]} to jump to')
        now = self.time
        if direction < 0:
            place = int(np.searchsorted(times, now, side='left')) - 1
        else:
            place = int(np.searchsorted(times, now, side='right'))
        ends = self._start if direction < 0 else self._end
        self._go_to(float(times[place]) if 0 <= place < len(times) else ends, playing=False)

    def _what_if(self, values: dict[str, Any]) -> None:
        ghost, self._ghost = self._ghost, None
        if ghost is not None:
            ghost.close()
        if values:
            self._ghost = WhatIfMotion(self._path, values, self.send)
        else:
            self.send({'type': 'what_if', 'on': False, 'done': True, 'text': ''})
