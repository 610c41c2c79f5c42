# SPDX-License-Identifier: Apache-2.0
"""Strobe: states of a run at the ends of cycles, which end the run once one comes back."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

from impact_damper_ros.motion.event import Sample
from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.motion.state import Run

from .acts import Schedule


@dataclass(slots=True)
class Strobe:
    """
    A run that ends once its state comes back: states at the ends of cycles are compared.

    Attributes
    ----------
    start, cycle : float
        When it began, and the duration of a cycle, s.
    rate : float
        Circular frequency that makes velocities comparable with displacements, rad/s.
    tolerance : float
        Distance of two states, over the size of the motion, below which they are the same.
    most, most_events : int
        Most cycles, and most events.
    cycles, next : int
        Cycles that are done, and cycles at the next comparison.
    happened : int
        Events before the last comparison.
    """

    start: float
    cycle: float
    rate: float
    tolerance: float
    most: int
    most_events: int
    cycles: int = 0
    next: int = 0
    happened: int = 0


#: Cycles between two comparisons, and number of earlier states that the last one is compared with.
CYCLES_OF_A_LOOK = 50
_STATES_BEFORE = 16
#: Columns of samples that hold X, Z, X' and Z'.
_STATE_COLUMNS = [
    Sample._fields.index(n) for n in ('x', 'z', 'primary_velocity', 'damper_velocity')
]
_COLUMN_X, _COLUMN_Z, _COLUMN_V, _COLUMN_W = _STATE_COLUMNS


@kernel
def next_look(run: Run, schedule: Schedule, strobe: Strobe) -> float:
    """Request the states at the ends of cycles up to the next comparison; return its instant."""
    if strobe.next == strobe.cycles:
        strobe.next = min(strobe.cycles + CYCLES_OF_A_LOOK, strobe.most)
        run.sampled = 0
        for k in range(CYCLES_OF_A_LOOK):
            schedule.instants[k] = inf
            if strobe.cycles + k < strobe.next:
                # One rounding, so that the steps do not drift
                schedule.instants[k] = strobe.start + (strobe.cycles + k + 1.0) * strobe.cycle
    look: float = schedule.instants[strobe.next - strobe.cycles - 1]
    return look


@kernel
def comes_back(samples: Any, strobe: Strobe) -> bool:
    """Return whether the last of some states is close to one of those before it."""
    count = strobe.next - strobe.cycles
    if count < 2:
        return False
    last = count - 1
    x = samples[last, _COLUMN_X]
    y = samples[last, _COLUMN_Z] - x
    v = samples[last, _COLUMN_V]
    u = samples[last, _COLUMN_W] - v
    largest = 0.0
    low = inf
    high = -inf
    nearest = inf
    for k in range(count):
        place = samples[k, _COLUMN_X]
        way = samples[k, _COLUMN_Z] - place
        largest = max(largest, abs(place))
        low = min(low, way)
        high = max(high, way)
        if last - _STATES_BEFORE <= k < last:
            speed = samples[k, _COLUMN_V]
            relative = samples[k, _COLUMN_W] - speed
            apart = max(abs(place - x), abs(way - y))
            apart = max(apart, max(abs(speed - v), abs(relative - u)) / strobe.rate)
            nearest = min(nearest, apart)
    return nearest <= strobe.tolerance * (largest + (high - low))


@kernel
def goes_on(run: Run, schedule: Schedule, strobe: Strobe) -> bool:
    """Compare the states, and return whether the run goes on."""
    back = comes_back(schedule.samples, strobe)
    strobe.cycles = strobe.next
    if back or strobe.cycles == strobe.most:
        return False
    strobe.happened = strobe.most_events - run.most + run.happened
    return True
