"""A branch of periodic motions as a curve, and Newton's method in planes across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impact_damper_ros.rig import ParameterError

from .equations import Array
from .family import Family, limits_of
from .orbit import PeriodicOrbit

__all__ = ['Curve', 'Point']

#: Largest residual of a point on a branch.
RESIDUAL_TOLERANCE = 1e-11

_CORRECTIONS = 8
_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Point:
    """
    A point of a branch.

    Attributes
    ----------
    place : ndarray, shape (n + 1,)
        The unknowns and the scaled parameter.
    tangent : ndarray, shape (n + 1,)
        Unit vector along the branch.
    orbit : PeriodicOrbit
        The motion.
    """

    place: Array
    tangent: Array
    orbit: PeriodicOrbit


class Curve:
    """
    The solutions of a family as a curve, with the scaled parameter as the last coordinate.

    Parameters
    ----------
    family : Family
        The equations.
    scale : float
        What the parameter is divided by.
    """

    def __init__(self, family: Family, scale: float) -> None:
        self.family = family
        self.scale = scale

    def value(self, place: Array) -> float:
        """Return the parameter, on the edge of its range if round-off has put it beyond."""
        value = float(place[-1]) * self.scale
        low, high = limits_of(self.family.name)
        slack = _ROUND_OFF * self.scale
        if low - slack <= value < low:
            return low
        return high if high < value <= high + slack else value

    def system(self, place: Array) -> tuple[Array, Array]:
        """Return the residual and its derivative by unknowns and parameter."""
        residual, by_unknowns = self.family.residual(place[:-1], self.value(place))
        step = 1e-6 * max(abs(float(place[-1])), 1e-3)
        sides = []
        for move in (step, -step):
            try:
                there = self.family.residual(place[:-1], (place[-1] + move) * self.scale)[0]
                sides.append((move, there))
            except ParameterError:
                # At the edge of the admissible range, from within
                sides.append((0.0, residual))
        (ahead, value_ahead), (behind, value_behind) = sides
        by_value = (value_ahead - value_behind) / (ahead - behind)
        return residual, np.column_stack([by_unknowns, by_value])

    def correct(self, guess: Array, normal: Array) -> Point | None:
        """Return the point of the curve in the plane through a guess, or None."""
        place = guess
        history: list[float] = []
        try:
            for _ in range(_CORRECTIONS):
                residual, matrix = self.system(place)
                history.append(float(np.abs(residual).max()))
                if len(history) > 2 and history[-1] > 0.5 * history[-2]:
                    break
                full = np.vstack([matrix, normal])
                missing = np.append(residual, normal @ (place - guess))
                # At a branch point the matrix is singular: the shortest correction
                place = place - np.linalg.lstsq(full, missing, rcond=1e-12)[0]
            residual, matrix = self.system(place)
            history.append(float(np.abs(residual).max()))
            if not history[-1] < RESIDUAL_TOLERANCE:
                return None
            tangent = np.linalg.svd(matrix)[2][-1]
            tangent = tangent if tangent @ normal >= 0.0 else -tangent
            orbit = self.family.orbit(place[:-1], self.value(place), tuple(history))
        except (ArithmeticError, np.linalg.LinAlgError, ParameterError):
            return None
        return Point(place, tangent, orbit)

    def ahead(self, point: Point, step: float) -> Point | None:
        """Return the point a step further along the curve, or None."""
        return self.correct(point.place + step * point.tangent, point.tangent)
