"""The page of the gap control study: tables, figures, and the text around them."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from textwrap import fill

from impact_damper_ros.outputs import write_text
from impact_damper_ros.report.drawing import save_figure
from impact_damper_ros.report.formatting import markdown_table

from .figures import FIGURES
from .findings import (
    LAW_LABELS,
    Results,
    best_gap_at_resonance,
    broadband,
    level_sweep,
    real_power,
    targets,
)
from .runs import (
    ANGLES,
    INDEPENDENT_LAWS,
    LAWS,
    REAL_MASS,
    REAL_SPEED,
    RIG,
    SENSITIVITIES,
    Extent,
    ideal_ratio,
    stepped_frequencies,
)

_INTRODUCTION = """
# Gap control

The effect of the laws of `gap_control` on the vibration of M, compared with fixed gaps and with
the first-order formula for two impacts per cycle. All numbers and figures are from exact runs;
`study_gap_control` writes this page.

Unless stated otherwise, the rig has M = 1 kg, K = 1 N/m, ζ = 0.01, μ = m/M = 0.1, R₁ = R₂ = 0.5,
and is level and frictionless. The controller takes 32 samples per natural period. Unless a speed
is given, the stops move instantly, and the energy that moves them is not counted (0 W). The rig
starts at rest with m in the middle. It is linear except for the gap: as long as the range of the
stops does not matter, all lengths scale with the force.
"""

_LAW_TEXT = """
## The laws

**The source.** Masri, Miller, Dehghanyar and Caughey, *Active parameter control of nonlinear
vibrating structures*, J. Applied Mechanics 56 (1989), is recommended at the end of the paper that
this package implements. Its exact law was not available. Known are these properties: the stops can
be moved; the law uses no model of the structure; the oscillation of the primary mass near the
damper determines the size of the gap and the time of the control action; the control energy moves
the stops, not the structure.

**The reconstruction** (`gap_control_stops: symmetric`). At each zero crossing of X the estimate
becomes Â ← (1 − α) Â + α max|X| of the last half-cycle; it begins with max|X| of the first whole
one. With the gap d* = π Â (1 + R)/((1 − R)(1 + μ)), the flight from one impact at X = 0 to the
next takes exactly half a cycle.

- *amplitude*: d = κ d*, limited to [`gap_min`, `gap_max`].
- *timed*: the stops are parked at a multiple of d*. At a zero crossing of X, a stop closes on m if
  m moves outwards, the impact would take energy from M (X′Y′ < 0 and
  μ(1 + R)/(1 + μ)·|Y′| < 2|X′|), and `gap_min` < 2|Y| < d. The stop is hit where |X′| is largest,
  and then opens again; at most once per zero crossing.

Both laws act once Â exceeds `gap_control_threshold`; below it the gap is `gap`. One rule is added
to the reconstruction, because it does not start without it: a stop that has not been hit for more
than two half-cycles moves in to where m turns round. For a rig that starts from rest, d* is much
wider than the motion of m.

**The extension** (`gap_control_stops: independent`, the default). Weight and friction make the two
flights unequal, and under a random force the centre of the motion of m drifts.

- *amplitude*: each stop has its own position, which scales with Â. At each impact on it, the stop
  moves by a tenth (`gap_control_timing_gain`) of the distance that m covers between the impact, as
  detected from the samples, and the instant 0.05 half-cycles (`gap_control_lead`) before the zero
  crossing. The law needs neither R nor μ nor the angle.
- *timed*: the stop closes on m on either side of the centre, up to half of d* past it, if m
  arrives with at least half the speed of M; otherwise the one impact would be too weak.

