"""One stretch of a run in a report: verdict, findings, pictures, tables."""

from __future__ import annotations

import math
from collections.abc import Callable

from .report_axes import Picture
from .report_glossary import linked
from .report_history import draw_history
from .report_html import Html, listed, safe
from .report_portraits import draw_damper_portrait, draw_primary_portrait, draw_section
from .report_response import draw_convergence, draw_gap_curve, draw_spectrum
from .report_svg import inline_svg
from .report_tables import (
    cause_of,
    comparison_table,
    energy_table,
    linked_badge,
    motion_of,
    multiplier_table,
    parameter_table,
)
from .report_units import instant, number, unit_for
from .run_comparison import StretchComparison

__all__ = ['PICTURES', 'figure_html', 'stretch_html']

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
    """
    Return a picture with its caption.

    Parameters
    ----------
    picture : Picture
        The picture; drawn within `drawing_style`.
    key : str
        Begins the ids of its parts.
    where : str
        What it is of, for those who have it read out.
    narrow : Picture, optional
        The same for a phone, if the picture is too wide for one.
    """
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
    """
    Return the section of a stretch.

    Parameters
    ----------
    stretch : StretchComparison
        The stretch.
    before : StretchComparison or None
        The one before it in the run, for what has changed.

    Returns
    -------
    Html
        To be made within `drawing_style`.
    """
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
