# SPDX-License-Identifier: Apache-2.0
"""What a design says: the table, the words, JSON, and the figure beside a tuned mass damper."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.design.bench_plan import PlannedRun
from impact_damper_ros.design.damper_design import Design, Uncertain
from impact_damper_ros.design.mass_damper import mass_damper_response
from impact_damper_ros.orbits.branch import Span
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.rig_parameters import ALL_SPECS
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

from .csv_tables import row
from .drawing import COLORS, blank_figure, finish_panel, legend_below, print_style, unit_axis
from .formatting import percent, quantity
from .table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


class Comparison(NamedTuple):
    """
    A chosen damper beside nothing and beside a tuned mass damper of its mass.

    Attributes
    ----------
    frequencies : ndarray
        Circular frequencies, rad/s.
    bare, mass_damper, damper : ndarray
        Largest |X| there without a damper, with the mass damper, and with the impact damper, m.
    levels, level_ratios : ndarray
        Levels as factors, and there the largest |X| over that without the damper.
    """

    frequencies: Array
    bare: Array
    mass_damper: Array
    damper: Array
    levels: Array
    level_ratios: Array


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
            quantity(d.rig.gap, 'm', 3),
            quantity(d.orbit.x_max, 'm', 3),
            percent(d.orbit.x_max / d.bare),
            'yes' if d.reached_from_rest else 'no',
            quantity(d.gap, 'm', 3),
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


def _peak(frequencies: Array, sizes: Array) -> str:
    worst = int(np.argmax(sizes))
    return f'{quantity(float(sizes[worst]), "m", 3)} at {frequencies[worst] / math.tau:.3g} Hz'


def design_text(design: Design, unsure: Uncertain, compared: Comparison) -> str:
    """Return what there is to say of the chosen design."""
    gap, worst = unsure.best
    rig = design.rig
    here = np.array([rig.first_harmonic[1]])
    other = float(mass_damper_response(rig, here)[0])
    best = quantity(design.orbit.x_max, 'm', 3)
    half = quantity(design.gap, 'm', 4)
    lines = [
        f'Chosen: {percent(design.mass_ratio)} of the mass, {_mass(design)}, for R = '
        f'{rig.restitution_1:.4g}.',
        f'  Best at this level and frequency: a gap of {half} in all, which leaves '
        f'{quantity(design.x_max, "m", 3)} of {quantity(design.bare, "m", 3)}, '
        f'{percent(design.x_max / design.bare)}.',
    ]
    if design.x_max > design.bare:
        lines.append('  That is more than without the damper: it is no help here.')
    if design.starts_by_itself is not None:
        other_gap = f'  A gap of {quantity(rig.gap, "m", 4)} would leave {best}, but '
        lines.append(
            f'{other_gap}M at rest never swings across it: m has to be started by a push.'
            if rig.gap > design.widest_hit
            else f'{other_gap}from rest the rig comes to another motion: m needs a push.'
        )
    *first, last = _uncertain_words(unsure)
    cases = f'{", ".join(first)} and {last}' if first else last
    here_worst = unsure.worst_at(design.gap)
    other_half = quantity(gap, 'm', 4)
    sure = (
        f'How sure: with {cases}, a gap of {other_half} has the best worst case from rest, '
        f'{percent(worst)}; with {half} it is {percent(here_worst)}. --rig-out has {half}, with '
        f'--worst-case {other_half}.'
    )
    lines += [
        textwrap.fill(sure, 98, initial_indent='  ', subsequent_indent='  '),
        'Once m hits both stops in each cycle, with the best gap, that motion lasts for',
        f'  gaps {_span_words(design.gap_range, "mm", 1e3)},',
        f'  levels {_span_words(design.level_range, "times this one", 1.0)},',
        f'  frequencies {_span_words(design.frequency_range, "Hz", 1.0 / math.tau)}.',
        'Beside a tuned mass damper of the same mass:',
        f'  here {quantity(design.x_max, "m", 3)} with the impact damper, '
        f'{quantity(other, "m", 3)} with the mass damper;',
        f'  the largest between {compared.frequencies[0] / math.tau:.3g} and '
        f'{compared.frequencies[-1] / math.tau:.3g} Hz, from rest:',
        f'  {_peak(compared.frequencies, compared.damper)} with the impact damper, '
        f'{_peak(compared.frequencies, compared.mass_damper)} with the mass damper,',
        f'  {_peak(compared.frequencies, compared.bare)} without. '
        + _verdict(design.x_max < other, compared),
    ]
    return '\n'.join(lines)


def _ends(low: float, high: float) -> str:
    """Return two numbers with as many digits as distinguish them, at least four."""
    digits = next((n for n in range(4, 17) if f'{low:.{n}g}' != f'{high:.{n}g}'), 17)
    return f'{low:.{digits}g} to {high:.{digits}g}'


def _uncertain_words(unsure: Uncertain) -> list[str]:
    """Return what is uncertain, and how much."""
    bounces = [ends for name, ends in unsure.ranges.items() if name.startswith('restitution')]
    found = []
    if bounces:
        low, high = min(low for low, _ in bounces), max(high for _, high in bounces)
        found.append(f'R from {_ends(low, high)}')
    for name, (low, high) in unsure.ranges.items():
        if not name.startswith('restitution'):
            unit = ALL_SPECS[name].unit
            found.append(f'{name} from {_ends(low, high)}{unit and f" {unit}"}')
    low, high = unsure.levels[0], unsure.levels[-1]
    return [*found, f'the level from {low:g} to {high:g} times this one']


def _verdict(better: bool, compared: Comparison) -> str:
    """Return a sentence that names the better damper, here and over all frequencies."""
    name = 'impact' if better else 'mass'
    if (compared.damper.max() < compared.mass_damper.max()) != better:
        return f'The {name} damper is better at this frequency and level, not over all of them.'
    return f'The {name} damper is better{" over all of them" if better else ""}.'


def design_json(
    found: Sequence[Design],
    chosen: Design,
    unsure: Uncertain,
    compared: Comparison,
    plan: Sequence[PlannedRun],
) -> dict[str, Any]:
    """Return all that was found, SI units."""
    gap, worst = unsure.best
    own = (
        *('reached_from_rest', 'impulse', 'impact_speed', 'acceleration'),
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
                    'starts_by_itself': d.starts_by_itself
                    and dict(zip(('gap', 'x_max'), d.starts_by_itself, strict=True)),
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
                'gap': gap,
                'worst_reduction': worst,
                'worst_reduction_of_chosen': unsure.worst_at(chosen.gap),
                'ranges': unsure.ranges,
                'levels': unsure.levels,
            },
            'plan': plan,
            'comparison': compared,
        }
    )
    return plain


_CSV = (
    *('mass_ratio', 'damper_mass', 'best_gap', 'best_x_max', 'reached_from_rest', 'gap', 'x_max'),
    *('without_damper', 'impact_speed', 'impulse', 'acceleration', 'gap_low', 'gap_high'),
    *('level_low', 'level_high', 'frequency_low', 'frequency_high'),
)


def design_csv(found: Sequence[Design]) -> str:
    """Return the designs as CSV, SI units."""
    rows = [
        (
            *(d.mass_ratio, d.rig.damper_mass, d.rig.gap, d.orbit.x_max),
            *(str(d.reached_from_rest).lower(), d.gap, d.x_max, d.bare),
            *(d.impact_speed, d.impulse, d.acceleration, d.gap_range.low, d.gap_range.high),
            *(d.level_range.low, d.level_range.high),
            *(d.frequency_range.low, d.frequency_range.high),
        )
        for d in found
    ]
    return ','.join(_CSV) + '\n' + ''.join(map(row, rows))


@print_style()
def design_figure(
    found: Sequence[Design], chosen: Design, unsure: Uncertain, compared: Comparison, title: str
) -> Figure:
    """Draw how heavy, which gap, over frequency and over level."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import FixedLocator, LogLocator, NullFormatter

    figure = blank_figure(7.6, 6.4, title)
    (mass, gap), (frequency, level) = figure.subplots(2, 2)
    none: dict[str, Any] = {'color': COLORS['quiet'], 'ls': '--', 'lw': 1.2}
    tuned: dict[str, Any] = {'color': COLORS['primary'], 'lw': 1.4}
    impact: dict[str, Any] = {'color': COLORS['damper'], 'lw': 1.8}
    ratios = [100.0 * d.mass_ratio for d in found]
    rates = np.array([chosen.rig.first_harmonic[1]])
    mass.axhline(chosen.bare, **none)
    mass.plot(ratios, [mass_damper_response(d.rig, rates)[0] for d in found], **tuned)
    mass.plot(ratios, [d.x_max for d in found], marker='o', ms=4, **impact)
    mass.plot(ratios, [d.orbit.x_max for d in found], **{**impact, 'ls': ':'})
    mass.plot([100.0 * chosen.mass_ratio], [chosen.x_max], 'o', ms=10, mfc='none', color='k')
    mass.set_yscale('log')
    finish_panel(mass, 'a', 'Mass of the damper [% of M]', '')
    unit_axis(mass.yaxis, 'Largest |X|', 'm', chosen.bare)
    ends = unsure.ratios.min(axis=1), unsure.worst
    case: dict[str, Any] = {'color': COLORS['damper'], 'alpha': 0.25, 'lw': 0}
    gap.fill_between(unsure.gaps, *ends, **case)
    gap.plot(unsure.gaps, unsure.worst, color=COLORS['special'], lw=1.4)
    gap.axvline(chosen.gap, color='k', lw=0.8)
    gap.axvline(unsure.best[0], color=COLORS['special'], lw=0.8, ls='--')
    gap.set_ylim(0.0, min(1.2, 1.05 * float(ends[1].max())))
    ratio = '|X| over that without damper'
    finish_panel(gap, 'b', '', ratio)
    unit_axis(gap.xaxis, 'Gap', 'm', unsure.gaps)
    hertz = compared.frequencies / math.tau
    frequency.plot(hertz, compared.bare, **none)
    frequency.plot(hertz, compared.mass_damper, **tuned)
    frequency.plot(hertz, compared.damper, **impact)
    frequency.set_yscale('log')
    finish_panel(frequency, 'c', 'Frequency [Hz]', '')
    unit_axis(frequency.yaxis, 'Largest |X|', 'm', compared.bare)
    level.axhline(1.0, **none)
    level.axhline(mass_damper_response(chosen.rig, rates)[0] / chosen.bare, **tuned)
    level.plot(compared.levels, compared.level_ratios, **impact)
    level.axvline(1.0, color='k', lw=0.8)
    level.set_xscale('log')
    level.xaxis.set_major_locator(FixedLocator([0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 10.0]))
    for axis in (level.xaxis, mass.yaxis, frequency.yaxis):
        axis.set_minor_formatter(NullFormatter())
    for axis in (mass.yaxis, frequency.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    level.set_ylim(0.0, 1.15)
    level.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    shaker = chosen.rig.swept
    finish_panel(level, 'd', f'Level of the {shaker}, over this one', ratio)
    handles = [
        Line2D([], [], label='no damper', **none),
        Line2D([], [], label='tuned mass damper of the same mass', **tuned),
        Line2D([], [], label='impact damper, from rest', **impact),
        Line2D([], [], label='... once it is started', **{**impact, 'ls': ':'}),
        Patch(label='all cases of R and level', **case),
        Line2D([], [], label='the worst case; its best gap', color=COLORS['special'], lw=1.4),
        Line2D([], [], label='the chosen gap, and this level', color='k', lw=0.8),
    ]
    legend_below(figure, handles, 3)
    return figure
