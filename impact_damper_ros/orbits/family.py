"""One-parameter families of periodic motions: the equations that a continuation follows."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from impact_damper_ros.rig import PARAMETER_SPECS, RigParameters
from impact_damper_ros.rig.mode import make_machine

from .equations import Array, ImpactEquations
from .error import OrbitError, single_harmonic
from .newton import Root
from .orbit import PeriodicOrbit
from .search import counted_as, orbit_of, within_theory
from .shooting import Section, follow_section, orbit_on, section_on

__all__ = [
    'EquationFamily',
    'Family',
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
    """
    Return the value of a parameter that a continuation can vary.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    name : str
        Name of a number or an array of the rig's parameters, of which the first entry counts; or
        'restitution' for both coefficients at once.

    Raises
    ------
    OrbitError
        If there is no such parameter.
    """
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
    """
    Return the rig with one parameter, as `value_of` names it, changed.

    Raises
    ------
    ParameterError
        If the rig is not admissible.
    """
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
        shot = follow_section(make_machine(rig), self._placed(rig, unknowns), period)
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
    """
    Return the family of a motion.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion.
    name : str
        The parameter varied, as `value_of` names it.
    """
    value_of(orbit.parameters, name)
    solvable = single_harmonic(orbit.parameters) and within_theory(orbit.parameters, orbit.stops)
    if solvable and not orbit.nodes:
        return EquationFamily(orbit.parameters, name, orbit.stops, orbit.cycles)
    return ShootingFamily(orbit, name)
