"""The report of the gap control study: tables, figures, and what they say."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean

from .drawing import save_figure
from .gap_study_figures import FIGURES
from .gap_study_findings import Results, broadband, level_sweep, targets
from .gap_study_ideal import ideal_ratio
from .gap_study_plan import (
    ANGLES,
    LAWS,
    RIG,
    SENSITIVITIES,
    Extent,
    sensitivity_values,
    sweep_frequencies,
)
from .gap_study_text import CAPTIONS, INTRODUCTION, LAW_TEXT, LIMITS

__all__ = ['report_text', 'write_study']

_NAMES = {
    'fixed': 'fixed gap, tuned at 1 N',
    'amplitude symmetric': 'amplitude, symmetric stops',
    'amplitude': 'amplitude, independent stops',
    'timed symmetric': 'timed, symmetric stops',
    'timed': 'timed, independent stops',
}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f'| {" | ".join(head)} |', f'| {" | ".join("---" for _ in head)} |']
    return '\n'.join([*lines, *(f'| {" | ".join(row)} |' for row in rows)])


def _target_table(results: Results, extent: Extent) -> str:
    return _table(
        ('target', 'at most', 'reached', ''),
        (
            (one.words, f'{one.limit:g}', f'{one.reached:.4f}', 'met' if one.met else '**missed**')
            for one in targets(results, extent)
        ),
    )


def _level_table(results: Results, extent: Extent, angle: int = 0) -> str:
    sweep = level_sweep(results, extent, angle)
    head = ('force [N]', *(f'{level:.3g}' for level in sweep.levels))
    rows = [
        (_NAMES[name], *(f'{value:.4f}' for value in values))
        for name, values in sweep.ratios.items()
    ]
    return _table(head, [*rows, ('ideal', *(f'{value:.4f}' for value in sweep.ideal))])


def _broadband_table(results: Results, extent: Extent) -> str:
    found = broadband(results, extent)
    rows = []
    for name in LAWS:
        rms, peak = zip(*found.ratios[name], strict=True)
        rows.append(
            (
                _NAMES[name],
                f'{fmean(rms):.3f}',
                f'{min(rms):.3f} to {max(rms):.3f}',
                f'{fmean(peak):.3f}',
                f'{min(peak):.3f} to {max(peak):.3f}',
            )
        )
    return _table(('law', 'rms, mean', 'rms, seeds', 'peak, mean', 'peak, seeds'), rows)


def _sweep_table(results: Results, extent: Extent) -> str:
    frequencies = sweep_frequencies(extent)
    turn = len(frequencies) // 2
    rows = []
    for name in ('fixed', 'amplitude', 'timed'):
        peaks = results['sweep', name].peaks
        up, down = peaks[: turn + 1], peaks[turn:][::-1]
        apart = max(abs(math.log(a / b)) for a, b in zip(up, down, strict=True))
        where = frequencies[max(range(len(up)), key=up.__getitem__)]
        rows.append(
            (
                _NAMES[name],
                f'{max(up):.2f} m at r = {where:.2f}',
                f'{max(down):.2f} m',
                f'{math.exp(apart):.2f}',
            )
        )
    head = (
        '',
        'largest on the way up',
        'largest on the way down',
        'up and down apart by a factor',
    )
    return _table(head, rows)


def _energy_table(results: Results) -> str:
    rows = []
    for where in ('resonance', 'broadband'):
        for name in ('amplitude', 'timed'):
            one = results['energy', where, name]
            taken = one.impact_power + one.dashpot_power
            rows.append(
                (
                    f'{_NAMES[name]}, {where}',
                    f'{one.impact_power:.4g}',
                    f'{one.dashpot_power:.4g}',
                    f'{one.actuator_power:.4g}',
                    f'{100.0 * one.actuator_power / taken:.1f} %',
                    f'{one.rms:.3f}',
                )
            )
    head = (
        '',
        'impacts take [W]',
        'dashpot takes [W]',
        'actuators spend [W]',
        'spent / taken',
        'rms of X [m]',
    )
    return _table(head, rows)


_UNITS = {
    'delay': ('delay [natural periods]', 'g'),
    'speed': ('speed [m/s]', 'g'),
    'noise': ('noise / amplitude', 'g'),
    'sampling': ('samples per natural period', 'g'),
}


def _sensitivity_table(results: Results, extent: Extent, what: str) -> str:
    ideal = ideal_ratio(RIG) * RIG.response_amplitude / math.sqrt(2.0)
    reference = broadband(results, extent).rms[0]
    values = [v for v in sensitivity_values(what) if ('sensitivity', what, 'timed', v) in results]
    rows = [
        (
            f'{name}: {words}',
            *(f'{results[part, what, name, value].rms / scale:.3f}' for value in values),
        )
        for name, part, words, scale in (
            ('amplitude', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity broadband', 'broadband, over the best fixed gap', reference),
        )
    ]
    return _table((_UNITS[what][0], *(f'{value:g}' for value in values)), rows)


def _figure(name: str) -> str:
    return f'![{CAPTIONS[name].partition(".")[0]}]({name}.png)\n\n*{CAPTIONS[name]}*'


def report_text(results: Results, extent: Extent) -> str:
    """
    Return README.md.

    Parameters
    ----------
    results : mapping
        Responses by the keys of their cases.
    extent : Extent
        What was run.
    """
    found = broadband(results, extent)
    parts = [
        INTRODUCTION,
        '## Targets',
        _target_table(results, extent),
        LAW_TEXT,
        '## Sixteenfold range of force at resonance',
        _figure('level'),
        'Amplitude of X (rms times √2) over that without impacts, 50 m per newton:',
        _level_table(results, extent),
        '## Broadband excitation',
        _figure('broadband'),
        f'Over the best fixed gap, {found.best:g} m, which leaves an rms of '
        f'{min(found.rms):.3f} to {max(found.rms):.3f} m (seeds {extent.seeds[0]} to '
        f'{extent.seeds[-1]}):',
        _broadband_table(results, extent),
        '## Through the resonance, up and down',
        _figure('sweep'),
        _sweep_table(results, extent),
        '## A load that changes',
        _figure('load'),
        '## Inclined, with friction',
        _figure('incline'),
    ]
    for angle in ANGLES:
        parts += [f'At {angle}°, over the amplitude without impacts:']
        parts += [_level_table(results, extent, angle)]
    parts += [
        '## Delay, speed, noise, sampling',
        _figure('sensitivity'),
        *(_sensitivity_table(results, extent, what) for what in SENSITIVITIES),
        '## What the actuators spend',
        CAPTIONS['energy'],
        _energy_table(results),
        LIMITS,
    ]
    return '\n\n'.join(part.strip() for part in parts) + '\n'


def write_study(results: Results, extent: Extent, directory: Path) -> list[Path]:
    """
    Write figures and README.md, each whole or not at all.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    OSError
        If one cannot be written.
    """
    written = []
    for name, draw in FIGURES.items():
        path = directory / f'{name}.png'
        save_figure(draw(results, extent), path)
        written.append(path)
    path = directory / 'README.md'
    part = path.with_name('.README.md.part')
    try:
        part.write_text(report_text(results, extent), encoding='utf-8')
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return [*written, path]
