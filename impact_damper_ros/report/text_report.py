# SPDX-License-Identifier: Apache-2.0
"""The text of a comparison: verdicts and, of each stretch, the tables of the page."""

from __future__ import annotations

from collections import Counter

from impact_damper_ros.compare.result import LogVerdict, RunComparison, StretchComparison, Verdict
from impact_damper_ros.parameters.quoting import as_line, plural

from .comparison_tables import STRETCH_TABLES, motion_words, overall_table

_MOST_FINDINGS, _MOST_STOPS = 6, 12


def _stretch_text(stretch: StretchComparison) -> str:
    lines = [
        f'stretch {stretch.number}    {stretch.start:.9g} s to {stretch.end:.9g} s; begins with: '
        f'{stretch.cause}',
    ]
    kind = motion_words(stretch)
    if stretch.stops:
        more = ',...' if len(stretch.stops) > _MOST_STOPS else ''
        kind += f', stops {",".join(map(str, stretch.stops[:_MOST_STOPS]))}{more}'
    if stretch.settled_at is not None:
        kind += f', settled at {stretch.settled_at:.6g} s'
    lines += [f'  motion     {kind}', f'             {stretch.evidence}']
    if stretch.missing_samples:
        lines.append(f'  missing    {plural(stretch.missing_samples, "sample")}')
    for table in (make(stretch) for make in STRETCH_TABLES):
        if table is not None:
            lines += table.text_with_note('  ').splitlines()
    if stretch.predicted is not None:
        orbit = stretch.predicted
        state = orbit.stability.replace('unstable', 'not stable')
        state += ', viable' if orbit.viable else f', not viable: {orbit.reason}'
        lines.append(f'  theory     {state}; {stretch.solver}')
    found = stretch.differences
    lines += [f'  finding    {difference.text}' for difference in found[:_MOST_FINDINGS]]
    if (left := len(found) - _MOST_FINDINGS) > 0:
        lines.append(f'             and {plural(left, "finding")} more')
    log = stretch.log.value
    lines.append(f'  log        {log.upper() if stretch.log is LogVerdict.DIFFERS else log}')
    word = stretch.verdict.value
    shown = word.upper() if stretch.verdict is Verdict.DIFFERS else word
    lines.append(f'  verdict    {shown}: {stretch.sentence}')
    return '\n'.join(map(as_line, lines))


def _run_of(comparison: RunComparison) -> str:
    several = comparison.run_count > 1
    return f', run {comparison.run} of {comparison.run_count}' if several else ''


def comparison_text(comparison: RunComparison) -> str:
    """Return the text of a comparison, with SI units."""
    lines = [
        f'compared     {comparison.bag}, node {comparison.node}{_run_of(comparison)}',
        f'recorded     {comparison.start:.9g} s to {comparison.end:.9g} s of rig time, '
        f'{plural(comparison.samples, "sample")}, {plural(comparison.impacts, "impact")}, '
        f'{plural(len(comparison.stretches), "stretch")}',
    ]
    lines.append(f'checked      {comparison.log.text}')
    if comparison.log.unchecked:
        lines.append(f'not checked  {"; ".join(comparison.log.unchecked)}')
    lines += [f'note         {remark}' for remark in comparison.remarks]
    lines += [f'fault        {fault}' for fault in comparison.faults]
    parts = [
        '\n'.join(map(as_line, lines)),
        *map(_stretch_text, comparison.stretches),
    ]
    counts = Counter(stretch.verdict.value for stretch in comparison.stretches)
    summary = ', '.join(f'{number} {word}' for word, number in counts.items()) or 'nothing'
    part = '' if not comparison.faults else '; the bag is not complete'
    last = [f'in all       {summary}{part}']
    table = overall_table(comparison.stretches, comparison.overall, '')
    if table is not None:
        last = [table.text_with_note(), '', *last]
    return '\n\n'.join([*parts, '\n'.join(last)])
