# SPDX-License-Identifier: Apache-2.0
"""
The largest Lyapunov exponent of a run.

`multipliers` gives a matrix for every flight and event of a run [1]_, and the exponent is the mean
growth of a deviation that is normalised again and again [2]_. The matrices do not include the
response of a gap control to a deviation: under control no exponent is measured.

References
----------
.. [1] P. C. Müller, Chaos Solitons Fractals 5, 1671-1681 (1995).
.. [2] T. S. Parker, L. O. Chua, Practical Numerical Algorithms for Chaotic Systems (1989).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.impact import bounce
from impact_damper_ros.motion.state import STICK

from .flight_arrays import Flights
from .multipliers import FlightLaws, Y, event_matrices, jumps, velocities_of
from .response import free_response

Array = NDArray[np.float64]

#: Parts of a run whose mean growths are compared, for the uncertainty of the exponent.
BATCHES = 20
#: 97.5 % point of Student's distribution with BATCHES - 1 degrees of freedom.
_STUDENT = 2.093


@dataclass(frozen=True)
class Deviations:
    """The matrices that propagate deviations of (X, X', Y, Y') through a part of a run."""

    start: float  # s
    end: float
    instants: Array  # of the events in it, s, shape (n,)
    events: Array  # their saltation matrices, shape (n, 4, 4)
    #: Of the flights before each event, and after the last, shape (n + 1,).
    modes: NDArray[np.int64]
    laws: FlightLaws

    def steps(self, ends: Array) -> tuple[Array, NDArray[np.int64]]:
        """
        Cut the stretch at instants that rise to its end.

        Returns a matrix for each flight with the event after it, if there is one, and the part
        that each belongs to.
        """
        order = np.searchsorted(self.instants, ends, side='right')
        nodes = np.insert(self.instants, order, ends)
        # Events at the end of a part come before it, as in `searchsorted`
        cut = np.zeros(len(nodes), dtype=bool)
        cut[order + np.arange(len(ends))] = True
        before = np.concatenate([[self.start], nodes[:-1]])
        flight = np.cumsum(~cut) - ~cut
        spans = nodes - before
        laws = FlightLaws(*(column[flight] for column in self.laws))
        matrices = laws.matrices(spans, free_response(laws.decay, laws.damped, spans))
        # A stop leaves m no deviation
        matrices[self.modes[flight] > STICK, Y, Y] = 0.0
        matrices[~cut] = self.events @ matrices[~cut]
        return matrices, np.cumsum(cut) - cut


@dataclass(frozen=True)
class Exponent:
    """A largest Lyapunov exponent."""

    value: float  # mean rate of growth, 1/s
    uncertainty: float  # half of a 95 % interval, 1/s

    @property
    def standard_error(self) -> float:
        """Standard error of the mean growth of the parts, 1/s."""
        return self.uncertainty / _STUDENT


def deviations(flights: Flights, start: float, end: float) -> Deviations:
    """
    Return the matrices of a stretch of a run from `start` to `end`, s.

    The run, whose rows have modes, may begin before the stretch and reach beyond it.
    """
    constants, laws, rows = flights.machine.constants, flights.laws, flights.rows
    events = rows[1:-1]
    time, kind, stop = events['time'], events['kind'], events['stop']
    impact = kind == EventKind.IMPACT
    modes, joint = rows['mode'][:-1], flights.together[:-1]
    push, force = flights.active[:-1] / flights.rig.primary_mass, flights.force(time)

    def rates(flight: slice, side: str) -> Array:
        """Return the rates of the state at the events, in the flights before or after them."""
        velocity, relative = velocities_of(events, side, joint[flight], constants.share)
        drive = (force + push[flight]) * np.where(joint[flight], 1.0 - constants.share, 1.0)
        along = FlightLaws(*(part[flight] for part in laws))
        return along.rates(events['x'], velocity, relative, drive)

    restitution = np.where(stop == 1, constants.restitution_1, constants.restitution_2)
    halts = np.isin(kind, (EventKind.REVERSAL, EventKind.STICK, EventKind.REST))
    # Plastic, or the cut of a chatter: all the impacts to come are one
    restitution = np.where(joint[1:], 0.0, restitution)
    approach = events['damper_velocity_before'] - events['primary_velocity_before']
    _, slope = bounce(constants, restitution, np.abs(approach))
    matrices = event_matrices(
        jumps(constants.share, impact, slope),
        impact,
        rates(slice(0, -1), 'before'),
        rates(slice(1, None), 'after'),
        impact | halts,
    )
    inside = (time > start) & (time <= end)
    first = int(np.count_nonzero(time <= start))
    part = slice(first, first + int(inside.sum()) + 1)
    return Deviations(
        start=start,
        end=end,
        instants=time[inside],
        events=matrices[inside],
        modes=modes[part],
        laws=FlightLaws(*(column[part] for column in laws)),
    )


def _products(along: Deviations, ends: Array) -> tuple[Array, Array]:
    """
    Return the product of the matrices over each part of a stretch, and the logarithm of its size.

    Neighbours are multiplied in all parts at once, and again, until each has one matrix left.
    """
    matrices, parts = along.steps(ends)
    counts = np.bincount(parts, minlength=len(ends))
    rows = 1 << int(counts.max() - 1).bit_length()
    product = np.tile(np.eye(4), (len(ends), rows, 1, 1))
    product[parts, np.arange(len(parts)) - (np.cumsum(counts) - counts)[parts]] = matrices
    logarithms = np.zeros(len(ends))
    while product.shape[1] > 1:
        product = product[:, 1::2] @ product[:, ::2]
        size = np.abs(product).max(axis=(2, 3))
        size[size == 0.0] = 1.0
        product /= size[..., None, None]
        logarithms += np.log(size).sum(axis=1)
    return product[:, 0], logarithms


def monodromy_of(along: Deviations, ends: Array) -> Array:
    """Return the product of the matrices over each part of a stretch, given the parts' ends, s."""
    products, logarithms = _products(along, ends)
    return products * np.exp(logarithms)[:, None, None]


def growth_exponent(along: Deviations, omega: float) -> Exponent:
    """
    Return the largest Lyapunov exponent from the growth of one deviation.

    The mean growth of its logarithm over the last 20 of 21 parts of the stretch; in the first
    part the deviation turns into the direction that grows most. The uncertainty is half of the
    95 % interval of the mean of these parts. `omega` (rad/s) makes velocities comparable with
    displacements.
    """
    ends = np.linspace(along.start, along.end, BATCHES + 2)[1:]
    ends[-1] = along.end
    products, growth = _products(along, ends)
    # Of X, X', Z and Z'
    absolute = np.eye(4) + np.eye(4, k=-2)
    scale = np.array([omega, 1.0, omega, 1.0])
    products = scale[:, None] * (absolute @ products @ np.linalg.inv(absolute)) / scale
    # Neither symmetric nor along an axis, so that it has a part in every direction
    vector = np.array([0.6, 0.3, -0.5, 0.55])
    for part, product in enumerate(products):
        vector = product @ vector
        norm = float(np.linalg.norm(vector))
        if norm == 0.0:
            return Exponent(-math.inf, 0.0)
        growth[part] += math.log(norm)
        vector /= norm
    rates = growth[1:] / np.diff(ends)
    error = float(rates.std(ddof=1)) / math.sqrt(BATCHES)
    return Exponent(float(rates.mean()), _STUDENT * error)
