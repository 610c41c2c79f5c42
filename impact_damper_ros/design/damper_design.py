# SPDX-License-Identifier: Apache-2.0
"""
The best gap of an impact damper of each mass, and its margins.

For each mass the motions of two impacts per cycle are followed over the gap, exactly, to where M
moves least and the motion is stable. Whether a rig from rest reaches that motion is simulated, and
rigs of many gaps are run from rest for comparison: a structure that swings less than half the gap
never hits a stop, and off resonance another motion may be smaller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.impact import bounce
from impact_damper_ros.orbits.arguments import OrbitError
from impact_damper_ros.orbits.branch import Branch, Span
from impact_damper_ros.orbits.continuation import follow
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.search import carried_over, find_orbits
from impact_damper_ros.orbits.settled_motion import settle
from impact_damper_ros.orbits.solved_orbits import flights_of, orbit_at
from impact_damper_ros.parameters.rig_parameters import RigParameters, check_rig
from impact_damper_ros.rig.rig import Rig

from .runs_from_rest import Array, Flags, largest_from_rest, widest_hit

#: Gaps at which motions are sought, over the optimal gap of theory; further gaps, off resonance or
#: where no motion was found; and the largest difference of two motions that are one.
_FIRST_GAPS, _NARROW_GAPS, _SAME_MOTION = (0.9, 0.7, 0.5, 1.0, 1.1, 0.35, 0.25), (0.15, 0.05), 1e-6
#: Samples of each flight of a motion.
_SAMPLES = 128
#: Two motions with largest |X| within this part are one; a smaller |X| by that part is worth
#: another gap.
_SAME, _WORTH = 5e-3, 0.02
#: Number of gaps that are tried from rest, number of the best that are refined, and number of gaps
#: for each; and the level at which m is still hit.
_GAPS_FROM_REST, _NARROWED, _FINER, _MARGIN = 128, 3, 8, 0.95
_POINTS, _STEP = 60, 0.15
#: Number of iterations of R and the speed that follows from it.
_TURNS = 50
#: Significant digits of a gap that can be built.
_DIGITS = 4
#: Ranges in which frequency and level are followed, as factors; the frequency first near its
#: value.
_FREQUENCIES, _LEVELS = ((0.94, 1.06), (0.5, 1.5)), ((0.25, 4.0),)


class FromRest(NamedTuple):
    """
    A gap, and the motion that a rig with it reaches from rest.

    Attributes
    ----------
    gap, x_max : float
        The gap, and the largest |X| some time after the start, m.
    keeps_margin : bool
        Whether m is still hit if the level is 5 % lower.
    """

    gap: float
    x_max: float
    keeps_margin: bool


@dataclass(frozen=True)
class Design:
    """
    The best damper of one mass; its gaps have four significant digits.

    Attributes
    ----------
    rig : RigParameters
        The rig with the best gap.
    orbit : PeriodicOrbit
        Its motion: two impacts in a cycle.
    reached_from_rest : bool
        Whether a rig from rest settles into it.
    starts_by_itself : FromRest or None
        The best gap from rest, where its motion is not `orbit`.
    without_margin : FromRest or None
        The best gap of all from rest, where it is better by more than 2 % but keeps no margin.
    widest_hit : float
        Widest gap with which m is hit at all from rest, m.
    gap_range, level_range, frequency_range : Span
        Ranges of the gap (m), the level (as a factor) and the frequency (rad/s), each alone.

    Examples
    --------
    >>> from impact_damper_ros.design.damper_design import best_design
    >>> structure = RigParameters.of_structure(
    ...     primary_mass=5.0,
    ...     natural_frequency=10.0,
    ...     damping_ratio=0.02,
    ...     mass_ratio=0.05,
    ...     force_frequencies='10 Hz',
    ...     gravity=0.0,
    ... )
    >>> design = best_design(structure)
    >>> round(1e3 * design.gap, 2), round(design.x_max / design.bare, 3)
    (2.3, 0.087)
    """

    rig: RigParameters
    orbit: PeriodicOrbit
    reached_from_rest: bool
    starts_by_itself: FromRest | None
    without_margin: FromRest | None
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
        """Gap to build: the best from rest, m."""
        return self.starts_by_itself.gap if self.starts_by_itself else self.rig.gap

    @property
    def x_max(self) -> float:
        """Largest |X| with that gap, m."""
        return self.starts_by_itself.x_max if self.starts_by_itself else self.orbit.x_max

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
    away, width, gain = _resonance(rig)
    x = abs(rig.first_harmonic[0]) / rig.stiffness / math.hypot(away, width)
    return math.pi * x * gain / (1.0 + rig.mass_ratio)


def _resonance(rig: RigParameters) -> tuple[float, float, float]:
    """
    Return 1 - r^2, 2 r (zeta + zeta_e) and (1 + R)/(1 - R), see `optimal_gap`.

    R is that of the approach speed 2 Omega X/(1 - R).
    """
    mu, r = rig.mass_ratio, rig.frequency_ratio
    slow = min(0.5 * (rig.restitution_1 + rig.restitution_2), 0.999)
    mean, away, width, gain = slow, 1.0 - r * r, 0.0, 1.0
    for _ in range(_TURNS if rig.restitution_slowness else 1):
        gain = (1.0 + mean) / (1.0 - mean)
        width = 2.0 * r * (rig.zeta + 2.0 / math.pi * mu / (1.0 + mu) * gain)
        x = abs(rig.first_harmonic[0]) / rig.stiffness / math.hypot(away, width)
        restitution, _ = bounce(rig, slow, 2.0 * rig.first_harmonic[1] * x / (1.0 - mean))
        mean = 0.5 * (mean + restitution)
    return away, width, gain


def rounded_gap(gap: float) -> float:
    """Return a gap with the digits to which one can be built, m."""
    return float(f'{gap:.{_DIGITS}g}')


def _motions(rig: RigParameters) -> Iterator[PeriodicOrbit]:
    """Yield the viable motions of two impacts of a rig, stable or not."""
    # All motions are found for a rig without friction, and then followed in the friction.
    for orbit in find_orbits(rig.replace(friction=0.0), (1, 2)).orbits:
        if orbit.viable:
            carried = carried_over(orbit, rig) if rig.friction else orbit
            if carried is not None and carried.viable:
                yield carried


def _follow_coarsely(orbit: PeriodicOrbit, name: str, low: float, high: float) -> Branch:
    """Follow a motion in a parameter, in the large steps of a design."""
    return follow(orbit, name, low, high, largest_step=_STEP, most_points=_POINTS)


def _branches(rig: RigParameters) -> list[Branch]:
    """Return the branches of these motions over the gap, mirror images once."""
    branches: list[Branch] = []
    away, width, _ = _resonance(rig)
    optimal = optimal_gap(rig)
    for share in (*_FIRST_GAPS, *_NARROW_GAPS):
        if branches and share in _NARROW_GAPS and abs(away) < width:
            break
        gap = share * optimal
        known = [orbit.x_max for branch in branches for orbit in branch.at([gap])[0]]
        for orbit in _motions(rig.replace(gap=gap)):
            if all(abs(orbit.x_max / x - 1.0) > _SAME_MOTION for x in known):
                branches.append(_follow_coarsely(orbit, 'gap', gap / 3.0, 2.0 * gap))
                known.append(orbit.x_max)
    return branches


def _best_to_build(branch: Branch) -> PeriodicOrbit | None:
    """Return the stable motion of a branch with the least |X|, at a gap that can be built."""
    best = branch.best()
    if best is None:
        return None
    nearest = rounded_gap(best.value)
    digit = 10.0 ** (math.floor(math.log10(nearest)) + 1 - _DIGITS)
    gaps = (nearest, rounded_gap(nearest - digit), rounded_gap(nearest + digit))
    # The least |X| may lie where stability is lost, and the nearest gap beyond
    motions = [
        # The point of the branch has the gap only to round-off.
        orbit_at(orbit, orbit.parameters.replace(gap=gap))
        for gap in gaps
        for orbit in branch.at([gap])[0]
    ]
    kept = [orbit for orbit in motions if orbit and orbit.viable and orbit.stable]
    return min(kept, key=lambda orbit: abs(orbit.x_max - best.orbit.x_max), default=None)


def _span_of(
    orbit: PeriodicOrbit, name: str, here: float, factors: Sequence[tuple[float, float]]
) -> Span:
    """
    Return how far a motion is stable and viable over a parameter.

    The parameter goes up to factors of its value, and farther where the motion does not end there.
    """
    span = Span(here, here)
    for low, high in factors:
        with suppress(OrbitError, ArithmeticError):
            span = _follow_coarsely(orbit, name, *sorted((low * here, high * here))).span(
                here, orbit
            )
        if span.low_reason and span.high_reason:
            break
    return span


def best_from_rest(rig: RigParameters, widest: float) -> tuple[FromRest, FromRest]:
    """
    Return the gaps with which a rig from rest moves least: with a margin, and of all.

    Gaps are tried up to the widest that is hit, m.
    """
    sure = min(widest, widest_hit(rig, _MARGIN))

    def sizes_of(gaps: Array) -> Array:
        def least(largest: Array, repeats: Flags) -> float:
            # A motion that does not repeat is no smaller after more cycles.
            return float(min(largest[repeats & (gaps <= sure)], default=math.inf))

        return largest_from_rest(rig, {'gap': gaps}, least)

    gaps = np.geomspace(0.1 * sure, max(widest, sure), _GAPS_FROM_REST)
    gaps = np.unique([rounded_gap(gap) for gap in [*gaps, sure]])
    sizes = sizes_of(gaps)
    # From rest |X| is no smooth function of the gap
    for limit in (sure, math.inf):
        order = [k for k in np.argsort(sizes) if gaps[k] <= limit][:_NARROWED]
        finer = [
            rounded_gap(gap)
            for k in order
            for gap in np.linspace(
                gaps[max(k - 1, 0)], gaps[min(k + 1, len(gaps) - 1)], _FINER + 2
            )[1:-1]
        ]
        more = np.setdiff1d(finer, gaps)
        gaps, sizes = np.append(gaps, more), np.append(sizes, sizes_of(more))
    best = [min(zip(sizes[near], gaps[near], strict=True)) for near in (gaps <= sure, gaps > 0.0)]
    first, second = (FromRest(float(gap), float(size), bool(gap <= sure)) for size, gap in best)
    return first, second


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

    Raises
    ------
    TypeError
        If `rig` is no `RigParameters`.
    OrbitError
        If the theory of periodic motion does not apply to the rig, as where no force acts.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters
    >>> design = best_design(RigParameters(gravity=0.0))
    >>> round(design.rig.gap, 1), round(design.orbit.x_max, 2), design.reached_from_rest
    (58.1, 2.71, False)
    """
    check_rig('rig', rig)
    motions = [(b, branch) for branch in _branches(rig) if (b := _best_to_build(branch))]
    if not motions:
        return None
    orbit, branch = min(motions, key=lambda pair: pair[0].x_max)
    there = orbit.parameters
    settled = settle(Rig(there, compiled=None))
    near = abs(settled.x_max / orbit.x_max - 1.0) < _SAME
    reached = settled.rhythm is not None and near
    widest = widest_hit(there)
    alone, any_gap = best_from_rest(there, widest)
    if alone.x_max > (1.0 - _WORTH) * there.response_amplitude:
        # A gap with a margin must also reduce the vibration.
        alone = any_gap
    least = min(alone.x_max, orbit.x_max if reached else math.inf)
    own = reached and orbit.x_max <= (1.0 + _WORTH) * least
    gaps = branch.span(there.gap, orbit)
    shaker = f'{there.swept}_'
    here = there.first_harmonic[1]
    frequencies = _span_of(orbit, f'{shaker}frequencies', here, _FREQUENCIES)
    if there.friction or there.air_force or math.sin(there.angle) * there.gravity:
        level = getattr(there, f'{shaker}amplitudes')[0]
        levels = _span_of(orbit, f'{shaker}amplitudes', level, _LEVELS).over(level)
    else:
        # At another level the motions are those at another gap, to scale.
        levels = Span(gaps.high, gaps.low, gaps.high_reason, gaps.low_reason).over(there.gap)
        levels = Span(1.0 / levels.low, 1.0 / levels.high, levels.low_reason, levels.high_reason)
    return Design(
        there,
        orbit,
        reached,
        None if own else alone,
        any_gap if least > (1.0 + _WORTH) * any_gap.x_max else None,
        widest,
        gaps,
        levels,
        frequencies,
    )
