# SPDX-License-Identifier: Apache-2.0
"""The findings of a replay, as text and as JSON."""

from __future__ import annotations

import math
from typing import Any

from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.quoting import as_line, plural
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
    impacts = plural(findings.impacts, 'impact')
    if not recorded.topics.impacts:
        impacts = 'no impacts (their topic was not recorded)'
    if findings.recorded_gap_control or findings.gap_control:
        impacts += f', {plural(findings.gap_control, "act")} of the gap control'
    lines = [
        f'replayed    {recorded.reader.path}, node {node}',
        f'compared    {plural(findings.samples, "sample")}, {impacts}, '
        f'{plural(findings.snapshots, "snapshot")}',
        f'time span   {start:.9g} s to {end:.9g} s of rig time',
        f'meanwhile   {plural(findings.changes, "change")}, {plural(findings.resets, "reset")}, '
        f'{plural(findings.pauses, "pause")}'
        + (f', {plural(findings.slips, "slip")} of the pace' if findings.slips else ''),
    ]
    if findings.gap_count:
        gap = findings.gaps[0]
        lines.append(
            f'missing     {plural(findings.missing_samples, "sample")} in '
            f'{plural(findings.gap_count, "gap")}, the first after {gap.after:.9g} s'
        )
    for count, noun, of in (
        (findings.missing_impacts, 'impact', ''),
        (findings.missing_gap_control, 'act', ' of the gap control'),
    ):
        if count:
            lines.append(
                f'missing     {plural(count, noun)}{of} of the replay, where the recorder may '
                'have dropped messages'
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
    # Names of topics and texts of faults come from the bag, and may hold any character.
    return '\n'.join(map(as_line, lines))


#: Counts of compared values and messages.
_COMPARED = (
    *('samples', 'impacts', 'gap_control', 'snapshots'),
    *('changes', 'resets', 'pauses', 'slips'),
)
#: Findings that the JSON has unchanged.
_FINDINGS = (
    *('verdict', 'difference_count', 'differences', 'divergence', 'gaps', 'remarks', 'faults'),
    *('missing_samples', 'missing_impacts', 'missing_gap_control'),
)


def findings_json(findings: Findings, recorded: RecordedRun) -> dict[str, Any]:
    """Return the findings for JSON; times in s of rig time, stamps in ns."""
    ends = {'start': findings.start_ns, 'end': findings.end_ns}
    plain: dict[str, Any] = as_plain(
        {
            'bag': str(recorded.reader.path),
            'node': recorded.topics.name,
            'run': recorded.number,
            'run_count': recorded.run_count,
            'complete': recorded.reader.complete,
            'compared': {
                **{name: getattr(findings, name) for name in _COMPARED},
                **{name: None if at is None else at / 1e9 for name, at in ends.items()},
            },
            'not_checked': findings.unchecked,
            'difference_count_by_topic': findings.by_topic,
            'first_difference': findings.first,
            **{name: getattr(findings, name) for name in _FINDINGS},
        }
    )
    return plain
