"""The search for periodic motions: which solver applies, and what its roots are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.mode import rig_constants

from .equations import Array, ImpactEquations, check_forcing, check_stops, single_harmonic
from .impact_solver import Root, StartReport, many_impact_roots, one_impact_roots, two_impact_roots
from .multipliers import monodromy, multipliers_of
from .orbit import PeriodicOrbit
from .shooting import shot_orbits
from .viability import assumed_flights, largest_displacement, why_not_viable

__all__ = ['OrbitSearch', 'counted_as', 'find_orbits', 'orbit_of', 'within_theory']


#: Motions closer than this, relative to their size, are the same.
SAME = 1e-7

#: Restitution below which a chatter has few impacts before m rests.
SOFT = 0.2

#: Systematic starts for each unknown instant, three and more impacts in a period.
STARTS_PER_INSTANT = 200


@dataclass(frozen=True)
class OrbitSearch:
    """
    What a search found, and how it went.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        All different motions: stable and viable ones first, then viable, then the others; the
        smallest swing first within each.
    report : StartReport
        How complete the search is.
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
    Return a motion counted so that it has the stops asked for.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion.
    stops : tuple of int
        The sequence asked for.

    Returns
    -------
    PeriodicOrbit or None
        If several ways of counting do, the one whose first impact is earliest in the force's
        cycle; None if none does.
    """
    turned = [
        orbit.begun_at(shift)
        for shift in range(orbit.impacts)
        if orbit.stops[shift:] + orbit.stops[:shift] == stops
    ]
    return min(turned, key=lambda orbit: orbit.phases[0], default=None)


def _distinct(orbits: Sequence[PeriodicOrbit]) -> list[PeriodicOrbit]:
    """Return each motion once, without those that repeat within the period."""
    kept: list[PeriodicOrbit] = []
    for orbit in sorted(orbits, key=lambda orbit: orbit.residual):
        turns = [
            orbit.begun_at(shift)
            for shift in range(orbit.impacts)
            if orbit.stops[shift:] + orbit.stops[:shift] == orbit.stops
        ]
        if orbit.repeats(SAME):
            continue
        if not any(turn.differs(other) < SAME for turn in turns for other in kept):
            kept.append(orbit)
    kept.sort(key=lambda orbit: (not orbit.viable, not orbit.stable, orbit.x_max))
    return kept


def orbit_of(equations: ImpactEquations, root: Root) -> PeriodicOrbit:
    """
    Work out everything about a root of the impact equations.

    Parameters
    ----------
    equations : ImpactEquations
        The equations.
    root : Root
        Their root.
    """
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
        stable=abs(multipliers[0]) < 1.0,
        viable=not reason,
        reason=reason,
        residual=root.residual,
        residual_history=root.history,
    )


def within_theory(parameters: RigParameters, stops: tuple[int, ...]) -> bool:
    """Return whether friction keeps its sign from impact to impact, or there is none."""
    alternating = all(a != b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
    return alternating or rig_constants(parameters).grip == 0.0


def may_rest_or_reverse(parameters: RigParameters, stops: tuple[int, ...]) -> bool:
    """Return whether m is likely to reverse, stick or come to rest between these impacts."""
    both = {1: parameters.restitution_1, 2: parameters.restitution_2}
    return rig_constants(parameters).grip > 0.0 or min(both[stop] for stop in stops) < SOFT


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
        roots, report = many_impact_roots(equations, starts, simulate)
    solved = (orbit_of(equations, root) for root in roots if _hits(equations, root))
    turned = (counted_as(orbit, stops) for orbit in solved)
    orbits = _distinct([orbit for orbit in turned if orbit is not None])
    return orbits, replace(report, distinct=len(orbits))


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
        Whether simulated motion gives starts too.

    Returns
    -------
    OrbitSearch
        Stable and unstable, viable and other motions. For one and two impacts these are all
        there are; for more, the report says which share of the starts converged.

    Notes
    -----
    Flights that return to the same stop against friction, and a force of several harmonics, are
    beyond the impact equations; the shooting solver then starts from simulated motion and from
    the motions of the rig without friction or with the first harmonic only. With `simulate` it
    also looks for motions in which m reverses, sticks or rests between alternating impacts.

    Raises
    ------
    OrbitError
        If the rig has no such motions to ask for; the text holds the remedy.

    Examples
    --------
    >>> found = find_orbits(RigParameters(gravity=0.0), (1, 2))
    >>> [round(phase, 6) for phase in found.orbits[0].phases]
    [0.733784, 0.233784]
    """
    stops = tuple(stops)
    check_forcing(parameters, cycles)
    check_stops(parameters, stops, cycles)
    orbits: list[PeriodicOrbit] = []
    if single_harmonic(parameters) and within_theory(parameters, stops):
        rig = _with_first_harmonic(parameters)
        orbits, report = _theory(rig, stops, cycles, starts, simulate)
        if not simulate or not may_rest_or_reverse(parameters, stops):
            return OrbitSearch(tuple(orbits), report)
        others, _ = shot_orbits(rig, stops, cycles, [])
    else:
        simple = _with_first_harmonic(parameters)
        if not within_theory(parameters, stops):
            simple = simple.replace(friction=0.0)
        solved, _ = _theory(simple, stops, cycles, starts, False)
        known = [orbit for orbit in solved if orbit.viable]
        others, report = shot_orbits(parameters, stops, cycles, known, simulate=simulate)
    turned = [counted_as(orbit, stops) for orbit in others]
    orbits = _distinct([*orbits, *(orbit for orbit in turned if orbit is not None)])
    return OrbitSearch(tuple(orbits), replace(report, distinct=len(orbits)))
