# SPDX-License-Identifier: Apache-2.0
"""The motion of a rig as arrays: samples, impacts, measurements and acts of the control."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.control.act import Action
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.rows import (
    Events,
    Messages,
    Samples,
    impacts_of,
    recorded_impacts,
    recorded_samples,
)
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.rig.stepped_sine import FirstAngle, rig_at, stepped_sine

Rows = NDArray[np.float64]

_SAMPLE = ('time', 'x', 'primary_velocity', 'z', 'damper_velocity', 'stop_1', 'stop_2')
#: Columns of samples; positions count from the static equilibrium of M, m, s, rad, cycles.
SAMPLE_COLUMNS = (*_SAMPLE, 'angle', 'phase', 'base', 'base_velocity')
_IMPACT = (
    *('time', 'stop', 'x', 'y', 'primary_velocity_before', 'primary_velocity_after'),
    *('damper_velocity_before', 'damper_velocity_after', 'impulse'),
)
#: Columns of impacts.
IMPACT_COLUMNS = (*_IMPACT, 'phase')
#: Columns of measurements, and of acts of the control: whether the act is a command, its places of
#: the stops in M, the active force on M, and the energy of both stops so far.
MEASURED_COLUMNS = ('time', 'x', 'z')
ACT_COLUMNS = ('time', 'command', 'stop_1', 'stop_2', 'force', 'energy')
#: Largest number of samples and impacts that are read of a recording.
MOST_SAMPLES, MOST_IMPACTS = 2_000_000, 1_000_000
COMMANDS = tuple(action.name.lower() for action in (Action.COMMAND, Action.ORDER))


class ForcePhase:
    """The angle of the first harmonic from a snapshot on, stepped sine included, as a phase."""

    def __init__(self, snapshot: Snapshot) -> None:
        rig, run = snapshot.parameters, snapshot.run
        first = rig_at(rig, snapshot.sweep.step)
        turned = snapshot.angles[0] if snapshot.angles else 0.0
        angles = [FirstAngle.of(first, run.time + run.time_low, turned)]
        for step in stepped_sine(rig, snapshot.sweep):
            angles.append(angles[-1].after_step(step.time, step.parameters))
        self._times, self._turned, self._rates = np.array(angles).T
        self._known = first.first_harmonic[0] != 0.0 and bool(self._rates.any())

    def at(self, time: Rows) -> Rows:
        """Return the phases at instants, in cycles from 0 to 1; NaN without a force."""
        if not self._known:
            return np.full(len(time), np.nan)
        place = np.clip(np.searchsorted(self._times, time, side='right') - 1, 0, None)
        cycles = self._turned[place] + (time - self._times[place]) * self._rates[place]
        phases: Rows = np.remainder(cycles, 1.0)
        return phases


@dataclass(frozen=True)
class Stretch:
    """The rig from one command to the next, which turns its messages into rows."""

    time_ns: int  # rig time at which the stretch begins
    offset_ns: int  # stamp of rig time 0
    rig: RigParameters
    phase: ForcePhase | None  # None if the phase is not needed

    def samples(self, messages: Messages) -> Rows:
        """Return joint states as `SAMPLE_COLUMNS`."""
        times = (messages['stamp_ns'] - self.offset_ns) / 1e9
        return self.sample_rows(recorded_samples(messages, self.rig, times))

    def impacts(self, messages: Messages) -> Rows:
        """Return messages of impacts as `IMPACT_COLUMNS`."""
        times = (messages['stamp_ns'] - self.offset_ns) / 1e9
        return self.impact_rows(recorded_impacts(messages, self.rig, times))

    def measurements(self, messages: Messages) -> Rows:
        """Return measurements as `MEASURED_COLUMNS`."""
        return measured_rows(messages, self.offset_ns)

    def acts(self, messages: Messages) -> Rows:
        """Return acts of the control as `ACT_COLUMNS`."""
        target_1, target_2, energy_1, energy_2, force = messages['numbers'][:, [0, 1, 6, 7, 8]].T
        command = np.isin(messages['frame'], COMMANDS)
        times = (messages['stamp_ns'] - self.offset_ns) / 1e9
        return np.column_stack([times, command, target_1, target_2, force, energy_1 + energy_2])

    def sample_rows(self, samples: Samples) -> Rows:
        """Return samples of the rig as `SAMPLE_COLUMNS`."""
        rows = np.column_stack([samples[name] for name in _SAMPLE])
        if self.rig.one_sided:
            rows[:, -1] = np.nan
        angles = np.full(len(rows), self.rig.angle)
        base = samples['base'], samples['base_velocity']
        return np.column_stack([rows, angles, self._phases(rows), *base])

    def impact_rows(self, events: Events) -> Rows:
        """Return the impacts among events of the rig as `IMPACT_COLUMNS`."""
        hits = impacts_of(events)
        rows = np.column_stack([hits[name] for name in _IMPACT])
        return np.column_stack([rows, self._phases(rows)])

    def _phases(self, rows: Rows) -> Rows:
        return np.full(len(rows), np.nan) if self.phase is None else self.phase.at(rows[:, 0])


def measured_rows(messages: Messages, offset_ns: int | NDArray[np.int64]) -> Rows:
    """Return measurements as `MEASURED_COLUMNS`, given the stamp of rig time 0."""
    x, y = messages['numbers'][:, :2].T
    return np.column_stack([(messages['stamp_ns'] - offset_ns) / 1e9, x, x + y])


class _Table:
    """Rows in rising order of their first column; the last ones are kept."""

    def __init__(self, width: int, most: int) -> None:
        self._most = most
        self._rows = np.empty((256, width))
        self._begin = self._end = 0

    @property
    def rows(self) -> Rows:
        return self._rows[self._begin : self._end]

    def add(self, rows: Rows) -> None:
        """Append rows; the oldest ones go where there is no room."""
        rows = rows[-self._most :]
        if self._end + len(rows) > len(self._rows):
            kept = self.rows[max(0, len(self.rows) + len(rows) - self._most) :].copy()
            room = min(2 * self._most, max(2 * (len(kept) + len(rows)), 256))
            if room != len(self._rows):
                self._rows = np.empty((room, self._rows.shape[1]))
            self._rows[: len(kept)] = kept
            self._begin, self._end = 0, len(kept)
        self._rows[self._end : self._end + len(rows)] = rows
        self._end += len(rows)
        self._begin = max(self._begin, self._end - self._most)

    def add_sorted(self, rows: Rows) -> None:
        """Append the rows that are not earlier than the last one, in their order."""
        if self._end > self._begin:
            rows = rows[rows[:, 0] >= self._rows[self._end - 1, 0]]
        self.add(rows[np.argsort(rows[:, 0], kind='stable')])


class MotionHistory:
    """
    The motion of a rig so far, each kind of row in the order of its instants.

    Of samples and measurements the newest `most_samples` are kept, of impacts and acts the newest
    `most_impacts`.
    """

    def __init__(self, most_samples: int, most_impacts: int) -> None:
        self._samples = _Table(len(SAMPLE_COLUMNS), most_samples)
        self._impacts = _Table(len(IMPACT_COLUMNS), most_impacts)
        self._measured = _Table(len(MEASURED_COLUMNS), most_samples)
        self._acts = _Table(len(ACT_COLUMNS), most_impacts)
        #: Number of times that the newest sample was corrected.
        self.corrections = 0

    @property
    def samples(self) -> Rows:
        """All samples."""
        return self._samples.rows

    @property
    def impacts(self) -> Rows:
        """All impacts."""
        return self._impacts.rows

    @property
    def measured(self) -> Rows:
        """All measurements."""
        return self._measured.rows

    @property
    def acts(self) -> Rows:
        """All acts of the control."""
        return self._acts.rows

    @property
    def end(self) -> float:
        """Rig time of the newest sample, s; NaN without any."""
        rows = self._samples.rows
        return float(rows[-1, 0]) if len(rows) else math.nan

    def add_samples(self, rows: Rows) -> None:
        """Append the samples that are later than the one before them."""
        rows = rows[np.isfinite(rows[:, :6]).all(axis=1)]
        before = np.fmax.accumulate(np.append(self.end, rows[:, 0]))[:-1]
        self._samples.add(rows[~(rows[:, 0] <= before)])

    def correct_end(self, row: Rows) -> None:
        """Replace the newest sample by one of the same instant."""
        last = self._samples.rows[-1:, 1:7]
        if len(last) and not np.array_equal(last[0], row[1:7]):
            last[0] = row[1:7]
            self.corrections += 1

    def add_impacts(self, rows: Rows) -> None:
        """Append the impacts that are not earlier than the last one, in their order."""
        self._impacts.add_sorted(rows[np.isfinite(rows[:, :9]).all(axis=1)])

    def add_measured(self, rows: Rows) -> None:
        """Append measurements."""
        self._measured.add_sorted(rows[np.isfinite(rows).all(axis=1)])

    def add_acts(self, rows: Rows) -> None:
        """Append acts of the control."""
        self._acts.add_sorted(rows)


def between(rows: Rows, start: float, end: float) -> Rows:
    """Return the rows after an instant, up to another one."""
    first, last = np.searchsorted(rows[:, 0], (start, end), side='right')
    return rows[first:last]
