# SPDX-License-Identifier: Apache-2.0
"""The text of a comparison: a table for each stretch."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from impact_damper_ros.compare import (
    EnergyBalance,
    ImpactStates,
    LogVerdict,
    Overall,
    RunComparison,
    StretchComparison,
    Verdict,
)
from impact_damper_ros.orbits.orbit import AT_IMPACTS, PeriodicOrbit
from impact_damper_ros.parameters.quoting import as_line, counted

from .table import Table

_MOST_IMPACTS, _MOST_FINDINGS, _MOST_STOPS = 8, 6, 12
_HEAD = (
    '',
    'stop',
    'phase [cycles]',
    'X [m]',
    "X' before",
    "X' after",
    "Z' before",
    "Z' after [m/s]",
    'impulse [N s]',
)


def _impact_rows(
    label: str, states: ImpactStates | PeriodicOrbit, impulses: tuple[float, ...]
) -> Iterator[list[str]]:
    for i, stop in enumerate(states.stops[:_MOST_IMPACTS]):
        speeds = [f'{getattr(states, name)[i]:.7g}' for name in AT_IMPACTS[1:]]
        place = f'{states.phases[i]:.9f}', f'{states.x[i]:.9g}'
        yield [label if i == 0 else '', str(stop), *place, *speeds, f'{impulses[i]:.7g}']
    if (left := len(states.stops) - _MOST_IMPACTS) > 0:
        yield [f'{left} more', *[''] * (len(_HEAD) - 1)]


def _energy_lines(energy: EnergyBalance) -> Iterator[str]:
    into = f'force {energy.force:.6g} J'
    if energy.air:
        into += f' + air {energy.air:.6g} J'
    yield (
        f'  energy     {into} = dashpot {energy.dashpot:.6g} + friction {energy.friction:.6g} + '
        f'impacts {energy.impacts:.6g} + stored {energy.stored:.3g} J,'
    )
    yield (
        f'             residual {energy.residual:+.1e} J (allowed {energy.tolerance:.1e} J)'
        f', in {counted(energy.periods, "period")}'
    )


def _motion_lines(stretch: StretchComparison) -> Iterator[str]:
    measured, orbit = stretch.measured, stretch.predicted
    if measured is None:
        return
    period = measured.last_period
    rows: list[list[str]] = []
    if period is not None:
        rows += _impact_rows('measured', period, period.impulse)
    if orbit is not None:
        rows += _impact_rows('predicted', orbit, stretch.predicted_impulse)
    if rows:
        yield from Table.of_rows(_HEAD, rows).text('  ').splitlines()
    size = f'largest |X| {measured.x_max:.7g} m'
    if not math.isnan(measured.amplitude_ratio):
        size += f', Xmax/A {measured.amplitude_ratio:.7g}'
    if orbit is not None:
        size += f' (predicted {orbit.x_max:.7g} m, {orbit.amplitude_ratio:.7g})'
    yield f'  swing      {size}; rms X {measured.x_rms:.6g} m'
    rhythm = (
        f'{counted(measured.impacts, "impact")} in the part measured, {measured.start:.6g} s to '
        f'{measured.end:.6g} s'
    )
    if not math.isnan(measured.impacts_per_cycle):
        rhythm += f', {measured.impacts_per_cycle:.4g} per cycle'
    if measured.impacts:
        rhythm += f'; impulses {measured.mean_impulse:.6g} N s on average, '
        rhythm += f'{measured.largest_impulse:.6g} N s at most'
    yield f'  impacts    {rhythm}'


def _overall_lines(overall: Overall) -> Iterator[str]:
    stops = f'{overall.impacts_on_stop_1} on stop 1, {overall.impacts_on_stop_2} on stop 2'
    yield (
        f'  overall    largest |X| {overall.x_max:.7g} m, rms X {overall.x_rms:.6g} m in '
        f'{overall.duration:.9g} s; {counted(overall.impacts, "impact")} ({stops})'
    )
    yield (
        f'             force {overall.force_work:.6g} J into M; taken from M by impacts '
        f'{overall.impact_energy:.6g} J ({overall.impact_loss:.6g} J of it lost), by the dashpot '
        f'{overall.dashpot_energy:.6g} J'
    )


def _stretch_text(stretch: StretchComparison) -> str:
    lines = [
        f'stretch {stretch.number}    {stretch.start:.9g} s to {stretch.end:.9g} s; begins with: '
        f'{stretch.cause}',
    ]
    kind = stretch.kind.value
    if stretch.cycles and stretch.stops:
        more = ',...' if len(stretch.stops) > _MOST_STOPS else ''
        stops = ','.join(map(str, stretch.stops[:_MOST_STOPS])) + more
        kind += (
            f', {counted(stretch.impacts_per_period, "impact")} in '
            f'{counted(stretch.cycles, "cycle")}, stops {stops}'
        )
    if stretch.settled_at is not None:
        kind += f', settled at {stretch.settled_at:.6g} s'
    lines += [f'  motion     {kind}', f'             {stretch.evidence}']
    if stretch.missing_samples:
        lines.append(f'  missing    {counted(stretch.missing_samples, "sample")}')
    if stretch.overall is not None:
        lines += _overall_lines(stretch.overall)
    lines += _motion_lines(stretch)
    decay = stretch.decay
    if decay is not None:
        rate = 'not measured' if math.isnan(decay.measured) else f'{decay.measured:.6g}'
        over = f' over {counted(decay.periods, "period")}' if decay.periods else ''
        lines.append(
            f'  decay      {rate} per period{over}, largest multiplier {decay.predicted:.6g}; '
            f'distance at the end {decay.distance:.2g} (the digits resolve {decay.floor:.1g})'
        )
    if stretch.energy is not None:
        lines += _energy_lines(stretch.energy)
    if stretch.predicted is not None:
        orbit = stretch.predicted
        state = orbit.stability.replace('unstable', 'not stable')
        state += ', viable' if orbit.viable else f', not viable: {orbit.reason}'
        lines.append(f'  theory     {state}; {stretch.solver}')
    findings = [*stretch.log_findings, *stretch.findings]
    lines += [f'  finding    {finding.text}' for finding in findings[:_MOST_FINDINGS]]
    if (left := len(findings) - _MOST_FINDINGS) > 0:
        lines.append(f'             and {counted(left, "finding")} more')
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
    """Return the text of a comparison; units are in it, all SI."""
    lines = [
        f'compared     {comparison.bag}, node {comparison.node}{_run_of(comparison)}',
        f'recorded     {comparison.start:.9g} s to {comparison.end:.9g} s of rig time, '
        f'{counted(comparison.samples, "sample")}, {counted(comparison.impacts, "impact")}, '
        f'{counted(len(comparison.stretches), "stretch")}',
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
    overall = comparison.overall
    if overall is not None and len(comparison.stretches) > 1:
        last += _overall_lines(overall)
    return '\n\n'.join([*parts, '\n'.join(last)])
