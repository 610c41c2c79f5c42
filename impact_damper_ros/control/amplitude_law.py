"""
The amplitude law: at each passage of X through zero, places for both stops.

Symmetric stops reconstruct the law of Masri, Miller, Dehghanyar and Caughey (1989), in which the
amplitude of the primary mass sets the gap: d = kappa d*(A).

Independent stops are an extension. Each stop has a place of its own, which grows and shrinks with
the amplitude and is corrected by the instant at which m hit it: after an early impact the stop is
moved out by what m covers in that time, after a late one it is moved in. The two flights may then
differ, as weight and friction make them, and neither R nor mu has to be known.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from .law import Plant
from .sensors import LENGTH, Kinds, Measurement

#: A stop is not moved by less than this part of its place: each start costs energy.
_DEAD_BAND = 0.005


@dataclass(slots=True)
class AmplitudeLaw:
    """
    State of the law: what corrects the places of independent stops.

    Attributes
    ----------
    places : list of float
        Distance of stop 1 and of stop 2 from the middle, outwards, m; empty before the first.
    amplitude : float
        Amplitude at the last passage, m.
    """

    KINDS: ClassVar[Kinds] = {'places': LENGTH, 'amplitude': LENGTH}

    places: list[float] = field(default_factory=list)
    amplitude: float = 0.0

    def see(self, sample: Measurement, plant: Plant) -> None:
        """Do nothing between the passages of X through zero."""

    def cross(self, sample: Measurement, plant: Plant) -> None:
        """Move both stops to their places."""
        if plant.parameters.independent:
            self._correct(sample.time, plant)
            first, second = self.places
        else:
            first = second = plant.symmetric_place(plant.parameters.gap_control_gain)
        plant.move(sample.time, (first, -second), _DEAD_BAND)

    def _correct(self, time: float, plant: Plant) -> None:
        """Correct the distances of both stops from the middle."""
        observer, p = plant.observer, plant.parameters
        if not self.places:
            here = Measurement(*observer.last)
            self.places = [here.stop_1, -here.stop_2]
        growth = observer.amplitude / self.amplitude if self.amplitude > 0.0 else 1.0
        self.amplitude = observer.amplitude
        for i, hit in enumerate((observer.hit_1, observer.hit_2)):
            place = self.places[i]
            if hit:
                early = time - hit[0]
                if early > 0.5 * observer.half_cycle:
                    # It belongs to the passage before this one.
                    early -= observer.half_cycle
                early -= p.gap_control_lead * observer.half_cycle
                place += p.gap_control_timing_gain * hit[1] * early
            place = min(growth * place, plant.search.limit(i))
            self.places[i] = min(max(place, 0.5 * p.gap_min), 0.5 * p.gap_max)
