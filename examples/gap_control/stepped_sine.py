# SPDX-License-Identifier: Apache-2.0
"""
Stepped sine through the resonance, up and down: the largest |X| late in each step.

    python examples/gap_control/stepped_sine.py [--out DIR] [--quick]

Steps of 0.01 rad/s, 25 natural periods each, 1 N: stepped_sine.png and stepped_sine.csv.
"""

from __future__ import annotations

import math

import numpy as np
from study import FIXED, INDEPENDENT, LABELS, OFF, RIG, SAMPLES, STYLES, best_fixed_gap, law

import output
from impact_damper_ros import GapControlParameters, Rig

LOW, HIGH = 0.8, 1.2


def peaks_of(control: GapControlParameters, steps: int, dwell: int) -> np.ndarray:
    """Return the largest |X| in the latter half of each step, up to the top and down again, m."""
    rig = RIG.replace(
        sweep_mode='up_down',
        sweep_low=LOW,
        sweep_high=HIGH,
        sweep_step=round((HIGH - LOW) / steps, 12),
        sweep_dwell=dwell * math.tau,
        gap=best_fixed_gap(RIG),
    )
    count = 2 * steps + 1
    # In the middle of its parts, so that none is at a change of the frequency
    instants = math.tau / SAMPLES * (np.arange(count * dwell * SAMPLES) + 0.5)
    run = Rig(rig, control=control, compiled=None)
    x = run.run(count * dwell * math.tau, instants).samples['x']
    return np.abs(x.reshape(count, 2, -1)[:, 1]).max(axis=1)


@output.print_style()
def main() -> None:
    """Run, print, write and draw."""
    arguments = output.options(__doc__)
    steps, dwell = (4, 20) if arguments.quick else (40, 25)
    ratios = np.linspace(LOW, HIGH, steps + 1)
    controls = {FIXED: OFF} | {name: law(name, RIG) for name in INDEPENDENT}
    found = {name: peaks_of(control, steps, dwell) for name, control in controls.items()}
    ways = {name: (x[: steps + 1], x[steps:][::-1]) for name, x in found.items()}
    output.show(
        ('', 'peak of X, up', 'peak of X, down', 'largest ratio of up and down'),
        (
            (
                LABELS[name],
                f'{up.max():.2f} m at r = {ratios[up.argmax()]:.2f}',
                f'{down.max():.2f} m',
                f'{np.exp(np.abs(np.log(up / down)).max()):.2f}',
            )
            for name, (up, down) in ways.items()
        ),
    )
    output.write_rows(
        arguments.out / 'stepped_sine.csv',
        ('frequency ratio', *(f'{name}, {way}' for name in found for way in ('up', 'down'))),
        (
            [float(ratio), *(float(way[k]) for pair in ways.values() for way in pair)]
            for k, ratio in enumerate(ratios)
        ),
    )
    figure = output.blank_figure(6.0, 4.4)
    axes = figure.subplots()
    alone = [RIG.replace(force_frequencies=(r,)).response_amplitude for r in ratios]
    axes.plot(ratios, alone, color='black', linewidth=0.9, label='without impacts')
    axes.plot([], [], ' ', label='up: solid, down: dashed')
    for name, (up, down) in ways.items():
        look = output.MARKS | {'linewidth': 1.4, 'color': STYLES[name]['color']}
        axes.plot(ratios, up, marker=STYLES[name]['marker'], label=LABELS[name], **look)
        axes.plot(ratios, down, linestyle='--', **look)
    axes.set_yscale('log')
    output.finish_panel(axes, '', 'frequency of the force over the natural one', 'largest |X| [m]')
    output.set_ticks(axes.yaxis, (1, 2, 5, 10, 20, 50))
    output.save(figure, arguments.out / 'stepped_sine.png', columns=2)


if __name__ == '__main__':
    main()
