"""What is measured of a stretch of a recorded run, and what is found to be wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ['Decay', 'EnergyBalance', 'Finding', 'ImpactStates', 'MeasuredMotion']


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
