"""The report of the gap control study: tables, figures, and what they say."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean

from impact_damper_ros.report.drawing import save_figure

from .figures import FIGURES
from .findings import Results, broadband, level_sweep, targets
from .runs import (
    ANGLES,
    LAWS,
    RIG,
    SENSITIVITIES,
    Extent,
    ideal_ratio,
    sensitivity_values,
    sweep_frequencies,
)

__all__ = ['CAPTIONS', 'INTRODUCTION', 'LAW_TEXT', 'LIMITS', 'report_text', 'write_study']


INTRODUCTION = """
# Gap control

What the laws of `gap_control` do to the vibration of M, against fixed gaps and against what two
impacts per cycle can do at best. All numbers and figures are of exact runs; this page is written
by `study_gap_control`.

The rig, unless said otherwise: M = 1 kg, K = 1 N/m, ζ = 0.01, μ = m/M = 0.1, R₁ = R₂ = 0.5,
level, without friction; 32 samples of the controller per natural period, stops that move at once.
It starts at rest with m in the middle. The rig is linear but for the gap: as long as the range of
the stops does not matter, all lengths may be multiplied by one number together with the force.
"""

LAW_TEXT = """
## The laws

**What the source says.** Masri, Miller, Dehghanyar and Caughey, *Active parameter control of
nonlinear vibrating structures*, J. Applied Mechanics 56 (1989), is what the paper behind this
package recommends at its end. Of that law is known here: the stops can be moved; no model of the
structure is used; the amount of oscillation of the primary mass near the damper determines the
size of the gap and the time at which the control acts; the control energy moves the stops, not the
structure. Its exact form was not available.

**What is reconstruction** (`gap_control_stops: symmetric`). With Â ← (1 − α) Â + α max|X| of the
last half cycle at each passage of X through zero, and d* = π Â (1 + R)/((1 − R)(1 + μ)), the gap
at which the flight from one impact at X = 0 to the next takes just half a cycle:

- *amplitude*: d = κ d*, within [`gap_min`, `gap_max`].
- *timed*: the stops are parked at a multiple of d*. At a passage of X through zero at which m
  moves outwards and the impact would take energy from M (X′Y′ < 0 and
  μ(1 + R)/(1 + μ)·|Y′| < 2|X′|), and `gap_min` < 2|Y| < d, the stop is closed on m, hits
  it where |X′| is largest, and is opened again; at most once for each passage.

Both act once Â is above `gap_control_threshold`; below it the stops stand at `gap`. Not in the
reconstruction as it was, but needed by it: stops that have not been hit for more than two half
cycles come in to where m turns round. Without that, a rig that starts from rest never begins: d*
is many times as wide as m moves by itself.

**What is extension** (`gap_control_stops: independent`, the default). Weight and friction make the
two flights unequal, and a random force lets the middle of the motion of m wander.

- *amplitude*: each stop has a place of its own. It grows and shrinks with Â, and at each impact on
  it, it is moved by a tenth (`gap_control_timing_gain`) of what m covers between the impact, as
  seen in the samples, and 0.05 half cycles (`gap_control_lead`) before the passage. Neither R nor
  μ nor the angle is needed.
- *timed*: the stop is closed on m on either side of the middle, up to half of d* past it, if m
  comes with at least half the speed of M, so that the one blow is not spent on a feeble one.

**What the controller sees**: X, X′, Y, Y′ at `gap_control_rate`, and once more at each passage of
X through zero, where a detector triggers the converters (noise on all of it, if asked for); the
instants of these triggers; and where the stops are. Impacts are found as a jump of Z′ between two
samples. With a delay or a finite speed, the passage and the place of m there are predicted from
the last sample and the rhythm of the triggers, and the command is given that much earlier. X is
measured from the static equilibrium of M alone.

