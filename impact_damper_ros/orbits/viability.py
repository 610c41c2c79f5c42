"""
Viability: whether the rig can perform a solution of the impact equations.

The equations hold at the impacts only. Here the flights between them are checked in closed form:
by the first event of the simulator and, to quantify a violation, by the exact extremes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple

from impact_damper_ros.rig.first_event import first_root
from impact_damper_ros.rig.flight import CONTACT_1, CONTACT_2, NO_EVENT, REVERSAL, oscillator_of
from impact_damper_ros.rig.oscillator import POINTS
from impact_damper_ros.rig.state import FREE, SLIDE_DOWN, SLIDE_UP, STICK

from .equations import Array, ImpactEquations, ImpactVelocities
from .flights import Flight, flight_after_impact, machine_of

#: Where the search goes on after a turning point, in steps of the grid: displacements between two
#: that are closer do not differ.
_BEYOND = 1e-5


class Extremes(NamedTuple):
    """
    Least and largest value of a displacement in a flight, and when.

    Displacements in m, times since the flight's origin in s.
    """

    low: float
    low_time: float
    high: float
    high_time: float


def _turning_times(flight: Flight, duration: float, relative: bool) -> Iterator[float]:
    """Yield the times at which X or, if `relative`, Y turns, in order, by the certified search."""
    there = flight.copy()
    run, waves, machine = there.run, there.waves, there.machine
    if not relative:
        # As seen from M, an m that hangs still moves by -X.
        run.relative_velocity, run.relative_acceleration = -run.velocity, -run.acceleration
    step = oscillator_of(machine.constants, run).step
    tau, run.direction = 0.0, 0
    while tau < duration:
        motion = there.motion(tau)
        if run.direction == 0:
            rates = motion.relative_velocity, motion.relative_2, -motion.x_3
            leading = next((rate for rate in rates if rate != 0.0), 0.0)
            if leading == 0.0:
                return
            run.direction = 1 if leading > 0.0 else -1
        end = min(tau + POINTS * step, duration)
        root = first_root(*machine, run, waves, REVERSAL, tau, motion, end, step)
        tau = end
        if root < inf:
            yield root
            run.direction, tau = 0, root + _BEYOND * step


def extremes(flight: Flight, duration: float, *, relative: bool) -> Extremes:
    """Return the least and largest X of a flight or, if `relative`, of Y - Y(origin)."""
    points = [0.0, duration, *_turning_times(flight, duration, relative)]
    motions = [(flight.motion(tau), tau) for tau in points]
    values = [(m.travel if relative else m.x, tau) for m, tau in motions]
    (low, low_time), (high, high_time) = min(values), max(values)
    return Extremes(low, low_time, high, high_time)


#: How much earlier than assumed, as a share of the period, an impact counts as another one.
TIME_TOLERANCE = 1e-7

_MODE_OF_DIRECTION = {0: FREE, 1: SLIDE_DOWN, -1: SLIDE_UP}


def assumed_flights(
    equations: ImpactEquations, x: Array, instants: Array, at: ImpactVelocities
) -> list[Flight]:
    """Return the flights after each impact, in the mode that the equations assume."""
    machine = machine_of(equations.parameters)
    flights = []
    for i, stop in enumerate(equations.stops):
        velocities = float(at.primary_after[i]), float(at.damper_after[i])
        flight = flight_after_impact(machine, float(instants[i]), stop, float(x[i]), *velocities)
        direction = equations.directions[i] if machine.constants.grip > 0.0 else 0
        flight.run.mode = _MODE_OF_DIRECTION[direction]
        flights.append(flight.begun())
    return flights


def largest_displacement(flights: Iterable[Flight], durations: Iterable[float]) -> float:
    """Return the largest |X| over flights, from their turning points, m."""
    largest = 0.0
    for flight, duration in zip(flights, durations, strict=True):
        swing = extremes(flight, float(duration), relative=False)
        largest = max(largest, -swing.low, swing.high)
    return largest


def _after_impact(flight: Flight, incoming: float, before: float) -> str:
    """Return why m does not leave the stop as assumed; empty if it does."""
    stop, mode = flight.run.last_stop, flight.struck(before, incoming).run.mode
    if mode == flight.run.mode:
        return ''
    if mode >= STICK:
        return f'stays on stop {stop} after the impact, its speed {abs(incoming):.4g} m/s there'
    return f'leaves stop {stop} against the friction assumed'


def _in_flight(flight: Flight, duration: float, end: int, tolerance: float) -> str:
    """Return what happens in a flight before its impact; empty if nothing does."""
    start = flight.run.last_stop
    kind, tau = flight.first_event(duration + tolerance)
    contact = CONTACT_1 if end == 1 else CONTACT_2
    if kind == NO_EVENT or tau > duration + tolerance:
        return ''
    if kind == contact and tau >= duration - tolerance:
        return ''
    route = f'between the impacts on stop {start} and stop {end}'
    when = f'{tau:.6g} s after the former'
    travel = extremes(flight, duration, relative=True)
    across = 2.0 * flight.machine.constants.half_gap
    # Distance beyond stop 1 and stop 2
    beyond_1 = travel.high - (0.0 if start == 1 else across)
    beyond_2 = -travel.low - (across if start == 1 else 0.0)
    if kind == REVERSAL:
        return (
            f'm turns back {route}, {when} and {abs(flight.motion(tau).travel):.4g} m from '
            f'stop {start}: friction changes sign there'
        )
    hit = 1 if kind == CONTACT_1 else 2
    beyond = max(beyond_1 if hit == 1 else beyond_2, 0.0)
    return f'm would pass stop {hit} by {beyond:.4g} m {route}, first {when}: another impact'


def why_not_viable(
    equations: ImpactEquations, x: Array, instants: Array, at: ImpactVelocities
) -> str:
    """Return why the rig cannot perform a motion; empty if it can."""
    durations = equations.durations(instants)
    tolerance = TIME_TOLERANCE * equations.period
    incoming = at.damper_before - at.primary_before
    faults = []
    for i, flight in enumerate(assumed_flights(equations, x, instants, at)):
        stop = equations.stops[i]
        towards = 1.0 if stop == 1 else -1.0
        if towards * incoming[i] <= 0.0:
            faults.append(
                f'm would reach stop {stop} from beyond it, with a relative velocity of '
                f'{incoming[i]:.4g} m/s (it must be {"positive" if stop == 1 else "negative"})'
            )
            continue
        fault = _after_impact(flight, float(incoming[i]), float(at.primary_before[i]))
        if fault:
            faults.append(f'm {fault}')
            continue
        end = equations.stops[(i + 1) % equations.impacts]
        faults.append(_in_flight(flight, float(durations[i]), end, tolerance))
    return '; '.join(fault for fault in faults if fault)
