# SPDX-License-Identifier: Apache-2.0
"""The report of a design: table, text, JSON, and the figure with mass dampers for comparison."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.design.bench_plan import PlannedRun
from impact_damper_ros.design.damper_design import Design
from impact_damper_ros.design.mass_damper import (
    Comparison,
    den_hartog,
    mass_damper_response,
    tuned_to_excitation,
)
from impact_damper_ros.design.worst_case import WorstCase, WorstCases
from impact_damper_ros.orbits.branch import Span
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .drawing import (
    COLORS,
    blank_figure,
    finish_panel,
    legend_below,
    place_log_ticks,
    print_style,
    unit_axis,
)
from .formatting import percent, quantity
from .table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
#: A damper helps if it leaves less than this part of the amplitude.
_HELPS = 0.98


def _mass(design: Design) -> str:
    mass = design.rig.damper_mass
    return f'{mass:.4g} kg' if mass >= 1.0 else f'{1e3 * mass:.4g} g'


def design_table(found: Sequence[Design]) -> Table:
    """Return the designs as a table for people."""
    head = (
        *('m/M', 'm', 'best gap', 'largest |X|', 'over none', 'from rest'),
        *('gap to build', 'its |X|', 'over none', 'at a stop', 'impulse', "X''"),
    )
    rows = [
        (
            percent(d.mass_ratio),
            _mass(d),
            quantity(d.rig.gap, 'm', 4),
            quantity(d.orbit.x_max, 'm', 3),
            percent(d.orbit.x_max / d.bare),
            'yes' if d.reached_from_rest else 'no',
            quantity(d.gap, 'm', 4),
            quantity(d.x_max, 'm', 3),
            percent(d.x_max / d.bare),
            f'{d.impact_speed:.3g} m/s',
            f'{d.impulse:.3g} N s',
            f'{d.acceleration / STANDARD_GRAVITY:.3g} g',
        )
        for d in found
    ]
    return Table.of_rows(head, rows)


def _span_words(span: Span, unit: str, factor: float) -> str:
    low, high = f'{factor * span.low:.4g}', f'{factor * span.high:.4g}'
    # A grazing has its details behind a colon
    below, above = (reason.partition(':')[0] for reason in (span.low_reason, span.high_reason))
    low = f'{low} ({below})' if below else f'{low} or less'
    high = f'{high} {unit} ({above})' if above else f'{high} {unit} or more'
    return f'from {low} to {high}'


def _from_rest_words(design: Design) -> list[str]:
    """Return the sentences on a start from rest."""
    texts = []
    alone, rig = design.starts_by_itself, design.rig
    best, best_gap = quantity(design.orbit.x_max, 'm', 3), quantity(rig.gap, 'm', 4)
    if design.x_max > design.bare:
        texts.append('That is more than without the damper: it is no help here.')
    if alone is not None:
        if design.reached_from_rest:
            texts.append(f'Two impacts per cycle leave {best} at least, with {best_gap}.')
        else:
            why = (
                'M at rest never swings across it: m has to be started by a push.'
                if rig.gap > design.widest_hit
                else 'from rest the rig settles into another motion: m needs a push.'
            )
            texts.append(f'A gap of {best_gap} would leave {best}, but {why}')
        kept = 'is hit as well' if alone.keeps_margin else 'is not hit'
        texts.append(f'With {quantity(alone.gap, "m", 4)}, m {kept} if the level is 5 % lower.')
    if (other := design.without_margin) is not None:
        texts.append(
            f'A gap of {quantity(other.gap, "m", 4)} would leave {quantity(other.x_max, "m", 3)} '
            'from rest, but m is not hit with it if the level is 5 % lower.'
        )
    return texts


def _fall(rig: RigParameters) -> str:
    """Return the speed from which restitution falls, in words; empty for a constant one."""
    speed = rig.restitution_speed
    return f', which falls with the speed from {quantity(speed, "m/s", 3)}' if speed else ''


def choice_text(found: Mapping[float, Design | None], reduction: float, missed: bool) -> str:
    """
    Return what is to be known about the choice among mass ratios; empty if there is nothing.

    Parameters
    ----------
    found : mapping of float to Design or None
        Designs by mass ratio; None where there is none.
    reduction : float
        The share of |X| that a damper should leave at most.
    missed : bool
        Whether all leave more.
    """
    missing = ', '.join(percent(ratio) for ratio, design in found.items() if design is None)
    lines = [f'No stable motion of two impacts per cycle for m/M of {missing}.'] if missing else []
    if missed:
        lines.append(
            f'No damper here leaves at most {percent(reduction)} of |X| (--reduction): the one '
            'that leaves the least is chosen.'
        )
    return ''.join(f'{line}\n' for line in lines)


def design_text(design: Design, unsure: WorstCases, compared: Comparison) -> str:
    """Return the text of the chosen design."""
    half = quantity(design.gap, 'm', 4)
    texts = [
        f'Best at this level and frequency: a gap of {half} in all, which leaves '
        f'{quantity(design.x_max, "m", 3)} of {quantity(design.bare, "m", 3)}, '
        f'{percent(design.x_max / design.bare)}.',
        *_from_rest_words(design),
        _worst_words(unsure),
    ]
    lines = [
        f'Chosen: {percent(design.mass_ratio)} of the mass, {_mass(design)}, for R = '
        f'{design.rig.restitution_1:.4g}{_fall(design.rig)}.',
        *map(_indent, texts),
        'Once m hits both stops in each cycle, with the best gap, that motion lasts for',
        f'  gaps {_span_words(design.gap_range, "mm", 1e3)},',
        f'  levels {_span_words(design.level_range, "times this one", 1.0)},',
        f'  frequencies {_span_words(design.frequency_range, "Hz", 1.0 / math.tau)}.',
        *_compared_words(design, compared),
    ]
    return '\n'.join(lines)


def _indent(text: str) -> str:
    return textwrap.fill(text, 102, initial_indent='  ', subsequent_indent='  ')


def _ends(low: float, high: float) -> str:
    """Return two numbers with as many digits as distinguish them, at least four."""
    digits = next((n for n in range(4, 17) if f'{low:.{n}g}' != f'{high:.{n}g}'), 17)
    return f'{low:.{digits}g} to {high:.{digits}g}'


def _uncertain_words(unsure: WorstCases) -> str:
    """Return the uncertain parameters and their ranges in words."""
    bounces = [ends for name, ends in unsure.ranges.items() if name.startswith('restitution')]
    parts = []
    if bounces:
        low, high = min(low for low, _ in bounces), max(high for _, high in bounces)
        parts.append(f'R from {_ends(low, high)}')
    for name, (low, high) in unsure.ranges.items():
        if not name.startswith('restitution'):
            unit = ALL_SPECS[name].unit
            parts.append(f'{name} from {_ends(low, high)}{unit and f" {unit}"}')
    low, high = unsure.levels
    levels = f'the level from {low:g} to {high:g} times this one' if low < high else 'this level'
    return f'{", ".join(parts)} and {levels}' if parts else levels


def case_words(worst: WorstCase) -> str:
    """Return a worst case in words."""
    parts = [f'level {worst.case["level"]:.4g}']
    bounces = {f'{v:.4g}' for n, v in worst.case.items() if n.startswith('restitution')}
    parts += [f'R {" and ".join(sorted(bounces))}'] if bounces else []
    for name, value in worst.case.items():
        if name != 'level' and not name.startswith('restitution'):
            unit = ALL_SPECS[name].unit
            parts.append(f'{name} {value:.5g}{unit and f" {unit}"}')
    return ', '.join(parts)


def _worst_words(unsure: WorstCases) -> str:
    """Return the worst cases of the gap to build, and of the gap for which it is least."""
    chosen, best = unsure.chosen, unsure.best
    gap, other = quantity(chosen.gap, 'm', 4), quantity(best.gap, 'm', 4)
    low, high = unsure.as_good
    ends = f'{quantity(low, "m", 3)} to {quantity(high, "m", 3)}'
    flat = f' Gaps from {ends} are as good, within 2 %.' if low < high else ''
    text = (
        f'How sure: with {_uncertain_words(unsure)}, the worst of {len(chosen.ratios):,} runs '
        f'from rest leaves {percent(chosen.ratio)} with {gap} ({case_words(chosen)}). '
    )
    if other == gap:
        return f'{text}No other gap has a better worst case.'
    return (
        f'{text}A gap of {other} has the best worst case, {percent(best.ratio)} '
        f'({case_words(best)}).{flat} --rig-out has {gap}, with --worst-case {other}.'
    )


def _spans_where(values: Array, flags: NDArray[np.bool_], unit: str = '') -> str:
    """Return the ranges of values that are flagged, in words; empty without any."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    parts = []
    for first, end in edges.reshape(-1, 2):
        low, high = (f'{values[k]:.3g}' for k in (first, end - 1))
        parts.append(f'at {low}{unit}' if low == high else f'from {low} to {high}{unit}')
    return ' and '.join(parts)


