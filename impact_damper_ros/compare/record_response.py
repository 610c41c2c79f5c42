# SPDX-License-Identifier: Apache-2.0
"""Motion of a rig over time, as it is drawn, and sized under measured records."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.measured.record import BASE_RECORD
from impact_damper_ros.motion.event import Event
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
        X, m; X - b if a record moves the base.
    name : str
        Which of them it is, 'X' or 'X - b'.
    offset : ndarray, shape (2, m)
        Instants of the samples and of all events, s, and Y there, m.
    stops : ndarray, shape (n, 2)
        Y of both stops, m.
    base : tuple of float
        Displacement and velocity of the base at the end, m and m/s.
    """

    times: Array
    displacement: Array
    name: str
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
        self._passed: list[tuple[float, float]] = []

    def instants(self) -> Iterator[float]:
        """Yield the instants of the samples, s."""
        return iter(self.times.tolist())

    def take_events(self, events: Sequence[Event]) -> None:
        """Keep where m is at events: between samples it reaches the stops and leaves them."""
        self._passed += [(event.time, event.y) for event in events]

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
        offset = np.array([*zip(self.times, taken['z'] - x, strict=True), *self._passed]).T
        offset = offset[:, np.argsort(offset[0], kind='stable')]
        carried = any(r.quantity == BASE_RECORD for r in self._rig.measured_records)
        name, place = ('X - b', x - taken['base']) if carried else ('X', x)
        return RecordResponse(self.times, place, name, offset, stops, base)
