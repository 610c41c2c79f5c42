# SPDX-License-Identifier: Apache-2.0
"""What varies along a branch: a parameter by its name, or any path of rigs, and its range."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from impact_damper_ros.parameters.parameter_spec import (
    ParameterSpec,
    number_between,
    whole_number,
)
from impact_damper_ros.parameters.quoting import quote, similar_names
from impact_damper_ros.parameters.rig_parameters import (
    PARAMETER_SPECS,
    RigParameters,
    check_rig,
    slowness,
)

from .arguments import OrbitError, single_harmonic

#: A name for both coefficients of restitution at once.
BOTH_RESTITUTIONS = 'restitution'
#: The reciprocal of `restitution_speed`, s/m: 0 is a constant restitution.
SLOWNESS = 'restitution_slowness'
# Multisine and sweep have no periodic motion.
_VARIABLE = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if spec.kind in ('double', 'double_array') and not name.startswith(('multisine_', 'sweep_'))
]

_KNOWN = (*_VARIABLE, SLOWNESS, BOTH_RESTITUTIONS)


def _check_name(name: str) -> None:
    if name not in _KNOWN:
        close = similar_names(name, _KNOWN)
        hint = f'did you mean {close}? There are ' if close else 'give one of '
        raise OrbitError(
            f'{quote(name)} cannot be varied: {hint}{", ".join(_KNOWN[:-1])}, or {_KNOWN[-1]}'
        )


def spec_of(name: str) -> ParameterSpec:
    """Return the specification of a quantity that a continuation can vary."""
    if name == SLOWNESS:
        speed = PARAMETER_SPECS['restitution_speed']
        return speed._replace(unit='s/m', low=0.0, high=1.0 / speed.least, least=0.0)
    return PARAMETER_SPECS['restitution_1' if name == BOTH_RESTITUTIONS else name]


def value_of(parameters: RigParameters, name: str) -> float:
    """
    Return the value of a parameter that a continuation can vary.

    Raises
    ------
    TypeError
        If the rig is no `RigParameters`.
    OrbitError
        If the parameter cannot be varied.

    Examples
    --------
    >>> value_of(RigParameters(), 'gap')
    37.0
    """
    check_rig('parameters', parameters)
    _check_name(name)
    if name == BOTH_RESTITUTIONS:
        one, other = parameters.restitution_1, parameters.restitution_2
        if one != other:
            raise OrbitError(
                f'{name} is one value for both stops, but restitution_1 is {one:.9g} and '
                f'restitution_2 {other:.9g}: vary restitution_1 or restitution_2, or in Python '
                'give a function that returns the rig with both of them'
            )
        return one
    value = getattr(parameters, name)
    return float(value[0] if isinstance(value, tuple) else value)


def number_of(name: str, value: float | str) -> float:
    """Return a value of a parameter that may be a text with a unit, in SI."""
    if not isinstance(value, str):
        return value
    return spec_of(name).in_si(value) if name in _KNOWN else float(value)


def with_value(parameters: RigParameters, name: str, value: float) -> RigParameters:
    """
    Return the rig with one parameter, as `value_of` names it, changed.

    Raises
    ------
    OrbitError
        If the parameter cannot be varied.
    ParameterError
        If the value is out of range.

    Examples
    --------
    >>> with_value(RigParameters(), 'gap', 30.0).gap
    30.0
    """
    if name == BOTH_RESTITUTIONS:
        return parameters.replace(restitution_1=value, restitution_2=value)
    if name == SLOWNESS:
        return parameters.replace(restitution_speed=slowness(value))
    _check_name(name)
    if PARAMETER_SPECS[name].kind == 'double_array':
        entries = getattr(parameters, name)
        return parameters.replace(**{name: (value, *entries[1:])})
    return parameters.replace(**{name: value})


#: A parameter by its name, or the rig as a function of a number.
Path = str | Callable[[float], RigParameters]


def range_of(path: Path, low: float | str, high: float | str) -> tuple[float, float]:
    """Return the ends of a range, each of which may be a text with a unit, in SI."""
    name = path if isinstance(path, str) else ''
    if name:
        _check_name(name)
    for end, value in (('low', low), ('high', high)):
        if not hasattr(value, '__float__') and not isinstance(value, str):
            raise OrbitError(f'{end} is {quote(value)}: give a number, or a text with a unit')
    return number_of(name, low), number_of(name, high)


@dataclass(frozen=True)
class Steps:
    """The parameter that varies along a branch, its bounds, and the steps; see `follow`."""

    path: Path
    low: float
    high: float
    start: float | None = None
    largest_step: float = 0.05
    most_points: int = 400

    def __post_init__(self) -> None:
        """Check the range."""
        if isinstance(self.path, str):
            _check_name(self.path)
        elif not callable(self.path):
            raise OrbitError(f'path is {quote(self.path)}: give a name, or a function of a number')
        text = f'{self.name} from {self.low:.9g} to {self.high:.9g}'
        if not -math.inf < self.low < self.high < math.inf:
            raise OrbitError(f'{text} is no range: give two numbers, the low end first')
        least, most = self.bounds[-2:]
        if self.low < least or self.high > most:
            raise OrbitError(
                f'{text} is beyond what is admissible: give a range within {least:.9g} to '
                f'{most:.9g}'
            )
        number_between('largest_step', self.largest_step, 1e-6, 1.0)
        whole_number('most_points', self.most_points, 2, 1_000_000)

    @property
    def name(self) -> str:
        """The name of the parameter; that of a function."""
        name = self.path if isinstance(self.path, str) else getattr(self.path, '__name__', '')
        return name if name.isidentifier() else 'the parameter'

    def rig(self, parameters: RigParameters, value: float) -> RigParameters:
        """Return a rig at another value."""
        path = self.path
        return with_value(parameters, path, value) if isinstance(path, str) else path(value)

    def value(self, parameters: RigParameters) -> float:
        """Return the value at which the branch begins with a rig; or raise `OrbitError`."""
        if isinstance(self.path, str):
            if self.path in ('force_frequencies', 'base_frequencies'):
                self._check_frequency(parameters)
            value = value_of(parameters, self.path)
        else:
            ends = (self.low, self.high) if self.start is None else (self.start,)
            values = [value for value in ends if self.path(value) == parameters]
            if not values:
                raise OrbitError(
                    f'the motion is of another rig than {self.name} returns at '
                    f'{" and ".join(f"{v:.9g}" for v in ends)}: give start, where it returns that'
                )
            value = values[0]
        if not self.contains(value):
            raise OrbitError(
                f'{self.name} is {value:.9g} where the branch begins: give a range around that, '
                f'not {self.low:.9g} to {self.high:.9g}'
            )
        return value

    def _check_frequency(self, parameters: RigParameters) -> None:
        """Raise `OrbitError` where one frequency is not that of the motion."""
        if not single_harmonic(parameters):
            raise OrbitError(
                f'{self.name} is the frequency of the first harmonic, and the others do not '
                'follow it: give a function that returns the rig with all of them'
            )
        if self.name != f'{parameters.swept}_frequencies':
            raise OrbitError(
                f'the {parameters.swept} shakes the rig: follow {parameters.swept}_frequencies'
            )

    @cached_property
    def bounds(self) -> tuple[float, ...]:
        """The ends of the range, and the least and largest admissible value, if known."""
        if not isinstance(self.path, str):
            return self.low, self.high
        spec = spec_of(self.path)
        assert spec.low is not None
        assert spec.high is not None
        return self.low, self.high, spec.low, spec.high

    def contains(self, value: float) -> bool:
        """Return whether a value is within the range."""
        return self.low <= value <= self.high
