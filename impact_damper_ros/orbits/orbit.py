# SPDX-License-Identifier: Apache-2.0
"""A periodic motion of the rig, with its stability and viability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .arguments import mirrored_stops, single_harmonic

#: A multiplier whose modulus is nearer to 1 is on the unit circle: a double multiplier has half of
#: the digits only.
NEUTRAL = 1e-6

#: Most stops that are named in a line.
_SHOWN = 12

#: Fields of a motion with an entry for each impact, without the stop and the phase.
AT_IMPACTS = (
    'x',
    'primary_velocity_before',
    'primary_velocity_after',
    'damper_velocity_before',
    'damper_velocity_after',
)


def stability_of(modulus: float) -> str:
    """Return whether a motion is stable, neutral or unstable, by its largest multiplier."""
    if modulus < 1.0 - NEUTRAL:
        return 'stable'
    return 'neutral' if modulus <= 1.0 + NEUTRAL else 'unstable'


class OrbitEvent(NamedTuple):
    """
    An event of a periodic motion that is not an impact.

    Attributes
    ----------
    kind : EventKind
        Reversal, stick, release or rest.
    stop : int
        The stop concerned, or 0.
    phase : float
        Instant of the event, counted as the phases of the impacts.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits
    >>> rig = RigParameters(
    ...     gravity=1.0, friction=0.3, angle=0.3, gap=16.0, force_frequencies=1.02
    ... )
    >>> reversal = find_orbits(rig, (1, 1, 2))[0].events[0]
    >>> reversal.kind.name, reversal.stop, round(reversal.phase, 6)
    ('REVERSAL', 0, 0.766202)
    """

    kind: EventKind
    stop: int
    phase: float


class Apart(NamedTuple):
    """Distance of two periodic motions with the same stops and period."""

    phase: float  # largest difference of the instants of the impacts, in cycles of the force
    x: float  # largest difference of X at the impacts, relative to the largest |X|


@dataclass(frozen=True)
class Rhythm:
    """
    A repeated sequence of impacts, of a measured or a predicted periodic motion.

    Attributes
    ----------
    stops : tuple of int
        The stop hit at each impact, 1 (lower) or 2.
    cycles : int
        Period k in cycles of the first harmonic of the force.
    phases : tuple of float
        Instants of the impacts in cycles of the force F sin(Omega t + phi), from t = 0. The
        first is in [0, 1), all are in [0, k).
    x : tuple of float
        Displacement of M at each impact, m.
    x_max : float
        Largest |X| over the period, m: the scale of differences of X.

    Examples
    --------
    >>> from impact_damper_ros import find_orbits
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> orbit.begun_at(1).stops, orbit.distance(orbit.begun_at(1)) < 1e-9
    ((2, 1), True)
    """

    stops: tuple[int, ...]
    cycles: int
    phases: tuple[float, ...]
    x: tuple[float, ...]
    x_max: float

    @classmethod
    def of_impacts(
        cls,
        cycles: int,
        stops: Sequence[int],
        phases: Sequence[float],
        x: Sequence[float],
        x_max: float,
    ) -> Self:
        """
        Return the rhythm of the impacts in a period, their phases from any whole cycle on.

        The rhythm begins on stop 1 after stop 2, if there is such an impact.
        """
        whole = math.floor(phases[0])
        inside = tuple((phase - whole) % cycles for phase in phases)
        rhythm = cls(tuple(stops), cycles, inside, tuple(x), x_max)
        turns = (i for i, stop in enumerate(stops) if stop == 1 < stops[i - 1])
        return rhythm.begun_at(next(turns, 0))

    @property
    def impacts(self) -> int:
        """Number N of impacts in a period."""
        return len(self.stops)

    def begun_at(self, impact: int) -> Self:
        """Return the same motion beginning at another of its impacts, given by index."""
        if impact == 0 and not self._cycles_before(0):
            return self
        names = [name for name in ('stops', *AT_IMPACTS) if hasattr(self, name)]
        turned = {n: getattr(self, n)[impact:] + getattr(self, n)[:impact] for n in names}
        return replace(self, phases=self.phases_from(impact), **turned)

    def phases_from(self, impact: int) -> tuple[float, ...]:
        """Return the phases of the same motion beginning at another of its impacts."""
        whole = self._cycles_before(impact)
        late = self.phases[impact:] + self.phases[:impact]
        return tuple((phase - whole) % self.cycles for phase in late)

    def _cycles_before(self, impact: int) -> int:
        """Return the whole cycles before an impact, which are left out."""
        return math.floor(self.phases[impact])

    def shifts(self, stops: tuple[int, ...]) -> list[int]:
        """Return the impacts, by index, from which it has a sequence of stops."""
        return [i for i in range(self.impacts) if self.stops[i:] + self.stops[:i] == stops]

    def _apart(self, shift: int, other: Rhythm) -> Apart:
        """Return the distance from another motion, if this one begins at one of its impacts."""
        size = max(self.x_max, other.x_max) or 1.0
        phases, x = self.phases_from(shift), self.x[shift:] + self.x[:shift]
        # A motion that repeats after k cycles may begin in any of them.
        first = phases[0] - other.phases[0]
        whole = round(first)
        differ = [abs(first - whole)]
        for a, b in zip(phases[1:], other.phases[1:], strict=True):
            late = a - b - whole
            differ.append(abs(late - self.cycles * round(late / self.cycles)))
        away = max(abs(a - b) for a, b in zip(x, other.x, strict=True))
        return Apart(max(differ), away / size)

    def nearest_turn(self, other: Rhythm) -> tuple[Self, Apart] | None:
        """
        Return this motion from the impact that matches another motion best, and the distance.

        The impact is that with the least distance; None if stops or period differ.
        """
        if self.cycles != other.cycles:
            return None
        shifts = self.shifts(other.stops)
        if not shifts:
            return None
        nearest = min(shifts, key=lambda shift: max(self._apart(shift, other)))
        return self.begun_at(nearest), self._apart(nearest, other)

    def distance(self, other: Rhythm) -> float:
        """
        Return the distance of two motions, whatever impact each is counted from.

        The distance is the largest difference of the instants of the impacts, in cycles of the
        force, and of X there, relative to the largest |X|; infinite if stops or period differ.
        Whole cycles before the first impact do not matter.
        """
        shifts = self.shifts(other.stops) if self.cycles == other.cycles else []
        return min((max(self._apart(shift, other)) for shift in shifts), default=math.inf)

    def repeats(self, tolerance: float) -> bool:
        """Return whether the motion repeats within its period, to a relative tolerance."""
        later = self.shifts(self.stops)[1:]
        return any(max(self._apart(shift, self)) < tolerance for shift in later)


@dataclass(frozen=True, kw_only=True)
class PeriodicOrbit(Rhythm):
    """
    A periodic motion: N impacts in k cycles of the force.

    Attributes
    ----------
    stops, cycles, phases, x, x_max
        As in `Rhythm`. Under several harmonics the first phase may be any in [0, k).
    parameters : RigParameters
        The rig.
    primary_velocity_before, primary_velocity_after : tuple of float
        Velocity of M just before and just after each impact, m/s.
    damper_velocity_before, damper_velocity_after : tuple of float
        Absolute velocity of m just before and just after each impact, m/s.
    multipliers : tuple of complex
        Stability multipliers, largest modulus first. There are four; a phase of sticking or rest
        makes some of them zero.
    viable : bool
        Whether the rig can perform the motion: m stays between the stops, hits them from within at
        these instants only, and friction is as assumed.
    reason : str
        Why the motion is not viable; empty if it is.
    residual : float
        Largest residual of the equations, relative to the displacements.
    residual_history : tuple of float
        The residual before each Newton step and at the end.
    events : tuple of OrbitEvent
        Reversals, sticking and rest within the period; empty where friction keeps its sign from
        impact to impact.

    Examples
    --------
    >>> from impact_damper_ros import find_orbits
    >>> orbit = find_orbits(RigParameters(gravity=0.0), (1, 2))[0]
    >>> [round(phase, 6) for phase in orbit.phases], round(orbit.x[0], 4)
    ([0.733784, 0.233784], 9.9294)
    >>> orbit.stability, round(abs(orbit.multipliers[0]), 4)
    ('stable', 0.9495)
    """

    parameters: RigParameters
    primary_velocity_before: tuple[float, ...]
    primary_velocity_after: tuple[float, ...]
    damper_velocity_before: tuple[float, ...]
    damper_velocity_after: tuple[float, ...]
    multipliers: tuple[complex, ...]
    viable: bool
    reason: str
    residual: float
    residual_history: tuple[float, ...]
    events: tuple[OrbitEvent, ...] = ()

    def __repr__(self) -> str:
        """Return the motion in a line."""
        stops = ','.join(map(str, self.stops[:_SHOWN])) + ',...' * (self.impacts > _SHOWN)
        viable = 'viable' if self.viable else f'not viable: {self.reason}'
        return (
            f'<PeriodicOrbit: stops {stops} in {plural(self.cycles, "cycle")}, '
            f'{self.stability}, {viable}; largest |X| {self.x_max:.6g} m>'
        )

    @property
    def stability(self) -> str:
        """Stable, neutral or unstable, as a word."""
        return stability_of(abs(self.multipliers[0]))

    @property
    def stable(self) -> bool:
        """Whether all multipliers are inside the unit circle: small deviations die out."""
        return self.stability == 'stable'

    @property
    def neutral(self) -> bool:
        """Whether the largest multiplier has modulus 1: without losses deviations remain."""
        return self.stability == 'neutral'

    @property
    def unstable(self) -> bool:
        """Whether the largest multiplier is outside the unit circle: small deviations grow."""
        return self.stability == 'unstable'

    @property
    def cycle(self) -> float:
        """Period of the force, s."""
        return math.tau / self.parameters.first_harmonic[1]

    @property
    def period(self) -> float:
        """Period of the motion, s."""
        return self.cycles * self.cycle

    @property
    def instants(self) -> tuple[float, ...]:
        """Instants of the impacts, s, rising from the first one within one period."""
        first = self.phases[0]
        return tuple(self.cycle * (first + (phase - first) % self.cycles) for phase in self.phases)

    @property
    def durations(self) -> tuple[float, ...]:
        """Durations from each impact to the next, s."""
        instants = self.instants
        later = (*instants[1:], instants[0] + self.period)
        return tuple(b - a for a, b in zip(instants, later, strict=True))

    @property
    def x_max_ratio(self) -> float:
        """Largest |X| over the amplitude A without impacts; NaN where A is not defined."""
        return self.parameters.x_max_ratio(self.x_max)

    def begun_at(self, impact: int) -> Self:
        """Return the same motion beginning at another of its impacts, given by index."""
        whole = self._cycles_before(impact)
        if impact == 0 and not whole:
            return self
        events = (e._replace(phase=(e.phase - whole) % self.cycles) for e in self.events)
        return replace(super().begun_at(impact), events=tuple(events))

    def _cycles_before(self, impact: int) -> int:
        whole = super()._cycles_before(impact)
        return whole if whole and single_harmonic(self.parameters) else 0

    def mirror_image(self) -> Self:
        """Return the mirror image of a motion of a symmetric rig, half a cycle later."""
        turned: dict[str, Any] = {
            name: tuple(-value for value in getattr(self, name)) for name in AT_IMPACTS
        }
        late = (
            e._replace(stop=3 - e.stop if e.stop else 0, phase=(e.phase + 0.5) % self.cycles)
            for e in self.events
        )
        image = replace(
            self,
            stops=mirrored_stops(self.stops),
            phases=tuple((phase + 0.5) % self.cycles for phase in self.phases),
            events=tuple(late),
            **turned,
        )
        return image.begun_at(0)

    def as_dict(self) -> dict[str, Any]:
        """Return the orbit for JSON; multipliers as pairs of real and imaginary part."""
        left_out = ('parameters', 'events')
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in left_out}
        stored = {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
        stored['stable'], stored['neutral'] = self.stable, self.neutral
        stored['multipliers'] = [[m.real, m.imag] for m in self.multipliers]
        stored['nodes'] = [
            {'kind': event.kind.name.lower(), 'stop': event.stop, 'phase': event.phase}
            for event in self.events
        ]
        return stored
