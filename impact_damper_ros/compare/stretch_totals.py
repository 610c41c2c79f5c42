"""
Numbers over a stretch: swing, impacts and energy, added up as it is read.

Between two recorded knots X and Y are the cubics through the recorded positions and velocities:
the equation of motion does not enter, so that the residual of the balance tests it.
"""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.rig import RigParameters

from .flight_check import Knots
from .recorded_stretch import ForceClock, RecordedImpacts
from .run_comparison import EnergyBalance, Overall
from .run_curves import Array, cubic_rates, cubic_swing, turning_points

__all__ = ['StretchTotals', 'energy_balance', 'stored_energy', 'work_between']


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
# Positions on [0, 1] and weights that add up to 1
_PLACES, _SHARES = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
#: Error of the work along a cubic, in (W h)^4 of the work there and back.
_CUBIC = 0.001
#: The same of the friction where m turns or stops, in the speeds there times the interval.
_BROKEN = 0.1
_ROUND_OFF = 1e-12


def stored_energy(
    rig: RigParameters, x: Array, velocity: Array, z: Array, damper_velocity: Array
) -> Array:
    """Return kinetic and potential energy of both masses, J; X from the static equilibrium."""
    slope = rig.gravity * math.sin(rig.angle)
    primary = 0.5 * rig.primary_mass * velocity**2 + 0.5 * rig.stiffness * x**2
    energy: Array = primary + rig.damper_mass * (0.5 * damper_velocity**2 - slope * z)
    return energy


def work_between(
    rig: RigParameters, clock: ForceClock | None, begin: Knots, end: Knots
) -> tuple[float, float, float]:
    """Return the work of the force on M, that there and back, and what the dashpot takes, J."""
    step = end.time - begin.time
    v_0 = begin.velocity
    b, a = cubic_rates(step, end.x - begin.x, v_0, end.velocity_before)
    force = dashpot = there_and_back = 0.0
    # Sums and not products of vectors, whose bits depend on the number of threads
    for place, share in zip(_PLACES, _SHARES, strict=True):
        velocity = v_0 + place * (b + place * a)
        if clock is not None:
            work = clock.force(begin.time + place * step) * velocity * step
            force += share * float(np.sum(work))
            there_and_back += share * float(np.sum(np.abs(work)))
        dashpot += share * rig.damping * float(np.sum(velocity**2 * step))
    if clock is None:
        force = there_and_back = math.nan
    return force, there_and_back, dashpot


def _path_length(step: Array, rise: Array, begin: Array, end: Array) -> float:
    """Return the way there and back along cubics with given velocities at their ends."""
    length = np.abs(rise)
    turns, out = turning_points(step, rise, begin, end)
    length[turns] = np.abs(out) + np.abs(rise[turns] - out)
    return float(length.sum())


def energy_balance(clock: ForceClock, knots: Knots, periods: int) -> EnergyBalance | None:
    """Balance the energy from the first knot to the last one, both after their impact, if any."""
    if len(knots) < 2:
        return None
    rig = clock.parameters
    begin, end = knots[:-1], knots[1:]
    step = end.time - begin.time
    moved = step > 0.0
    begin, end, step = begin[moved], end[moved], step[moved]
    force, there_and_back, dashpot = work_between(rig, clock, begin, end)
    y_0, y_1 = begin.z - begin.x, end.z - end.x
    grip = rig.friction * rig.damper_mass * rig.gravity * math.cos(rig.angle)
    relative = begin.damper_velocity - begin.velocity
    later = end.damper_velocity_before - end.velocity_before
    friction = grip * _path_length(step, y_1 - y_0, relative, later)
    # Where m begins or ends to move relative to M, or turns, Y is no cubic.
    broken = (relative * later <= 0.0) & ((relative != 0.0) | (later != 0.0))
    doubt = grip * float(((np.abs(relative) + np.abs(later)) * step)[broken].sum())
    air = np.where(begin.last_stop == 1.0, -1.0, np.where(begin.last_stop == 2.0, 1.0, 0.0))
    air_work = rig.air_force * float(air @ (y_1 - y_0))
    hits = knots[1:]
    before = stored_energy(rig, hits.x, hits.velocity_before, hits.z, hits.damper_velocity_before)
    after = stored_energy(rig, hits.x, hits.velocity, hits.z, hits.damper_velocity)
    impacts = float((before - after)[hits.stop > 0.0].sum())
    ends = knots[np.array([0, len(knots) - 1])]
    energy = stored_energy(rig, ends.x, ends.velocity, ends.z, ends.damper_velocity)
    stored = float(energy[1] - energy[0])
    fastest = max([rig.omega, *rig.harmonics[1]])
    turned = fastest * float(step.max(initial=0.0))
    scale = there_and_back + dashpot + friction + abs(impacts) + float(np.abs(energy).max())
    return EnergyBalance(
        start=float(knots.time[0]),
        end=float(knots.time[-1]),
        periods=periods,
        force=force,
        air=air_work,
        dashpot=dashpot,
        friction=friction,
        impacts=impacts,
        stored=stored,
        residual=force + air_work - dashpot - friction - impacts - stored,
        tolerance=(_CUBIC * turned**4 + _ROUND_OFF) * scale + _BROKEN * doubt,
    )


