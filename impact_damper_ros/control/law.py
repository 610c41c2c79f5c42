"""What all laws share: the damper as they know it, the search for m, and how stops are moved."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, pi
from typing import ClassVar, NamedTuple, Protocol

from impact_damper_ros.rig import GapControlParameters, RigParameters

from .actuator import Actuators
from .sensors import LENGTH, Kinds, Measurement, Observer


class Damper(NamedTuple):
    """
    What the laws know of the damper.

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

        Where there is none, as for elastic stops, it is the largest gap.

        Notes
        -----
        From equal flights between impacts at X = 0 without friction and weight, and momentum and
        restitution at each impact: d* = pi A (1 + R)/((1 - R)(1 + mu)).
        """
        loss = (1.0 - self.restitution) * (1.0 + self.mass_ratio)
        travel = pi * amplitude * (1.0 + self.restitution)
        return travel / loss if travel < largest * loss else largest


def damper_of(rig: RigParameters) -> Damper:
    """Return the damper of a rig."""
    return Damper(rig.mass_ratio, 0.5 * (rig.restitution_1 + rig.restitution_2))


#: Half cycles without an impact on a stop before it is moved in.
_PATIENCE = 2
_REACH = 0.9


@dataclass(slots=True)
class Search:
    """
    Where m is to be found; every field goes through JSON.

    A gap that suits the amplitude is many times as wide as that amplitude. m crosses it only in
    the rhythm of its impacts; at rest, or held by friction, it would never reach a stop. A stop
    that has not been hit for some half cycles is therefore moved in to where m turns round.

    Attributes
    ----------
    missed : list of int
        Half cycles since the last impact on stop 1 and on stop 2.
    reach : list of float
        How far outwards m was sampled on each side since it could last have hit there, m.
    """

    KINDS: ClassVar[Kinds] = {'reach': LENGTH}

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
        """Return how far out a stop (0 or 1) may be for m to reach it, m."""
        return inf if self.missed[i] <= _PATIENCE else _REACH * self.reach[i]

    @property
    def common_limit(self) -> float:
        """How far out symmetric stops may be for m to reach them, m."""
        return max(self.limit(0), self.limit(1))


class Plant(NamedTuple):
    """
    What a law sees of the rig, and how it moves the stops.

    Attributes
    ----------
    observer, search : Observer, Search
        Estimates from the samples so far, the present one included.
    actuators : Actuators
        Actuators of the stops.
    damper : Damper
        The damper.
    parameters : GapControlParameters
        Parameters of the control.
    next_sample : float
        When the next sample on the grid is taken, s.
    """

    observer: Observer
    search: Search
    actuators: Actuators
    damper: Damper
    parameters: GapControlParameters
    next_sample: float

    def symmetric_place(self, share: float) -> float:
        """Return the place of symmetric stops: half a share of the optimal gap, m."""
        p = self.parameters
        optimal = self.damper.optimal_gap(self.observer.amplitude, p.gap_max)
        half = 0.5 * min(max(share * optimal, p.gap_min), p.gap_max)
        return max(min(half, self.search.common_limit), 0.5 * p.gap_min)

    def move(
        self, time: float, places: tuple[float | None, float | None], dead_band: float
    ) -> None:
        """Order stops to places, but none that is within the dead band of its place."""
        wanted = [
            place if place is not None and abs(place - before) > dead_band * abs(before) else None
            for place, before in zip(places, self.actuators.commanded, strict=True)
        ]
        if wanted != [None, None]:
            self.actuators.order(time, wanted[0], wanted[1], self.parameters)


class Law(Protocol):
    """State of a law that moves the stops; a dataclass, every field of which goes through JSON."""

    #: What its numbers are.
    KINDS: ClassVar[Kinds]

    def see(self, sample: Measurement, plant: Plant) -> None:
        """Act on a sample of the grid."""

    def cross(self, sample: Measurement, plant: Plant) -> None:
        """Act on a passage of X through zero, with the sample taken there."""
