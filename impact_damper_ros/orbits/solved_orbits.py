# SPDX-License-Identifier: Apache-2.0
"""
From guesses to periodic motions: nodes are read from a run of the simulator, and solved.

Newton's method keeps the nodes. A solution that the rig cannot perform, since other events come
between them, is followed with the simulator instead, and its events are the next nodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from impact_damper_ros.motion.event import Event, EventKind
from impact_damper_ros.motion.impact import bounce, rebound
from impact_damper_ros.motion.state import CHATTER_1, REST_1, REST_2, STICK
from impact_damper_ros.parameters.parameter_spec import check_kind
from impact_damper_ros.parameters.rig_parameters import RigParameters, check_rig
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.run_result import Events, Outcome

from .arguments import check_forcing, single_harmonic
from .flight_arrays import Flights, run_flights
from .flights import machine_of, moving_at_impact, rig_on
from .multipliers import velocities_of
from .orbit import AT_IMPACTS, OrbitEvent, PeriodicOrbit
from .periodic_problem import Node, PeriodicProblem, Solution, impact_nodes, last_stops
from .response import Array
from .transmissibility import Transmissibility
from .viability import LEFT

#: Most events of a period.
MOST_EVENTS = 2000
#: Number of times that the nodes are read anew if a solution has other nodes.
_MOST_LOOKS = 3


class Guess(NamedTuple):
    """Nodes of a motion, and their states and instants in the form of `PeriodicProblem`."""

    nodes: tuple[Node, ...]
    states: Array
    instants: Array


def _resting(mode: int) -> int:
    return mode if mode in (STICK, REST_1, REST_2) else 0


def _read(events: Events, mode: int) -> dict[int, Node] | None:
    """
    Return the nodes among events that begin in a mode, by their rows.

    The result is The result is None where a chatter ends without rest, or m comes to rest without
    an impact.
    """
    nodes: dict[int, Node] = {}
    kind = None
    for row, event in enumerate(events):
        before, last = mode, kind
        kind, stop, mode = EventKind(event['kind']), int(event['stop']), int(event['mode'])
        rests = kind is EventKind.REST
        if before >= CHATTER_1 and (not rests or mode >= CHATTER_1):
            return None
        if rests and before < CHATTER_1 and last is not EventKind.IMPACT:
            return None
        if not rests:
            nodes[row] = Node(kind, stop, mode)
    return nodes


def guess_along(rig: Rig, instant: float, period: float) -> Guess | None:
    """
    Return a guess of the periodic motion near that of a rig, which is run on.

    The rig is at an instant of the force, s. The period begins within a flight, or within sticking
    or rest if there is one, in which the distance from the periodic motion decays most.
    """
    start, first, here = rig.time, rig.mode, rig.sample()
    run = rig.run(start + period, most_events=MOST_EVENTS)
    if run.outcome is not Outcome.COMPLETE:
        return None
    events = run.events
    begins = np.append(start, events['time'])
    spans = np.diff(begins, append=start + period)
    modes = np.append(int(first), events['mode'])
    speeds = events['damper_velocity_after'] - events['primary_velocity_after']
    speeds = np.append(here.damper_velocity - here.primary_velocity, speeds)
    # Resting flights first, then long and fast ones
    rests = np.isin(modes, (STICK, REST_1, REST_2))
    speeds = np.abs(np.where(modes < STICK, speeds, 0.0))
    longest = spans * np.where(rests.any(), rests, speeds)
    best = int(longest.argmax())
    # A period begins in the first part of a flight, away from a reversal that may be half-way.
    begin = begins[best] + spans[best] * (0.5 if rests[best] else 0.25)
    later = rig.run(begin + period, most_events=MOST_EVENTS)
    if later.outcome is not Outcome.COMPLETE:
        return None
    events = np.concatenate([events[best:], later.events])
    read = _read(events, int(modes[best]))
    if not read or all(node.kind is not EventKind.IMPACT for node in read.values()):
        return None
    nodes = tuple(read.values())
    # The last node leads to the flight, or the support, within which the period begins
    resting, last = _resting(modes[best]), nodes[-1]
    if last.resting != resting or not (resting or last.mode == modes[best]):
        return None
    events = events[list(read)]
    instants = instant + (events['time'] - start)
    if np.diff(instants).min(initial=1.0) <= 0.0:
        return None
    mass_ratio = rig.parameters.mass_ratio
    joint = events['mode'] >= STICK
    velocity, relative = velocities_of(events, 'after', joint, mass_ratio / (1.0 + mass_ratio))
    half = 0.5 * rig.parameters.gap
    way = events['y'] + np.where(last_stops(nodes) == 1, -half, half)
    states = np.stack([events['x'], velocity, way, relative], axis=-1)
    return Guess(nodes, states, instants)


def after_impact(orbit: PeriodicOrbit, parameters: RigParameters, change: float = 0.0) -> Rig:
    """Return a rig just after the first impact of a motion, with a change of X' before it, m/s."""
    moving = moving_at_impact(
        machine_of(parameters),
        orbit.instants[0],
        orbit.stops[0],
        orbit.x[0],
        orbit.primary_velocity_before[0] + change,
        orbit.damper_velocity_before[0],
        before=True,
    )
    return rig_on(moving, parameters)


