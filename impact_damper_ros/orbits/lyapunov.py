# SPDX-License-Identifier: Apache-2.0
"""
The largest Lyapunov exponent of a run, and the multipliers of a motion under control.

Without control, `multipliers` gives a matrix for every flight and event of a run [1]_, and the
exponent is the mean growth of a deviation that is normalised again and again [2]_.

These matrices do not include the response of a control to a deviation: samples, estimates,
positions of the stops, pending commands. Under control two whole rigs are therefore run, with a
small separation of their motions. Their decisions (whether a stop is moved now or at the next
sample) are not differentiable, so the separation is finite and is renormalised at the same instant
of each cycle [3]_. Two rigs that have decided differently are no longer neighbours: such a cycle
is left out, and a new neighbour is started. The smaller the separation, the fewer such cycles
there are, so that the exponent exists in spite of the jumps [4]_; if they are many, none is given.
[5]_ compares such methods. Stops at rest, as within the dead band of the control, do not deviate
and do not contribute to the exponent.

References
----------
.. [1] P. C. Müller, Chaos Solitons Fractals 5, 1671-1681 (1995).
.. [2] T. S. Parker, L. O. Chua, Practical Numerical Algorithms for Chaotic Systems (1989).
.. [3] G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980).
.. [4] A. Katok, J.-M. Strelcyn, Lecture Notes in Mathematics 1222 (1986).
.. [5] M. Balcerzak et al., Mech. Syst. Signal Process. 141, 106734 (2020).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.control.nearby_rig import NearbyRig, RigState, Scales
from impact_damper_ros.rig import EventKind, Mode
from impact_damper_ros.rig.state import STICK

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
    rig, laws, rows = flights.machine.constants, flights.laws, flights.rows
    events = rows[1:-1]
    time, kind, stop = events['time'], events['kind'], events['stop']
    impact = kind == EventKind.IMPACT
    modes, joint = rows['mode'][:-1], flights.together[:-1]
    push, force = flights.active[:-1] / flights.rig.primary_mass, flights.force(time)

    def rates(flight: slice, side: str) -> Array:
        """Return the rates of the state at the events, in the flights before or after them."""
        velocity, relative = velocities_of(events, side, joint[flight], rig.share)
        drive = (force + push[flight]) * np.where(joint[flight], 1.0 - rig.share, 1.0)
        along = FlightLaws(*(part[flight] for part in laws))
        return along.rates(events['x'], velocity, relative, drive)

    restitution = np.where(stop == 1, rig.restitution_1, rig.restitution_2)
    halts = np.isin(kind, (EventKind.REVERSAL, EventKind.STICK, EventKind.REST))
    # Plastic, or the cut of a chatter: all the impacts to come are one
    restitution = np.where(joint[1:], 0.0, restitution)
    matrices = event_matrices(
        jumps(rig.share, impact, restitution),
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
    return _batched_exponent(growth, np.diff(ends, prepend=along.start))


def _batched_exponent(growth: Array, spans: Array) -> Exponent:
    """Return the exponent from the growth in each part of a time; a part may have none."""
    kept = np.flatnonzero(spans[1:] > 0.0) + 1
    rates: Any = growth[kept] / spans[kept]
    error = float(rates.std(ddof=1)) / math.sqrt(len(kept))
    return Exponent(float(rates.mean()), _STUDENT * error)


#: Separation of neighbours, relative to the size of the motion, and at least so many times the
#: round-off of the time; for a multiplier it is wider, since that has fewer tries.
_NEAR, _CLEAR, _WIDER = 1e-7, 1e4, 10.0
#: Separation from which on neighbours are taken to have parted.
_PARTED = 1e-2
#: Cycles in which neighbours may agree again after one of them had an event earlier.
_PATIENCE = 3
#: Share of the cycles in which they may not.
_MOST_LEFT_OUT = 0.05
#: Most periods for a multiplier, how exact it is to be, and what of a deviation is nothing new.
_MOST_STEPS, _EXACT, _NOTHING = 24, 1e-5, 1e-6
#: Error of a deviation after a period, relative to it, at least.
_ROUND_OFF = 1e-8


def _rig(snapshot: dict[str, Any]) -> NearbyRig:
    """Restore a rig, and run it to between two samples: at a sample, round-off decides."""
    rig = NearbyRig.restore(snapshot, compiled=None)
    rig.go_between_samples()
    return rig


def _near(rig: NearbyRig, scales: Scales) -> float:
    """Return how far apart neighbours are at first."""
    return max(_NEAR, _CLEAR * scales.rate * math.ulp(rig.time))


def _first_deviation(state: RigState) -> Array:
    """Return a deviation of the motion, in all the ways in which it can deviate."""
    ways = {'x': 0.6, 'velocity': 0.3}
    if state.run.mode <= Mode.STICK:
        ways |= {'clearance_1': -0.5, 'clearance_2': 0.5}
    if state.run.mode < Mode.STICK:
        ways |= {'relative_velocity': 0.55}
    deviation = np.array([0.0 if part else ways.get(name, 0.0) for part, name in state.places])
    return deviation / float(np.linalg.norm(deviation))


class _Period:
    """A period of a motion under control, through which deviations are carried."""

    def __init__(self, rig: NearbyRig, period: float, scales: Scales, side: float) -> None:
        self.rig = rig
        self.begun = rig.numbers()
        self.end = rig.time + period
        self.near = _WIDER * _near(rig, scales)
        self.step = side * self.near * scales.of(self.begun)
        #: Error of a deviation, relative to it: instants are the coarsest numbers of a state.
        self.round_off = max(_ROUND_OFF, scales.rate * math.ulp(self.end) / self.near)
        self.last = NearbyRig.restore(rig.snapshot(), compiled=None)
        self.sequence = self.last.go_to(self.end)
        self.reached = self.last.numbers()

    def carried(self, deviation: Array) -> Array | None:
        """Return a deviation one period later; None if neighbours on both sides diverge."""
        for side in (1.0, -1.0):
            step = side * self.step
            other = self.rig.at(self.begun, self.begun.numbers + step * deviation)
            if other is None or other.go_to(self.end) != self.sequence:
                continue
            there = other.numbers()
            if not there.alike(self.reached):
                continue
            image: Array = (there.numbers - self.reached.numbers) / step
            if self.near * float(np.linalg.norm(image)) < _PARTED:
                return image
        return None

    def multiplier(self) -> tuple[float, float]:
        """
        Return the modulus of the largest multiplier, and its error; NaN if neighbours diverge.

        A deviation is carried through the period, made orthogonal to those before, and carried
        through it again (Arnoldi, Quart. Appl. Math. 9, 1951), until nothing new comes or the
        largest multiplier no longer changes. The error combines the rest and the effect of the
        round-off of a deviation on a multiplier, its root if that is double.
        """
        if self.reached.places != self.begun.places:
            return math.nan, math.nan
        basis = [_first_deviation(self.begun)]
        matrix = np.zeros((_MOST_STEPS + 1, _MOST_STEPS))
        for k in range(_MOST_STEPS):
            image = self.carried(basis[k])
            if image is None:
                return math.nan, math.nan
            size = max(1.0, float(np.linalg.norm(image)))
            # Twice, since the rest of the first pass is of the order of round-off
            for _ in range(2):
                parts = np.array([float(one @ image) for one in basis])
                matrix[: k + 1, k] += parts
                image = image - parts @ np.array(basis)
            left = float(np.linalg.norm(image))
            values, vectors = np.linalg.eig(matrix[: k + 1, : k + 1])
            first = int(np.argmax(np.abs(values)))
            largest = float(abs(values[first]))
            error = left * float(abs(vectors[-1, first]))
            if left <= _NOTHING * size or error <= _EXACT * largest:
                break
            matrix[k + 1, k] = left
            basis.append(image / left)
        condition = float(np.linalg.norm(np.linalg.pinv(vectors)[first]))
        astray = self.round_off * size
        return largest, error + min(condition * astray, math.sqrt(astray))


def period_exponent(
    snapshot: dict[str, Any], period: float, scales: Scales
) -> tuple[Exponent, float]:
    """
    Return the largest Lyapunov exponent of a periodic motion under control, and its multiplier.

    The snapshot is that of a `Rig` under control, the period is in s. The exponent is the mean of
    ln(largest multiplier)/period of two periods in a row, with neighbours on either side; its
    uncertainty is the difference and the error of the multiplier. NaN if neighbours decide
    differently. The multiplier is the modulus of the largest one.
    """
    first = _Period(_rig(snapshot), period, scales, 1.0)
    second = _Period(first.last, period, scales, -1.0)
    (one, error), (other, its_error) = first.multiplier(), second.multiplier()
    if one == 0.0 or other == 0.0:
        return Exponent(-math.inf, 0.0), 0.0
    rates = math.log(one) / period, math.log(other) / period
    mean = 0.5 * (rates[0] + rates[1])
    inexact = max(error / one, its_error / other) / period
    return Exponent(mean, abs(rates[1] - rates[0]) + inexact), math.exp(mean * period)


def parting_exponent(
    snapshot: dict[str, Any], cycle: float, cycles: int, scales: Scales
) -> Exponent:
    """
    Return the largest Lyapunov exponent of any motion under control.

    The mean growth of the separation of two neighbours and its uncertainty, as of
    `growth_exponent`, over at least 21 cycles of the force, each of `cycle` s. NaN if they decide
    differently in more than one of twenty cycles.
    """
    rig = _rig(snapshot)
    begun, state = rig.time, rig.numbers()
    near = _near(rig, scales)
    growth, spans = np.zeros(cycles), np.zeros(cycles)
    other: NearbyRig | None = None
    size, done = near, 0
    while done < cycles:
        if other is None:
            deviation = near * scales.of(state) * _first_deviation(state)
            other, size = rig.at(state, state.numbers + deviation), near
            other = other or rig.at(state, state.numbers - deviation)
        first, apart = done, None
        events: list[tuple[int, int]] = []
        its_events: list[tuple[int, int]] = []
        while apart is None and done < min(cycles, first + _PATIENCE):
            done += 1
            events += rig.go_to(begun + done * cycle)
            state = rig.numbers()
            if other is not None:
                its_events += other.go_to(rig.time)
                if its_events == events:
                    apart = _separation(state, other.numbers(), scales)
        if apart is None or other is None:
            other = None
            continue
        there = float(np.linalg.norm(apart))
        if there == 0.0:
            return Exponent(-math.inf, 0.0)
        growth[first:done] = math.log(there / size) / (done - first)
        spans[first:done] = cycle
        nearer = rig.at(state, state.numbers + near / there * scales.of(state) * apart)
        # Where m would be beyond a stop or turned round, they stay as far apart as they are
        other, size = (other, there) if nearer is None else (nearer, near)
    if np.count_nonzero(spans) < (1.0 - _MOST_LEFT_OUT) * cycles:
        return Exponent(math.nan, math.nan)
    parts = np.array_split(np.arange(cycles), BATCHES + 1)
    return _batched_exponent(
        np.array([growth[part].sum() for part in parts]),
        np.array([spans[part].sum() for part in parts]),
    )


def _separation(state: RigState, there: RigState, scales: Scales) -> Array | None:
    """Return the scaled distance of a neighbour; None if it cannot be compared."""
    if not there.alike(state):
        return None
    apart = (there.numbers - state.numbers) / scales.of(state)
    return apart if float(np.linalg.norm(apart)) < _PARTED else None
