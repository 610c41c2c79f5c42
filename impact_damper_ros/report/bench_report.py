# SPDX-License-Identifier: Apache-2.0
"""What a bench test of a rig would show, in words, tables, JSON and a figure; and its plan."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.design.bench_test import BenchTest, Knowledge, Sweep, SwitchedOn, Variation
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .drawing import COLORS, blank_figure, finish_panel, legend_below, print_style, unit_axis
from .formatting import quantity
from .table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_WIDTH = 95
#: From here on M moves as it would without the damper.
_USELESS = 0.95
#: A run that is recorded: cycles, and samples in one of them.
_CYCLES, _PER_CYCLE = 100, 100


def percent(value: float, digits: int = 3) -> str:
    """Return a share in per cent."""
    return f'{100.0 * value:.{digits}g} %'


def _filled(text: str) -> str:
    return textwrap.fill(
        ' '.join(text.split()), _WIDTH, initial_indent='  ', subsequent_indent='  '
    )


def _size(x: float) -> str:
    return quantity(x, 'm', 3)


def _start_words(start: SwitchedOn) -> str:
    rig, motion = start.rig, start.settled
    bare = rig.response_amplitude
    left = f'{_size(motion.x_max)}, {percent(motion.x_max / bare)} of the {_size(bare)} without it'
    if motion.kind is MotionKind.NO_IMPACTS:
        return (
            f'm is never hit: M swings {_size(bare)} to both sides, and the gap is '
            f'{_size(rig.gap)}. The damper does nothing at this level until m is pushed.'
        )
    hit = start.first_impact
    texts = []
    if math.isfinite(hit):
        before = start.sizes[: max(1, math.ceil(hit / start.cycle))]
        texts.append(
            f'The first impact comes after {hit:.3g} s, when M has grown to '
            f'{_size(float(before.max()))}.'
        )
    rhythm = motion.rhythm
    if rhythm is None:
        texts.append(f'The motion does not repeat ({motion.kind.value}); M moves up to {left}.')
        return ' '.join(texts)
    settled = start.settling_time
    if math.isfinite(settled):
        texts.append(f'After {settled:.3g} s the amplitude has settled.')
    cycles = '' if rhythm.cycles == 1 else f'{rhythm.cycles} '
    count = len(rhythm.stops)
    texts.append(
        f'm then makes {count} impact{"s" * (count > 1)} in {cycles or "each "}cycle'
        f'{"s" * (rhythm.cycles > 1)} (stops {", ".join(map(str, rhythm.stops))}), '
        f'{start.impact_rate:.3g} a second, at up to {start.impact_speed:.3g} m/s. '
        f'M moves {left}.'
    )
    return ' '.join(texts)


def _ranges(frequencies: Array, chosen: NDArray[np.bool_]) -> str:
    """Return the ranges of frequencies that are chosen, in Hz."""
    hertz, parts = frequencies / math.tau, []
    steps = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int)))
    for first, end in zip(steps[::2], steps[1::2], strict=True):
        low, high = f'{hertz[first]:.4g}', f'{hertz[end - 1]:.4g}'
        parts.append(low if low == high else f'{low} to {high}')
    return ' and '.join([', '.join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _peak(sweep: Sweep, sizes: Array) -> str:
    k = int(np.argmax(sizes))
    return f'{_size(float(sizes[k]))} at {sweep.frequencies[k] / math.tau:.4g} Hz'


def _sweep_words(sweep: Sweep) -> str:
    texts = [
        f'The largest |X| is {_peak(sweep, sweep.up)} on the way up and '
        f'{_peak(sweep, sweep.down)} on the way down, {_peak(sweep, sweep.bare)} without impacts.'
    ]
    for way, impacts in (('up', sweep.impacts_up), ('down', sweep.impacts_down)):
        heard = impacts > 0.0
        where = f'from {_ranges(sweep.frequencies, heard)} Hz' if heard.any() else 'nowhere'
        texts.append(f'On the way {way} impacts are heard {where}.')
    if sweep.differs.any():
        texts.append(
            f'Up and down differ at {_ranges(sweep.frequencies, sweep.differs)} Hz: there the rig '
            'has more than one motion, or one that does not repeat, and what is measured depends '
            'on how it was reached.'
        )
    else:
        texts.append('Up and down agree: the rig has one motion at each frequency.')
    return ' '.join(texts)


_NAMES = {'restitution': 'R', 'friction': 'friction', 'level': 'level'}


def _variation_words(variations: Sequence[Variation], rig: RigParameters) -> str:
    left, lost = [], []
    for one in variations:
        name = _NAMES[one.name]
        left.append(
            f'{name} from {one.values[0]:g} to {one.values[-1]:g} leaves '
            f'{100.0 * min(one.ratios):.3g} to {percent(max(one.ratios))}'
        )
        which = [f'{v:g}' for v, r in zip(one.values, one.ratios, strict=True) if r > _USELESS]
        if which:
            lost.append(f'{name} {" and ".join(which)}')
    text = f'Of the amplitude without the damper {"; ".join(left)}.'
    if lost:
        text += (
            f' With {", ".join(lost)} the damper does nothing from rest: m is hit only if M '
            f'swings more than half the gap, {_size(0.5 * rig.gap)}.'
        )
    return text


def variation_table(variations: Sequence[Variation]) -> Table:
    """Return the variations as a table for people."""
    rows = [
        (f'{_NAMES[one.name]} {value:g}', _size(x), percent(ratio))
        for one in variations
        for value, x, ratio in zip(one.values, one.x_max, one.ratios, strict=True)
    ]
    return Table.of_rows(('from rest with', 'largest |X|', 'over none'), rows)


def bench_text(found: BenchTest) -> str:
    """Return in words what a bench test would show."""
    hertz = found.rig.first_harmonic[1] / math.tau
    sweep = found.sweep
    low, high = sweep.frequencies[0] / math.tau, sweep.frequencies[-1] / math.tau
    return '\n'.join(
        [
            f'Switched on from rest at {hertz:.4g} Hz:',
            _filled(_start_words(found.start)),
            f'Swept slowly from {low:.4g} to {high:.4g} Hz and back, at constant level:',
            _filled(_sweep_words(sweep)),
            'From rest, one thing varied at a time:',
            variation_table(found.variations).text('  '),
            _filled(_variation_words(found.variations, found.rig)),
        ]
    )


def _plan_table(runs: Sequence[Knowledge]) -> Table:
    """Return the runs of a plan, and how well each determines the parameters."""
    rows = []
    for k, run in enumerate(runs):
        name = 'settled motion alone' if k == 0 else 'from rest'
        r, friction, gap = run.deviations
        known = (
            (f'± {r:.2g}', f'± {friction:.2g}', f'± {percent(gap, 2)}')
            if math.isfinite(r)
            else ('not known', 'not known', 'not known')
        )
        repeats = 'yes' if run.repeats else 'no'
        rows.append((name, f'{run.level:g}', _size(run.gap), str(run.flights), repeats, *known))
    head = ('run', 'level', 'gap', 'flights', 'repeats', 'R', 'friction', 'gap known to')
    return Table.of_rows(head, rows)


def test_plan(rig: RigParameters, runs: Sequence[Knowledge]) -> str:
    """Return the runs to record on a bench, so that the rig can be fitted to them."""
    hertz = rig.first_harmonic[1] / math.tau
    seconds = float(f'{_CYCLES / hertz:.2g}')
    rate = float(f'{_PER_CYCLE * hertz:.1g}')
    steps = [
        'Weigh m, and know the modal mass M or the force. Record X, the force or the motion of '
        'the base, and the instants of the impacts (an accelerometer on M, or a microphone).',
        'Without m, or with m clamped: let M ring down. fit_rig FREE.csv --structure gives its '
        'frequency and damping.',
        f'With m, from rest, the shaker switched on at once at {hertz:.4g} Hz: {seconds:g} s at '
        f'{rate:g} samples a second. Then again at another level and with other gaps:',
    ]
    texts = [
        textwrap.fill(f'{k}. {text}', _WIDTH, initial_indent='  ', subsequent_indent='     ')
        for k, text in enumerate(steps, 1)
    ]
    texts.append(_plan_table(runs).text('       '))
    settled = runs[0]
    sure = [run for run in runs[1:] if math.isfinite(run.deviations[0])]
    note = (
        '(Standard deviations if frequency and damping are known, and the speeds at the impacts '
        'and the places of m to 1 % of the approach speed and of the gap.)'
    )
    if sure and not math.isfinite(settled.deviations[0]):
        note = (
            'In the settled motion alone R, friction and gap cannot be distinguished: its flights '
            f'are all alike, and one law holds for them. Record the start. {note}'
        )
    elif not sure:
        note = 'm is not hit from rest, or too rarely, to distinguish R, friction and gap: push m.'
    texts.append(textwrap.fill(note, _WIDTH, initial_indent='     ', subsequent_indent='     '))
    last = (
        f'4. Swept slowly from {0.8 * hertz:.4g} to {1.2 * hertz:.4g} Hz and back at constant '
        'level. design_damper --check predicts the result: where the two differ, the model fails.'
    )
    fit = (
        '5. fit_rig START.csv --impacts HITS.csv --rig RIG.yaml --rig-out fitted.yaml fits R, '
        'friction and gap to a start; design_damper --fitted fitted.yaml goes on from there.'
    )
    texts += [
        textwrap.fill(
            text,
            _WIDTH,
            initial_indent='  ',
            subsequent_indent='     ',
            break_on_hyphens=False,
        )
        for text in (last, fit)
    ]
    return '\n'.join(['Test plan:', *texts])


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def plan_json(runs: Sequence[Knowledge]) -> list[dict[str, Any]]:
    """Return the runs of a plan, SI units."""
    return [
        {
            'settled_only': k == 0,
            'gap': run.gap,
            'level': run.level,
            'flights': run.flights,
            'repeats': run.repeats,
            'standard_deviations': dict(
                zip(
                    ('restitution', 'friction', 'relative_gap'),
                    map(_finite, run.deviations),
                    strict=True,
                )
            ),
        }
        for k, run in enumerate(runs)
    ]


def bench_json(found: BenchTest) -> dict[str, Any]:
    """Return all that a bench test would show, SI units."""
    start, sweep = found.start, found.sweep
    return {
        'from_rest': {
            'kind': start.settled.kind.value,
            'stops': list(start.settled.rhythm.stops) if start.settled.rhythm else None,
            'first_impact': _finite(start.first_impact),
            'settling_time': _finite(start.settling_time),
            'impact_rate': start.impact_rate,
            'impact_speed': start.impact_speed,
            'x_max': start.settled.x_max,
            'without_damper': found.rig.response_amplitude,
        },
        'sweep': {name: column.tolist() for name, column in vars(sweep).items()},
        'variations': {
            one.name: {
                'values': list(one.values),
                'x_max': list(one.x_max),
                'reduction': list(one.ratios),
            }
            for one in found.variations
        },
        'plan': plan_json(found.plan),
    }


@print_style()
def bench_figure(found: BenchTest, title: str) -> Figure:
    """Draw the start, the sweep, and what R, friction and level change."""
    from matplotlib.lines import Line2D

    figure = blank_figure(7.6, 5.8)
    grid = figure.add_gridspec(2, 6)
    start, sweep = figure.add_subplot(grid[0, :3]), figure.add_subplot(grid[0, 3:])
    run, ways, bare = found.start, found.sweep, found.rig.response_amplitude
    none: dict[str, Any] = {'color': COLORS['quiet'], 'ls': '--', 'lw': 1.2}
    down: dict[str, Any] = {'color': COLORS['upper'], 'lw': 1.3}
    up: dict[str, Any] = {'color': COLORS['damper'], 'lw': 1.8}
    times = (np.arange(len(run.sizes)) + 1.0) * run.cycle
    settled = run.settling_time if math.isfinite(run.settling_time) else times[-1]
    start.plot(times, run.sizes, color=COLORS['primary'], lw=1.6)
    start.axhline(bare, **none)
    start.set_xlim(0.0, min(2.0 * settled, times[-1]))
    start.set_ylim(0.0, 1.1 * max(bare, float(run.sizes.max())))
    finish_panel(start, 'a', 'Time after the shaker is switched on [s]', '')
    unit_axis(start.yaxis, 'Largest |X| of a cycle', 'm', bare)
    hertz = ways.frequencies / math.tau
    sweep.plot(hertz, ways.bare, **none)
    sweep.plot(hertz, ways.down, **down)
    sweep.plot(hertz, ways.up, **up)
    sweep.set_yscale('log')
    finish_panel(sweep, 'b', 'Frequency [Hz]', '')
    unit_axis(sweep.yaxis, 'Largest |X|', 'm', ways.bare)
    sweep.yaxis.set_minor_formatter(lambda *_: '')
    count = len(found.variations)
    for k, one in enumerate(found.variations):
        panel = figure.add_subplot(grid[1, 6 * k // count : 6 * (k + 1) // count])
        panel.plot(one.values, one.ratios, 'o-', color=COLORS['primary'], ms=4, lw=1.2)
        panel.axhline(1.0, **none)
        panel.set_ylim(0.0, 1.15)
        label = {'restitution': 'Restitution R', 'friction': 'Friction γ', 'level': 'Level'}
        finish_panel(panel, 'cde'[k], label[one.name], '' if k else '|X| over that without damper')
    handles = [
        Line2D([], [], label='no damper', **none),
        Line2D([], [], label='sweep up', **up),
        Line2D([], [], label='sweep down', **down),
        Line2D([], [], label='from rest', color=COLORS['primary'], lw=1.6),
    ]
    legend_below(figure, handles, 4)
    figure.suptitle(textwrap.fill(title, 100), fontsize=7.5, color='0.3')
    return figure
