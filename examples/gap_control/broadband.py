# SPDX-License-Identifier: Apache-2.0
"""
Broadband excitation: laws against the fixed gap that is best for the same seed.

    python examples/gap_control/broadband.py [--out DIR] [--quick]

Random-phase multisines of 48 lines, 1 N rms, for 200 natural periods, of which the first 20 are
left out: broadband.png and broadband.csv.
"""

from __future__ import annotations

from statistics import fmean

import numpy as np
from study import (
    INDEPENDENT,
    LABELS,
    LAWS,
    REAL,
    RIG,
    SPAN,
    START,
    STYLES,
    Watched,
    broadband_gaps,
    broadband_rig,
    law,
    rms_over_gaps,
    watched,
)

import output


@output.print_style()
def main() -> None:
    """Run, print, write and draw."""
    arguments = output.options(__doc__)
    seeds = (1,) if arguments.quick else tuple(range(1, 9))
    length = {'settle': START, 'watch': SPAN}
    rigs = {seed: broadband_rig(seed) for seed in seeds}
    gaps = broadband_gaps(arguments.quick)
    fixed = np.array([rms_over_gaps(rig, gaps, **length) for rig in rigs.values()])
    best = {
        seed: watched(rigs[seed].replace(gap=float(gaps[row.argmin()])), **length)
        for seed, row in zip(seeds, fixed, strict=True)
    }
    runs: dict[str, dict[int, Watched]] = {
        name: {seed: watched(rig, law(name, RIG), **length) for seed, rig in rigs.items()}
        for name in LAWS
    }
    real = {
        name: {seed: watched(rig, law(name, RIG, **REAL), **length) for seed, rig in rigs.items()}
        for name in INDEPENDENT
    }
    rms = {
        name: [run.rms / best[seed].rms for seed, run in row.items()] for name, row in runs.items()
    }
    peak = {
        name: [run.peak / best[seed].peak for seed, run in row.items()]
        for name, row in runs.items()
    }
    common, least = fixed.mean(axis=0), fixed.min(axis=1)
    whole = fixed[:, gaps % 1.0 == 0.0].min(axis=1)
    coarse = [run.rms / one for run, one in zip(runs['timed'].values(), whole, strict=True)]
    print(
        f'{len(gaps)} fixed gaps from {gaps[0]:g} to {gaps[-1]:g} m. The best of each seed: '
        f'{", ".join(f"{gap:g}" for gap in gaps[fixed.argmin(axis=1)])} m, rms {min(least):.3f} '
        f'to {max(least):.3f} m, mean {fmean(least):.3f} m. The best of all: '
        f'{gaps[common.argmin()]:g} m, mean rms {common.min():.3f} m. Over the best gap of whole '
        f'metres the timed law comes to {fmean(coarse):.3f} in the mean, {max(coarse):.3f} at '
        'most.\n'
    )
    head = ('law', 'rms over the best gap', 'of the seeds', 'peak', 'of the seeds',
            'rms over one gap for all', f'rms, stops at {REAL["actuator_speed"]:g} m/s',
            'spent [W]', 'over dissipated')  # fmt: skip
    rows = []
    for name in LAWS:
        row: list[object] = [LABELS[name]]
        for ratios in (rms[name], peak[name]):
            row += [f'{fmean(ratios):.3f}', f'{min(ratios):.3f} to {max(ratios):.3f}']
        over_common = (
            run.rms / one[common.argmin()]
            for run, one in zip(runs[name].values(), fixed, strict=True)
        )
        row.append(f'{fmean(over_common):.3f}')
        if name in real:
            some = real[name].values()
            spent, lost = (
                fmean(run.actuator_power for run in some),
                fmean(run.impact_power + run.dashpot_power for run in some),
            )
            ratio = fmean(run.rms / best[seed].rms for seed, run in real[name].items())
            row += [f'{ratio:.3f}', f'{spent:.3g}', f'{spent / lost:.0%}']
        else:
            row += ['', '', '']
        rows.append(row)
    output.show(head, rows)
    output.show(
        ('law', 'impacts [W]', 'dashpot [W]', 'actuators [W]', 'rms of X [m]'),
        (
            (LABELS[name], *(fmean(getattr(run, part) for run in row.values())
             for part in ('impact_power', 'dashpot_power', 'actuator_power', 'rms')))
            for name, row in real.items()
        ),
    )  # fmt: skip
    output.write_rows(
        arguments.out / 'broadband.csv',
        ('case', 'gap', *(f'rms, seed {seed}' for seed in seeds)),
        [
            *(['fixed', float(gap), *map(float, fixed[:, k])] for k, gap in enumerate(gaps)),
            *([name, '', *(run.rms for run in row.values())] for name, row in runs.items()),
            *([f'{name}, real', '', *(run.rms for run in row.values())]
              for name, row in real.items()),
        ],
    )  # fmt: skip
    figure = output.blank_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    left.fill_between(gaps, fixed.min(axis=0), fixed.max(axis=0), color='0.88')
    left.plot(gaps, common, color=output.GREY, linewidth=1.4, label='fixed gap, mean of the seeds')
    for k, name in enumerate(LAWS):
        color = STYLES[name]['color']
        line = {key: value for key, value in STYLES[name].items() if key != 'marker'}
        mean = fmean(run.rms for run in runs[name].values())
        left.axhline(mean, label=LABELS[name], **line)
        for shift, marker, ratios, label in (
            (-0.12, 'o', rms[name], 'rms'),
            (0.12, 'D', peak[name], 'peak'),
        ):
            look = output.MARKS | {'markersize': 5, 'marker': marker, 'color': color}
            look |= {'markerfacecolor': color if label == 'rms' else 'white'}
            places = [k + shift] * len(ratios)
            right.plot(places, ratios, linestyle='none', label=label if k == 0 else None, **look)
    left.set_ylim(0.0, 5.0)
    output.finish_panel(left, 'a', 'fixed gap [m]', 'rms of X [m]')
    right.axhline(1.0, color='0.5', linewidth=0.8)
    right.axhline(0.85, color='black', linewidth=0.8, linestyle=(0, (5, 3)))
    right.text(-0.4, 0.84, 'target for the rms', va='top', fontsize=8)
    right.set_xlim(-0.5, len(LAWS) - 0.5)
    right.set_ylim(bottom=0.0)
    output.finish_panel(right, 'b', '', 'X over that with the best fixed gap')
    right.legend(loc='lower left', frameon=False)
    right.set_xticks(range(len(LAWS)), [name.replace(' ', '\n') for name in LAWS])
    output.save(figure, arguments.out / 'broadband.png', columns=3)


if __name__ == '__main__':
    main()
