"""A recording as arrays, read once: its motion, and the changes of the rig."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.replay import Command, RecordedRun, Rows
from impact_damper_ros.replay.rows import Table
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .knobs import as_json
from .motion import ForcePhase, MotionHistory, impact_rows
from .presets import preset_with

#: Largest number of samples and impacts that are read of a recording.
MOST_SAMPLES, MOST_IMPACTS = 2_000_000, 1_000_000
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
        count = recorded.reader.topics[recorded.topics.joint_states].message_count
        # Surplus samples are dropped below, at the end.
        self.motion = MotionHistory(max(1, min(count, 2 * MOST_SAMPLES)), MOST_IMPACTS)
        self.eras: list[Era] = []
        self.changes: list[dict[str, Any]] = []

    def take(self, rows: Rows) -> None:
        """Take the messages of the present rig."""
        if rows.states.size:
            self._take_states(rows.states)
        if rows.impacts.size:
            self._take_impacts(rows.impacts)

    def enter(self, snapshot: Command) -> None:
        """Take what was done to the rig."""
        state = snapshot.state
        restored = Snapshot.from_dict(dict(state))
        rig = restored.parameters
        control = state['gap_control']['parameters']
        values = {**rig.as_dict(), **control, **snapshot.initial.as_dict()}
        time = snapshot.time_ns / 1e9
        era = Era(time, rig, {n: as_json(v) for n, v in values.items()}, state)
        before = self.eras[-1].values if self.eras else {}
        changed = {n: v for n, v in era.values.items() if before.get(n, v) != v}
        kind = 'reset' if snapshot.resets else 'change' if changed else ''
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

    def _take_states(self, table: Table) -> None:
        time = (table.stamp_ns - self._offset_ns) / 1e9
        later = np.maximum.accumulate(np.append(self.motion.end, time)) if len(time) else time
        known = np.nan_to_num(later[:-1], nan=-np.inf)
        keep = (time > known) & np.isfinite(table.numbers[:, :4:2]).all(axis=1)
        time, numbers = time[keep], table.numbers[keep]
        x, z, stop_1, stop_2 = numbers[:, :4].T - self._rest
        primary, damper, velocity_1, velocity_2 = numbers[:, 5:9].T
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

    def _take_impacts(self, table: Table) -> None:
        stops = np.select([table.frame == 'stop_1', table.frame == 'stop_2'], [1.0, 2.0], 0.0)
        time = (table.stamp_ns - self._offset_ns) / 1e9
        rows = np.column_stack([time, stops, table.numbers[:, :6]])
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
        if isinstance(item, Rows):
            reading.take(item)
        elif isinstance(item, Command):
            reading.enter(item)
        if len(reading.motion.samples) >= MOST_SAMPLES:
            remarks.append(f'only the first {MOST_SAMPLES:,} samples are shown')
            break
    if not len(reading.motion.samples):
        raise ValueError(f'{path.name} holds no joint states of a rig')
    if not recorded.reader.complete:
        remarks.append('the recording was cut short')
    return Recording(reading.motion, reading.eras, reading.changes, '; '.join(remarks))
