"""
The rhythm of a run: impacts that repeat, N of them in k cycles of the force.

Plain Python on purpose, and quick: the node looks for the rhythm of the running rig, next to its
engine. What a whole recorded stretch is, with the noise of its stamps, is told by `recurrence`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, Protocol, Self

__all__ = [
    'MOST_CYCLES',
    'RECOGNISED',
    'SETTLED',
    'Apart',
    'MotionKind',
    'Rhythm',
    'approaches',
    'period_distances',
    'rhythm_of',
    'turned_cycles',
]


class MotionKind(Enum):
    """What a motion is, as measured."""

    AT_REST = 'at rest'
    #: M moves, m hits no stop.
    NO_IMPACTS = 'without impacts'
    #: It comes to repeat, or to have no impacts.
    TRANSIENT = 'transient'
    PERIODIC = 'periodic'
    #: These two by the thresholds of `irregularity`.
    QUASI_PERIODIC = 'quasi-periodic'
    CHAOTIC = 'chaotic'
    #: What is known does not decide.
    UNDECIDED = 'undecided'
    #: Under a force, or a control, that never repeats.
    NOT_PERIODICALLY_DRIVEN = 'not periodically driven'


#: Longest period looked for, in cycles of the force.
MOST_CYCLES = 8
#: Two periods that differ by less, in cycles of the force and relative to the largest |X|, are a
#: rhythm; and by less than `SETTLED`, a settled one.
RECOGNISED = 1e-2
SETTLED = 1e-4

# A period of 2 k cycles is one only if it repeats this much better than one of k: near a period
# doubling, k cycles repeat badly on the way to a motion that repeats after k.
_BETTER = 1e-2
_ROUND_OFF = 1e-9
# Periods that are compared for an approach: so many, half of them at least, while so much alike.
_LOOKED_BACK, _FEW_PERIODS, _ALIKE = 18, 6, 0.1


class Apart(NamedTuple):
    """
    How far two rhythms with the same stops and period are apart.

    Attributes
    ----------
    phase : float
        Largest difference of the instants of the impacts, in cycles of the force.
    x : float
        Largest difference of X at the impacts, relative to the largest |X|.
    """

    phase: float
    x: float


class _Counted(Protocol):
    """A periodic motion counted from one of its impacts, such as a `PeriodicOrbit`."""

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
    """
    Impacts that repeat.

    Attributes
    ----------
    stops : tuple of int
        Stops hit in one period, in order.
    cycles : int
        The period k, in cycles of the force.
    phases : tuple of float
        Instants of the impacts in cycles of the force since its zero angle; the first is in
        [0, 1), all are in [0, k).
    x : tuple of float
        X at each impact, m.
    x_max : float
        Largest |X|, m: the scale of differences of X.
    drift : float
        Largest difference between the last period and the one before, in cycles of the force and
        relative to the largest |X|; 0 for a motion of the theory.
    decay : float
        The drift over that of the period before: the factor by which the distance from the
        periodic motion shrinks in a period. NaN where round-off hides it.
    first : int
        Index of the first of these impacts in the run.
    """

    stops: tuple[int, ...]
    cycles: int
    phases: tuple[float, ...]
    x: tuple[float, ...]
    x_max: float
    drift: float = 0.0
    decay: float = math.nan
    first: int = 0

    @classmethod
    def of(cls, orbit: _Counted) -> Self:
        """Return the rhythm of a motion of the theory."""
        return cls(orbit.stops, orbit.cycles, orbit.phases, orbit.x, orbit.x_max)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """Read what `as_dict` has written, or other entries of the same names."""
        return cls(
            tuple(stored['stops']),
            stored['cycles'],
            tuple(stored['phases']),
            tuple(stored['x']),
            stored['x_max'],
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the rhythm as what JSON can hold, without how it was come to."""
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
        """Whether the last two periods are the same, by and large."""
        return self.drift < SETTLED

    def turns(self) -> Iterator[Self]:
        """Yield the same rhythm counted from each of its impacts."""
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
        Return this rhythm counted as another one is.

        Parameters
        ----------
        other : Rhythm
            The other one.

        Returns
        -------
        turned : Rhythm
            Of the ways to count this rhythm that have the other's stops, the nearest one.
        apart : Apart
            How far it is from the other. None stands for both if it has other stops or another
            period.
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


