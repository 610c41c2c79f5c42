# SPDX-License-Identifier: Apache-2.0
"""
Transmissibility of a rig on a base with many lines of motion, by the method of Welch.

The lines of a random base are multiples of one frequency. The spectrum over one period of that
frequency has a value at each line, into which no other line leaks. The spectra of X, X - b and b
are averaged over stretches of one period (Welch 1967, *IEEE Trans. Audio Electroacoust.* 15(2),
70-73; without overlap and window), and their ratio at each line is the square of the
transmissibility there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.transmissibility import dynamic_stiffness
from impact_damper_ros.rig.observed_run import Observer
from impact_damper_ros.rig.rig import Rig

Array = NDArray[np.float64]

#: Samples in a cycle of the fastest line, at least.
_SAMPLES = 8
#: Part of a multiple of the lowest frequency by which a line may miss it.
_OFF = 1e-6
#: Most lines that are compared with multiples of a frequency.
_MOST_MULTIPLE = 1_000_000
#: Part of a free vibration that may be left where the averages begin.
_LEFT = 1e-3


class RandomResponse(NamedTuple):
    """
    Motion of M over that of its base, at each line of the base.

    Attributes
    ----------
    frequencies : ndarray, shape (n,)
        Frequencies of the lines, Hz.
    base, primary : ndarray, shape (n,)
        Spectral densities of b'' and of X'' there, (m/s^2)^2/Hz.
    absolute, relative : ndarray, shape (n,)
        Transmissibilities |X|/|b| and |X - b|/|b|.
    absolute_without, relative_without : ndarray, shape (n,)
        Transmissibilities of M alone, without the damper.
    total : tuple of float
        rms X over rms b, and rms (X - b) over rms b.
    period : float
        Period after which the base repeats, s.
    periods : int
        Number of periods in the averages.
    left_out : int
        Number of periods before these, in which the rig settles.
    left : float
        Part of a free vibration, without impacts, that is left after these.
    """

    frequencies: Array
    base: Array
    primary: Array
    absolute: Array
    relative: Array
    absolute_without: Array
    relative_without: Array
    total: tuple[float, float]
    period: float
    periods: int
    left_out: int
    left: float

    @property
    def base_rms(self) -> float:
        """Root mean square of b'', m/s^2."""
        return math.sqrt(float(self.base.sum()) / self.period)

    @property
    def primary_rms(self) -> float:
        """Root mean square of X'' at the lines, m/s^2."""
        return math.sqrt(float(self.primary.sum()) / self.period)

    def smooth(self, values: Array, lines: int = 9) -> Array:
        """Return the root of the mean square of a transmissibility over neighbouring lines."""
        window = np.ones(min(lines, len(values)))
        weights = np.convolve(self.base, window, 'same')
        return np.asarray(np.sqrt(np.convolve(values**2 * self.base, window, 'same') / weights))


def common_period(frequencies: Sequence[float]) -> float:
    """Return the period after which lines repeat, s; NaN if they are no multiples of one."""
    rates = np.unique(np.array([w for w in frequencies if w > 0.0]) / math.tau)
    if len(rates) < 2:
        return math.nan
    width = float(np.diff(rates).min())
    if not rates[-1] < _MOST_MULTIPLE * width:
        return math.nan
    # The period by the highest line, which determines it best
    width = float(rates[-1]) / round(float(rates[-1]) / width)
    turns = rates / width
    if np.abs(turns - np.round(turns)).max() > _OFF * len(rates):
        return math.nan
    return 1.0 / width


class ResponseSamples(Observer):
    """
    Samples of a run on a random base, over whole periods at its end.

    Parameters
    ----------
    rig : Rig
        The rig, with a base of several lines.
    duration : float
        When the run ends, s. The first periods, in which a free vibration without impacts decays
        to a thousandth, are left out, at least one; but the last one never.

    Raises
    ------
    ValueError
        If the lines do not repeat, or not within the run.
    """

    def __init__(self, rig: Rig, duration: float) -> None:
        """Find the period of the base and the instants of the samples."""
        self._rig = rig
        base = rig.parameters.base_motion
        acting = [w for b, w in zip(base.amplitudes, base.frequencies, strict=True) if b]
        self.period = common_period(acting)
        if not math.isfinite(self.period):
            raise ValueError(
                f'the base moves by {len(acting)} line{"s" * (len(acting) != 1)} that have no '
                'common period: give base_frequencies that are multiples of one, or a --base-psd'
            )
        whole = math.floor((duration - rig.time) / self.period * (1.0 + 1e-12))
        if not whole:
            raise ValueError(
                f'the base repeats after {self.period:.6g} s: give a --duration of at least '
                f'{self.period:.6g} s, better {10.0 * self.period:.6g} s'
            )
        # The slowest decay is that with m held in the gap.
        mass = rig.parameters.primary_mass + rig.parameters.damper_mass
        self._decay = 0.5 * rig.parameters.damping / mass * self.period
        wanted = math.log(1.0 / _LEFT) / self._decay if self._decay else math.inf
        self.periods = max(1, whole - max(1, math.ceil(min(wanted, whole))))
        self._left_out = whole - self.periods
        least = self.period * max(acting) / math.tau * _SAMPLES
        self._each = 2 ** math.ceil(math.log2(least))
        self._start = max(rig.time, duration - self.periods * self.period)
        self._step = self.period / self._each
        self._lines = np.unique(np.round(np.array(acting) / math.tau * self.period).astype(int))
        self._taken: list[NDArray[np.void]] = []

    def instants(self) -> Iterator[float]:
        """Yield the instants of the samples, s."""
        return (self._start + k * self._step for k in range(self.periods * self._each))

    def take_samples(self, samples: NDArray[np.void]) -> None:
        """Keep samples."""
        self._taken.append(samples)

    def response(self) -> RandomResponse:
        """Return the transmissibility, after the run."""
        from scipy.signal import welch

        taken = np.concatenate(self._taken)
        x, base = taken['x'], taken['base']
        spectra = [
            welch(signal, 1.0 / self._step, 'boxcar', self._each, 0, detrend='constant')[1]
            for signal in (x, base, x - base)
        ]
        own, shaken, apart = (spectrum[self._lines] for spectrum in spectra)
        frequencies = self._lines / self.period
        circular = math.tau * frequencies
        rig, moved = self._rig.parameters, np.std(base)
        with np.errstate(divide='ignore'):
            alone = 1.0 / np.abs(dynamic_stiffness(rig, circular))
        return RandomResponse(
            frequencies,
            shaken * circular**4,
            own * circular**4,
            np.sqrt(own / shaken),
            np.sqrt(apart / shaken),
            alone * np.abs(dynamic_stiffness(rig, circular, 0.0)),
            alone * rig.primary_mass * circular**2,
            (float(np.std(x) / moved), float(np.std(x - base) / moved)),
            self.period,
            self.periods,
            self._left_out,
            math.exp(-self._decay * self._left_out),
        )
