# SPDX-License-Identifier: Apache-2.0
"""Measured records while they act on a rig: which sample is held, and until when."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from functools import lru_cache
from math import inf
from typing import Any, NamedTuple

from impact_damper_ros.measured.record import COPY, MeasuredRecord
from impact_damper_ros.parameters.parameter_spec import number_between

#: Earliest start, s.
_EARLIEST = 1e13


class Playback(NamedTuple):
    """
    A record that acts on a rig.

    Attributes
    ----------
    record : MeasuredRecord
        The record.
    start : float
        Time of its first sample, s.
    instants : list of float
        Since when each value acts, s; infinity after the last one.
    values : list of float
        These values, the last one is 0.
    """

    record: MeasuredRecord
    start: float
    instants: list[float]
    values: list[float]

    @classmethod
    def begin(cls, record: MeasuredRecord, start: float) -> Playback:
        """Return a record that starts at a time."""
        starts, values = record.steps()
        record = record if record.copy else record.with_copy()
        return cls(record, start, [*(start + since for since in starts), inf], list(values))

    def step_at(self, time: float) -> int:
        """Return which value acts at a time, after any step at that time."""
        return max(0, bisect_right(self.instants, time) - 1)

    def as_dict(self) -> dict[str, Any]:
        """Return the record, and when it began to act, as texts and a number."""
        return {'start': self.start, **dict(self.record.copy)}

    @classmethod
    def of_dict(cls, stored: Mapping[str, Any], time: float) -> Playback:
        """Return a record that acts at a time, s, from what `as_dict` wrote."""
        start = number_between('records.start', stored['start'], -_EARLIEST, time)
        return _begin(start, *(stored[key] for key in COPY))


@lru_cache(maxsize=8)
def _begin(start: float, *texts: str) -> Playback:
    """Return a record that starts at a time, from its copy, which many snapshots have."""
    return Playback.begin(MeasuredRecord.of_copy(dict(zip(COPY, texts, strict=True))), start)
