# SPDX-License-Identifier: Apache-2.0
"""The search for periodic motions: the solver that applies, and its roots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple, Self

import numpy as np

from impact_damper_ros.parameters.parameter_spec import ParameterError, whole_number
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
    check_rig,
    slowness,
)
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Outcome
from impact_damper_ros.rig.snapshot import Snapshot

from .arguments import (
    OrbitError,
    check_forcing,
    check_stops,
    first_turn,
    mirrored_stops,
    pressed_to,
    repeats_after,
    single_harmonic,
    symmetric,
)
from .flights import Machine, machine_of
from .orbit import AT_IMPACTS, PeriodicOrbit
from .solved_orbits import after_impact, guess_along, orbit_at, orbit_of, solve_orbit
from .starts import ImpactEquations, impact_roots

#: Motions closer than this, relative to their size, are one.
SAME = 1e-7

#: Largest difference of the largest |X| of one motion, which is compared first.
_ALIKE = 1e-4

#: Restitution below which a chatter may have only one or two impacts before m rests.
SOFT = 0.2

#: Systematic starts for each unknown instant, three and more impacts in a period.
STARTS_PER_INSTANT = 200
#: Longest period, in cycles of the force.
MOST_CYCLES = 1000

_SETTLING_CYCLES = 120
_STARTS_PER_RUN = 3
#: Most events of a period, on average, of a rig that is run, over the first number of periods.
_MOST_EVENTS = 200
_FIRST_PERIODS = 10
#: Changes of the velocity of M by which a rig leaves an unstable motion, as shares of Xmax Omega:
#: large ones for slow departures, small ones where another motion is near.
_CHANGES = 1e-2, -1e-2, 1e-4, -1e-4
_FIRST_SHARE = 0.25
_LEAST_SHARE = 1.0 / 64.0
_NUMBERS = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind == 'double' and name != 'restitution_speed'
]


class StartReport(NamedTuple):
    """
    The starts of a search for the motions of one stop sequence.

    Attributes
    ----------
    complete : bool
        Whether all motions are found, up to roots closer together than the scan: one or two
        impacts with a constant restitution, one harmonic, and no reversal, sticking or rest
        between them.
    starts : int
        Guesses from which Newton's method began, but for those of the scan: systematic ones,
        motions of a simpler rig, without friction or with one harmonic, and simulated motion.
    converged : int
        Number of starts that led to a motion, with these or other stops.

    Examples
    --------
    >>> find_orbits(RigParameters(gravity=0.0), (1, 2)).report.complete
    True
    """

    complete: bool
    starts: int = 0
    converged: int = 0

    def with_those_of(self, other: Self) -> Self:
        """Return the report with the starts of another search for the same motions."""
        complete = self.complete or other.complete
        return type(self)(complete, self.starts + other.starts, self.converged + other.converged)

    def with_guesses(self, orbits: Sequence[PeriodicOrbit | None]) -> Self:
        """Return the report with further starts, given the motions to which they led."""
        reached = len(orbits) - orbits.count(None)
        return self._replace(starts=self.starts + len(orbits), converged=self.converged + reached)


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

    Examples
    --------
    >>> search = find_orbits(RigParameters(gravity=0.0), (1, 2))
    >>> len(search), [orbit.stable for orbit in search], search.report.complete
    (2, [True, False], True)
    """

    orbits: tuple[PeriodicOrbit, ...]
    report: StartReport

    def __len__(self) -> int:
        """Return the number of motions."""
        return len(self.orbits)

    def __getitem__(self, place: int) -> PeriodicOrbit:
        """Return a motion by its place."""
        return self.orbits[place]

    def __iter__(self) -> Iterator[PeriodicOrbit]:
        """Return an iterator over the motions."""
        return iter(self.orbits)


def counted_as(orbit: PeriodicOrbit, stops: tuple[int, ...]) -> PeriodicOrbit | None:
    """
    Return a motion with its impacts in the order of the given stops; None if it has other stops.

    If several orders match, the one whose first impact is earliest in the cycle of the force.
    """
    shifts = orbit.shifts(stops)
    first = min(shifts, key=lambda shift: orbit.phases_from(shift)[0], default=None)
    return None if first is None else orbit.begun_at(first)


