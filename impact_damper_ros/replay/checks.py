"""
Recorded against replayed messages: joint states, impacts, acts of the gap control.

Impacts pair one to one. Otherwise, an exact match a few impacts further on shows that some are
missing on one side; without such a match the two count as the same impact, altered.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from typing import NamedTuple

from impact_damper_ros.bag.messages import CdrError, JointStateLayout, header_ns
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS
from impact_damper_ros.control import CONTROL_JOINTS, ControlRecord

from .findings import Difference, Findings, SampleGap
from .recorded_run import Disorder

_Numbers = tuple[tuple[float, ...], ...]
#: Number of impacts within which a match is searched.
_REACH = 16
#: Impacts of the replay that are kept until the first recorded message.
_KEPT_BEFORE = 4096
#: Gaps without samples that are remembered, to excuse the impacts missing there.
_REMEMBERED_GAPS = 64


def bits(value: float) -> bytes:
    """Return a double as it is stored, in which 0.0 and -0.0 differ."""
    return struct.pack('<d', value)


class _Expected(NamedTuple):
    """An impact, or an act of the control, of the replay."""

    stamp_ns: int
    time: float
    frame_id: str
    numbers: _Numbers
    after: str


class _Recorded(NamedTuple):
    """A message of the bag."""

    stamp_ns: int
    content: bytes
    layout: JointStateLayout

    def equals(self, expected: _Expected) -> bool:
        return (
            self.layout.frame_id == expected.frame_id
            and self.layout.filled(expected.stamp_ns, *expected.numbers) == self.content
        )


class ImpactMatcher:
    """
    Pairs the impacts of a bag with those of its replay.

    The recorder of a bag that is not stamped with rig time may not have received a missing impact.
    """

    what = 'impact'
    joints: tuple[str, ...] = IMPACT_JOINTS
    efforts = 'N s'

    def __init__(
        self, topic: str, findings: Findings, disorder: Disorder, *, stamped: bool
    ) -> None:
        self._topic = topic
        self._findings = findings
        self._disorder = disorder
        self._stamped = stamped
        self._recorded: deque[_Recorded] = deque()
        # The last message that left the queue
        self._before = b''
        self._expected: deque[_Expected] = deque()
        self._layouts: list[JointStateLayout] = []
        self._gaps: deque[SampleGap] = deque(maxlen=_REMEMBERED_GAPS)
        self._begun = stamped
        self._has_paired = stamped
        #: Stamp of the last recorded message
        self.last_ns = 0
        #: Impacts of the replay before the first recorded one, at which the recorder joined
        self.before_recorder = 0

    @property
    def even(self) -> bool:
        """Whether every impact so far has its counterpart."""
        return self._begun and not self._recorded and not self._expected

    def paired(self, contents: Sequence[bytes]) -> None:
        """Count impacts that were paired elsewhere."""
        self._findings.recorded_impacts += len(contents)
        self._findings.impacts += len(contents)
        self._before = contents[-1] if contents else self._before

    def take(self, content: bytes) -> None:
        """Take a recorded message."""
        layout = next((s for s in self._layouts if s.fits(content)), None)
        if layout is None:
            layout = JointStateLayout(content)
            if layout.names != self.joints or layout.counts != (len(self.joints),) * 3:
                raise CdrError(f'its joints are {", ".join(layout.names) or "none"}')
            self._layouts = [layout, *self._layouts[:3]]
        self.last_ns = header_ns(content)
        self._count_recorded()
        self._recorded.append(_Recorded(self.last_ns, content, layout))

    def expect(self, stamp_ns: int, time: float, stop: int, numbers: _Numbers) -> None:
        """Take an impact of the replay, with the numbers that its message should hold."""
        self._expect(stamp_ns, time, f'stop_{stop}', numbers)

    def _count_recorded(self) -> None:
        self._findings.recorded_impacts += 1

    def _count_paired(self) -> None:
        self._findings.impacts += 1

    def _count_missing(self) -> None:
        self._findings.missing_impacts += 1

    def _expect(self, stamp_ns: int, time: float, frame_id: str, numbers: _Numbers) -> None:
        after = self._findings.after
        self._expected.append(_Expected(stamp_ns, time, frame_id, numbers, after))
        if not self._begun and len(self._expected) > _KEPT_BEFORE:
            self._expected.popleft()

    def begin(self, stamp_ns: int) -> int:
        """Drop the impacts before the first sample or message; return its stamp."""
        first_ns = min([stamp_ns, *(r.stamp_ns for r in self._recorded)])
        if not self._begun:
            self._begun = True
            while self._expected and self._expected[0].stamp_ns < first_ns:
                self._expected.popleft()
        return first_ns

    def excuse(self, gap: SampleGap) -> None:
        """Take note of a gap in which messages are missing."""
        self._gaps.append(gap)

    def settle(self, *, final: bool = False) -> None:
        """Pair what can be paired."""
        recorded, expected = self._recorded, self._expected
        while recorded and expected:
            if recorded[0].equals(expected[0]):
                self._has_paired = True
                self._count_paired()
                self._before = recorded.popleft().content
                expected.popleft()
            elif final or min(len(recorded), len(expected)) > _REACH:
                self._settle_unequal()
            else:
                return
        while len(expected) > (0 if final else 4 * _REACH):
            self._missing(expected.popleft())
        while len(recorded) > (0 if final else 4 * _REACH):
            self._surplus(recorded.popleft())

    def drop_after(self, stamp_ns: int) -> None:
        """Forget the impacts of the replay after a stamp, where the bag ends."""
        while self._expected and self._expected[-1].stamp_ns > stamp_ns:
            self._expected.pop()

    def _settle_unequal(self) -> None:
        recorded, expected = self._recorded, self._expected
        # Many in a row may be missing in the bag.
        stamp_ns = recorded[0].stamp_ns
        for ahead, candidate in enumerate(islice(expected, 1, None), 1):
            if candidate.stamp_ns == stamp_ns and recorded[0].equals(candidate):
                for _ in range(ahead):
                    self._missing(expected.popleft())
                return
        for ahead, found in enumerate(islice(recorded, 1, _REACH), 1):
            if found.equals(expected[0]):
                for _ in range(ahead):
                    self._surplus(recorded.popleft())
                return
        self._has_paired = True
        self._count_paired()
        self._before = recorded[0].content
        self._altered(recorded.popleft(), expected.popleft())

    def _altered(self, recorded: _Recorded, expected: _Expected) -> None:
        for quantity, unit, there, here in self._differing(recorded, expected):
            self._differ(expected, quantity, unit, there, here)
            break

    def _missing(self, expected: _Expected) -> None:
        excused = any(g.from_ns <= expected.stamp_ns <= g.to_ns for g in self._gaps)
        if not self._has_paired:
            self.before_recorder += 1
        elif excused or not self._stamped:
            self._count_missing()
        else:
            self._differ(expected, self.what, '', None, expected.frame_id)

    def _surplus(self, recorded: _Recorded) -> None:
        findings, before = self._findings, self._before
        self._before = recorded.content
        if recorded.content == before:
            # Copied, as where recordings that overlap are joined
            self._disorder.note(self._disorder.doubled, self._topic, recorded.stamp_ns)
            return
        findings.differ(
            Difference(
                time=(recorded.stamp_ns - findings.offset_ns) / 1e9,
                stamp_ns=recorded.stamp_ns,
                topic=self._topic,
                quantity=self.what,
                unit='',
                recorded=recorded.layout.frame_id,
                replayed=None,
                after=findings.after,
            )
        )

    def _differ(
        self, expected: _Expected, quantity: str, unit: str, there: object, here: object
    ) -> None:
        self._findings.differ(
            Difference(
                time=expected.time,
                stamp_ns=expected.stamp_ns,
                topic=self._topic,
                quantity=quantity,
                unit=unit,
                recorded=there,
                replayed=here,
                after=expected.after,
            )
        )

    def _differing(
        self, recorded: _Recorded, expected: _Expected
    ) -> Iterator[tuple[str, str, object, object]]:
        """Yield the differences: quantity, unit, recorded and replayed value."""
        if recorded.stamp_ns != expected.stamp_ns:
            yield 'stamp', 'ns', recorded.stamp_ns, expected.stamp_ns
        if recorded.layout.frame_id != expected.frame_id:
            yield 'frame_id', '', recorded.layout.frame_id, expected.frame_id
        there = [v for part in recorded.layout.numbers(recorded.content) for v in part]
        here = [v for part in expected.numbers for v in part]
        names = [
            (f'{field} of {joint}', unit)
            for field, unit in (
                ('position', 'm'),
                ('velocity', 'm/s'),
                ('effort', self.efforts),
            )
            for joint in self.joints
        ]
        for (name, unit), a, b in zip(names, there, here, strict=True):
            if bits(a) != bits(b):
                yield name, unit, a, b


class ControlMatcher(ImpactMatcher):
    """Pairs the acts of the gap control of a bag with those of its replay."""

    what = 'act of the gap control'
    joints = CONTROL_JOINTS
    efforts = 'J'

    def expect_record(self, stamp_ns: int, record: ControlRecord) -> None:
        """Take an act of the replay."""
        self._expect(stamp_ns, record.time, record.frame_id, record.numbers)

    def _count_recorded(self) -> None:
        self._findings.recorded_control += 1

    def _count_paired(self) -> None:
        self._findings.control += 1

    def _count_missing(self) -> None:
        self._findings.missing_control += 1


#: Samples from which the period is estimated if the rate is not known.
_LEARNT_FROM = 50


class SampleCheck:
    """Compares joint states."""

    def __init__(self, topic: str, findings: Findings) -> None:
        self._topic = topic
        self._findings = findings
        self._layout: JointStateLayout | None = None

    def numbers(self, content: bytes) -> tuple[tuple[float, ...], ...]:
        """Return positions and velocities of a recorded message."""
        return self._layout_of(content).numbers(content)

    def compare(
        self,
        stamp_ns: int,
        content: bytes,
        time: float,
        numbers: _Numbers,
        before: Sequence[_Numbers] = (),
    ) -> None:
        """Compare a recorded message with the replayed sample."""
        layout = self._layout or self._layout_of(content)
        self._findings.samples += 1
        if layout.filled(stamp_ns, *numbers) == content:
            return
        layout = self._layout_of(content)
        if any(layout.filled(stamp_ns, *other) == content for other in before):
            return
        self._note_differences(stamp_ns, content, time, numbers)

    def _layout_of(self, content: bytes) -> JointStateLayout:
        layout = self._layout
        if layout is None or not layout.fits(content):
            layout = JointStateLayout(content)
            if layout.names != JOINTS or layout.counts[:2] != (len(JOINTS),) * 2:
                held = ', '.join(layout.names) or 'none'
                raise CdrError(f'its joints are {held}, not {", ".join(JOINTS)}')
            self._layout = layout
        return layout

    def _note_differences(
        self, stamp_ns: int, content: bytes, time: float, numbers: _Numbers
    ) -> None:
        findings = self._findings
        positions, velocities, _ = self.numbers(content)
        differing: list[tuple[str, str, int | float, int | float]] = []
        if (within_ns := header_ns(content)) != stamp_ns:
            differing.append(('stamp', 'ns', within_ns, stamp_ns))
        there = (*positions, *velocities)
        here = sum(numbers, ())
        values_differ = False
        units = {'incline': 'rad'}
        names = [
            (f'{what} of {joint}', units.get(joint, 'm') + per)
            for what, per in (('position', ''), ('velocity', '/s'))
            for joint in JOINTS
        ]
        for (name, unit), a, b in zip(names, there, here, strict=True):
            if bits(a) != bits(b):
                differing.append((name, unit, a, b))
                values_differ = True
        if not differing and (frame := self._layout_of(content).frame_id):
            findings.differ(
                Difference(time, stamp_ns, self._topic, 'frame_id', '', frame, '', findings.after)
            )
        if not differing:
            # Only optional content differs, such as efforts.
            return
        # The largest difference is the most telling one.
        differences = [
            Difference(time, stamp_ns, self._topic, quantity, unit, a, b, findings.after)
            for quantity, unit, a, b in differing
        ]
        findings.differ(max(differences, key=lambda difference: difference.ulps))
        if values_differ:
            size = max(map(abs, here[:4]))
            findings.divergence.take(time, there[0] - here[0], there[1] - here[1], size)


class SampleSpacing:
    """Finds gaps without samples."""

    def __init__(self, findings: Findings) -> None:
        #: Rig time from one sample to the next; 0 if not known yet
        self.period_ns = 0.0
        self._findings = findings
        self._early: list[tuple[int, int, int]] = []

    def even(self, times_ns: Sequence[int]) -> bool:
        """Return whether samples follow the last one without a gap."""
        last_ns = self._findings.end_ns
        if last_ns is None or self._early or not self.period_ns:
            return False
        steps = [after - before for before, after in pairwise([last_ns, *times_ns])]
        return min(steps) > 0 and max(steps) <= 1.5 * self.period_ns

    def take(self, time_ns: int, stamp_ns: int) -> list[SampleGap]:
        """Take the next sample."""
        last_ns = self._findings.end_ns
        self._findings.end_ns = time_ns
        if last_ns is None:
            self._findings.start_ns = time_ns
            return []
        if self.period_ns and not self._early:
            if time_ns - last_ns <= 1.5 * self.period_ns:
                return []
            return self._gaps([(last_ns, time_ns, stamp_ns)])
        self._early.append((last_ns, time_ns, stamp_ns))
        return self.close() if self.period_ns or len(self._early) == _LEARNT_FROM else []

    def close(self) -> list[SampleGap]:
        """Check the first samples by the shortest step among them, if the period was not known."""
        steps = [after - before for before, after, _ in self._early if after > before]
        early, self._early = self._early, []
        if not self.period_ns and steps:
            self.period_ns = float(min(steps))
        return self._gaps(early)

    def _gaps(self, steps: list[tuple[int, int, int]]) -> list[SampleGap]:
        gaps = []
        for before_ns, after_ns, stamp_ns in steps:
            step = after_ns - before_ns
            if self.period_ns and step > 1.5 * self.period_ns:
                missing = round(step / self.period_ns) - 1
                gaps.append(SampleGap(before_ns / 1e9, stamp_ns - step, stamp_ns, missing))
        for gap in gaps:
            self._findings.miss(gap)
        return gaps
