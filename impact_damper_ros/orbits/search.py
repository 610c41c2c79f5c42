"""The search for periodic motions: which solver applies, and what its roots are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, RigParameters

from .equations import (
    Array,
    ImpactEquations,
    OrbitError,
    check_forcing,
    check_stops,
    checked_whole,
    pressed_to,
    single_harmonic,
)
from .event_map import follow_trajectory
from .flights import flight_at, machine_of
from .impact_roots import Root, many_impact_roots, one_impact_roots, two_impact_roots
from .multipliers import monodromy, multipliers_of
from .orbit import PeriodicOrbit
from .settling import starting_points
from .shooting import Section, section_of, section_on, shoot
from .viability import assumed_flights, largest_displacement, why_not_viable

#: Motions closer than this, relative to their size, are the same.
SAME = 1e-7

#: Restitution below which a chatter may have only one or two impacts before m rests.
SOFT = 0.2

#: Systematic starts for each unknown instant, three and more impacts in a period.
STARTS_PER_INSTANT = 200
#: Most systematic starts.
MOST_STARTS = 1_000_000

_SETTLING_CYCLES = 120
_STARTS_PER_RUN = 3
_MOST_EVENTS = 200
_BUSY_PERIODS = 8
_FIRST_SHARE = 0.25
_LEAST_SHARE = 1.0 / 64.0
_NUMBERS = [name for name, spec in PARAMETER_SPECS.items() if spec.kind == 'double']


@dataclass(frozen=True, kw_only=True)
class StartReport:
    """
    Statistics of the search for motions of one stop sequence.

    Attributes
    ----------
    stops : tuple of int
        The sequence.
    method : str
        'scan': every motion of the impact equations was found, without starts to count.
        'starts': the impact equations were solved from systematic starts. 'shooting': the event
        map was solved from motions of a simpler rig, without friction or with one harmonic.
    starts, converged : int
        Systematic starts, or motions of the simpler rig, and how many led to a motion.
    simulated, simulated_converged : int
        Starts taken from simulated motion, and how many converged.
    distinct : int
        Different motions found.
    """

    stops: tuple[int, ...]
    method: Literal['scan', 'starts', 'shooting']
    starts: int = 0
    converged: int = 0
    simulated: int = 0
    simulated_converged: int = 0
    distinct: int = 0

    @property
    def complete(self) -> bool:
        """Whether all motions are found, up to roots closer together than the scan."""
        return self.method == 'scan'

    @property
    def text(self) -> str:
        """The report in one line."""
        line = f'stops {",".join(map(str, self.stops))}: '
        if self.complete:
            return f'{line}all solutions, {self.distinct} found'
        line += f'{self.distinct} found; '
        if self.method == 'starts':
            share = self.converged / self.starts if self.starts else 0.0
            line += f'{self.converged} of {self.starts} ({share:.0%}) systematic starts'
        else:
            line += f'{self.converged} of {self.starts} motions of a simpler rig carried over'
        return f'{line}, {self.simulated_converged} of {self.simulated} from simulation converged'


@dataclass(frozen=True)
class OrbitSearch:
    """
    The result of a search.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        All different motions: stable and viable ones first, then viable, then the others; the
        smallest swing first within each.
    report : StartReport
        How the search went, and whether it is complete.
    """

    orbits: tuple[PeriodicOrbit, ...]
    report: StartReport


def _hits(equations: ImpactEquations, root: Root) -> bool:
    """Return whether all impacts have a speed; motion without impacts solves the equations too."""
    at = equations.velocities(root.x, root.instants)
    speeds = np.abs(at.damper_before - at.primary_before)
    scale = max(equations.length * equations.frequency, float(np.abs(at.primary_before).max()))
    return bool(speeds.min() > SAME * scale)


def counted_as(orbit: PeriodicOrbit, stops: tuple[int, ...]) -> PeriodicOrbit | None:
    """
    Return a motion with its impacts in the order of the given stops; None if it has others.

    If several orders match, the one whose first impact is earliest in the cycle of the force.
    """
    return min(orbit.turned_to(stops), key=lambda orbit: orbit.phases[0], default=None)


def _distinct(orbits: Sequence[PeriodicOrbit]) -> list[PeriodicOrbit]:
    """Return each motion once, without those that repeat within the period."""
    kept: list[PeriodicOrbit] = []
    for orbit in sorted(orbits, key=lambda orbit: orbit.residual):
        turns = list(orbit.turned_to(orbit.stops))
        if orbit.repeats(SAME):
            continue
        if not any(turn.differs(other) < SAME for turn in turns for other in kept):
            kept.append(orbit)
    kept.sort(key=lambda orbit: (not orbit.viable, not orbit.stable, orbit.x_max))
    return kept


def orbit_of(equations: ImpactEquations, root: Root) -> PeriodicOrbit:
    """Return the periodic motion that belongs to a root of the impact equations."""
    x = root.x
    # The whole cycles before the first impact do not matter, and would cost digits.
    instants = root.instants - equations.cycle * np.floor(root.instants[0] / equations.cycle)
    at = equations.velocities(x, instants)
    flights = assumed_flights(equations, x, instants, at)
    multipliers = multipliers_of(monodromy(equations, x, instants))
    reason = why_not_viable(equations, x, instants, at)
    phases = instants / equations.cycle % equations.cycles

    def row(values: Array) -> tuple[float, ...]:
        return tuple(float(value) for value in values)

    return PeriodicOrbit(
        parameters=equations.parameters,
        stops=equations.stops,
        cycles=equations.cycles,
        phases=row(phases),
        x=row(x),
        primary_velocity_before=row(at.primary_before),
        primary_velocity_after=row(at.primary_after),
        damper_velocity_before=row(at.damper_before),
        damper_velocity_after=row(at.damper_after),
        x_max=largest_displacement(flights, equations.durations(instants)),
        multipliers=multipliers,
        viable=not reason,
        reason=reason,
        residual=root.residual,
        residual_history=root.history,
    )


def within_theory(parameters: RigParameters, stops: tuple[int, ...]) -> bool:
    """Return whether friction is absent, or keeps its sign from impact to impact."""
    alternating = all(a != b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
    return alternating or machine_of(parameters).constants.grip == 0.0


def may_rest_or_reverse(parameters: RigParameters, stops: tuple[int, ...]) -> bool:
    """Return whether m is likely to reverse, stick or come to rest between these impacts."""
    both = {1: parameters.restitution_1, 2: parameters.restitution_2}
    soft = min(both[stop] for stop in stops) < SOFT
    return soft or len(stops) > 2 or machine_of(parameters).constants.grip > 0.0


def _theory(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    starts: int | None,
    simulate: bool,
) -> tuple[list[PeriodicOrbit], StartReport]:
    """Solve the impact equations."""
    equations = ImpactEquations(parameters, stops, cycles)
    report = StartReport(stops=stops, method='scan')
    if equations.impacts == 1:
        roots = one_impact_roots(equations)
    elif equations.impacts == 2:
        roots = two_impact_roots(equations)
    else:
        if starts is None:
            starts = STARTS_PER_INSTANT * (equations.impacts - 1)
        roots, (converged, simulated, simulated_converged) = many_impact_roots(
            equations, starts, simulate
        )
        report = StartReport(
            stops=stops,
            method='starts',
            starts=starts,
            converged=converged,
            simulated=simulated,
            simulated_converged=simulated_converged,
        )
    solved = (orbit_of(equations, root) for root in roots if _hits(equations, root))
    turned = (counted_as(orbit, stops) for orbit in solved)
    orbits = _distinct([orbit for orbit in turned if orbit is not None])
    return orbits, replace(report, distinct=len(orbits))


def settled_sections(
    parameters: RigParameters, cycles: int, most_events: int = _MOST_EVENTS
) -> Iterator[Section]:
    """Yield states of simulated motion, after it has had time to settle."""
    machine = machine_of(parameters)
    period = cycles * math.tau / parameters.force_frequencies[0]
    for initial in starting_points(parameters):
        flight = flight_at(
            machine,
            0.0,
            initial.initial_primary_position,
            initial.initial_primary_velocity,
            initial.initial_damper_offset - machine.constants.half_gap,
            initial.initial_damper_velocity - initial.initial_primary_velocity or 1e-9,
            0,
            0,
        )
        busy = 0
        periods = max(2 * _STARTS_PER_RUN, _SETTLING_CYCLES // cycles)
        for i in range(periods):
            trajectory = follow_trajectory(flight, period, differentiate=False)
            if trajectory is None:
                break
            busy = busy + 1 if len(trajectory.events) > most_events else 0
            if busy > _BUSY_PERIODS:
                break
            flight = trajectory.end
            if (periods - i) % 2 == 1 and periods - i <= 2 * _STARTS_PER_RUN:
                yield section_of(trajectory, 0.0)


def carried_over(orbit: PeriodicOrbit, parameters: RigParameters) -> PeriodicOrbit | None:
    """
    Follow a motion to another rig, on the straight line between the parameters.

    The rig that it starts from has the first harmonic only, or all the same.
    """
    section = section_on(orbit)
    here = {name: getattr(orbit.parameters, name) for name in _NUMBERS}
    there = {name: getattr(parameters, name) for name in _NUMBERS}
    varied = [name for name in _NUMBERS if here[name] != there[name]]
    done, share = 0.0, _FIRST_SHARE
    found: PeriodicOrbit | None = None
    while done < 1.0:
        if section is None or share < _LEAST_SHARE:
            return None
        ahead = min(1.0, done + share)
        first, *others = parameters.force_amplitudes
        rig = parameters.replace(
            force_amplitudes=(first, *(ahead * other for other in others)),
            **{name: here[name] + ahead * (there[name] - here[name]) for name in varied},
        )
        shot = shoot(rig, section, orbit.cycles)
        if shot is None or not any(shot[0].turned_to(orbit.stops)):
            share *= 0.5
            continue
        found = shot[0]
        section = section_on(found) or shot[1]
        done, share = ahead, 1.5 * share
    return found


def _shot_orbits(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    simpler: Sequence[PeriodicOrbit],
    *,
    simulate: bool = True,
) -> tuple[list[PeriodicOrbit], StartReport]:
    """Find motions of one stop sequence with the shooting solver."""
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
                if any(shot[0].turned_to(stops)):
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


def _with_first_harmonic(parameters: RigParameters) -> RigParameters:
    """Return the rig driven by the first harmonic of its force only."""
    return parameters.replace(
        force_amplitudes=parameters.force_amplitudes[:1],
        force_frequencies=parameters.force_frequencies[:1],
        force_phases=parameters.force_phases[:1],
    )


def find_orbits(
    parameters: RigParameters,
    stops: Sequence[int],
    cycles: int = 1,
    *,
    starts: int | None = None,
    simulate: bool = True,
) -> OrbitSearch:
    """
    Find the periodic motions of one stop sequence.

    Parameters
    ----------
    parameters : RigParameters
        The rig; if its force has several harmonics, they must have a common period.
    stops : sequence of int
        Stops hit in one period, in order, 1 (lower) or 2.
    cycles : int, optional
        Period in cycles of the force's first harmonic.
    starts : int, optional
        Number of systematic starts of the impact equations for three and more impacts; 200 for
        each unknown instant, if not given.
    simulate : bool, optional
        Whether to use simulated motion as starts, too.

    Returns
    -------
    OrbitSearch
        Stable and unstable, viable and other motions. For one and two impacts the list is
        complete; for more, the report gives the share of the starts that converged.

    Notes
    -----
    The impact equations cover neither flights that return to the same stop against friction nor a
    force of several harmonics. The shooting solver then starts from simulated motion and from the
    motions of the rig without friction or with the first harmonic only. With `simulate` it also
    searches for motions in which m reverses, sticks or rests. The impacts of a completed chatter
    count, up to the rest.

    Raises
    ------
    OrbitError
        If the search does not apply to the rig or to the arguments.

    Examples
    --------
    >>> found = find_orbits(RigParameters(gravity=0.0), (1, 2))
    >>> [round(phase, 6) for phase in found.orbits[0].phases]
    [0.733784, 0.233784]
    """
    stops = check_stops(parameters, stops, cycles)
    check_forcing(parameters, cycles)
    if starts is not None:
        starts = checked_whole('starts', starts, 0, MOST_STARTS)
    try:
        return _found(parameters, stops, int(cycles), starts, simulate)
    except np.linalg.LinAlgError as error:
        raise OrbitError(
            f'the equations of this rig have no solution in double precision ({error}): give '
            'masses, stiffness, damping and force within a few powers of ten of one another'
        ) from error


def _found(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    starts: int | None,
    simulate: bool,
) -> OrbitSearch:
    """Find the periodic motions of a stop sequence that has been checked."""
    orbits: list[PeriodicOrbit] = []
    if single_harmonic(parameters) and within_theory(parameters, stops):
        rig = _with_first_harmonic(parameters)
        orbits, report = _theory(rig, stops, cycles, starts, simulate)
        if not simulate or not may_rest_or_reverse(parameters, stops):
            return OrbitSearch(tuple(orbits), report)
        others, shot = _shot_orbits(rig, stops, cycles, [])
        report = replace(
            report,
            simulated=report.simulated + shot.simulated,
            simulated_converged=report.simulated_converged + shot.simulated_converged,
        )
    else:
        simple = _with_first_harmonic(parameters)
        if not within_theory(parameters, stops):
            simple = simple.replace(friction=0.0)
        known = []
        if len(set(stops)) > 1 or pressed_to(simple, stops[0]):
            solved, _ = _theory(simple, stops, cycles, starts, False)
            known = [orbit for orbit in solved if orbit.viable]
        others, report = _shot_orbits(parameters, stops, cycles, known, simulate=simulate)
    turned = [counted_as(orbit, stops) for orbit in others]
    orbits = _distinct([*orbits, *(orbit for orbit in turned if orbit is not None)])
    return OrbitSearch(tuple(orbits), replace(report, distinct=len(orbits)))