def _compared_words(design: Design, compared: Comparison) -> list[str]:
    """Return the chosen damper compared with mass dampers, over frequencies and levels."""
    hertz, here = compared.frequencies / math.tau, len(compared.frequencies) // 2
    at_level = compared.damper[int(np.flatnonzero(compared.levels == 1.0)[0])]
    tunings = den_hartog(design.rig), tuned_to_excitation(design.rig)
    broad, tuned = "Den Hartog's", f'the one tuned to {tunings[1].frequency / math.tau:.4g} Hz'
    rivals = {
        'the impact damper': at_level,
        broad: compared.den_hartog,
        tuned: compared.tuned,
    }

    def row(name: str, own: float, sizes: Array, zeta: str = '') -> tuple[str, ...]:
        level, k = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        where = f'{hertz[k]:.3g} Hz'
        where += f', level {compared.levels[level]:.3g}' if len(sizes) > 1 else ''
        return name, zeta, quantity(own, 'm', 3), quantity(float(sizes[level, k]), 'm', 3), where

    zetas = [f'ζ {100.0 * one.zeta:.3g} %' for one in tunings]
    rows = [
        row('the impact damper, from rest', design.x_max, compared.damper),
        *(
            row(name, float(rivals[name][here]), rivals[name][None], zeta)
            for name, zeta in zip((broad, tuned), zetas, strict=True)
        ),
        row('none', design.bare, compared.bare[None]),
    ]
    low, high = compared.levels[0], compared.levels[-1]
    levels = f'levels from {low:g} to {high:g}' if low < high else f'level {low:g}'
    head = 'Beside a mass damper of the same mass on a spring; |X| over the level, '
    head += f'{hertz[0]:.3g} to {hertz[-1]:.3g} Hz, {levels}:'
    table = Table.of_rows(('', '', 'here', 'largest', 'where'), rows, 2)
    least = np.min([*rivals.values(), _HELPS * compared.bare], axis=0)
    places = {name: _spans_where(hertz, sizes == least, ' Hz') for name, sizes in rivals.items()}
    best = '; '.join(f'{name} {text}' for name, text in places.items() if text)
    beats = (at_level < _HELPS * compared.bare) & (at_level < compared.den_hartog)
    ratio = compared.den_hartog[here] / compared.bare[here]
    beyond = _spans_where(compared.level_range, compared.level_ratios < min(ratio, _HELPS))
    places_text = _spans_where(hertz, beats, ' Hz')
    below = [places_text and f'{places_text} at this level', beyond and f'here at levels {beyond}']
    least_text = f'these leave the least: {best}; elsewhere all' if best else 'all'
    sentence = (
        f'At this level {least_text} leave more than 98 % of |X| without a damper. The impact '
        f'damper leaves less than {broad} {", and ".join(filter(None, below)) or "nowhere"}.'
    )
    return [head, table.text('  '), _indent(sentence)]


