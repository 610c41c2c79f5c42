# SPDX-License-Identifier: Apache-2.0
"""
Response over frequency: motion of M and its base at each frequency of a stepped sine.

The motion in a step is taken from its second half, where a step lasts for some cycles; in a swept
sine, whose steps are as short as a cycle, from the whole step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import Event, EventKind, table_of_events
from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.rig.observed_run import Observer
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.stepped_sine import rig_at, stepped_sine

from .flight_arrays import Flights, FlightStart, number_points
from .response import Array
from .transmissibility import dynamic_stiffness

#: Points in a cycle at which the motion is evaluated; a largest value is low by 3e-4 at most.
_POINTS = 128
#: Least number of cycles of a step whose first half is left out.
_SETTLES = 4.0
#: Points that are computed at once.
_MOST_POINTS = 2**18


class SweptResponse(NamedTuple):
    """
    Response at each step of a sweep.

    Attributes
    ----------
    time : ndarray, shape (n,)
        When the steps begin, s.
    frequency : ndarray, shape (n,)
        Frequency of the swept line, rad/s.
    upwards : ndarray of bool, shape (n,)
        Whether the frequency rises; the highest frequency of a sweep up and down belongs to the
        way up.
    level : ndarray, shape (n,)
        Amplitude of the swept line: N, or in the unit of `base_quantity`.
    x, relative, acceleration : ndarray, shape (n,)
        Largest abs(X), abs(X - b) and abs(X''), m and m/s^2. The impacts, in which X'' is
        infinite, are left out.
    x_without, relative_without, acceleration_without : ndarray, shape (n,)
        Amplitudes of M alone under the swept line, settled.
    impacts : ndarray, shape (n,)
        Impacts per cycle.
    """

    time: Array
    frequency: Array
    upwards: NDArray[np.bool_]
    level: Array
    x: Array
    relative: Array
    acceleration: Array
    x_without: Array
    relative_without: Array
    acceleration_without: Array
    impacts: Array


def swept_response(flights: Flights) -> SweptResponse:
    """Return the response of a swept rig, whose flights have a row at each step."""
    rows, times = flights.rows, flights.rows['time']
    begins = np.flatnonzero(rows['kind'] == EventKind.FREQUENCY_STEP)
    begins = np.concatenate([[0], begins[begins > 0]])
    start, end = times[begins], np.append(times[begins[1:]], times[-1])
    whole = end > start
    begins, start, end = begins[whole], start[whole], end[whole]
    force, frequency, _ = flights.first[begins].T
    cycles = (end - start) * frequency / math.tau
    since = np.where(cycles >= _SETTLES, 0.5 * (start + end), start)
    hits = times[rows['kind'] == EventKind.IMPACT]
    counted = np.searchsorted(hits, end) - np.searchsorted(hits, since)
    rising = np.diff(frequency, prepend=frequency[:1]) > 0.0
    rising[:1] = rising[1:2] if len(rising) > 1 else flights.rig.sweep_mode != 'down'
    level, alone, apart = _alone(flights.rig, force, frequency)
    x, relative, acceleration = _largest(flights, since, end, frequency)
    return SweptResponse(
        start,
        frequency,
        rising,
        level,
        x,
        relative,
        acceleration,
        alone,
        apart,
        alone * frequency**2,
        counted / ((end - since) * frequency / math.tau),
    )


def _alone(rig: RigParameters, force: Array, frequency: Array) -> tuple[Array, Array, Array]:
    """Return the level, and the amplitudes of X and X - b of M alone."""
    pull = dynamic_stiffness(rig, frequency, 0.0)
    with np.errstate(divide='ignore'):
        alone = np.abs(force) / np.abs(dynamic_stiffness(rig, frequency))
    moved = np.zeros_like(frequency)
    level = np.abs(force)
    if rig.swept == 'base':
        moved = np.abs(force / pull)
        level = moved * frequency ** ORDERS[rig.base_quantity]
    # |X - b| = M W^2 |b| / |K + i C W - M W^2|; without a base it is |X|
    inertia = rig.primary_mass * frequency**2
    with np.errstate(invalid='ignore'):
        apart = np.where(moved > 0.0, alone * inertia / np.abs(pull), alone)
    return level, alone, apart


def _largest(flights: Flights, since: Array, end: Array, frequency: Array) -> Array:
    """Return the largest |X|, |X - b| and |X''| in each of some stretches."""
    count = np.ceil((end - since) * frequency / math.tau * _POINTS).astype(int) + 1
    found = np.empty((3, len(since)))
    ends = np.cumsum(count)
    first = 0
    while first < len(since):
        done = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, done + _MOST_POINTS, side='right')))
        here = slice(first, last)
        piece, number = number_points(count[here])
        times = since[here][piece] + number * ((end - since) / (count - 1))[here][piece]
        index = np.clip(
            np.searchsorted(flights.starts, times, side='right') - 1, 0, len(flights) - 1
        )
        tau = np.minimum(times - flights.starts[index], flights.spans[index])
        x, _, acceleration, _ = flights.motion(index, tau)
        base, _, _ = flights.base(index, tau)
        starts = np.flatnonzero(number == 0)
        for k, values in enumerate((x, x - base, acceleration)):
            found[k, here] = np.maximum.reduceat(np.abs(values), starts)
        first = last
    return found


class SweptRun(Observer):
    """
    Takes the events of a run with a sweep, and returns its response.

    Parameters
    ----------
    rig : Rig
        The rig at the start of the run. Only the sweep changes it on the way.
    """

    def __init__(self, rig: Rig) -> None:
        """Note the state of the rig."""
        self._rig, self._sweep, self._begin = rig, rig.sweep, FlightStart.of(rig)
        self._events: list[Event] = []

    def take_events(self, events: Sequence[Event]) -> None:
        """Take the events since the last call."""
        self._events += events

    def response(self) -> SweptResponse:
        """Return the response up to the present time."""
        rig, parameters = self._rig, self._rig.parameters
        events = table_of_events(self._events)
        count = int((events['kind'] == EventKind.FREQUENCY_STEP).sum())
        coming = islice(stepped_sine(parameters, self._sweep), count)
        rigs = [rig_at(parameters, self._sweep.step), *(step.parameters for step in coming)]
        steps = np.array([one.first_harmonic for one in rigs])
        return swept_response(
            self._begin.flights(parameters, events, FlightStart.of(rig).row, steps)
        )
