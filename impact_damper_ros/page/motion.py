"""The last minutes of a motion as arrays: samples, impacts, and the phase of the force."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.forcing import frequency_at, frequency_steps
from impact_damper_ros.rig.snapshot import Snapshot

Rows = NDArray[np.float64]

#: Columns of samples; positions count from the static equilibrium of M, m, s, cycles.
SAMPLE_COLUMNS = (
    *('time', 'x', 'x_velocity', 'z', 'z_velocity'),
    *('stop_1', 'stop_1_velocity', 'stop_2', 'stop_2_velocity', 'angle', 'phase'),
)
#: Columns of impacts; velocities just after, impulse as its modulus.
IMPACT_COLUMNS = (
    *('time', 'stop', 'x', 'x_velocity', 'z_velocity', 'impulse', 'phase', 'y'),
    'x_velocity_before',
    'z_velocity_before',
)


def impact_rows(rows: Rows, rig: RigParameters, phases: NDArray[np.float64], rest: float) -> Rows:
    """
    Return impacts as `IMPACT_COLUMNS`.

    Parameters
    ----------
    rows : ndarray of shape (n, 8)
        Time, stop, then positions, velocities after and impulses of M and m, as published.
    rig : RigParameters
        The rig.
    phases : ndarray of shape (n,)
        Of the force, cycles.
    rest : float
        Published position of M in its static equilibrium, m.
    """
    time, stop, x, z, x_after, z_after, primary, damper = rows.T
    return np.column_stack(
        [
            *(time, stop, x - rest, x_after, z_after, np.abs(primary), phases, z - x),
            x_after - primary / rig.primary_mass,
            z_after - damper / rig.damper_mass,
        ]
    )


class ForcePhase:
    """
    The phase of the first harmonic of the force, stepped sine included.

    Parameters
    ----------
    snapshot : Snapshot
        The rig at an instant; what comes after it is known.
    """

    def __init__(self, snapshot: Snapshot) -> None:
        rig = snapshot.parameters
        begun = snapshot.run.time + snapshot.run.time_low
        turned = snapshot.angles[0] / math.tau if snapshot.angles else 0.0
        own = rig.force_phases[0] / math.tau
        times, frequencies = [begun], [rig.force_frequencies[0] / math.tau]
        start, step = snapshot.sweep
        if rig.sweep_mode != 'off':
            steps = np.arange(step, frequency_steps(rig) + 1)
            times = [begun, *(start + rig.sweep_dwell * steps[1:])]
            frequencies = [frequency_at(rig, int(k)) / math.tau for k in steps]
        self._times, self._frequencies = np.array(times), np.array(frequencies)
        lengths = np.diff(self._times) * self._frequencies[:-1]
        self._cycles = turned + own + np.concatenate([[0.0], np.cumsum(lengths)])
        self._known = rig.force_amplitudes[0] != 0.0 and bool(self._frequencies.any())

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the phases at instants, in cycles from 0 to 1; NaN without a force."""
        if not self._known:
            return np.full(len(time), np.nan)
        place = np.clip(np.searchsorted(self._times, time, side='right') - 1, 0, None)
        cycles = self._cycles[place] + (time - self._times[place]) * self._frequencies[place]
        phases: NDArray[np.float64] = np.remainder(cycles, 1.0)
        return phases


class _Table:
    """Rows in rising order of their first column, of which the last ones are kept."""

    def __init__(self, width: int, most: int) -> None:
        self._most = most
        self._rows = np.empty((256, width))
        self._begin = self._end = 0

    @property
    def rows(self) -> Rows:
        return self._rows[self._begin : self._end]

    def add(self, rows: Rows) -> None:
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


class MotionHistory:
    """
    Samples and impacts of a rig in the order of their instants.

    Parameters
    ----------
    most_samples, most_impacts : int
        How many are kept, the newest ones.
    """

    def __init__(self, most_samples: int, most_impacts: int) -> None:
        self._samples = _Table(len(SAMPLE_COLUMNS), most_samples)
        self._impacts = _Table(len(IMPACT_COLUMNS), most_impacts)

    @property
    def samples(self) -> Rows:
        """All samples."""
        return self._samples.rows

    @property
    def impacts(self) -> Rows:
        """All impacts."""
        return self._impacts.rows

    @property
    def end(self) -> float:
        """Rig time of the newest sample, s; NaN without any."""
        rows = self._samples.rows
        return float(rows[-1, 0]) if len(rows) else math.nan

    def add_samples(self, rows: Rows) -> None:
        """Append samples, which must be later than the last one."""
        self._samples.add(rows)

    def add_impacts(self, rows: Rows) -> None:
        """Append impacts, which must not be earlier than the last one."""
        self._impacts.add(rows)

    def samples_between(self, start: float, end: float) -> Rows:
        """Return the samples after an instant, up to another one."""
        return _between(self._samples.rows, start, end)

    def impacts_between(self, start: float, end: float) -> Rows:
        """Return the impacts after an instant, up to another one."""
        return _between(self._impacts.rows, start, end)


def _between(rows: Rows, start: float, end: float) -> Rows:
    first, last = np.searchsorted(rows[:, 0], (start, end), side='right')
    return rows[first:last]
