# SPDX-License-Identifier: Apache-2.0
"""
What a test of a rig on a bench would show, computed before it is built.

The rig is switched on from rest, swept up and down in frequency at constant level, and run from
rest with its uncertain parameters varied. How well a recorded run tells restitution, friction and
gap apart follows from the laws of the flights of m: from one impact to the next, momentum and
free flight give two equations that are linear in (M + m)/(m (1 + R)), in the deceleration by
friction and in the gap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.orbits.settled_motion import SettledMotion, settle
from impact_damper_ros.orbits.swept_response import SweptRun
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.rig import Events, Rig

from .damper_design import at_level, from_rest

Array = NDArray[np.float64]

#: Samples of a cycle; the amplitude has settled once it stays within this part of its last one.
_SAMPLES, _SETTLED = 64, 0.05
#: Cycles of the run from rest that is looked at for when the amplitude settles.
_CYCLES = 300
#: A sweep: its ends over the frequency of the excitation, its steps each way, and at each of them
#: the fewest cycles and the time constants of M; amplitudes that differ by this part are two.
_SWEPT, _STEPS, _DWELL_CYCLES, _DWELL_CONSTANTS, _OTHER = (0.8, 1.2), 40, 60, 8.0, 0.05
#: Values of restitution and friction that are run.
_VARIED = 5
#: Errors of what is recorded: of a speed, over that of approach, and of a place, over the gap;
#: and the ratio of eigenvalues below which the laws do not distinguish three unknowns.
_SPEED_ERROR, _PLACE_ERROR, _DEGENERATE = 0.01, 0.01, 1e-9


@dataclass(frozen=True)
class SwitchedOn:
    """
    A rig that is switched on from rest.

    Attributes
    ----------
    rig : RigParameters
        The rig.
    events : ndarray of EVENT_TYPE
        Events of its first cycles.
    sizes : ndarray
        Largest |X| of each of them, m.
    settled : SettledMotion
        The motion that it comes to.
    """

    rig: RigParameters
    events: Events
    sizes: Array
    settled: SettledMotion

    @property
    def impacts(self) -> Events:
        """The impacts of its first cycles."""
        hits: Events = self.events[self.events['kind'] == EventKind.IMPACT]
        return hits

    @property
    def first_impact(self) -> float:
        """When m is first hit, s; infinity if it is not."""
        hits = self.impacts
        return float(hits['time'][0]) if len(hits) else math.inf

    @property
    def cycle(self) -> float:
        """Cycle of the excitation, s."""
        return self.settled.cycle

    @cached_property
    def settling_time(self) -> float:
        """When the amplitude has settled, s; infinity if it does not within the first cycles."""
        end = self.settled.x_max
        far = np.flatnonzero(np.abs(self.sizes / end - 1.0) > _SETTLED)
        if self.settled.period is None or (len(far) and far[-1] == len(self.sizes) - 1):
            return math.inf
        return (int(far[-1]) + 1 if len(far) else 1) * self.cycle

    @property
    def impact_rate(self) -> float:
        """Impacts per second of the motion that it comes to."""
        motion = self.settled
        span = motion.period.cycles * motion.cycle if motion.period else motion.end
        if motion.period is None:
            span -= motion.watched_from
        return len(motion.impacts) / span

    @property
    def impact_speed(self) -> float:
        """Largest speed of approach in that motion, m/s; 0 without impacts."""
        return max(
            (
                abs(hit.damper_velocity_before - hit.primary_velocity_before)
                for hit in self.settled.impacts
            ),
            default=0.0,
        )


def switched_on(rig: RigParameters) -> SwitchedOn:
    """Run a rig from rest."""
    settled = settle(Rig(rig, compiled=None))
    cycle = settled.cycle
    times = np.arange(_CYCLES * _SAMPLES + 1) * (cycle / _SAMPLES)
    result = Rig(rig, compiled=None).run(float(times[-1]), times)
    x = np.abs(result.samples['x'][1:]).reshape(_CYCLES, _SAMPLES)
    return SwitchedOn(rig, result.events, x.max(axis=1), settled)


@dataclass(frozen=True)
class Sweep:
    """
    A sweep up and down at constant level.

    Attributes
    ----------
    frequencies : ndarray, shape (n,)
        Circular frequencies, rad/s, rising.
    up, down : ndarray, shape (n,)
        Largest |X| there on the way up and down, m.
    bare : ndarray, shape (n,)
        That without impacts, m.
    impacts_up, impacts_down : ndarray, shape (n,)
        Impacts per cycle.
    """

    frequencies: Array
    up: Array
    down: Array
    bare: Array
    impacts_up: Array
    impacts_down: Array

    @property
    def differs(self) -> NDArray[np.bool_]:
        """Where the ways up and down have different motions."""
        differs: NDArray[np.bool_] = np.abs(self.up / self.down - 1.0) > _OTHER
        return differs


def swept(rig: RigParameters) -> Sweep:
    """Sweep the frequency of a rig up and down, from rest, at constant level."""
    center = rig.first_harmonic[1]
    low, high = (share * center for share in _SWEPT)
    constant = 1.0 / (rig.zeta * rig.omega) if rig.zeta else 0.0
    dwell = max(_DWELL_CYCLES * math.tau / center, _DWELL_CONSTANTS * constant)
    moving = rig.with_first_frequency(low).replace(
        sweep_mode='up_down',
        sweep_low=low,
        sweep_high=high,
        sweep_step=(high - low) / _STEPS,
        sweep_dwell=dwell,
    )
    run = Rig(moving, compiled=None)
    response = SweptRun(run)
    response.happened(run.advance((2 * _STEPS + 1) * dwell))
    found = response.response()
    up, down = slice(0, _STEPS + 1), slice(None, _STEPS - 1, -1)
    return Sweep(
        found.frequency[up],
        found.x[up],
        found.x[down],
        found.x_without[up],
        found.impacts[up],
        found.impacts[down],
    )


@dataclass(frozen=True)
class Variation:
    """
    A rig from rest with one of its parameters varied.

    Attributes
    ----------
    name : str
        The parameter: restitution, friction or level.
    values : tuple of float
        Its values.
    x_max, ratios : tuple of float
        Largest |X|, m, and over that without the damper.
    """

    name: str
    values: tuple[float, ...]
    x_max: tuple[float, ...]
    ratios: tuple[float, ...]


def varied(rig: RigParameters, name: str, values: Sequence[float]) -> Variation:
    """Run a rig from rest for some values of restitution, friction or level."""

    def at(value: float) -> RigParameters:
        if name == 'level':
            return at_level(rig, value)
        if name == 'restitution':
            return rig.replace(restitution_1=value, restitution_2=value)
        return rig.replace(**{name: value})

    rigs = [at(value) for value in values]
    sizes = [from_rest(one) for one in rigs]
    ratios = [x / one.response_amplitude for x, one in zip(sizes, rigs, strict=True)]
    return Variation(name, tuple(values), tuple(sizes), tuple(ratios))


@dataclass(frozen=True)
class Knowledge:
    """
    How well a run distinguishes restitution, friction and gap.

    Speeds and places of each flight are taken to be known to 1 % of the speed of approach and of
    the gap.

    Attributes
    ----------
    gap, level : float
        Gap (m) and level, as a factor, of the run.
    flights : int
        Flights of m from impact to impact that it has.
    repeats : bool
        Whether the motion comes to repeat, so that later flights tell nothing new.
    deviations : tuple of float
        Standard deviations of restitution, of the coefficient of friction, and of the gap over
        the gap; infinite where the run does not tell.
    """

    gap: float
    level: float
    flights: int
    repeats: bool
    deviations: tuple[float, float, float]


def flight_laws(rig: RigParameters, events: Events) -> tuple[Array, Array, Array]:
    """
    Return the laws of the flights of m that go from impact to impact without a reversal.

    Parameters
    ----------
    rig : RigParameters
        The rig, with two stops.
    events : ndarray of EVENT_TYPE
        Events one after another.

    Returns
    -------
    rows : ndarray, shape (n, 2, 3)
        Factors of (M + m)/(m (1 + R)), of the deceleration by friction gamma g cos(angle), and of
        the gap: of the velocity at the end of each flight, and of the way through it.
    constants : ndarray, shape (n, 2)
        What is added to them; the sums are 0, in m/s and m.
    speeds : ndarray, shape (n,)
        Speed of approach at the end, m/s.
    """
    hit = events['kind'] == EventKind.IMPACT
    alone = hit[:-1] & hit[1:]
    first, last = events[:-1][alone], events[1:][alone]
    span = last['time'] - first['time']
    jumps = [h['primary_velocity_after'] - h['primary_velocity_before'] for h in (first, last)]
    before = [h['primary_velocity_before'] for h in (first, last)]
    # Stop 1 is where Y is positive: on its way there m slides down
    way = 0.5 * (np.where(last['stop'] == 1, 1.0, -1.0) - np.where(first['stop'] == 1, 1.0, -1.0))
    slides = np.sign(first['damper_velocity_after'] - first['primary_velocity_after'])
    start = before[0] - jumps[0] * (rig.primary_mass / rig.damper_mass)
    fall = rig.gravity * math.sin(rig.angle) + 0.0 * span
    speed = [jumps[0] - jumps[1], -slides * span, 0.0 * span]
    place = [jumps[0] * span, -0.5 * slides * span**2, -way]
    rows = np.stack([np.stack(speed, axis=-1), np.stack(place, axis=-1)], axis=1)
    constants = np.stack(
        [
            start + fall * span - before[1],
            start * span + 0.5 * fall * span**2 - (last['x'] - first['x']),
        ],
        axis=-1,
    )
    approach = np.abs(last['damper_velocity_before'] - last['primary_velocity_before'])
    return rows, constants, approach


def _told(rig: RigParameters, events: Events) -> tuple[int, tuple[float, float, float]]:
    """Return the number of flights, and the deviations of `Knowledge`."""
    rows, _, speeds = flight_laws(rig, events)
    unknown = (math.inf, math.inf, math.inf)
    if len(rows) < 2:
        return len(rows), unknown
    mean = 0.5 * (rig.restitution_1 + rig.restitution_2)
    # To scales of R, friction and gap
    alpha = (rig.primary_mass + rig.damper_mass) / (rig.damper_mass * (1.0 + mean))
    scales = np.array([alpha / (1.0 + mean), rig.gravity * math.cos(rig.angle), rig.gap])
    errors = np.array([_SPEED_ERROR * float(speeds.mean()), _PLACE_ERROR * rig.gap])
    laws = (rows * scales / errors[:, None]).reshape(-1, 3)
    values, vectors = np.linalg.eigh(laws.T @ laws)
    if values[0] <= _DEGENERATE * values[-1]:
        return len(rows), unknown
    r, friction, gap = np.sqrt((vectors**2 / values).sum(axis=1)).tolist()
    return len(rows), (r, friction, gap)


def knowledge(
    rig: RigParameters, level: float = 1.0, cycles: int = 100, *, settled: bool = False
) -> Knowledge:
    """
    Return how well a run tells restitution, friction and gap apart.

    Parameters
    ----------
    rig : RigParameters
        The rig; of the run too, but for the level.
    level : float, optional
        The level of the run, as a factor.
    cycles : int, optional
        Cycles of the excitation that are recorded.
    settled : bool, optional
        Whether they are recorded once the motion has settled only, and not from rest.
    """
    there = at_level(rig, level)
    moving = Rig(there, compiled=None)
    motion = settle(moving)
    if not settled:
        moving = Rig(there, compiled=None)
    events = moving.run(moving.time + cycles * motion.cycle).events
    flights, deviations = _told(there, events)
    return Knowledge(rig.gap, level, flights, motion.period is not None, deviations)


@dataclass(frozen=True)
class BenchTest:
    """
    What a bench test of a rig would show.

    Attributes
    ----------
    rig : RigParameters
        The rig.
    start : SwitchedOn
        It is switched on from rest.
    sweep : Sweep
        It is swept up and down.
    variations : tuple of Variation
        It is run from rest with restitution, friction and level varied.
    plan : tuple of Knowledge
        The runs to record, and how well each distinguishes restitution, friction and gap; the
        first one is the settled motion alone.
    """

    rig: RigParameters
    start: SwitchedOn
    sweep: Sweep
    variations: tuple[Variation, ...]
    plan: tuple[Knowledge, ...]


def planned_runs(rig: RigParameters) -> tuple[Knowledge, ...]:
    """Return the runs of a test plan, the settled motion first."""
    return (
        knowledge(rig, settled=True),
        knowledge(rig),
        knowledge(rig, 2.0),
        knowledge(rig.replace(gap=0.8 * rig.gap)),
        knowledge(rig.replace(gap=1.1 * rig.gap)),
    )


def bench_test(
    rig: RigParameters, ranges: Mapping[str, tuple[float, float]], levels: Sequence[float]
) -> BenchTest:
    """
    Return what a bench test of a rig would show.

    Parameters
    ----------
    rig : RigParameters
        The rig, shaken by one harmonic of a force or of its base.
    ranges : mapping
        Lowest and highest `restitution` of both stops, and of `friction`.
    levels : sequence of float
        Levels of the excitation, as factors.
    """
    if not rig.periodic_force:
        raise ValueError(
            'the rig is not shaken by one lasting sine: give force_amplitudes or base_amplitudes '
            'one value, and leave multisine and sweep off'
        )
    variations = [
        varied(rig, name, np.linspace(*ends, _VARIED if ends[0] < ends[1] else 1).tolist())
        for name, ends in ranges.items()
    ]
    variations.append(varied(rig, 'level', levels))
    return BenchTest(rig, switched_on(rig), swept(rig), tuple(variations), planned_runs(rig))
