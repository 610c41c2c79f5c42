"""The report: figures, captions, claims and the numbers behind each curve, as files."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from impact_damper_ros.report.drawing import save_figure

from .claims import (
    Claim,
    agreement_claims,
    air_claims,
    claims_table,
    frequency_scale_claims,
    gap_claims,
    optimum_claims,
    response_claims,
    vertical_claims,
)
from .curves import Status
from .figures import draw_figure_2, draw_figure_3, draw_figure_4, draw_figure_5, draw_figure_6
from .plan import FIGURES, OptimumPoint, Series

__all__ = ['CAPTIONS', 'claims_of', 'write_figure', 'write_report']


_COMMON = (
    'Lines: theory, solid where stable, dashed where unstable; solutions that the rig cannot '
    'perform are left out. Open marks: settled runs of the exact simulator.'
)

#: Files of each figure, with their captions.
CAPTIONS: dict[str, dict[str, str]] = {
    '2': {
        f'figure_2_g{g}': (
            f'**Figure 2, g = {g} m/s²** ({where}). Durations between impacts, in half-cycles of '
            'the force, and largest displacement over the displacement A without impacts, '
            'against the gap, for two (a, b), three (c, d) and four (e, f) impacts in one cycle. '
            'K = 1 N/m, M = 1 kg, F = 1 N, m = 0.042 kg, C = 0.01 N s/m, R₁ = R₂ = 0.75, '
            'Ω = 1.02 rad/s. Two impacts: all viable solutions of the impact equations. Three '
            'and four: motions followed over the gap by shooting as far as they go without '
            'turning back at a fold, drawn if stable somewhere (the others are in the CSV file). '
            'In (e, f) the family that ends near 9 m hits each stop twice in a row, the one that '
            'ends near 13 m hits one stop three times. With friction m reverses within the '
            'flights that return to the same stop, and friction with it, which the equations of '
            'the paper leave out; where that happens with two impacts, the motion is followed by '
            'shooting, too.'
        )
        for g, where in ((1, "as in the paper's caption"), (2, "as in the paper's text"))
    },
    '3': {
        'figure_3': (
            '**Figure 3.** Largest displacement with two impacts per cycle. (a) Unequal '
            'restitution, r = 1, g = 2 m/s², the three operations of Figure 2. (b) Against the '
            'angle, g = 9.81 m/s², d = 37 m; simulated up to 50°. (c) Against the input '
            'frequency for four angles, g = 9.81 m/s², d = 37 m. (d) Against the friction '
            'coefficient, horizontal, d = 50 m, r = 1, g = 9.81 m/s².'
        )
    },
    '4': {
        'figure_4': (
            '**Figure 4.** Largest displacement against the natural frequency, g = 9.81 m/s², '
            'd = 50 m, r = 1. The values printed (AK/F₀ = 1, ζ = 0.05, r = 1) exclude each other; '
            'drawn are F₀/K = 1 m and ζ = 0.005.'
        )
    },
    '5': {
        'figure_5': (
            '**Figure 5.** (a) The gap that makes the displacement smallest and (b) the '
            'displacement with it, against the angle; r = 1, g = 9.81 m/s², no friction, two '
            'impacts per cycle, stable and viable motions only. Bars mark optima at an edge of '
            'stability. Simulations start near the motion (velocity of M off by 0.1 % of its '
            'swing), since other attractors are near; right at an edge of stability none settles.'
        )
    },
    '6': {
        'figure_6': (
            '**Figure 6.** Largest displacement against the force p of compressed air on m, '
            'horizontal, γ = 0.5, g = 9.81 m/s², d = 37 m. p is constant between impacts and '
            'points away from the stop hit last. At p = mγg the air just cancels friction; at '
            'p = 2mγg it drives m as strongly as friction alone would brake it.'
        )
    },
}


def _needs(figure: str, results: Mapping[str, Series]) -> dict[str, Series]:
    return {name: s for name, s in results.items() if name.startswith(f'{figure} ')} | {
        name: s for name, s in results.items() if name.startswith(figure)
    }


def claims_of(
    figure: str, results: Mapping[str, Series], optima: Sequence[OptimumPoint]
) -> list[Claim]:
    """
    Judge the claims about one figure.

    Parameters
    ----------
    figure : str
        One of `FIGURES`.
    results : mapping of str to Series
        Series by name; those of this figure must be among them.
    optima : sequence of OptimumPoint
        For Figure 5.
    """
    judges: dict[str, Callable[[Mapping[str, Series]], list[Claim]]] = {
        '2': gap_claims,
        '3': response_claims,
        '4': frequency_scale_claims,
        '6': air_claims,
    }
    return optimum_claims(optima) if figure == '5' else judges[figure](_needs(figure, results))


def _write_whole(path: Path, text: str) -> None:
    part = path.with_name(f'.{path.name}.part')
    try:
        part.write_text(text, encoding='utf-8')
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _series_csv(results: Mapping[str, Series]) -> str:
    """Return the numbers behind sweeps; solutions that are not viable are left out."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['series', 'variable', 'curve', 'stops', 'cycles', 'kind', 'value',
                     'xmax_over_a', 'largest_multiplier', 'durations'])  # fmt: skip
    for name, series in results.items():
        head = [name, series.sweep.variable]
        for number, curve in enumerate(series.curves, 1):
            stops = ''.join(map(str, curve.stops))
            for p in curve.points:
                if p.status == Status.NOT_VIABLE:
                    continue
                lasts = ' '.join(f'{v:.6f}' for v in p.durations)
                kind = p.status.name.lower()
                writer.writerow([*head, number, stops, 1, kind, f'{p.value:.8g}',
                                 f'{p.ratio:.7f}', f'{p.modulus:.6f}', lasts])  # fmt: skip
        for m in series.marks:
            if m.stops and len(m.stops) <= 8:
                lasts = ' '.join(f'{v:.6f}' for v in m.durations)
                writer.writerow([*head, '', ''.join(map(str, m.stops)), m.cycles, 'simulated',
                                 f'{m.value:.8g}', f'{m.ratio:.6f}', '', lasts])  # fmt: skip
    return text.getvalue()


