# SPDX-License-Identifier: Apache-2.0
"""The summary of a sweep: counts, attractors and the optimum, as JSON and in words."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.parameters.quoting import plural

from .best import Optimum
from .table import Columns

if TYPE_CHECKING:
    import pandas as pd

#: Most reasons and attractors that are listed.
_MOST_SHOWN = 8


def attractors_of(table: pd.DataFrame | Columns) -> list[dict[str, Any]]:
    """Return the attractors of a sweep of initial conditions, the most frequent first."""
    grid, columns = Columns.of(table)
    if not all(axis.initial for axis in grid.axes):
        return []
    rows = defaultdict[int, list[int]](list)
    for k, number in enumerate(columns['attractor']):
        if number is not None:
            rows[int(number)].append(k)
    found = []
    for number, places in sorted(rows.items()):
        first, settled = places[0], columns['settled'][places[0]]
        sizes = ([columns[name][k] for k in places] for name in ('x_max', 'x_max_ratio'))
        x_max, ratio = (np.array(one, dtype=float) for one in sizes)
        found.append(
            {
                'attractor': number,
                'kind': columns['kind'][first],
                'cycles': int(columns['cycles'][first]) if settled else None,
                'stops': columns['stops'][first] if settled else None,
                'share': len(places) / grid.size,
                'x_max': float(x_max.mean()),
                'x_max_ratio': float(ratio.mean()),
                'first_point': first,
            }
        )
    return found


def attractor_text(attractor: dict[str, Any]) -> str:
    """Return kind, period and stops of a motion in words."""
    text = str(attractor['kind'])
    if attractor['cycles'] is not None:
        text += f', {plural(attractor["cycles"], "cycle")}'
        if attractor['stops']:
            text += f', stops {attractor["stops"]}'
    return text


def summary_of(table: pd.DataFrame | Columns, optimum: Optimum | None) -> dict[str, Any]:
    """Return counts, attractors and optimum of a sweep, for JSON."""
    grid, values = columns = Columns.of(table)
    found = None
    if optimum is not None:
        pairs = list(zip(grid.axes, optimum.values, strict=True))
        rig = grid.setup.parameters
        found = {
            **asdict(optimum),
            'names': [axis.name for axis in grid.axes],
            'at': [f'{axis.name} = {axis.value_text(value, rig, 7)}' for axis, value in pairs],
        }
    return {
        'rigs': grid.size,
        'failed': values['ok'].count(False),
        'reasons': _counts(values['reason'], _MOST_SHOWN),
        'kinds': _counts(values['kind']),
        'attractors': attractors_of(columns),
        'optimum': found,
    }


def _counts(texts: Iterable[str | None], most: int | None = None) -> dict[str, int]:
    """Return the number of each text, the most frequent first."""
    return dict(Counter(text for text in texts if text is not None).most_common(most))


def summary_text(path: Path, summary: dict[str, Any]) -> str:
    """Return a summary in words."""
    kinds = ', '.join(f'{count} {kind}' for kind, count in summary['kinds'].items())
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
        at = ', '.join(optimum['at'])
        edge = ', at the end of a range' if optimum['at_edge'] else ''
        turn = f', followed {optimum["direction"]}wards' if optimum['direction'] else ''
        lines.append(
            f'  {optimum["best"]} {optimum["measure"]}: {optimum["value"]:.7g} at {at}{edge}{turn}'
        )
    return '\n'.join(lines)
