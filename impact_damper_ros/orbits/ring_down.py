# SPDX-License-Identifier: Apache-2.0
"""
Ring-down: a rig that is released, and its loss of energy in each cycle.

The energy E = M V^2/2 is that of M at the upward passages of X through the middle, whose instants
are roots of the closed motion. Of two neighbouring ones

    Psi = 1 - E_next/E,   loss factor Psi/(2 pi),   zeta = -ln(V_next/V)/(2 pi).

The dashpot alone loses 1 - exp(-4 pi zeta/eta) of the energy in each cycle; the damper causes the
rest.

References
----------
1. R. D. Friend, V. K. Kinra, "Particle impact damping", J. Sound Vib. 233 (2000), 93-118: loss
   over amplitude from the free decay, and its dimensionless acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.parameter_spec import as_float, whole_number
from impact_damper_ros.parameters.quoting import plural, quote
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters, check_rig
from impact_damper_ros.parameters.units import STANDARD_GRAVITY
from impact_damper_ros.rig.rig import Rig

from .flight_arrays import Flights, number_points, run_flights

Array = NDArray[np.float64]

#: Releases of m, one for each phase of the vibration of M.
RELEASES = 20
#: A ring-down ends at this part of its first amplitude.
END_SHARE = 0.01
#: Damping ratio above which the dashpot alone leaves less than that of the first cycle.
_MOST_ZETA = 1.0 / math.hypot(1.0, math.tau / math.log(END_SHARE))
#: Most cycles of a ring-down.
MOST_CYCLES = 2000
#: Fewest upward passages of a recorded ring-down.
_LEAST_PASSAGES = 3
_CYCLES_AT_ONCE = 50
_STEPS_PER_CYCLE = 32
#: Least number of cycles for a median and quantiles, with many releases.
_LEAST_IN_BIN = 10


@dataclass(frozen=True)
class Cycles:
    """
    Cycles of one ring-down.

    Attributes
    ----------
    time : ndarray, shape (n + 1,)
        Instants of the upward passages of X through the middle, s.
    velocity : ndarray, shape (n + 1,)
        Velocity V of M there, m/s.
    """

    time: Array
    velocity: Array

    def __repr__(self) -> str:
        """Return the number of cycles and the first velocity in a line."""
        first = f' from {self.velocity[0]:.6g} m/s' if len(self.velocity) else ''
        return f'<Cycles: {len(self.loss)}{first}>'

    @property
    def loss(self) -> Array:
        """Share of the energy that is lost in each cycle, Psi."""
        share: Array = 1.0 - (self.velocity[1:] / self.velocity[:-1]) ** 2
        return share

    @property
    def zeta(self) -> Array:
        """Damping ratio of each cycle."""
        ratio: Array = -np.log(self.velocity[1:] / self.velocity[:-1]) / math.tau
        return ratio

    def above(self, velocity: float) -> Cycles:
        """Return the first cycles, as long as V is not below a velocity, m/s."""
        over = np.flatnonzero(self.velocity < velocity)
        last = int(over[0]) if len(over) else len(self.velocity)
        return Cycles(self.time[:last], self.velocity[:last])


def middle_of(parameters: RigParameters) -> float:
    """Return the mean X of a ring-down, m: on average M carries the weight of m."""
    weight = parameters.damper_mass * parameters.gravity * math.sin(parameters.angle)
    return weight / parameters.stiffness


def cycles_of(flights: Flights) -> Cycles:
    """Return the upward passages of X through the middle in flights without force."""
    middle = middle_of(flights.rig)
    step = math.tau / flights.rig.omega / _STEPS_PER_CYCLE
    counts = np.maximum(1, np.ceil(flights.spans / step)).astype(int)
    index, place = number_points(counts)
    low = flights.spans[index] * (place / counts[index])
    high = flights.spans[index] * ((place + 1) / counts[index])
    before, after = (flights.motion(index, tau)[0] - middle for tau in (low, high))
    found = (before < 0.0) & (after >= 0.0)
    index, low, high = index[found], low[found], high[found]
    # Bisection to the last bit: X is a closed formula, and rises between both ends.
    for _ in range(60):
        between = 0.5 * (low + high)
        below = flights.motion(index, between)[0] < middle
        low, high = np.where(below, between, low), np.where(below, high, between)
    velocity = flights.motion(index, high)[1]
    return Cycles(flights.starts[index] + high, velocity)


def release_start(parameters: RigParameters, amplitude: float, phase: float) -> InitialConditions:
    """
    Return the start of a ring-down: m is let go at a phase of a vibration of M that carries it.

    The phase counts from the largest X. m starts in the middle of the gap, or on the stop to which
    its weight presses m.
    """
    weight = parameters.gravity * math.sin(parameters.angle)
    grip = parameters.friction * parameters.gravity * math.cos(parameters.angle)
    velocity = -amplitude * parameters.omega * math.sin(phase)
    half = 0.5 * parameters.gap
    on_stop = weight > grip or (weight < -grip and not parameters.one_sided)
    return InitialConditions(
        initial_primary_position=middle_of(parameters) + amplitude * math.cos(phase),
        initial_primary_velocity=velocity,
        initial_damper_offset=math.copysign(half, weight) if on_stop else 0.0,
        initial_damper_velocity=velocity,
    )


@dataclass(frozen=True)
class RingDown:
    """
    Ring-downs of a rig that differ in the phase at which m is released.

    Attributes
    ----------
    parameters : RigParameters
        The rig, without force and with its base at rest.
    amplitude : float
        First amplitude of M, m.
    runs : tuple of Cycles
        The cycles of each release.

    Examples
    --------
    >>> rig = RigParameters(damper_mass=0.06, gap=1.0, restitution_1=0.5, restitution_2=0.5)
    >>> found = ring_down(rig, 1.0, releases=2)
    >>> round(found.bound, 3), bool(found.loss.max() > found.dashpot_loss)
    (1.419, True)
    """

    parameters: RigParameters
    amplitude: float
    runs: tuple[Cycles, ...]

    def __repr__(self) -> str:
        """Return the ring-downs in a line."""
        return (
            f'<RingDown: {plural(len(self.loss), "cycle")} of '
            f'{plural(len(self.runs), "release")}, from {self.amplitude:.6g} m down>'
        )

    @cached_property
    def velocity(self) -> Array:
        """V at the beginning of each cycle of all runs, m/s."""
        return np.concatenate([run.velocity[:-1] for run in self.runs])

    @property
    def amplitudes(self) -> Array:
        """Amplitude V/omega of each cycle, m."""
        size: Array = self.velocity / self.parameters.omega
        return size

    @cached_property
    def loss(self) -> Array:
        """Share of the energy that each cycle of all runs loses, Psi."""
        return np.concatenate([run.loss for run in self.runs])

    @property
    def zeta(self) -> Array:
        """Damping ratio of each cycle of all runs."""
        return np.concatenate([run.zeta for run in self.runs])

    @property
    def dashpot_loss(self) -> float:
        """Share of the energy that the dashpot alone dissipates in each cycle."""
        return -math.expm1(-2.0 * math.tau * self.parameters.zeta / self.parameters.eta)

    @property
    def bound(self) -> float:
        """
        Psi of two impacts per cycle at X = 0, the largest loss where losses are small.

        It is 8 mu/(1 + mu) (1 + R)/(1 - R) with the mean R, plus the loss of the dashpot; infinite
        for elastic stops.
        """
        p = self.parameters
        mean = 0.5 * (p.restitution_1 + p.restitution_2)
        if mean >= 1.0:
            return math.inf
        share = p.mass_ratio / (1.0 + p.mass_ratio)
        return self.dashpot_loss + 8.0 * share * (1.0 + mean) / (1.0 - mean)

    def curve(self, bins: int = 24) -> dict[str, Array]:
        """
        Return the loss over amplitude: median and quantiles of cycles of about one amplitude.

        Returns
        -------
        dict of ndarray
            `amplitude` (m), `acceleration` (g), `cycles`, and of Psi `median`, `low` (0.1) and
            `high` (0.9).

        Notes
        -----
        All cycles in the order of their amplitudes are divided into parts: each spans the same
        factor of the amplitude, or as much more as it needs to have ten cycles, or half as many
        as there are releases.
        """
        least = min(_LEAST_IN_BIN, max(1, len(self.runs) // 2))
        order = np.argsort(self.amplitudes)
        size, loss = self.amplitudes[order], self.loss[order]
        factor = (size[-1] / size[0]) ** (1.0 / bins)
        parts, begin = [], 0
        while begin < len(size):
            end = int(np.searchsorted(size, size[begin] * factor, side='right'))
            end = max(end, begin + least)
            if len(size) - end < least:
                end = len(size)
            parts.append(slice(begin, end))
            begin = end
        to_g = self.parameters.omega**2 / STANDARD_GRAVITY
        rows = [
            (
                middle := float(np.median(size[part])),
                middle * to_g,
                float(len(size[part])),
                *np.quantile(loss[part], (0.5, 0.1, 0.9)).tolist(),
            )
            for part in parts
        ]
        names = ('amplitude', 'acceleration', 'cycles', 'median', 'low', 'high')
        return dict(zip(names, np.array(rows).reshape(-1, len(names)).T, strict=True))

    def as_dict(self) -> dict[str, Any]:
        """Return the curve over amplitude, and its references, for JSON."""
        return {
            'amplitude': self.amplitude,
            'releases': len(self.runs),
            'cycles': len(self.loss),
            'dashpot_loss': self.dashpot_loss,
            'bound': self.bound if math.isfinite(self.bound) else None,
            'curve': {name: column.tolist() for name, column in self.curve().items()},
        }


def is_free(parameters: RigParameters) -> bool:
    """Return whether nothing shakes a rig: no force acts, and its base is at rest."""
    return not any(parameters.harmonics[0])


def recorded_ring_down(flights: Flights) -> RingDown | None:
    """
    Return the ring-down of flights without force; None if M does not swing.

    Parameters
    ----------
    flights : Flights
        The motion from the release on.

    Returns
    -------
    RingDown or None
        One run, whose first amplitude is that of the first upward passage; it ends by the rule of
        `ring_down`.
    """
    if flights.drive is None or not is_free(flights.rig) or flights.active.any():
        return None
    cycles = cycles_of(flights)
    if not len(cycles.time) or not cycles.velocity[0] > 0.0:
        return None
    omega = flights.rig.omega
    run = cycles.above(END_SHARE * float(cycles.velocity[0]))
    if len(run.time) < _LEAST_PASSAGES:
        return None
    return RingDown(flights.rig, float(cycles.velocity[0]) / omega, (run,))


def _parts(rig: Rig, amplitude: float, most_cycles: int) -> Iterator[Cycles]:
    """Yield the cycles of a ring-down in parts, until it is over."""
    period = math.tau / rig.parameters.omega
    for _ in range(math.ceil(most_cycles / _CYCLES_AT_ONCE)):
        part = cycles_of(run_flights(rig, rig.time + _CYCLES_AT_ONCE * period))
        yield part
        last = part.velocity[-1] if len(part.velocity) else 0.0
        if last < END_SHARE * amplitude * rig.parameters.omega:
            return


def ring_down(
    parameters: RigParameters,
    amplitude: float,
    *,
    releases: int = RELEASES,
    most_cycles: int = MOST_CYCLES,
) -> RingDown:
    """
    Release a rig and let it ring down, once for each phase at which m is let go.

    Parameters
    ----------
    parameters : RigParameters
        The rig; its force and the motion of its base are switched off.
    amplitude : float
        First amplitude of M, m.
    releases : int, optional
        Number of phases.
    most_cycles : int, optional
        Cycles after which a ring-down ends; it ends earlier at 1 % of its first amplitude.

    Returns
    -------
    RingDown
        Passages, velocities and losses of all cycles.

    Raises
    ------
    TypeError
        If the rig is no `RigParameters`.
    ValueError
        If the amplitude is not positive, or no release swings up twice before it is over.
    RunawayError
        If the rig has too many events.

    Examples
    --------
    >>> rig = RigParameters(damper_mass=0.06, gap=1.0, restitution_1=0.5, restitution_2=0.5)
    >>> found = ring_down(rig, 1.0, releases=4)
    >>> bool(found.curve()['median'].max() > 4.0 * found.dashpot_loss)
    True
    """
    check_rig('parameters', parameters)
    if not 0.0 < as_float(amplitude) < math.inf:
        raise ValueError(f'amplitude is {quote(amplitude)} m: give a positive number')
    releases = whole_number('releases', releases, 1, 10_000)
    most_cycles = whole_number('most_cycles', most_cycles, 1, 2**31)
    free = parameters.replace(
        force_amplitudes=(0.0,),
        force_frequencies=(parameters.omega,),
        force_phases=(0.0,),
        base_amplitudes=(0.0,),
        base_frequencies=(parameters.omega,),
        base_phases=(0.0,),
        multisine_level=0.0,
        sweep_mode='off',
    )
    runs = []
    for k in range(releases):
        start = release_start(free, amplitude, math.tau * k / releases)
        parts = list(_parts(Rig(free, start, compiled=None), amplitude, most_cycles))
        time, velocity = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ('time', 'velocity')
        )
        runs.append(Cycles(time, velocity).above(END_SHARE * amplitude * free.omega))
    runs = [run for run in runs if len(run.time) > 1]
    if not runs:
        raise ValueError(
            f'from {amplitude:.4g} m no cycle of M ends above {100.0 * END_SHARE:g} % of that: '
            'give '
            + (
                f'less damping (the damping ratio is {free.zeta:.3g}, and above {_MOST_ZETA:.2f} '
                'the dashpot alone leaves less)'
                if free.zeta > _MOST_ZETA
                else 'a larger amplitude, or less damping'
            )
        )
    return RingDown(free, amplitude, tuple(runs))
