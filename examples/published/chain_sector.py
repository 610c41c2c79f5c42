# SPDX-License-Identifier: Apache-2.0
"""
One sector of a chain of oscillators with vibro-impact energy sinks, without its neighbours.

    python examples/published/chain_sector.py [--out DIR]

The sector (mu = 0.02, damping ratio 0.001, R = 0.8) is that of T. Weidemann, L. A. Bergman,
A. F. Vakakis and M. Krack, Nonlinear Dynamics, 2025, doi:10.1007/s11071-025-10928-4. Its coupling
to the neighbours, and with it localization, is not in this package; the sector alone is.

At a given force over K b and frequency the balance of `invariant_manifold` is quadratic in B: the
response over the force at resonance, which is compared with exact motions.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from invariant_manifold import amplitude, exact, force, sink

from impact_damper_ros import PeriodicOrbit, find_orbits

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import BLUE, GREY, MARKS, blank_figure, finish_panel, options, print_style, save, show

SECTOR = sink(0.8, 0.02, 1e-3)
HEIGHTS = (1.2, 1.5, 2.0, 3.0, 5.0)


def compared(heights: tuple[float, ...] = HEIGHTS) -> list[tuple[float, float, float, float]]:
    """Return force, C/b of the balance and of the exact motion, and C/b without m."""
    rows = []
    for height in heights:
        push = force(SECTOR, height)
        alone = 0.5 * push / SECTOR.zeta
        rows.append((push, abs(amplitude(SECTOR, height)), exact(SECTOR, height)[1], alone))
    return rows


def stable_at(height: float) -> list[PeriodicOrbit]:
    """Return the stable motions of two impacts per cycle at the force of a height."""
    rig = SECTOR.replace(force_amplitudes=force(SECTOR, height))
    return [orbit for orbit in find_orbits(rig, (1, 2), simulate=False).orbits if orbit.stable]


@print_style()
def main() -> None:
    """Compute, print and draw."""
    arguments = options(__doc__)
    rows = compared()
    show(('force over K b', 'C/b, balance', 'C/b, exact', 'apart', 'C/b without m', 'stable'),
         [(f'{p:.5f}', f'{a:.4f}', f'{b:.4f}', f'{b / a - 1.0:.1e}', f'{alone:.2f}',
           len(stable_at(height)))
          for height, (p, a, b, alone) in zip(HEIGHTS, rows, strict=True)])  # fmt: skip
    figure = blank_figure(5.0, 3.2)
    axes = figure.subplots()
    heights = np.linspace(1.0, 5.2, 200)
    pushes = [force(SECTOR, height) for height in heights]
    axes.loglog(pushes, [abs(amplitude(SECTOR, h)) for h in heights], color=BLUE, label='balance')
    pushes, _, sizes, alone = np.transpose(compared(tuple(np.linspace(1.1, 5.0, 16))))
    axes.loglog(pushes, sizes, 'o', color=BLUE, label='exact', **MARKS)
    axes.loglog(pushes, alone, '--', color=GREY, label='without m')
    axes.legend(frameon=False)
    finish_panel(axes, '', 'force over $K b$ at $r$ = 1', 'amplitude of $X$ over $b$')
    save(figure, arguments.out / 'chain_sector.png')


if __name__ == '__main__':
    main()
