"""
The gap with the least motion of the primary mass.

Bapat (1995), Figure 5. The largest |X| of the stable, viable motions is followed over the gap.
This function is not smooth: motions begin and end at folds, lose stability, or gain an impact. At
each of these it jumps upwards, to another motion or to none. The minimum is therefore found by a
golden section search, which converges to such an edge as well as to a smooth minimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import islice

import numpy as np

from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.parameter_spec import as_float
from impact_damper_ros.rig.quoting import shown

from .arguments import OrbitError, check_forcing, check_stops, checked_number
from .orbit import PeriodicOrbit
from .search import find_orbits

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_MOST_STEPS = 80
_WINDOW_STEPS = 12
#: Smallest gap of the default range, relative to the largest.
_LEAST_SHARE = 0.004
_SAME_BRANCH = 0.02
#: A pair of multipliers this close to 1 and -1 in angle counts as real, rad.
_REAL_ANGLE = 1e-6

#: Largest number of gaps of the initial grid.
_MOST_POINTS = 100_000


class Limit(Enum):
    """What limits the best gap."""

    MINIMUM = 'interior minimum'
    STABILITY = 'edge of stability'
    VIABILITY = 'edge of viability'
    FOLD = 'fold: the motion ends'
    RANGE = 'end of the searched range'


@dataclass(frozen=True, kw_only=True)
class OptimalGap:
    """
    The best gap, and what limits it.

    Attributes
    ----------
    gap : float
        The gap, m; at an edge the last one at which the motion is stable and viable.
    orbit : PeriodicOrbit
        The motion there.
    bracket : tuple of float
        Gaps between which the optimum lies, m.
    limit : Limit
        Whether it is a minimum, or what ends the motion just beyond.
    beyond : str
        The change just beyond the gap, with numbers; empty for a minimum.
    coexisting : str
        Other stable motions of the same rig, with numbers: viable ones with the same stops, and
        the one without impacts of a level rig; empty if none is known.
    evaluations : int
        Number of gaps at which the motions were found.
    """

    gap: float
    orbit: PeriodicOrbit
    bracket: tuple[float, float]
    limit: Limit
    beyond: str
    coexisting: str
    evaluations: int

    @property
    def x_max(self) -> float:
        """Largest |X| at the best gap, m."""
        return self.orbit.x_max


def _gap_scale(rig: RigParameters) -> float:
    """Return a gap above which no motion with impacts can be driven."""
    amplitude = rig.response_amplitude
    restitution = min(max(rig.restitution_1, rig.restitution_2), 0.95)
    return amplitude * (
        2.0 + math.pi * (1.0 + restitution) / ((1.0 - restitution) * (1.0 + rig.mass_ratio))
    )


def gap_range(rig: RigParameters) -> tuple[float, float]:
    """Return the range of gaps that `optimal_gap` searches by default, m."""
    scale = _gap_scale(rig)
    if not math.isfinite(scale) or scale == 0.0:
        raise OrbitError(
            f'the response without impacts is {rig.response_amplitude:g} m: give the gaps to '
            'look at, as gaps=(low, high)'
        )
    return _LEAST_SHARE * scale, scale


def _narrowing(
    function: Callable[[float], float], low: float, middle: float, high: float
) -> Iterator[list[float]]:
    """
    Yield ever narrower brackets of a minimum, by golden section.

    `scipy.optimize.minimize_scalar` refuses a bracket whose best place is at its end, as at the
    end of the range, and does not return the bracket that it ends with.
    """
    while True:
        yield [low, middle, high]
        right = high - middle > middle - low
        trial = middle + (1.0 - _GOLDEN) * ((high if right else low) - middle)
        if function(trial) < function(middle):
            low, middle, high = (middle, trial, high) if right else (low, trial, middle)
        elif right:
            high = trial
        else:
            low = trial


class _GapSearch:
    """The smallest stable, viable motion as a function of the gap."""

    def __init__(
        self, rig: RigParameters, stops: Sequence[int], cycles: int, simulate: bool
    ) -> None:
        self.rig = rig
        self.stops = tuple(stops)
        self.cycles = cycles
        self.simulate = simulate
        self.known: dict[float, tuple[PeriodicOrbit, ...]] = {}

    def motions(self, gap: float) -> tuple[PeriodicOrbit, ...]:
        """Return the motions at a gap."""
        rig = self.rig.replace(gap=gap)
        return find_orbits(rig, self.stops, self.cycles, simulate=self.simulate).orbits

    def viable(self, gap: float) -> tuple[PeriodicOrbit, ...]:
        """Return the viable motions at a gap."""
        if gap not in self.known:
            self.known[gap] = tuple(orbit for orbit in self.motions(gap) if orbit.viable)
        return self.known[gap]

    def motion(self, gap: float) -> PeriodicOrbit | None:
        stable = [orbit for orbit in self.viable(gap) if orbit.stable]
        return min(stable, key=lambda orbit: orbit.x_max, default=None)

    def modulus(self, gap: float) -> float:
        """Return the least modulus of the largest multiplier among the motions at a gap."""
        return min((abs(o.multipliers[0]) for o in self.viable(gap)), default=math.inf)

    def stable_between(self, low: float, middle: float, high: float) -> float | None:
        """Return a gap with a stable motion next to the one where it is most nearly so."""
        steps = _narrowing(self.modulus, low, middle, high)
        for _, gap, _ in islice(steps, _WINDOW_STEPS):
            if self.motion(gap) is not None:
                return gap
        return None

    def refined(self, grid: list[float]) -> list[float]:
        """Return a grid with one more gap in each narrow window of stability."""
        inner = zip(grid, grid[1:], grid[2:], strict=False)
        windows = [
            self.stable_between(low, middle, high)
            for low, middle, high in inner
            if self.motion(middle) is None
            and self.modulus(middle) <= min(self.modulus(low), self.modulus(high))
            and math.isfinite(self.modulus(middle))
        ]
        return sorted({*grid, *(gap for gap in windows if gap is not None)})

    def swing(self, gap: float) -> float:
        orbit = self.motion(gap)
        return math.inf if orbit is None else orbit.x_max

    def minimum(self, low: float, middle: float, high: float, tolerance: float) -> list[float]:
        """Narrow (low, high) around its best gap `middle`; return the three at the end."""
        bracket = [low, middle, high]
        for bracket in islice(_narrowing(self.swing, low, middle, high), _MOST_STEPS + 1):
            if bracket[2] - bracket[0] <= tolerance * bracket[2]:
                break
        return list(bracket)

    def verdict(self, orbit: PeriodicOrbit, beyond: float) -> tuple[Limit, str]:
        """Describe the motion just beyond an edge."""
        same = min(self.motions(beyond), key=orbit.differs, default=None)
        if same is None or orbit.differs(same) > _SAME_BRANCH:
            return Limit.FOLD, f'no such motion at a gap of {beyond:.9g} m'
        if not same.viable:
            return Limit.VIABILITY, same.reason
        if not same.stable:
            return Limit.STABILITY, _instability(same)
        return Limit.MINIMUM, ''


def _instability(orbit: PeriodicOrbit) -> str:
    """Describe how a motion loses stability."""
    value = orbit.multipliers[0]
    angle = abs(math.atan2(value.imag, value.real))
    if angle < _REAL_ANGLE:
        return f'a multiplier passes +1 ({value.real:.6f})'
    if math.pi - angle < _REAL_ANGLE:
        return f'period doubling: a multiplier passes -1 ({value.real:.6f})'
    return (
        f'Neimark-Sacker: a pair of multipliers of modulus {abs(value):.6f} at '
        f'+-{math.degrees(angle):.2f} degrees leaves the unit circle'
    )


def _coexisting(orbit: PeriodicOrbit, viable: Sequence[PeriodicOrbit]) -> str:
    """Describe the other stable motions of the same rig."""
    others = [other for other in viable if other.stable and orbit.differs(other) > _SAME_BRANCH]
    found = [('with the same stops', other.x_max) for other in others]
    found += _without_impacts(orbit.parameters)
    return '; '.join(
        f'M can also move by {swing:.6g} m {words}, {swing / orbit.x_max:.3g} times as much'
        for words, swing in found
    )


def _without_impacts(rig: RigParameters) -> list[tuple[str, float]]:
    """Return the steady vibrations of a level rig that reach no stop, in words, with their X."""
    if rig.angle or rig.air_force:
        return []
    found = []
    hold = rig.friction * rig.gravity
    if hold == 0.0 and rig.response_amplitude <= 0.5 * rig.gap:
        # m stays where it is
        found.append(('without impacts', rig.response_amplitude))
    joined = rig.replace(primary_mass=rig.primary_mass + rig.damper_mass)
    swing = joined.response_amplitude
    if 0.0 < swing * rig.force_frequencies[0] ** 2 <= hold:
        found.append(('with m held by friction', swing))
    return found


def optimal_gap(
    rig: RigParameters,
    *,
    gaps: tuple[float, float] | None = None,
    stops: Sequence[int] = (1, 2),
    cycles: int = 1,
    points: int = 90,
    tolerance: float = 1e-7,
    simulate: bool = False,
) -> OptimalGap:
    """
    Find the gap that makes the largest |X| smallest, over stable and viable motions.

    Parameters
    ----------
    rig : RigParameters
        The rig, two-sided and driven by one harmonic; its gap does not matter.
    gaps : tuple of float, optional
        Range of gaps to search, m; `gap_range(rig)` if not given.
    stops : sequence of int, optional
        Stops hit in one period; two alternating impacts if not given.
    cycles : int, optional
        Period in cycles of the force.
    points : int, optional
        Number of gaps of the initial grid, in geometric progression. A motion that is stable over
        less than one step is found by the minimum of its largest multiplier; one that is also
        viable over less than a step may be missed.
    tolerance : float, optional
        Width of the bracket at the end, relative to the gap. Below 1e-8 a smooth minimum is
        lost in round-off.
    simulate : bool, optional
        Whether to search also for motions in which m reverses, sticks or rests, from simulated
        starts; much slower.

    Returns
    -------
    OptimalGap
        The gap, the motion there, and what limits it.

    Raises
    ------
    OrbitError
        If the rig has no gap to choose, the range is not admissible, or no motion of these stops
        is stable and viable in it.

    Examples
    --------
    >>> best = optimal_gap(RigParameters(gravity=0.0), gaps=(30.0, 80.0), points=20)
    >>> best.limit.value
    'interior minimum'
    """
    check_forcing(rig)
    if rig.one_sided:
        raise OrbitError('the rig is one-sided, it has no gap to choose: give one_sided: false')
    try:
        low, high = gap_range(rig) if gaps is None else map(as_float, gaps)
    except (TypeError, ValueError) as error:
        if isinstance(error, OrbitError):
            raise
        raise OrbitError(f'gaps is {shown(gaps)}: give the least and the largest') from None
    count = as_float(points)
    if not 0.0 < low < high < math.inf or not 3 <= count <= _MOST_POINTS or count % 1.0:
        raise OrbitError(
            f'gaps from {low:g} to {high:g} m at {shown(points)} points: give 0 < low < high and '
            f'at least 3 points, a whole number up to {_MOST_POINTS}'
        )
    points, tolerance = int(count), checked_number('tolerance', tolerance, 0.0, 1.0)
    stops = check_stops(rig, stops, cycles)
    search = _GapSearch(rig, stops, cycles, simulate)
    grid = search.refined([float(gap) for gap in np.geomspace(low, high, points)])
    swings = [search.swing(gap) for gap in grid]
    best = min(range(len(grid)), key=swings.__getitem__)
    if math.isinf(swings[best]):
        raise OrbitError(
            f'no stable, viable motion with stops {",".join(map(str, search.stops))} in '
            f'{cycles} cycles at gaps from {low:g} to {high:g} m: try other gaps, more points or '
            'other stops'
        )
    # The lowest of the grid need not lie in the deepest valley: try every one that may be.
    deepest: list[float] | None = None
    for i in range(len(grid)):
        left, right = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
        if math.isinf(swings[i]) or swings[i] > min(search.swing(left), search.swing(right)):
            continue
        if swings[i] > 1.2 * swings[best]:
            continue
        valley = search.minimum(left, grid[i], right, tolerance)
        if deepest is None or search.swing(valley[1]) < search.swing(deepest[1]):
            deepest = valley
    assert deepest is not None
    left, gap, right = deepest
    orbit = search.motion(gap)
    assert orbit is not None
    limit, beyond = _limit(search, orbit, deepest, (low, high))
    return OptimalGap(
        gap=gap,
        orbit=orbit,
        bracket=(left, right),
        limit=limit,
        beyond=beyond,
        coexisting=_coexisting(orbit, search.viable(gap)),
        evaluations=len(search.known),
    )


def _limit(
    search: _GapSearch,
    orbit: PeriodicOrbit,
    bracket: Sequence[float],
    ends: tuple[float, float],
) -> tuple[Limit, str]:
    """Describe what limits the best gap on either side of the bracket."""
    left, gap, right = bracket
    if gap in ends:
        return Limit.RANGE, f'the searched range ends at {gap:g} m'
    for side in (right, left):
        limit, beyond = search.verdict(orbit, side)
        if limit is not Limit.MINIMUM:
            return limit, beyond
    return Limit.MINIMUM, ''