def flights_of(orbit: PeriodicOrbit) -> Flights:
    """Return the flights of one period of a motion, from just after its first impact."""
    return run_flights(after_impact(orbit, orbit.parameters), orbit.period)


def transmissibility(orbit: PeriodicOrbit) -> Transmissibility:
    """
    Return the transmissibility from the base to M in a periodic motion.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion.

    Returns
    -------
    Transmissibility
        The ratios over one period; NaN for a base at rest, and for a motion that the rig cannot
        perform.

    Raises
    ------
    TypeError
        If the motion is no `PeriodicOrbit`.
    RunawayError
        If the rig has too many events on the way.

    Examples
    --------
    >>> from impact_damper_ros import find_orbits
    >>> shaken = RigParameters(
    ...     gravity=0.0, gap=0.37, force_amplitudes=0.0, base_amplitudes=0.01
    ... )
    >>> round(transmissibility(find_orbits(shaken, (1, 2))[0]).absolute, 4)
    10.5249
    """
    check_kind(
        'orbit',
        orbit,
        PeriodicOrbit,
        'a PeriodicOrbit, such as find_orbits(parameters, (1, 2))[0]',
    )
    if not orbit.viable or not orbit.parameters.base_motion.moves:
        return Transmissibility()
    return flights_of(orbit).integrals()[0].transmissibility


def _guess_performed(orbit: PeriodicOrbit, parameters: RigParameters) -> Guess | None:
    """Return a guess from a run of a rig after the first impact of a motion."""
    rig = after_impact(orbit, parameters)
    return guess_along(rig, orbit.instants[0], orbit.period)


def guess_on(orbit: PeriodicOrbit) -> Guess | None:
    """
    Return the nodes of a known motion, its first impact first.

    The nodes of a motion with other events than impacts are read from the simulator; None if there
    are too many events.
    """
    if not orbit.events:
        return _guess_of_impacts(orbit)
    guess = _guess_performed(orbit, orbit.parameters)
    if guess is None:
        return None
    instant = orbit.instants[0]
    whole = np.round((guess.instants - instant) / orbit.period) * orbit.period
    late = np.abs(guess.instants - whole - instant)
    late[[node.kind is not EventKind.IMPACT for node in guess.nodes]] = np.inf
    first = int(np.argmin(late))
    return Guess(
        guess.nodes[first:] + guess.nodes[:first],
        np.roll(guess.states, -first, axis=0),
        np.append(guess.instants[first:], guess.instants[:first] + orbit.period) - whole[first],
    )


def _guess_of_impacts(orbit: PeriodicOrbit) -> Guess:
    velocity = np.array(orbit.primary_velocity_after)
    relative = np.array(orbit.damper_velocity_after) - velocity
    states = np.stack([np.array(orbit.x), velocity, 0.0 * velocity, relative], axis=-1)
    return Guess(impact_nodes(orbit.stops), states, np.array(orbit.instants))


def orbit_of(solution: Solution) -> PeriodicOrbit:
    """Return the periodic motion that belongs to a solution of the boundary-value problem."""
    problem = solution.problem
    rig, cycle, cycles = solution.parameters, solution.cycle, problem.cycles
    nodes, instants = problem.nodes, solution.instants.tolist()
    states, before = solution.states.tolist(), solution.before.tolist()
    share = rig.mass_ratio / (1.0 + rig.mass_ratio)
    impacts = [j for j, node in enumerate(nodes) if node.kind is EventKind.IMPACT]
    # Whole periods before the first impact are left out, since they would cost digits; so are
    # whole cycles in the phases, under one harmonic.
    period = cycles * cycle
    early = period * math.floor(instants[impacts[0]] / period)
    whole = math.floor((instants[impacts[0]] - early) / cycle) if single_harmonic(rig) else 0
    columns: dict[str, list[float]] = {name: [] for name in ('phases', *AT_IMPACTS)}
    events: list[OrbitEvent] = []
    for j, node in enumerate(nodes):
        instant = instants[j] - early
        phase = (instant / cycle - whole) % cycles
        if node.kind is not EventKind.IMPACT:
            events.append(OrbitEvent(node.kind, node.stop, phase))
            continue
        _, velocity, _, relative = before[j]
        coefficient = rig.restitution_1 if node.stop == 1 else rig.restitution_2
        restitution, _ = bounce(rig, coefficient, abs(relative))
        after, relative_after = rebound(share, restitution, velocity, relative)
        row = (
            *(phase, states[j][0], velocity, after),
            *(velocity + relative, after + relative_after),
        )
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
        if node.resting:
            rest = ((instant + float(solution.table[j, LEFT])) / cycle - whole) % cycles
            events.append(OrbitEvent(EventKind.REST, node.stop, rest))
    return PeriodicOrbit(
        parameters=rig,
        stops=problem.stops,
        cycles=cycles,
        **{name: tuple(values) for name, values in columns.items()},
        x_max=solution.x_max,
        multipliers=solution.multipliers,
        viable=solution.viable,
        reason=solution.reason,
        residual=solution.residual,
        residual_history=solution.history,
        events=tuple(events),
    )


