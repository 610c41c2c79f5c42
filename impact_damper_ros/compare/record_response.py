# SPDX-License-Identifier: Apache-2.0
"""
Response of a rig to measured records, beside that to every second sample of them.

What a rig is given is held between samples. The error of that is of the second order in their
interval; the record of every second sample has four times of it, so that the error is about a
third of the difference, as long as the motion is regular. Where impacts follow irregularly, any
difference grows until both motions are as different as two runs of a chaotic rig: peaks and means
then still compare.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig.observed_run import Observer
from impact_damper_ros.rig.rig import Rig

Array = NDArray[np.float64]

#: Samples in a natural cycle of M.
_LOOKS = 64
#: Part of the largest displacement by which two motions are no longer the same.
APART = 0.01


class RecordResponse(NamedTuple):
    """
    Displacement of M from its base under records, and under every second sample of them.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Instants, s.
    displacement, halved : ndarray, shape (n,)
        X - b under the records, and under every second sample of them, m.
    base : tuple of float
        Displacement and velocity of the base at the end, m and m/s.
    """

    times: Array
    displacement: Array
    halved: Array
    base: tuple[float, float]

    @property
    def apart_from(self) -> float:
        """Since when both differ by `APART` of the largest displacement, s; infinite if never."""
        most = APART * float(np.abs(self.displacement).max())
        wrong = np.flatnonzero(np.abs(self.halved - self.displacement) > most)
        return float(self.times[wrong[0]]) if len(wrong) else math.inf


class RecordSamples(Observer):
    """Samples of X - b of a run from its start."""

    def __init__(self, rig: Rig, duration: float) -> None:
        """Choose the instants."""
        self._rig = rig
        count = max(2, math.ceil(duration * rig.parameters.omega / math.tau * _LOOKS))
        self.times = np.linspace(rig.time, rig.time + duration, count + 1)
        self._instants: list[float] = self.times.tolist()
        self.displacement: list[float] = []

    def ticks(self) -> Iterator[float]:
        """Yield the instants of the samples, s."""
        return iter(self._instants)

    def reached(self, instant: float) -> None:
        """Take a sample."""
        taken = len(self.displacement)
        if taken < len(self._instants) and instant == self._instants[taken]:
            sample = self._rig.sample()
            self.displacement.append(sample.x - sample.base)

    def beside(self, other: RecordSamples) -> RecordResponse:
        """Return the response, with that of a run under every second sample."""
        sample = self._rig.sample()
        return RecordResponse(
            self.times,
            np.array(self.displacement),
            np.array(other.displacement),
            (sample.base, sample.base_velocity),
        )
