# SPDX-License-Identifier: Apache-2.0
"""
Random force or motion of the base from the table of a power spectral density.

The density is a power of the frequency between two points of the table (a line in a log-log plot).
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

from .table import FREQUENCY, LEVEL, TableError, read_table

Array = NDArray[np.float64]

#: Number of lines, where none is given.
LINES = 200
#: What may be random, and the units of its density, the first in SI.
_LEVELS = {
    'acceleration': LEVEL._replace(units=('(m/s^2)^2/Hz',)),
    'force': LEVEL._replace(units=('N^2/Hz',)),
}


class RandomLines(NamedTuple):
    """
    Lines of a random signal.

    Attributes
    ----------
    amplitudes : tuple of float
        Of a force, N, or of an acceleration, m/s^2.
    frequencies, phases : tuple of float
        In rad/s and rad.
    integral : float
        Root of the integral of the table, which is the root mean square of the lines.
    period : float
        Time after which the signal repeats, s.
    quantity : {'force', 'acceleration'}
        What the table is the density of.
    """

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    phases: tuple[float, ...]
    integral: float
    period: float
    quantity: str

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

    def described(self) -> str:
        """Return band, level and period in words."""
        low, high = (rate / math.tau for rate in (self.frequencies[0], self.frequencies[-1]))
        unit, factor = ('g', STANDARD_GRAVITY) if self.quantity != 'force' else ('N', 1.0)
        count = len(self.frequencies)
        return (
            f'random {self.quantity} of {count} line{"s" * (count > 1)} from {low:.4g} Hz to '
            f'{high:.4g} Hz: {self.rms / factor:.4g} {unit} rms, '
            f'{self.integral / factor:.4g} {unit} by the integral of the table; repeats after '
            f'{self.period:.6g} s'
        )


class Density:
    """
    A power spectral density, one-sided, a power of the frequency between two points.

    Parameters
    ----------
    frequencies : array_like, shape (n,)
        Rising and positive, Hz; at least two.
    levels : array_like, shape (n,)
        Positive, in the square of a unit per Hz.
    """

    def __init__(self, frequencies: ArrayLike, levels: ArrayLike) -> None:
        self.frequencies: Array = np.asarray(frequencies, float)
        self.levels: Array = np.asarray(levels, float)
        self._powers = np.diff(np.log(self.levels)) / np.diff(np.log(self.frequencies))

    def integral(self, low: float, high: float) -> float:
        """Return the mean square between two frequencies, Hz."""
        total = 0.0
        for k, power in enumerate(self._powers):
            begin, end = max(low, self.frequencies[k]), min(high, self.frequencies[k + 1])
            if begin >= end:
                continue
            scale = self.levels[k] * (begin / self.frequencies[k]) ** power * begin
            rise, turn = math.log(end / begin), power + 1.0
            total += scale * (math.expm1(turn * rise) / turn if turn else rise)
        return float(total)

    def lines(self, count: int, seed: int) -> tuple[Array, Array, Sequence[float], float]:
        """Return amplitudes, frequencies (Hz), phases (rad) of lines, and their spacing, Hz."""
        low, high = float(self.frequencies[0]), float(self.frequencies[-1])
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
    """
    Return the lines of a random signal from the table of its density.

    Parameters
    ----------
    path : Path
        A CSV file with the columns ``f [Hz]`` and ``level [g^2/Hz]``, or the unit
        ``(m/s^2)^2/Hz`` for a base and ``N^2/Hz`` for a force.
    count : int, optional
        Number of bins into which the band is divided.
    seed : int, optional
        Seed of the phases.
    quantity : {'force', 'acceleration'}, optional
        What the table has to be the density of; either, if not given.

    Returns
    -------
    RandomLines
        The lines, which the parameters of a force or of a base take.

    Raises
    ------
    TableError
        If the table is no density.
    """
    if not 1 <= count <= MAX_HARMONICS - 1:
        raise TableError(f'{count} lines: give a number from 1 to {MAX_HARMONICS - 1}')
    wanted = LEVEL if quantity is None else _LEVELS[quantity]
    table = read_table(path, {'frequency': FREQUENCY, 'level': wanted})
    table.check_rising('frequency')
    for key in ('frequency', 'level'):
        table.check_finite(key)
        table.check_positive(key)
    level = table.columns['level']
    density = Density(table.columns['frequency'].values, level.values)
    amplitudes, rates, phases, width = density.lines(count, seed)
    integral = density.integral(float(density.frequencies[0]), float(density.frequencies[-1]))
    return RandomLines(
        tuple(amplitudes.tolist()),
        tuple((math.tau * rates).tolist()),
        tuple(phases),
        math.sqrt(integral),
        1.0 / width,
        'force' if level.unit == 'N^2/Hz' else 'acceleration',
    )
