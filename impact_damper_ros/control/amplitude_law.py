"""
The amplitude law: at each passage of X through zero, places for both stops.

Symmetric stops are the reconstruction of the law of Masri, Miller, Dehghanyar and Caughey (1989),
of which is known that the amplitude of the primary mass sets the gap: d = kappa d*(A).

Independent stops are an extension. Each stop has a place of its own, which grows and shrinks with
the amplitude, and is corrected by the time at which m was seen to hit it: early, and it is moved
out by what m covers in that time; late, and it is moved in. So the two flights need not be alike,
which weight and friction do not let them be, and neither R nor mu is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from impact_damper_ros.rig import GapControlParameters

from .law import Damper, Search
from .sensors import Measurement, Observer

__all__ = ['StopTiming', 'symmetric_gap']


def symmetric_gap(
    share: float, amplitude: float, damper: Damper, p: GapControlParameters
) -> float:
    """Return a share of the optimal gap of an amplitude, within the range of the actuators, m."""
    return min(max(share * damper.optimal_gap(amplitude, p.gap_max), p.gap_min), p.gap_max)


@dataclass(slots=True)
class StopTiming:
    """
    Places of independent stops, corrected by the instants of the impacts on them.

    Attributes
    ----------
    places : list of float
        Distance of stop 1 and of stop 2 from the middle, outwards, m; empty before the first.
    amplitude : float
        Amplitude at the last passage, m.
    """

    places: list[float] = field(default_factory=list)
    amplitude: float = 0.0

    def cross(
        self, time: float, observer: Observer, search: Search, p: GapControlParameters
    ) -> tuple[float, float]:
        """Return the distances of both stops from the middle after a zero crossing of X, m."""
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
            place = min(growth * place, search.limit(i))
            self.places[i] = min(max(place, 0.5 * p.gap_min), 0.5 * p.gap_max)
        return self.places[0], self.places[1]
