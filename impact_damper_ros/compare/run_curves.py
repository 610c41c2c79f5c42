"""
What a recorded run looks like: its samples and impacts as arrays, and cubics between the samples.

All are of bounded size, however long the run. Times are rig time in s, phases are in cycles of
the force's first harmonic, all else is in SI units; velocities are absolute unless said to be
relative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    'Array',
    'Convergence',
    'CubicSwing',
    'GapCurve',
    'ImpactCurve',
    'MotionCurve',
    'PredictedCurve',
    'Spectrum',
    'StretchCurves',
    'SwingEnvelope',
    'cubic_rates',
    'cubic_swing',
    'turning_points',
]


Array = NDArray[np.float64]


@dataclass(frozen=True)
class SwingEnvelope:
    """
    X over a whole stretch: least and greatest value in consecutive pieces.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Beginning of each piece, s.
    low, high : ndarray of shape (n,)
        Least and greatest sampled X in it, m.
    """

    time: Array
    low: Array
    high: Array


@dataclass(frozen=True)
class MotionCurve:
    """
    The motion in detail, as recorded: joint states, and both sides of each impact.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Instants, s, not falling; an impact is there twice, just before and just after it.
    x, velocity : ndarray of shape (n,)
        X in m, and X' in m/s.
    y, relative_velocity : ndarray of shape (n,)
        Y = Z - X in m, and Y' in m/s.
    stop_1, stop_2 : ndarray of shape (n,)
        Positions of the stops relative to M, m; NaN where there is no stop 2.
    """

    time: Array
    x: Array
    velocity: Array
    y: Array
    relative_velocity: Array
    stop_1: Array
    stop_2: Array


@dataclass(frozen=True)
class ImpactCurve:
    """
    Impacts, and so the points of the Poincare section: states just after impact.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Instants, s.
    phase : ndarray of shape (n,)
        Phase of the force, cycles in [0, 1); NaN where it is not known.
    stop : ndarray of shape (n,)
        1 or 2.
    x : ndarray of shape (n,)
        X, m.
    primary_velocity_before, primary_velocity_after : ndarray of shape (n,)
        X' just before and just after, m/s.
    damper_velocity_before, damper_velocity_after : ndarray of shape (n,)
        Z' just before and just after, m/s.
    impulse : ndarray of shape (n,)
        Modulus of the impulse, N s.
    """

    time: Array
    phase: Array
    stop: NDArray[np.int64]
    x: Array
    primary_velocity_before: Array
    primary_velocity_after: Array
    damper_velocity_before: Array
    damper_velocity_after: Array
    impulse: Array


@dataclass(frozen=True)
class PredictedCurve:
    """
    One period of the predicted motion, as a closed curve.

    It goes from just after the first impact to just after the same impact one period later.

    Attributes
    ----------
    phase : ndarray of shape (n,)
        Cycles of the force since its zero angle, not falling; an impact is there twice.
    x, velocity : ndarray of shape (n,)
        X in m, and X' in m/s.
    y, relative_velocity : ndarray of shape (n,)
        Y in m, and Y' in m/s.
    force_zero : float
        A rig time, s, at which the force's angle is zero: the phase p is at force_zero + p cycles.
        Another period of k cycles later the motion is the same.
    cycle : float
        Duration of a cycle of the force, s.
    cycles : int
        Cycles k in a period.
    """

    phase: Array
    x: Array
    velocity: Array
    y: Array
    relative_velocity: Array
    force_zero: float
    cycle: float
    cycles: int


@dataclass(frozen=True)
class Convergence:
    """
    How the recorded motion approaches the periodic one, period by period.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Beginning of each period, s.
    distance : ndarray of shape (n,)
        Distance of its impacts from those of the periodic motion: the largest difference of any
        displacement, velocity and instant, each relative to its size. Without unit.
    floor : float
        Distance below which whole nanoseconds of the stamps hide everything.
    fitted_from, fitted_to : int
        The periods (indices from, and up to but without) on which the decay was measured; equal
        if it could not be.
    measured : float
        Measured factor by which the distance shrinks in a period; NaN if it could not be measured.
    predicted : float
        The largest modulus of the multipliers; NaN without a prediction.
    """

    time: Array
    distance: Array
    floor: float
    fitted_from: int
    fitted_to: int
    measured: float
    predicted: float


@dataclass(frozen=True)
class Spectrum:
    """
    Amplitude spectrum of X, of the end of a stretch.

    Attributes
    ----------
    frequency : ndarray of shape (n,)
        In Hz.
    amplitude : ndarray of shape (n,)
        Amplitude of X, m.
    force_frequency : float
        Of the force's first harmonic, Hz.
    resolution : float
        Width of a line, Hz.
    window : str
        Name of the window.
    """

    frequency: Array
    amplitude: Array
    force_frequency: float
    resolution: float
    window: str


@dataclass(frozen=True)
class GapCurve:
    """
    The predicted motion followed in the gap, all other parameters as logged.

    Attributes
    ----------
    gap : ndarray of shape (n,)
        Gaps along the branch, m; it may turn.
    ratio : ndarray of shape (n,)
        Largest |X| as a share of that without impacts, Xmax/A.
    stable, viable : ndarray of bool, shape (n,)
        Whether the motion there is stable, and whether the rig can move so.
    special_gap, special_ratio : ndarray of shape (s,)
        Folds, period doublings, grazing and the like.
    special_kind : tuple of str
        What each of them is.
    measured_gap, measured_ratio : float
        This run.
    stops : tuple of int
        Stops hit in a period of this branch.
    ended : str
        Why it was not followed further.
    """

    gap: Array
    ratio: Array
    stable: NDArray[np.bool_]
    viable: NDArray[np.bool_]
    special_gap: Array
    special_ratio: Array
    special_kind: tuple[str, ...]
    measured_gap: float
    measured_ratio: float
    stops: tuple[int, ...]
    ended: str


@dataclass(frozen=True)
class StretchCurves:
    """
    All arrays of one stretch; None where there is nothing to show.

    Attributes
    ----------
    envelope : SwingEnvelope or None
        X over the whole stretch.
    motion : MotionCurve or None
        The end of the stretch in detail: the last periods, or the last cycles of the force.
    impacts : ImpactCurve or None
        The latest impacts, those of `motion` and more before them.
    predicted : PredictedCurve or None
        One period of the predicted motion.
    convergence : Convergence or None
        The approach to the periodic motion.
    spectrum : Spectrum or None
        Of X.
    gap_curve : GapCurve or None
        Xmax/A against the gap.
    """

    envelope: SwingEnvelope | None = None
    motion: MotionCurve | None = None
    impacts: ImpactCurve | None = None
    predicted: PredictedCurve | None = None
    convergence: Convergence | None = None
    spectrum: Spectrum | None = None
    gap_curve: GapCurve | None = None


# Four points of Gauss integrate the square of a cubic exactly
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def cubic_rates(step: Array, rise: Array, begin: Array, end: Array) -> tuple[Array, Array]:
    """
    Return b and a of the cubic's velocity begin + b s + a s^2, with s from 0 to 1.

    Parameters
    ----------
    step, rise : ndarray of shape (n,)
        Duration and displacement from one knot to the next.
    begin, end : ndarray of shape (n,)
        Velocities there.
    """
    mean = rise / step
    return 2.0 * (3.0 * mean - 2.0 * begin - end), 3.0 * (begin + end - 2.0 * mean)


def turning_points(
    step: Array, rise: Array, begin: Array, end: Array
) -> tuple[NDArray[np.intp], Array]:
    """Return where the velocity changes sign between two knots."""
    turns = np.flatnonzero(begin * end < 0.0)
    step, v_0 = step[turns], begin[turns]
    b, a = cubic_rates(step, rise[turns], v_0, end[turns])
    # Between velocities of different signs there is one root.
    root = np.sqrt(np.maximum(b * b - 4.0 * a * v_0, 0.0))
    s = 2.0 * v_0 / (-b + np.copysign(root, v_0))
    out: Array = step * s * (v_0 + s * (b / 2.0 + s * a / 3.0))
    return turns, out


class CubicSwing(NamedTuple):
    """
    Displacement along cubics, between their ends.

    Attributes
    ----------
    largest : float
        Largest |X| where X turns between two ends, m; 0 if it does not.
    total, squares : float
        Integrals of X, m s, and of its square, m^2 s.
    """

    largest: float
    total: float
    squares: float


def cubic_swing(span: Array, start: Array, end: Array, v_0: Array, v_1: Array) -> CubicSwing:
    """
    Measure how X moves along the cubics between knots.

    Parameters
    ----------
    span : ndarray of shape (n,)
        Durations, s.
    start, end : ndarray of shape (n,)
        X at both ends, m.
    v_0, v_1 : ndarray of shape (n,)
        X' there, times the duration, m.
    """
    rise = end - start
    square, cube = 3.0 * rise - 2.0 * v_0 - v_1, v_0 + v_1 - 2.0 * rise

    def at(s: Array) -> Array:
        value: Array = start + s * (v_0 + s * (square + s * cube))
        return value

    largest = 0.0
    # X' = v_0 + 2 square s + 3 cube s^2, its two roots in the form that does not cancel
    root = np.sqrt(np.maximum(square * square - 3.0 * cube * v_0, 0.0))
    half = -(square + np.copysign(root, square))
    with np.errstate(divide='ignore', invalid='ignore'):
        for s in (half / (3.0 * cube), v_0 / half):
            inside = (s > 0.0) & (s < 1.0)
            if inside.any():
                largest = max(largest, float(np.abs(at(np.where(inside, s, 0.0))).max()))
    total = squares = 0.0
    # Sums and not products of vectors, whose bits depend on the number of threads
    for place, weight in zip(0.5 * (1.0 + _GAUSS), 0.5 * _WEIGHTS, strict=True):
        value = at(np.full_like(start, place))
        total += weight * float(np.sum(value * span))
        squares += weight * float(np.sum(value * value * span))
    return CubicSwing(largest, total, squares)