def _difference(
    instants: Sequence[float],
    stops: Sequence[int],
    x: Sequence[float],
    count: int,
    end: int,
    cycles: int,
    size: float,
) -> float:
    """Return by how much `count` impacts before `end` differ from as many before them."""
    worst = 0.0
    for i in range(end - count, end):
        j = i - count
        if stops[i] != stops[j]:
            return math.inf
        late = abs(instants[i] - instants[j] - cycles)
        far = abs(x[i] - x[j]) / size
        worst = max(worst, late, far)
    return worst


def rhythm_of(
    instants: Sequence[float],
    stops: Sequence[int],
    x: Sequence[float],
    x_max: float,
    *,
    most_cycles: int = MOST_CYCLES,
) -> Rhythm | None:
    """
    Recognise a rhythm at the end of a run.

    Parameters
    ----------
    instants : sequence of float
        Instants of all impacts in a row, in cycles of the force since its zero angle.
    stops : sequence of int
        The stops they hit.
    x : sequence of float
        X at each, m.
    x_max : float
        Largest |X| of the motion, m.
    most_cycles : int, optional
        Longest period looked for, in cycles of the force.

    Returns
    -------
    Rhythm or None
        The shortest period that has settled; else the shortest one of which the last three
        differ by less than `RECOGNISED`. It begins on stop 1 after stop 2, if there is such a
        place, and is one of the last two periods.

    Examples
    --------
    >>> rhythm_of([0.2, 0.7, 1.2, 1.7, 2.2, 2.7], [1, 2] * 3, [1.0, -1.0] * 3, 2.0).phases
    (0.2, 0.7)
    """
    total = len(instants)
    if not total:
        return None
    size = x_max or 1.0
    best: tuple[int, int, float, float] | None = None
    drifts: dict[int, float] = {}
    count = 0
    for cycles in range(1, most_cycles + 1):
        # The impact nearest to a period before the last one
        begin = instants[-1] - cycles
        while count + 1 < total and abs(instants[-2 - count] - begin) <= abs(
            instants[-1 - count] - begin
        ):
            count += 1
        if not 0 < 3 * count <= total:
            break
        drift = _difference(instants, stops, x, count, total, cycles, size)
        if drift > RECOGNISED:
            continue
        earlier = _difference(instants, stops, x, count, total - count, cycles, size)
        if earlier > RECOGNISED:
            continue
        parts = [drifts[k] for k in drifts if cycles % k == 0]
        drifts[cycles] = drift
        if parts and drift > _BETTER * min(parts):
            continue
        decay = drift / earlier if earlier > _ROUND_OFF else math.nan
        if best is None or drift < SETTLED:
            best = (cycles, count, drift, decay)
        if drift < SETTLED:
            break
    if best is None:
        return None
    cycles, count, drift, decay = best
    first = _beginning(stops, count)
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


def period_distances(
    instants: Sequence[float], stops: Sequence[int], x: Sequence[float], rhythm: Rhythm
) -> list[float]:
    """
    Return by how much each of the last periods differs from the one before it, the last one last.

    Parameters
    ----------
    instants, stops, x : sequence
        As of `rhythm_of`.
    rhythm : Rhythm
        What it has recognised in them.

    Returns
    -------
    list of float
        At most `_LOOKED_BACK` numbers, as `Rhythm.drift`; they end where a period is not alike.
    """
    count, cycles, size = rhythm.impacts, rhythm.cycles, rhythm.x_max or 1.0
    found: list[float] = []
    end = len(instants)
    while end >= 2 * count and len(found) < _LOOKED_BACK:
        far = _difference(instants, stops, x, count, end, cycles, size)
        if far > _ALIKE:
            break
        found.append(far)
        end -= count
    return found[::-1]


def approaches(distances: Sequence[float]) -> bool:
    """Return whether distances shrink, over twelve periods and more: they come to repeat."""
    half = len(distances) // 2
    return half >= _FEW_PERIODS and max(distances[half:]) < max(distances[:half])


def _beginning(stops: Sequence[int], count: int) -> int:
    """Return the index of the last impact on stop 1 after stop 2 with a whole period from it."""
    total = len(stops)
    for i in range(total - count, total - 2 * count, -1):
        if stops[i] == 1 and stops[i - 1] == 2:
            return i
    return total - count


def turned_cycles(snapshot: Mapping[str, Any], frequency: float) -> float:
    """
    Return the angle of the force's first harmonic at a rig's snapshot, in cycles.

    Parameters
    ----------
    snapshot : mapping
        The snapshot.
    frequency : float
        The frequency that the first harmonic has there, rad/s.
    """
    origin = snapshot['origin']
    since = float(snapshot['time']) - float(origin['time'])
    return (float(origin['angles'][0]) + frequency * since) / math.tau
