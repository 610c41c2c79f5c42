# SPDX-License-Identifier: Apache-2.0
"""
Slow invariant manifold of a vibro-impact energy sink: amplitude of M over that of m, its fold.

    python examples/published/invariant_manifold.py [--out DIR]

O. V. Gendelman, Journal of Sound and Vibration 331 (2012), 4599-4608.

For a light m between stops at +-b, without friction, Z is a triangle of height B, and X a cosine
of amplitude C. At stop 1, X = B - b, and m moves at (2/pi) B Omega, before and after. As the
velocity of M does not change, restitution needs X' = -q B Omega, q = (2/pi) (1 - R)/(1 + R). So

    C^2 = (B - b)^2 + (q B)^2,    least at B = b/(1 + q^2), where C = b q/sqrt(1 + q^2).

With the first harmonic 8/pi^2 of a triangle the force that belongs to each B is, over K,

    F = |(1 - r^2 + 2 i zeta r) (B - b + i q B) - mu r^2 (8/pi^2) B|.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from impact_damper_ros import PeriodicOrbit, RigParameters, find_orbits

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import (
    BLUE,
    MARKS,
    ORANGE,
    blank_figure,
    finish_panel,
    options,
    print_style,
    save,
    show,
)

RESTITUTIONS = (0.6, 0.8)
MASS_RATIO, ZETA = 5e-4, 2e-4
_TRIANGLE = 8.0 / math.pi**2


def sink(restitution: float, mass_ratio: float = MASS_RATIO, zeta: float = ZETA) -> RigParameters:
    """Return a rig at resonance with b = 1."""
    return RigParameters(
        damping=2.0 * zeta,
        damper_mass=mass_ratio,
        gap=2.0,
        gravity=0.0,
        restitution_1=restitution,
        restitution_2=restitution,
    )


def slope(restitution: float) -> float:
    """Return q."""
    return 2.0 / math.pi * (1.0 - restitution) / (1.0 + restitution)


def fold_of(restitution: float) -> tuple[float, float]:
    """Return B and C at the fold, over b."""
    q = slope(restitution)
    return 1.0 / (1.0 + q**2), q / math.hypot(1.0, q)


def amplitude(rig: RigParameters, height: float) -> complex:
    """Return X of the manifold over b, with the phase of Z, for a height B over b."""
    return height - 1.0 + 1j * slope(rig.restitution_1) * height


def force(rig: RigParameters, height: float) -> float:
    """Return the force over K b that belongs to a height B over b."""
    r, mu = rig.frequency_ratio, rig.mass_ratio
    inertia = 1.0 - r**2 + 2j * rig.zeta * r
    return abs(inertia * amplitude(rig, height) - mu * r**2 * _TRIANGLE * height)


def harmonics(orbit: PeriodicOrbit) -> tuple[float, float]:
    """Return B and C of an exact symmetric motion: C is of its first harmonic, by the balance."""
    rig = orbit.parameters
    r, half = rig.frequency_ratio, 0.5 * rig.gap
    height = orbit.x[0] + half
    turned = math.tau * orbit.phases[0] - 0.5 * math.pi
    pushed = rig.force_amplitudes[0] / rig.stiffness * np.exp(1j * turned)
    inertia = 1.0 - r**2 + 2j * rig.zeta * r
    x = (pushed + rig.mass_ratio * r**2 * _TRIANGLE * height) / inertia
    return height / half, float(abs(x)) / half


def exact(rig: RigParameters, height: float) -> tuple[float, float]:
    """Return B and C of the exact motion at the force that the manifold has for a height."""
    driven = rig.replace(force_amplitudes=force(rig, height) * 0.5 * rig.gap * rig.stiffness)
    found = find_orbits(driven, (1, 2), simulate=False).orbits
    symmetric = [o for o in found if o.viable and abs(o.x[0] + o.x[1]) < 1e-9 * rig.gap]
    return min(map(harmonics, symmetric), key=lambda found: abs(found[0] - height))


def exact_fold(rig: RigParameters) -> tuple[float, float]:
    """Return B and C where the exact C is least: of a parabola through three motions."""
    middle = fold_of(rig.restitution_1)[0]
    heights, sizes = zip(*(exact(rig, middle + d) for d in (-0.01, 0.0, 0.01)), strict=True)
    a, b, c = np.polyfit(np.array(heights) - middle, np.array(sizes) ** 2, 2)
    return middle - 0.5 * b / a, math.sqrt(c - 0.25 * b**2 / a)


@print_style()
def main() -> None:
    """Compute, print and draw."""
    arguments = options(__doc__)
    rows = []
    figure = blank_figure(5.0, 3.2)
    axes = figure.subplots()
    for restitution, colour in zip(RESTITUTIONS, (BLUE, ORANGE), strict=True):
        (_, closed), (_, found) = fold_of(restitution), exact_fold(sink(restitution))
        rows.append((restitution, f'{closed:.6f}', f'{found:.6f}', f'{found / closed - 1.0:.1e}'))
        heights = np.linspace(0.4, 1.6, 200)
        label = f'R = {restitution:g}'
        sizes = [abs(amplitude(sink(restitution), height)) for height in heights]
        axes.plot(heights, sizes, color=colour, label=label)
        marks = [exact(sink(restitution), height) for height in np.linspace(0.7, 1.35, 14)]
        axes.plot(*np.transpose(marks), 'o', color=colour, **MARKS)
    show(('R', 'fold C/b, closed form', f'exact, mu = {MASS_RATIO:g}', 'apart'), rows)
    axes.legend(frameon=False)
    finish_panel(axes, '', 'height of $Z$ over $b$', 'amplitude of $X$ over $b$')
    save(figure, arguments.out / 'invariant_manifold.png')


if __name__ == '__main__':
    main()
