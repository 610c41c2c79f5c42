# SPDX-License-Identifier: Apache-2.0
"""
A motion that repeats: its last period, the predicted motion, and the approach to it.

Near the periodic motion the state at impact one period later is a linear function of the one
before. Its largest eigenvalue is measured by dynamic mode decomposition (Schmid, J. Fluid Mech.
656, 2010) of the differences of successive periods, each scaled to the same size: the theory does
not enter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impact_damper_ros.motion.event import events_of_table
from impact_damper_ros.orbits.arguments import OrbitError
from impact_damper_ros.orbits.flight_arrays import Drive
from impact_damper_ros.orbits.orbit import AT_IMPACTS, PeriodicOrbit, Rhythm
from impact_damper_ros.orbits.recurrence import Period, Section
from impact_damper_ros.orbits.search import find_orbits
from impact_damper_ros.orbits.solved_orbits import counted_from_zero, orbit_near
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.rows import Events
from impact_damper_ros.theory.motion_curve import orbit_curve

from .motion_kind import NEGLIGIBLE_IMPULSE, SETTLED, section_of
from .result import Array, Convergence, Decay, ImpactStates, PredictedCurve

# The predicted motion


#: A solution of Newton's method that is nearer than this is taken without a search.
_NEAR = 0.05
_MOST_SEARCHED_IMPACTS = 4
#: Number of impacts at which Newton's method begins, the strongest first: round-off matters least
#: there.
_STARTS = 3


def impulses_of(orbit: PeriodicOrbit) -> tuple[float, ...]:
    """Return the impulses of a motion, N s."""
    mass = orbit.parameters.primary_mass
    pairs = zip(orbit.primary_velocity_before, orbit.primary_velocity_after, strict=True)
    return tuple(mass * abs(after - before) for before, after in pairs)


def _without_weak_impacts(orbit: PeriodicOrbit) -> PeriodicOrbit:
    impulses = impulses_of(orbit)
    least = NEGLIGIBLE_IMPULSE * max(impulses, default=0.0)
    kept = [i for i, impulse in enumerate(impulses) if impulse > least]
    if len(kept) == orbit.impacts:
        return orbit
    columns: dict[str, Any] = {
        name: tuple(getattr(orbit, name)[i] for i in kept)
        for name in ('stops', 'phases', *AT_IMPACTS)
    }
    return replace(orbit, **columns)


def _state_row(orbit: PeriodicOrbit, table: Section) -> Array:
    """Return the impacts of a motion as a row of `_period_states`, scaled by a table."""
    x = np.array(orbit.x) / table.length
    velocity = np.array(orbit.primary_velocity_after) / table.speed
    damper_velocity = np.array(orbit.damper_velocity_after) / table.speed
    states = np.column_stack([x, velocity, damper_velocity])
    return np.concatenate([np.array(orbit.phases), states.ravel()])


def _solutions(
    rig: RigParameters, drive: Drive, period: Events, cycles: int
) -> Iterator[tuple[PeriodicOrbit | None, str]]:
    """Yield motions near a measured period, and the method that found each."""
    strongest = np.argsort(-period['impulse'], kind='stable')[:_STARTS]
    for impact in events_of_table(period[strongest]):
        phase = (impact.time - drive.zero) / drive.cycle
        yield orbit_near(rig, impact, phase, cycles), 'boundary-value problem of its events'
    stops = tuple(period['stop'].tolist())
    if len(stops) <= _MOST_SEARCHED_IMPACTS:
        orbits = find_orbits(rig, stops, cycles).orbits
        for orbit in orbits:
            yield orbit, f'search, one of {len(orbits)}'


def _match_orbit(
    rig: RigParameters, drive: Drive, period: Events, rhythm: Rhythm
) -> tuple[PeriodicOrbit | None, str]:
    """
    Solve the periodic problem of a rig, counted from the zero of its force, from a period.

    The motion begins at the same impact as the measured one. With it comes the method that found
    it, or the reason why there is none.
    """
    best: tuple[tuple[bool, float], PeriodicOrbit] | None = None
    how = ''
    try:
        for orbit, solver in _solutions(rig, drive, period, rhythm.cycles):
            turn = orbit and _without_weak_impacts(orbit).nearest_turn(rhythm)
            if not turn:
                continue
            rank = not turn[0].viable, max(turn[1])
            if best is None or rank < best[0]:
                best, how = (rank, turn[0]), solver
                if rank < (False, _NEAR):
                    break
    except OrbitError as error:
        return None, str(error)
    if best is None:
        text = f'no motion with the stops {",".join(map(str, rhythm.stops))} in '
        return None, f'{text}{plural(rhythm.cycles, "cycle")} was found'
    return best[1], how


# The recorded periods


def _impact_states(drive: Drive, impacts: Events, cycles: int) -> ImpactStates:
    """Return the impacts of one period."""
    phases = drive.phase(impacts['time'])
    named = {name: tuple(impacts[name].tolist()) for name in ('x', *AT_IMPACTS[1:], 'impulse')}
    inside = tuple(((phases - math.floor(phases[0])) % cycles).tolist())
    return ImpactStates(stops=tuple(impacts['stop'].tolist()), phases=inside, **named)


def _period_states(table: Section, recurrence: Period, end: int) -> Array:
    """Return the states of the last periods, one row each; phases count from its period."""
    n, k = recurrence.rows, recurrence.cycles
    begin = len(table) - (len(recurrence.distance) + 1) * n
    count = (end - begin) // n
    rows = slice(end - count * n, end)
    periods = np.arange(count)[:, None]
    phase = table.phase[rows].reshape(count, n) - k * (periods - (count - 1))
    states = table.states[rows].reshape(count, 3 * n)
    return np.hstack([phase, states])


#: Differences of successive periods between which the decay is measured: the linear regime.
_LINEAR = 5e-3
_NOISE_FLOORS = 300.0
_LEAST_PERIODS = 8
_PERIODS_PER_RANK = 4
_MOST_RANK = 4
_NEGLIGIBLE = 1e-3
#: Relative difference up to which a factor equals the predicted one, or that of another half.
SAME_DECAY, _SAME_HALVES = 0.05, 0.1


def decay_rate(states: Array, floor: float) -> tuple[float, int, int]:
    """
    Measure the decay of the differences of successive periods, one per row.

    The results are the factor in a period, which is the largest modulus of the eigenvalues and NaN
    if it could not be measured, the first of the periods used, and their number. As long as both
    halves of the periods give different factors, the later half is taken.
    """
    steps = np.diff(states, axis=0)
    sizes = np.abs(steps).max(axis=1)
    large = np.flatnonzero(sizes > _LINEAR)
    start = int(large[-1]) + 1 if len(large) else 0
    largest_later = np.maximum.accumulate(sizes[::-1])[::-1]
    small = np.flatnonzero(largest_later < _NOISE_FLOORS * floor)
    stop = int(small[0]) if len(small) else len(sizes)
    count = stop - start
    if count < _LEAST_PERIODS:
        return math.nan, start, 0
    factor = _factor(steps[start:stop], sizes[start:stop, None])
    while count >= 2 * _LEAST_PERIODS:
        middle = start + count // 2
        parts = slice(start, middle + 1), slice(middle, stop)
        early, late = (_factor(steps[part], sizes[part, None]) for part in parts)
        if abs(late - early) <= _SAME_HALVES * factor:
            break
        start, count, factor = middle, stop - middle, late
    return factor, start, count


def _factor(steps: Array, sizes: Array) -> float:
    """Return the factor by which steps shrink, given the size of each."""
    before, after = (steps[:-1] / sizes[:-1]).T, (steps[1:] / sizes[:-1]).T
    modes, values, rows = np.linalg.svd(before, full_matrices=False)
    rank = min(_MOST_RANK, max(1, len(steps) // _PERIODS_PER_RANK))
    rank = int(min(rank, (values > _NEGLIGIBLE * values[0]).sum()))
    modes, values, rows = modes[:, :rank], values[:rank], rows[:rank]
    map_ = modes.T @ after @ rows.T / values
    return float(np.abs(np.linalg.eigvals(map_)).max())


#: Most periods that are shown, and periods shown after the distance has reached the resolution of
#: the stamps.
_MOST_SHOWN_PERIODS, _PERIODS_BEYOND = 4000, 60
_HIDDEN = 3.0
#: Factor by which the distance from the motion may exceed its bound.
_MARGIN = 3.0
_FLOORS = 5.0
_SOLVED = 1e-9


@dataclass(frozen=True)
class PeriodicMotion:
    """A measured motion that repeats, and the predicted one."""

    period: ImpactStates  # its last period
    time: float  # instant of the first impact of that period, rig time, s
    #: The predicted motion nearest to the measured one, without the weak impacts of a chatter, or
    #: None; the largest difference of an instant (cycles) or of a scaled state of their impacts;
    #: the method that found the motion, or why there is none.
    orbit: PeriodicOrbit | None
    distance: float
    solver: str
    decay: Decay
    first: int  # first of the periods on which the decay was measured
    times: Array  # beginning of each period, s
    #: Distance of each period from the predicted one, or without a prediction from the last one.
    distances: Array
    #: Largest distance that the remaining transient and the resolution of the stamps explain.
    allowed: float
    settled_at: float | None  # instant from which the distance is less than `SETTLED`, s
    recurrence: Period

    def as_curve(self) -> Convergence:
        """Return the approach to the periodic motion, for a plot."""
        hidden = np.flatnonzero(self.distances < _HIDDEN * self.recurrence.floor)
        last = min([*(hidden[:1] + _PERIODS_BEYOND), _MOST_SHOWN_PERIODS])
        times, distances = self.times[:last], self.distances[:last]
        return Convergence(times, distances, self.first, self.decay)


def last_period(stops: Array, count: int) -> int:
    """
    Return the index at which the last whole period, of `count` impacts, begins.

    It begins with an impact on stop 1 after one on stop 2, if the last two periods have one.
    """
    total = len(stops)
    for i in range(total - count, max(total - 2 * count, 0), -1):
        if stops[i] == 1 and stops[i - 1] == 2:
            return i
    return total - count


def periodic_motion(
    drive: Drive, impacts: Events, recurrence: Period, rig: RigParameters | None = None
) -> PeriodicMotion:
    """Measure a motion that repeats, and find the nearest predicted motion of the rig."""
    n = recurrence.rows
    table = section_of(impacts, drive.zero, drive.cycle)
    end = last_period(table.stop, n) + n
    rows = _period_states(table, recurrence, end)
    period = _impact_states(drive, impacts[end - n : end], recurrence.cycles)
    orbit, solver = None, ''
    if rig is not None:
        rig, last = counted_from_zero(rig, drive.angles), impacts[end - n : end]
        rhythm = Rhythm(period.stops, recurrence.cycles, period.phases, period.x, table.length)
        orbit, solver = _match_orbit(rig, drive, last, rhythm)
    reference = rows[-1]
    if orbit is not None:
        reference = _state_row(orbit, table)
        first = reference[0]
        reference[:n] = first + (reference[:n] - first) % recurrence.cycles
        reference[:n] += round(rows[-1, 0] - first)
    factor, begin, count = decay_rate(rows, recurrence.floor)
    distances = np.abs(rows - reference).max(axis=1)
    if orbit is None:
        distances = distances[:-1] if len(distances) > 1 else distances
    begins = end - n * np.arange(len(rows), 0, -1)
    shrinks = factor if factor < 1.0 else recurrence.factor
    recent = float(recurrence.distance[-6:].max())
    allowed = _MARGIN * recent / (1.0 - min(shrinks, 0.999)) + _FLOORS * recurrence.floor + _SOLVED
    far = np.flatnonzero(distances > SETTLED)
    settled = int(far[-1]) + 1 if len(far) else 0
    times = impacts['time'][begins][: len(distances)]
    return PeriodicMotion(
        period=period,
        time=float(impacts['time'][end - n]),
        orbit=orbit,
        distance=math.inf if orbit is None else float(distances[-1]),
        solver=solver,
        decay=Decay(
            measured=factor,
            predicted=abs(orbit.multipliers[0]) if orbit is not None else math.nan,
            periods=count,
            distance=float(distances[-1]),
            floor=recurrence.floor,
        ),
        first=begin,
        times=times,
        distances=distances,
        allowed=allowed,
        settled_at=float(times[settled]) if settled < len(times) else None,
        recurrence=recurrence,
    )


# Curves for plots


def predicted_curve(
    drive: Drive, orbit: PeriodicOrbit, period: ImpactStates | None, time: float
) -> PredictedCurve | None:
    """
    Return one period of a predicted motion; None if the rig cannot move so.

    It is placed beside the measured period, if there is one, whose first impact is at `time`.
    """
    rows = orbit_curve(orbit)
    if rows is None:
        return None
    # The zero of the force before the measured period, from which both count their phases
    first = period.phases[0] if period is not None else float(drive.phase(np.array(time)) % 1.0)
    late = round(float(rows[0, 0]) - first) if period is not None else 0
    zero = time - (first + late) * drive.cycle
    phase, x, velocity, y, relative = rows.T
    return PredictedCurve(phase, x, velocity, y, relative, zero, drive.cycle, orbit.cycles)
