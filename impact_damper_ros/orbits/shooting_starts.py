"""Starts for the shooting solver: simulated motion, and a simpler rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.mode import make_machine

from .event_map import origin_at, run_course
from .orbit import PeriodicOrbit
from .report import StartReport
from .settled import starting_points
from .shooting import Section, section_of, section_on, shoot

__all__ = ['carried_over', 'settled_sections', 'shot_orbits']

_SETTLING_CYCLES = 120
_STARTS_PER_RUN = 3
_MOST_EVENTS = 200
_BUSY_PERIODS = 8
_FIRST_SHARE = 0.25
_LEAST_SHARE = 1.0 / 64.0


def settled_sections(
    parameters: RigParameters, cycles: int, most_events: int = _MOST_EVENTS
) -> Iterator[Section]:
    """
    Yield states of simulated motion, after it has had time to settle.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    cycles : int
        Period looked for, in cycles of the force.
    most_events : int, optional
        A run is left once several periods in a row have more events than this.

    Yields
    ------
    Section
        Several from each of several initial conditions.
    """
    machine = make_machine(parameters)
    period = cycles * math.tau / parameters.force_frequencies[0]
    for initial in starting_points(parameters):
        origin = origin_at(
            machine,
            0.0,
            initial.initial_primary_position,
            initial.initial_primary_velocity,
            initial.initial_damper_offset - machine.stop,
            initial.initial_damper_velocity - initial.initial_primary_velocity or 1e-9,
            0,
            0,
        )
        busy = 0
        periods = max(2 * _STARTS_PER_RUN, _SETTLING_CYCLES // cycles)
        for i in range(periods):
            course = run_course(machine, origin, period, differentiate=False)
            if course is None:
                break
            busy = busy + 1 if len(course.incidents) > most_events else 0
            if busy > _BUSY_PERIODS:
                break
            origin = course.end
            if (periods - i) % 2 == 1 and periods - i <= 2 * _STARTS_PER_RUN:
                yield section_of(machine, course, 0.0)


def carried_over(orbit: PeriodicOrbit, parameters: RigParameters) -> PeriodicOrbit | None:
    """
    Follow a motion from a simpler rig to another one.

    Parameters
    ----------
    orbit : PeriodicOrbit
        A viable motion of the rig without friction, or with the first harmonic only, or both.
    parameters : RigParameters
        The rig with friction and all harmonics.

    Returns
    -------
    PeriodicOrbit or None
        The motion with the same stops there; None if it is lost on the way.
    """
    section = section_on(orbit)
    simple = orbit.parameters.friction
    done, share = 0.0, _FIRST_SHARE
    found: PeriodicOrbit | None = None
    while done < 1.0:
        if section is None or share < _LEAST_SHARE:
            return None
        ahead = min(1.0, done + share)
        first, *others = parameters.force_amplitudes
        rig = parameters.replace(
            friction=simple + ahead * (parameters.friction - simple),
            force_amplitudes=(first, *(ahead * other for other in others)),
        )
        shot = shoot(rig, section, orbit.cycles)
        if shot is None or shot[0].stops not in _turns(orbit.stops):
            share *= 0.5
            continue
        found = shot[0]
        section = section_on(found) or shot[1]
        done, share = ahead, 1.5 * share
    return found


def _turns(stops: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [stops[i:] + stops[:i] for i in range(len(stops))]


def shot_orbits(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    simpler: Sequence[PeriodicOrbit],
    *,
    simulate: bool = True,
) -> tuple[list[PeriodicOrbit], StartReport]:
    """
    Find motions of one stop sequence with the shooting solver.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    stops : tuple of int
        Stops hit in one period.
    cycles : int
        Period in cycles of the force.
    simpler : sequence of PeriodicOrbit
        Viable motions with these stops of the rig without friction or further harmonics.
    simulate : bool, optional
        Whether simulated motion gives starts too.

    Returns
    -------
    orbits : list of PeriodicOrbit
        What was found; the same may be there more than once, and counted from any impact.
    report : StartReport
        How many starts converged.
    """
    carried = [carried_over(orbit, parameters) for orbit in simpler]
    orbits = [orbit for orbit in carried if orbit is not None]
    converged = len(orbits)
    simulated = simulated_converged = 0
    if simulate:
        # Impacts, as many reversals, and room for sticking
        most_events = 4 * len(stops) + 8
        for section in settled_sections(parameters, cycles, most_events):
            simulated += 1
            shot = shoot(parameters, section, cycles)
            if shot is not None:
                simulated_converged += 1
                if shot[0].stops in _turns(stops):
                    orbits.append(shot[0])
    return orbits, StartReport(
        stops=stops,
        method='shooting',
        starts=len(simpler),
        converged=converged,
        simulated=simulated,
        simulated_converged=simulated_converged,
        distinct=len(orbits),
    )
