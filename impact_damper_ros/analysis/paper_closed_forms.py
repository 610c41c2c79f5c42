"""
Older results that the general theory must contain.

The symmetric motion with two impacts per cycle of a horizontal, frictionless damper (Masri and
Caughey 1966) and the ball on a table too heavy to notice it (see Bapat, Sankar and Popplewell
1986). Both are derived here by hand, apart from the solver.
"""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.orbits.floquet import flight_matrix
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.mode import make_machine

from .paper_rigs import VERTICAL

__all__ = ['heavy_table_range', 'symmetric_displacements', 'vertical_range']


def symmetric_displacements(rig: RigParameters) -> tuple[float, ...]:
    """
    Return X at stop 1 of the symmetric motions, from a quadratic.

    Parameters
    ----------
    rig : RigParameters
        Horizontal and without friction and air, both restitutions equal.

    Notes
    -----
    m crosses with the speed v = (2 X + d) Omega/pi, so momentum and restitution give M's speeds
    -v (1 - R + 2 mu)/(1 + R) before and -v (1 - R - 2 mu R)/(1 + R) after stop 1. Half a cycle
    later M must be at the mirror image. All is linear in v but A^2, the sum of two squares.
    """
    mu, restitution = rig.mass_ratio, rig.restitution_1
    rate = rig.force_frequencies[0]
    half = math.pi / rate
    phi = flight_matrix(make_machine(rig).free, half)[:2, :2]
    k = (1.0 + phi[0, 0]) / phi[0, 1]
    after = -(1.0 - restitution - 2.0 * mu * restitution) / (1.0 + restitution)
    # Free part of X over v; then X - free = A sin, and its rate over Omega = A cos
    free = 2.0 * mu / (phi[1, 0] - k * (1.0 + phi[1, 1]))
    cosine = (after + k * free) / rate
    sine = np.array([0.5 * half - free, -0.5 * rig.gap])
    roots = np.roots(
        [
            sine[0] ** 2 + cosine**2,
            2.0 * sine[0] * sine[1],
            sine[1] ** 2 - rig.response_amplitude**2,
        ]
    )
    real = sorted(float(v.real) for v in roots if abs(v.imag) < 1e-12 * abs(v) and v.real > 0.0)
    return tuple(0.5 * (v * half - rig.gap) for v in real)


def heavy_table_range(restitution: float) -> tuple[float, float]:
    """Return the ends of the stable range of A Omega^2/g, one impact per cycle, m much lighter."""
    low = math.pi * (1.0 - restitution) / (1.0 + restitution)
    rise = 2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2
    return low, math.hypot(low, rise)


def _has_stable(intensity: float) -> bool:
    rate = VERTICAL.force_frequencies[0]
    gravity = VERTICAL.response_amplitude * rate**2 / intensity
    found = find_orbits(VERTICAL.replace(gravity=gravity), (1,), simulate=False)
    return any(orbit.stable and orbit.viable for orbit in found.orbits)


def vertical_range(inside: float = 0.8, steps: int = 40) -> tuple[float, float]:
    """
    Return the ends of the stable range of A Omega^2/g of the paper's vertical one-sided rig.

    Parameters
    ----------
    inside : float, optional
        A value within the range.
    steps : int, optional
        Bisections of each end.
    """

    def edge(good: float, bad: float) -> float:
        for _ in range(steps):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if _has_stable(middle) else (good, middle)
        return good

    return edge(inside, 0.1), edge(inside, 3.0)
