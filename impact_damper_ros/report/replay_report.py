# SPDX-License-Identifier: Apache-2.0
"""The findings of a replay, as text and as JSON."""

from __future__ import annotations

import math
from typing import Any

from impact_damper_ros.parameters.quoting import as_line, counted
from impact_damper_ros.replay.findings import Difference, Findings, ReplayVerdict
from impact_damper_ros.replay.run import RecordedRun

_VERDICTS = {
    ReplayVerdict.IDENTICAL: 'identical: the run is reproduced bit for bit from its log',
    ReplayVerdict.WITHIN_ROUND_OFF: 'within round-off: the run is reproduced from its log, but '
    'not its last bits',
    ReplayVerdict.DIFFERENT: 'DIFFERENT: the run is not reproduced from its log',
}


def _verdict(findings: Findings) -> str:
    """Return the verdict in words."""
    if not findings.samples:
        return 'nothing could be compared'
    if findings.verdict is not ReplayVerdict.PARTIAL:
        return _VERDICTS[findings.verdict]
    how = 'within round-off' if findings.other_bits else 'identical'
    return f'{how} as far as it could be compared; the bag is not complete'


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
        lines.append(f'  difference {first.amount:.6g} {first.unit}'.rstrip())
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
        lines.append('            after that, all samples agree again')
    return lines


def findings_text(findings: Findings, recorded: RecordedRun) -> str:
    """Return the findings of a replay and the verdict as text."""
    start, end = (findings.start_ns or 0) / 1e9, (findings.end_ns or 0) / 1e9
    node = recorded.topics.name
    if recorded.run_count > 1:
        node += f', run {recorded.number} of {recorded.run_count}'
    impacts = counted(findings.impacts, 'impact')
    if not recorded.topics.impacts:
        impacts = 'no impacts (their topic was not recorded)'
    if findings.recorded_control or findings.control:
        impacts += f', {counted(findings.control, "act")} of the gap control'
    lines = [
        f'replayed    {recorded.reader.path}, node {node}',
        f'compared    {counted(findings.samples, "sample")}, {impacts}, '
        f'{counted(findings.snapshots, "snapshot")}',
        f'time span   {start:.9g} s to {end:.9g} s of rig time',
        f'meanwhile   {counted(findings.changes, "change")}, {counted(findings.resets, "reset")}, '
        f'{counted(findings.pauses, "pause")}'
        + (f', {counted(findings.slips, "slip")} of the pace' if findings.slips else ''),
    ]
    if findings.gap_count:
        gap = findings.gaps[0]
        lines.append(
            f'missing     {counted(findings.missing_samples, "sample")} in '
            f'{counted(findings.gap_count, "gap")}, the first after {gap.time:.9g} s'
        )
    if findings.missing_impacts:
        lines.append(
            f'missing     {counted(findings.missing_impacts, "impact")} of the replay, where the '
            'recorder may have dropped messages'
        )
    if findings.missing_control:
        lines.append(
            f'missing     {counted(findings.missing_control, "act")} of the gap control of the '
            'replay, where the recorder may have dropped messages'
        )
    if findings.unchecked:
        lines.append(f'not checked {"; ".join(findings.unchecked)}')
    lines += [f'note        {remark}' for remark in findings.remarks]
    lines += [f'fault       {fault}' for fault in findings.faults]
    if (first := findings.first) is not None:
        lines += _difference_lines(first, start)
        parts = ', '.join(f'{n} on {topic}' for topic, n in findings.by_topic.items())
        lines.append(f'differences {parts}')
        lines += _divergence_lines(findings)
    lines.append(f'verdict     {_verdict(findings)}')
    # Names of topics and texts of faults come from the bag
    return '\n'.join(map(as_line, lines))


def findings_json(findings: Findings, recorded: RecordedRun) -> dict[str, Any]:
    """Return the findings for JSON; times in s of rig time, stamps in ns."""
    divergence, first = findings.divergence, findings.first
    return {
        'bag': str(recorded.reader.path),
        'node': recorded.topics.name,
        'run': recorded.number,
        'run_count': recorded.run_count,
        'complete': recorded.reader.complete,
        'verdict': findings.verdict.value,
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
        'not_checked': list(findings.unchecked),
        'difference_count': findings.difference_count,
        'difference_count_by_topic': findings.by_topic,
        'first_difference': first.as_dict() if first else None,
        'differences': [d.as_dict() for d in findings.differences],
        'divergence': {
            'samples': divergence.samples,
            'first': divergence.first if divergence.samples else None,
            'last': divergence.last if divergence.samples else None,
            'largest_x': divergence.largest_x,
            'largest_z': divergence.largest_z,
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
