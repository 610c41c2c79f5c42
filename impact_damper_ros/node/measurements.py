# SPDX-License-Identifier: Apache-2.0
"""What a controller outside the node is shown: samples of the sensors, on their way to it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from impact_damper_ros.bag.rig_topics import RigMessages
from impact_damper_ros.control import Rig
from impact_damper_ros.control.sensors import mixed_bits, mixed_seed, uniform_of
from impact_damper_ros.rig import NodeSettings
from impact_damper_ros.rig.tick_grid import TickGrid

#: Of the random numbers of a sample, those that are not noise.
_LOSS, _JITTER = 5, 6


class Sent(NamedTuple):
    """A measurement on its way: when it is published, rig time in ns, its stamp and content."""

    due_ns: int
    stamp_ns: int
    content: bytes


class Measurements:
    """
    Samples of the sensors at their own rate, with latency, jitter and losses.

    All that is random is a function of the seed of the sensors and the index of the sample.

    Parameters
    ----------
    rate : float
        Samples per second of rig time; 0 for none.
    """

    def __init__(self, rate: float) -> None:
        self._grid = TickGrid(rate) if rate else None
        self._encoder = RigMessages()
        self._index = 0
        self._on_the_way: deque[Sent] = deque()
        # Of the last sample, for a frozen sensor
        self._seen: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    def next_ns(self) -> int | None:
        """Return the rig time at which the next one is taken or published, ns."""
        if self._grid is None:
            return None
        sample_ns = self._grid.instant(self._index)
        return min(sample_ns, self._on_the_way[0].due_ns) if self._on_the_way else sample_ns

    def take(self, rig: Rig, settings: NodeSettings, time_ns: int, offset_ns: int) -> list[Sent]:
        """Take the sample that is due at an instant; return those that are published then."""
        if self._grid is None:
            return []
        # After a start the first one may be past.
        while (sample_ns := self._grid.instant(self._index)) <= time_ns:
            if sample_ns == time_ns:
                self._sample(rig, settings, time_ns, offset_ns)
            self._index += 1
        due = []
        while self._on_the_way and self._on_the_way[0].due_ns <= time_ns:
            due.append(self._on_the_way.popleft())
        return due

    def _sample(self, rig: Rig, settings: NodeSettings, time_ns: int, offset_ns: int) -> None:
        control = rig.control
        late_s, jitter_s = settings.measurement_latency, settings.measurement_jitter
        if settings.measurement_loss or jitter_s:
            key = mixed_bits(mixed_seed(control.gap_control_seed) ^ self._index)
            late_s += jitter_s * uniform_of(mixed_bits(key + _JITTER))
            if uniform_of(mixed_bits(key + _LOSS)) <= settings.measurement_loss:
                return
        if control.sensor_fault == 'dropout':
            return
        if control.sensor_fault != 'frozen' or self._seen is None:
            seen, stop_rates = rig.measure(self._index)
            self._seen = (
                (seen.x, seen.y, seen.stop_1, seen.stop_2),
                (seen.x_rate, seen.y_rate, *stop_rates),
            )
        stamp_ns = offset_ns + time_ns
        content = self._encoder.measurement(stamp_ns, *self._seen)
        due_ns = time_ns + round(late_s * 1e9)
        if self._on_the_way:
            # None overtakes the one before.
            due_ns = max(due_ns, self._on_the_way[-1].due_ns)
        self._on_the_way.append(Sent(due_ns, stamp_ns, content))