**What the actuators may do**: a moving stop never does work on m. Where the two meet, the stop
stands, and is hit there, or not. It is opened again by the next command.
"""

CAPTIONS = {
    'level': (
        'Level sweep at resonance. Amplitude of X over that without impacts, for a fixed gap that '
        'is the best one at 1 N, and for the laws. The ideal is ζ/(ζ + ζ_eq) with '
        'ζ_eq = (2/π)(μ/(1 + μ))(1 + R)/(1 − R): two impacts per cycle, both at X = 0.'
    ),
    'broadband': (
        'Broadband excitation. A random-phase multisine of 48 lines from 0.5 to 2 times the '
        'natural frequency, 1 N rms, for 200 natural periods. (a) rms of X against the fixed gap, '
        'mean and span of the seeds, and with the laws. (b) rms (filled) and peak (open) of X '
        'over those of the best fixed gap, for each seed.'
    ),
    'sweep': (
        'Stepped sine through the resonance. Largest |X| in the latter half of each of the steps '
        'of 25 natural periods, 1 N, up (solid) and down (dashed).'
    ),
    'load': ('A load that changes. The force at resonance goes from 1 N to 4 N and to 0.25 N.'),
    'incline': (
        'Inclined rigs with friction. The basic rig of Bapat (1995) (μ = 0.042, R = 0.75, '
        'ζ = 0.005), friction 0.5, g = 1 m/s², at resonance; at 15° m sticks, at 45° it slides '
        'down. The ideal takes friction into account, which brakes m on both of its ways, and is '
        'the more important the smaller the force.'
    ),
    'sensitivity': (
        'What real sensors and actuators cost. rms of X at resonance over the ideal (solid), and '
        'with the timed law under broadband excitation over the best fixed gap (dashed); '
        'independent stops. Noise is given over the ideal amplitude of X, for X and Y, and of X′, '
        'for the rates. Lines: 1.15, and 0.85.'
    ),
    'energy': (
        'With stops of 0.01 kg (1 % of M) that move at 16 m/s. Each start or turn of a stop '
        'spends its kinetic energy, nothing is recovered at its end; friction of guides, and '
        'weight and inertia of the stop in the moving M are left out. None of it reaches m: the '
        'work of the stops on m and M is zero by construction, and the tests find it so in the '
        'balance of energy of random runs.'
    ),
}

LIMITS = """
## Where it falls short

- The amplitude law with independent stops is no good under broadband excitation: it corrects a
  stop by one impact at a time, and these come at random. Symmetric stops do better there, the
  timed law much better.
- A stop that is slower than about half the approach speed of m (6 of 10.9 m/s here) cannot close
  and open again within half a cycle. m then meets stops that are half-way, at all the wrong
  times, and the timed law is worse than a fixed gap. The amplitude law makes do with less.
- A delay of a quarter of a period is too much for the amplitude law, whose correction then comes
  an impact too late. The timed law looks ahead, and stands it as long as the rhythm is regular.
- At resonance a fixed gap that is tuned for just this force is as good as the laws. They are for
  the case that force, frequency or friction are not known or do not stay.
- The timed law spends about as much on its stops as the impacts take from M, with stops of a
  hundredth of M as fast as assumed above. It goes with their mass and the square of their speed.

## What this does not show

- The reaction of the moving stops on M is left out: their mass is taken to be part of M. It is
  small as long as the stops are light.
- X is measured from the equilibrium of M alone. Where M moves less than m's weight deflects it,
  m g sin θ / K, X has no passages through zero, and the control does not act.
- At rest on a stop, or stuck in the gap, m takes no energy, and a stop cannot push it. Below
  the acceleration at which m begins to slide no law helps.
