# SPDX-License-Identifier: Apache-2.0
"""The summary of a sweep: counts, attractors and the optimum, as JSON and in words."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impact_damper_ros.parameters.quoting import plural

from .best import Optimum
from .grid import Grid

if TYPE_CHECKING:
    import pandas as pd

#: Most reasons and attractors that are listed.
_MOST_SHOWN = 8


def attractors_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the attractors of a sweep of initial conditions, the most frequent first."""
    if not all(axis.initial for axis in Grid.from_inputs(table.attrs['inputs']).axes):
        return []
    return [
        {
            'attractor': int(number),
            'kind': rows.kind.iloc[0],
            'cycles': int(rows.cycles.iloc[0]) if rows.settled.iloc[0] else None,
            'stops': rows.stops.iloc[0] if rows.settled.iloc[0] else None,
            'share': len(rows) / len(table),
            'x_max': float(rows.x_max.mean()),
            'x_max_ratio': float(rows.x_max_ratio.mean()),
            'first_point': int(rows.point.iloc[0]),
        }
        for number, rows in table.groupby('attractor')
    ]


def attractor_text(attractor: dict[str, Any]) -> str:
    """Return kind, period and stops of a motion in words."""
    text = str(attractor['kind'])
    if attractor['cycles'] is not None:
        text += f', {plural(attractor["cycles"], "cycle")}'
        if attractor['stops']:
            text += f', stops {attractor["stops"]}'
    return text


def summary_of(table: pd.DataFrame, optimum: Optimum | None) -> dict[str, Any]:
    """Return counts, attractors and optimum of a sweep, for JSON."""
    grid = Grid.from_inputs(table.attrs['inputs'])
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
        'rigs': len(table),
        'failed': int((~table.ok).sum()),
        'reasons': _counts(table.reason, _MOST_SHOWN),
        'kinds': _counts(table.kind),
        'attractors': attractors_of(table),
        'optimum': found,
    }


def _counts(column: pd.Series[Any], most: int | None = None) -> dict[str, int]:
    """Return the number of each text, the most frequent first."""
    return {str(text): int(count) for text, count in column.value_counts()[:most].items()}


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
