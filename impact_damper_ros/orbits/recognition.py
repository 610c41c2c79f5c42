"""
Recognition of periodic motion, from impacts and from states once in a cycle of the force.

Impacts repeat if each is at a small distance from the one a period later. Three criteria use these
distances: `repeated_impacts` for exact motion, `rhythm_of` for a running rig, and
`find_recurrence` for recordings. In a recording the distance shrinks geometrically until the whole
nanoseconds of the stamps hide it, so that a period is recognised by distances that end there or go
on shrinking; a small distance alone is not enough, since a chaotic motion returns close to itself
now and then.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.rig import Event

from .recurrence import LONGEST_PERIOD, MotionKind

Array = NDArray[np.float64]

__all__ = ['LONGEST_PERIOD', 'MotionKind']

#: Longest period that is recognised in a running rig, in cycles of the force.
LONGEST_RHYTHM = 8
#: A recorded motion nearer to its limit than this, relative to its size, is called settled.
SETTLED = 1e-3
#: Two periods of a running rig that differ by less, in cycles of the force and relative to the
#: largest |X|, are a rhythm, and a settled one if they differ by less than `SETTLED_DRIFT`.
RECOGNISED = 1e-2
SETTLED_DRIFT = 1e-4

# A period of 2 k cycles counts only if it repeats this much better than one of k: near a period
# doubling, k cycles repeat badly on the way to a motion that repeats after k.
_BETTER = 1e-2
_DRIFT_ROUND_OFF = 1e-9
# A stamp is rounded to the nanosecond; so are both of a difference.
_STAMP_S = 1.5e-9
_FLOORS = 10.0
_ROUND_OFF = 1e-12
# Largest distance of an impact from the corresponding one a period later.
_SAME = 0.3
_APPROACHING = 0.3
_NEAR = 0.1
_FEW, _MANY = 6, 18
_SHRINKS = 0.7


@dataclass(frozen=True)
class ImpactTable:
    """Impacts in a row, for comparison with those a period later."""

    phase: Array  # instants in cycles of the force, from any zero, shape (n,)
    stop: NDArray[Any]  # shape (n,)
    states: Array  # further quantities compared, such as X, X' after and Z' after, shape (n, m)
    scale: float = 1.0  # what differences of states are divided by
    floor: float = 0.0  # distance that the rounding of stamps alone makes
    #: What displacements (m) and velocities (m/s) have been divided by in `states`.
    length: float = 1.0
    speed: float = 1.0

    @classmethod
    def of(
        cls,
        time: Array,
        stop: Array,
        x: Array,
        velocity: Array,
        damper_velocity: Array,
        cycle: float,
    ) -> ImpactTable:
        """Return recorded impacts, scaled by the largest of their second half."""
        late = slice(len(time) // 2, None)
        length = float(np.abs(x[late]).max(initial=0.0)) or 1.0
        speeds = np.maximum(np.abs(velocity), np.abs(damper_velocity))
        speed = float(speeds[late].max(initial=0.0)) or 1.0
        states = np.column_stack([x / length, velocity / speed, damper_velocity / speed])
        floor = _STAMP_S / cycle + _ROUND_OFF
        return cls(time / cycle, stop, states, 1.0, floor, length, speed)

    @classmethod
    def of_x(
        cls, phase: Sequence[float], stop: Sequence[int], x: Sequence[float], scale: float
    ) -> ImpactTable:
        """Return impacts whose instants (cycles) and X (over a scale) are compared."""
        states = np.array(x, float).reshape(-1, 1)
        return cls(np.array(phase, float), np.array(stop, int), states, scale)

    def __len__(self) -> int:
        return len(self.phase)

    def impacts_in(self, cycles: int) -> int:
        """Return how many impacts before the last one the nearest to a period before it is."""
        begin = self.phase[-1] - cycles
        return len(self) - 1 - int(np.abs(self.phase - begin).argmin())

    def distances(self, impacts: int, cycles: int) -> Array:
        """Return the distance of each impact from the one a period later (inf: another stop)."""
        late = np.abs(self.phase[impacts:] - self.phase[:-impacts] - cycles)
        moved = (np.abs(self.states[impacts:] - self.states[:-impacts]) / self.scale).max(axis=1)
        far: Array = np.maximum(late, moved)
        far[self.stop[impacts:] != self.stop[:-impacts]] = np.inf
        return far


def section_distance(section: Array, period: int, count: int, size: ArrayLike = 1.0) -> float:
    """
    Return the largest distance of the last `count` states from those a period before.

    The section (n, m) holds one state in each cycle; differences are divided by `size`.
    """
    late, early = section[-count:], section[-count - period : -period]
    return float((np.abs(late - early) / size).max())


@dataclass(frozen=True)
class Recurrence:
    """A period of the impacts."""

    #: Cycles of the force and impacts in a period.
    cycles: int
    impacts: int
    #: Largest distance of any impact from the one a period later, for each of the last periods
    #: that hit the same stops, the last one last, shape (p,).
    distance: Array
    floor: float  # distance that the rounding of stamps alone makes

    @property
    def level(self) -> float:
        """Distance of the last two periods."""
        return float(self.distance[-1])

    @property
    def at_floor(self) -> bool:
        """Whether the last periods are the same to within the rounding of stamps."""
        return self.level <= _FLOORS * self.floor

    @property
    def shrinks(self) -> bool:
        """Whether the distance keeps shrinking."""
        first, second, third = self._thirds()
        return second < _SHRINKS * first and third < _SHRINKS * second

    @property
    def grows(self) -> bool:
        """Whether the distance keeps growing: the run leaves an unstable motion."""
        first, second, third = self._thirds()
        return (
            first < _SHRINKS * second
            and second < _SHRINKS * third
            and third > _FLOORS * self.floor
        )

    def _thirds(self) -> tuple[float, float, float]:
        """Return the largest distance in each third of the periods."""
        if len(self.distance) < 3:
            return np.nan, np.nan, np.nan
        first, second, third = (float(part.max()) for part in np.array_split(self.distance, 3))
        return first, second, third

    @property
    def factor(self) -> float:
        """Factor by which the distance shrinks in a period, estimated; at most 0.999."""
        floor = _FLOORS * self.floor
        distance = self.distance[len(self.distance) // 3 :]
        above = np.flatnonzero(distance > floor)
        if len(above) < 3:
            return 0.0 if self.at_floor else 0.999
        slope = np.polyfit(above, np.log(distance[above]), 1)[0]
        return float(min(np.exp(slope), 0.999))

    @property
    def remaining(self) -> float:
        """Bound of the distance of the last period from the limit of a shrinking sequence."""
        recent = float(self.distance[-6:].max())
        return recent / (1.0 - self.factor)


def _recurrence(table: ImpactTable, cycles: int) -> Recurrence | None:
    """Return the last periods of that many cycles, if at least two of them agree."""
    impacts = table.impacts_in(cycles)
    late = abs(table.phase[-1 - impacts] - (table.phase[-1] - cycles))
    if impacts < 1 or len(table) < 2 * impacts or late > _SAME:
        return None
    far = table.distances(impacts, cycles)
    unlike = np.flatnonzero(far > _SAME)
    like = far[unlike[-1] + 1 :] if len(unlike) else far
    count = len(like) // impacts
    if count < 1:
        return None
    distance = like[len(like) - count * impacts :].reshape(count, impacts).max(axis=1)
    return Recurrence(cycles, impacts, distance, table.floor)


def find_recurrence(table: ImpactTable, most_cycles: int = LONGEST_PERIOD) -> Recurrence | None:
    """
    Find the shortest period of the impacts at the end of a recorded stretch.

    A period that the motion has settled to within the rounding of stamps, or approaches; else
    the shortest one that the last periods nearly have; None if there is none.
    """
    if len(table) < 3:
        return None
    last = table.phase[-1] - table.phase[0]
    close: Recurrence | None = None
    for cycles in range(1, most_cycles + 1):
        if 2 * cycles > last + 0.5:
            break
        period = _recurrence(table, cycles)
        if period is None or period.grows:
            continue
        if period.at_floor and _kept(period):
            return period
        if period.shrinks and _converges(period):
            return period
        steady = period.distance[-4:]
        if close is None and len(steady) == 4 and steady.max() < SETTLED:
            close = period
    return close


def _converges(period: Recurrence) -> bool:
    """Return whether a shrinking sequence of distances is one that leads to a periodic motion."""
    count = len(period.distance)
    recent = float(period.distance[-6:].max())
    return (count >= _MANY and recent < _NEAR) or (
        count >= _FEW and period.remaining < _APPROACHING
    )


def _kept(period: Recurrence) -> bool:
    """Return whether the two periods before the last one agree nearly."""
    return len(period.distance) >= 2 and float(period.distance[-2:].max()) < SETTLED


class Apart(NamedTuple):
    """Distance of two rhythms with the same stops and period."""

    phase: float  # largest difference of the instants of the impacts, in cycles of the force
    x: float  # largest difference of X at the impacts, relative to the largest |X|


class _Counted(Protocol):
    """A periodic motion as a sequence of impacts, such as a `PeriodicOrbit`."""

    @property
    def stops(self) -> tuple[int, ...]: ...
    @property
    def cycles(self) -> int: ...
    @property
    def phases(self) -> tuple[float, ...]: ...
    @property
    def x(self) -> tuple[float, ...]: ...
    @property
    def x_max(self) -> float: ...


@dataclass(frozen=True)
class Rhythm:
    """A repeating sequence of impacts."""

    stops: tuple[int, ...]  # stops hit in one period, in order
    cycles: int  # the period k, in cycles of the force
    #: Instants of the impacts in cycles of the force since its zero angle; the first is in [0,
    #: 1), all are in [0, k).
    phases: tuple[float, ...]
    x: tuple[float, ...]  # X at each impact, m
    x_max: float  # largest |X|, m: the scale of differences of X
    #: Largest difference between the last period and the one before, in cycles of the force and
    #: relative to the largest |X|; 0 for a motion of the theory.
    drift: float = 0.0
    #: The drift over that of the period before: the factor by which the distance from the
    #: periodic motion shrinks in a period. NaN where round-off hides it.
    decay: float = math.nan
    first: int = 0  # index of the first of these impacts in the run

    @classmethod
    def of(cls, orbit: _Counted) -> Self:
        """Return the rhythm of a periodic motion of the theory."""
        return cls(orbit.stops, orbit.cycles, orbit.phases, orbit.x, orbit.x_max)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """Read what `as_dict` returns, or other entries of the same names."""
        return cls(
            tuple(stored['stops']),
            stored['cycles'],
            tuple(stored['phases']),
            tuple(stored['x']),
            stored['x_max'],
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the rhythm for JSON, without drift and decay."""
        return {
            'stops': list(self.stops),
            'cycles': self.cycles,
            'phases': list(self.phases),
            'x': list(self.x),
            'x_max': self.x_max,
        }

    @property
    def impacts(self) -> int:
        """Number N of impacts in a period."""
        return len(self.stops)

    @property
    def settled(self) -> bool:
        """Whether the last two periods are nearly the same."""
        return self.drift < SETTLED_DRIFT

    def turns(self) -> Iterator[Self]:
        """Yield the same rhythm beginning at each of its impacts."""
        for i in range(self.impacts):
            whole = math.floor(self.phases[i])
            phases = self.phases[i:] + self.phases[:i]
            yield replace(
                self,
                stops=self.stops[i:] + self.stops[:i],
                phases=tuple((phase - whole) % self.cycles for phase in phases),
                x=self.x[i:] + self.x[:i],
                first=self.first + i,
            )

    def turned_to(self, other: Rhythm) -> tuple[Self, Apart] | None:
        """
        Return this rhythm beginning at the same impact as another one, and their distance.

        Of several impacts that match the stops, the one with the least distance; None if stops or
        period differ.
        """
        if self.cycles != other.cycles or self.impacts != other.impacts:
            return None
        found = [(turn, _apart(turn, other)) for turn in self.turns() if turn.stops == other.stops]
        return min(found, key=lambda pair: max(pair[1]), default=None)


