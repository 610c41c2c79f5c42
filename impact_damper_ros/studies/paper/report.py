"""The report: figures, captions, claims and the numbers behind each curve, as files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from impact_damper_ros.outputs import write_text
from impact_damper_ros.report.drawing import save_figure
from impact_damper_ros.report.formatting import markdown_table

from .claim import Claim
from .curves import Status
from .figure_claims import all_claims
from .figures import draw_figure_2, draw_figure_3, draw_figure_4, draw_figure_5, draw_figure_6
from .series import AngleOptimum, Series

#: Files of each figure, with their captions.
_CAPTIONS: dict[str, dict[str, str]] = {
    '2': {
        f'figure_2_g{g}': (
            f'**Figure 2, g = {g} m/s²** ({where}). Durations between impacts, in half-cycles of '
            'the force, and largest displacement over the displacement A without impacts, '
            'against the gap, for two (a, b), three (c, d) and four (e, f) impacts in one cycle. '
            'K = 1 N/m, M = 1 kg, F = 1 N, m = 0.042 kg, C = 0.01 N s/m, R₁ = R₂ = 0.75, '
            'Ω = 1.02 rad/s. Two impacts: all viable solutions of the impact equations. Three '
            'and four: motions that are stable somewhere, followed over the gap, up '
            'to a fold at most. They start from all viable solutions of the impact equations at '
            'every second gap; with friction, from the motions of the rigs without it, with '
            'angle, friction and gravity changed step by step. In (e, f) the family that ends '
            'near 9 m hits each stop twice in a row, the one that ends near 13 m hits one stop '
            'three times. With friction, m reverses within the flights that return to the same '
            'stop, and so does the friction force, which the equations of the paper do not allow '
            'for; motions of two impacts with such reversals are followed, too.'
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
            'd = 50 m, r = 1. The printed values (AK/F₀ = 1, ζ = 0.05, r = 1) contradict each '
            'other; the figure is for F₀/K = 1 m and ζ = 0.005.'
        )
    },
    '5': {
        'figure_5': (
            '**Figure 5.** (a) The gap with the smallest displacement and (b) that displacement, '
            'against the angle; r = 1, g = 9.81 m/s², no friction, two impacts per cycle, stable '
            'and viable motions only. Bars mark optima at an edge of stability. Simulations start '
            'near the motion (velocity of M off by 0.1 % of its amplitude), since other '
            'attractors are near; at an edge of stability they do not settle.'
        )
    },
    '6': {
        'figure_6': (
            '**Figure 6.** Largest displacement against the force p of compressed air on m, '
            'horizontal, γ = 0.5, g = 9.81 m/s², d = 37 m. p is constant between impacts and '
            'points away from the stop hit last. At p = mγg the air cancels friction; at p = 2mγg '
            'it drives m as strongly as friction alone would brake it.'
        )
    },
}


def _series_csv(results: Mapping[str, Series]) -> str:
    """Return the numbers behind series; solutions that are not viable are left out."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['series', 'variable', 'curve', 'stops', 'cycles', 'kind', 'value',
                     'xmax_over_a', 'largest_multiplier', 'durations'])  # fmt: skip
    for name, series in results.items():
        head = [name, series.plan.variable]
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


def _optima_csv(optima: Sequence[AngleOptimum]) -> str:
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
    optima: Sequence[AngleOptimum],
    directory: Path,
) -> list[Path]:
    """Write the pictures of a figure and the CSV file of its numbers; return their paths."""
    draw = {'3': draw_figure_3, '4': draw_figure_4, '6': draw_figure_6}
    written = []
    for name in _CAPTIONS[figure]:
        if figure == '2':
            drawing = draw_figure_2(results, float(name[-1]))
        elif figure == '5':
            drawing = draw_figure_5(optima)
        else:
            drawing = draw[figure](results)
        written.append(directory / f'{name}.png')
        save_figure(drawing, written[-1])
    own = {name: series for name, series in results.items() if name[0] == figure}
    written.append(directory / f'figure_{figure}.csv')
    write_text(written[-1], _optima_csv(optima) if figure == '5' else _series_csv(own))
    return written


_INTRODUCTION = """\
# The paper, reproduced

C. N. Bapat, *The general motion of an inclined impact damper with friction*, Journal of Sound and
Vibration 184(3), 417-427, 1995. `reproduce_paper` makes this page, the figures, and a CSV file
with the numbers behind each figure.

Lines are theory, solid where stable and dashed where unstable; solutions that the rig cannot
perform are left out. No line with three or four impacts starts from a simulation. Open marks are
settled runs of the exact simulator, from rest, from near the predicted motions, and from the
settled motions at the neighbouring marks, so that attractors not reached from rest are found, too.
Motions that do not repeat within four cycles of the force have no mark. The figures of the paper
have no readable axes: the ranges are chosen here.
"""


_VERDICTS = """\
*Reproduced in part*: the claim holds for some of the rigs, motions or measures that it is about;
the verdict says for which. A change of the displacement by less than 10 % counts as small.
"""


def write_report(
    results: Mapping[str, Series], optima: Sequence[AngleOptimum], directory: Path
) -> list[Claim]:
    """Write README.md, with every figure and the table of claims; return the claims."""
    claims = all_claims(results, optima)
    lines = [_INTRODUCTION]
    for captions in _CAPTIONS.values():
        for name, caption in captions.items():
            lines += [f'![{name}]({name}.png)', '', caption, '']
    rows = [
        (str(number), one.figure, one.claim, one.computed, _bold(one.verdict))
        for number, one in enumerate(claims, 1)
    ]
    table = markdown_table(('no.', 'about', 'claim', 'computed', 'verdict'), rows)
    lines += ['## Claims', '', _VERDICTS, table, '']
    write_text(directory / 'README.md', '\n'.join(lines))
    return claims


def _bold(verdict: str) -> str:
    judgement, colon, remark = verdict.partition(':')
    return f'**{judgement}**{colon}{remark}'
