"""
Viability: whether the rig can perform a solution of the impact equations.

The equations hold at the impacts only. Here the flights between them are checked in closed form:
by the first event of the simulator and, to quantify a violation, by the exact extremes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from impact_damper_ros.rig.certificate import safe_step
from impact_damper_ros.rig.contact import first_event
from impact_damper_ros.rig.flight import (
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    REVERSAL,
    Flight,
    Motion,
    motion_at,
)
from impact_damper_ros.rig.mode import (
    FREE,
    SLIDE_DOWN,
    SLIDE_UP,
    STICK,
    RigConstants,
    launch,
    rig_constants,
)
from impact_damper_ros.rig.origin import Origin
from impact_damper_ros.rig.oscillator import derivative_bound
from impact_damper_ros.rig.transition import struck

from .equations import Array, ImpactEquations, ImpactVelocities
from .event_map import origin_after_impact

_TIME_TOLERANCE = 1e-13


class Extremes(NamedTuple):
    """
    Least and largest value of a displacement in a flight, and when.

    Displacements in m, times since the flight's origin in s.
    """

    low: float
    low_time: float
    high: float
    high_time: float


def _rates(motion: Motion, relative: bool) -> tuple[float, float, float]:
    """Return the first three derivatives of Y or X."""
    if relative:
        return motion.relative_velocity, motion.relative_2, -motion.x_3
    return motion.velocity, motion.x_2, motion.x_3


def _turning_times(flight: Flight, duration: float, relative: bool) -> Iterator[float]:
    """
    Yield the times at which the velocity is zero, in order.

    From step to step the velocity keeps its sign: its third derivative is bounded, and
    `safe_step` returns how far that is certain.
    """
    oscillator = flight.oscillator
    least = _TIME_TOLERANCE * duration
    tau, sign = 0.0, 0.0
    while tau < duration:
        motion = motion_at(flight, tau)
        rates = _rates(motion, relative)
        bound = derivative_bound(oscillator, motion.x_4, motion.x_5, oscillator.bound_4)
        if sign == 0.0:
            leading = next((rate for rate in rates if rate != 0.0), 0.0)
            if leading == 0.0:
                return
            sign = 1.0 if leading > 0.0 else -1.0
        speed = max(sign * rates[0], 0.0)
        step = safe_step(speed, sign * rates[1], sign * rates[2], bound, oscillator.horizon)
        if step <= least:
            yield tau
            # Beyond the root; a velocity that only touches zero keeps its sign.
            tau += least
            beyond = _rates(motion_at(flight, tau), relative)
            sign = 0.0
            if abs(beyond[0]) <= abs(rates[1]) * least:
                sign = -1.0 if rates[1] < 0.0 else 1.0
            continue
        tau += step


def extremes(flight: Flight, duration: float, *, relative: bool) -> Extremes:
    """Return the least and largest X of a flight or, if `relative`, of Y - Y(origin)."""
    points = [0.0, duration, *_turning_times(flight, duration, relative)]
    motions = [(motion_at(flight, tau), tau) for tau in points]
    values = [(m.travel if relative else m.x, tau) for m, tau in motions]
    (low, low_time), (high, high_time) = min(values), max(values)
    return Extremes(low, low_time, high, high_time)


#: How much earlier than assumed, as a share of the period, an impact counts as another one.
TIME_TOLERANCE = 1e-7

_MODE_OF_DIRECTION = {0: FREE, 1: SLIDE_DOWN, -1: SLIDE_UP}


def _assumed(
    equations: ImpactEquations,
    rig: RigConstants,
    x: Array,
    instants: Array,
    at: ImpactVelocities,
) -> Iterator[tuple[Origin, Flight]]:
    """Yield the state just after each impact, in the mode assumed, and the flight from it."""
    for i, stop in enumerate(equations.stops):
        velocities = float(at.primary_after[i]), float(at.damper_after[i])
        origin = origin_after_impact(rig, float(instants[i]), stop, float(x[i]), *velocities)
        direction = equations.directions[i] if rig.grip > 0.0 else 0
        origin = origin._replace(mode=_MODE_OF_DIRECTION[direction])
        yield origin, launch(rig, origin)


def assumed_flights(
    equations: ImpactEquations, x: Array, instants: Array, at: ImpactVelocities
) -> list[Flight]:
    """Return the closed-form flights after each impact, as the equations assume them."""
    rig = rig_constants(equations.parameters)
    return [flight for _, flight in _assumed(equations, rig, x, instants, at)]


def largest_displacement(flights: Iterable[Flight], durations: Iterable[float]) -> float:
    """Return the largest |X| over flights, from their turning points, m."""
    largest = 0.0
    for flight, duration in zip(flights, durations, strict=True):
        swing = extremes(flight, float(duration), relative=False)
        largest = max(largest, -swing.low, swing.high)
    return largest


def _after_impact(machine: RigConstants, origin: Origin, incoming: float, before: float) -> str:
    """Return why m does not leave the stop as assumed; empty if it does."""
    stop = origin.last_stop
    hit = struck(machine, origin._replace(velocity=before, relative_velocity=incoming), stop)
    mode = hit.origin.mode
    if mode == origin.mode:
        return ''
    if mode >= STICK:
        return f'stays on stop {stop} after the impact, its speed {abs(incoming):.4g} m/s there'
    return f'leaves stop {stop} against the friction assumed'


def _in_flight(
    machine: RigConstants,
    flight: Flight,
    origin: Origin,
    duration: float,
    end: int,
    tolerance: float,
) -> str:
    """Return what happens in a flight before its impact; empty if nothing does."""
    start = origin.last_stop
    kind, tau = first_event(flight, 0.0, duration + tolerance)
    contact = CONTACT_1 if end == 1 else CONTACT_2
    if kind == NO_EVENT or tau > duration + tolerance:
        return ''
    if kind == contact and tau >= duration - tolerance:
        return ''
    route = f'between the impacts on stop {start} and stop {end}'
    when = f'{tau:.6g} s after the former'
    travel = extremes(flight, duration, relative=True)
    across = 2.0 * machine.stop
    # Distance beyond stop 1 and stop 2
    beyond_1 = travel.high - (0.0 if start == 1 else across)
    beyond_2 = -travel.low - (across if start == 1 else 0.0)
    if kind == REVERSAL:
        return (
            f'm turns back {route}, {when} and {abs(motion_at(flight, tau).travel):.4g} m from '
            f'stop {start}: friction changes sign there'
        )
    hit = 1 if kind == CONTACT_1 else 2
    beyond = max(beyond_1 if hit == 1 else beyond_2, 0.0)
    return f'm would pass stop {hit} by {beyond:.4g} m {route}, first {when}: another impact'


def why_not_viable(
    equations: ImpactEquations, x: Array, instants: Array, at: ImpactVelocities
) -> str:
    """Return why the rig cannot perform a motion; empty if it can."""
    machine = rig_constants(equations.parameters)
    durations = equations.durations(instants)
    tolerance = TIME_TOLERANCE * equations.period
    incoming = at.damper_before - at.primary_before
    faults = []
    for i, (origin, flight) in enumerate(_assumed(equations, machine, x, instants, at)):
        stop = equations.stops[i]
        towards = 1.0 if stop == 1 else -1.0
        if towards * incoming[i] <= 0.0:
            faults.append(
                f'm would reach stop {stop} from beyond it, with a relative velocity of '
                f'{incoming[i]:.4g} m/s (it must be {"positive" if stop == 1 else "negative"})'
            )
            continue
        fault = _after_impact(machine, origin, float(incoming[i]), float(at.primary_before[i]))
        if fault:
            faults.append(f'm {fault}')
            continue
        end = equations.stops[(i + 1) % equations.impacts]
        faults.append(_in_flight(machine, flight, origin, float(durations[i]), end, tolerance))
    return '; '.join(fault for fault in faults if fault)
