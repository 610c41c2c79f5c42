"""The damper as the controller knows it: mass ratio and restitution, nothing of the structure."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

from impact_damper_ros.rig import RigParameters

__all__ = ['Damper', 'damper_of']


class Damper(NamedTuple):
    """
    What the laws may know beforehand.

    Attributes
    ----------
    mass_ratio : float
        mu = m/M.
    restitution : float
        Mean R of both stops.
    """

    mass_ratio: float
    restitution: float

    @property
    def rebound(self) -> float:
        """Jump in Z' by an impact, over the approach speed."""
        return (1.0 + self.restitution) / (1.0 + self.mass_ratio)

    @property
    def push(self) -> float:
        """Jump in X' by an impact, over the approach speed."""
        return self.mass_ratio * self.rebound

    def optimal_gap(self, amplitude: float, largest: float) -> float:
        """
        Return the gap d* at which two impacts per cycle are at X = 0, where |X'| is largest.

        Parameters
        ----------
        amplitude : float
            Amplitude of X, m.
        largest : float
            What to return where there is no such gap, as for elastic stops.

        Notes
        -----
        From equal flights between X = 0 and X = 0 without friction and weight, and momentum and
        restitution at each impact: d* = pi A (1 + R)/((1 - R)(1 + mu)).
        """
        loss = (1.0 - self.restitution) * (1.0 + self.mass_ratio)
        travel = pi * amplitude * (1.0 + self.restitution)
        return travel / loss if travel < largest * loss else largest


def damper_of(rig: RigParameters) -> Damper:
    """Return the damper of a rig."""
    return Damper(rig.mass_ratio, 0.5 * (rig.restitution_1 + rig.restitution_2))
