"""
Shooting: periodic motions as fixed points of the event map.

This solver covers what the impact equations do not: flights that return to the same stop against
friction, in which friction reverses, and motions with sticking or rest. The period begins at a
fixed phase of the force, within a flight, or within a phase of sticking or rest if there is one,
since the state has fewer dimensions there: (X, X', Y) where m sticks in the
gap and (X, X') where it rests on a stop, instead of (X, X', Y, Y').
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from impact_damper_ros.rig import Event, EventKind, RigParameters
from impact_damper_ros.rig.parameter_spec import number_between
from impact_damper_ros.rig.snapshot import LATEST
from impact_damper_ros.rig.state import REST_1, REST_2, STICK

from .equations import Array, OrbitError, check_cycles, check_forcing
from .event_map import FlightPart, Trajectory, follow_trajectory
from .flights import Flight, Machine, flight_after_impact, flight_at, machine_of
from .multipliers import multipliers_of
from .orbit import OrbitEvent, PeriodicOrbit
from .viability import largest_displacement

#: Largest change of the state over a period, relative to its size.
RESIDUAL_TOLERANCE = 1e-11

# Newton's method with shorter steps where needed. `scipy.optimize.root` takes 25 % longer (192 to
# 240 ms for 15 starts) and converges from other far starts (one row of 2052 of figure 3 changes).
_NEWTON_STEPS = 30
_LEAST_PART = 1.0 / 256.0

# Deviations of (X, X', Y, Y') from those of (X, X', Z, Z')
_RELATIVE = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]]
)
_ABSOLUTE = np.linalg.inv(_RELATIVE)


@dataclass(frozen=True)
class Section:
    """
    A state at which a period begins.

    Attributes
    ----------
    instant : float
        Time on the force's clock, s.
    resting : int
        The mode `STICK`, `REST_1` or `REST_2`, or 0 if m moves relative to M.
    last_stop : int
        The stop hit last.
    state : ndarray, shape (4,), (3,) or (2,)
        As many of (X, X', Y - d/2, Y') as are free.
    """

    instant: float
    resting: int
    last_stop: int
    state: Array

    @property
    def dimension(self) -> int:
        """Number of free coordinates."""
        return {0: 4, STICK: 3}.get(self.resting, 2)

    def flight(self, machine: Machine, state: Array) -> Flight:
        """Return the flight from a state of this section."""
        x, velocity, beyond, relative_velocity = (*(float(v) for v in state), 0.0, 0.0)[:4]
        return flight_at(
            machine,
            self.instant,
            x,
            velocity,
            beyond,
            relative_velocity,
            self.resting,
            self.last_stop,
        )


def _state_of(flight: Flight) -> Array:
    """Return (X, X', Y - d/2, Y')."""
    run = flight.run
    return np.array([run.x, run.velocity, -run.clearance_1, run.relative_velocity])


def _resting(flight: Flight) -> int:
    return flight.run.mode if flight.run.mode in (STICK, REST_1, REST_2) else 0


def _promise(part: FlightPart) -> tuple[int, float]:
    """Rate a flight as a place to begin a period: resting first, then long and fast."""
    if _resting(part.flight):
        return 1, part.duration
    if part.flight.run.joint:
        return 0, 0.0
    return 0, part.duration * abs(part.flight.run.relative_velocity)


def section_of(trajectory: Trajectory, instant: float) -> Section:
    """Choose where the period of a motion that starts at an instant (s) begins."""
    best = max(trajectory.flights, key=_promise)
    resting = _resting(best.flight)
    # In flight closer to its beginning, away from a reversal that may be half-way
    tau = best.duration * (0.5 if resting else 0.25)
    there = best.flight.after(tau)
    section = Section(instant + best.start + tau, resting, there.run.last_stop, np.empty(0))
    return replace(section, state=_state_of(there)[: section.dimension])


def _section_after(
    parameters: RigParameters,
    period: float,
    instant: float,
    stop: int,
    x: float,
    velocity: float,
    damper_velocity: float,
) -> Section | None:
    """Choose where the period begins of a motion with an impact, from the state just after it."""
    machine = machine_of(parameters)
    flight = flight_after_impact(machine, instant, stop, x, velocity, damper_velocity)
    trajectory = follow_trajectory(flight, period)
    return None if trajectory is None else section_of(trajectory, instant)


def section_on(orbit: PeriodicOrbit) -> Section | None:
    """
    Choose where the period of a known motion begins.

    Parameters
    ----------
    orbit : PeriodicOrbit
        A motion with impacts, viable or nearly so.

    Returns
    -------
    Section or None
        None if the simulator cannot follow it.
    """
    return _section_after(
        orbit.parameters,
        orbit.period,
        orbit.instants[0],
        orbit.stops[0],
        orbit.x[0],
        orbit.primary_velocity_after[0],
        orbit.damper_velocity_after[0],
    )


@dataclass(frozen=True)
class _Shot:
    """One run over a period: the change of the state, its derivative, and the trajectory."""

    change: Array
    matrix: Array
    trajectory: Trajectory


def _shot(machine: Machine, section: Section, state: Array, period: float) -> _Shot | None:
    flight = section.flight(machine, state)
    if _resting(flight) != section.resting:
        return None
    # Through hundreds of impacts a derivative may grow beyond all numbers
    with np.errstate(over='ignore', invalid='ignore'):
        trajectory = follow_trajectory(flight, period)
    if trajectory is None or _resting(trajectory.end) != section.resting:
        return None
    if not np.isfinite(trajectory.matrix).all():
        return None
    n = section.dimension
    matrix = _RELATIVE @ trajectory.matrix @ _ABSOLUTE
    return _Shot(_state_of(trajectory.end)[:n] - state, matrix[:n, :n], trajectory)


def follow_section(
    machine: Machine, section: Section, period: float
) -> tuple[Array, Array] | None:
    """Return the change of a section's state over a period, and the map's derivative."""
    shot = _shot(machine, section, section.state, period)
    return None if shot is None else (shot.change, shot.matrix)


def orbit_on(
    parameters: RigParameters, section: Section, cycles: int, history: tuple[float, ...]
) -> PeriodicOrbit:
    """Return the periodic motion through a state that is known to be a fixed point."""
    period = cycles * math.tau / parameters.force_frequencies[0]
    shot = _shot(machine_of(parameters), section, section.state, period)
    if shot is None:
        raise ArithmeticError('the motion changes its kind where the period begins')
    return _orbit(parameters, section, cycles, shot, history)


def shoot(
    parameters: RigParameters, section: Section, cycles: int
) -> tuple[PeriodicOrbit, Section] | None:
    """
    Find the periodic motion near a state by Newton's method on the event map.

    Parameters
    ----------
    parameters : RigParameters
        The rig; the period is counted in cycles of the force's first harmonic.
    section : Section
        Where to begin.
    cycles : int
        Period in cycles of the force.

    Returns
    -------
    orbit : PeriodicOrbit
        The motion; it is viable, since it is computed by the simulator.
    section : Section
        Its state where the period begins. The result is None if the method does not converge.

    Raises
    ------
    OrbitError
        If the force does not repeat within the period.
    """
    cycles = check_cycles(cycles)
    check_forcing(parameters, cycles)
    machine = machine_of(parameters)
    cycle = math.tau / parameters.force_frequencies[0]
    state = section.state
    if np.shape(state) != (section.dimension,) or not np.isfinite(state).all():
        raise OrbitError(
            f'the state of the section is {state}: give {section.dimension} finite numbers, such '
            'as those of section_on'
        )
    shot = _shot(machine, section, state, cycles * cycle)
    history: list[float] = []
    if shot is None:
        return None
    rate = parameters.omega

    def size(change: Array, at: Array) -> float:
        length = max(abs(parameters.force_amplitudes[0]) / parameters.stiffness, abs(at[0]))
        units = np.array([length, rate * length, length, rate * length])[: len(change)]
        return float(np.abs(change / units).max())

    best = size(shot.change, state)
    for _ in range(_NEWTON_STEPS):
        history.append(best)
        if best == 0.0:
            break
        step = np.linalg.lstsq(np.eye(len(state)) - shot.matrix, shot.change, rcond=1e-14)[0]
        part = 1.0
        better = None
        while part >= _LEAST_PART:
            trial = _shot(machine, section, state + part * step, cycles * cycle)
            if trial is not None and size(trial.change, state + part * step) < best:
                better = trial
                break
            part *= 0.25
        if better is None:
            break
        state, shot = state + part * step, better
        best = size(shot.change, state)
    history.append(best)
    if best > RESIDUAL_TOLERANCE or shot.trajectory.end.run.last_stop != section.last_stop:
        return None
    settled = replace(section, state=state)
    return _orbit(parameters, settled, cycles, shot, tuple(history)), settled


def _orbit(
    parameters: RigParameters,
    section: Section,
    cycles: int,
    shot: _Shot,
    history: tuple[float, ...],
) -> PeriodicOrbit:
    """Return the periodic motion of a fixed point."""
    cycle = math.tau / parameters.force_frequencies[0]
    events = shot.trajectory.events
    impacts = [i for i in events if i.kind is EventKind.IMPACT]
    first = impacts[0].time if impacts else 0.0
    whole = cycle * math.floor((section.instant + first) / cycle)

    def phase(time: float) -> float:
        return ((section.instant - whole) + time) / cycle % cycles

    flights = shot.trajectory.flights
    multipliers = multipliers_of(shot.matrix) + (0j,) * (4 - section.dimension)
    return PeriodicOrbit(
        parameters=parameters,
        stops=tuple(i.stop for i in impacts),
        cycles=cycles,
        phases=tuple(phase(i.time) for i in impacts),
        x=tuple(i.x for i in impacts),
        primary_velocity_before=tuple(i.primary_velocity_before for i in impacts),
        primary_velocity_after=tuple(i.primary_velocity_after for i in impacts),
        damper_velocity_before=tuple(i.damper_velocity_before for i in impacts),
        damper_velocity_after=tuple(i.damper_velocity_after for i in impacts),
        x_max=largest_displacement(
            (part.flight for part in flights), (part.duration for part in flights)
        ),
        multipliers=multipliers,
        viable=True,
        reason='',
        residual=history[-1],
        residual_history=history,
        events=tuple(
            OrbitEvent(i.kind, i.stop, phase(i.time))
            for i in events
            if i.kind is not EventKind.IMPACT
        ),
    )


def orbit_near(
    parameters: RigParameters, impact: Event, phase: float, cycles: int
) -> PeriodicOrbit | None:
    """
    Find a periodic motion by shooting from the state just after an impact.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    impact : Event
        The impact.
    phase : float
        Its instant in cycles of the force since its zero angle.
    cycles : int
        Period in cycles of the force.

    Returns
    -------
    PeriodicOrbit or None
        The motion to which Newton's method converges; None if it does not.
    """
    phase = number_between('phase', phase, -LATEST, LATEST)
    cycles = check_cycles(cycles)
    check_forcing(parameters, cycles)
    cycle = math.tau / parameters.force_frequencies[0]
    section = _section_after(
        parameters,
        cycles * cycle,
        cycle * (phase % cycles),
        impact.stop,
        impact.x,
        impact.primary_velocity_after,
        impact.damper_velocity_after,
    )
    shot = None if section is None else shoot(parameters, section, cycles)
    return None if shot is None else shot[0]
