"""What the simulator settles into: the marks of the figures, held against the theory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Any

from impact_damper_ros.orbits import PeriodicOrbit, orbit_near
from impact_damper_ros.orbits.settled import repeated_impacts
from impact_damper_ros.rig import (
    Event,
    EventKind,
    InitialConditions,
    RigParameters,
    Simulator,
)

from .swing import Swing

__all__ = ['SettledMotion', 'disturbed', 'settle', 'settled_motions']

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
    """
    Return a simulator that starts near a periodic motion, just after its first impact.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion.
    share : float, optional
        By how much the velocity of M is off, relative to its largest displacement times Omega.

    Returns
    -------
    Simulator
        Its force has the phase that belongs there.
    """
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
    """
    Simulate until the motion repeats.

    Parameters
    ----------
    simulator : Simulator
        The rig, at its start; it goes on.
    value : float, optional
        What to call the result.

    Returns
    -------
    SettledMotion
        With the periodic motion of the theory beside it.
    """
    rig = simulator.parameters
    cycle = math.tau / rig.force_frequencies[0]
    begun = math.ceil(simulator.time / cycle)
    recent: list[Event] = []
    for k in range(begun + CYCLES_BETWEEN_LOOKS, begun + MOST_CYCLES + 1, CYCLES_BETWEEN_LOOKS):
        events = simulator.advance(k * cycle)
        recent = [e for e in events if e.kind is EventKind.IMPACT]
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
    """
    Simulate rigs, each from rest and other starts.

    Parameters
    ----------
    rigs : sequence of (float, RigParameters)
        Value of the swept parameter, rising, and the rig there.
    carried : bool
        Whether each settled motion is also a start at the values next to it, as in a slow sweep
        upwards and downwards; the force must be the same for all.
    predicted : mapping of float to sequence of PeriodicOrbit, optional
        Motions that are started as well, off by a small disturbance.

    Returns
    -------
    list of SettledMotion
        Different motions at each value; also those that do not repeat, with no stops.
    """
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
