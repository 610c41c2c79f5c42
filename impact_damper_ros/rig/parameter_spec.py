"""
What a parameter is: its meaning, unit, range and default, and the check of a value.

A frozen dataclass derived from `ParameterTable` declares its parameters with the field makers of
this module. `specs_of` returns them by name; ROS descriptors, parameters files, error messages and
the documentation are made from that.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import field, fields, replace
from itertools import islice
from math import isfinite
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias

from .quoting import shown

Value: TypeAlias = float | bool | int | str | tuple[float, ...]
Kind: TypeAlias = Literal['double', 'bool', 'double_array', 'integer', 'string']

#: When a value that is set while the node runs takes effect.
Effect: TypeAlias = Literal['now', 'next reset', 'next recording', 'start']

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
    for each entry. A number with a `least` is 0, which stands for what `zero` says, or at least
    that. `choices` are the texts that a string may be; without any it may be every text but an
    empty one. `effect` is when a value that is set while the node runs takes effect.
    """

    name: str
    description: str
    unit: str
    low: float | None
    high: float | None
    kind: Kind
    default: Value
    choices: tuple[str, ...] = ()
    least: float = 0.0
    zero: str = ''
    effect: Effect = 'now'

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
        """Return a value, which may come from a file, checked and in the type of the kind."""
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
        if hasattr(value, '__float__') and not isinstance(value, bool) and not _is_list(value):
            value = (value,)
        if isinstance(value, str | bytes) or not _is_list(value):
            raise ParameterError(
                self.name, f'{self.name} is {shown(value)}: give a list of numbers, such as [1.0]'
            )
        # What is given may have no end
        entries = tuple(islice(value, MAX_HARMONICS + 1))
        if not 1 <= len(entries) <= MAX_HARMONICS:
            count = len(value) if hasattr(value, '__len__') else f'{len(entries)} or more'
            raise ParameterError(
                self.name,
                f'{self.name} has {count} entries: give 1 to {MAX_HARMONICS}, one for each '
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
        if 0.0 < number < self.least:
            raise ParameterError(
                self.name,
                f'{where} is {value!r}{unit}: give 0 ({self.zero}) or a number from '
                f'{self.least:g} to {self.high:g}{unit}',
            )
        return number


def _is_list(value: Any) -> bool:
    """Return whether a value has entries; a numpy array may be one number."""
    return hasattr(value, '__iter__') and getattr(value, 'shape', None) != ()


def number_between(name: str, value: Any, low: float, high: float) -> float:
    """Return a number of any kind as a float; or raise a `ParameterError` that names it."""
    number = float('nan')
    if hasattr(value, '__float__') and not isinstance(value, bool):
        with suppress(TypeError, ValueError, OverflowError):
            number = float(value)
    if not low <= number <= high:
        raise ParameterError(
            name, f'{name} is {shown(value)}: give a number from {low:g} to {high:g}'
        )
    return number


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number of any kind as an int; or raise a `ParameterError` that names it."""
    with suppress(ParameterError):
        number = number_between(name, value, low, high)
        if number == int(number):
            return int(number)
    raise ParameterError(
        name, f'{name} is {shown(value)}: give a whole number from {low} to {high}'
    )


def double_field(
    default: float,
    low: float,
    high: float,
    unit: str,
    description: str,
    *,
    least: float = 0.0,
    zero: str = '',
    effect: Effect = 'now',
) -> Any:
    """Declare a number."""
    limits = description, unit, low, high
    return _declared(*limits, 'double', default, least=least, zero=zero, effect=effect)


def integer_field(
    default: int,
    low: int,
    high: int,
    unit: str,
    description: str,
    *,
    least: int = 0,
    zero: str = '',
    effect: Effect = 'now',
) -> Any:
    """Declare a whole number."""
    limits = description, unit, low, high
    return _declared(*limits, 'integer', default, least=least, zero=zero, effect=effect)


def bool_field(default: bool, description: str, *, effect: Effect = 'now') -> Any:
    """Declare a yes or no."""
    return _declared(description, '', None, None, 'bool', default, effect=effect)


def string_field(
    default: str, choices: tuple[str, ...], description: str, *, effect: Effect = 'now'
) -> Any:
    """Declare a text; one of some choices, if there are any."""
    return _declared(
        description, '', None, None, 'string', default, choices=choices, effect=effect
    )


def array_field(default: float, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a list of numbers; by default it has one."""
    return _declared(description, unit, low, high, 'double_array', (default,))


def _declared(
    description: str,
    unit: str,
    low: float | None,
    high: float | None,
    kind: Kind,
    default: Value,
    **more: Any,
) -> Any:
    """Return a dataclass field with what `ParameterSpec` has of it, but for the name."""
    spec = ParameterSpec('', description, unit, low, high, kind, default, **more)
    return field(default=default, metadata={'spec': spec})


_SPECS: dict[type, dict[str, ParameterSpec]] = {}


def specs_of(table: type) -> dict[str, ParameterSpec]:
    """Return the parameters that a dataclass declares, by name."""
    if table not in _SPECS:
        _SPECS[table] = {
            entry.name: entry.metadata['spec']._replace(name=entry.name)
            for entry in fields(table)
            if 'spec' in entry.metadata
        }
    return _SPECS[table]


class ParameterTable:
    """Values of the parameters that a frozen dataclass declares; checked when it is made."""

    __slots__ = ()
    #: What they are the parameters of.
    _owner: ClassVar[str] = ''

    def __post_init__(self) -> None:
        """Replace every value by its checked one."""
        for name, spec in specs_of(type(self)).items():
            object.__setattr__(self, name, spec.checked(getattr(self, name)))

    def replace(self, **changes: Any) -> Self:
        """
        Return the table with some parameters changed, all at once.

        Raises
        ------
        ParameterError
            If a name is unknown or the changed table is not admissible.
        """
        for name in changes:
            if name not in specs_of(type(self)):
                raise ParameterError(name, f'{name} is not a parameter of {self._owner}')
        return replace(self, **changes)  # type: ignore[type-var]

    def as_dict(self) -> dict[str, Any]:
        """Return name and value of every parameter."""
        return {name: getattr(self, name) for name in specs_of(type(self))}
