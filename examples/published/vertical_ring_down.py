# SPDX-License-Identifier: Apache-2.0
"""
Ring-down of a vertical rig with mu = 0.06: loss over the acceleration of M.

    python examples/published/vertical_ring_down.py [--out DIR]

R. D. Friend and V. K. Kinra, Journal of Sound and Vibration 233 (2000), 93-118: a bed of
particles in a box on a beam that is released. Here one m with a small R stands for the bed; its
R and the gap are chosen. Below 1 g m rests on its stop and only the dashpot acts; above, the loss
has one maximum.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from impact_damper_ros import RigParameters, ring_down
from impact_damper_ros.orbits.ring_down import RingDown

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    blank_figure,
    finish_panel,
    options,
    print_style,
    save,
    show,
)

RESTITUTIONS = (0.05, 0.1, 0.2, 0.3)
#: Natural frequency; first acceleration and gap, over g and g/omega^2.
OMEGA, FIRST, GAP = math.tau * 18.0, 8.0, 8.0
GRAVITY = 9.81


def released(restitution: float) -> RingDown:
    """Release the rig with a restitution."""
    unit = GRAVITY / OMEGA**2
    rig = RigParameters(
        primary_mass=1.0,
        stiffness=OMEGA**2,
        damping=2.0 * 0.001 * OMEGA,
        damper_mass=0.06,
        gap=GAP * unit,
        angle=0.5 * math.pi,
        gravity=GRAVITY,
        restitution_1=restitution,
        restitution_2=restitution,
    )
    return ring_down(rig, FIRST * unit)


def maxima(loss: np.ndarray) -> int:
    """Return how many maxima a curve has, without those a tenth of the largest deep or less."""
    from scipy.signal import find_peaks

    return len(find_peaks([0.0, *loss, 0.0], prominence=0.1 * max(loss))[0])


@print_style()
def main() -> None:
    """Compute, print and draw."""
    arguments = options(__doc__)
    rows = []
    figure = blank_figure(5.0, 3.2)
    axes = figure.subplots()
    for restitution, colour in zip(RESTITUTIONS, (BLUE, ORANGE, GREEN, PURPLE), strict=True):
        found = released(restitution)
        curve = found.curve(14)
        largest = int(np.argmax(curve['median']))
        at, loss = curve['acceleration'], curve['median']
        below = float(loss[at < 0.9].max())
        rows.append((restitution, float(loss[largest]), float(at[largest]), maxima(loss), below,
                     found.dashpot_loss, found.bound))  # fmt: skip
        axes.semilogx(at, loss, 'o-', color=colour, label=f'R = {restitution:g}', markersize=3)
    show(('R', 'largest Psi', 'at [g]', 'maxima', 'largest below 0.9 g', 'dashpot', 'bound'), rows)
    axes.legend(frameon=False)
    finish_panel(axes, '', 'acceleration of $M$ [g]', r'loss $Ψ$, median')
    save(figure, arguments.out / 'vertical_ring_down.png')


if __name__ == '__main__':
    main()