def _distinct(
    orbits: Iterable[PeriodicOrbit | None], stops: tuple[int, ...]
) -> list[PeriodicOrbit]:
    """Return each motion with these stops once, without those that repeat within the period."""
    turned = [orbit and counted_as(orbit, stops) for orbit in orbits]
    kept: list[PeriodicOrbit] = []
    for orbit in sorted(filter(None, turned), key=lambda orbit: orbit.residual):
        if orbit.repeats(SAME):
            continue
        alike = (o for o in kept if abs(o.x_max - orbit.x_max) <= _ALIKE * orbit.x_max)
        if not any(orbit.distance(other) < SAME for other in alike):
            kept.append(orbit)
    kept.sort(key=lambda orbit: (not orbit.viable, not orbit.stable, orbit.x_max))
    return kept


def within_theory(grip: float, stops: tuple[int, ...]) -> bool:
    """Return whether friction is absent, or keeps its sign from impact to impact."""
    alternating = all(a != b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
    return alternating or grip == 0.0


def may_rest_or_reverse(machine: Machine, stops: tuple[int, ...]) -> bool:
    """Return whether m is likely to reverse, stick or come to rest between these impacts."""
    constants = machine.constants
    both = {1: constants.restitution_1, 2: constants.restitution_2}
    soft = min(both[stop] for stop in stops) < SOFT
    return soft or len(stops) > 2 or constants.grip > 0.0


def is_scanned(machine: Machine, stops: tuple[int, ...]) -> bool:
    """Return whether the scan of the impact equations finds all motions with these impacts."""
    falls = machine.constants.restitution_slowness > 0.0
    return not falls and not may_rest_or_reverse(machine, stops)


def _theory(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    starts: int | None,
    *,
    viable: bool = False,
) -> tuple[list[PeriodicOrbit], StartReport]:
    """Return the motions of the impact equations, or the viable ones only, and the starts."""
    complete, count = is_scanned(machine_of(parameters), stops), None
    equations = ImpactEquations(parameters, stops, cycles)
    if equations.impacts > 2:
        count = STARTS_PER_INSTANT * (equations.impacts - 1) if starts is None else starts
    roots, converged = impact_roots(equations, count, viable=viable)
    return _distinct(map(orbit_of, roots), stops), StartReport(complete, count or 0, converged)


def starting_rigs(parameters: RigParameters) -> Iterator[Rig]:
    """
    Yield rigs that may settle into different motions.

    They start at rest, displaced, moving fast, or with m next to a stop, scaled by the response
    without impacts and the gap as far as that is admissible.
    """
    static = abs(parameters.first_harmonic[0]) / parameters.stiffness
    amplitude = min(parameters.response_amplitude, 5.0 * static)
    speed = amplitude * parameters.first_harmonic[1]
    half = 0.5 * parameters.gap
    limit = INITIAL_SPECS['initial_primary_velocity'].high
    assert limit is not None
    for x, velocity, offset in (
        (1.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (-0.5, 1.0, 0.9),
        (0.3, -2.0, -0.9),
        (2.0, 1.0, 0.3),
    ):
        place = (
            half - min(half, abs(offset) * amplitude) if parameters.one_sided else offset * half
        )
        with suppress(ParameterError):
            initial = InitialConditions(
                initial_primary_position=max(-limit, min(limit, x * amplitude)),
                initial_primary_velocity=max(-limit, min(limit, velocity * speed)),
                initial_damper_offset=place,
            )
            yield Rig(parameters, initial, compiled=None)


def _looks(rig: Rig, cycles: int) -> Iterator[tuple[int, Snapshot]]:
    """
    Run a rig until it may have settled; yield its last states, and the cycles that each follows.

    The states are whole numbers of periods apart. A rig with too many events is left out.
    """
    period = cycles * math.tau / rig.parameters.first_harmonic[1]
    last = max(2 * _STARTS_PER_RUN, _SETTLING_CYCLES // cycles) - 1
    looks = range(last - 2 * (_STARTS_PER_RUN - 1), last + 1, 2)
    done = 0
    for periods in sorted({min(_FIRST_PERIODS, looks[0]), *looks}):
        most = (periods - done) * _MOST_EVENTS
        run = rig.run(periods * period, record=False, most_events=most)
        if run.outcome is not Outcome.COMPLETE:
            break
        done = periods
        if periods in looks:
            yield periods * cycles, rig.state()


def _motion_near(state: Snapshot, instant: float, cycles: int) -> PeriodicOrbit | None:
    """Return the motion near a state at an instant of its force (s), or None."""
    rig = Rig.resume(state, compiled=None)
    parameters = rig.parameters
    guess = guess_along(rig, instant, cycles * math.tau / parameters.first_harmonic[1])
    return None if guess is None else solve_orbit(parameters, guess, cycles)


@lru_cache(maxsize=4)
def _settled_states(parameters: RigParameters, cycles: int) -> tuple[tuple[int, Snapshot], ...]:
    """Return the states of `_looks` of all `starting_rigs`."""
    return tuple(look for rig in starting_rigs(parameters) for look in _looks(rig, cycles))


# For all stop sequences
@lru_cache(maxsize=4)
def settled_orbits(parameters: RigParameters, cycles: int) -> tuple[PeriodicOrbit | None, ...]:
    """Return the motions near simulated motion, of `starting_rigs`; None where there is none."""
    # Short periods of all lengths are sought from the same states
    short = 2 * _STARTS_PER_RUN * cycles <= _SETTLING_CYCLES
    cycle = math.tau / parameters.first_harmonic[1]
    return tuple(
        _motion_near(state, done % cycles * cycle, cycles)
        for done, state in _settled_states(parameters, 1 if short else cycles)
    )


def _left_for(orbit: PeriodicOrbit, cycles: int) -> Iterator[PeriodicOrbit | None]:
    """Yield the orbits that a rig reaches from an unstable one by small changes of velocity."""
    rate = orbit.parameters.first_harmonic[1]
    for change in _CHANGES:
        rig = after_impact(orbit, orbit.parameters, change * orbit.x_max * rate)
        for _, state in _looks(rig, cycles):
            yield _motion_near(state, orbit.instants[0], cycles)


def _repeat(
    parameters: RigParameters, stops: tuple[int, ...], cycles: int, starts: int | None
) -> Iterator[PeriodicOrbit]:
    """Yield the motions of which some periods have these stops, as before a period doubling."""
    for times in range(2, len(stops) + 1):
        word, k = stops[: len(stops) // times], cycles // times
        if word * times == stops and k * times == cycles and repeats_after(parameters, k):
            yield from _orbits_with(parameters, word, k, starts, simulate=True).orbits


def carried_over(orbit: PeriodicOrbit, parameters: RigParameters) -> PeriodicOrbit | None:
    """
    Follow a motion to another rig, on the straight line between the parameters.

    The rig of the motion has the first harmonic only, or the same harmonics.
    """
    start = {name: getattr(orbit.parameters, name) for name in _NUMBERS}
    end = {name: getattr(parameters, name) for name in _NUMBERS}
    varied = [name for name in _NUMBERS if start[name] != end[name]]
    slow = orbit.parameters.restitution_slowness, parameters.restitution_slowness
    done, share, latest = 0.0, _FIRST_SHARE, orbit
    while done < 1.0:
        if share < _LEAST_SHARE:
            return None
        ahead = min(1.0, done + share)
        rig = parameters.replace(
            **_with_share_of_others(parameters, ahead),
            **{name: start[name] + ahead * (end[name] - start[name]) for name in varied},
            restitution_speed=slowness(slow[0] + ahead * (slow[1] - slow[0])),
        )
        moved = orbit_at(latest, rig)
        if moved is None:
            share *= 0.5
            continue
        latest, done, share = moved, ahead, 1.5 * share
    return latest


def _followed_orbits(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    simpler: Sequence[PeriodicOrbit],
    present: Sequence[PeriodicOrbit] = (),
    *,
    starts: int | None = None,
    simulate: bool = True,
) -> list[PeriodicOrbit | None]:
    """
    Return the motion of each guess: motions of a simpler rig with these stops, and simulation.

    Runs are simulated from several starting points, and from near the unstable motions so far and
    those that repeat within the period, next to which the rig often performs another motion.
    """
    orbits = [carried_over(orbit, parameters) for orbit in simpler]
    if simulate:
        orbits += settled_orbits(parameters, cycles)
        left = _distinct([*present, *orbits], stops)
        for orbit in (*left, *_repeat(parameters, stops, cycles, starts)):
            if orbit.viable and orbit.unstable:
                orbits += _left_for(orbit, cycles)
    return orbits


def _with_first_harmonic(parameters: RigParameters) -> RigParameters:
    """Return the rig driven by the first harmonic of its force only."""
    return parameters.replace(**_with_share_of_others(parameters, 0.0))


def _with_share_of_others(parameters: RigParameters, share: float) -> dict[str, Any]:
    """Return the amplitudes of force and base with a share of all harmonics but the first."""
    amplitudes: dict[str, Any] = {}
    for group in parameters.harmonic_groups:
        own = getattr(parameters, f'{group}_amplitudes')
        kept = 0 if amplitudes else 1
        amplitudes[f'{group}_amplitudes'] = (*own[:kept], *(share * a for a in own[kept:]))
    return amplitudes


def _simpler_orbits(
    parameters: RigParameters, stops: tuple[int, ...], cycles: int, starts: int | None
) -> Iterator[PeriodicOrbit]:
    """
    Yield the motions with these stops of the rig without friction or with the first harmonic only.

    The period of several harmonics may contain several periods of the first, any of which may come
    first.
    """
    simple, single = _with_first_harmonic(parameters), single_harmonic(parameters)
    if not within_theory(machine_of(parameters).constants.grip, stops):
        simple = simple.replace(friction=0.0)
    machine = machine_of(simple)
    for times in range(1, 2 if single else cycles + 1):
        word, k = stops[: len(stops) // times], cycles // times
        if word * times != stops or k * times != cycles:
            continue
        if len(set(word)) == 1 and not pressed_to(machine, word[0]):
            continue
        for orbit in _theory(simple, word, k, starts, viable=True)[0]:
            for first in range(1 if single else k):
                phases = (first + k * i + phase for i in range(times) for phase in orbit.phases)
                columns = {name: getattr(orbit, name) * times for name in ('stops', *AT_IMPACTS)}
                inside = tuple(phase % cycles for phase in phases)
                yield replace(orbit, cycles=cycles, phases=inside, **columns)


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
        each unknown instant, if not given. A symmetric rig is searched for the stops of the mirror
        images, too.
    simulate : bool, optional
        Whether to use simulated motion as starts, too.

    Returns
    -------
    OrbitSearch
        Stable and unstable, viable and other motions. For one and two impacts the list is
        complete; for more, the report gives the share of the starts that converged.

    Notes
    -----
    Where restitution falls with the speed, the starts are motions with constant restitutions from
    that of slow impacts down, and simulated motion; the list is complete for one constant only.
    The impact equations cover neither flights that return to the same stop against friction nor a
    force of several harmonics. The search then starts from simulated motion and from the
    motions of the rig without friction or with the first harmonic only. With `simulate` it also
    looks for motions in which m reverses, sticks or rests. The impacts of a completed chatter
    count, up to the rest.

    Raises
    ------
    OrbitError
        If the search does not apply to the rig or to the arguments.
    TypeError
        If `parameters` is no `RigParameters`.

    Examples
    --------
    >>> search = find_orbits(RigParameters(gravity=0.0), (1, 2))
    >>> [round(phase, 6) for phase in search[0].phases]
    [0.733784, 0.233784]
    >>> [orbit.stable for orbit in search]
    [True, False]
    """
    check_rig('parameters', parameters)
    stops = check_stops(parameters, stops)
    cycles = whole_number('cycles', cycles, 1, MOST_CYCLES)
    if starts is not None:
        starts = whole_number('starts', starts, 0, 10_000_000)
    check_forcing(parameters, cycles)
    mirrored = first_turn(mirrored_stops(stops))
    try:
        found = _orbits_with(parameters, stops, cycles, starts, simulate)
        if mirrored == first_turn(stops) or not symmetric(machine_of(parameters)):
            return found
        # Each of the two searches misses some motions of which the other finds the mirror images.
        other = _orbits_with(parameters, mirrored, cycles, starts, simulate)
        orbits = _distinct([*found, *(orbit.mirror_image() for orbit in other)], stops)
        return OrbitSearch(tuple(orbits), found.report.with_those_of(other.report))
    except np.linalg.LinAlgError as error:
        raise OrbitError(
            f'the equations of this rig have no solution in double precision ({error}): give '
            'masses, stiffness, damping and force within a few powers of ten of one another'
        ) from error


# The cache also serves searches of multiples.
@lru_cache(maxsize=32)
def _orbits_with(
    parameters: RigParameters,
    stops: tuple[int, ...],
    cycles: int,
    starts: int | None,
    simulate: bool,
) -> OrbitSearch:
    """Find the periodic motions of a stop sequence that has been checked."""
    orbits: list[PeriodicOrbit] = []
    simpler: list[PeriodicOrbit] = []
    report, machine = StartReport(complete=False), machine_of(parameters)
    if single_harmonic(parameters) and within_theory(machine.constants.grip, stops):
        parameters = _with_first_harmonic(parameters)
        orbits, report = _theory(parameters, stops, cycles, starts)
        if not simulate or is_scanned(machine, stops):
            return OrbitSearch(tuple(orbits), report)
    else:
        simpler = list(_simpler_orbits(parameters, stops, cycles, starts))
    others = _followed_orbits(
        parameters, stops, cycles, simpler, orbits, starts=starts, simulate=simulate
    )
    orbits += filter(None, others)
    if symmetric(machine):
        images = (orbit.mirror_image() for orbit in orbits if orbit.shifts(mirrored_stops(stops)))
        orbits += list(images)
    return OrbitSearch(tuple(_distinct(orbits, stops)), report.with_guesses(others))