"""


_NAMES = {
    'fixed': 'fixed gap, tuned at 1 N',
    'amplitude symmetric': 'amplitude, symmetric stops',
    'amplitude': 'amplitude, independent stops',
    'timed symmetric': 'timed, symmetric stops',
    'timed': 'timed, independent stops',
}


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f'| {" | ".join(head)} |', f'| {" | ".join("---" for _ in head)} |']
    return '\n'.join([*lines, *(f'| {" | ".join(row)} |' for row in rows)])


def _target_table(results: Results, extent: Extent) -> str:
    return _table(
        ('target', 'at most', 'reached', ''),
        (
            (one.words, f'{one.limit:g}', f'{one.reached:.4f}', 'met' if one.met else '**missed**')
            for one in targets(results, extent)
        ),
    )


def _level_table(results: Results, extent: Extent, angle: int = 0) -> str:
    sweep = level_sweep(results, extent, angle)
    head = ('force [N]', *(f'{level:.3g}' for level in sweep.levels))
    rows = [
        (_NAMES[name], *(f'{value:.4f}' for value in values))
        for name, values in sweep.ratios.items()
    ]
    return _table(head, [*rows, ('ideal', *(f'{value:.4f}' for value in sweep.ideal))])


def _broadband_table(results: Results, extent: Extent) -> str:
    found = broadband(results, extent)
    rows = []
    for name in LAWS:
        rms, peak = zip(*found.ratios[name], strict=True)
        rows.append(
            (
                _NAMES[name],
                f'{fmean(rms):.3f}',
                f'{min(rms):.3f} to {max(rms):.3f}',
                f'{fmean(peak):.3f}',
                f'{min(peak):.3f} to {max(peak):.3f}',
            )
        )
    return _table(('law', 'rms, mean', 'rms, seeds', 'peak, mean', 'peak, seeds'), rows)


def _sweep_table(results: Results, extent: Extent) -> str:
    frequencies = sweep_frequencies(extent)
    turn = len(frequencies) // 2
    rows = []
    for name in ('fixed', 'amplitude', 'timed'):
        peaks = results['sweep', name].peaks
        up, down = peaks[: turn + 1], peaks[turn:][::-1]
        apart = max(abs(math.log(a / b)) for a, b in zip(up, down, strict=True))
        where = frequencies[max(range(len(up)), key=up.__getitem__)]
        rows.append(
            (
                _NAMES[name],
                f'{max(up):.2f} m at r = {where:.2f}',
                f'{max(down):.2f} m',
                f'{math.exp(apart):.2f}',
            )
        )
    head = (
        '',
        'largest on the way up',
        'largest on the way down',
        'up and down apart by a factor',
    )
    return _table(head, rows)


def _energy_table(results: Results) -> str:
    rows = []
    for where in ('resonance', 'broadband'):
        for name in ('amplitude', 'timed'):
            one = results['energy', where, name]
            taken = one.impact_power + one.dashpot_power
            rows.append(
                (
                    f'{_NAMES[name]}, {where}',
                    f'{one.impact_power:.4g}',
                    f'{one.dashpot_power:.4g}',
                    f'{one.actuator_power:.4g}',
                    f'{100.0 * one.actuator_power / taken:.1f} %',
                    f'{one.rms:.3f}',
                )
            )
    head = (
        '',
        'impacts take [W]',
        'dashpot takes [W]',
        'actuators spend [W]',
        'spent / taken',
        'rms of X [m]',
    )
    return _table(head, rows)


_UNITS = {
    'delay': ('delay [natural periods]', 'g'),
    'speed': ('speed [m/s]', 'g'),
    'noise': ('noise / amplitude', 'g'),
    'sampling': ('samples per natural period', 'g'),
}


def _sensitivity_table(results: Results, extent: Extent, what: str) -> str:
    ideal = ideal_ratio(RIG) * RIG.response_amplitude / math.sqrt(2.0)
    reference = broadband(results, extent).rms[0]
    values = [v for v in sensitivity_values(what) if ('sensitivity', what, 'timed', v) in results]
    rows = [
        (
            f'{name}: {words}',
            *(f'{results[part, what, name, value].rms / scale:.3f}' for value in values),
        )
        for name, part, words, scale in (
            ('amplitude', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity', 'resonance, over the ideal', ideal),
            ('timed', 'sensitivity broadband', 'broadband, over the best fixed gap', reference),
        )
    ]
    return _table((_UNITS[what][0], *(f'{value:g}' for value in values)), rows)


def _figure(name: str) -> str:
    return f'![{CAPTIONS[name].partition(".")[0]}]({name}.png)\n\n*{CAPTIONS[name]}*'


def report_text(results: Results, extent: Extent) -> str:
    """Return README.md."""
    found = broadband(results, extent)
    parts = [
        INTRODUCTION,
        '## Targets',
        _target_table(results, extent),
        LAW_TEXT,
        '## Sixteenfold range of force at resonance',
        _figure('level'),
        'Amplitude of X (rms times √2) over that without impacts, 50 m per newton:',
        _level_table(results, extent),
        '## Broadband excitation',
        _figure('broadband'),
        f'Over the best fixed gap, {found.best:g} m, which leaves an rms of '
        f'{min(found.rms):.3f} to {max(found.rms):.3f} m (seeds {extent.seeds[0]} to '
        f'{extent.seeds[-1]}):',
        _broadband_table(results, extent),
        '## Through the resonance, up and down',
        _figure('sweep'),
        _sweep_table(results, extent),
        '## A load that changes',
        _figure('load'),
        '## Inclined, with friction',
        _figure('incline'),
    ]
    for angle in ANGLES:
        parts += [f'At {angle}°, over the amplitude without impacts:']
        parts += [_level_table(results, extent, angle)]
    parts += [
        '## Delay, speed, noise, sampling',
        _figure('sensitivity'),
        *(_sensitivity_table(results, extent, what) for what in SENSITIVITIES),
        '## What the actuators spend',
        CAPTIONS['energy'],
        _energy_table(results),
        LIMITS,
    ]
    return '\n\n'.join(part.strip() for part in parts) + '\n'


def write_study(results: Results, extent: Extent, directory: Path) -> list[Path]:
    """
    Write figures and README.md, each whole or not at all.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    OSError
        If one cannot be written.
    """
    written = []
    for name, draw in FIGURES.items():
        path = directory / f'{name}.png'
        save_figure(draw(results, extent), path)
        written.append(path)
    path = directory / 'README.md'
    part = path.with_name('.README.md.part')
    try:
        part.write_text(report_text(results, extent), encoding='utf-8')
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return [*written, path]