def _optima_csv(optima: Sequence[OptimumPoint]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['angle_degrees', 'gap', 'xmax_over_a', 'simulated', 'limit', 'beyond'])
    for p in optima:
        ratio = f'{p.best.orbit.amplitude_ratio:.7f}'
        settled = f'{p.settled.ratio:.6f}' if p.settled.stops else ''
        writer.writerow([f'{p.angle:g}', f'{p.best.gap:.5f}', ratio, settled,
                         p.best.limit.value, p.best.beyond])  # fmt: skip
    return text.getvalue()


def write_figure(
    figure: str,
    results: Mapping[str, Series],
    optima: Sequence[OptimumPoint],
    directory: Path,
) -> list[Path]:
    """
    Draw a figure and write it, with the numbers behind it.

    Parameters
    ----------
    figure : str
        One of `FIGURES`.
    results : mapping of str to Series
        Series by name.
    optima : sequence of OptimumPoint
        For Figure 5.
    directory : Path
        Where.

    Returns
    -------
    list of Path
        The files.
    """
    draw = {'3': draw_figure_3, '4': draw_figure_4, '6': draw_figure_6}
    written = []
    for name in CAPTIONS[figure]:
        if figure == '2':
            drawing = draw_figure_2(results, float(name[-1]))
        elif figure == '5':
            drawing = draw_figure_5(optima)
        else:
            drawing = draw[figure](results)
        save_figure(drawing, directory / f'{name}.png')
        written.append(directory / f'{name}.png')
    numbers = _optima_csv(optima) if figure == '5' else _series_csv(_needs(figure, results))
    _write_whole(directory / f'figure_{figure}.csv', numbers)
    return [*written, directory / f'figure_{figure}.csv']


def write_report(
    results: Mapping[str, Series], optima: Sequence[OptimumPoint], directory: Path
) -> list[Claim]:
    """
    Write README.md: every figure with its caption, and the table of claims.

    Parameters
    ----------
    results : mapping of str to Series
        All series.
    optima : sequence of OptimumPoint
        For Figure 5.
    directory : Path
        Where.

    Returns
    -------
    list of Claim
        All claims.
    """
    claims = agreement_claims(results)
    for figure in FIGURES:
        claims += claims_of(figure, results, optima)
    claims += vertical_claims()
    lines = [
        '# The paper, reproduced',
        '',
        'C. N. Bapat, *The general motion of an inclined impact damper with friction*, Journal '
        'of Sound and Vibration 184(3), 417-427, 1995. Made by `reproduce_paper`; the numbers '
        'behind each figure are in the CSV file of its name.',
        '',
        _COMMON,
        '',
        "The paper's figures come without readable axes: the ranges are chosen here. Motions that "
        'do not repeat within four cycles of the force are not marked. The simulator starts from '
        'rest, and from settled motion at the neighbouring marks or near predicted motion, so '
        'that attractors not reached from rest are seen too.',
        '',
    ]
    for captions in CAPTIONS.values():
        for name, caption in captions.items():
            lines += [f'![{name}]({name}.png)', '', caption, '']
    lines += ['## Claims', '', claims_table(claims)]
    _write_whole(directory / 'README.md', '\n'.join(lines))
    return claims
