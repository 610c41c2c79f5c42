"""The summary of a sweep: counts, attractors and the optimum, as JSON and in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from impact_damper_ros.rig.quoting import counted

from .optimum import Nearby, Optimum
from .table import FAILED, SweepTable

#: Reasons and attractors that are listed.
_MOST_SHOWN = 8


def attractors_of(table: SweepTable) -> list[dict[str, Any]]:
    """Return the attractors of a sweep of initial conditions, the most frequent first."""
    if not all(axis.initial for axis in table.plan.axes):
        return []
    numbers = np.nan_to_num(table.numbers('attractor'), nan=FAILED).astype(int)
    motions, stops = table.texts('motion'), table.texts('stops')
    period, x_max, ratio = (table.numbers(name) for name in ('period', 'x_max', 'x_max_ratio'))
    found = []
    for number in range(numbers.max(initial=FAILED) + 1):
        rows = np.flatnonzero(numbers == number)
        first = int(rows[0])
        found.append(
            {
                'attractor': number,
                'motion': motions[first],
                'period': None if np.isnan(period[first]) else int(period[first]),
                'stops': stops[first],
                'share': len(rows) / len(numbers),
                'x_max': float(x_max[rows].mean()),
                'x_max_ratio': float(ratio[rows].mean()),
                'first_point': first,
            }
        )
    return found


def attractor_text(attractor: dict[str, Any]) -> str:
    """Return kind, period and stops of a motion in words."""
    text = str(attractor['motion'])
    if attractor['period'] is not None:
        text += f', {counted(attractor["period"], "cycle")}'
        if attractor['stops']:
            text += f', stops {attractor["stops"]}'
    return text


def _cautions(optimum: Optimum, names: Sequence[str]) -> list[str]:
    """Return a line for each edge and each other motion of the optimum."""
    texts = []
    for edge in optimum.edges:
        assert edge.axis is not None
        best, there = optimum.values[edge.axis], edge.values[edge.axis]
        far = ''
        if best:
            percent = 100.0 * (there - best) / abs(best)
            far = f' ({abs(percent):.2g} % {"more" if percent > 0.0 else "less"})'
        texts.append(
            f'edge: at {names[edge.axis]} = {there:.6g}{far} {_as_much(edge, optimum.measure)}, '
            f'{edge.start}'
        )
    texts += [
        f'the same rig {other.start}: {_as_much(other, optimum.measure)}'
        for other in optimum.coexisting
    ]
    return texts


def _as_much(nearby: Nearby, measure: str) -> str:
    """Return the measure of another motion, and its kind."""
    times = f', {nearby.ratio:.3g} times as much' if 0.0 < nearby.ratio < math.inf else ''
    return f'{measure} is {nearby.measure:.5g}{times} ({attractor_text(vars(nearby))})'


def summary_of(table: SweepTable, optimum: Optimum | None) -> dict[str, Any]:
    """Return counts, attractors and optimum of a sweep, for JSON."""
    ok = table.flags('ok')
    reasons = Counter(reason for reason in table.texts('reason') if reason is not None)
    return {
        'rigs': len(table),
        'failed': int((~ok).sum()),
        'reasons': dict(reasons.most_common(_MOST_SHOWN)),
        'motions': dict(Counter(m for m in table.texts('motion') if m is not None).most_common()),
        'attractors': attractors_of(table),
        'optimum': None
        if optimum is None
        else {
            **optimum.as_dict(),
            'names': [axis.name for axis in table.plan.axes],
            'cautions': _cautions(optimum, [axis.name for axis in table.plan.axes]),
        },
    }


def summary_text(path: Path, summary: dict[str, Any]) -> str:
    """Return a summary in words."""
    kinds = ', '.join(f'{count} {kind}' for kind, count in summary['motions'].items())
    failed = f'{summary["failed"]} failed' if summary['failed'] else ''
    lines = [f'{path}: {summary["rigs"]} rigs: {", ".join(p for p in (kinds, failed) if p)}']
    lines += [f'  {count} failed: {reason}' for reason, count in summary['reasons'].items()]
    attractors = summary['attractors']
    lines += [
        f'  attractor {one["attractor"]}: {one["share"]:.1%} of the starts, '
        f'{attractor_text(one)}, largest |X| {one["x_max"]:.6g} m'
        for one in attractors[:_MOST_SHOWN]
    ]
    if len(attractors) > _MOST_SHOWN:
        lines.append(f'  and {len(attractors) - _MOST_SHOWN} more attractors')
    optimum = summary['optimum']
    if optimum is not None and not attractors:
        at = ', '.join(
            f'{name} = {value:.7g}'
            for name, value in zip(optimum['names'], optimum['values'], strict=True)
        )
        edge = ', at the end of a range' if optimum['at_edge'] else ''
        scatter = f' +- {optimum["scatter"]:.1g}' if optimum['scatter'] else ''
        lines.append(
            f'  {optimum["best"]} {optimum["measure"]}: {optimum["value"]:.7g}{scatter} at '
            f'{at}{edge}'
        )
        lines += [f'    {caution}' for caution in optimum['cautions']]
    return '\n'.join(lines)
