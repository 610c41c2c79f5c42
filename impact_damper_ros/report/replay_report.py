"""What `replay_run` reports: the findings of a replay, and of a what-if, as text and as JSON."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.replay.findings import Difference, Findings, Verdict
from impact_damper_ros.replay.recorded_run import RecordedRun
from impact_damper_ros.replay.what_if import RecordedValues
from impact_damper_ros.rig import Event, EventKind, Sample
from impact_damper_ros.rig.shown import as_line
from impact_damper_ros.rig.swing import Swing

__all__ = ['Envelope', 'Response', 'as_json', 'comparison_text', 'findings_text']


class Response:
    """
    Largest and mean motion of M, impacts and their energy, from samples in a row.

    Attributes
    ----------
    samples, impacts : int
        How many there were.
    energy : float
        Energy lost in the impacts, J.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.impacts = 0
        self.energy = 0.0
        self._squares = self._covered = 0.0
        # The last instant, X and X' just after it
        self._last: tuple[float, float, float] | None = None
        self._swing = Swing()

    def look(self, sample: Sample, events: Sequence[Event]) -> None:
        """Take the next sample, and the events since the one before."""
        self.samples += 1
        self._swing.look(sample, events)
        for event in events:
            self._reach(event.time, event.x, event.primary_velocity_before)
            self._last = event.time, event.x, event.primary_velocity_after
            if event.kind is EventKind.IMPACT:
                self.impacts += 1
                self.energy += lost_energy(event)
        self._reach(sample.time, sample.x, sample.primary_velocity)
        self._last = sample.time, sample.x, sample.primary_velocity

    def _reach(self, time: float, x: float, velocity: float) -> None:
        """Add the integral of X squared along the cubic from the last instant to this one."""
        if self._last is None or time <= self._last[0]:
            return
        start, x0, velocity0 = self._last
        step = time - start
        u, v = velocity0 * step, velocity * step
        squares = 156.0 * (x0 * x0 + x * x) + 4.0 * (u * u + v * v) + 108.0 * x0 * x
        squares += 44.0 * (x0 * u - x * v) + 26.0 * (x * u - x0 * v) - 6.0 * u * v
        self._squares += squares * step / 420.0
        self._covered += step

    @property
    def largest(self) -> float:
        """Largest |X|, m; also between the samples."""
        return self._swing.largest

    @property
    def rms(self) -> float:
        """Root mean square of X over time, m, also between the samples; NaN without any."""
        return math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan


def lost_energy(event: Event) -> float:
    """
    Return the kinetic energy that an impact takes, J.

    Half the impulse times what the speed of approach is more than that of separation.
    """
    approach = abs(event.damper_velocity_before - event.primary_velocity_before)
    separation = abs(event.damper_velocity_after - event.primary_velocity_after)
    return 0.5 * event.impulse * (approach - separation)


