# SPDX-License-Identifier: Apache-2.0
"""
The report of `compare_run`: one page, and its numbers as JSON.

The page needs no network, no script and no other file. It has the same bytes for the same
recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros.compare import LogVerdict, RunComparison, StretchComparison, Verdict
from impact_damper_ros.orbits.swept_response import SweptResponse
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.theory.gap_curve import GapCurve

from .charts import PICTURES
from .comparison_tables import (
    STRETCH_TABLES,
    cause_of,
    motion_words,
    overall_table,
    overview_table,
    parameter_table,
)
from .drawing import page_style
from .formatting import instant, number, quantity
from .html_page import Shown, on_page, render, write_page
from .motion_charts import draw_run
from .swept_response_figure import base_amplitude

#: Most stretches that are shown in detail, and that are listed.
MOST_DETAILED, MOST_LISTED = 12, 300
_MOST_FINDINGS = 20

#: Why a chart may be missing.
_NEEDED = {
    'section': 'a Poincaré section needs impacts and a known phase of the force',
    'convergence': 'a convergence plot needs a periodic motion that is approached',
    'gap': 'a gap curve needs a periodic motion that theory can follow',
}
_URGENCY = {Verdict.DIFFERS: 0, Verdict.PREDICTED_UNSTABLE: 1, Verdict.TOO_SHORT: 3}


class _Badge(NamedTuple):
    """Class of a verdict in the page's style, and a sign that needs no colour."""

    kind: str
    sign: str


_BADGES = {
    Verdict.AGREES: _Badge('good', '✓'),
    Verdict.DIFFERS: _Badge('bad', '✗'),
    Verdict.NOT_SETTLED: _Badge('open', '…'),
    Verdict.PREDICTED_UNSTABLE: _Badge('open', '!'),
    Verdict.NO_PREDICTION: _Badge('none', '–'),
    Verdict.SWEPT: _Badge('good', '↗'),
    Verdict.TOO_SHORT: _Badge('none', '–'),
}


def shown_stretches(
    stretches: Sequence[StretchComparison], most: int
) -> tuple[StretchComparison, ...]:
    """
    Return the `most` important stretches, in the order of the run.

    Those that differ from theory or whose log is wrong come first, then the longest.
    """

    def rank(stretch: StretchComparison) -> tuple[int, float]:
        wrong = stretch.log is LogVerdict.DIFFERS
        urgency = 0 if wrong else _URGENCY.get(stretch.verdict, 2)
        return urgency, stretch.start - stretch.end

    chosen = sorted(stretches, key=rank)[:most]
    return tuple(sorted(chosen, key=lambda stretch: stretch.number))


def _sweep_tiles(rig: RigParameters, found: SweptResponse) -> Iterator[tuple[str, str, str]]:
    """Yield the largest values of a sweep, and their frequencies."""
    values = [('Largest |X|', 'm', found.x, found.x_without)]
    if rig.swept == 'base':
        base = base_amplitude(rig, found)
        values.append(('Largest |X − b|', 'm', found.relative, found.relative_without))
        values.append(('Transmissibility', '', found.x / base, found.x_without / base))
    for title, unit, of, alone in values:
        best, other = int(of.argmax()), float(alone.max())
        place = f'at {found.frequency[best] / math.tau:.4g} Hz'
        without = f'{place}; {quantity(other, unit, 4).rstrip()} without damper'
        yield title, quantity(float(of[best]), unit, 4).rstrip(), without


