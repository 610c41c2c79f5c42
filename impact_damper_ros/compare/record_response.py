# SPDX-License-Identifier: Apache-2.0
"""Response of a rig to measured records."""

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


class RecordResponse(NamedTuple):
    """
    Displacement of M from its base under measured records.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Instants, s.
    displacement : ndarray, shape (n,)
        X - b, m.
    base : tuple of float
        Displacement and velocity of the base at the end, m and m/s.
    """

    times: Array
    displacement: Array
    base: tuple[float, float]


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

    def response(self) -> RecordResponse:
        """Return the response so far."""
        sample = self._rig.sample()
        base = sample.base, sample.base_velocity
        return RecordResponse(self.times, np.array(self.displacement), base)