**With the model** (*predictive*). At each zero crossing of X the simulator itself computes the
motion ahead, from the exact state and with the exact force, for some fifty pairs of places of the
stops. The stops go where M has the least energy 2.1 half-cycles later. No real controller knows
so much: the law shows what could be gained if the structure and the force were known. It is no
strict bound, because it looks ahead by 2.1 half-cycles only. This horizon was chosen by weak
forces on inclines and under broadband excitation of the seeds 9 to 16, which have no part in this
study ([the trials](../control.md#the-horizon-of-the-predictive-law)).

**The measurements** of the other laws: X, X′, Y, Y′ at `gap_control_rate`, and once more at each
zero crossing of X, where a detector triggers the converters (with noise on all of them, if set);
the instants of these triggers; and the positions of the stops. A jump of Z′ between two samples
indicates an impact. With a delay or a finite speed of the stops, the controller predicts the zero
crossing and the position of m there from the last sample and the period of the triggers, and gives
the command earlier by this time. X is measured from the static equilibrium of M alone.

**The actuators**: a moving stop never does work on m. Where the two meet, the stop halts, and may
be hit there. The next command opens it again.
"""

_CAPTIONS = {
    'level': (
        'Force level at resonance. Amplitude of X over that without impacts, for the fixed gap '
        'that is best at 1 N, and for the laws. The ideal is ζ/(ζ + ζ_eq) with '
        'ζ_eq = (2/π)(μ/(1 + μ))(1 + R)/(1 − R): two impacts per cycle, both at X = 0, to first '
        'order. The lines of the timed and the predictive law coincide.'
    ),
    'broadband': (
        'Broadband excitation. A random-phase multisine of 48 lines from 0.5 to 2 times the '
        'natural frequency, 1 N rms, for 200 natural periods, of which the first 20 are left out '
        'of all numbers. (a) rms of X against the fixed gap, mean and range over the seeds, and '
        'with the laws (their means). (b) rms (filled) and peak (open) of X over those with the '
        'fixed gap that is best for the same seed, for each seed.'
    ),
    'stepped_sine': (
        'Stepped sine through the resonance. Largest |X| in the second half of each step of 25 '
        'natural periods, 1 N, up (solid) and down (dashed).'
    ),
    'load': 'Changing load. The force at resonance changes from 1 N to 4 N and then to 0.25 N.',
    'incline': (
        'Inclined rigs with friction. The basic rig of Bapat (1995) (μ = 0.042, R = 0.75, '
        'ζ = 0.005), friction 0.5, g = 1 m/s², at resonance. At 15° m sticks, at 45° it slides '
        'down. The ideal takes account of friction, which slows m in both flights; its effect is '
        'greater for smaller forces.'
    ),
    'sensitivity': (
        'Real sensors and actuators. rms of X at resonance over the ideal (solid), and with the '
        'timed and predictive laws under broadband excitation of seed 1 over the best fixed gap '
        '(dashed); independent stops. Noise on X and Y is relative to the ideal amplitude of X, '
        'on the rates to that of X′; of what is measured, the predictive law uses the amplitude '
        'only. Horizontal lines: 1.15 and 0.85.'
    ),
    'energy': (
        f'Here the stops have a mass of {REAL_MASS:g} kg (1 % of M) and move at '
        f'{REAL_SPEED:g} m/s. Each start or reversal of a stop costs its kinetic energy, and '
        'nothing is recovered at its end. A stop that moves instantly is booked with 0 W: its '
        'kinetic energy would be infinite. Friction of the guides, and weight and inertia of the '
        'stop in the moving M, are neglected. None of this energy reaches m: the work of the '
        'stops on m and M is zero by construction, which the tests confirm from the energy '
        'balance of random runs. Under broadband excitation, means of the seeds.'
    ),
}

_LIMITS = """
## Limitations

- The amplitude law with independent stops fails under broadband excitation: it corrects a stop
  from one impact at a time, and these occur at random. Symmetric stops are better there, and the
  timed law is much better.
- A stop slower than about half the approach speed of m (6 of 10.9 m/s here) cannot close and open
  again within half a cycle. m then hits stops on their way, at the wrong times, and the timed law
  is worse than a fixed gap. The amplitude law needs less speed.
- With a delay of a quarter of a period the correction of the amplitude law comes one impact too
  late. The timed law predicts, and tolerates the delay as long as the motion is regular.
- At resonance, a fixed gap tuned for the actual force is as good as the laws, and needs no energy.
  The laws are useful if force, frequency or friction are unknown or change.
- With the stops assumed above, of a hundredth of M, the timed law spends on its stops more than
  half of what is dissipated at resonance, and about as much as is dissipated under broadband
  excitation. It is proportional to their mass and the square of their speed.
- The predictive law can be worse than the timed law where what pays comes later than 2.1
  half-cycles, as just above the resonance, by half a percent.

## What this study does not cover

- The reaction of the moving stops on M is neglected, and their mass is part of M. The reaction is
  small if the stops are light.
- X is measured from the equilibrium of M alone. Where M moves less than the static deflection due
  to the weight of m, m g sin θ / K, X has no zero crossings, and the control does not act.
- m takes no energy while it rests on a stop or sticks in the gap, and a stop cannot push it. Below
  the acceleration at which m begins to slide no law has an effect.
"""


def _target_table(results: Results, extent: Extent) -> str:
    head = (
        'target',
        'at most',
        'stops that move instantly',
        '',
        'stops at finite speed',
        'spent on them / dissipated',
    )
    return markdown_table(
        head,
        (
            (
                one.text,
                f'{one.limit:g}',
                f'{one.reached:.4f}',
                'met' if one.met else '**missed**',
                f'{one.real:.4f}',
                f'{100.0 * one.share:.0f} %',
            )
            for one in targets(results, extent)
        ),
    )


def _paragraph(text: str) -> str:
    """Return text in lines of full length."""
    return fill(' '.join(text.split()), 99, break_long_words=False, break_on_hyphens=False)


def _target_text() -> str:
    return _paragraph(f"""
The target is judged with stops that move instantly; the energy for them is not counted. With
stops at finite speed ({REAL_SPEED:g} m/s per newton of force, {REAL_MASS:g} kg each) the actuators
spend the given part of what impacts and dashpot dissipate: 0 % with a fixed gap. At resonance the
energy is that at 1 N; under broadband excitation it is the mean of the seeds.""")


def _ideal_text(results: Results, extent: Extent) -> str:
    gap, ratio = best_gap_at_resonance(results, extent)
    sweep = level_sweep(results, extent)
    unit = sweep.levels.index(1.0)
    timed, ideal = sweep.ratios['timed'][unit], sweep.ideal[unit]
    best = 'less' if ratio < timed else 'no less'
    return _paragraph(f"""
At 1 N the best fixed gap, {gap:.1f} m, leaves {ratio:.5f} of the amplitude without impacts,
{best} than the timed law ({timed:.5f}). The *ideal*, {ideal:.5f}, is a formula of first order: it
counts the fundamental of the impacts' force only. It is a reference, and no bound.""")


def _broadband_text(results: Results, extent: Extent) -> str:
    found = broadband(results, extent)
    timed = fmean(found.common['timed'])
    own = [rms for rms, _ in found.ratios['timed']]
    first, last = extent.seeds[0], extent.seeds[-1]
    gaps = extent.broadband_gaps
    steps = [later - gap for gap, later in pairwise(gaps)] or [0.0]
    return _paragraph(f"""
{len(gaps)} fixed gaps from {gaps[0]:g} to {gaps[-1]:g} m, in steps of {min(steps):g} m to
{max(steps):g} m. The best one for each seed ({first} to {last}) is
{', '.join(f'{gap:g}' for gap in found.own)} m, with an rms of {min(found.own_rms):.3f} to
{max(found.own_rms):.3f} m (mean {fmean(found.own_rms):.3f} m). The ratios to it are the headline:
{fmean(own):.3f} for the timed law in the mean, {max(own):.3f} at most. The rms depends on the gap
irregularly, so that a finer grid finds a lower one: over whole metres only, these ratios are
{fmean(found.coarse):.3f} and {max(found.coarse):.3f}. The one gap that is best for all seeds in
the mean is {found.best:g} m (mean rms {found.best_rms:.3f} m); against it the timed law comes to
{timed:.3f}. The last two columns are with stops at {REAL_SPEED:g} m/s and what their actuators
spend; all others are with stops that move instantly, booked with 0 W.""")


def _level_table(results: Results, extent: Extent, angle: int = 0) -> str:
    sweep = level_sweep(results, extent, angle)
    head = ('force [N]', *(f'{level:.3g}' for level in sweep.levels))
    rows = [
        (LAW_LABELS[name], *(f'{value:.4f}' for value in values))
        for name, values in sweep.ratios.items()
    ]
    return markdown_table(head, [*rows, ('ideal', *(f'{value:.4f}' for value in sweep.ideal))])


def _broadband_table(results: Results, extent: Extent) -> str:
    found = broadband(results, extent)
    rows = []
    for name in LAWS:
        rms, peak = zip(*found.ratios[name], strict=True)
        real = found.real.get(name)
        power = real_power(results, extent, 'broadband', name) if real else None
        rows.append(
            (
                LAW_LABELS[name],
                f'{fmean(rms):.3f}',
                f'{min(rms):.3f} to {max(rms):.3f}',
                f'{fmean(peak):.3f}',
                f'{min(peak):.3f} to {max(peak):.3f}',
                f'{fmean(found.common[name]):.3f}',
                f'{fmean(real):.3f}' if real else '',
                f'{power.actuators:.3g} W, {100.0 * power.share:.0f} %' if power else '',
            )
        )
    head = (
        'law',
        'rms, mean',
        'rms, seeds',
        'peak, mean',
        'peak, seeds',
        'rms over one gap for all seeds',
        f'rms, mean, at {REAL_SPEED:g} m/s',
        'spent, and over dissipated',
    )
    return markdown_table(head, rows)


def _stepped_table(results: Results, extent: Extent) -> str:
    frequencies = stepped_frequencies(extent)
    turn = len(frequencies) // 2
    rows = []
    for name in ('fixed', *INDEPENDENT_LAWS):
        peaks = results['stepped', name].peaks
        up, down = peaks[: turn + 1], peaks[turn:][::-1]
        apart = max(abs(math.log(a / b)) for a, b in zip(up, down, strict=True))
        where = frequencies[max(range(len(up)), key=up.__getitem__)]
        rows.append(
            (
                LAW_LABELS[name],
                f'{max(up):.2f} m at r = {where:.2f}',
                f'{max(down):.2f} m',
                f'{math.exp(apart):.2f}',
            )
        )
    head = ('', 'peak of X, up', 'peak of X, down', 'largest ratio of up and down')
    return markdown_table(head, rows)


def _energy_table(results: Results, extent: Extent) -> str:
    rows = []
    for where, words in (('level', 'resonance, 1 N'), ('broadband', 'broadband')):
        keys = extent.seeds if where == 'broadband' else (1.0,)
        for name in INDEPENDENT_LAWS:
            power = real_power(results, extent, where, name)
            rows.append(
                (
                    f'{LAW_LABELS[name]}, {words}',
                    f'{power.impacts:.4g}',
                    f'{power.dashpot:.4g}',
                    f'{power.actuators:.4g}',
                    f'{100.0 * power.share:.1f} %',
                    f'{fmean(results["real", where, name, key].rms for key in keys):.3f}',
                )
            )
    head = (
        '',
        'impacts dissipate [W]',
        'dashpot dissipates [W]',
        'actuators spend [W]',
        'spent / dissipated',
        'rms of X [m]',
    )
    return markdown_table(head, rows)


_UNITS = {
    'delay': 'delay [natural periods]',
    'speed': 'speed [m/s]',
    'noise': 'noise / amplitude',
    'sampling': 'samples per natural period',
}


def _sensitivity_table(results: Results, extent: Extent, what: str) -> str:
    ideal = ideal_ratio(RIG) * RIG.response_amplitude / math.sqrt(2.0)
    reference = broadband(results, extent).own_rms[0]
    values = [v for v in SENSITIVITIES[what] if ('sensitivity', what, 'timed', v) in results]
    rows = [
        (
            f'{name}: {words}',
            *(f'{results[part, what, name, value].rms / scale:.3f}' for value in values),
        )
        for name, part, words, scale in (
            ('amplitude', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity', 'resonance, over the ideal', ideal),
            ('predictive', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity broadband', 'broadband, over the best fixed gap', reference),
            (
                'predictive',
                'sensitivity broadband',
                'broadband, over the best fixed gap',
                reference,
            ),
        )
    ]
    return markdown_table((_UNITS[what], *(f'{value:g}' for value in values)), rows)


def _figure(name: str) -> str:
    return f'![{_CAPTIONS[name].partition(".")[0]}]({name}.png)\n\n*{_CAPTIONS[name]}*'


def report_text(results: Results, extent: Extent) -> str:
    """Return README.md."""
    parts = [
        _INTRODUCTION,
        '## Targets',
        _target_table(results, extent),
        _target_text(),
        _LAW_TEXT,
        '## Sixteenfold range of force at resonance',
        _figure('level'),
        'Amplitude of X (rms times √2) over that without impacts, 50 m/N:',
        _level_table(results, extent),
        _ideal_text(results, extent),
        '## Broadband excitation',
        _figure('broadband'),
        _broadband_text(results, extent),
        _broadband_table(results, extent),
        '## Through the resonance, up and down',
        _figure('stepped_sine'),
        _stepped_table(results, extent),
        '## Changing load',
        _figure('load'),
        '## Inclined, with friction',
        _figure('incline'),
    ]
    for angle in ANGLES:
        parts += [f'Amplitude at {angle}° over that without impacts:']
        parts += [_level_table(results, extent, angle)]
    parts += [
        '## Delay, speed, noise, sampling',
        _figure('sensitivity'),
        *(_sensitivity_table(results, extent, what) for what in SENSITIVITIES),
        '## Energy of the actuators',
        _CAPTIONS['energy'],
        _energy_table(results, extent),
        _LIMITS,
    ]
    return '\n\n'.join(part.strip() for part in parts) + '\n'


def write_study(results: Results, extent: Extent, directory: Path) -> list[Path]:
    """Write figures and README.md, each completely or not at all; return the paths."""
    written = [directory / f'{name}.png' for name in FIGURES]
    for draw, path in zip(FIGURES.values(), written, strict=True):
        save_figure(draw(results, extent), path)
    page = directory / 'README.md'
    write_text(page, report_text(results, extent))
    return [*written, page]