def _apart(one: Rhythm, other: Rhythm) -> Apart:
    size = max(one.x_max, other.x_max) or 1.0
    # Whole cycles before the first impact do not matter: a motion that repeats after k cycles
    # may begin in any of them.
    first = one.phases[0] - other.phases[0]
    whole = round(first)
    phases = [abs(first - whole)]
    for a, b in zip(one.phases[1:], other.phases[1:], strict=True):
        late = a - b - whole
        phases.append(abs(late - one.cycles * round(late / one.cycles)))
    return Apart(max(phases), max(abs(a - b) for a, b in zip(one.x, other.x, strict=True)) / size)


def last_period(stops: Sequence[int] | NDArray[Any], count: int) -> int:
    """
    Return the index at which the last whole period, of `count` impacts, begins.

    On stop 1 after stop 2, if there is such an impact in the last two periods.
    """
    total = len(stops)
    for i in range(total - count, max(total - 2 * count, 0), -1):
        if stops[i] == 1 and stops[i - 1] == 2:
            return i
    return total - count


def rhythm_of(
    instants: Sequence[float],
    stops: Sequence[int],
    x: Sequence[float],
    x_max: float,
    *,
    most_cycles: int = LONGEST_RHYTHM,
) -> Rhythm | None:
    """
    Recognise a rhythm at the end of a run that continues.

    Given are the instants of all impacts in a row, in cycles of the force since its zero angle,
    the stops and X of each, and the largest |X|, m. Returned is the shortest period that has
    settled; else the shortest one of which the last three differ by less than `RECOGNISED`. It
    begins on stop 1 after stop 2, if there is such a place, and is one of the last two periods.

    >>> rhythm_of([0.2, 0.7, 1.2, 1.7, 2.2, 2.7], [1, 2] * 3, [1.0, -1.0] * 3, 2.0).phases
    (0.2, 0.7)
    """
    total = len(instants)
    if not total:
        return None
    table = ImpactTable.of_x(instants, stops, x, x_max or 1.0)
    best: tuple[int, int, float, float] | None = None
    drifts: dict[int, float] = {}
    for cycles in range(1, most_cycles + 1):
        count = table.impacts_in(cycles)
        if 3 * count > total:
            break
        if not count:
            continue
        distances = table.distances(count, cycles)
        drift = float(distances[-count:].max())
        earlier = float(distances[-2 * count : -count].max())
        if max(drift, earlier) > RECOGNISED:
            continue
        parts = [drifts[k] for k in drifts if cycles % k == 0]
        drifts[cycles] = drift
        if parts and drift > _BETTER * min(parts):
            continue
        decay = drift / earlier if earlier > _DRIFT_ROUND_OFF else math.nan
        if best is None or drift < SETTLED_DRIFT:
            best = (cycles, count, drift, decay)
        if drift < SETTLED_DRIFT:
            break
    if best is None:
        return None
    cycles, count, drift, decay = best
    first = last_period(stops, count)
    whole = math.floor(instants[first])
    chosen = range(first, first + count)
    return Rhythm(
        tuple(stops[i] for i in chosen),
        cycles,
        tuple((instants[i] - whole) % cycles for i in chosen),
        tuple(x[i] for i in chosen),
        x_max,
        drift,
        decay,
        first,
    )


