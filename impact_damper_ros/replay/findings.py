# SPDX-License-Identifier: Apache-2.0
"""The findings of a replay: counts, differences, and a verdict."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass, field
from enum import Enum
from math import isfinite, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.quoting import quote

#: Differences kept after each change of the rig, and remarks and faults kept.
_MOST_KEPT = 20
#: Names of whole messages that are only recorded, or only in the replay.
WHOLE = IMPACT, ACT = 'impact', 'act of the gap control'

Array = NDArray[np.float64]


class ReplayVerdict(Enum):
    """Verdict on a replay."""

    IDENTICAL = 'identical'
    #: Equal within the round-off of another machine, or of another arithmetic.
    WITHIN_ROUND_OFF = 'within_round_off'
    #: One of these two, as far as the bag can be compared.
    PARTIAL = 'partial'
    DIFFERENT = 'different'

    @property
    def exit_code(self) -> int:
        """The exit code of `replay_run`."""
        return {'different': 1, 'partial': 3}.get(self.value, 0)


@dataclass(frozen=True)
class Difference:
    """
    A recorded value that is not the replayed one.

    Attributes
    ----------
    time : float
        Rig time, s.
    stamp_ns : int
        Stamp of the message.
    topic, quantity, unit : str
        The quantity that differs.
    recorded, replayed : object
        Both values; None where there is none.
    after : str
        The last change or reset before.
    """

    time: float
    stamp_ns: int
    topic: str
    quantity: str
    unit: str
    recorded: Any
    replayed: Any
    after: str

    @property
    def amount(self) -> float:
        """Recorded minus replayed value; NaN where it is no finite number."""
        if isinstance(self.recorded, int | float) and isinstance(self.replayed, int | float):
            with suppress(OverflowError):
                return float(self.recorded - self.replayed)
        return nan

    @property
    def text(self) -> str:
        """A sentence with both values."""
        where = f'{self.quantity} on {self.topic} at {self.time:.9g} s'
        if self.recorded is None and self.quantity in WHOLE:
            return f'{where} is missing in the log ({self.replayed})'
        if self.replayed is None:
            return f'{where} is in the log, but did not happen ({self.recorded})'
        unit = f' {self.unit}' if self.unit else ''
        there, here = _text_of(self.recorded), _text_of(self.replayed)
        if there == here:
            there, here = str(self.recorded), str(self.replayed)
        return f'{where} is {there}{unit} in the log, and {here}{unit} when the log is replayed'

    def as_dict(self) -> dict[str, Any]:
        """Return the difference in types of JSON; a number that is not finite is a text."""
        plain = {name: _plain(value) for name, value in asdict(self).items()}
        difference = self.amount if isfinite(self.amount) else None
        return {**plain, 'difference': difference, 'text': self.text}


def _text_of(value: object) -> str:
    if value is None:
        return 'not given'
    if isinstance(value, float):
        return f'{value:.9g}'
    return value if isinstance(value, str) else quote(value)


def _plain(value: Any) -> Any:
    return repr(value) if isinstance(value, float) and not isfinite(value) else value


@dataclass(frozen=True)
class SampleGap:
    """A gap without samples: time of the sample before, both stamps, number of missing samples."""

    after: float  # rig time, s
    from_stamp_ns: int
    to_stamp_ns: int
    missing: int


@dataclass
class Divergence:
    """How replayed and recorded joint states diverge."""

    #: Rig times of the first and the last sample that differs, s.
    first: float = nan
    last: float = nan
    samples: int = 0  # number of samples that differ
    #: Largest differences of X and Z, m.
    largest_x: float = 0.0
    largest_z: float = 0.0

    def take(self, times: Array, x: Array, z: Array) -> None:
        """Take samples that differ by `x` and `z`, m, at instants, s."""
        if not len(times):
            return
        if not self.samples:
            self.first = float(times[0])
        self.samples += len(times)
        self.last = float(times[-1])
        with np.errstate(over='ignore', invalid='ignore'):
            self.largest_x = max(self.largest_x, float(np.abs(x).max()))
            self.largest_z = max(self.largest_z, float(np.abs(z).max()))


@dataclass
class Findings:
    """
    The findings of a replay.

    Attributes
    ----------
    samples, impacts : int
        Numbers of samples and impacts that were compared.
    recorded_impacts : int
        Number of impacts in the bag, from its start on.
    gap_control, recorded_gap_control, missing_gap_control : int
        Like `impacts`, `recorded_impacts` and `missing_impacts`, for acts of the gap control.
    changes, resets, pauses, slips, snapshots : int
        Other counts.
    start_ns, end_ns : int or None
        Rig times of the first and last sample, in nanoseconds.
    differences : list of Difference
        The first ones after each change of the rig, and the first one of each topic.
    difference_count : int
        Number of all differences.
    by_topic : dict of str to int
        Number of differences of each topic.
    divergence : Divergence
        Divergence of the joint states.
    gaps : list of SampleGap
        The first gaps without samples.
    missing_samples, gap_count : int
        Samples missing in all gaps, and number of gaps.
    missing_impacts : int
        Impacts of the replay that are not in the bag, where the recorder has dropped messages.
    remarks : list of str
        Remarks, such as on initial conditions taken from a snapshot.
    faults : list of str
        Why only a part of the bag could be compared.
    after : str
        The last change or reset.
    offset_ns : int
        Present stamp at rig time 0, in nanoseconds.
    other_bits : str
        Why the replay cannot have the last bits of the recording; empty if it can. The numbers
        are then compared with the replay within the errors of round-off.
    undecided : int
        Flights that are not compared with the replay, since round-off may change their events.
    unchecked : tuple of str
        Topics of the bag that were not compared.
    """

    samples: int = 0
    impacts: int = 0
    recorded_impacts: int = 0
    gap_control: int = 0
    recorded_gap_control: int = 0
    missing_gap_control: int = 0
    changes: int = 0
    resets: int = 0
    pauses: int = 0
    slips: int = 0
    snapshots: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    differences: list[Difference] = field(default_factory=list)
    difference_count: int = 0
    by_topic: dict[str, int] = field(default_factory=dict)
    divergence: Divergence = field(default_factory=Divergence)
    gaps: list[SampleGap] = field(default_factory=list)
    gap_count: int = 0
    missing_samples: int = 0
    missing_impacts: int = 0
    remarks: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    after: str = 'the start of the bag'
    offset_ns: int = 0
    other_bits: str = ''
    undecided: int = 0
    unchecked: tuple[str, ...] = ()
    _kept_after: str = ''
    _kept_count: int = 0

    @property
    def verdict(self) -> ReplayVerdict:
        """The verdict: whether the replay reproduces everything recorded."""
        if self.difference_count:
            return ReplayVerdict.DIFFERENT
        if self.faults:
            return ReplayVerdict.PARTIAL
        return ReplayVerdict.WITHIN_ROUND_OFF if self.other_bits else ReplayVerdict.IDENTICAL

    @property
    def first(self) -> Difference | None:
        """The earliest difference."""
        return min(self.differences, key=lambda d: d.time, default=None)

    def differ(
        self,
        stamp_ns: int,
        topic: str,
        quantity: str,
        unit: str,
        recorded: object,
        replayed: object,
    ) -> None:
        """Add a difference."""
        time = (stamp_ns - self.offset_ns) / 1e9
        values = quantity, unit, recorded, replayed
        difference = Difference(time, stamp_ns, topic, *values, self.after)
        self.difference_count += 1
        first = topic not in self.by_topic
        self.by_topic[topic] = self.by_topic.get(topic, 0) + 1
        if self.after != self._kept_after:
            self._kept_after, self._kept_count = self.after, 0
        self._kept_count += 1
        if self._kept_count <= _MOST_KEPT or first:
            self.differences.append(difference)

    def fault(self, text: str) -> None:
        """Add a reason why only a part of the bag can be compared."""
        if len(self.faults) < _MOST_KEPT:
            self.faults.append(text)

    def remark(self, text: str) -> None:
        """Add a remark."""
        if len(self.remarks) < _MOST_KEPT:
            self.remarks.append(text)

    def miss(self, gap: SampleGap) -> None:
        """Add a gap without samples."""
        self.gap_count += 1
        self.missing_samples += gap.missing
        if len(self.gaps) < _MOST_KEPT:
            self.gaps.append(gap)
