# SPDX-License-Identifier: Apache-2.0
"""
Measured records of a force on M, or of the acceleration of the base, held between samples.

Each sample is held from the middle of the interval before it to the middle of the one after it.
What is held is a step function of time; a rig follows it exactly. That it stands for a signal
which is smooth between its samples is an error of the second order in their interval: the record
of every second sample has four times the error, and shows it.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .measured_table import (
    ACCELERATION,
    BASE,
    FORCE,
    TIME,
    Quantity,
    TableError,
    read_table,
    sampling_rate,
)
from .quoting import as_line
from .units import STANDARD_GRAVITY

Array = NDArray[np.float64]

FORCE_RECORD, BASE_RECORD = 'force', 'base'
#: The column of each kind of record.
_COLUMNS = {
    FORCE_RECORD: FORCE,
    BASE_RECORD: Quantity((*ACCELERATION.names, *BASE.names), ('m/s^2',)),
}
#: Fewest samples, of which every second one is still a record, and most.
_LEAST_SAMPLES, _MOST_SAMPLES = 4, 10_000_000


class MeasuredRecord(NamedTuple):
    """
    A record, as a rig follows it.

    Attributes
    ----------
    quantity : {'force', 'base'}
        A force on M, N, or the acceleration of the base, m/s^2.
    times : ndarray, shape (n,)
        Instants of the samples since the first one, s.
    values : ndarray, shape (n,)
        What was measured then.
    name : str
        Name of the file.
    """

    quantity: str
    times: Array
    values: Array
    name: str

    @property
    def duration(self) -> float:
        """How long it lasts, s: the last sample is held for half an interval, as the first one."""
        return float(self.times[-1] + 0.5 * (self.times[-1] - self.times[-2]))

    @property
    def rate(self) -> float:
        """Samples per second, in the mean."""
        return float((len(self.times) - 1) / self.times[-1])

    @property
    def digest(self) -> str:
        """Digest of the samples, whatever the file is called and how it writes them."""
        content = np.concatenate([self.times, self.values]).astype('<f8').tobytes()
        return hashlib.sha256(self.quantity.encode() + content).hexdigest()

    def steps(self) -> tuple[list[float], list[float]]:
        """Return since when each value is held, s from the first sample, and these; 0 at last."""
        middles = 0.5 * (self.times[1:] + self.times[:-1])
        starts = [0.0, *middles.tolist(), self.duration]
        return starts, [*self.values.tolist(), 0.0]

    def halved(self) -> MeasuredRecord:
        """Return the record of every second sample."""
        return self._replace(times=self.times[::2], values=self.values[::2])

    def described(self) -> str:
        """Return the record in words."""
        unit, factor, what = 'N', 1.0, 'force'
        if self.quantity == BASE_RECORD:
            unit, factor, what = 'g', STANDARD_GRAVITY, 'acceleration of the base'
        sizes = np.abs(self.values) / factor
        return (
            f'{as_line(self.name)}: {what} of {len(self.values)} samples in '
            f'{self.times[-1]:.6g} s, {self.rate:.6g} Hz, at most {sizes.max():.4g} {unit}, '
            f'{np.sqrt(np.mean(sizes**2)):.4g} {unit} rms'
        )


def read_record(path: Path, quantity: str, cycle: float = 0.0) -> MeasuredRecord:
    """
    Read a record from a table.

    Parameters
    ----------
    path : Path
        A table with the columns ``t [s]`` and ``force [N]``, or ``acceleration [m/s^2]`` (or in
        g).
    quantity : {'force', 'base'}
        What was recorded.
    cycle : float, optional
        Least time that it has to last, s.

    Raises
    ------
    TableError
        If the table is no such record: the text names column, line and remedy.
    """
    table = read_table(path, {'time': TIME, quantity: _COLUMNS[quantity]})
    sampling_rate(table)
    table.check_finite(quantity)
    times, values = table.columns['time'].values, table.columns[quantity].values
    if not _LEAST_SAMPLES <= len(times) <= _MOST_SAMPLES:
        raise TableError(
            f'{as_line(str(path))}: {len(times)} samples: give {_LEAST_SAMPLES} to {_MOST_SAMPLES}'
        )
    lasting = float(times[-1] - times[0])
    if not lasting >= cycle:
        raise table.error(
            'time',
            len(times) - 1,
            f'the record lasts {lasting:.6g} s, less than a natural cycle of the rig, '
            f'{cycle:.4g} s: give a longer one, with zeros after its end if it is a blow',
        )
    return MeasuredRecord(quantity, times - times[0], values, path.name)
