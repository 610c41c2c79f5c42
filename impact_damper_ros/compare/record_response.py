# SPDX-License-Identifier: Apache-2.0
"""Motion of a rig over time, for runs under measured records."""

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
    Motion of both masses over time.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Instants, s.
    displacement : ndarray, shape (n,)
        X - b, m.
    offset : ndarray, shape (n,)
        Y, m.
    stops : ndarray, shape (n, 2)
        Y of both stops, m.
    base : tuple of float
        Displacement and velocity of the base at the end, m and m/s.
    """

    times: Array
    displacement: Array
    offset: Array
    stops: Array
    base: tuple[float, float]


class RecordSamples(Observer):
    """Samples of a run from its start."""

    def __init__(self, rig: Rig, duration: float) -> None:
        """Choose the instants."""
        self._rig = rig
        count = max(2, math.ceil(duration * rig.parameters.omega / math.tau * _LOOKS))
        self.times = np.linspace(rig.time, rig.time + duration, count + 1)
        self._taken: list[NDArray[np.void]] = []

    def instants(self) -> Iterator[float]:
        """Yield the instants of the samples, s."""
        return iter(self.times.tolist())

    def take_samples(self, samples: NDArray[np.void]) -> None:
        """Keep samples."""
        self._taken.append(samples)

    def response(self) -> RecordResponse:
        """Return the response so far."""
        sample = self._rig.sample()
        base = sample.base, sample.base_velocity
        taken = np.concatenate(self._taken)
        x = taken['x']
        stops = np.column_stack([taken['stop_1'] - x, taken['stop_2'] - x])
        return RecordResponse(self.times, x - taken['base'], taken['z'] - x, stops, base)
