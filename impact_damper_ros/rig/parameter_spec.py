"""
What a parameter is: its name, meaning, unit and range, and how a value is checked against them.

A frozen dataclass declares its parameters with the field makers of this module and calls
`check_fields` in its `__post_init__`; `specs_of` then gives the table from which ROS descriptors,
parameters files, error messages and the documentation are made.
"""

from __future__ import annotations

from dataclasses import field, fields
from math import isfinite
from typing import Any, Literal, NamedTuple, TypeAlias

from .shown import shown

__all__ = [
    'MAX_HARMONICS',
    'NUMBER_KINDS',
    'ParameterError',
    'ParameterSpec',
    'Value',
    'array_field',
    'bool_field',
    'check_fields',
    'double_field',
    'integer_field',
    'specs_of',
    'string_field',
]

Value: TypeAlias = float | bool | int | str | tuple[float, ...]
Kind: TypeAlias = Literal['double', 'bool', 'double_array', 'integer', 'string']

#: Kinds whose values are numbers, with a range.
NUMBER_KINDS = ('double', 'double_array', 'integer')
#: Most harmonics the force may have.
MAX_HARMONICS = 1024


class ParameterError(ValueError):
    """
    A parameter value that the rig cannot take.

    Attributes
    ----------
    name : str
        Name of the offending parameter.
    """

    def __init__(self, name: str, message: str) -> None:
        """Keep the name apart, so that callers can point at the parameter."""
        super().__init__(message)
        self.name = name


class ParameterSpec(NamedTuple):
    """
    What a parameter is: its meaning, unit and closed range.

    `low` and `high` are finite for a number, and None for a bool or a text; for an array they hold
    for each entry. `choices` are the texts that a string may be; without any it may be every text
    but an empty one.
    """

    name: str
    description: str
    unit: str
    low: float | None
    high: float | None
    kind: Kind
    default: Value
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name with unit, for messages, tables and plots."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name

    @property
    def span(self) -> str:
        """What values it may have, in words."""
        if self.kind == 'bool':
            return 'true, false'
        if self.kind == 'string':
            return ', '.join(self.choices) or 'a text'
        if self.kind == 'integer' and self.low is not None and self.high is not None:
            return f'{int(self.low)} to {int(self.high)}'
        return f'{self.low:g} to {self.high:g}'

    def checked(self, value: Any) -> Value:
        """
        Return the value as the kind asks: a float, a bool, an int, a text or a tuple of floats.

        Parameters
        ----------
        value : Any
            A number, a bool, a text or a sequence of numbers. Integers become floats for a
            double, and whole floats integers for an integer.

        Returns
        -------
        Value
            The value, of the type that the kind names.

        Raises
        ------
        ParameterError
            If the type is wrong, or a number is outside the range, NaN or infinite.
        """
        if self.kind == 'bool':
            if not isinstance(value, bool):
                raise ParameterError(
                    self.name, f'{self.name} is {shown(value)}: give true or false'
                )
            return value
        if self.kind == 'string':
            return self._text(value)
        if self.kind == 'integer':
            number = self._number(value, self.name)
            if number != int(number):
                raise ParameterError(self.name, f'{self.name} is {number!r}: {self._remedy}')
            return int(number)
        if self.kind == 'double':
            return self._number(value, self.name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = (value,)
        if isinstance(value, str | bytes) or not hasattr(value, '__iter__'):
            raise ParameterError(
                self.name, f'{self.name} is {shown(value)}: give a list of numbers, such as [1.0]'
            )
        entries = tuple(value)
        if not 1 <= len(entries) <= MAX_HARMONICS:
            raise ParameterError(
                self.name,
                f'{self.name} has {len(entries)} entries: give 1 to {MAX_HARMONICS}, one for each '
                'harmonic (amplitude 0 switches the force off)',
            )
        return tuple(self._number(v, f'{self.name}[{i}]') for i, v in enumerate(entries))

    @property
    def _remedy(self) -> str:
        unit = f' {self.unit}' if self.unit else ''
        number = 'a whole number' if self.kind == 'integer' else 'a number'
        degrees = ' (10° = 0.1745 rad)' if self.unit == 'rad' else ''
        return f'give {number} from {self.span}{unit}{degrees}'

    def _text(self, value: Any) -> str:
        if isinstance(value, bool):
            # YAML 1.1 takes an unquoted off for false.
            value = {False: 'off', True: 'on'}[value] if self.choices else value
        if not isinstance(value, str) or not value.strip():
            remedy = f'give one of {self.span}' if self.choices else 'give a text'
            raise ParameterError(self.name, f'{self.name} is {shown(value)}: {remedy}')
        if self.choices and value not in self.choices:
            raise ParameterError(
                self.name, f'{self.name} is {shown(value)}: give one of {", ".join(self.choices)}'
            )
        return value

    def _number(self, value: Any, where: str) -> float:
        assert self.low is not None
        assert self.high is not None
        unit = f' {self.unit}' if self.unit else ''
        if isinstance(value, bool) or not hasattr(value, '__float__'):
            raise ParameterError(self.name, f'{where} is {shown(value)}: {self._remedy}')
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(self.name, f'{where} is {shown(value)}: {self._remedy}') from None
        if not isfinite(number) or not self.low <= number <= self.high:
            raise ParameterError(self.name, f'{where} is {number!r}{unit}: {self._remedy}')
        return number


def double_field(default: float, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number."""
    return field(
        default=default,
        metadata={'spec': (description, unit, low, high, 'double', default)},
    )


def integer_field(default: int, low: int, high: int, unit: str, description: str) -> Any:
    """Declare a whole number."""
    return field(
        default=default,
        metadata={'spec': (description, unit, low, high, 'integer', default)},
    )


def bool_field(default: bool, description: str) -> Any:
    """Declare a yes or no."""
    return field(
        default=default, metadata={'spec': (description, '', None, None, 'bool', default)}
    )


def string_field(default: str, choices: tuple[str, ...], description: str) -> Any:
    """Declare a choice between texts."""
    return field(
        default=default,
        metadata={'spec': (description, '', None, None, 'string', default, choices)},
    )


def array_field(default: float, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a list of numbers; by default it has one."""
    return field(
        default=(default,),
        metadata={'spec': (description, unit, low, high, 'double_array', (default,))},
    )


def specs_of(cls: type) -> dict[str, ParameterSpec]:
    """Return the parameters that a dataclass declares, by name."""
    return {f.name: ParameterSpec(f.name, *f.metadata['spec']) for f in fields(cls)}


def check_fields(instance: Any, specs: dict[str, ParameterSpec]) -> None:
    """
    Replace every field of a frozen dataclass by its checked value, in its `__post_init__`.

    Raises
    ------
    ParameterError
        If a value is not admissible.
    """
    for name, spec in specs.items():
        object.__setattr__(instance, name, spec.checked(getattr(instance, name)))
