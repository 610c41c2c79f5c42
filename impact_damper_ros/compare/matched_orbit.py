"""The periodic motion that the theory has for the logged rig, nearest to a measured one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from impact_damper_ros.orbits import (
    ImpactEquations,
    OrbitError,
    PeriodicOrbit,
    find_orbits,
    orbit_near,
)
from impact_damper_ros.orbits.impact_solver import polish
from impact_damper_ros.orbits.recognition import ImpactTable, Recurrence
from impact_damper_ros.orbits.search import orbit_of, within_theory
from impact_damper_ros.rig import Event, EventKind, RigParameters

from .recorded_stretch import ForceClock, RecordedImpacts
from .run_comparison import ImpactStates
from .run_curves import Array

__all__ = [
    'MatchedOrbit',
    'counted_impacts',
    'impact_table',
    'impulses_of',
    'match_orbit',
    'state_row',
]


#: Impacts weaker than this share of the strongest are those of a chatter, and not counted.
NEGLIGIBLE_IMPULSE = 1e-3
#: Nearer than this, the motion that Newton's method leads to is taken without a further search.
_NEAR = 0.05
_MOST_SEARCHED_IMPACTS = 4


@dataclass(frozen=True)
class MatchedOrbit:
    """
    What the theory has.

    Attributes
    ----------
    orbit : PeriodicOrbit or None
        The nearest motion, counted as the measured one is, without the weak impacts of a chatter.
    distance : float
        Largest difference of any instant (cycles) or scaled state of its impacts; inf without it.
    solver : str
        What found it, or why there is none.
    """

    orbit: PeriodicOrbit | None
    distance: float
    solver: str


def counted_impacts(impacts: RecordedImpacts) -> RecordedImpacts:
    """Return the impacts without the weak ones of chatters, by the second half's strongest."""
    strength = np.abs(impacts.primary_impulse)
    strongest = float(strength[len(impacts) // 2 :].max(initial=0.0))
    return impacts[strength > NEGLIGIBLE_IMPULSE * strongest]


def impact_table(impacts: RecordedImpacts, zero: float, cycle: float) -> ImpactTable:
    """Return impacts scaled for comparison; phases from a zero of the force, s."""
    return ImpactTable.of(
        impacts.time - zero,
        impacts.stop,
        impacts.x,
        impacts.velocity_after,
        impacts.damper_velocity_after,
        cycle,
    )


def impulses_of(orbit: PeriodicOrbit) -> tuple[float, ...]:
    """Return the impulses of a motion, N s."""
    mass = orbit.parameters.primary_mass
    pairs = zip(orbit.primary_velocity_before, orbit.primary_velocity_after, strict=True)
    return tuple(mass * abs(after - before) for before, after in pairs)


def _counted(orbit: PeriodicOrbit) -> PeriodicOrbit:
    """Return a motion without its weak impacts."""
    impulses = impulses_of(orbit)
    least = NEGLIGIBLE_IMPULSE * max(impulses, default=0.0)
    kept = [i for i, impulse in enumerate(impulses) if impulse > least]
    if len(kept) == orbit.impacts:
        return orbit

    def chosen(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(values[i] for i in kept)

    return replace(
        orbit,
        stops=tuple(orbit.stops[i] for i in kept),
        phases=chosen(orbit.phases),
        x=chosen(orbit.x),
        primary_velocity_before=chosen(orbit.primary_velocity_before),
        primary_velocity_after=chosen(orbit.primary_velocity_after),
        damper_velocity_before=chosen(orbit.damper_velocity_before),
        damper_velocity_after=chosen(orbit.damper_velocity_after),
    )


def state_row(orbit: PeriodicOrbit, table: ImpactTable) -> Array:
    """Return the impacts of a motion as a row of `approach.period_states`, scaled by a table."""
    x = np.array(orbit.x) / table.length
    velocity = np.array(orbit.primary_velocity_after) / table.speed
    damper_velocity = np.array(orbit.damper_velocity_after) / table.speed
    states = np.column_stack([x, velocity, damper_velocity])
    return np.concatenate([np.array(orbit.phases), states.ravel()])


def _nearest_turn(
    orbit: PeriodicOrbit, measured: Array, stops: tuple[int, ...], table: ImpactTable
) -> tuple[float, PeriodicOrbit] | None:
    """Return a motion counted so that it is nearest to a measured row, and the distance."""
    counted = _counted(orbit)
    n, found = counted.impacts, []
    if n != len(stops):
        return None
    for shift in range(n):
        turn = counted.begun_at(shift)
        if turn.stops != stops:
            continue
        row = state_row(turn, table)
        # Phases in order, from the first one on, and whole cycles taken out
        phases = turn.phases[0] + (row[:n] - turn.phases[0]) % turn.cycles
        late = phases - measured[:n]
        late -= np.round(late[0])
        far = max(np.abs(late).max(), np.abs(row[n:] - measured[n:]).max())
        found.append((float(far), turn))
    return min(found, key=lambda pair: pair[0], default=None)


def _solutions(
    rig: RigParameters, period: ImpactStates, recurrence: Recurrence, instants: Array
) -> Iterator[tuple[PeriodicOrbit | None, str]]:
    """Yield motions that Newton's method leads to from the measured one, and what found them."""
    cycles, stops = recurrence.cycles, period.stops
    single = not any(rig.force_amplitudes[1:])
    if single and within_theory(rig, stops):
        first = rig.replace(
            force_amplitudes=rig.force_amplitudes[:1],
            force_frequencies=rig.force_frequencies[:1],
            force_phases=rig.force_phases[:1],
        )
        equations = ImpactEquations(first, stops, cycles)
        root = polish(equations, np.array(period.x), instants)
        yield (None if root is None else orbit_of(equations, root)), 'impact equations'
    last = len(stops) - 1
    impact = Event(
        float(instants[last]),
        EventKind.IMPACT,
        stops[last],
        period.x[last],
        0.0,
        period.primary_velocity_before[last],
        period.primary_velocity_after[last],
        period.damper_velocity_before[last],
        period.damper_velocity_after[last],
        period.impulse[last],
    )
    yield orbit_near(rig, impact, period.phases[last], cycles), 'shooting on the event map'
    if len(stops) <= _MOST_SEARCHED_IMPACTS:
        search = find_orbits(rig, stops, cycles)
        method = 'impact equations' if search.report.method == 'scan' else 'search'
        for orbit in search.orbits:
            yield orbit, f'{method}, one of {len(search.orbits)}'


def match_orbit(
    clock: ForceClock,
    period: ImpactStates,
    measured: Array,
    recurrence: Recurrence,
    table: ImpactTable,
) -> MatchedOrbit:
    """Solve the periodic problem of the logged rig that a measured motion poses."""
    rig = clock.counted_from_zero()
    cycle = clock.cycle
    instants = cycle * np.array(period.phases)
    instants[1:] += (
        cycle
        * recurrence.cycles
        * np.ceil((instants[0] - instants[1:]) / (cycle * recurrence.cycles))
    )
    best: tuple[float, PeriodicOrbit] | None = None
    how = ''
    try:
        for orbit, solver in _solutions(rig, period, recurrence, instants):
            turn = orbit and _nearest_turn(orbit, measured, period.stops, table)
            if turn and (
                best is None or (not turn[1].viable, turn[0]) < (not best[1].viable, best[0])
            ):
                best, how = turn, solver
                if turn[1].viable and turn[0] < _NEAR:
                    break
    except OrbitError as error:
        return MatchedOrbit(None, np.inf, str(error))
    if best is None:
        stops = ','.join(map(str, period.stops))
        text = f'no motion with the stops {stops} in {recurrence.cycles} cycles was found'
        return MatchedOrbit(None, np.inf, text)
    return MatchedOrbit(best[1], best[0], how)
