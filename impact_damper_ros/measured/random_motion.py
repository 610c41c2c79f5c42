# SPDX-License-Identifier: Apache-2.0
"""
Random force or motion of the base from the table of a power spectral density.

The density is a power of the frequency between two points of the table (a line in a log-log plot),
steps where the table has a frequency twice, and is zero beside a level of zero.
Its band is divided into bins of equal width; each has one line whose mean square is the integral
of the density over the bin, and a random phase. The lines are at multiples of the width, so that
the signal repeats after a period of one over it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.parameters.forcing import random_phases
from impact_damper_ros.parameters.parameter_spec import MAX_HARMONICS
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .sheet import FREQUENCY, LEVEL, Quantity, TableError
from .table import MeasuredTable, read_measured_table

Array = NDArray[np.float64]

#: Number of lines, where none is given.
LINES = 200
#: Quantities that may be random, and the units of their densities, the first in SI.
_LEVELS = {
    'acceleration': LEVEL._replace(units=('(m/s^2)^2/Hz',)),
    'force': LEVEL._replace(units=('N^2/Hz',)),
}
#: Column of slopes: rise of the density from a point to the next one, in place of a level.
_SLOPE = Quantity(('slope', 'steigung'), ('dB/oct',))


class RandomLines(NamedTuple):
    """Lines of a random force, N, or of an acceleration of the base, m/s^2."""

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    phases: tuple[float, ...]
    #: Root of the integral of the table, which is the root mean square of the lines.
    integral: float
    #: Period after which the signal repeats, s.
    period: float
    #: 'force' or 'acceleration'.
    quantity: str
    #: Which columns of the table are used, and which are not.
    columns: str = ''

    @property
    def rms(self) -> float:
        """Root mean square of the lines, N or m/s^2."""
        return math.sqrt(sum(a * a for a in self.amplitudes) / 2.0)

    def values(self) -> dict[str, Any]:
        """Return the parameters of a rig that has the lines as its force, or as its base."""
        group = 'force' if self.quantity == 'force' else 'base'
        lines: dict[str, Any] = {
            f'{group}_amplitudes': self.amplitudes,
            f'{group}_frequencies': self.frequencies,
            f'{group}_phases': self.phases,
        }
        return lines if group == 'force' else {**lines, 'base_quantity': self.quantity}

    def description(self) -> str:
        """Return band, level and period in words."""
        low, high = (rate / math.tau for rate in (self.frequencies[0], self.frequencies[-1]))
        unit, factor = ('g', STANDARD_GRAVITY) if self.quantity != 'force' else ('N', 1.0)
        count = len(self.frequencies)
        return (
            f'random {self.quantity} of {count} line{"s" * (count > 1)} from {low:.4g} Hz to '
            f'{high:.4g} Hz: {self.rms / factor:.4g} {unit} rms, '
            f'{self.integral / factor:.4g} {unit} by the integral of the table; repeats after '
            f'{self.period:.6g} s; {self.columns}'
        )


class Density:
    """
    A one-sided power spectral density over rising frequencies, Hz.

    It is a power of the frequency between two points, a step where two frequencies are equal, and
    zero beside a level of zero.
    """

    def __init__(self, frequencies: ArrayLike, levels: ArrayLike) -> None:
        self.frequencies: Array = np.asarray(frequencies, float)
        self.levels: Array = np.asarray(levels, float)
        rises = np.diff(np.log(self.frequencies))
        positive = (rises > 0.0) & (self.levels[1:] > 0.0) & (self.levels[:-1] > 0.0)
        #: Intervals where the density is above 0, and its power of the frequency there
        self._positive = np.flatnonzero(positive)
        whole = np.log(np.where(self.levels > 0.0, self.levels, 1.0))
        self._powers = np.diff(whole) / np.where(positive, rises, 1.0)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency with a density above 0, Hz."""
        return float(self.frequencies[self._positive[0]]), float(
            self.frequencies[self._positive[-1] + 1]
        )

    def integral(self, low: float, high: float) -> float:
        """Return the mean square between two frequencies, Hz."""
        total = 0.0
        for k in self._positive:
            power = self._powers[k]
            begin, end = max(low, self.frequencies[k]), min(high, self.frequencies[k + 1])
            if begin >= end:
                continue
            scale = self.levels[k] * (begin / self.frequencies[k]) ** power * begin
            rise, turn = math.log(end / begin), power + 1.0
            total += scale * (math.expm1(turn * rise) / turn if turn else rise)
        return float(total)

    def lines(self, count: int, seed: int) -> tuple[Array, Array, Sequence[float], float]:
        """Return amplitudes, frequencies (Hz), phases (rad) of lines, and their spacing, Hz."""
        low, high = self.band
        width = (high - low) / count
        first, last = math.floor(low / width + 0.5), math.floor(high / width + 0.5)
        numbers = np.arange(max(1, first), last + 1)
        squares = np.array([self.integral((n - 0.5) * width, (n + 0.5) * width) for n in numbers])
        kept = squares > 0.0
        amplitudes: Array = np.sqrt(2.0 * squares[kept])
        rates = np.asarray(numbers[kept] * width, np.float64)
        return amplitudes, rates, random_phases(int(kept.sum()), seed), width


