"""
A curve of a figure: periodic motions along one parameter, and simulated marks.

Two alternating impacts come from the enumeration, which finds every solution at each value.
More impacts come from the shooting solver, led along the parameter from motions that the
simulator settles into; friction may then reverse within a flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from impact_damper_ros.orbits import PeriodicOrbit, find_orbits, orbit_near
from impact_damper_ros.orbits.recognition import repeated_impacts
from impact_damper_ros.orbits.settling import run_by_cycles
from impact_damper_ros.orbits.shooting import Section, section_on, shoot
from impact_damper_ros.rig import Event, InitialConditions, RigParameters, Simulator
from impact_damper_ros.rig.swing import Swing

from .rigs import VARIABLES

__all__ = [
    'Curve',
    'Point',
    'SettledMotion',
    'Status',
    'Sweep',
    'disturbed',
    'enumerated_curves',
    'followed_curves',
    'settle',
    'settled_motions',
]


#: Cycles of the force between looks, most of them, and how closely two periods must agree.
CYCLES_BETWEEN_LOOKS, MOST_CYCLES, TOLERANCE = 50, 600, 1e-8
_SAMPLES_PER_CYCLE = 240
_MOST_PERIODS = 4
_SEED_IMPACTS = 6
_MOST_IMPACTS_PER_CYCLE = 25
#: Velocity of M in `disturbed`, relative to its swing.
DISTURBANCE = 0.001


@dataclass(frozen=True)
class SettledMotion:
    """
    A motion that repeats, as simulated.

    Attributes
    ----------
    value : float
        The swept parameter.
    stops : tuple of int
        Stops hit in a period; empty if it does not repeat within 4 cycles of the force.
    cycles : int
        Period in cycles of the force.
    ratio : float
        Largest |X| over A, sampled finely.
    durations : tuple of float
        From impact to impact, in half-cycles of the force.
    orbit : PeriodicOrbit or None
        The periodic motion that the theory finds next to it.
    seeds : tuple of PeriodicOrbit
        Motions with the period of the force, stable or not, that shooting finds from states of
        the run; there may be some even if the run does not repeat.
    """

    value: float
    stops: tuple[int, ...]
    cycles: int
    ratio: float
    durations: tuple[float, ...]
    orbit: PeriodicOrbit | None
    seeds: tuple[PeriodicOrbit, ...] = ()

    @property
    def difference(self) -> float:
        """Largest disagreement of simulation and theory in the durations, half-cycles."""
        if self.orbit is None or self.orbit.impacts != len(self.stops):
            return math.inf
        half = 0.5 * self.orbit.cycle
        theory = [duration / half for duration in self.orbit.durations]
        return min(
            max(abs(a - b) for a, b in zip(self.durations, theory[s:] + theory[:s], strict=True))
            for s in range(len(theory))
        )


def disturbed(orbit: PeriodicOrbit, share: float = DISTURBANCE) -> Simulator:
    """Return a simulator that starts near a periodic motion, just after its first impact."""
    rig = orbit.parameters
    rate = rig.force_frequencies[0]
    phase = rig.force_phases[0] + rate * orbit.instants[0]
    half = 0.5 * rig.gap
    initial = InitialConditions(
        initial_primary_position=orbit.x[0],
        initial_primary_velocity=orbit.primary_velocity_after[0] + share * orbit.x_max * rate,
        initial_damper_offset=half if orbit.stops[0] == 1 else -half,
        initial_damper_velocity=orbit.damper_velocity_after[0],
    )
    return Simulator(rig.replace(force_phases=(math.remainder(phase, math.tau),)), initial)


def _watch(rig: RigParameters, simulator: Simulator, cycles: int, begun: int) -> float:
    """Return the largest |X| over some cycles."""
    swing = Swing()
    cycle = math.tau / rig.force_frequencies[0]
    for k in range(cycles * _SAMPLES_PER_CYCLE + 1):
        events = simulator.advance((begun + k / _SAMPLES_PER_CYCLE) * cycle)
        swing.look(simulator.sample(), events)
    return swing.largest


def settle(simulator: Simulator, value: float = 0.0) -> SettledMotion:
    """Simulate until the motion repeats."""
    rig = simulator.parameters
    cycle = math.tau / rig.force_frequencies[0]
    begun = math.ceil(simulator.time / cycle)
    recent: list[Event] = []
    for look in run_by_cycles(simulator, CYCLES_BETWEEN_LOOKS, MOST_CYCLES, first=begun):
        k, recent = begun + look.cycles, look.impacts
        if len(recent) > _MOST_IMPACTS_PER_CYCLE * CYCLES_BETWEEN_LOOKS:
            return SettledMotion(value, (), 0, math.nan, (), None)
        recent = [e for e in recent if e.time > (k - 3 * _MOST_PERIODS - 1) * cycle]
        repeated = repeated_impacts(recent, cycle, _MOST_PERIODS, TOLERANCE)
        if repeated is None:
            continue
        period, cycles = repeated
        instants = [e.time for e in period]
        ends = [*instants[1:], instants[0] + cycles * cycle]
        orbit = orbit_near(rig, recent[-1], recent[-1].time / cycle, cycles)
        seeds = (orbit,) if orbit is not None and cycles == 1 else _seeds(rig, recent)
        return SettledMotion(
            value=value,
            stops=tuple(e.stop for e in period),
            cycles=cycles,
            ratio=_watch(rig, simulator, cycles, k) / rig.response_amplitude,
            durations=tuple(2.0 * (b - a) / cycle for a, b in zip(instants, ends, strict=True)),
            orbit=orbit,
            seeds=seeds,
        )
    return SettledMotion(value, (), 0, math.nan, (), None, _seeds(rig, recent))


def _seeds(rig: RigParameters, impacts: Sequence[Event]) -> tuple[PeriodicOrbit, ...]:
    """Shoot for one cycle of the force from the last impacts of a run."""
    cycle = math.tau / rig.force_frequencies[0]
    last = impacts[-_SEED_IMPACTS:]
    tries = (orbit_near(rig, impact, impact.time / cycle, 1) for impact in last)
    return tuple(orbit for orbit in tries if orbit is not None)


def settled_motions(
    rigs: Sequence[tuple[float, RigParameters]],
    *,
    carried: bool,
    predicted: Mapping[float, Sequence[PeriodicOrbit]] = MappingProxyType({}),
) -> list[SettledMotion]:
    """Simulate rigs, each from rest and other starts."""
    found: list[list[_Run]] = [[] for _ in rigs]
    for runs, (value, rig) in zip(found, rigs, strict=True):
        _take(runs, Simulator(rig), value)
        for orbit in predicted.get(value, ()):
            _take(runs, disturbed(orbit), value)
    if carried:
        forth = list(range(len(rigs)))
        for order in (forth, forth[::-1]):
            for i, j in pairwise(order):
                value, rig = rigs[j]
                for motion, state in list(found[i]):
                    if motion.stops and not any(
                        motion.stops == other.stops and motion.cycles == other.cycles
                        for other, _ in found[j]
                    ):
                        simulator = Simulator.restore(state)
                        simulator.change(rig)
                        _take(found[j], simulator, value)
    return [motion for runs in found for motion, _ in runs]


_Run = tuple[SettledMotion, dict[str, Any]]


def _take(runs: list[_Run], simulator: Simulator, value: float) -> None:
    """Add what a rig settles into, if it is not there yet."""
    motion = settle(simulator, value)
    if not any(_same(motion, other) for other, _ in runs):
        runs.append((motion, simulator.snapshot()))


def _same(one: SettledMotion, other: SettledMotion) -> bool:
    if one.stops != other.stops or one.cycles != other.cycles:
        return False
    pairs = zip(one.durations, other.durations, strict=True)
    return all(abs(a - b) < 1e-5 for a, b in pairs)


#: Neighbouring motions further apart than this, relative to their size, are not one curve.
_NEIGHBOURS = 0.25
_SAME = 1e-4
_EDGE_BISECTIONS = 12
_FOLLOW_LEAST = 1.0 / 64.0


class Status(IntEnum):
    """What kind of motion a point of a curve is."""

    STABLE = 0
    UNSTABLE = 1
    NOT_VIABLE = 2


@dataclass(frozen=True)
class Sweep:
    """
    What to compute.

    Attributes
    ----------
    name : str
        Names the series in tables and files.
    rig : RigParameters
        The rig, but for what is swept.
    variable : str
        Key of `VARIABLES`.
    values : tuple of float
        Values, rising.
    marks : tuple of float
        Values at which the simulator is run; some of `values`.
    impacts : tuple of int
        Numbers of impacts per cycle of the force that are sought.
    """

    name: str
    rig: RigParameters
    variable: str
    values: tuple[float, ...]
    marks: tuple[float, ...] = ()
    impacts: tuple[int, ...] = (2,)

    def at(self, value: float) -> RigParameters:
        """Return the rig at a value."""
        return VARIABLES[self.variable].apply(self.rig, value)


@dataclass(frozen=True)
class Point:
    """
    One motion on a curve.

    Attributes
    ----------
    value : float
        The swept parameter.
    ratio : float
        Largest |X| over A.
    durations : tuple of float
        Durations from impact to impact, in half-cycles of the force, pi/Omega.
    status : Status
        Stable, unstable or not viable.
    modulus : float
        Largest modulus of a multiplier.
    """

    value: float
    ratio: float
    durations: tuple[float, ...]
    status: Status
    modulus: float


@dataclass
class Curve:
    """
    Motions of one kind, in the order of the parameter.

    Attributes
    ----------
    stops : tuple of int
        Stops hit in a period.
    points : list of Point
        The motions.
    reverses : bool
        Whether m reverses between alternating stops, against the assumption of the paper.
    """

    stops: tuple[int, ...]
    points: list[Point] = field(default_factory=list)
    reverses: bool = False

    @property
    def impacts(self) -> int:
        """Number of impacts in a period."""
        return len(self.stops)

    def values(self, status: Status | None = None) -> list[float]:
        """Return the values at which there is a motion, of a kind if given."""
        return [p.value for p in self.points if status is None or p.status == status]


def point_of(value: float, orbit: PeriodicOrbit) -> Point:
    """Return what a figure shows of a motion."""
    half = 0.5 * orbit.cycle
    status = Status.STABLE if orbit.stable else Status.UNSTABLE
    return Point(
        value=value,
        ratio=orbit.amplitude_ratio,
        durations=tuple(duration / half for duration in orbit.durations),
        status=status if orbit.viable else Status.NOT_VIABLE,
        modulus=abs(orbit.multipliers[0]),
    )


def _link(
    curves: list[tuple[Curve, list[PeriodicOrbit]]], value: float, orbits: Sequence[PeriodicOrbit]
) -> None:
    """Append each motion to the open curve it continues best, or to a new one."""
    pairs = sorted(
        (
            (tail[-1].differs(orbit), i, j)
            for i, (_, tail) in enumerate(curves)
            for j, orbit in enumerate(orbits)
        ),
        key=lambda pair: pair[0],
    )
    used_curves: set[int] = set()
    used_orbits: set[int] = set()
    for distance, i, j in pairs:
        if distance > _NEIGHBOURS or i in used_curves or j in used_orbits:
            continue
        used_curves.add(i)
        used_orbits.add(j)
        curves[i][0].points.append(point_of(value, orbits[j]))
        curves[i][1].append(orbits[j])
    open_curves = [pair for i, pair in enumerate(curves) if i in used_curves]
    for j, orbit in enumerate(orbits):
        if j not in used_orbits:
            open_curves.append((Curve(orbit.stops, [point_of(value, orbit)]), [orbit]))
    curves[:] = open_curves


def _two_impacts(sweep: Sweep, value: float) -> tuple[PeriodicOrbit, ...]:
    stops = (1,) if sweep.rig.one_sided else (1, 2)
    return find_orbits(sweep.at(value), stops, simulate=False).orbits


def enumerated_curves(sweep: Sweep) -> list[Curve]:
    """Find the curves of two alternating impacts per cycle (one, if the rig is one-sided)."""
    values = list(sweep.values)
    found = {value: _two_impacts(sweep, value) for value in values}

    def kind(value: float) -> tuple[int, int]:
        fit = [o for o in found[value] if o.viable]
        return len(fit), sum(o.stable for o in fit)

    for left, right in zip(sweep.values, sweep.values[1:], strict=False):
        low, high = left, right
        for _ in range(_EDGE_BISECTIONS):
            if kind(low) == kind(high):
                break
            middle = 0.5 * (low + high)
            found[middle] = _two_impacts(sweep, middle)
            low, high = (middle, high) if kind(middle) == kind(low) else (low, middle)
    done: list[Curve] = []
    current: list[tuple[Curve, list[PeriodicOrbit]]] = []
    for value in sorted(found):
        _link(current, value, found[value])
        done += [curve for curve, _ in current if all(curve is not one for one in done)]
    return done


def _turned(orbit: PeriodicOrbit, stops: tuple[int, ...]) -> PeriodicOrbit | None:
    """Return the motion counted as `stops`, or None."""
    for shift in range(orbit.impacts):
        if orbit.stops[shift:] + orbit.stops[:shift] == stops:
            return orbit.begun_at(shift)
    return None


@dataclass(frozen=True)
class _Step:
    """A motion that is being followed: where, what, and its state to shoot from."""

    value: float
    orbit: PeriodicOrbit
    section: Section

    def to(self, sweep: Sweep, value: float) -> _Step | None:
        """Return the motion at another value, if it is still the same kind."""
        shot = shoot(sweep.at(value), self.section, self.orbit.cycles)
        turned = None if shot is None else _turned(shot[0], self.orbit.stops)
        if shot is None or turned is None or self.orbit.differs(turned) > _NEIGHBOURS:
            return None
        return _Step(value, turned, section_on(turned) or shot[1])

    @property
    def point(self) -> Point:
        return point_of(self.value, self.orbit)


def _sharpened(sweep: Sweep, last: _Step, after: _Step) -> list[Point]:
    """Return more motions about the place between two where stability changes."""
    points = []
    near, far = last, after.value
    for _ in range(_EDGE_BISECTIONS):
        middle = near.to(sweep, 0.5 * (near.value + far))
        if middle is None:
            break
        points.append(middle.point)
        if middle.orbit.stable == near.orbit.stable:
            near = middle
        else:
            far = middle.value
    return sorted(points, key=lambda point: point.value, reverse=after.value < last.value)


def _follow(
    sweep: Sweep, start: tuple[float, PeriodicOrbit, Section], targets: Sequence[float]
) -> list[Point]:
    """Lead a motion along values in a row, with smaller steps where needed, until it ends."""
    here = _Step(*start)
    points: list[Point] = []
    for target in targets:
        step = least = target - here.value
        least *= _FOLLOW_LEAST
        while here.value != target:
            last = abs(step) >= abs(target - here.value)
            ahead = here.to(sweep, target if last else here.value + step)
            if ahead is None:
                step *= 0.5
                if abs(step) < abs(least):
                    return points
                continue
            if ahead.orbit.stable != here.orbit.stable:
                points += _sharpened(sweep, here, ahead)
            here = ahead
            points.append(here.point)
            if here.orbit.impacts == 2 and not here.orbit.nodes:
                return points
    return points


def followed_curves(sweep: Sweep, motions: Sequence[SettledMotion], impacts: int) -> list[Curve]:
    """Find curves of motions in one cycle of the force from those that were simulated."""
    curves: list[Curve] = []
    for motion in motions:
        for orbit in motion.seeds:
            # Two impacts without reversal, sticking or rest are enumerated
            if orbit.impacts != impacts or (impacts == 2 and not orbit.nodes):
                continue
            point = point_of(motion.value, orbit)
            known = (p for c in curves for p in c.points if p.value == motion.value)
            section = section_on(orbit)
            if section is None or any(_alike(point, other) for other in known):
                continue
            start = (motion.value, orbit, section)
            below = _follow(sweep, start, [v for v in sweep.values[::-1] if v < motion.value])
            above = _follow(sweep, start, [v for v in sweep.values if v > motion.value])
            points = [*below[::-1], point, *above]
            curves.append(Curve(orbit.stops, points, reverses=impacts == 2))
    return curves


def _alike(one: Point, other: Point) -> bool:
    if len(one.durations) != len(other.durations) or abs(one.ratio - other.ratio) > _SAME:
        return False
    turns = (
        np.roll(one.durations, shift) - np.array(other.durations)
        for shift in range(len(one.durations))
    )
    return min(float(np.abs(turn).max()) for turn in turns) < math.sqrt(_SAME)