class Envelope:
    """
    A long signal, for a picture: its least and greatest values in stretches of samples.

    Parameters
    ----------
    total : int
        Samples that are to come, about.
    stretches : int
        Into how many stretches they are put, at most.
    """

    def __init__(self, total: int, stretches: int) -> None:
        self._size = max(1, math.ceil(total / stretches))
        self._count = 0
        self._time: list[float] = []
        self._low: list[float] = []
        self._high: list[float] = []

    def look(self, time: float, value: float) -> None:
        """Take the next sample."""
        if self._count % self._size == 0:
            self._time.append(time)
            self._low.append(value)
            self._high.append(value)
        elif value < self._low[-1]:
            self._low[-1] = value
        elif value > self._high[-1]:
            self._high[-1] = value
        self._count += 1

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the times at which the stretches begin, and their least and greatest values."""
        return np.array(self._time), np.array(self._low), np.array(self._high)


#: Changes of a held parameter that are listed.
_MOST_VALUES = 20

_VERDICTS = {
    Verdict.IDENTICAL: 'identical: the run is reproduced bit for bit from its log',
    Verdict.DIFFERENT: 'DIFFERENT: the run is not reproduced from its log',
    Verdict.PARTIAL: 'identical as far as it could be compared; the bag is not whole',
}


def _count(number: int, noun: str) -> str:
    return f'{number} {noun}{"" if number == 1 else "s"}'


def _value(value: Any, unit: str) -> str:
    if value is None:
        return 'none'
    return f'{value!r} {unit}'.rstrip()


def _difference_lines(first: Difference, start: float) -> list[str]:
    lines = [
        f'first at    rig time {first.time:.9f} s, {first.time - start:.9f} s into the bag '
        f'(stamp {first.stamp_ns} ns)',
        f'            {first.topic}, {first.quantity}',
        f'  recorded  {_value(first.recorded, first.unit)}',
        f'  replayed  {_value(first.replayed, first.unit)}',
    ]
    if not math.isnan(first.amount):
        ulps = f', {first.ulps:.4g} units in the last place' if first.ulps < 1e6 else ''
        lines.append(f'  difference {first.amount:.6g} {first.unit}'.rstrip() + ulps)
    lines.append(f'  after     {first.after}')
    return lines


def _divergence_lines(findings: Findings) -> list[str]:
    divergence = findings.divergence
    if not divergence.samples:
        return []
    lines = [
        f'samples     {divergence.samples} of {findings.samples} differ, from '
        f'{divergence.first:.9f} s to {divergence.last:.9f} s; up to {divergence.largest_x:.3g} m '
        f'in X and {divergence.largest_z:.3g} m in Z'
    ]
    end = (findings.end_ns or 0) / 1e9
    if divergence.last < end:
        lines.append('            after that, all samples are as recorded again')
    if len(divergence.marks) > 1:
        lines.append('growth      sample   rig time [s]     X [m]       Z [m]')
        lines += [
            f'            {number:>6}   {time:<14.6f} {x:> .3e}  {z:> .3e}'
            for number, time, x, z in divergence.marks
        ]
    if findings.by_another_library:
        lines.append(
            'hint        it begins in the last place: the bag may have been recorded where the '
            'mathematical functions (C library) round otherwise'
        )
    return lines


def findings_text(findings: Findings, recorded: RecordedRun) -> str:
    """Return what was compared, what was found, and the verdict."""
    start, end = (findings.start_ns or 0) / 1e9, (findings.end_ns or 0) / 1e9
    node = recorded.topics.name
    impacts = _count(findings.impacts, 'impact')
    if not recorded.topics.impacts:
        impacts = 'no impacts (their topic was not recorded)'
    if findings.recorded_control or findings.control:
        impacts += f', {_count(findings.control, "act")} of the gap control'
    lines = [
        f'replayed    {recorded.reader.path}, node {node}',
        f'compared    {_count(findings.samples, "sample")}, {impacts}, '
        f'{_count(findings.snapshots, "snapshot")}',
        f'time span   {start:.9g} s to {end:.9g} s of rig time',
        f'meanwhile   {_count(findings.changes, "change")}, {_count(findings.resets, "reset")}, '
        f'{_count(findings.pauses, "pause")}'
        + (f', {_count(findings.slips, "slip")} of the pace' if findings.slips else ''),
    ]
    if findings.gap_count:
        gap = findings.gaps[0]
        lines.append(
            f'missing     {_count(findings.missing_samples, "sample")} in '
            f'{_count(findings.gap_count, "gap")}, the first after {gap.time:.9g} s: the recorder '
            'has not got them'
        )
    if findings.missing_impacts:
        lines.append(
            f'missing     {_count(findings.missing_impacts, "impact")} of the replay, where the '
            'recorder may have dropped messages'
        )
    if findings.missing_control:
        lines.append(
            f'missing     {_count(findings.missing_control, "act")} of the gap control of the '
            'replay, where the recorder may have dropped messages'
        )
    lines += [f'note        {remark}' for remark in findings.remarks]
    lines += [f'fault       {fault}' for fault in findings.faults]
    if (first := findings.first) is not None:
        lines += _difference_lines(first, start)
        parts = ', '.join(f'{n} on {topic}' for topic, n in findings.by_topic.items())
        lines.append(f'differences {parts}')
        lines += _divergence_lines(findings)
    if not findings.samples:
        lines.append('verdict     nothing could be compared')
    else:
        lines.append(f'verdict     {_VERDICTS[findings.verdict]}')
    # Names of topics and texts of faults come out of the bag.
    return '\n'.join(map(as_line, lines))


def comparison_text(
    held: Mapping[str, tuple[RecordedValues, Any]],
    recorded: Response,
    what_if: Response,
    how: str,
) -> str:
    """
    Return the motion with and without the held parameters, side by side.

    Parameters
    ----------
    held : mapping
        Name of each held parameter, with what it was in the recorded run and the held value.
    recorded, what_if : Response
        The runs.
    how : str
        How the what-if starts.
    """
    parts = [
        f'{name} = {now!r} (recorded: {was.described(repr, _MOST_VALUES)})'
        for name, (was, now) in held.items()
    ]
    rows: list[tuple[str, float, float]] = [
        ('largest |X| [m]', recorded.largest, what_if.largest),
        ('rms X [m]', recorded.rms, what_if.rms),
        ('impacts', recorded.impacts, what_if.impacts),
        ('energy lost in impacts [J]', recorded.energy, what_if.energy),
    ]
    lines = [
        textwrap.fill(f'what if     {", ".join(parts)}', 99, subsequent_indent=' ' * 12),
        f'start       {how}',
        f'{"":<28}{"recorded":>14}{"what if":>14}{"ratio":>10}',
    ]
    for name, was, now in rows:
        ratio = f'{now / was:.4f}' if was else '-'
        lines.append(f'{name:<28}{was:>14.7g}{now:>14.7g}{ratio:>10}')
    return '\n'.join(lines)


def _finite(value: Any) -> Any:
    """Return a value, or its name if JSON has none for it."""
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def _difference(difference: Difference) -> dict[str, Any]:
    amount = difference.amount
    return {
        'time': difference.time,
        'stamp_ns': difference.stamp_ns,
        'topic': difference.topic,
        'quantity': difference.quantity,
        'unit': difference.unit,
        'recorded': _finite(difference.recorded),
        'replayed': _finite(difference.replayed),
        'difference': amount if math.isfinite(amount) else None,
        'after': difference.after,
    }


def as_json(findings: Findings, recorded: RecordedRun) -> dict[str, Any]:
    """Return the findings as what JSON can hold; times in s of rig time, stamps in ns."""
    divergence, first = findings.divergence, findings.first
    return {
        'bag': str(recorded.reader.path),
        'node': recorded.topics.name,
        'complete': recorded.reader.complete,
        'verdict': findings.verdict.name.lower(),
        'compared': {
            'samples': findings.samples,
            'impacts': findings.impacts,
            'gap_control': findings.control,
            'snapshots': findings.snapshots,
            'changes': findings.changes,
            'resets': findings.resets,
            'pauses': findings.pauses,
            'slips': findings.slips,
            'start': None if findings.start_ns is None else findings.start_ns / 1e9,
            'end': None if findings.end_ns is None else findings.end_ns / 1e9,
        },
        'difference_count': findings.difference_count,
        'difference_count_by_topic': findings.by_topic,
        'first_difference': _difference(first) if first else None,
        'differences': [_difference(d) for d in findings.differences],
        'divergence': {
            'samples': divergence.samples,
            'first': divergence.first if divergence.samples else None,
            'last': divergence.last if divergence.samples else None,
            'largest_x': divergence.largest_x,
            'largest_z': divergence.largest_z,
            'growth': [
                {'sample': n, 'time': t, 'x': x, 'z': z} for n, t, x, z in divergence.marks
            ],
        },
        'missing_samples': findings.missing_samples,
        'missing_impacts': findings.missing_impacts,
        'missing_gap_control': findings.missing_control,
        'gaps': [
            {'after': g.time, 'from_stamp_ns': g.from_ns, 'missing': g.missing}
            for g in findings.gaps
        ],
        'remarks': findings.remarks,
        'faults': findings.faults,
    }
