# SPDX-License-Identifier: Apache-2.0
"""
The best gap of an impact damper of each mass, and how sure it is.

For each mass the stable motion of two impacts per cycle is followed over the gap, exactly, to
where M moves least. Whether a rig from rest reaches that motion is simulated. A structure that
swings less than half the gap never hits a stop; the best gap from rest is then found by running
rigs of many gaps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.arguments import OrbitError
from impact_damper_ros.orbits.branch import Branch, Span
from impact_damper_ros.orbits.continuation import follow
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.search import carried_over, find_orbits
from impact_damper_ros.orbits.settled_motion import settle
from impact_damper_ros.orbits.solved_orbits import flights_of
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Rig

Array = NDArray[np.float64]

#: Gaps at which motions are sought, over the optimal gap of theory, and beside the resonance, or
#: where there are none so far, as well; and how near two motions are one.
_FIRST_GAPS, _NARROW_GAPS, _SAME_MOTION = (0.9, 0.7, 0.5, 1.0, 1.1, 0.35, 0.25), (0.15, 0.05), 1e-6
#: A run from rest: time constants of M, least cycles, and cycles at its end that are measured.
_TIME_CONSTANTS, _LEAST_CYCLES, _MEASURED_CYCLES, _SAMPLES = 8.0, 150, 30, 128
#: Cycles in which irregular impacts with R = 0 would come to repeat; 1/(1 - R) times as many.
_IMPACT_CYCLES = 45.0
#: Two motions with largest |X| within this part are one.
_SAME = 5e-3
#: Gaps that are tried from rest, how many of the best are looked at closely, at how many gaps
#: each; the level at which m is still hit; and a gap that M does not swing across, over its
#: amplitude.
_GAPS_FROM_REST, _NARROWED, _FINER, _MARGIN, _OPEN = 96, 3, 8, 0.95, 20.0
_POINTS, _STEP = 60, 0.15
#: How far frequency and level are followed, as factors; the frequency first next to its value.
_FREQUENCIES, _LEVELS = ((0.94, 1.06), (0.5, 1.5)), ((0.25, 4.0),)
#: Gaps that are tried for the worst case, over the best one; then some around the best of them.
_LEAST_GAP, _WIDEST_GAP = 0.3, 1.5


@dataclass(frozen=True)
class Design:
    """
    The best damper of one mass.

    Attributes
    ----------
    rig : RigParameters
        The rig with the best gap.
    orbit : PeriodicOrbit
        Its motion: two impacts in a cycle.
    reached_from_rest : bool
        Whether a rig from rest settles into it.
    starts_by_itself : tuple of float or None
        Gap and largest |X| of the best rig that does, m, where the best one does not.
    widest_hit : float
        Widest gap with which m is hit at all from rest, m.
    gap_range, level_range, frequency_range : Span
        How far the gap (m), the level (as a factor) and the frequency (rad/s) may go, each alone.
    """

    rig: RigParameters
    orbit: PeriodicOrbit
    reached_from_rest: bool
    starts_by_itself: tuple[float, float] | None
    widest_hit: float
    gap_range: Span
    level_range: Span
    frequency_range: Span

    @property
    def mass_ratio(self) -> float:
        """Mass ratio m/M."""
        return self.rig.mass_ratio

    @property
    def bare(self) -> float:
        """Amplitude of X without the damper, m."""
        return self.rig.response_amplitude

    @property
    def gap(self) -> float:
        """Gap to build: the best, or the best that starts by itself, m."""
        return self.starts_by_itself[0] if self.starts_by_itself else self.rig.gap

    @property
    def x_max(self) -> float:
        """Largest |X| with that gap, m."""
        return self.starts_by_itself[1] if self.starts_by_itself else self.orbit.x_max

    @property
    def built(self) -> RigParameters:
        """The rig to build."""
        return self.rig.replace(gap=self.gap)

    @property
    def impact_speed(self) -> float:
        """Largest approach speed at a stop, m/s."""
        pairs = zip(
            self.orbit.damper_velocity_before, self.orbit.primary_velocity_before, strict=True
        )
        return max(abs(z - x) for z, x in pairs)

    @property
    def impulse(self) -> float:
        """Largest impulse at a stop, N s."""
        pairs = zip(
            self.orbit.damper_velocity_after, self.orbit.damper_velocity_before, strict=True
        )
        return self.rig.damper_mass * max(abs(after - before) for after, before in pairs)

    @property
    def acceleration(self) -> float:
        """Largest |X''| between two impacts, m/s^2; at an impact the velocity of M jumps."""
        flights = flights_of(self.orbit)
        index = np.repeat(np.arange(len(flights)), _SAMPLES)
        shares = np.tile(np.linspace(0.0, 1.0, _SAMPLES), len(flights))
        _, _, acceleration, _ = flights.motion(index, shares * flights.spans[index])
        return float(np.abs(acceleration).max())


def optimal_gap(rig: RigParameters) -> float:
    """
    Return the gap of theory, m: two impacts per cycle at X = 0, without friction.

    d* = pi X (1 + R)/((1 - R)(1 + mu)), where X is that of the structure with the damping ratio
    zeta + zeta_e, zeta_e = (2/pi)(mu/(1 + mu))(1 + R)/(1 - R): at resonance
    X/A = zeta/(zeta + zeta_e).
    """
    away, width, bounce = _resonance(rig)
    x = abs(rig.first_harmonic[0]) / rig.stiffness / math.hypot(away, width)
    return math.pi * x * bounce / (1.0 + rig.mass_ratio)


def _resonance(rig: RigParameters) -> tuple[float, float, float]:
    """Return 1 - r^2, 2 r (zeta + zeta_e) and (1 + R)/(1 - R), see `optimal_gap`."""
    mean = min(0.5 * (rig.restitution_1 + rig.restitution_2), 0.999)
    bounce, mu = (1.0 + mean) / (1.0 - mean), rig.mass_ratio
    equivalent = 2.0 / math.pi * mu / (1.0 + mu) * bounce
    r = rig.frequency_ratio
    return 1.0 - r * r, 2.0 * r * (rig.zeta + equivalent), bounce


def at_level(rig: RigParameters, factor: float) -> RigParameters:
    """Return a rig whose force or base is stronger by a factor."""
    name = f'{rig.swept}_amplitudes'
    return rig.replace(**{name: tuple(factor * a for a in getattr(rig, name))})


def _transient(rig: RigParameters) -> int:
    """Return the cycles within which the start of a rig is forgotten, by M and by its impacts."""
    cycle = math.tau / rig.first_harmonic[1]
    lost = 1.0 - 0.5 * (rig.restitution_1 + rig.restitution_2)
    lasting = max(
        _TIME_CONSTANTS / (rig.zeta * rig.omega * cycle) if rig.zeta else math.inf,
        _IMPACT_CYCLES / lost if lost else math.inf,
    )
    most = 10 * _LEAST_CYCLES
    return max(_LEAST_CYCLES, math.ceil(min(lasting, most)))


def from_rest(rig: RigParameters) -> float:
    """Return the largest |X| of a rig some time after it was started from rest, m."""
    cycle = math.tau / rig.first_harmonic[1]
    cycles = _transient(rig)
    start, end = cycles * cycle, (cycles + _MEASURED_CYCLES) * cycle
    times = np.linspace(start, end, _MEASURED_CYCLES * _SAMPLES + 1)
    samples = Rig(rig, compiled=None).run(end, times).samples
    return float(np.abs(samples['x']).max(initial=0.0))


def widest_hit(rig: RigParameters, level: float = 1.0) -> float:
    """
    Return the widest gap with which m of a rig from rest is hit at some level, m.

    Beside the resonance M swings farther at first than later on. On an incline, along which m
    slides to a stop by itself, it is the gap across which M alone swings.
    """
    alone = at_level(rig, level).replace(gap=_OPEN * rig.response_amplitude)
    if rig.gravity * math.sin(rig.angle):
        alone = alone.replace(angle=0.0, friction=0.0)
    cycles = _transient(rig)
    end = cycles * math.tau / rig.first_harmonic[1]
    samples = Rig(alone, compiled=None).run(end, np.linspace(0.0, end, cycles * _SAMPLES)).samples
    return 2.0 * float(np.abs(samples['z'] - samples['x']).max())


def _performed(orbit: PeriodicOrbit) -> bool:
    return orbit.viable and orbit.stable


def _motions(rig: RigParameters) -> Iterator[PeriodicOrbit]:
    """Yield the stable motions of two impacts of a rig."""
    # Without friction all motions are found at once, and they are carried to the friction.
    for orbit in find_orbits(rig.replace(friction=0.0), (1, 2)).orbits:
        if orbit.viable:
            found = carried_over(orbit, rig) if rig.friction else orbit
            if found is not None and _performed(found):
                yield found


def _followed(orbit: PeriodicOrbit, name: str, low: float, high: float) -> Branch:
    return follow(orbit, name, low, high, largest_step=_STEP, most_points=_POINTS)


def _branches(rig: RigParameters) -> list[Branch]:
    """Return the branches of these motions over the gap, mirror images once."""
    found: list[Branch] = []
    away, width, _ = _resonance(rig)
    optimal = optimal_gap(rig)
    for share in (*_FIRST_GAPS, *_NARROW_GAPS):
        if found and share in _NARROW_GAPS and abs(away) < width:
            break
        gap = share * optimal
        known = [orbit.x_max for branch in found for orbit in branch.at([gap])[0]]
        for orbit in _motions(rig.replace(gap=gap)):
            if all(abs(orbit.x_max / x - 1.0) > _SAME_MOTION for x in known):
                found.append(_followed(orbit, 'gap', gap / 3.0, 2.0 * gap))
                known.append(orbit.x_max)
    return found


def _span_of(
    orbit: PeriodicOrbit, name: str, here: float, factors: Sequence[tuple[float, float]]
) -> Span:
    """
    Return how far a motion is stable and viable over a parameter.

    It is followed up to factors of its value, farther where nothing ends it there.
    """
    span = Span(here, here)
    for low, high in factors:
        with suppress(OrbitError, ArithmeticError):
            span = _followed(orbit, name, *sorted((low * here, high * here))).span(here, orbit)
        if span.low_reason and span.high_reason:
            break
    return span


def reaches(rig: RigParameters, x_max: float) -> bool:
    """Return whether a rig from rest settles on a motion with impacts and that largest |X|."""
    settled = settle(Rig(rig, compiled=None))
    return settled.rhythm is not None and abs(settled.x_max / x_max - 1.0) < _SAME


def best_from_rest(rig: RigParameters) -> tuple[float, float]:
    """
    Return the gap with which a rig from rest moves least, m, and its largest |X| then, m.

    M hits m only if it swings more than half the gap; a twentieth of the level is the margin.
    """
    widest = widest_hit(rig, _MARGIN)
    gaps = np.geomspace(0.1 * widest, widest, _GAPS_FROM_REST)
    sizes = np.array([from_rest(rig.replace(gap=float(gap))) for gap in gaps])
    # From rest |X| is no smooth function of the gap
    for best in np.argsort(sizes)[:_NARROWED]:
        low, high = gaps[max(best - 1, 0)], gaps[min(best + 1, _GAPS_FROM_REST - 1)]
        finer = np.linspace(low, high, _FINER + 2)[1:-1]
        gaps = np.append(gaps, finer)
        sizes = np.append(sizes, [from_rest(rig.replace(gap=float(gap))) for gap in finer])
    best = int(np.argmin(sizes))
    return float(gaps[best]), float(sizes[best])


def best_design(rig: RigParameters) -> Design | None:
    """
    Return the best damper of a rig's damper mass; the gap of the rig does not matter.

    Parameters
    ----------
    rig : RigParameters
        The structure with a damper of some mass, shaken by one harmonic.

    Returns
    -------
    Design or None
        None if no stable motion of two impacts per cycle was found.
    """
    found = [(best, branch) for branch in _branches(rig) if (best := branch.best()) is not None]
    if not found:
        return None
    best, branch = min(found, key=lambda pair: pair[0].orbit.x_max)
    orbit, there = best.orbit, best.orbit.parameters
    reached = reaches(there, orbit.x_max)
    alone = None if reached else best_from_rest(there)
    gaps = branch.span(best.value, orbit)
    shaker = f'{there.swept}_'
    here = there.first_harmonic[1]
    frequencies = _span_of(orbit, f'{shaker}frequencies', here, _FREQUENCIES)
    if there.friction or there.air_force or math.sin(there.angle) * there.gravity:
        level = getattr(there, f'{shaker}amplitudes')[0]
        levels = _span_of(orbit, f'{shaker}amplitudes', level, _LEVELS).over(level)
    else:
        # Motions of another level are those of another gap, to scale.
        levels = Span(gaps.high, gaps.low, gaps.high_reason, gaps.low_reason).over(best.value)
        levels = Span(1.0 / levels.low, 1.0 / levels.high, levels.low_reason, levels.high_reason)
    widest = widest_hit(there)
    return Design(there, orbit, reached, alone, widest, gaps, levels, frequencies)


def designs(rig: RigParameters, mass_ratios: Sequence[float]) -> Iterator[Design]:
    """Yield the best damper of each mass ratio; none for those without a motion of two impacts."""
    for mass_ratio in mass_ratios:
        found = best_design(rig.replace(mass_ratio=mass_ratio))
        if found is not None:
            yield found


@dataclass(frozen=True)
class Uncertain:
    """
    The gap whose worst case is best, over what is uncertain of the rig and over levels.

    Attributes
    ----------
    gaps : ndarray, shape (n,)
        Gaps that were tried, m, that of the design among them.
    ratios : ndarray, shape (n, cases)
        Largest |X| over that without the damper, from rest, for each case.
    ranges : dict
        Lowest and highest value of each uncertain parameter, SI.
    levels : tuple of float
        The levels as factors.
    """

    gaps: Array
    ratios: Array
    ranges: dict[str, tuple[float, float]]
    levels: tuple[float, ...]

    @property
    def worst(self) -> Array:
        """The worst case of each gap, over the amplitude without the damper."""
        worst: Array = self.ratios.max(axis=1)
        return worst

    @property
    def best(self) -> tuple[float, float]:
        """The gap whose worst case is best, m, and that worst case."""
        k = int(np.argmin(self.worst))
        return float(self.gaps[k]), float(self.worst[k])

    def worst_at(self, gap: float) -> float:
        """Return the worst case of the tried gap that is closest to a gap, in m."""
        return float(self.worst[np.argmin(np.abs(self.gaps - gap))])


def _at(rig: RigParameters, ranges: Mapping[str, tuple[float, float]], end: int) -> RigParameters:
    """Return a rig with uncertain parameters at one end of their ranges."""
    return rig.replace(**{name: ends[end] for name, ends in ranges.items()})


def cases(
    rig: RigParameters, ranges: Mapping[str, tuple[float, float]], levels: Sequence[float]
) -> list[RigParameters]:
    """
    Return the rigs that a rig may be.

    Both restitutions are low, as given, or high together; each with friction low and high, and
    with each level. Other parameters are low and high one at a time.
    """
    bounces = {n: ends for n, ends in ranges.items() if n.startswith('restitution')}
    rubbing = {n: ends for n, ends in ranges.items() if n == 'friction'}
    found = [rig]
    if bounces:
        found += [_at(rig, bounces, end) for end in (0, 1)]
    if rubbing:
        found = [_at(one, rubbing, end) for one in found for end in (0, 1)]
    found = [at_level(one, level) for one in found for level in levels]
    others = {n: e for n, e in ranges.items() if n not in bounces and n not in rubbing}
    return found + [_at(rig, {n: e}, end) for n, e in others.items() for end in (0, 1)]


def uncertain(
    design: Design,
    ranges: Mapping[str, tuple[float, float]],
    levels: Sequence[float],
    count: int = 20,
) -> Uncertain:
    """Return how a range of gaps does from rest, in every case of `cases`."""
    possible = cases(design.rig, ranges, levels)

    def ratios(gaps: Array) -> Array:
        runs = [
            [from_rest(one.replace(gap=float(gap))) / one.response_amplitude for one in possible]
            for gap in gaps
        ]
        return np.array(runs)

    # From rest |X| jumps from gap to gap: the worst case of the gap to build is one that was run
    gaps = np.append(np.geomspace(_LEAST_GAP, _WIDEST_GAP, count) * design.gap, design.gap)
    gaps.sort()
    found = ratios(gaps)
    best = int(np.argmin(found.max(axis=1)))
    low, high = gaps[max(best - 1, 0)], gaps[min(best + 1, count)]
    finer = np.linspace(low, high, count // 2 + 2)[1:-1]
    gaps, found = np.append(gaps, finer), np.append(found, ratios(finer), axis=0)
    order = np.argsort(gaps)
    return Uncertain(gaps[order], found[order], dict(ranges), tuple(levels))


def over_frequency(rig: RigParameters, frequencies: Array) -> Array:
    """Return the largest |X| of a rig from rest at circular frequencies (rad/s), m."""
    return np.array([from_rest(rig.with_first_frequency(float(w))) for w in frequencies])


def over_level(rig: RigParameters, levels: Array) -> Array:
    """Return the largest |X| of a rig from rest, over that without the damper, at levels."""
    ratios = []
    for level in levels:
        there = at_level(rig, float(level))
        ratios.append(from_rest(there) / there.response_amplitude)
    return np.array(ratios)