def design_json(
    found: Sequence[Design],
    chosen: Design,
    unsure: WorstCases,
    compared: Comparison,
    plan: Sequence[PlannedRun],
) -> dict[str, Any]:
    """Return all results, in SI units."""
    own = (
        *('reached_from_rest', 'starts_by_itself', 'without_margin'),
        *('impulse', 'impact_speed', 'acceleration'),
        *('gap_range', 'level_range', 'frequency_range'),
    )
    plain: dict[str, Any] = as_plain(
        {
            'designs': [
                {
                    'mass_ratio': d.mass_ratio,
                    'damper_mass': d.rig.damper_mass,
                    'gap': d.rig.gap,
                    'x_max': d.orbit.x_max,
                    'reduction': d.orbit.x_max / d.bare,
                    **{name: getattr(d, name) for name in own},
                }
                for d in found
            ],
            'chosen': {
                'mass_ratio': chosen.mass_ratio,
                'gap': chosen.gap,
                'x_max': chosen.x_max,
                'without_damper': chosen.bare,
                'parameters': chosen.built,
            },
            'uncertain': {
                'gap': unsure.best.gap,
                'worst_reduction': unsure.best.ratio,
                'worst_case': unsure.best.case,
                'worst_reduction_of_chosen': unsure.chosen.ratio,
                'worst_case_of_chosen': unsure.chosen.case,
                'runs': len(unsure.chosen.ratios),
                'ranges': unsure.ranges,
                'levels': unsure.levels,
            },
            'plan': plan,
            'comparison': compared,
        }
    )
    return plain