def _tiles(stretch: StretchComparison) -> Iterator[tuple[str, str, str]]:
    """Yield the key numbers."""
    measured, orbit, decay = stretch.measured, stretch.predicted, stretch.decay
    what = plural(stretch.impacts, 'impact')
    if stretch.stops:
        what = f'stops {", ".join(map(str, stretch.stops))}'
    if stretch.response is not None:
        yield from _sweep_tiles(stretch.parameters, stretch.response)
        most = float(stretch.response.impacts.max())
        yield (
            'Impacts per cycle',
            number(most, 3),
            f'at most; {plural(stretch.impacts, "impact")}',
        )
        return
    yield 'Motion', motion_words(stretch), what
    if measured is not None:
        theory = 'no prediction'
        if orbit is not None:
            theory = f'predicted {quantity(orbit.x_max, "m", 5, measured.x_max)}'
        yield 'Largest |X|', quantity(measured.x_max, 'm', 5), theory
        amplitude = stretch.parameters.response_amplitude
        without = 'the force is not a single harmonic'
        if amplitude > 0.0:
            without = f'A = {quantity(amplitude, "m", 4)} without impacts'
        yield 'Xmax / A', number(measured.x_max_ratio, 4), without
        impulse = f'mean impulse {quantity(measured.mean_impulse, "N s", 3)}'
        yield 'Impacts per cycle', number(measured.impacts_per_cycle, 4), impulse
    if stretch.settled_at is None:
        yield 'Steady', 'not reached', f'in {instant(stretch.end - stretch.start)} s'
    else:
        after = f'after {instant(stretch.settled_at - stretch.start)} s'
        yield 'Steady since', f'{instant(stretch.settled_at)} s', after
    if decay is not None:
        known = math.isfinite(decay.measured)
        factor = f'× {number(decay.measured, 4)}' if known else 'not measured'
        yield 'Decay per period', factor, f'largest multiplier {number(decay.predicted, 4)}'


def _findings(stretch: StretchComparison) -> Iterator[str]:
    """Yield the contradictions to the log."""
    for difference in stretch.differences[:_MOST_FINDINGS]:
        yield f'{instant(difference.time)} s: {difference.text}'
    if (left := len(stretch.differences) - _MOST_FINDINGS) > 0:
        yield f'{left} more, see report.json'
    if stretch.missing_samples:
        yield f'missing in the log: {plural(stretch.missing_samples, "sample")}'


def _pictures(stretch: StretchComparison) -> tuple[list[Shown], list[str]]:
    """Return the charts, and why some are missing."""
    shown, missing = [], []
    for name, draw in PICTURES.items():
        picture = draw(stretch)
        if picture is not None:
            key, where = f's{stretch.number}-{name}', f'stretch {stretch.number}'
            shown.append(on_page(picture, key, where))
        elif name in _NEEDED:
            missing.append(_NEEDED[name])
    return shown, missing


def _detail(stretch: StretchComparison, before: StretchComparison | None) -> dict[str, Any]:
    """Return the entries of the template for a stretch."""
    pictures, missing = _pictures(stretch)
    impacts, *left, energy = (make(stretch) for make in STRETCH_TABLES)
    evidence = '' if stretch.evidence in stretch.sentence else stretch.evidence
    return {
        'number': stretch.number,
        'cause': cause_of(stretch),
        'verdict': stretch.verdict,
        'sentence': stretch.sentence,
        'extent': (
            f'{instant(stretch.start)} s to {instant(stretch.end)} s of rig time, '
            f'{plural(stretch.samples, "sample")}, {plural(stretch.impacts, "impact")}; '
            f'log {stretch.log.value}'
        ),
        'findings': list(_findings(stretch)),
        'tiles': list(_tiles(stretch)),
        'pictures': pictures,
        'missing': f'Not drawn: {"; ".join(missing)}.' if missing and pictures else '',
        'impacts': impacts,
        'columns': [left, [energy, parameter_table(stretch, before)]],
        'reasons': [('Kind of motion', evidence), ('Prediction', stretch.solver)],
    }


def _overview(comparison: RunComparison, detailed: Sequence[StretchComparison]) -> dict[str, Any]:
    """Return the picture of the whole run and the tables of its stretches."""
    stretches = comparison.stretches
    if not stretches:
        return {'overview': [], 'tables': []}
    rows = shown_stretches(stretches, MOST_LISTED)
    note = left_out = ''
    if len(detailed) < len(stretches):
        note = f'{len(detailed)} of {len(stretches)} are shown in detail: those that differ, '
        note += 'then the longest. '
    if len(rows) < len(stretches):
        left_out = f'{len(stretches) - len(rows)} are not listed here; report.json has all.'
    picture = draw_run(stretches)
    drawn = [] if picture is None else [on_page(picture, 'run', 'all stretches')]
    numbers = {stretch.number for stretch in detailed}
    tables = [
        overview_table(rows, numbers, (note + left_out).rstrip()),
        overall_table(rows, comparison.overall, left_out),
    ]
    return {'overview': drawn, 'tables': tables}


