"""
The curves of a figure: periodic motions against one parameter, and simulated motions as marks.

Motions with two alternating impacts are enumerated: every solution is found at each value. Motions
with more impacts, and those in which friction reverses within a flight, are followed along the
parameter. They start from all solutions of the impact equations at each value, and
with friction, which the equations do not cover there, from those of frictionless rigs, carried
over. They do not start from simulations: what a run settles into may depend on its last digit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import PeriodicOrbit, find_orbits, orbit_near, plausible_stops
from impact_damper_ros.orbits.recognition import repeated_impacts
from impact_damper_ros.orbits.search import carried_over, counted_as
from impact_damper_ros.orbits.settling import run_by_cycles
from impact_damper_ros.orbits.solved_orbits import orbit_at
from impact_damper_ros.rig import Event, InitialConditions, RigParameters
from impact_damper_ros.rig.event_budget import EventBudget
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.rig.swing import Swing

from .rigs import VARIABLES

#: Cycles of the force between two checks, and in all; the tolerance within which periods agree.
CYCLES_BETWEEN_LOOKS, MOST_CYCLES, TOLERANCE = 50, 600, 1e-8
#: Fewest and most cycles near a predicted motion, which may be stable by little.
_CYCLES_NEAR = (3000, 30000)
_SAMPLES_PER_CYCLE = 240
_MOST_PERIODS = 4
_MOST_IMPACTS_PER_CYCLE = 25


@dataclass(frozen=True)
class SettledMotion:
    """A motion that the simulator settles into."""

    value: float  # the varied parameter
    #: Stops hit in a period; empty if the motion does not repeat within 4 cycles of the force.
    stops: tuple[int, ...]
    cycles: int  # period in cycles of the force
    ratio: float  # largest |X| over A
    durations: tuple[float, ...]  # from impact to impact, in half-cycles of the force
    orbit: PeriodicOrbit | None  # the periodic motion that the theory finds next to it

    @property
    def difference(self) -> float:
        """Largest difference between simulated and predicted durations, half-cycles."""
        if self.orbit is None or self.orbit.impacts != len(self.stops):
            return math.inf
        half = 0.5 * self.orbit.cycle
        theory = [duration / half for duration in self.orbit.durations]
        return min(
            max(abs(a - b) for a, b in zip(self.durations, theory[s:] + theory[:s], strict=True))
            for s in range(len(theory))
        )


def disturbed(orbit: PeriodicOrbit, share: float = 0.001) -> Rig:
    """
    Return a rig that starts near a periodic motion, just before its first impact.

    The velocity of M is off by a share of its amplitude. Just after the impact would be another
    motion where air drives m: no air acts before the first impact of a run.
    """
    rig = orbit.parameters
    rate = rig.force_frequencies[0]
    phase = rig.force_phases[0] + rate * orbit.instants[0]
    half = 0.5 * rig.gap
    initial = InitialConditions(
        initial_primary_position=orbit.x[0],
        initial_primary_velocity=orbit.primary_velocity_before[0] + share * orbit.x_max * rate,
        initial_damper_offset=half if orbit.stops[0] == 1 else -half,
        initial_damper_velocity=orbit.damper_velocity_before[0],
    )
    return Rig(rig.replace(force_phases=(math.remainder(phase, math.tau),)), initial)


def _largest(rig: Rig, cycles: int, begun: int) -> float:
    """Return the largest |X| over some cycles."""
    swing, budget = Swing(), EventBudget()
    cycle = math.tau / rig.parameters.force_frequencies[0]
    for k in range(cycles * _SAMPLES_PER_CYCLE + 1):
        events = budget.advance(rig, (begun + k / _SAMPLES_PER_CYCLE) * cycle)
        swing.look(rig.sample(), events)
    return swing.largest


def settle(rig: Rig, value: float = 0.0, most_cycles: int = MOST_CYCLES) -> SettledMotion:
    """Simulate until the motion repeats."""
    parameters = rig.parameters
    cycle = math.tau / parameters.force_frequencies[0]
    begun = math.ceil(rig.time / cycle)
    recent: list[Event] = []
    for look in run_by_cycles(rig, CYCLES_BETWEEN_LOOKS, most_cycles, first=begun):
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
        orbit = orbit_near(parameters, recent[-1], recent[-1].time / cycle, cycles)
        return SettledMotion(
            value=value,
            stops=tuple(e.stop for e in period),
            cycles=cycles,
            ratio=_largest(rig, cycles, k) / parameters.response_amplitude,
            durations=tuple(2.0 * (b - a) / cycle for a, b in zip(instants, ends, strict=True)),
            orbit=orbit,
        )
    return SettledMotion(value, (), 0, math.nan, (), None)


def settled_motions(
    rigs: Sequence[tuple[float, RigParameters]],
    *,
    carried: bool,
    predicted: Mapping[float, Sequence[PeriodicOrbit]] = MappingProxyType({}),
) -> list[SettledMotion]:
    """
    Simulate rigs, each from rest, near the predicted motions, and from its neighbours' motions.

    The last of these if `carried`: motions are carried from rig to rig, up and down.
    """
    found: list[list[_Run]] = [[] for _ in rigs]
    for runs, (value, rig) in zip(found, rigs, strict=True):
        _take(runs, Rig(rig), value)
        for orbit in predicted.get(value, ()):
            _take(runs, disturbed(orbit), value, _cycles_near(orbit))
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
                        here = Rig.resume(state)
                        here.change(rig)
                        _take(found[j], here, value)
    return [motion for runs in found for motion, _ in runs]


def _cycles_near(orbit: PeriodicOrbit) -> int:
    """Return for how many cycles a run near a stable motion may take to settle."""
    least, most = _CYCLES_NEAR
    needed = 2.0 * math.log(TOLERANCE) / math.log(max(abs(orbit.multipliers[0]), 0.5))
    return round(min(max(needed, least), most))


_Run = tuple[SettledMotion, Snapshot]


def _take(runs: list[_Run], rig: Rig, value: float, most_cycles: int = MOST_CYCLES) -> None:
    """Add the motion that a rig settles into, if it is new."""
    motion = settle(rig, value, most_cycles)
    if not any(_same(motion, other) for other, _ in runs):
        runs.append((motion, rig.state()))


def _same(one: SettledMotion, other: SettledMotion) -> bool:
    if one.stops != other.stops or one.cycles != other.cycles:
        return False
    pairs = zip(one.durations, other.durations, strict=True)
    return all(abs(a - b) < 1e-5 for a, b in pairs)


#: Motions at neighbouring values whose relative difference is larger are on different curves.
_LARGEST_STEP = 0.25
#: Motions at one value nearer than this are the same, in Xmax/A and in half-cycles.
_SAME, _SAME_DURATION = 1e-4, 1e-3
_EDGE_BISECTIONS = 12
#: Smallest step in following a motion, relative to the distance between values.
_SMALLEST_STEP = 1.0 / 64.0


class Status(IntEnum):
    """Stability and viability of a motion."""

    STABLE = 0
    UNSTABLE = 1
    NOT_VIABLE = 2


@dataclass(frozen=True)
class SeriesPlan:
    """A series of a figure: a rig, the parameter that varies, and its values."""

    #: Name in tables and files.
    name: str
    rig: RigParameters
    variable: str  # key of `VARIABLES`
    values: tuple[float, ...]  # values, rising
    marks: tuple[float, ...] = ()  # values at which the rig is simulated; some of `values`
    impacts: tuple[int, ...] = (2,)  # numbers of impacts per cycle of the force that are sought
    #: Value up to which motions with three impacts and more are sought.
    many_up_to: float = math.inf
    judged_at: tuple[float, ...] = ()  # values that a claim names; a quick look takes them, too

    def at(self, value: float) -> RigParameters:
        """Return the rig at a value."""
        return VARIABLES[self.variable].apply(self.rig, value)


@dataclass(frozen=True)
class CurvePoint:
    """One motion on a curve."""

    value: float  # the varied parameter
    ratio: float  # largest |X| over A
    #: From impact to impact, in half-cycles of the force, pi/Omega.
    durations: tuple[float, ...]
    status: Status
    modulus: float  # largest modulus of a multiplier
    #: The motion itself.
    orbit: PeriodicOrbit | None = field(default=None, repr=False, compare=False)


@dataclass
class Curve:
    """Motions of one kind, in the order of the parameter."""

    #: Stops hit in a period.
    stops: tuple[int, ...]
    points: list[CurvePoint] = field(default_factory=list)
    #: Whether m reverses between alternating stops, which the paper excludes.
    reverses: bool = False
    #: Whether it starts from a simulation, since nothing else has led to it.
    simulated: bool = False

    @property
    def impacts(self) -> int:
        """Number of impacts in a period."""
        return len(self.stops)


def _point(value: float, orbit: PeriodicOrbit) -> CurvePoint:
    half = 0.5 * orbit.cycle
    status = Status.STABLE if orbit.stable else Status.UNSTABLE
    return CurvePoint(
        value=value,
        ratio=orbit.amplitude_ratio,
        durations=tuple(duration / half for duration in orbit.durations),
        status=status if orbit.viable else Status.NOT_VIABLE,
        modulus=abs(orbit.multipliers[0]),
        orbit=orbit,
    )


def _link(
    curves: list[tuple[Curve, list[PeriodicOrbit]]], value: float, orbits: Sequence[PeriodicOrbit]
) -> None:
    """Append each motion to the open curve that it continues best, or to a new one."""
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
        if distance > _LARGEST_STEP or i in used_curves or j in used_orbits:
            continue
        used_curves.add(i)
        used_orbits.add(j)
        curves[i][0].points.append(_point(value, orbits[j]))
        curves[i][1].append(orbits[j])
    open_curves = [pair for i, pair in enumerate(curves) if i in used_curves]
    for j, orbit in enumerate(orbits):
        if j not in used_orbits:
            open_curves.append((Curve(orbit.stops, [_point(value, orbit)]), [orbit]))
    curves[:] = open_curves


def _two_impacts(plan: SeriesPlan, value: float) -> tuple[PeriodicOrbit, ...]:
    stops = (1,) if plan.rig.one_sided else (1, 2)
    return find_orbits(plan.at(value), stops, simulate=False).orbits


def enumerated_curves(plan: SeriesPlan) -> list[Curve]:
    """Find all curves of two alternating impacts per cycle, or one if the rig is one-sided."""
    values = list(plan.values)
    found = {value: _two_impacts(plan, value) for value in values}

    def kind(value: float) -> tuple[int, int]:
        fit = [o for o in found[value] if o.viable]
        return len(fit), sum(o.stable for o in fit)

    for left, right in zip(plan.values, plan.values[1:], strict=False):
        low, high = left, right
        for _ in range(_EDGE_BISECTIONS):
            if kind(low) == kind(high):
                break
            middle = 0.5 * (low + high)
            found[middle] = _two_impacts(plan, middle)
            low, high = (middle, high) if kind(middle) == kind(low) else (low, middle)
    done: list[Curve] = []
    current: list[tuple[Curve, list[PeriodicOrbit]]] = []
    for value in sorted(found):
        _link(current, value, found[value])
        done += [curve for curve, _ in current if all(curve is not one for one in done)]
    return done


@dataclass(frozen=True)
class _Step:
    """A motion that is followed."""

    value: float
    orbit: PeriodicOrbit

    def to(self, plan: SeriesPlan, value: float) -> _Step | None:
        """Return the motion at another value, if it is still of the same kind."""
        there = orbit_at(self.orbit, plan.at(value))
        if there is None or self.orbit.differs(there) > _LARGEST_STEP:
            return None
        return _Step(value, there)

    @property
    def point(self) -> CurvePoint:
        return _point(self.value, self.orbit)


def _instability(orbit: PeriodicOrbit) -> tuple[int, int, int]:
    """Count the multipliers outside the unit circle: above 1, below -1, and not real."""
    outside = [m for m in orbit.multipliers if abs(m) >= 1.0]
    above = sum(m.imag == 0.0 and m.real > 0.0 for m in outside)
    below = sum(m.imag == 0.0 and m.real < 0.0 for m in outside)
    return above, below, len(outside) - above - below


def _between(plan: SeriesPlan, near: _Step, far: _Step, bisections: int) -> list[CurvePoint]:
    """Return motions between two, around each value at which other multipliers are unstable."""
    if not bisections or _instability(near.orbit) == _instability(far.orbit):
        return []
    middle = near.to(plan, 0.5 * (near.value + far.value))
    if middle is None:
        return []
    return [
        *_between(plan, near, middle, bisections - 1),
        middle.point,
        *_between(plan, middle, far, bisections - 1),
    ]


def _sharpened(plan: SeriesPlan, near: _Step, far: _Step) -> list[CurvePoint]:
    """
    Return motions between two, around the values at which the stability changes.

    A range of stability between two unstable motions is found if they are unstable in different
    ways, as by a period doubling on one side and a pair of multipliers on the other.
    """
    points = _between(plan, near, far, _EDGE_BISECTIONS)
    found = {near.point.status, far.point.status, *(point.status for point in points)}
    return points if Status.STABLE in found else []


def _follow(
    plan: SeriesPlan,
    start: Start,
    targets: Sequence[float],
    known: Mapping[float, Sequence[CurvePoint]],
) -> list[CurvePoint]:
    """Follow a motion along the values, with smaller steps where needed, to its end or a join."""
    here = _Step(*start)
    points: list[CurvePoint] = []
    for target in targets:
        step = least = target - here.value
        least *= _SMALLEST_STEP
        while here.value != target:
            last = abs(step) >= abs(target - here.value)
            ahead = here.to(plan, target if last else here.value + step)
            if ahead is None:
                step *= 0.5
                if abs(step) < abs(least):
                    return points
                continue
            points += _sharpened(plan, here, ahead)
            here = ahead
            points.append(here.point)
            if here.orbit.impacts == 2 and not here.orbit.events:
                return points
        if any(alike(here.point, other) for other in known.get(target, ())):
            return points
    return points


#: A motion that a curve is followed from, and the value of the parameter.
Start = tuple[float, PeriodicOrbit]


def frictionless_motions(plan: SeriesPlan, values: Iterable[float]) -> list[Start]:
    """Find the viable motions without friction at some values: all of the impact equations."""
    found: list[Start] = []
    for value in values:
        rig = plan.at(value).replace(friction=0.0)
        sequences = (
            stops
            for impacts in plan.impacts
            if impacts == 2 or value <= plan.many_up_to
            for stops in plausible_stops(rig, impacts)
            # The motions of the paper hit both
            if len(set(stops)) == 2
        )
        for stops in sequences:
            orbits = find_orbits(rig, stops, simulate=False).orbits
            found += [(value, orbit) for orbit in orbits if orbit.viable]
    return found


def carried_starts(plan: SeriesPlan, motions: Iterable[Start]) -> list[Start]:
    """Return the motions of other rigs, carried over to the rig of a series at their values."""
    found: list[Start] = []
    for value, orbit in motions:
        over = carried_over(orbit, plan.at(value))
        counted = None if over is None else counted_as(over, orbit.stops)
        if counted is not None:
            found.append((value, counted))
    return found


def followed_curves(plan: SeriesPlan, starts: Iterable[Start], impacts: int) -> list[Curve]:
    """
    Follow motions of one force cycle along the parameter, each curve once.

    With three impacts and more only curves that are stable somewhere are kept.
    """
    curves: list[Curve] = []
    known: dict[tuple[int, ...], dict[float, list[CurvePoint]]] = {}
    for value, orbit in starts:
        # Two impacts without reversal, sticking or rest are enumerated
        if orbit.impacts != impacts or (impacts == 2 and not orbit.events):
            continue
        point = _point(value, orbit)
        others = known.setdefault(orbit.stops, {})
        if any(alike(point, other) for other in others.get(value, ())):
            continue
        start = (value, orbit)
        below = _follow(plan, start, [v for v in plan.values[::-1] if v < value], others)
        above = _follow(plan, start, [v for v in plan.values if v > value], others)
        points = [*below[::-1], point, *above]
        for one in points:
            others.setdefault(one.value, []).append(one)
        curves.append(Curve(orbit.stops, points, reverses=impacts == 2))
    return [c for c in curves if impacts == 2 or any(p.status == Status.STABLE for p in c.points)]


def alike(one: CurvePoint | SettledMotion, other: CurvePoint) -> bool:
    """Return whether two motions with the same stops at the same value are the same."""
    if len(one.durations) != len(other.durations) or abs(one.ratio - other.ratio) > _SAME:
        return False
    turns = (
        np.roll(one.durations, shift) - np.array(other.durations)
        for shift in range(len(one.durations))
    )
    return min(float(np.abs(turn).max()) for turn in turns) < _SAME_DURATION


def point_of(curves: Iterable[Curve], mark: SettledMotion) -> CurvePoint | None:
    """Return the motion on some curves that a settled motion is."""
    if mark.cycles != 1:
        return None
    turns = {mark.stops[i:] + mark.stops[:i] for i in range(len(mark.stops))}
    points = (
        point
        for curve in curves
        if curve.stops in turns
        for point in curve.points
        if point.value == mark.value and point.status != Status.NOT_VIABLE
    )
    return next((point for point in points if alike(mark, point)), None)