def solve_orbit(parameters: RigParameters, guess: Guess, cycles: int) -> PeriodicOrbit | None:
    """Return the motion to which Newton's method converges, if the rig can perform it."""
    reached = _solve(parameters, guess, cycles)
    return None if reached is None else reached[0]


def _solve(
    parameters: RigParameters, guess: Guess, cycles: int
) -> tuple[PeriodicOrbit, Guess] | None:
    """Return the motion of `solve_orbit` with its nodes, states and instants."""
    for _ in range(_MOST_LOOKS):
        solution = PeriodicProblem(parameters, guess.nodes, cycles).solve(*guess[1:])
        if solution is None:
            return None
        orbit = orbit_of(solution)
        if orbit.viable:
            return orbit, Guess(guess.nodes, solution.states, solution.instants)
        again = _guess_performed(orbit, parameters)
        if again is None or again.nodes == guess.nodes:
            return None
        guess = again
    return None


def _counted_as(orbit: PeriodicOrbit, other: PeriodicOrbit | None) -> PeriodicOrbit | None:
    """Return a motion, begun at the impact that matches another motion best; None without one."""
    turned = None if other is None else other.nearest_turn(orbit)
    return None if turned is None else turned[0]


def performed_near(
    orbit: PeriodicOrbit, parameters: RigParameters
) -> tuple[PeriodicOrbit, Guess] | None:
    """Return the motion near a solution, with the same stops, that a rig performs, or None."""
    guess = _guess_performed(orbit, parameters)
    reached = None if guess is None else _solve(parameters, guess, orbit.cycles)
    if reached is None:
        return None
    counted = _counted_as(orbit, reached[0])
    return None if counted is None else (counted, reached[1])


def orbit_at(orbit: PeriodicOrbit, parameters: RigParameters) -> PeriodicOrbit | None:
    """
    Return the motion of another rig to which Newton's method converges from a motion.

    It has the same stops in the same order; other events may have come or gone. The result is None
    if no motion nearby can be performed.
    """
    guess = guess_on(orbit)
    other = None if guess is None else solve_orbit(parameters, guess, orbit.cycles)
    counted = _counted_as(orbit, other)
    if counted is None and (there := performed_near(orbit, parameters)) is not None:
        counted = there[0]
    return counted


#: Difference of angles of harmonics, rad, below which it is round-off.
_SAME_ANGLE = 1e-9


def counted_from_zero(parameters: RigParameters, angles: Sequence[float]) -> RigParameters:
    """
    Return a rig with the phases of its harmonics at the zero angle of the first.

    The periodic theory counts time from an instant at which all angles are zero; after a change of
    frequencies on a live rig there may be no such instant. `angles` are those of one instant,
    without the phases, rad. The lines of a multisine, for which there is no periodic theory, stay
    as they are.
    """
    back = (angles[0] % math.tau) / (parameters.first_harmonic[1] or math.inf)
    counted, first = {}, 0
    for group in parameters.harmonic_groups:
        if group == 'multisine':
            continue
        own = getattr(parameters, f'{group}_phases'), getattr(parameters, f'{group}_frequencies')
        phases: list[float] = []
        for j, (phase, frequency) in enumerate(zip(*own, strict=True), first):
            late = math.remainder(angles[j] - frequency * back, math.tau) if j else 0.0
            moved = abs(late) > _SAME_ANGLE
            phases.append(math.remainder(phase + late, math.tau) if moved else phase)
        counted[f'{group}_phases'] = tuple(phases)
        first += len(phases)
    return parameters.replace(**counted)


def orbit_near(
    parameters: RigParameters, impact: Event, phase: float, cycles: int
) -> PeriodicOrbit | None:
    """
    Find a periodic motion from an impact of a motion near it.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    impact : Event
        The impact.
    phase : float
        Instant of the impact in cycles of the force since its zero angle.
    cycles : int
        Period in cycles of the force.

    Returns
    -------
    PeriodicOrbit or None
        The motion to which Newton's method converges; None if it does not.

    Raises
    ------
    TypeError
        If the rig or the impact is of another kind.

    Examples
    --------
    >>> rig = Rig(RigParameters(gravity=0.0))
    >>> _ = rig.advance(2000.0)
    >>> impact = rig.advance(2007.0)[-1]
    >>> orbit_near(rig.parameters, impact, impact.time / math.tau, 1).stops
    (2, 1)
    """
    check_rig('parameters', parameters)
    check_kind('impact', impact, Event, 'an Event, one of rig.advance(time)')
    check_forcing(parameters, cycles)
    cycle = math.tau / parameters.first_harmonic[1]
    instant = cycle * (phase % cycles)
    moving = moving_at_impact(
        machine_of(parameters),
        instant,
        impact.stop,
        impact.x,
        impact.primary_velocity_after,
        impact.damper_velocity_after,
    )
    guess = guess_along(rig_on(moving, parameters), instant, cycles * cycle)
    return None if guess is None else solve_orbit(parameters, guess, cycles)
