"""The findings of a replay: counts, differences, and how they grow."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from math import inf, nan, ulp
from typing import Any

#: Differences kept one by one.
_MOST_KEPT = 20
#: Differences kept after each change of the rig.
_KEPT_EACH = 20
#: Differing samples after which the difference is noted.
_MARKS = tuple(m * 10**k for k in range(8) for m in (1, 2, 5))
#: Differences of so few units in the last place indicate another library of mathematics.
_LIBRARY_ULPS = 8
#: Such differences grow slowly: number of the first differing samples, and their tolerance.
_EARLY, _ROUND_OFF = 10, 1e-9


class ReplayVerdict(Enum):
    """Verdict on a replay; the value is the exit code."""

    IDENTICAL = 0
    DIFFERENT = 1
    #: Identical as far as the bag can be compared.
    PARTIAL = 3


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
        """Recorded minus replayed value; NaN where these are no numbers."""
        if isinstance(self.recorded, int | float) and isinstance(self.replayed, int | float):
            return self.recorded - self.replayed
        return nan

    @property
    def ulps(self) -> float:
        """The same in units of the last place of the replayed value."""
        if isinstance(self.replayed, float) and isinstance(self.recorded, float):
            return abs(self.amount) / ulp(self.replayed)
        return inf


@dataclass(frozen=True)
class SampleGap:
    """A gap without samples: the stamps before and after it, and how many are missing."""

    time: float
    from_ns: int
    to_ns: int
    missing: int


@dataclass
class Divergence:
    """How replayed and recorded joint states diverge."""

    #: Rig times of the first and the last sample that differs, s.
    first: float = nan
    last: float = nan
    samples: int = 0  # how many do
    #: Largest differences of X and Z, m.
    largest_x: float = 0.0
    largest_z: float = 0.0
    #: Number of differing samples, rig time, s, and the differences of X and Z there, m.
    marks: list[tuple[int, float, float, float]] = field(default_factory=list)
    #: Largest difference among the first samples that differ, as a part of the positions.
    early: float = 0.0

    def take(self, time: float, x: float, z: float, size: float) -> None:
        """Take a sample that differs by `x` and `z`, of positions of some size, m."""
        if not self.samples:
            self.first = time
        self.samples += 1
        if self.samples <= _EARLY:
            difference = max(abs(x), abs(z))
            self.early = max(self.early, difference / size if size else difference)
        self.last = time
        self.largest_x = max(self.largest_x, abs(x))
        self.largest_z = max(self.largest_z, abs(z))
        if self.samples in _MARKS:
            self.marks.append((self.samples, time, x, z))


@dataclass
class Findings:
    """
    The findings of a replay.

    Attributes
    ----------
    samples, impacts : int
        How many were compared.
    recorded_impacts : int
        How many the bag holds, from its start on.
    control, recorded_control, missing_control : int
        The same, and `missing_impacts`, for acts of the gap control.
    changes, resets, pauses, slips, snapshots : int
        Other counts.
    start_ns, end_ns : int or None
        Rig times of the first and last sample, in nanoseconds.
    differences : list of Difference
        The first ones.
    kept : list of Difference
        The first ones after each change of the rig.
    difference_count : int
        How many there are.
    by_topic : dict of str to int
        The same for each topic.
    divergence : Divergence
        Of the joint states.
    gaps : list of SampleGap
        The first gaps without samples.
    missing_samples, gap_count : int
        Samples missing in all of them, and their number.
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
    """

    samples: int = 0
    impacts: int = 0
    recorded_impacts: int = 0
    control: int = 0
    recorded_control: int = 0
    missing_control: int = 0
    changes: int = 0
    resets: int = 0
    pauses: int = 0
    slips: int = 0
    snapshots: int = 0
    start_ns: int | None = None
    end_ns: int | None = None
    differences: list[Difference] = field(default_factory=list)
    kept: list[Difference] = field(default_factory=list)
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
    _kept_after: str = ''
    _kept_count: int = 0

    @property
    def verdict(self) -> ReplayVerdict:
        """Whether everything recorded is reproduced."""
        if self.difference_count:
            return ReplayVerdict.DIFFERENT
        return ReplayVerdict.PARTIAL if self.faults else ReplayVerdict.IDENTICAL

    @property
    def first(self) -> Difference | None:
        """The earliest difference."""
        return min(self.differences, key=lambda d: d.time, default=None)

    @property
    def by_another_library(self) -> bool:
        """Whether the differences indicate another library of mathematics."""
        return (
            self.first is not None
            and self.first.ulps <= _LIBRARY_ULPS
            and self.divergence.samples > 1
            and self.divergence.early <= _ROUND_OFF
            and not self.faults
        )

    def differ(self, difference: Difference) -> None:
        """Add a difference."""
        self.difference_count += 1
        topic = difference.topic
        self.by_topic[topic] = self.by_topic.get(topic, 0) + 1
        if self.after != self._kept_after:
            self._kept_after, self._kept_count = self.after, 0
        self._kept_count += 1
        if self._kept_count <= _KEPT_EACH:
            self.kept.append(difference)
        # The first of every topic is kept in any case.
        if len(self.differences) < _MOST_KEPT or self.by_topic[topic] == 1:
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
