"""A branch of periodic motions: its equations, and the curve of their solutions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.mode import rig_constants

from .equations import Array, ImpactEquations, OrbitError, single_harmonic
from .impact_solver import Root
from .orbit import PeriodicOrbit
from .search import counted_as, orbit_of, within_theory
from .shooting import Section, follow_section, orbit_on, section_on

__all__ = [
    'Curve',
    'EquationFamily',
    'Family',
    'Point',
    'ShootingFamily',
    'family_of',
    'limits_of',
    'value_of',
    'with_value',
]


#: A name for both coefficients of restitution at once.
BOTH_RESTITUTIONS = 'restitution'
# Multisine and sweep have no periodic motion.
_VARIABLE = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind in ('double', 'double_array') and not name.startswith(('multisine_', 'sweep_'))
]


def value_of(parameters: RigParameters, name: str) -> float:
    """Return the value of a parameter that a continuation can vary."""
    if name == BOTH_RESTITUTIONS:
        return parameters.restitution_1
    spec = PARAMETER_SPECS.get(name)
    if spec is None or name not in _VARIABLE:
        raise OrbitError(
            f'{name!r} cannot be varied: give one of {", ".join(_VARIABLE)}, or '
            f'{BOTH_RESTITUTIONS}'
        )
    value = getattr(parameters, name)
    return float(value[0] if isinstance(value, tuple) else value)


def with_value(parameters: RigParameters, name: str, value: float) -> RigParameters:
    """Return the rig with one parameter, as `value_of` names it, changed."""
    if name == BOTH_RESTITUTIONS:
        return parameters.replace(restitution_1=value, restitution_2=value)
    if PARAMETER_SPECS[name].kind == 'double_array':
        entries = getattr(parameters, name)
        return parameters.replace(**{name: (value, *entries[1:])})
    return parameters.replace(**{name: value})


def limits_of(name: str) -> tuple[float, float]:
    """Return the least and largest value of a parameter, as `value_of` names it."""
    spec = PARAMETER_SPECS['restitution_1' if name == BOTH_RESTITUTIONS else name]
    assert spec.low is not None
    assert spec.high is not None
    return spec.low, spec.high


class Family(Protocol):
    """
    What a continuation needs to know: n equations in n unknowns and one parameter.

    Attributes
    ----------
    name : str
        The parameter, as `value_of` names it.
    """

    name: str

    def start(self, orbit: PeriodicOrbit) -> Array:
        """Return the unknowns of a motion of this family."""

    def residual(self, unknowns: Array, value: float) -> tuple[Array, Array]:
        """Return the equations' residual, and its derivative by the unknowns."""

    def orbit(self, unknowns: Array, value: float, history: tuple[float, ...]) -> PeriodicOrbit:
        """Return the motion at a solution."""


class EquationFamily:
    """
    Motions that the impact equations hold for.

    The unknowns are X_i over a fixed length and the angles W t_i.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    name : str
        The parameter varied.
    stops : tuple of int
        Stops hit in one period.
    cycles : int
        Period in cycles of the force.
    """

    def __init__(
        self, parameters: RigParameters, name: str, stops: tuple[int, ...], cycles: int
    ) -> None:
        self.parameters = parameters
        self.name = name
        self.stops = stops
        self.cycles = cycles
        self.length = ImpactEquations(parameters, stops, cycles).length

    def _equations(self, value: float) -> ImpactEquations:
        rig = with_value(self.parameters, self.name, value)
        return ImpactEquations(rig, self.stops, self.cycles)

    def _split(self, equations: ImpactEquations, unknowns: Array) -> tuple[Array, Array]:
        n = equations.impacts
        return unknowns[:n] * self.length, unknowns[n:] / equations.frequency

    def start(self, orbit: PeriodicOrbit) -> Array:
        """Return the unknowns of a motion of this family."""
        frequency = orbit.parameters.force_frequencies[0]
        return np.concatenate(
            [np.array(orbit.x) / self.length, frequency * np.array(orbit.instants)]
        )

    def residual(self, unknowns: Array, value: float) -> tuple[Array, Array]:
        """Return the equations' residual, and its derivative by the unknowns."""
        equations = self._equations(value)
        x, instants = self._split(equations, unknowns)
        if float(equations.durations(instants).min()) <= 0.0:
            raise ArithmeticError('impacts out of order')
        size, jacobian = equations.residual(x, instants)
        n = equations.impacts
        jacobian[:, :n] *= self.length / equations.length
        jacobian[:, n:] *= equations.rate / equations.frequency
        return size, jacobian

    def orbit(self, unknowns: Array, value: float, history: tuple[float, ...]) -> PeriodicOrbit:
        """Return the motion at a solution."""
        equations = self._equations(value)
        return orbit_of(equations, Root(*self._split(equations, unknowns), history[-1], history))


class ShootingFamily:
    """
    Motions with reversals, sticking or rest, as fixed points of the event map.

    The unknowns are the free coordinates of the state where the period begins.

    Parameters
    ----------
    orbit : PeriodicOrbit
        A motion of the family.
    name : str
        The parameter varied.
    times : int, optional
        How many of its periods make one of the family.

    Raises
    ------
    OrbitError
        If the simulator cannot follow the motion.
    """

    def __init__(self, orbit: PeriodicOrbit, name: str, times: int = 1) -> None:
        section = section_on(orbit)
        if section is None:
            raise OrbitError('the motion has too many events to be followed')
        self.parameters = orbit.parameters
        self.name = name
        self.stops = orbit.stops * times
        self.cycles = orbit.cycles * times
        self._section = section
        self._angle = section.instant * orbit.parameters.force_frequencies[0]
        length = max(orbit.x_max, 1e-3 * orbit.parameters.gap)
        speed = orbit.parameters.omega * length
        self._units: Array = np.array([length, speed, length, speed])[: section.dimension]

    def _placed(self, rig: RigParameters, unknowns: Array) -> Section:
        section = self._section
        return Section(
            self._angle / rig.force_frequencies[0],
            section.resting,
            section.last_stop,
            unknowns * self._units,
        )

    def start(self, orbit: PeriodicOrbit) -> Array:
        """Return the unknowns of the motion that the family was made from."""
        assert orbit.parameters == self.parameters
        return self._section.state / self._units

    def residual(self, unknowns: Array, value: float) -> tuple[Array, Array]:
        """Return the equations' residual, and its derivative by the unknowns."""
        rig = with_value(self.parameters, self.name, value)
        period = self.cycles * math.tau / rig.force_frequencies[0]
        shot = follow_section(rig_constants(rig), self._placed(rig, unknowns), period)
        if shot is None:
            raise ArithmeticError('the motion changes its kind where the period begins')
        change, matrix = shot
        jacobian = (matrix - np.eye(len(change))) * self._units / self._units[:, None]
        return change / self._units, jacobian

    def orbit(self, unknowns: Array, value: float, history: tuple[float, ...]) -> PeriodicOrbit:
        """Return the motion at a solution."""
        rig = with_value(self.parameters, self.name, value)
        orbit = orbit_on(rig, self._placed(rig, unknowns), self.cycles, history)
        return counted_as(orbit, self.stops) or orbit


def family_of(orbit: PeriodicOrbit, name: str) -> Family:
    """Return the family of a motion."""
    value_of(orbit.parameters, name)
    solvable = single_harmonic(orbit.parameters) and within_theory(orbit.parameters, orbit.stops)
    if solvable and not orbit.nodes:
        return EquationFamily(orbit.parameters, name, orbit.stops, orbit.cycles)
    return ShootingFamily(orbit, name)


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