@print_style()
def design_figure(
    found: Sequence[Design], chosen: Design, unsure: WorstCases, compared: Comparison, title: str
) -> Figure:
    """Draw |X| over mass, gap, frequency and level."""
    from matplotlib.lines import Line2D

    figure = blank_figure(7.6, 6.6, title)
    (mass, gap), (frequency, level) = figure.subplots(2, 2)
    none: dict[str, Any] = {'color': COLORS['quiet'], 'ls': '--', 'lw': 1.2}
    broad: dict[str, Any] = {'color': COLORS['primary'], 'lw': 1.4}
    tuned: dict[str, Any] = {**broad, 'ls': '-.'}
    impact: dict[str, Any] = {'color': COLORS['damper'], 'lw': 1.8}
    case: dict[str, Any] = {'color': COLORS['damper'], 'alpha': 0.5, 'ls': '', 'marker': '.'}
    worst: dict[str, Any] = {'color': COLORS['special'], 'lw': 1.4}
    robust = {**worst, 'ls': '--', 'lw': 0.8}
    ratios = [100.0 * d.mass_ratio for d in found]
    rates = np.array([chosen.rig.first_harmonic[1]])
    mass.axhline(chosen.bare, **none)
    for line, tuning in ((broad, den_hartog), (tuned, tuned_to_excitation)):
        sizes = [mass_damper_response(d.rig, tuning(d.rig), rates)[0] for d in found]
        mass.plot(ratios, sizes, **line)
    mass.plot(ratios, [d.x_max for d in found], marker='o', ms=4, **impact)
    mass.plot(ratios, [d.orbit.x_max for d in found], **{**impact, 'ls': ':'})
    mass.plot([100.0 * chosen.mass_ratio], [chosen.x_max], 'o', ms=10, mfc='none', color='k')
    mass.set_yscale('log')
    finish_panel(mass, 'a', 'Mass of the damper [% of M]', '')
    unit_axis(mass.yaxis, 'Largest |X|', 'm', chosen.bare)
    _draw_cases(gap, unsure, case, worst)
    ratio = '|X| over that without damper'
    finish_panel(gap, 'b', '', ratio)
    unit_axis(gap.xaxis, 'Gap', 'm', unsure.gaps)
    hertz = compared.frequencies / math.tau
    frequency.plot(hertz, compared.bare, **none)
    frequency.plot(hertz, compared.den_hartog, **broad)
    frequency.plot(hertz, compared.tuned, **tuned)
    frequency.plot(hertz, compared.damper[np.flatnonzero(compared.levels == 1.0)[0]], **impact)
    frequency.set_yscale('log')
    finish_panel(frequency, 'c', 'Frequency [Hz]', '')
    unit_axis(frequency.yaxis, 'Largest |X|', 'm', compared.bare)
    here = len(hertz) // 2
    level.axhline(1.0, **none)
    level.axhline(compared.den_hartog[here] / compared.bare[here], **broad)
    level.axhline(compared.tuned[here] / compared.bare[here], **tuned)
    level.plot(compared.level_range, compared.level_ratios, **impact)
    level.axvline(1.0, color='k', lw=0.8)
    level.set_xscale('log')
    place_log_ticks(level.xaxis)
    level.set_ylim(0.0, 1.15 * max(1.0, float(compared.level_ratios.max())))
    shaker = chosen.rig.swept
    finish_panel(level, 'd', f'Level of the {shaker}, over this one', ratio)
    frequency_text = f'{rates[0] / math.tau:.4g} Hz'
    handles = [
        Line2D([], [], label='no damper', **none),
        Line2D([], [], label="mass damper, Den Hartog's tuning", **broad),
        Line2D([], [], label=f'mass damper tuned to {frequency_text}', **tuned),
        Line2D([], [], label='impact damper, from rest', **impact),
        Line2D([], [], label='... once it is started', **{**impact, 'ls': ':'}),
        Line2D([], [], label='one run from rest', **case),
        Line2D([], [], label='the worst of each gap', **worst),
        Line2D([], [], label='the chosen gap, and this level', color='k', lw=0.8),
        Line2D([], [], label='the gap with the best worst case', **robust),
    ]
    legend_below(figure, handles, 3)
    return figure


