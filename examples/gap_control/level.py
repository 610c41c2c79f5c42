# SPDX-License-Identifier: Apache-2.0
"""
Amplitude at resonance over a sixteenfold range of the force: laws, a fixed gap, and the ideal.

    python examples/gap_control/level.py [--out DIR] [--quick]

Level, and inclined with friction: level.png, incline.png and level.csv.
"""

from __future__ import annotations

import math
from typing import Any

from study import (
    FIXED,
    INCLINED,
    INDEPENDENT,
    LABELS,
    LAWS,
    REAL,
    RIG,
    STYLES,
    Watched,
    best_fixed_gap,
    ideal_ratio,
    law,
    watched,
)

import output
from impact_damper_ros import RigParameters

RIGS = {
    0: RIG,
    15: INCLINED.replace(angle=math.radians(15.0)),
    45: INCLINED.replace(angle=math.radians(45.0)),
}


def runs_at(rig: RigParameters, level: float, length: dict[str, float]) -> dict[str, Watched]:
    """Return the runs with the fixed gap that is best at 1 N, and with each law."""
    forced = rig.replace(force_amplitudes=(level,))
    found = {FIXED: watched(forced.replace(gap=best_fixed_gap(rig)), **length)}
    return found | {name: watched(forced, law(name, rig), **length) for name in LAWS}


def compared(timed: list[float], ideal: list[float]) -> str:
    """Say how near the timed law comes to the ideal, and how much it depends on the level."""
    most = max(one / other for one, other in zip(timed, ideal, strict=True))
    spread = (max(timed) - min(timed)) / (max(timed) + min(timed))
    return f'Timed law: at most {most:.4f} times the ideal, spread {spread:.4f}'


def draw(axes: Any, levels: list[float], ratios: dict[str, list[float]], letter: str) -> None:
    """Draw the amplitude against the force."""
    for name, row in ratios.items():
        style = STYLES.get(name, {'color': 'black', 'linewidth': 1.0})
        axes.plot(
            levels, row, label=LABELS.get(name, name), **{'linewidth': 1.4} | output.MARKS | style
        )
    axes.set(xscale='log', yscale='log')
    axes.set_ylim(0.024, 0.6)
    output.finish_panel(
        axes, letter, 'amplitude of the force at resonance [N]', 'X / X without impacts'
    )
    output.set_ticks(axes.xaxis, (0.25, 0.5, 1, 2, 4))
    output.set_ticks(axes.yaxis, (0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 1))


@output.print_style()
def main() -> None:
    """Run, print, write and draw."""
    arguments = output.options(__doc__)
    quick = arguments.quick
    levels = [0.25, 1.0, 4.0] if quick else [2.0 ** (k / 2) for k in range(-4, 5)]
    length = {'settle': 160.0, 'watch': 40.0} if quick else {'settle': 240.0, 'watch': 80.0}
    head = ('angle [deg]', 'law', *(f'{level:.3g} N' for level in levels))
    ratios: dict[int, dict[str, list[float]]] = {}
    for angle, rig in RIGS.items():
        rows: dict[str, list[float]] = {name: [] for name in (*LABELS, 'ideal')}
        for level in levels:
            forced = rig.replace(force_amplitudes=(level,))
            for name, run in runs_at(rig, level, length).items():
                rows[name].append(run.amplitude / forced.response_amplitude)
            rows['ideal'].append(ideal_ratio(forced))
        ratios[angle] = rows
        print(f'Amplitude over that without impacts, {angle} degrees:\n')
        output.show(head[1:], ([LABELS.get(name, name), *row] for name, row in rows.items()))
    output.write_rows(
        arguments.out / 'level.csv',
        head,
        ([angle, name, *row] for angle, rows in ratios.items() for name, row in rows.items()),
    )
    print(
        f'best fixed gap at 1 N: {best_fixed_gap(RIG):.1f} m. '
        f'{compared(ratios[0]["timed"], ratios[0]["ideal"])}\n'
    )
    real = {
        name: [
            watched(
                RIG.replace(force_amplitudes=(level,)),
                law(name, RIG, **REAL | {'actuator_speed': level * REAL['actuator_speed']}),
                **length,
            )
            for level in levels
        ]
        for name in INDEPENDENT
    }
    timed = [
        run.amplitude / RIG.replace(force_amplitudes=(level,)).response_amplitude
        for level, run in zip(levels, real['timed'], strict=True)
    ]
    print(
        f'Stops at {REAL["actuator_speed"]:g} m/s per newton of force, {REAL["actuator_mass"]:g} '
        f'kg each. {compared(timed, ratios[0]["ideal"])}. Powers [W] at 1 N:\n'
    )
    output.show(
        ('law', 'impacts', 'dashpot', 'actuators', 'spent / dissipated', 'rms of X [m]'),
        (
            (LABELS[name], run.impact_power, run.dashpot_power, run.actuator_power,
             f'{run.share:.1%}', run.rms)
            for name, runs in real.items()
            for run in [runs[levels.index(1.0)]]
        ),
    )  # fmt: skip
    figure = output.blank_figure(6.0, 4.2)
    draw(figure.subplots(), levels, ratios[0], '')
    output.save(figure, arguments.out / 'level.png', columns=2)
    figure = output.blank_figure(9.0, 4.4)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, angle, letter in zip(panels, (15, 45), 'ab', strict=True):
        draw(axes, levels, ratios[angle], letter)
        axes.text(0.97, 0.95, f'{angle}°', transform=axes.transAxes, ha='right', va='top')
    panels[1].set_ylabel('')
    output.save(figure, arguments.out / 'incline.png', columns=3)


if __name__ == '__main__':
    main()
