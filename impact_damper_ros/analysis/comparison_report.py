"""
The report of `compare_run`: one page that holds all it shows, and the numbers as JSON.

The page needs nothing but itself: no network, no script, no other file. It has the same bytes for
the same recording.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from errno import ENOTDIR
from importlib.resources import files
from itertools import pairwise
from os import strerror
from pathlib import Path
from string import Template

from .report_glossary import glossary_html, linked
from .report_history import draw_run
from .report_html import Html, listed, safe
from .report_stretch import figure_html, stretch_html
from .report_svg import drawing_style
from .report_tables import linked_badge, overall_table, overview_table, sign_of
from .report_units import instant
from .run_comparison import RunComparison, StretchComparison, Verdict

__all__ = ['report_page', 'told_stretches', 'write_report']

#: Stretches that are shown in detail, and those that are listed; a page of more is of no use.
MOST_DETAILED, MOST_LISTED = 12, 300

_TEMPLATE = files('impact_damper_ros.analysis') / 'report_template'
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
    """
    Return the page.

    Parameters
    ----------
    comparison : RunComparison
        What it reports.
    command : str, optional
        The command line that was given.
    drawn : callable, optional
        Called with the number of stretches that are drawn, and of those to draw.
    """
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