#: Knots after a joint state that are kept until the next one comes; more mean that none comes.
_MOST_HELD = 20_000
#: Errors of the cubics: of a smooth motion, in (W h)^4, and by steps of the friction, in (W h)^3.
_SMOOTH, _STEPS = 1.0 / 200.0, 1.0 / 50.0


class StretchTotals:
    """
    Adds up what `Overall` has; between the parts it keeps the last joint state.

    Parameters
    ----------
    parameters : RigParameters
        The rig, as logged.
    clock : ForceClock or None
        The force; None if its phase is not known, or its frequency not constant.
    """

    def __init__(self, parameters: RigParameters, clock: ForceClock | None) -> None:
        self._rig, self._clock = parameters, clock
        self._held: Knots | None = None
        self._largest = math.nan
        self._covered = self._squares = self._dashpot = self._taken = self._longest = 0.0
        self._force = 0.0 if clock is not None else math.nan
        self._impacts = [0, 0]

    def take(self, knots: Knots, impacts: RecordedImpacts, longest: float) -> None:
        """Take the next part."""
        # A log may hold any number; what overflows is no number in the result.
        with np.errstate(over='ignore', invalid='ignore'):
            self._count(impacts)
            if len(knots):
                size = float(np.abs(knots.x).max())
                self._largest = size if math.isnan(self._largest) else max(self._largest, size)
            if self._held is not None:
                knots = Knots.joined([self._held, knots])
            samples = np.flatnonzero(knots.stop == 0.0)
            if len(samples) > 1:
                self._integrate(knots[samples[0] : samples[-1] + 1], longest)
            begin = int(samples[-1]) if len(samples) else len(knots)
            self._held = knots[begin:] if 0 < len(knots) - begin <= _MOST_HELD else None

    def _count(self, impacts: RecordedImpacts) -> None:
        for stop in (1, 2):
            self._impacts[stop - 1] += int((impacts.stop == stop).sum())
        before = impacts.velocity_before(self._rig)
        # The difference of the squares, without their cancellation
        lost = (before - impacts.velocity_after) * (before + impacts.velocity_after)
        self._taken += 0.5 * self._rig.primary_mass * float(lost.sum())

    def _integrate(self, knots: Knots, longest: float) -> None:
        """Add the integrals from the first knot to the last one, both joint states."""
        samples = np.flatnonzero(knots.stop == 0.0)
        sampled = np.diff(knots.time[samples]) <= longest
        within = np.repeat(sampled, np.diff(samples))
        step = np.diff(knots.time)
        used = within & (step > 0.0)
        if not used.any():
            return
        begin, end, step = knots[:-1][used], knots[1:][used], step[used]
        swing = cubic_swing(
            step, begin.x, end.x, begin.velocity * step, end.velocity_before * step
        )
        force, _, dashpot = work_between(self._rig, self._clock, begin, end)
        self._covered += float(step.sum())
        self._squares += swing.squares
        self._largest = max(self._largest, swing.largest)
        self._force += force
        self._dashpot += dashpot
        self._longest = max(self._longest, float(step.max()))

    def finish(self, duration: float) -> Overall:
        """Return the numbers of a stretch of a length in s."""
        rig = self._rig
        frequencies = [rig.omega, *rig.harmonics[1]]
        if rig.sweep_mode != 'off':
            frequencies.append(rig.sweep_high)
        turned = max(frequencies) * self._longest
        steps = rig.damper_mass / rig.primary_mass if rig.friction * rig.gravity > 0.0 else 0.0
        return Overall(
            duration=duration,
            covered=self._covered,
            x_max=self._largest,
            x_rms=math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan,
            impacts=sum(self._impacts),
            impacts_on_stop_1=self._impacts[0],
            impacts_on_stop_2=self._impacts[1],
            impact_energy=self._taken,
            dashpot_energy=self._dashpot,
            force_work=self._force,
            accuracy=_SMOOTH * turned**4 + _STEPS * steps * turned**3,
        )
