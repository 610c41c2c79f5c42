# SPDX-License-Identifier: Apache-2.0
"""
Recognition of motion that repeats, on a Poincaré section.

A motion is compared with itself some cycles of the force earlier. Its states are taken on a
section: at its impacts, or once in each cycle (stroboscopic). With the right period the distance
of successive periods shrinks geometrically until the tolerance or the rounding of the numbers
hides it. A small distance alone is not enough: a chaotic motion returns close to itself now and
then.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_damper_ros.parameters.parameter_spec import check_kind

Array = NDArray[np.float64]

#: Longest period that is recognised, in cycles of the force.
LONGEST_PERIOD = 16
#: Two periods that differ by less, relative to the size of the motion, are nearly the same.
NEAR = 1e-3

# A period of 2 k cycles counts only if it repeats this much better than one of k: near a period
# doubling, k cycles repeat badly on the way to a motion that repeats after k, and a free vibration
# that takes 2 k cycles dies out more slowly than it turns. Where k cycles already repeat to
# within so many tolerances, or this number, 2 k do not count at all.
_BETTER, _NEARLY, _NEARLY_AT_MOST = 1e-2, 1e3, 1e-5
# Periods farther apart than this are not compared, and larger levels of shorter periods do not
# count.
_SAME, _RECOGNISED = 0.3, 1e-2
# Distance that round-off makes, in floors; and distance below which it hides a decay.
_FLOORS, _DECAY_ROUND_OFF = 10.0, 1e-9
# Periods that a motion approaches: factor by which the distance shrinks from one third of them to
# the next, and the least number and distance of them.
_SHRINKS, _FEW, _MANY, _APPROACHING, _CLOSE = 0.7, 6, 18, 0.3, 0.1


class MotionKind(Enum):
    """
    The kind of a motion, as measured.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters, settle
    >>> settle(Rig(RigParameters(gravity=0.0))).kind is MotionKind.PERIODIC
    True
    """

    AT_REST = 'at rest'
    #: M moves, m hits no stop.
    NO_IMPACTS = 'without impacts'
    #: The motion settles to a period, or to a motion without impacts.
    TRANSIENT = 'transient'
    PERIODIC = 'periodic'
    #: The next two kinds follow from the thresholds of `irregularity`.
    QUASI_PERIODIC = 'quasi-periodic'
    CHAOTIC = 'chaotic'
    #: The evidence does not determine the kind.
    UNDECIDED = 'undecided'
    #: The force, or the control, never repeats.
    NOT_PERIODICALLY_DRIVEN = 'not periodically driven'


def nearest_return(states: Array, longest: int = LONGEST_PERIOD) -> Array:
    """Return the least distance of the last state (..., n, m) from `longest` before it."""
    apart = np.abs(states[..., -1 - longest : -1, :] - states[..., -1:, :]).max(axis=-1)
    nearest: Array = apart.min(axis=-1)
    return nearest


@dataclass(frozen=True)
class Section:
    """
    Consecutive states of a motion, for comparison with those a period earlier.

    Attributes
    ----------
    phase : ndarray, shape (n,)
        Instants of the states in cycles of the force, from any zero.
    stop : ndarray, shape (n,)
        The stop hit at each, or 0.
    states : ndarray, shape (n, m)
        Quantities that are compared, relative to the size of the motion.
    length, speed : float
        Divisors of displacements (m) and velocities (m/s).

    Examples
    --------
    >>> turn = np.arange(4)
    >>> section = Section.of_impacts(0.5 * turn, 1 + turn % 2, np.cos(np.pi * turn))
    >>> section.stop.tolist(), len(section.states)
    ([1, 2, 1, 2], 4)
    """

    phase: Array
    stop: NDArray[Any]
    states: Array
    length: float = 1.0
    speed: float = 1.0

    @classmethod
    def of_impacts(
        cls,
        phase: ArrayLike,
        stop: ArrayLike,
        x: ArrayLike,
        *velocities: ArrayLike,
        length: float | None = None,
    ) -> Section:
        """
        Return the section at impacts.

        Parameters
        ----------
        phase, stop, x : array_like, shape (n,)
            Instants in cycles of the force, the stops hit, and X there, m.
        *velocities : array_like, shape (n,)
            Velocities that are compared too, such as those after the impacts, m/s.
        length : float, optional
            Size of X, m; the largest |X| of the second half, if not given. The size of the
            velocities is their largest.
        """
        place = np.asarray(x, float)
        late = slice(len(place) // 2, None)
        rates = np.array(velocities, float).reshape(len(velocities), len(place))
        if length is None:
            length = float(np.abs(place[late]).max(initial=0.0))
        speed = float(np.abs(rates[:, late]).max(initial=0.0)) or 1.0
        states = np.column_stack([place / (length or 1.0), *(rates / speed)])
        return cls(np.asarray(phase, float), np.asarray(stop), states, length or 1.0, speed)

    @classmethod
    def stroboscopic(cls, states: Array, size: ArrayLike = 1.0) -> Section:
        """Return states (n, m) once in each cycle, each divided by its size."""
        count = len(states)
        return cls(np.arange(float(count)), np.zeros(count, int), states / np.asarray(size))

    def __len__(self) -> int:
        return len(self.phase)

    def rows_in(self, cycles: int) -> int:
        """Return the number of rows in a period, by the row nearest to a period before the end."""
        begin = self.phase[-1] - cycles
        return len(self) - 1 - int(np.abs(self.phase - begin).argmin())

    def distances(self, rows: int, cycles: int) -> Array:
        """Return the distance of each row from the one a period earlier (inf: another stop)."""
        late = np.abs(self.phase[rows:] - self.phase[:-rows] - cycles)
        moved = np.abs(self.states[rows:] - self.states[:-rows]).max(axis=1)
        far: Array = np.maximum(late, moved)
        far[self.stop[rows:] != self.stop[:-rows]] = np.inf
        return far


@dataclass(frozen=True)
class Period:
    """
    A period of a motion, and how closely it repeats.

    Attributes
    ----------
    cycles : int
        The period, in cycles of the force.
    rows : int
        Rows of the section in a period: impacts, or cycles.
    distance : ndarray, shape (p,)
        Largest distance of any row from the one a period earlier, for each of the last periods
        that hit the same stops, the last one last.
    tolerance, floor : float
        As given to `find_period`.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters, settle
    >>> period = settle(Rig(RigParameters(gravity=0.0))).period
    >>> period.cycles, period.rows, period.settled
    (1, 1, True)
    """

    cycles: int
    rows: int
    distance: Array
    tolerance: float
    floor: float

    def __repr__(self) -> str:
        """Return the period in a line."""
        return (
            f'<Period: {self.cycles} cycles, {self.rows} rows; the last two differ by '
            f'{self.level:.1e}>'
        )

    @property
    def level(self) -> float:
        """Distance of the last two periods."""
        return float(self.distance[-1])

    @property
    def at_floor(self) -> bool:
        """Whether the last periods are equal to within the rounding of their numbers."""
        return self.level <= _FLOORS * self.floor

    @property
    def repeated(self) -> int:
        """Number of the last periods that agree with the period before to within the tolerance."""
        far = np.flatnonzero(self.distance > max(self.tolerance, _FLOORS * self.floor))
        return len(self.distance) - (int(far[-1]) + 1 if len(far) else 0)

    @property
    def settled(self) -> bool:
        """Whether the last two periods agree, and the two before them nearly do."""
        before = float(self.distance[-2]) if len(self.distance) > 1 else np.inf
        return self.repeated > 0 and before < max(NEAR, self.tolerance)

    @property
    def shrinks(self) -> bool:
        """Whether the distance keeps shrinking."""
        first, second, third = self._thirds()
        return second < _SHRINKS * first and third < _SHRINKS * second

    @property
    def grows(self) -> bool:
        """Whether the distance keeps growing: the run leaves an unstable motion."""
        first, second, third = self._thirds()
        hidden = max(self.tolerance, _FLOORS * self.floor)
        return first < _SHRINKS * second and second < _SHRINKS * third and third > hidden

    @property
    def approaches(self) -> bool:
        """Whether the distance shrinks as that of a motion which becomes periodic."""
        count = len(self.distance)
        recent = float(self.distance[-6:].max())
        soon = count >= _FEW and self.remaining < _APPROACHING
        return self.shrinks and (soon or (count >= _MANY and recent < _CLOSE))

    def _thirds(self) -> tuple[float, float, float]:
        """Return the largest distance in each third of the periods."""
        if len(self.distance) < 3:
            return np.nan, np.nan, np.nan
        first, second, third = (float(part.max()) for part in np.array_split(self.distance, 3))
        return first, second, third

    @property
    def decay(self) -> float:
        """Distance of the last two periods over that of the two before; NaN in round-off."""
        before = float(self.distance[-2]) if len(self.distance) > 1 else 0.0
        return self.level / before if before > _DECAY_ROUND_OFF else np.nan

    @property
    def factor(self) -> float:
        """Factor by which the distance shrinks in a period, estimated; at most 0.999."""
        distance = self.distance[len(self.distance) // 3 :]
        above = np.flatnonzero(distance > _FLOORS * self.floor)
        if len(above) < 3:
            return 0.0 if self.at_floor else 0.999
        slope = np.polyfit(above, np.log(distance[above]), 1)[0]
        return float(min(np.exp(slope), 0.999))

    @property
    def remaining(self) -> float:
        """Bound of the distance of the last period from the limit of a shrinking sequence."""
        recent = float(self.distance[-6:].max())
        return recent / (1.0 - self.factor)


def _compare(section: Section, cycles: int, tolerance: float, floor: float) -> Period | None:
    """Return the last periods of that many cycles, if at least two of them are alike."""
    rows = section.rows_in(cycles)
    late = abs(section.phase[-1 - rows] - (section.phase[-1] - cycles))
    if rows < 1 or len(section) < 2 * rows or late > _SAME:
        return None
    far = section.distances(rows, cycles)
    unlike = np.flatnonzero(far > _SAME)
    like = far[unlike[-1] + 1 :] if len(unlike) else far
    count = len(like) // rows
    if count < 1:
        return None
    distance = like[len(like) - count * rows :].reshape(count, rows).max(axis=1)
    return Period(cycles, rows, distance, tolerance, floor)


def find_period(
    section: Section,
    tolerance: float,
    floor: float = 0.0,
    *,
    near: float = NEAR,
    longest: int = LONGEST_PERIOD,
) -> Period | None:
    """
    Find the period with which a motion repeats at the end of its section.

    Parameters
    ----------
    section : Section
        Consecutive states of the motion; the last ones count.
    tolerance : float
        Distance below which two periods are the same, relative to the size of the motion and in
        cycles of the force.
    floor : float, optional
        Distance that the rounding of the numbers alone makes; ten times this distance counts as
        equal.
    near : float, optional
        Distance of the last four periods up to which a period is returned even if the motion has
        neither reached nor certainly approaches it.
    longest : int, optional
        Longest period to look for, in cycles of the force.

    Returns
    -------
    Period or None
        The shortest period in which the motion has settled (`settled`), or which it approaches
        (`approaches`); else the shortest one that the last periods nearly have; None if there is
        none.

    Raises
    ------
    TypeError
        If the section is no `Section`.

    Examples
    --------
    >>> turn = np.arange(24)
    >>> section = Section.of_impacts(0.5 * turn, 1 + turn % 2, np.cos(np.pi * turn))
    >>> found = find_period(section, 1e-9)
    >>> found.cycles, found.rows, found.settled
    (1, 2, True)
    """
    check_kind('section', section, Section, 'a Section, such as Section.of_impacts(...)')
    if len(section) < 3:
        return None
    span = section.phase[-1] - section.phase[0]
    nearly = min(_NEARLY * tolerance, _NEARLY_AT_MOST)
    levels: dict[int, float] = {}
    close: Period | None = None
    for cycles in range(1, longest + 1):
        if 2 * cycles > span + 0.5:
            break
        period = _compare(section, cycles, tolerance, floor)
        if period is None or period.grows:
            continue
        parts = [levels[k] for k in levels if cycles % k == 0]
        if period.level < _RECOGNISED:
            levels[cycles] = period.level
        if parts and (period.level > _BETTER * min(parts) or min(parts) <= nearly):
            continue
        if period.settled or period.approaches:
            return period
        last = period.distance[-4:]
        if close is None and len(last) == 4 and last.max() < near:
            close = period
    return close
