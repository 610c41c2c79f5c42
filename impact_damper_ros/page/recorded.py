"""A recording as arrays, read once: its motion, and the changes of the rig."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.bag.messages import JointStateColumns
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.replay.recorded_run import Item, RecordedChange, RecordedRun
from impact_damper_ros.replay.recorded_snapshot import RecordedSnapshot
from impact_damper_ros.rig import INITIAL_SPECS, RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .knobs import as_json
from .motion import ForcePhase, MotionHistory, impact_rows
from .presets import preset_with

#: Largest number of samples and impacts that are read of a recording.
MOST_SAMPLES, MOST_IMPACTS = 2_000_000, 1_000_000
_BATCH = 16_384
_MOST_CHANGES = 2000


@dataclass(frozen=True)
class Era:
    """
    The rig from one change to the next.

    Attributes
    ----------
    time : float
        Rig time at which it begins, s.
    rig : RigParameters
        The rig.
    values : dict
        Parameters of the rig and of its control, and the initial conditions as far as known.
    state : dict
        State of its snapshot.
    """

    time: float
    rig: RigParameters
    values: dict[str, Any]
    state: dict[str, Any]


@dataclass(frozen=True)
class Recording:
    """
    A recording.

    Attributes
    ----------
    motion : MotionHistory
        The whole motion.
    eras : list of Era
        The rigs, in order.
    changes : list of dict
        The changes and resets: time, kind, new values, and the preset that the rig then matches.
    remark : str
        What is missing from the recording; empty if nothing is.
    """

    motion: MotionHistory
    eras: list[Era]
    changes: list[dict[str, Any]]
    remark: str

    @property
    def start(self) -> float:
        """Rig time of the first sample, s."""
        return float(self.motion.samples[0, 0])

    def era(self, time: float) -> int:
        """Return the number of the era of an instant."""
        times = [era.time for era in self.eras]
        return max(int(np.searchsorted(times, time, side='right')) - 1, 0)


class _Reading:
    """Collects the content of a bag."""

    def __init__(self, recorded: RecordedRun) -> None:
        self._topics = recorded.topics
        count = recorded.reader.topics[recorded.topics.joint_states].message_count
        # Surplus samples are dropped below, at the end.
        self.motion = MotionHistory(max(1, min(count, 2 * MOST_SAMPLES)), MOST_IMPACTS)
        self._columns = {
            recorded.topics.joint_states: JointStateColumns((JOINTS,), (4, 4, 0)),
            recorded.topics.impacts: JointStateColumns((IMPACT_JOINTS,), (2, 2, 2)),
        }
        self._waiting: dict[str, list[bytes]] = {name: [] for name in self._columns}
        self._initial: dict[str, Any] = {}
        self.eras: list[Era] = []
        self.changes: list[dict[str, Any]] = []
        self._enter(recorded.start)

    def take(self, item: Item) -> None:
        if isinstance(item, list):
            for record in item:
                waiting = self._waiting.get(record.topic)
                if waiting is not None:
                    waiting.append(record.content)
            if max(map(len, self._waiting.values())) >= _BATCH:
                self.read()
        elif isinstance(item, RecordedChange):
            self._initial |= {n: v for n, v in item.values.items() if n in INITIAL_SPECS}
            if item.dump:
                self.eras[-1].values.update(self._initial)
        else:
            self.read()
            self._enter(item)

    def _enter(self, snapshot: RecordedSnapshot) -> None:
        state = snapshot.state
        restored = Snapshot.from_dict(dict(state))
        rig = restored.parameters
        values = {**rig.as_dict(), **state['gap_control']['parameters'], **self._initial}
        time = snapshot.time_ns / 1e9
        era = Era(time, rig, {n: as_json(v) for n, v in values.items()}, state)
        before = self.eras[-1].values if self.eras else {}
        changed = {n: v for n, v in era.values.items() if before.get(n, v) != v}
        kind = 'reset' if snapshot.reason == 'reset' else 'change' if changed else ''
        if not self.eras:
            kind = 'stretch'
        if kind and len(self.changes) < _MOST_CHANGES:
            preset = preset_with(era.values)
            self.changes.append({'time': time, 'kind': kind, 'values': changed, 'preset': preset})
        if kind or not self.eras:
            self.eras.append(era)
        self._phase = ForcePhase(restored)
        self._rig = rig
        self._offset_ns = snapshot.offset_ns
        self._rest = rig.static_deflection

    def read(self) -> None:
        """Turn the messages that wait into rows."""
        states, impacts = self._waiting.values() if len(self._waiting) == 2 else ([], [])
        if states:
            self._read_states(states)
        if impacts:
            self._read_impacts(impacts)
        for waiting in self._waiting.values():
            waiting.clear()

    def _read_states(self, contents: list[bytes]) -> None:
        table = self._columns[self._topics.joint_states].read(contents)
        time = (table.stamps_ns - self._offset_ns) / 1e9
        later = np.maximum.accumulate(np.append(self.motion.end, time)) if len(time) else time
        known = np.nan_to_num(later[:-1], nan=-np.inf)
        keep = (time > known) & np.isfinite(table.numbers[:, :4:2]).all(axis=1)
        time, numbers = time[keep], table.numbers[keep]
        x, z, stop_1, stop_2 = numbers[:, :4].T - self._rest
        primary, damper, velocity_1, velocity_2 = numbers[:, 4:8].T
        if self._rig.one_sided:
            stop_2, velocity_2 = np.full((2, len(time)), np.nan)
        angle = np.full(len(time), self._rig.angle)
        phase = self._phase.at(time)
        self.motion.add_samples(
            np.column_stack(
                [
                    *(time, x, primary, z, damper),
                    *(stop_1, velocity_1, stop_2, velocity_2, angle, phase),
                ]
            )
        )

    def _read_impacts(self, contents: list[bytes]) -> None:
        columns = self._columns[self._topics.impacts]
        table = columns.read(contents)
        stops = np.array([{'stop_1': 1.0, 'stop_2': 2.0}.get(f, 0.0) for f in columns.frames])
        time = (table.stamps_ns - self._offset_ns) / 1e9
        rows = np.column_stack([time, stops[table.frames], table.numbers[:, :6]])
        rows = rows[np.isfinite(rows).all(axis=1) & (rows[:, 1] > 0.0)]
        rows = rows[np.argsort(rows[:, 0], kind='stable')]
        phases = self._phase.at(rows[:, 0])
        self.motion.add_impacts(impact_rows(rows, self._rig, phases, self._rest))


def load_recording(path: Path) -> Recording:
    """
    Read a recording.

    Parameters
    ----------
    path : Path
        A bag directory or a file of one, whole, cut or recovered.

    Returns
    -------
    Recording
        The recording.

    Raises
    ------
    RecordingError
        If no rig is recorded in it.
    ValueError
        If it holds no motion.
    """
    recorded = RecordedRun(path, purpose='play')
    reading = _Reading(recorded)
    remarks = []
    for item in recorded.walk():
        reading.take(item)
        if len(reading.motion.samples) >= MOST_SAMPLES:
            remarks.append(f'only the first {MOST_SAMPLES:,} samples are shown')
            break
    reading.read()
    if not len(reading.motion.samples):
        raise ValueError(f'{path.name} holds no joint states of a rig')
    if not recorded.reader.complete:
        remarks.append('the recording was cut short')
    return Recording(reading.motion, reading.eras, reading.changes, '; '.join(remarks))
