# SPDX-License-Identifier: Apache-2.0
"""
A load that changes: the force at resonance goes from 1 N to 4 N, and then to 0.25 N.

    python examples/gap_control/load.py [--out DIR] [--quick]

The largest |X| in each natural period: load.png and load.csv.
"""

from __future__ import annotations

import math

import numpy as np
from study import (
    FIXED,
    INDEPENDENT,
    LABELS,
    OFF,
    RIG,
    SAMPLES,
    STYLES,
    best_fixed_gap,
    ideal_amplitude,
    law,
)

import output
from impact_damper_ros import GapControlParameters, Rig

LEVELS = (1.0, 4.0, 0.25)


def peaks_of(control: GapControlParameters, periods: int) -> np.ndarray:
    """Return the largest |X| in each period, m; the force changes between two of them."""
    run = Rig(RIG.replace(gap=best_fixed_gap(RIG)), control=control, compiled=None)
    peaks = []
    for k, level in enumerate(LEVELS):
        run.change(run.parameters.replace(force_amplitudes=(level,)))
        part = (np.arange(periods * SAMPLES) + 1) / SAMPLES
        instants = math.tau * (k * periods + part)
        x = run.run(float(instants[-1]), instants).samples['x']
        peaks.append(np.abs(x.reshape(periods, SAMPLES)).max(axis=1))
    return np.concatenate(peaks)


@output.print_style()
def main() -> None:
    """Run, print, write and draw."""
    arguments = output.options(__doc__)
    span = 40 if arguments.quick else 120
    controls = {FIXED: OFF} | {name: law(name, RIG) for name in INDEPENDENT}
    found = {name: peaks_of(control, span) for name, control in controls.items()}
    ideals = [ideal_amplitude(RIG.replace(force_amplitudes=(level,))) for level in LEVELS]
    output.show(
        ('largest X of the last period [m]', *(f'at {level:g} N' for level in LEVELS)),
        [
            *([LABELS[name], *map(float, x[span - 1 :: span])] for name, x in found.items()),
            ['ideal', *ideals],
        ],
    )
    output.write_rows(
        arguments.out / 'load.csv',
        ('natural period', *found),
        ([k, *map(float, row)] for k, row in enumerate(zip(*found.values(), strict=True))),
    )
    figure = output.blank_figure(7.5, 3.8)
    axes = figure.subplots()
    for name, x in found.items():
        axes.plot(x, color=STYLES[name]['color'], linewidth=1.3, label=LABELS[name])
    for k, (level, ideal) in enumerate(zip(LEVELS, ideals, strict=True)):
        ends, label = [k * span, (k + 1) * span], 'ideal' if k == 0 else None
        axes.plot(ends, [ideal, ideal], color='black', linewidth=0.8, label=label)
        axes.text((k + 0.5) * span, 105.0, f'{level:g} N', ha='center', va='center')
    axes.set(yscale='log', xlim=(0.0, 3.0 * span), ylim=(0.3, 160.0))
    output.finish_panel(axes, '', 'time [natural periods]', 'largest |X| of each period [m]')
    output.set_ticks(axes.yaxis, (0.5, 1, 2, 5, 10, 20, 50, 100))
    output.save(figure, arguments.out / 'load.png', columns=3)


if __name__ == '__main__':
    main()
