"""Recorded against replayed joint states, one by one, and the samples that are missing."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from .cdr import CdrError
from .impact_ledger import bits
from .joint_state_bytes import JointStateBytes, header_ns
from .replay_findings import Difference, Findings, SampleGap
from .rig_messages import JOINTS

__all__ = ['SampleCheck', 'SampleSpacing']

_QUANTITIES = (
    *((f'position of {joint}', 'm') for joint in JOINTS),
    *((f'velocity of {joint}', 'm/s') for joint in JOINTS),
)
_Numbers = tuple[tuple[float, ...], ...]
#: Samples from which the period is learnt if the bag does not tell the rate.
_LEARNT_FROM = 50


class SampleCheck:
    """
    Compares joint states.

    Parameters
    ----------
    topic : str
        Their topic.
    findings : Findings
        Takes what is found.
    """

    def __init__(self, topic: str, findings: Findings) -> None:
        self._topic = topic
        self._findings = findings
        self._shape: JointStateBytes | None = None

    def numbers(self, content: bytes) -> tuple[tuple[float, ...], ...]:
        """
        Return positions and velocities of a recorded message.

        Raises
        ------
        CdrError
            If it is not a joint state of a rig.
        """
        return self._shape_of(content).numbers(content)

    def compare(
        self,
        stamp_ns: int,
        content: bytes,
        time: float,
        numbers: _Numbers,
        before: Sequence[_Numbers] = (),
    ) -> None:
        """
        Compare a recorded message with the replayed sample.

        Parameters
        ----------
        stamp_ns : int
            The stamp that it should have.
        content : bytes
            The message.
        time : float
            Rig time, s.
        numbers : tuple
            Positions and velocities that it should hold.
        before : sequence of tuple, optional
            Those that it may hold instead, from just before changes at the same instant.

        Raises
        ------
        CdrError
            If it is not a joint state of a rig.
        """
        shape = self._shape or self._shape_of(content)
        self._findings.samples += 1
        if shape.filled(stamp_ns, *numbers) == content:
            return
        shape = self._shape_of(content)
        if any(shape.filled(stamp_ns, *other) == content for other in before):
            return
        self._note_differences(stamp_ns, content, time, numbers)

    def _shape_of(self, content: bytes) -> JointStateBytes:
        shape = self._shape
        if shape is None or not shape.fits(content):
            shape = JointStateBytes(content)
            if shape.names != JOINTS or shape.counts[:2] != (4, 4):
                held = ', '.join(shape.names) or 'none'
                raise CdrError(f'its joints are {held}, not {", ".join(JOINTS)}')
            self._shape = shape
        return shape

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
        for (name, unit), a, b in zip(_QUANTITIES, there, here, strict=True):
            if bits(a) != bits(b):
                differing.append((name, unit, a, b))
                values_differ = True
        if not differing and (frame := self._shape_of(content).frame_id):
            findings.differ(
                Difference(time, stamp_ns, self._topic, 'frame_id', '', frame, '', findings.after)
            )
        if not differing:
            # Only what the message does not need to hold, such as efforts.
            return
        # What differs most says more than what is first in the message.
        differences = [
            Difference(time, stamp_ns, self._topic, quantity, unit, a, b, findings.after)
            for quantity, unit, a, b in differing
        ]
        findings.differ(max(differences, key=lambda difference: difference.ulps))
        if values_differ:
            size = max(map(abs, here[:4]))
            findings.divergence.look(time, there[0] - here[0], there[1] - here[1], size)


class SampleSpacing:
    """
    Finds where samples are missing.

    Parameters
    ----------
    findings : Findings
        Takes what is found.

    Attributes
    ----------
    period_ns : float
        Rig time from one sample to the next; 0 as long as it is not known.
    """

    def __init__(self, findings: Findings) -> None:
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

    def look(self, time_ns: int, stamp_ns: int) -> list[SampleGap]:
        """
        Take the next sample.

        Parameters
        ----------
        time_ns, stamp_ns : int
            Its rig time and stamp.

        Returns
        -------
        list of SampleGap
            Gaps that are known by now, usually none.
        """
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
        """Judge the first samples, whose period was not known, by the shortest step among them."""
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
