"""
How motions under gap control part from their neighbours: multipliers and Lyapunov exponent.

The matrices of `lyapunov` do not hold what the control does with a deviation. Here two whole rigs
are run, which differ by a little in the motion, and from then on in all that the control knows and
does about it: its samples, estimates, the places of the stops, the commands that wait.

What the control decides is not differentiable: whether a stop is sent off now or at the next
sample, whether a change is worth a command. A finite, small separation is therefore taken anew at
the same instant of each cycle (Benettin, Galgani, Giorgilli and Strelcyn, Meccanica 15, 1980), and
no linearisation at the jump, where there is none. Two rigs that have decided differently are not
neighbours any more; such cycles are left out, and another neighbour is taken. That they are the
fewer the smaller the separation is what lets an exponent exist at all with such jumps (Katok and
Strelcyn, Lecture Notes in Mathematics 1222, 1986); where they are not few, there is none here.
Balcerzak and others, Mech. Syst. Signal Process. 141 (2020) 106734, compare such methods.

Deviations begin in the motion. Stops that stand, as they do while what the control wants is within
its dead band, do not deviate then, and have no part in the exponent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.control.nearby_rig import NearbyRig, RigState, Scales
from impact_damper_ros.rig import Event, Mode

from .lyapunov import BATCHES, Exponent, batched_exponent

__all__ = ['parting_exponent', 'period_exponent']

Array = NDArray[np.float64]

#: Separation of neighbours, relative to the size of the motion, and at least so many times the
#: round-off of the time; for a multiplier it is wider, since that has fewer tries.
_NEAR, _CLEAR, _WIDER = 1e-7, 1e4, 10.0
#: Separation from which on neighbours are taken to have parted.
_PARTED = 1e-2
#: Cycles in which neighbours may come to agree again, one of them having had an event earlier.
_PATIENCE = 3
#: Share of the cycles in which they may not.
_MOST_LEFT_OUT = 0.05
#: Most periods for a multiplier, how exact it is to be, and what of a deviation is nothing new.
_MOST_STEPS, _EXACT, _NOTHING = 24, 1e-5, 1e-6
#: Error of a deviation after a period, relative to it, at least.
_ROUND_OFF = 1e-8


def _rig(snapshot: dict[str, Any]) -> NearbyRig:
    """Return a rig from where neighbours are watched: where it samples, round-off decides."""
    rig = NearbyRig.restore(snapshot)
    rig.go_between_samples()
    return rig


def _course(events: Iterable[Event]) -> list[tuple[int, int]]:
    """Return what neighbours have in common: their events, but for instants and numbers."""
    return [(int(event.kind), event.stop) for event in events]


def _near(rig: NearbyRig, scales: Scales) -> float:
    """Return how far apart neighbours are at first."""
    return max(_NEAR, _CLEAR * scales.rate * math.ulp(rig.time))


def _first_deviation(state: RigState) -> Array:
    """Return a deviation of the motion, in all the ways in which it can deviate."""
    ways = {'x': 0.6, 'velocity': 0.3}
    if state.mode <= Mode.STICK:
        ways |= {'clearance_1': -0.5, 'clearance_2': 0.5}
    if state.mode < Mode.STICK:
        ways |= {'relative_velocity': 0.55}
    deviation = np.array(
        [ways.get(str(p[-1]), 0.0) if p[0] == 'origin' else 0.0 for p in state.places]
    )
    return deviation / float(np.linalg.norm(deviation))


class _Period:
    """A period of a motion under control, through which deviations are carried."""

    def __init__(self, rig: NearbyRig, period: float, scales: Scales, side: float) -> None:
        self.rig = rig
        self.begun = rig.state()
        self.end = rig.time + period
        self.near = _WIDER * _near(rig, scales)
        self.step = side * self.near * scales.of(self.begun)
        #: Error of a deviation, relative to it: instants are the coarsest numbers of a state.
        self.round_off = max(_ROUND_OFF, scales.rate * math.ulp(self.end) / self.near)
        self.last = NearbyRig.restore(rig.snapshot())
        self.course = _course(self.last.advance(self.end))
        self.reached = self.last.state()

    def carried(self, deviation: Array) -> Array | None:
        """Return what becomes of a deviation; None if neighbours on either side part."""
        for side in (1.0, -1.0):
            step = side * self.step
            other = self.rig.at(self.begun, self.begun.numbers + step * deviation)
            if other is None or _course(other.advance(self.end)) != self.course:
                continue
            there = other.state()
            if not there.alike(self.reached):
                continue
            image: Array = (there.numbers - self.reached.numbers) / step
            if self.near * float(np.linalg.norm(image)) < _PARTED:
                return image
        return None

    def multiplier(self) -> tuple[float, float]:
        """
        Return the modulus of the largest multiplier, and its error; NaN if neighbours part.

        Notes
        -----
        A deviation is carried through the period, made orthogonal to those before, and carried
        through it again (Arnoldi, Quart. Appl. Math. 9, 1951), until nothing new comes or the
        largest multiplier of what has come stays as it is. The error is what is left then, and
        what the round-off of a deviation makes of a multiplier, its root if that is double.
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
            # Twice, since once leaves a part of the order of round-off over what is left
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

    Parameters
    ----------
    snapshot : dict
        The rig, of a `ControlledRig`.
    period : float
        The period, s.
    scales : Scales
        What makes the numbers of its state comparable.

    Returns
    -------
    Exponent
        The mean of ln(largest multiplier)/period of two periods in a row, with neighbours on
        either side; the uncertainty is the difference and the error of the multiplier. NaN if
        neighbours decide differently.
    float
        The modulus of the largest multiplier.
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

    Parameters
    ----------
    snapshot : dict
        The rig, of a `ControlledRig`.
    cycle : float
        Cycle of the force, s.
    cycles : int
        For how many of them neighbours are watched, at least 21.
    scales : Scales
        What makes the numbers of its state comparable.

    Returns
    -------
    Exponent
        Mean growth of the separation of two neighbours and its uncertainty, as of
        `lyapunov.growth_exponent`; NaN if they decide differently in more than one of twenty
        cycles.
    """
    rig = _rig(snapshot)
    begun, state = rig.time, rig.state()
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
        events: tuple[list[Event], list[Event]] = ([], [])
        while apart is None and done < min(cycles, first + _PATIENCE):
            done += 1
            events[0].extend(rig.advance(begun + done * cycle))
            state = rig.state()
            if other is not None:
                events[1].extend(other.advance(rig.time))
                apart = _separation(state, other, events, scales)
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
    return batched_exponent(
        np.array([growth[part].sum() for part in parts]),
        np.array([spans[part].sum() for part in parts]),
    )


def _separation(
    state: RigState, other: NearbyRig, events: tuple[list[Event], list[Event]], scales: Scales
) -> Array | None:
    """Return how far a neighbour is, scaled; None if it is none any more, or not at present."""
    there = other.state()
    if not there.alike(state) or _course(events[0]) != _course(events[1]):
        return None
    apart = (there.numbers - state.numbers) / scales.of(state)
    return apart if float(np.linalg.norm(apart)) < _PARTED else None
