"""The optimal gap against the angle of inclination: Figure 5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impact_damper_ros.orbits.optimum import OptimalGap, optimal_gap

from .paper_rigs import BASIC
from .paper_settled import SettledMotion, disturbed, settle

__all__ = ['OptimumPoint', 'figure_5_angles', 'optimum_at']

#: Gaps searched, m: all that have stable motion with two impacts per cycle at r = 1.
GAPS = (35.0, 62.0)
_POINTS = 16


@dataclass(frozen=True)
class OptimumPoint:
    """
    The optimum at one angle.

    Attributes
    ----------
    angle : float
        Inclination, degrees.
    best : OptimalGap
        The gap and what limits it.
    settled : SettledMotion
        What the simulator settles into there, started near the motion.
    """

    angle: float
    best: OptimalGap
    settled: SettledMotion


def figure_5_angles(*, quick: bool = False) -> tuple[float, ...]:
    """Return the angles of the figure, degrees."""
    if quick:
        return (0.0, 10.0, 45.0, 90.0)
    fine = np.arange(0.0, 20.0, 2.5)
    return tuple(float(angle) for angle in np.concatenate([fine, np.arange(20.0, 90.1, 5.0)]))


def optimum_at(angle: float) -> OptimumPoint:
    """
    Find the optimal gap at an angle; g = 9.81 and r = 1, no friction.

    Parameters
    ----------
    angle : float
        Inclination, degrees.
    """
    rig = BASIC.replace(angle=float(np.radians(angle)))
    best = optimal_gap(rig, gaps=GAPS, points=_POINTS, tolerance=1e-6)
    return OptimumPoint(angle, best, settle(disturbed(best.orbit, 1e-3), angle))
