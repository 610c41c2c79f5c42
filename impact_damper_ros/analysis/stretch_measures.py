"""What is measured of a stretch of a recorded run, and what is found to be wrong with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

__all__ = ['Decay', 'EnergyBalance', 'Finding', 'ImpactStates', 'MeasuredMotion', 'Overall']


@dataclass(frozen=True)
class ImpactStates:
    """
    The impacts of one period, in order.

    Attributes
    ----------
    stops : tuple of int
        The stops hit, 1 (the lower one) or 2.
    phases : tuple of float
        Instants in cycles of the force since its zero angle, the first in [0, 1), all in [0, k).
    x : tuple of float
        X, m.
    primary_velocity_before, primary_velocity_after : tuple of float
        X' just before and just after, m/s.
    damper_velocity_before, damper_velocity_after : tuple of float
        Z' just before and just after, m/s.
    impulse : tuple of float
        Moduli of the impulses, N s.
    """

    stops: tuple[int, ...]
    phases: tuple[float, ...]
    x: tuple[float, ...]
    primary_velocity_before: tuple[float, ...]
    primary_velocity_after: tuple[float, ...]
    damper_velocity_before: tuple[float, ...]
    damper_velocity_after: tuple[float, ...]
    impulse: tuple[float, ...]


@dataclass(frozen=True)
class MeasuredMotion:
    """
    The steady part of a stretch, or, where it does not settle, its second half.

    Attributes
    ----------
    start, end : float
        The part measured, rig time, s.
    x_max, x_rms : float
        Largest |X| and root mean square of X, m.
    amplitude_ratio : float
        x_max as a share of the amplitude A without impacts; NaN if there is no such.
    impacts : int
        Number of impacts.
    impacts_per_cycle : float
        The same per cycle of the force; NaN without a force.
    mean_impulse, largest_impulse : float
        Of the impacts, N s; 0 without any.
    last_period : ImpactStates or None
        The last whole period of a periodic or settling motion.
    """

    start: float
    end: float
    x_max: float
    x_rms: float
    amplitude_ratio: float
    impacts: int
    impacts_per_cycle: float
    mean_impulse: float
    largest_impulse: float
    last_period: ImpactStates | None = None


@dataclass(frozen=True, kw_only=True)
class Overall:
    """
    Numbers over a whole stretch or run, whatever the motion, from the log alone.

    Between two joint states in a row, and the impacts between them, X is the cubic through the
    recorded positions and velocities. Integrals leave out where samples are missing, and what is
    before the first and after the last joint state of a stretch.

    Attributes
    ----------
    duration : float
        Length, s.
    covered : float
        How much of it the integrals (`x_rms`, `dashpot_energy`, `force_work`) go over, s.
    x_max : float
        Largest |X|, also between the samples, m; X from the static equilibrium of M.
    x_rms : float
        Root mean square of X over the time covered, m; the mean of X is not taken off.
    impacts, impacts_on_stop_1, impacts_on_stop_2 : int
        Number of recorded impacts.
    impact_energy : float
        Kinetic energy that M lost in all recorded impacts, J: by velocities and impulses, exact.
        The loose mass got a part of it; the rest became heat. Where m rests on a stop, it takes
        energy from M, or gives some back, without an impact.
    dashpot_energy : float
        Energy that the dashpot took from M, J.
    force_work : float
        Work of the force on M, J; NaN where its phase is not known, or its frequency is swept.
    accuracy : float
        Estimate of the largest relative error of `x_max`, `x_rms` and `dashpot_energy` (and of
        `force_work`, as a share of the work there and back) by the cubics:
        (W h)^4/200 + mu (W h)^3/50, with the longest interval h, the highest circular frequency
        W of natural vibration and force, and the mass ratio mu, whose term stands only with
        friction.
    """

    duration: float
    covered: float
    x_max: float
    x_rms: float
    impacts: int
    impacts_on_stop_1: int
    impacts_on_stop_2: int
    impact_energy: float
    dashpot_energy: float
    force_work: float
    accuracy: float

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the same over several stretches: sums, the largest |X|, the common rms."""
        covered = sum(part.covered for part in parts)
        squares = sum(part.x_rms**2 * part.covered for part in parts if part.covered > 0.0)
        largest = [part.x_max for part in parts if not math.isnan(part.x_max)]
        return cls(
            duration=sum(part.duration for part in parts),
            covered=covered,
            x_max=max(largest, default=math.nan),
            x_rms=math.sqrt(squares / covered) if covered > 0.0 else math.nan,
            impacts=sum(part.impacts for part in parts),
            impacts_on_stop_1=sum(part.impacts_on_stop_1 for part in parts),
            impacts_on_stop_2=sum(part.impacts_on_stop_2 for part in parts),
            impact_energy=math.fsum(part.impact_energy for part in parts),
            dashpot_energy=math.fsum(part.dashpot_energy for part in parts),
            force_work=math.fsum(part.force_work for part in parts),
            accuracy=max((part.accuracy for part in parts), default=0.0),
        )


@dataclass(frozen=True)
class EnergyBalance:
    """
    Where the energy went over whole periods, in J: force + air = all the others + residual.

    Attributes
    ----------
    start, end : float
        Rig time, s.
    periods : int
        Periods between them; cycles of the force where the motion is not periodic.
    force, air : float
        Work of the force on M, and of the compressed air on both masses.
    dashpot, friction, impacts : float
        Energy lost in each.
    stored : float
        Change of kinetic and potential energy.
    residual : float
        What is left unexplained.
    tolerance : float
        How much may be, by interpolation between the samples.
    """

    start: float
    end: float
    periods: int
    force: float
    air: float
    dashpot: float
    friction: float
    impacts: float
    stored: float
    residual: float
    tolerance: float


@dataclass(frozen=True)
class Decay:
    """
    The approach to the periodic motion.

    Attributes
    ----------
    measured : float
        Factor by which the distance shrinks in a period; NaN if it could not be measured.
    predicted : float
        Largest modulus of the multipliers; NaN without a prediction.
    periods : int
        Periods on which it was measured.
    distance : float
        Distance from the periodic motion at the end, relative.
    floor : float
        Distance below which whole nanoseconds of the stamps hide everything.
    """

    measured: float
    predicted: float
    periods: int
    distance: float
    floor: float


@dataclass(frozen=True)
class Finding:
    """
    One thing that is not as it should be.

    Attributes
    ----------
    quantity, unit : str
        What differs: ``'X at impact 2'``, ``'gap'``.
    time : float
        Rig time, s.
    measured, expected, tolerance : float
        By how much; NaN where there are no numbers.
    text : str
        A sentence with the numbers.
    """

    quantity: str
    unit: str
    time: float
    measured: float
    expected: float
    tolerance: float
    text: str

    @property
    def difference(self) -> float:
        """Measured minus expected value."""
        return self.measured - self.expected
