"""
What the laws share: the damper as the controller knows it, and the search for m.

A gap that suits the amplitude is many times as wide as that amplitude. m crosses it only in the
rhythm of its impacts; at rest, or held by friction, it would never find a stop. So a stop that has
not been hit for some half cycles comes to where m turns round.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, pi
from typing import NamedTuple

from impact_damper_ros.rig import RigParameters

from .sensors import Measurement, Observer

__all__ = ['Damper', 'Search', 'damper_of']


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


#: Half cycles without an impact on a stop that are none too many.
_PATIENCE = 2
_REACH = 0.9


@dataclass(slots=True)
class Search:
    """
    What is remembered of m; every field goes through JSON.

    Attributes
    ----------
    missed : list of int
        Half cycles since the last impact on stop 1 and on stop 2.
    reach : list of float
        How far outwards m has been seen on each side since it could last have hit there, m.
    """

    missed: list[int] = field(default_factory=lambda: [0, 0])
    reach: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def see(self, sample: Measurement) -> None:
        """Take a sample."""
        self.reach[0] = max(self.reach[0], sample.y)
        self.reach[1] = max(self.reach[1], -sample.y)

    def cross(self, observer: Observer) -> None:
        """Take the end of a half cycle."""
        for i, hit in enumerate((observer.hit_1, observer.hit_2)):
            self.missed[i] = 0 if hit else self.missed[i] + 1

    def begin(self, rising: bool) -> None:
        """Begin another half cycle, at its passage of X through zero."""
        # m meets stop 1 about where X falls through zero, and stop 2 about where it rises.
        self.reach[0 if rising else 1] = 0.0

    def limit(self, i: int) -> float:
        """Return how far out a stop (0 or 1) may be to be found by m, m."""
        return inf if self.missed[i] <= _PATIENCE else _REACH * self.reach[i]

    @property
    def common_limit(self) -> float:
        """How far out symmetric stops may be if neither is hit any more, m."""
        return max(self.limit(0), self.limit(1))
