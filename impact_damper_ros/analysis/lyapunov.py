"""
How deviations grow along a run: its multipliers and its largest Lyapunov exponent.

The state (X, X', Z, Z') at a fixed instant is carried by the free vibration of each flight and by
the saltation matrix of each event, as in `orbits.floquet`; here for all flights and events of a
run at once, from nothing but the list of its events. The many impacts that a complete chatter
has after its cut act together as one plastic impact. Müller, Chaos Solitons Fractals 5 (1995),
gives the method for impacts; Parker and Chua, Practical Numerical Algorithms for Chaotic Systems
(1989), the estimate from renormalised growth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.long_run import Events
from impact_damper_ros.rig.mode import SLIDE_DOWN, SLIDE_UP, STICK, Machine
from impact_damper_ros.rig.oscillator import Oscillator

__all__ = [
    'BATCHES',
    'Deviations',
    'Exponent',
    'batched_exponent',
    'deviations',
    'growth_exponent',
    'monodromy_of',
]

Array = NDArray[np.float64]

#: Parts of a run whose mean growths are compared, for the uncertainty of the exponent.
BATCHES = 20
#: 97.5 % point of Student's distribution with BATCHES - 1 degrees of freedom.
_STUDENT = 2.093

_PLACE = np.array([-1.0, 0.0, 1.0, 0.0])
_SPEED = np.array([0.0, -1.0, 0.0, 1.0])


@dataclass(frozen=True)
class Deviations:
    """
    The matrices that carry deviations of (X, X', Z, Z') through a stretch of a run.

    Attributes
    ----------
    start, end : float
        The stretch, s.
    instants : ndarray, shape (n,)
        The events in it, s.
    events : ndarray, shape (n, 4, 4)
        Their saltation matrices.
    modes : ndarray of int, shape (n + 1,)
        The mode before each event, and after the last.
    machine : Machine
        The rig.
    """

    start: float
    end: float
    instants: Array
    events: Array
    modes: NDArray[np.int64]
    machine: Machine

    def steps(self, ends: Array) -> tuple[Array, NDArray[np.int64]]:
        """
        Cut the stretch at instants.

        Parameters
        ----------
        ends : ndarray, shape (m,)
            Where a part ends, s; rising, the last one at the end of the stretch.

        Returns
        -------
        matrices : ndarray, shape (n + m, 4, 4)
            A matrix for each flight with the event after it, if there is one.
        parts : ndarray of int, shape (n + m,)
            The part each of them belongs to.
        """
        order = np.searchsorted(self.instants, ends, side='right')
        nodes = np.insert(self.instants, order, ends)
        # Events at the end of a part come before it, as in `searchsorted`
        cut = np.zeros(len(nodes), dtype=bool)
        cut[order + np.arange(len(ends))] = True
        before = np.concatenate([[self.start], nodes[:-1]])
        flight = np.cumsum(~cut) - ~cut
        matrices = _flight_matrices(self.machine, self.modes[flight], nodes - before)
        matrices[~cut] = self.events @ matrices[~cut]
        return matrices, np.cumsum(cut) - cut


@dataclass(frozen=True)
class Exponent:
    """
    A largest Lyapunov exponent.

    Attributes
    ----------
    value : float
        Mean rate of growth of a deviation, 1/s.
    uncertainty : float
        Half of a 95 % interval, 1/s.
    """

    value: float
    uncertainty: float

    @property
    def standard_error(self) -> float:
        """Standard error of the mean growth of the parts, 1/s."""
        return self.uncertainty / _STUDENT


def _vibrations(oscillator: Oscillator, spans: Array) -> Array:
    envelope = np.exp(-oscillator.decay * spans)
    impulse = envelope * np.sin(oscillator.frequency * spans) / oscillator.frequency
    cosine = envelope * np.cos(oscillator.frequency * spans)
    matrices = np.empty((len(spans), 2, 2))
    matrices[:, 0, 0] = cosine + oscillator.decay * impulse
    matrices[:, 0, 1] = impulse
    matrices[:, 1, 0] = -oscillator.omega_squared * impulse
    matrices[:, 1, 1] = cosine - oscillator.decay * impulse
    return matrices


def _flight_matrices(machine: Machine, modes: NDArray[np.int64], spans: Array) -> Array:
    """Return the matrix of each flight, by its mode and duration."""
    matrices = np.zeros((len(spans), 4, 4))
    apart, stuck, on_stop = modes < STICK, modes == STICK, modes > STICK
    matrices[apart, :2, :2] = _vibrations(machine.free, spans[apart])
    matrices[apart, 2, 2] = matrices[apart, 3, 3] = 1.0
    matrices[apart, 2, 3] = spans[apart]
    matrices[~apart, :2, :2] = _vibrations(machine.joint, spans[~apart])
    # Friction holds m wherever it is; a stop leaves it no deviation
    matrices[stuck, 2] = matrices[stuck, 0] + _PLACE
    matrices[on_stop, 2] = matrices[on_stop, 0]
    matrices[~apart, 3] = matrices[~apart, 1]
    return matrices


def deviations(
    machine: Machine,
    angles: tuple[float, ...],
    events: Events,
    mode: int,
    last_stop: int,
    start: float,
    end: float,
) -> Deviations:
    """
    Return the matrices of a stretch of a run.

    Parameters
    ----------
    machine : Machine
        The rig.
    angles : tuple of float
        Angle turned by each harmonic at time 0, rad.
    events : ndarray of EVENT_TYPE
        Events in a row; they may begin before the stretch and reach beyond it.
    mode : int
        The mode before the first of these events.
    last_stop : int
        The stop hit last before them, or 0.
    start, end : float
        The stretch, s.
    """
    count, time, x = len(events), events['time'], events['x']
    kind, stop = events['kind'], events['stop']
    impact = kind == EventKind.IMPACT
    modes = np.concatenate([[mode], events['mode']]).astype(np.int64)
    joint = modes >= STICK
    direction = np.where(modes == SLIDE_DOWN, 1.0, np.where(modes == SLIDE_UP, -1.0, 0.0))
    hit = np.concatenate([[last_stop], np.where(impact, stop, 0)])
    hit = hit[np.maximum.accumulate(np.where(hit > 0, np.arange(count + 1), 0))]
    air = machine.air * np.choose(hit, [0.0, -1.0, 1.0])

    drive = np.zeros(count)
    for force, rate, phase, angle in zip(
        machine.free.forces, machine.free.frequencies, machine.phases, angles, strict=True
    ):
        drive += force * np.sin(rate * time + (phase + angle))
    mu = machine.mass_ratio

    def rates(flight: slice, velocity: Array, damper: Array) -> Array:
        """Return (X', X'', Z', Z'') at the events, in the flights before or after them."""
        free, both = machine.free, machine.joint
        way, push, together = direction[flight], air[flight], joint[flight]
        common = (velocity + mu * damper) / (1.0 + mu)
        apart = (
            drive
            + mu * (way * machine.grip - push)
            - 2.0 * free.decay * velocity
            - free.omega_squared * x
        )
        one = (
            drive / (1.0 + mu)
            + mu / (1.0 + mu) * machine.slope
            - 2.0 * both.decay * common
            - both.omega_squared * x
        )
        slide = machine.slope - way * machine.grip + push
        return np.where(
            together[:, None],
            np.stack([common, one, common, one], axis=-1),
            np.stack([velocity, apart, damper, slide], axis=-1),
        )

    before = rates(
        slice(0, count), events['primary_velocity_before'], events['damper_velocity_before']
    )
    after = rates(
        slice(1, count + 1), events['primary_velocity_after'], events['damper_velocity_after']
    )
    restitution = np.where(stop == 1, machine.restitution_1, machine.restitution_2)
    # Plastic, or the cut of a chatter: all the impacts to come are one
    jump = _jumps(mu, np.where(joint[1:], 0.0, restitution), impact)
    normal = np.where(impact[:, None], _PLACE, _SPEED)
    across = np.einsum('ij,ij->i', normal, before)
    # A release changes nothing, since the relative acceleration is zero there
    apart = np.isin(kind, (EventKind.REVERSAL, EventKind.STICK, EventKind.REST)) & ~joint[:-1]
    crosses = (impact | apart) & (across != 0.0)
    rise = (after - np.einsum('ijk,ik->ij', jump, before)) / np.where(crosses, across, 1.0)[
        :, None
    ]
    matrices = jump + np.where(crosses[:, None, None], rise[:, :, None] * normal[:, None, :], 0.0)
    inside = (time > start) & (time <= end)
    first = int(np.count_nonzero(time <= start))
    return Deviations(
        start=start,
        end=end,
        instants=time[inside],
        events=matrices[inside],
        modes=modes[first : first + int(inside.sum()) + 1],
        machine=machine,
    )


def _jumps(mass_ratio: float, restitution: Array, impact: NDArray[np.bool_]) -> Array:
    """Return the derivative of the state after each event by the one before it."""
    total = 1.0 + mass_ratio
    jump = np.zeros((len(restitution), 4, 4))
    jump[:, range(4), range(4)] = 1.0
    hit = np.zeros((len(restitution), 4, 4))
    hit[:, 0, 0] = hit[:, 2, 2] = 1.0
    hit[:, 1, 1] = (1.0 - mass_ratio * restitution) / total
    hit[:, 1, 3] = mass_ratio * (1.0 + restitution) / total
    hit[:, 3, 1] = (1.0 + restitution) / total
    hit[:, 3, 3] = (mass_ratio - restitution) / total
    return np.where(impact[:, None, None], hit, jump)


def monodromy_of(along: Deviations, ends: Array) -> list[Array]:
    """
    Return the product of the matrices over each part of a stretch.

    Parameters
    ----------
    along : Deviations
        The stretch.
    ends : ndarray
        Where each part ends, s; rising, the last one at the end of the stretch.
    """
    matrices, parts = along.steps(ends)
    products: list[Array] = [np.eye(4) for _ in ends]
    for matrix, part in zip(matrices, parts, strict=True):
        products[part] = matrix @ products[part]
    return products


def growth_exponent(along: Deviations, omega: float) -> Exponent:
    """
    Return the largest Lyapunov exponent from the growth of one deviation.

    Parameters
    ----------
    along : Deviations
        The stretch.
    omega : float
        Natural circular frequency, rad/s, which makes velocities comparable with displacements.

    Returns
    -------
    Exponent
        The mean growth of the logarithm over the last 20 of 21 parts of the stretch (the first
        one turns the deviation into the direction that grows most), and by Student's distribution
        the 95 % interval of the mean of these parts.
    """
    ends = np.linspace(along.start, along.end, BATCHES + 2)[1:]
    ends[-1] = along.end
    matrices, parts = along.steps(ends)
    scale = np.array([omega, 1.0, omega, 1.0])
    matrices = scale[:, None] * matrices / scale
    # Neither symmetric nor along an axis, so that it has a part in every direction
    vector = np.array([0.6, 0.3, -0.5, 0.55])
    growth = np.zeros(len(ends))
    for matrix, part in zip(matrices, parts, strict=True):
        vector = matrix @ vector
        norm = math.sqrt(float(vector @ vector))
        if norm == 0.0:
            return Exponent(-math.inf, 0.0)
        growth[part] += math.log(norm)
        vector /= norm
    return batched_exponent(growth, np.diff(ends, prepend=along.start))


def batched_exponent(growth: Array, spans: Array) -> Exponent:
    """
    Return the exponent from the growth in each part of a time.

    Parameters
    ----------
    growth : ndarray, shape (BATCHES + 1,)
        Growth of the logarithm of a deviation in each part; that in the first is left out.
    spans : ndarray, shape (BATCHES + 1,)
        How long each part is, s.
    """
    rates: Any = growth[1:] / spans[1:]
    return Exponent(float(rates.mean()), _STUDENT * float(rates.std(ddof=1)) / math.sqrt(BATCHES))
