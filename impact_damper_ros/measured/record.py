# SPDX-License-Identifier: Apache-2.0
"""
Measured records of a force on M, or of the acceleration of the base, held between samples.

Each sample is held from the middle of the interval before it to the middle of the one after it.
The held record is a step function of time, which a rig follows exactly. Its difference from a
signal that is smooth between samples is of the second order in the interval: the record of every
second sample has four times the error.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import as_line, quote
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .sheet import ACCELERATION, BASE, FORCE, TIME, Quantity, TableError
from .table import check_whole, read_measured_table

Array = NDArray[np.float64]

FORCE_RECORD, BASE_RECORD = 'force', 'base'
#: Names of the texts of a copy.
COPY = ('quantity', 'name', 'digest', 'times', 'values')
#: The column of each kind of record.
_COLUMNS = {
    FORCE_RECORD: FORCE,
    BASE_RECORD: Quantity((*ACCELERATION.names, *BASE.names), ('m/s^2',)),
}
#: Fewest and most samples.
_LEAST_SAMPLES, _MOST_SAMPLES = 4, 10_000_000
#: Longest copy, bytes, and largest value, N or m/s^2.
_LONGEST_COPY, _LARGEST = 25 * _MOST_SAMPLES, 1e12


class MeasuredRecord(NamedTuple):
    """A force on M, N, or an acceleration of the base, m/s^2, as a rig follows it."""

    #: 'force' or 'base'.
    quantity: str
    #: Times since the first sample, s.
    times: Array
    values: Array
    #: Name of the file, and the columns that are used.
    name: str
    columns: str = ''
    #: A copy of the record as named texts, which JSON keeps; see `with_copy`.
    copy: tuple[tuple[str, str], ...] = ()

    @property
    def duration(self) -> float:
        """Duration, s: the first and the last sample are held for half an interval."""
        return float(self.times[-1] + 0.5 * (self.times[-1] - self.times[-2]))

    @property
    def rate(self) -> float:
        """Samples per second, in the mean."""
        return float((len(self.times) - 1) / self.times[-1])

    def with_copy(self) -> MeasuredRecord:
        """
        Return the record with a copy of itself as texts, from which `of_copy` makes it anew.

        The digest is that of the numbers, whatever the file is called and how it writes them.
        """
        numbers = {'times': self.times, 'values': self.values}
        texts = {key: ','.join(map(repr, array.tolist())) for key, array in numbers.items()}
        packed = {
            key: base64.b85encode(zlib.compress(text.encode())).decode()
            for key, text in texts.items()
        }
        digest = hashlib.sha256('\n'.join([self.quantity, *texts.values()]).encode()).hexdigest()
        names = {'quantity': self.quantity, 'name': self.name, 'digest': digest}
        return self._replace(copy=tuple({**names, **packed}.items()))

    @classmethod
    def of_copy(cls, copy: Mapping[str, Any]) -> MeasuredRecord:
        """Return the record that texts are a copy of; raise a ValueError if there is none."""
        try:
            texts = {key: _expand(copy[key]) for key in ('times', 'values')}
            times, values = (
                np.array([float(number) for number in text.split(',')]) for text in texts.values()
            )
        except (ValueError, zlib.error) as error:
            raise ValueError(f'the copy of a record cannot be expanded: {error}') from error
        quantity = copy['quantity']
        digest = hashlib.sha256('\n'.join([quantity, *texts.values()]).encode()).hexdigest()
        if digest != copy['digest']:
            raise ValueError(
                f'the record {quote(copy["name"])} is damaged: its digest does not match'
            )
        if quantity not in _COLUMNS or len(times) != len(values):
            raise ValueError(
                f'the record {quote(copy["name"])} of {quote(quantity)} has {len(times)} times '
                f'and {len(values)} values: give as many'
            )
        rises = np.isfinite(times).all() and (np.diff(times) > 0.0).all()
        if not (rises and len(times) > 1 and times[0] == 0.0):
            raise ValueError(f'the times of the record {quote(copy["name"])} do not rise from 0')
        if (row := _too_large(values)) is not None:
            raise ValueError(
                f'the record {quote(copy["name"])} has the value {values[row]:.6g}: give at most '
                f'{_LARGEST:.0e}'
            )
        kept = tuple((key, copy[key]) for key in COPY)
        return cls(quantity, times, values, str(copy['name']), copy=kept)

    def steps(self) -> tuple[list[float], list[float]]:
        """Return starts of the steps, s from the first sample, and values; the last one is 0."""
        middles = 0.5 * (self.times[1:] + self.times[:-1])
        starts = [0.0, *middles.tolist(), self.duration]
        return starts, [*self.values.tolist(), 0.0]

    def description(self) -> str:
        """Return the record in words."""
        unit, factor, what = 'N', 1.0, 'force'
        if self.quantity == BASE_RECORD:
            unit, factor, what = 'g', STANDARD_GRAVITY, 'acceleration of the base'
        sizes = np.abs(self.values) / factor
        return (
            f'{as_line(self.name)}: {what} of {len(self.values)} samples in '
            f'{self.times[-1]:.6g} s, {self.rate:.6g} Hz, at most {sizes.max():.4g} {unit}, '
            f'{np.sqrt(np.mean(sizes**2)):.4g} {unit} rms'
            + (f'; {self.columns}' if self.columns else '')
        )


def _too_large(values: Array) -> int | None:
    """Return the place of the first value that is no number, or too large for a rig."""
    wrong = np.flatnonzero(~(np.abs(values) <= _LARGEST))
    return int(wrong[0]) if len(wrong) else None


def _expand(packed: str) -> str:
    """Return a text that was compressed, unless it is too long."""
    expander = zlib.decompressobj()
    content = expander.decompress(base64.b85decode(packed), _LONGEST_COPY)
    if expander.unconsumed_tail:
        raise ValueError(f'the copy of a record is longer than {_LONGEST_COPY} bytes')
    return content.decode('ascii')


def read_record(path: Path, quantity: str, cycle: float = 0.0) -> MeasuredRecord:
    """Read a record from a file; it has to last a cycle, s."""
    table, digit = read_measured_table(
        path, {'time': TIME, quantity: _COLUMNS[quantity]}
    ).on_a_clock()
    check_whole(table, digit)
    table.check_finite(quantity)
    times, values = table.columns['time'].values, table.columns[quantity].values
    if not _LEAST_SAMPLES <= len(times) <= _MOST_SAMPLES:
        raise TableError(
            f'{as_line(str(path))}: {len(times)} samples: give {_LEAST_SAMPLES} to {_MOST_SAMPLES}'
        )
    if (row := _too_large(values)) is not None:
        raise table.error(
            quantity,
            row,
            f'{table.as_given(quantity, row)}: give at most {_LARGEST:.0e} N or m/s^2',
        )
    lasting = float(times[-1] - times[0])
    if not lasting >= cycle:
        raise table.error(
            'time',
            len(times) - 1,
            f'the record lasts {lasting:.6g} s, less than a natural cycle of the rig, '
            f'{cycle:.4g} s: record longer, or append zeros after an impulse',
        )
    return MeasuredRecord(quantity, times - times[0], values, path.name, table.described)


def read_records(names: Mapping[str, Any], cycle: float = 0.0) -> list[MeasuredRecord]:
    """Read the tables that parameters of a node name; see `read_record`."""
    found = []
    for parameter, quantity in (('force_record', FORCE_RECORD), ('base_record', BASE_RECORD)):
        name = names.get(parameter, 'none')
        if not isinstance(name, str):
            raise TableError(f'{parameter} is {quote(name)}: give the path of a table, or none')
        if name != 'none':
            path = Path(name)
            # The path ~NAME of an unknown user stays as it is, and the file is not found.
            with contextlib.suppress(RuntimeError):
                path = path.expanduser()
            found.append(read_record(path, quantity, cycle))
    return found
