# SPDX-License-Identifier: Apache-2.0
"""
Real sensors and actuators: delay, finite speed, noise and slow sampling.

    python examples/gap_control/sensitivity.py [--out DIR] [--quick]

rms of X at resonance over the ideal, and under broadband excitation of seed 1 over the best fixed
gap: sensitivity.png and sensitivity.csv.
"""

from __future__ import annotations

import math

from study import (
    INDEPENDENT,
    RIG,
    SPAN,
    START,
    STYLES,
    broadband_gaps,
    broadband_rig,
    ideal_amplitude,
    law,
    rms_over_gaps,
    watched,
)

import output

#: Of each disturbance: its label and values, and the parameters that it is, given a value.
DISTURBANCES = {
    'delay': (
        'delay of the actuators [natural periods]',
        (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
        lambda value: {'actuator_delay': value * math.tau},
    ),
    'speed': (
        'speed of the stops [m/s]',
        (1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 64.0),
        lambda value: {'actuator_speed': value},
    ),
    'noise': (
        'noise on X, Y and their rates / amplitude of each',
        (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2),
        lambda value: dict.fromkeys(
            ('gap_control_noise_position', 'gap_control_noise_velocity'),
            value * ideal_amplitude(RIG),
        ),
    ),
    'sampling': (
        'samples of the controller per natural period',
        (6.0, 8.0, 12.0, 16.0, 20.0, 32.0, 64.0, 100.0),
        lambda value: {'gap_control_rate': value / math.tau},
    ),
}
RESONANCE, BROADBAND = 'resonance, over the ideal', 'broadband, over the best fixed gap'
#: The amplitude law fails under broadband excitation.
SERIES = (
    *((name, RESONANCE) for name in INDEPENDENT),
    *((name, BROADBAND) for name in INDEPENDENT[1:]),
)


@output.print_style()
def main() -> None:
    """Run, print, write and draw."""
    arguments = output.options(__doc__)
    quick = arguments.quick
    length = {'settle': 160.0, 'watch': 40.0} if quick else {'settle': 240.0, 'watch': 80.0}
    random, span = broadband_rig(1), {'settle': START, 'watch': SPAN}
    reference = {
        RESONANCE: ideal_amplitude(RIG) / math.sqrt(2.0),
        BROADBAND: float(rms_over_gaps(random, broadband_gaps(quick), **span).min()),
    }
    runs = {RESONANCE: (RIG, length), BROADBAND: (random, span)}
    approach = watched(RIG, law('timed', RIG), **length).approach
    print(f'With the timed law at resonance m approaches M with {approach:.1f} m/s.\n')
    figure = output.blank_figure(9.0, 6.4)
    stored = []
    for axes, letter, (what, (label, values, disturbed)) in zip(
        figure.subplots(2, 2).ravel(), 'abcd', DISTURBANCES.items(), strict=True
    ):
        some = values[3:4] if quick else values
        rows = []
        for name, where in SERIES:
            rig, spans = runs[where]
            controls = (law(name, RIG, **disturbed(value)) for value in some)
            ratios = [watched(rig, one, **spans).rms / reference[where] for one in controls]
            rows.append([f'{name}: {where}', *(f'{ratio:.3f}' for ratio in ratios)])
            stored += [[what, v, name, where, r] for v, r in zip(some, ratios, strict=True)]
            look = {'linestyle': '-', 'marker': 'o'} if where == RESONANCE else {
                'linestyle': '--', 'marker': 'D'}  # fmt: skip
            look |= output.MARKS | {'linewidth': 1.4, 'color': STYLES[name]['color']}
            axes.plot(some, ratios, label=rows[-1][0], **look)
        output.show((label, *(f'{value:g}' for value in some)), rows)
        if what in ('speed', 'sampling'):
            axes.set_xscale('log')
            output.set_ticks(axes.xaxis, some)
        axes.set(yscale='log', ylim=(0.5, 14.0))
        axes.axhline(1.15, color='0.4', linewidth=0.8, linestyle=':')
        axes.axhline(0.85, color='0.4', linewidth=0.8, linestyle=(0, (5, 3)))
        output.finish_panel(axes, letter, label, 'rms of X, ratio')
        output.set_ticks(axes.yaxis, (0.5, 0.7, 1, 1.5, 2, 3, 5, 10))
    output.write_rows(
        arguments.out / 'sensitivity.csv', ('disturbance', 'value', 'law', 'where', 'rms'), stored
    )
    output.save(figure, arguments.out / 'sensitivity.png', columns=2)


if __name__ == '__main__':
    main()