def repeated_impacts(
    impacts: Sequence[Event], cycle: float, most_cycles: int = 8, tolerance: float = 1e-10
) -> tuple[list[Event], int] | None:
    """
    Recognise an exactly periodic motion at the end of a run.

    Three periods must agree to the tolerance, relative to the cycle (s) and the largest |X| at
    an impact. Returns the impacts of one of the last two periods, beginning on stop 1 after
    stop 2 if there is such a place, and the period in cycles; None if the run does not repeat.
    """
    if not impacts:
        return None
    size = max(abs(event.x) for event in impacts)
    stops = [event.stop for event in impacts]
    instants = [event.time / cycle for event in impacts]
    table = ImpactTable.of_x(instants, stops, [event.x for event in impacts], size or 1.0)
    for cycles in range(1, most_cycles + 1):
        count = table.impacts_in(cycles)
        if count == 0 or len(impacts) < 3 * count:
            continue
        if table.distances(count, cycles)[-2 * count :].max() < tolerance:
            first = last_period(stops, count)
            return list(impacts[first : first + count]), cycles
    return None


def turned_cycles(snapshot: Mapping[str, Any], frequency: float) -> float:
    """
    Return the angle of the force's first harmonic at a rig's snapshot, in cycles.

    The frequency (rad/s) is the one that this harmonic has there.
    """
    origin = snapshot['origin']
    since = float(snapshot['time']) - float(origin['time'])
    return (float(origin['angles'][0]) + frequency * since) / math.tau