def _head(comparison: RunComparison, command: str) -> dict[str, Any]:
    """Return the verdicts on the whole run, and the origin of the report."""
    counts = [(v, sum(s.verdict is v for s in comparison.stretches)) for v in Verdict]
    size = f'{plural(len(comparison.stretches), "stretch")} of constant parameters in '
    size += f'{instant(comparison.end - comparison.start)} s, '
    size += f'{plural(comparison.samples, "sample")} and {plural(comparison.impacts, "impact")}.'
    checked = f'Checked: {comparison.log.text}.'
    if comparison.log.unchecked:
        checked += f' Not checked: {"; ".join(comparison.log.unchecked)}.'
    facts = [
        ('Recording', comparison.bag),
        ('Node', comparison.node or 'not named in the recording'),
        ('Recording complete', 'yes' if comparison.complete else 'no'),
        ('Run', f'{comparison.run} of {comparison.run_count}'),
        ('Rig time', f'{instant(comparison.start)} s to {instant(comparison.end)} s'),
        ('Written by', f'impact_damper_ros {comparison.version}'),
    ]
    return {
        'run': comparison,
        'name': Path(comparison.bag).name or comparison.bag,
        'size': size,
        'counts': [(verdict, count) for verdict, count in counts if count],
        'checked': checked,
        'facts': [*facts, ('Command', command)] if command else facts,
        'origin': (
            'Measured values are those of the replayed recording, with all digits. The predicted '
            'motion is the exact periodic motion for the logged parameters. report.json '
            'beside this page contains all numbers, including those of the stretches without a '
            'section here.'
        ),
    }


def with_gap_curves(comparison: RunComparison, done: Callable[[], object] = bool) -> RunComparison:
    """Follow the predicted motions of stretches that are shown in detail in the gap."""
    curves: dict[RigParameters, GapCurve] = {}
    found = {s.number: s for s in comparison.stretches}
    detailed = shown_stretches(comparison.stretches, MOST_DETAILED)
    for stretch in detailed:
        orbit = stretch.predicted
        if orbit is not None and stretch.measured is not None and not orbit.parameters.one_sided:
            curve = curves.setdefault(
                orbit.parameters.replace(gap=1.0), GapCurve(orbit.parameters)
            )
            curve.follow(orbit)
            drawn = replace(stretch.curves, gap_curve=curve.message())
            found[stretch.number] = replace(stretch, curves=drawn)
        done()
    return replace(comparison, stretches=tuple(found.values()))


def report_page(
    comparison: RunComparison, *, command: str = '', done: Callable[[], object] = bool
) -> str:
    """Return the page; the parameters are those of `write_report`."""
    chosen = shown_stretches(comparison.stretches, MOST_DETAILED)
    before = {b.number: a for a, b in pairwise(comparison.stretches)}
    detailed = []
    with page_style():
        overview = _overview(comparison, chosen)
        for stretch in chosen:
            detailed.append(_detail(stretch, before.get(stretch.number)))
            done()
    return render(
        'report.html',
        **_head(comparison, command),
        **overview,
        badges=_BADGES,
        detailed=detailed,
    )


def write_report(
    comparison: RunComparison,
    directory: Path,
    *,
    command: str = '',
    done: Callable[[], object] = bool,
) -> Path:
    """
    Write report.html and report.json, both whole or neither.

    Parameters
    ----------
    comparison : RunComparison
        The result to report.
    directory : Path
        Directory of the report; made if absent.
    command : str, optional
        The command line, which the page shows.
    done : callable, optional
        Called after each step: two for each of the stretches that are shown in detail.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OSError
        If a file cannot be written; its `filename` is the file.
    """
    directory = Path(directory)
    comparison = with_gap_curves(comparison, done)
    page = report_page(comparison, command=command, done=done)
    return write_page(directory, page, comparison)
