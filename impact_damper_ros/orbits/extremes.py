# SPDX-License-Identifier: Apache-2.0
"""Exact extremes of displacements: the turning points of flights, by the certified search."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.first_event import first_root
from impact_damper_ros.rig.flight import REVERSAL, oscillator_of
from impact_damper_ros.rig.oscillator import POINTS
from impact_damper_ros.rig.state import CHATTER_1, REST_1, STICK

from .flights import Flight, Machine, flight_at

if TYPE_CHECKING:
    from impact_damper_ros.control.rig import Events

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
        if root < math.inf:
            yield root
            run.direction, tau = 0, root + _BEYOND * step


def extremes(flight: Flight, duration: float, *, relative: bool) -> Extremes:
    """Return the least and largest X of a flight or, if `relative`, of Y - Y(origin)."""
    points = [0.0, duration, *_turning_times(flight, duration, relative)]
    motions = [(flight.motion(tau), tau) for tau in points]
    values = [(m.travel if relative else m.x, tau) for m, tau in motions]
    (low, low_time), (high, high_time) = min(values), max(values)
    return Extremes(low, low_time, high, high_time)


def largest_displacement(flights: Iterable[Flight], durations: Iterable[float]) -> float:
    """Return the largest |X| over flights, from their turning points, m."""
    largest = 0.0
    for flight, duration in zip(flights, durations, strict=True):
        swing = extremes(flight, max(0.0, duration), relative=False)
        largest = max(largest, -swing.low, swing.high)
    return largest


def largest_between(
    machine: Machine, angles: Sequence[float], rows: Events, start: float, end: float
) -> float:
    """
    Return the largest |X| of a run between two times, s.

    The flights of M are computed from the events themselves, so that it does not matter whether
    stops move. The first of the rows is the state at some time up to `start`, with the stop hit
    last; the others are the events since. `angles` are those of the harmonics at time 0, rad.
    """
    flights, durations, last_stop = [], [], int(rows['stop'][0])
    ends = [*rows['time'][1:].tolist(), end]
    for row, over in zip(rows, ends, strict=True):
        if row['kind'] == EventKind.IMPACT:
            last_stop = int(row['stop'])
        time = float(row['time'])
        if over <= start or time >= end:
            continue
        mode, velocity = int(row['mode']), float(row['primary_velocity_after'])
        mode = mode - CHATTER_1 + REST_1 if mode >= CHATTER_1 else mode
        flight = flight_at(
            machine,
            time,
            float(row['x']),
            velocity,
            -machine.constants.half_gap,
            float(row['damper_velocity_after']) - velocity,
            mode if mode >= STICK else 0,
            last_stop,
            angles,
        )
        flight.run.mode = mode
        flight = flight.begun()
        flights.append(flight.after(start - time) if time < start else flight)
        durations.append(min(over, end) - max(time, start))
    return largest_displacement(flights, durations)
