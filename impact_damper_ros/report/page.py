"""
The report of `compare_run`: one page that holds all it shows, and the numbers as JSON.

The page needs nothing but itself: no network, no script, no other file. It has the same bytes for
the same recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from errno import ENOTDIR
from importlib.resources import files
from itertools import pairwise
from os import strerror
from pathlib import Path
from string import Template

from impact_damper_ros.compare import RunComparison, StretchComparison, Verdict

from .charts import Picture, draw_history, draw_run
from .glossary import glossary_html, linked
from .html import Html, drawing_style, inline_svg, listed, safe
from .portraits import (
    draw_convergence,
    draw_damper_portrait,
    draw_gap_curve,
    draw_primary_portrait,
    draw_section,
    draw_spectrum,
)
from .tables import (
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
from .units import instant, number, unit_for

__all__ = [
    'PICTURES',
    'figure_html',
    'report_page',
    'stretch_html',
    'told_stretches',
    'write_report',
]


#: Pictures of a stretch by the name that begins their ids, in the order of the page.
PICTURES: dict[str, Callable[[StretchComparison], Picture | None]] = {
    'history': draw_history,
    'portrait': draw_primary_portrait,
    'relative': draw_damper_portrait,
    'section': draw_section,
    'spectrum': draw_spectrum,
    'convergence': draw_convergence,
    'gap': draw_gap_curve,
}
#: Why some of them may be missing.
_NEEDED = {
    'section': 'a Poincaré section needs impacts and a known phase of the force',
    'convergence': 'a convergence plot needs a periodic motion that is approached',
    'gap': 'a gap curve needs a periodic motion that theory can follow',
}
_MOST_FINDINGS = 20


def figure_html(picture: Picture, key: str, where: str, narrow: Picture | None = None) -> Html:
    """Return a picture with its caption."""
    label = f'{picture.title}, {where}'
    drawn = inline_svg(picture.figure, key, label)
    if narrow is not None:
        small = inline_svg(narrow.figure, f'{key}-narrow', label)
        drawn = f'<div class="broad">{drawn}</div><div class="slim">{small}</div>'
    caption = f'<strong>{linked(picture.title)}.</strong> {linked(picture.caption)}'
    kind = 'wide' if picture.wide else 'narrow'
    return Html(f'<figure class="{kind}">{drawn}<figcaption>{caption}</figcaption></figure>')


def _tiles(stretch: StretchComparison) -> Html:
    """Return the few numbers to look at first."""
    measured, orbit, decay = stretch.measured, stretch.predicted, stretch.decay
    tiles: list[tuple[str, str, str]] = []
    if stretch.stops:
        stops = f'stops {", ".join(map(str, stretch.stops))}'
        tiles.append(('Motion', motion_of(stretch), stops))
    else:
        tiles.append(('Motion', motion_of(stretch), f'{stretch.impacts} impacts'))
    if measured is not None:
        unit = unit_for('m', measured.x_max)
        theory = 'no prediction'
        if orbit is not None:
            theory = f'predicted {number(unit.factor * orbit.x_max, 5)} {unit.name}'
        swing = f'{number(unit.factor * measured.x_max, 5)} {unit.name}'
        tiles.append(('Largest |X|', swing, theory))
        amplitude = stretch.parameters.response_amplitude
        handy = unit_for('m', amplitude)
        without = 'no single harmonic drives it'
        if amplitude > 0.0:
            without = f'A = {number(handy.factor * amplitude, 4)} {handy.name} without impacts'
        tiles.append(('Xmax / A', number(measured.amplitude_ratio, 4), without))
        blow = unit_for('N s', measured.mean_impulse)
        impulse = f'mean impulse {number(blow.factor * measured.mean_impulse, 3)} {blow.name}'
        tiles.append(('Impacts per cycle', number(measured.impacts_per_cycle, 4), impulse))
    if stretch.settled_at is None:
        tiles.append(('Steady', 'not reached', f'in {instant(stretch.end - stretch.start)} s'))
    else:
        after = f'after {instant(stretch.settled_at - stretch.start)} s'
        tiles.append(('Steady since', f'{instant(stretch.settled_at)} s', after))
    if decay is not None:
        largest = f'largest multiplier {number(decay.predicted, 4)}'
        known = math.isfinite(decay.measured)
        factor = f'× {number(decay.measured, 4)}' if known else 'not measured'
        tiles.append(('Decay per period', factor, largest))
    return Html(
        '<dl class="tiles">'
        + ''.join(
            f'<div><dt>{linked(name)}</dt>'
            f'<dd>{linked(value)}<small>{linked(small)}</small></dd></div>'
            for name, value, small in tiles
        )
        + '</dl>'
    )


def _findings(stretch: StretchComparison) -> Html:
    """Return what is not as it should be; empty if all is well."""
    texts = [f'{instant(f.time)} s: {f.text}' for f in stretch.findings[:_MOST_FINDINGS]]
    left = len(stretch.findings) - len(texts)
    if left > 0:
        texts.append(f'{left} more, see report.json')
    if stretch.missing_samples:
        texts.append(f'{stretch.missing_samples} samples are missing in the log')
    if not texts:
        return Html()
    texts = [linked(text) for text in texts]
    return Html(f'<div class="notes"><h3>Findings</h3>{listed(texts)}</div>')


def _pictures(stretch: StretchComparison) -> Html:
    """Return the plots, and why some are not there."""
    shown: list[str] = []
    missing: list[str] = []
    for name, draw in PICTURES.items():
        picture = draw(stretch)
        if picture is not None:
            key, where = f's{stretch.number}-{name}', f'stretch {stretch.number}'
            narrow = draw_history(stretch, wide=False) if name == 'history' else None
            shown.append(figure_html(picture, key, where, narrow))
        elif name in _NEEDED:
            missing.append(_NEEDED[name])
    if not shown:
        return Html('<p>Of this stretch too little was recorded to draw anything.</p>')
    why = f'<p class="judged">Not drawn: {linked("; ".join(missing))}.</p>' if missing else ''
    return Html(f'<div class="plots">{"".join(shown)}</div>{why}')


def stretch_html(stretch: StretchComparison, before: StretchComparison | None) -> Html:
    """Return the section of a stretch."""
    tables = [
        comparison_table(stretch) + multiplier_table(stretch),
        energy_table(stretch) + parameter_table(stretch, before),
    ]
    columns = ''.join(f'<div>{part}</div>' for part in tables if part)
    evidence = '' if stretch.evidence in stretch.sentence else stretch.evidence
    told = (('Kind of motion', evidence), ('Prediction', stretch.solver))
    judged = ''.join(
        f'<p class="judged">{name}: {linked(text)}</p>' for name, text in told if text
    )
    time = f'{instant(stretch.start)} s to {instant(stretch.end)} s of rig time, '
    time += f'{stretch.samples} samples, {stretch.impacts} impacts'
    return Html(
        f'<section class="stretch" id="stretch-{stretch.number}" '
        f'aria-labelledby="stretch-{stretch.number}-title">'
        f'<h2 id="stretch-{stretch.number}-title">Stretch {stretch.number}: '
        f'{safe(cause_of(stretch))}</h2>'
        f'<p class="verdict">{linked_badge(stretch.verdict)}{linked(stretch.sentence)}</p>'
        f'<p class="judged">{linked(time)}</p>'
        f'{_findings(stretch)}{_tiles(stretch)}{_pictures(stretch)}'
        f'<div class="tables">{columns}</div>'
        f'{judged}'
        '</section>'
    )


#: Stretches that are shown in detail, and those that are listed; a page of more is of no use.
MOST_DETAILED, MOST_LISTED = 12, 300

_TEMPLATE = files('impact_damper_ros.report') / 'template'
_URGENCY = {
    Verdict.DIFFERS: 0,
    Verdict.PREDICTED_UNSTABLE: 1,
    Verdict.AGREES: 2,
    Verdict.NOT_SETTLED: 2,
    Verdict.NO_PREDICTION: 2,
    Verdict.TOO_SHORT: 3,
}


def told_stretches(
    stretches: Sequence[StretchComparison], most: int
) -> tuple[StretchComparison, ...]:
    """
    Return the most telling stretches, in the order of the run.

    Those that differ from theory come first, then those with findings, then the longest.

    Parameters
    ----------
    stretches : sequence of StretchComparison
        All of them.
    most : int
        How many.
    """

    def weight(stretch: StretchComparison) -> tuple[int, bool, float]:
        length = stretch.end - stretch.start
        return _URGENCY.get(stretch.verdict, 2), not stretch.findings, -length

    chosen = sorted(stretches, key=weight)[:most]
    return tuple(sorted(chosen, key=lambda stretch: stretch.number))


def _count(number: int, word: str) -> str:
    return f'{number} {word}' if number == 1 else f'{number} {word}s'


def _summary(comparison: RunComparison) -> Html:
    """Return the verdicts on the whole run, and what is wrong with the recording."""
    counts = [
        (verdict, sum(s.verdict is verdict for s in comparison.stretches)) for verdict in Verdict
    ]
    badges = ' '.join(linked_badge(verdict, count) for verdict, count in counts if count)
    stretches = len(comparison.stretches)
    told = f'{_count(stretches, "stretch") if stretches == 1 else f"{stretches} stretches"} of '
    told += f'constant parameters in {instant(comparison.end - comparison.start)} s, '
    told += f'{_count(comparison.samples, "sample")} and {_count(comparison.impacts, "impact")}.'
    text = f'<p>{linked(told)}</p>'
    if badges:
        text += f'<p class="verdict">{badges}</p>'
    checked = f'Checked: {comparison.log.text}.'
    if comparison.log.unchecked:
        checked += f' Not checked: {"; ".join(comparison.log.unchecked)}.'
    text += f'<p>{linked(checked)}</p>'
    if comparison.faults:
        text += '<div class="notes"><h2>The recording can be used in part only</h2>'
        text += f'{listed(map(linked, comparison.faults))}</div>'
    if comparison.remarks:
        remarks = listed(map(linked, comparison.remarks))
        text += f'<div class="notes calm"><h2>Remarks</h2>{remarks}</div>'
    return Html(text)


def _overview(comparison: RunComparison, detailed: Sequence[StretchComparison]) -> Html:
    """Return the picture of the whole run and the table of its stretches."""
    stretches = comparison.stretches
    begin = '<section class="first" aria-labelledby="overview"><h2 id="overview">Overview</h2>'
    if not stretches:
        return Html(f'{begin}<p>The recording has nothing to compare.</p></section>')
    listed_ones = told_stretches(stretches, MOST_LISTED)
    notes = []
    if len(detailed) < len(stretches):
        notes.append(
            f'{len(detailed)} of {len(stretches)} are shown in detail: those that differ or have '
            'findings, then the longest.'
        )
    if len(listed_ones) < len(stretches):
        notes.append(
            f'{len(stretches) - len(listed_ones)} are left out here; report.json has all of them.'
        )
    picture = draw_run(stretches)
    narrow = draw_run(stretches, wide=False)
    drawn = '' if picture is None else figure_html(picture, 'run', 'all stretches', narrow)
    numbers = {stretch.number for stretch in detailed}
    left_out = notes[-1] if len(listed_ones) < len(stretches) else ''
    return Html(
        f'{begin}<div class="plots">{drawn}</div>'
        f'{overview_table(listed_ones, numbers, " ".join(notes))}'
        f'{overall_table(listed_ones, comparison.overall, left_out)}</section>'
    )


def _navigation(detailed: Sequence[StretchComparison]) -> Html:
    links = ['<li><a href="#overview">Overview</a></li>']
    links += [
        f'<li><a href="#stretch-{s.number}" title="Stretch {s.number}: {safe(s.verdict.value)}">'
        f'{sign_of(s.verdict)} {s.number}</a></li>'
        for s in detailed
    ]
    links.append('<li><a href="#glossary">Glossary</a></li>')
    links.append('<li><a href="#origin">How it was obtained</a></li>')
    return Html(f'<ol>{"".join(links)}</ol>')


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
        facts.append(('Command', Html(f'<code>{safe(command)}</code>')))
    rows = ''.join(f'<dt>{linked(name)}</dt><dd>{safe(value)}</dd>' for name, value in facts)
    words = (
        'What is measured is taken from the recording alone: samples, impacts and parameters as '
        'logged. What is predicted is the exact periodic motion for these parameters. All numbers,'
        ' also those of stretches without a section here, stand in report.json beside this page.'
    )
    return Html(
        '<section aria-labelledby="origin"><h2 id="origin">How it was obtained</h2>'
        f'<p>{linked(words)}</p><dl class="facts">{rows}</dl></section>'
    )


def report_page(
    comparison: RunComparison,
    *,
    command: str = '',
    drawn: Callable[[int, int], None] | None = None,
) -> str:
    """Return the page."""
    detailed = told_stretches(comparison.stretches, MOST_DETAILED)
    before = {b.number: a for a, b in pairwise(comparison.stretches)}
    sections = []
    with drawing_style():
        overview = _overview(comparison, detailed)
        for count, stretch in enumerate(detailed, 1):
            sections.append(stretch_html(stretch, before.get(stretch.number)))
            if drawn is not None:
                drawn(count, len(detailed))
    name = Path(comparison.bag).name or comparison.bag
    style = (_TEMPLATE / 'report.css').read_text('utf-8').strip()
    return Template((_TEMPLATE / 'report.html').read_text('utf-8')).substitute(
        title=safe(f'{name}: held against theory'),
        heading=safe(name),
        style=style,
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
        The command line that was given, to be told on the page.
    drawn : callable, optional
        Called with the number of stretches that are drawn, and of those to draw.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OSError
        If it cannot be written; its `filename` says what.
    """
    page = report_page(comparison, command=command, drawn=drawn)
    numbers = json.dumps(comparison.as_dict(), indent=1, allow_nan=False) + '\n'
    contents = {'report.json': numbers, 'report.html': page}
    if directory.exists() and not directory.is_dir():
        raise NotADirectoryError(ENOTDIR, strerror(ENOTDIR), str(directory))
    directory.mkdir(parents=True, exist_ok=True)
    parts = {directory / name: directory / f'.{name}.part' for name in contents}
    try:
        for (path, part), content in zip(parts.items(), contents.values(), strict=True):
            try:
                part.write_text(content, encoding='utf-8')
            except OSError as error:
                # A full disk is told without a name.
                raise OSError(error.errno, error.strerror, str(path)) from error
        for path, part in parts.items():
            part.replace(path)
    finally:
        for part in parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)
    return directory / 'report.html'
