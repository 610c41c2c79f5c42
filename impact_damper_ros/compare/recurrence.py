"""
After how many cycles of the force the impacts of a stretch repeat.

The distance of each impact from the one a period later is what a periodic motion drives to zero:
geometrically, until the whole nanoseconds of the stamps hide it. So a period is recognised by
distances that end there, or shrink on and on; not by a small distance alone, since a chaotic
motion returns close to itself now and then.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .result import Array

__all__ = ['MOST_CYCLES', 'SETTLED', 'ImpactTable', 'Recurrence', 'find_recurrence']


#: Longest period looked for, in cycles of the force.
MOST_CYCLES = 16
#: A motion nearer to its limit than this, relative to its size, is called settled.
SETTLED = 1e-3

# A stamp is rounded to the nanosecond; so are both of a difference.
_STAMP_S = 1.5e-9
_FLOORS = 10.0
_ROUND_OFF = 1e-12
# Farther apart than this, two impacts are not the same one a period later.
_SAME = 0.3
_APPROACHING = 0.3
_NEAR = 0.1
_FEW, _MANY = 6, 18
_SHRINKS = 0.7


@dataclass(frozen=True)
class ImpactTable:
    """
    Impacts of a stretch, scaled for comparison.

    Attributes
    ----------
    phase : ndarray of shape (n,)
        Instants in cycles of the force; from any zero.
    stop : ndarray of shape (n,)
        The stops.
    states : ndarray of shape (n, 3)
        X, X' after and Z' after, each relative to its size.
    floor : float
        What the rounding of stamps makes of a distance.
    length, speed : float
        The sizes, m and m/s.
    """

    phase: Array
    stop: Array
    states: Array
    floor: float
    length: float
    speed: float

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
        """Scale the impacts by the largest of their second half."""
        late = slice(len(time) // 2, None)
        length = float(np.abs(x[late]).max(initial=0.0)) or 1.0
        speeds = np.maximum(np.abs(velocity), np.abs(damper_velocity))
        speed = float(speeds[late].max(initial=0.0)) or 1.0
        states = np.column_stack([x / length, velocity / speed, damper_velocity / speed])
        return cls(time / cycle, stop, states, _STAMP_S / cycle + _ROUND_OFF, length, speed)

    def __len__(self) -> int:
        return len(self.phase)

    def distances(self, impacts: int, cycles: int) -> Array:
        """Return the distance of each impact from the one a period later (inf: another stop)."""
        late = np.abs(self.phase[impacts:] - self.phase[:-impacts] - cycles)
        moved = np.abs(self.states[impacts:] - self.states[:-impacts]).max(axis=1)
        far: Array = np.maximum(late, moved)
        far[self.stop[impacts:] != self.stop[:-impacts]] = np.inf
        return far


@dataclass(frozen=True)
class Recurrence:
    """
    A period of the impacts.

    Attributes
    ----------
    cycles, impacts : int
        Cycles of the force and impacts in a period.
    distance : ndarray of shape (p,)
        Largest distance of any impact from the one a period later, for each of the last periods
        that hit the same stops, the last one last.
    floor : float
        What the rounding of stamps makes of a distance.
    """

    cycles: int
    impacts: int
    distance: Array
    floor: float

    @property
    def level(self) -> float:
        """Distance of the last two periods."""
        return float(self.distance[-1])

    @property
    def at_floor(self) -> bool:
        """Whether the last periods are the same, as far as the stamps tell."""
        return self.level <= _FLOORS * self.floor

    @property
    def shrinks(self) -> bool:
        """Whether the distance shrinks on and on."""
        first, second, third = self._thirds()
        return second < _SHRINKS * first and third < _SHRINKS * second

    @property
    def grows(self) -> bool:
        """Whether the distance grows on and on: the run leaves a motion that is not stable."""
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
        """Factor by which the distance shrinks in a period, roughly; at most 0.999."""
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


def _period(table: ImpactTable, cycles: int) -> Recurrence | None:
    """Return the last periods of so many cycles, if there are at least two like each other."""
    phase = table.phase
    begin = phase[-1] - cycles
    before = int(np.abs(phase - begin).argmin())
    impacts = len(table) - 1 - before
    if impacts < 1 or len(table) < 2 * impacts or abs(phase[before] - begin) > _SAME:
        return None
    far = table.distances(impacts, cycles)
    unlike = np.flatnonzero(far > _SAME)
    like = far[unlike[-1] + 1 :] if len(unlike) else far
    count = len(like) // impacts
    if count < 1:
        return None
    distance = like[len(like) - count * impacts :].reshape(count, impacts).max(axis=1)
    return Recurrence(cycles, impacts, distance, table.floor)


def find_recurrence(table: ImpactTable, most_cycles: int = MOST_CYCLES) -> Recurrence | None:
    """Find the shortest period of the impacts at the end of a stretch."""
    if len(table) < 3:
        return None
    last = table.phase[-1] - table.phase[0]
    close: Recurrence | None = None
    for cycles in range(1, most_cycles + 1):
        if 2 * cycles > last + 0.5:
            break
        period = _period(table, cycles)
        if period is None or period.grows:
            continue
        if period.at_floor and _kept(period):
            return period
        if period.shrinks and _approaches(period):
            return period
        steady = period.distance[-4:]
        if close is None and len(steady) == 4 and steady.max() < SETTLED:
            close = period
    return close


def _approaches(period: Recurrence) -> bool:
    """Return whether a shrinking sequence of distances is one that leads to a periodic motion."""
    count = len(period.distance)
    recent = float(period.distance[-6:].max())
    return (count >= _MANY and recent < _NEAR) or (
        count >= _FEW and period.remaining < _APPROACHING
    )


def _kept(period: Recurrence) -> bool:
    """Return whether two periods before the last one were the same, too, or nearly."""
    return len(period.distance) >= 2 and float(period.distance[-2:].max()) < SETTLED