def random_lines(
    path: Path, count: int = LINES, seed: int = 1, quantity: str | None = None
) -> RandomLines:
    """Return the lines of the table of a density: of that `quantity`, if it is given."""
    if not 1 <= count <= MAX_HARMONICS - 1:
        raise TableError(f'{count} lines: give a number from 1 to {MAX_HARMONICS - 1}')
    wanted = LEVEL if quantity is None else _LEVELS[quantity]
    table = read_measured_table(path, {'frequency': FREQUENCY, 'level': wanted}, {'slope': _SLOPE})
    level = table.columns['level']
    density = _density(table)
    amplitudes, rates, phases, width = density.lines(count, seed)
    integral = density.integral(*density.band)
    return RandomLines(
        tuple(amplitudes.tolist()),
        tuple((math.tau * rates).tolist()),
        tuple(phases),
        math.sqrt(integral),
        1.0 / width,
        'force' if level.unit == 'N^2/Hz' else 'acceleration',
        table.described,
    )


def _density(table: MeasuredTable) -> Density:
    """Return the density of a table."""
    table.check_rising('frequency', steps=True)
    table.check_positive('frequency', zero=True)
    hertz, levels = (table.columns[key].values.copy() for key in ('frequency', 'level'))
    if 'slope' in table.columns:
        _follow_slopes(hertz, levels, table.columns['slope'].values)
        column = table.columns['level']._replace(values=levels)
        table = table._replace(columns={**table.columns, 'level': column})
    table.check_finite('level')
    table.check_positive('level', zero=True)
    if len(at_rest := np.flatnonzero((hertz == 0.0) & (levels > 0.0))):
        raise table.error(
            'frequency',
            int(at_rest[0]),
            '0 Hz: begin at the lowest frequency that is to be shaken',
        )
    above = hertz > 0.0
    hertz, levels = hertz[above], levels[above]
    between = (np.diff(hertz) > 0.0) & (levels[1:] > 0.0) & (levels[:-1] > 0.0)
    if not between.any():
        raise TableError(f'{table.source}: no band with a level above 0: give two such points')
    return Density(hertz, levels)


def _follow_slopes(hertz: Array, levels: Array, slopes: Array) -> None:
    """Fill levels by the slopes from each point to the next one, in dB per octave."""
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        ratios = 10.0 ** (0.1 * slopes[:-1] * np.diff(np.log2(hertz)))
        for k, ratio in enumerate(ratios):
            if np.isnan(levels[k + 1]):
                levels[k + 1] = levels[k] * ratio
        for k in range(len(ratios) - 1, -1, -1):
            if np.isnan(levels[k]):
                levels[k] = levels[k + 1] / ratios[k]