def _draw_cases(
    axes: Any, unsure: WorstCases, case: Mapping[str, Any], worst: Mapping[str, Any]
) -> None:
    """Draw all runs over the gap, with the worst of each gap."""
    low, high = unsure.as_good
    worst_of_some = zip(unsure.gaps.tolist(), unsure.ratios.max(axis=1).tolist(), strict=True)
    # Between the gaps as good none is worse than these
    envelope = {gap: ratio for gap, ratio in worst_of_some if not low < gap < high} | unsure.whole
    clouds = [(np.repeat(unsure.gaps, unsure.ratios.shape[1]), unsure.ratios.ravel())]
    for one in {one.gap: one for one in (unsure.chosen, unsure.best)}.values():
        clouds.append((np.full(len(one.ratios), one.gap), one.ratios))
        envelope[one.gap] = one.ratio
    for gaps, ratios in clouds:
        axes.plot(gaps, ratios, ms=2.5, rasterized=True, mew=0, **case)
    axes.plot(*zip(*sorted(envelope.items()), strict=True), **worst)
    top = 1.25 * max(envelope.values())
    axes.set_ylim(0.0, top)
    middle = float(np.mean(axes.get_xlim()))
    for one, line in (
        (unsure.chosen, {'color': 'k', 'lw': 0.8}),
        (unsure.best, {**worst, 'lw': 0.8, 'ls': '--'}),
    ):
        axes.axvline(one.gap, **line)
        axes.plot([one.gap], [one.ratio], 'o', ms=4, color=line['color'])
        right = one.gap < middle
        axes.annotate(
            f'{percent(one.ratio)}: {case_words(one)}',
            (one.gap, one.ratio),
            (4 if right else -4, 4),
            textcoords='offset points',
            ha='left' if right else 'right',
            fontsize='x-small',
            bbox={'facecolor': 'w', 'edgecolor': 'none', 'alpha': 0.85, 'pad': 1.0},
        )
