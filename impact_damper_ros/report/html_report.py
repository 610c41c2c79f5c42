"""
The report of `compare_run`: one page that holds all it shows, and the numbers as JSON.

The page needs nothing but itself: no network, no script, no other file. It has the same bytes for
the same recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from errno import ENOTDIR
from importlib.resources import files
from itertools import pairwise
from os import strerror
from pathlib import Path
from string import Template

from impact_damper_ros.compare import LogVerdict, RunComparison, StretchComparison, Verdict
from impact_damper_ros.compare.periodic_motion import GapCurves
from impact_damper_ros.outputs import write_texts
from impact_damper_ros.rig.quoting import counted

from .charts import PICTURES, Picture, draw_history, draw_run
from .drawing import page_style
from .formatting import instant, number, quantity
from .glossary import glossary_html, linked
from .html import Html, element, joined, listed, safe
from .html_tables import (
    cause_of,
    comparison_table,
    energy_table,
    linked_badge,
    motion_of,
    multiplier_table,
    overall_table,
    overview_table,
    parameter_table,
    sign_of,
)
from .inline_svg import inline_svg

#: Stretches that are shown in detail, and those that are listed: more would make the page useless.
MOST_DETAILED, MOST_LISTED = 12, 300
_MOST_FINDINGS = 20

#: Why a chart may be missing.
_NEEDED = {
    'section': 'a Poincaré section needs impacts and a known phase of the force',
    'convergence': 'a convergence plot needs a periodic motion that is approached',
    'gap': 'a gap curve needs a periodic motion that theory can follow',
}
_TEMPLATE = files('impact_damper_ros.report') / 'template'
_URGENCY = {Verdict.DIFFERS: 0, Verdict.PREDICTED_UNSTABLE: 1, Verdict.TOO_SHORT: 3}


def shown_stretches(
    stretches: Sequence[StretchComparison], most: int
) -> tuple[StretchComparison, ...]:
    """
    Return the `most` important stretches, in the order of the run.

    Those that differ from theory or whose log is wrong come first, then those with findings, then
    the longest.
    """

    def rank(stretch: StretchComparison) -> tuple[int, bool, float]:
        length = stretch.end - stretch.start
        wrong = stretch.log is LogVerdict.DIFFERS
        urgency = 0 if wrong else _URGENCY.get(stretch.verdict, 2)
        return urgency, not stretch.findings, -length

    chosen = sorted(stretches, key=rank)[:most]
    return tuple(sorted(chosen, key=lambda stretch: stretch.number))


def _figure(picture: Picture, key: str, where: str, narrow: Picture | None = None) -> Html:
    """Return a picture with its caption, and the variant for a narrow page."""
    label = f'{picture.title}, {where}'
    drawn = Html(inline_svg(picture.figure, key, label))
    if narrow is not None:
        small = Html(inline_svg(narrow.figure, f'{key}-narrow', label))
        drawn = joined(element('div', drawn, class_='broad'), element('div', small, class_='slim'))
    title = element('strong', linked(picture.title), '.')
    caption = element('figcaption', title, ' ', linked(picture.caption))
    return element('figure', drawn, caption, class_='wide' if picture.wide else 'narrow')


def _tiles(stretch: StretchComparison) -> Html:
    """Return the key numbers."""
    measured, orbit, decay = stretch.measured, stretch.predicted, stretch.decay
    what = counted(stretch.impacts, 'impact')
    if stretch.stops:
        what = f'stops {", ".join(map(str, stretch.stops))}'
    tiles = [('Motion', motion_of(stretch), what)]
    if measured is not None:
        theory = 'no prediction'
        if orbit is not None:
            theory = f'predicted {quantity(orbit.x_max, "m", 5, measured.x_max)}'
        tiles.append(('Largest |X|', quantity(measured.x_max, 'm', 5), theory))
        amplitude = stretch.parameters.response_amplitude
        without = 'the force is not a single harmonic'
        if amplitude > 0.0:
            without = f'A = {quantity(amplitude, "m", 4)} without impacts'
        tiles.append(('Xmax / A', number(measured.amplitude_ratio, 4), without))
        impulse = f'mean impulse {quantity(measured.mean_impulse, "N s", 3)}'
        tiles.append(('Impacts per cycle', number(measured.impacts_per_cycle, 4), impulse))
    if stretch.settled_at is None:
        tiles.append(('Steady', 'not reached', f'in {instant(stretch.end - stretch.start)} s'))
    else:
        after = f'after {instant(stretch.settled_at - stretch.start)} s'
        tiles.append(('Steady since', f'{instant(stretch.settled_at)} s', after))
    if decay is not None:
        known = math.isfinite(decay.measured)
        factor = f'× {number(decay.measured, 4)}' if known else 'not measured'
        largest = f'largest multiplier {number(decay.predicted, 4)}'
        tiles.append(('Decay per period', factor, largest))
    entries = (
        element(
            'div',
            element('dt', linked(name)),
            element('dd', linked(value), element('small', linked(small))),
        )
        for name, value, small in tiles
    )
    return element('dl', *entries, class_='tiles')


def _findings(stretch: StretchComparison) -> Html:
    """Return what contradicts the log; empty if nothing does."""
    findings = [*stretch.log_findings, *stretch.findings]
    texts = [f'{instant(f.time)} s: {f.text}' for f in findings[:_MOST_FINDINGS]]
    left = len(findings) - len(texts)
    if left > 0:
        texts.append(f'{left} more, see report.json')
    if stretch.missing_samples:
        missing = counted(stretch.missing_samples, 'sample')
        texts.append(f'missing in the log: {missing}')
    return _notes('h3', 'Findings', texts)


def _notes(tag: str, title: str, texts: Sequence[str], kind: str = 'notes') -> Html:
    if not texts:
        return Html()
    return element('div', element(tag, title), listed(map(linked, texts)), class_=kind)


def _pictures(stretch: StretchComparison) -> Html:
    """Return the charts, and why some are missing."""
    shown, missing = [], []
    for name, draw in PICTURES.items():
        picture = draw(stretch)
        if picture is not None:
            key, where = f's{stretch.number}-{name}', f'stretch {stretch.number}'
            narrow = draw_history(stretch, wide=False) if name == 'history' else None
            shown.append(_figure(picture, key, where, narrow))
        elif name in _NEEDED:
            missing.append(_NEEDED[name])
    if not shown:
        return element('p', 'Too little of this stretch was recorded to draw anything.')
    plots = element('div', *shown, class_='plots')
    return joined(plots, _judged(f'Not drawn: {"; ".join(missing)}.') if missing else '')


def _judged(text: str) -> Html:
    return element('p', linked(text), class_='judged')


def _stretch_section(stretch: StretchComparison, before: StretchComparison | None) -> Html:
    tables = [
        joined(comparison_table(stretch), multiplier_table(stretch)),
        joined(energy_table(stretch), parameter_table(stretch, before)),
    ]
    evidence = '' if stretch.evidence in stretch.sentence else stretch.evidence
    reasons = (('Kind of motion', evidence), ('Prediction', stretch.solver))
    time = f'{instant(stretch.start)} s to {instant(stretch.end)} s of rig time, '
    time += f'{counted(stretch.samples, "sample")}, {counted(stretch.impacts, "impact")}'
    verdict = joined(linked_badge(stretch.verdict), linked(stretch.sentence))
    title = f'Stretch {stretch.number}: {cause_of(stretch)}'
    key = f'stretch-{stretch.number}'
    return element(
        'section',
        element('h2', title, id=f'{key}-title'),
        element('p', verdict, class_='verdict'),
        _judged(f'{time}; log {stretch.log.value}'),
        _findings(stretch),
        _tiles(stretch),
        _pictures(stretch),
        element('div', *(element('div', part) for part in tables if part), class_='tables'),
        *(_judged(f'{name}: {text}') for name, text in reasons if text),
        class_='stretch',
        id=key,
        aria_labelledby=f'{key}-title',
    )


def _summary(comparison: RunComparison) -> Html:
    """Return the verdicts on the whole run, and the faults of the recording."""
    counts = [
        (verdict, sum(s.verdict is verdict for s in comparison.stretches)) for verdict in Verdict
    ]
    badges = ' '.join(linked_badge(verdict, count) for verdict, count in counts if count)
    size = f'{counted(len(comparison.stretches), "stretch")} of constant parameters in '
    size += f'{instant(comparison.end - comparison.start)} s, '
    size += f'{counted(comparison.samples, "sample")} and {counted(comparison.impacts, "impact")}.'
    checked = f'Checked: {comparison.log.text}.'
    if comparison.log.unchecked:
        checked += f' Not checked: {"; ".join(comparison.log.unchecked)}.'
    return joined(
        element('p', linked(size)),
        element('p', Html(badges), class_='verdict') if badges else '',
        element('p', linked(checked)),
        _notes('h2', 'The recording can be used in part only', comparison.faults),
        _notes('h2', 'Remarks', comparison.remarks, 'notes calm'),
    )


def _overview(comparison: RunComparison, detailed: Sequence[StretchComparison]) -> Html:
    """Return the picture of the whole run and the table of its stretches."""
    stretches = comparison.stretches
    content: list[str] = [element('h2', 'Overview', id='overview')]
    if not stretches:
        content.append(element('p', 'The recording holds nothing to compare.'))
    else:
        rows = shown_stretches(stretches, MOST_LISTED)
        note = left_out = ''
        if len(detailed) < len(stretches):
            note = f'{len(detailed)} of {len(stretches)} are shown in detail: those that differ '
            note += 'or have findings, then the longest. '
        if len(rows) < len(stretches):
            left_out = f'{len(stretches) - len(rows)} are not listed here; report.json has all.'
        picture, narrow = draw_run(stretches), draw_run(stretches, wide=False)
        drawn = '' if picture is None else _figure(picture, 'run', 'all stretches', narrow)
        numbers = {stretch.number for stretch in detailed}
        content += [
            element('div', drawn, class_='plots'),
            overview_table(rows, numbers, (note + left_out).rstrip()),
            overall_table(rows, comparison.overall, left_out),
        ]
    return element('section', *content, class_='first', aria_labelledby='overview')


def _navigation(detailed: Sequence[StretchComparison]) -> Html:
    links = [element('a', 'Overview', href='#overview')]
    for stretch in detailed:
        title = f'Stretch {stretch.number}: {stretch.verdict.value}'
        text = f'{sign_of(stretch.verdict)} {stretch.number}'
        links.append(element('a', text, href=f'#stretch-{stretch.number}', title=title))
    links.append(element('a', 'Glossary', href='#glossary'))
    links.append(element('a', 'How it was obtained', href='#origin'))
    return element('ol', *(element('li', link) for link in links))


def _origin(comparison: RunComparison, command: str) -> Html:
    """Return how the report came about."""
    facts = [
        ('Recording', comparison.bag),
        ('Node', comparison.node or 'not named in the recording'),
        ('Recording complete', 'yes' if comparison.complete else 'no'),
        ('Stamps', comparison.stamps),
        ('Rig time', f'{instant(comparison.start)} s to {instant(comparison.end)} s'),
        ('Written by', f'impact_damper_ros {comparison.version}'),
    ]
    if command:
        facts.append(('Command', element('code', command)))
    rows = (joined(element('dt', linked(name)), element('dd', value)) for name, value in facts)
    words = (
        'What is measured is taken from the recording alone: samples, impacts and parameters as '
        'logged. What is predicted is the exact periodic motion for these parameters. '
        'report.json beside this page contains all numbers, including those of the stretches '
        'without a section here.'
    )
    return element(
        'section',
        element('h2', 'How it was obtained', id='origin'),
        element('p', linked(words)),
        element('dl', *rows, class_='facts'),
        aria_labelledby='origin',
    )


def _with_gap_curves(comparison: RunComparison) -> RunComparison:
    """Follow the predicted motions in the gap, of those stretches that are shown in detail."""
    curves = GapCurves()
    detailed = {s.number for s in shown_stretches(comparison.stretches, MOST_DETAILED)}
    stretches = (
        replace(stretch, curves=curves.added(stretch))
        if stretch.number in detailed and stretch.curves.gap_curve is None
        else stretch
        for stretch in comparison.stretches
    )
    return replace(comparison, stretches=tuple(stretches))


def report_page(
    comparison: RunComparison,
    *,
    command: str = '',
    drawn: Callable[[int, int], None] | None = None,
) -> str:
    """Return the page; the parameters are those of `write_report`."""
    detailed = shown_stretches(comparison.stretches, MOST_DETAILED)
    before = {b.number: a for a, b in pairwise(comparison.stretches)}
    sections = []
    with page_style():
        overview = _overview(comparison, detailed)
        for count, stretch in enumerate(detailed, 1):
            sections.append(_stretch_section(stretch, before.get(stretch.number)))
            if drawn is not None:
                drawn(count, len(detailed))
    name = Path(comparison.bag).name or comparison.bag
    return Template((_TEMPLATE / 'report.html').read_text('utf-8')).substitute(
        title=safe(f'{name}: compared with theory'),
        heading=safe(name),
        style=(_TEMPLATE / 'report.css').read_text('utf-8').strip(),
        summary=_summary(comparison),
        navigation=_navigation(detailed),
        overview=overview,
        stretches='\n'.join(sections),
        glossary=glossary_html(),
        origin=_origin(comparison, command),
    )


def write_report(
    comparison: RunComparison,
    directory: Path,
    *,
    command: str = '',
    drawn: Callable[[int, int], None] | None = None,
) -> Path:
    """
    Write report.html and report.json, both whole or neither.

    Parameters
    ----------
    comparison : RunComparison
        What to report.
    directory : Path
        Where; made if it is not there.
    command : str, optional
        The command line that was given, to be shown on the page.
    drawn : callable, optional
        Called with the number of stretches that are drawn, and of those to draw.

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
    page = report_page(_with_gap_curves(comparison), command=command, drawn=drawn)
    numbers = json.dumps(comparison.as_dict(), indent=1, allow_nan=False) + '\n'
    if directory.exists() and not directory.is_dir():
        raise NotADirectoryError(ENOTDIR, strerror(ENOTDIR), str(directory))
    directory.mkdir(parents=True, exist_ok=True)
    write_texts({directory / 'report.json': numbers, directory / 'report.html': page})
    return directory / 'report.html'
