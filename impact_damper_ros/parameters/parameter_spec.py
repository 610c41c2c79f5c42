# SPDX-License-Identifier: Apache-2.0
"""
What a parameter is: its meaning, unit, range and default, and the check of a value.

A frozen dataclass derived from `ParameterTable` declares its parameters with the field makers of
this module. `specs_of` returns them by name; ROS descriptors, parameters files, error messages and
the documentation are made from that.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import field, fields
from itertools import islice
from math import inf, isfinite, nan
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeAlias

from .quoting import as_name, quote, similar_names
from .units import UNITS, USUAL, in_si, split_number

Value: TypeAlias = float | bool | int | str | tuple[float, ...]
Kind: TypeAlias = Literal['double', 'bool', 'double_array', 'integer', 'string']

#: When a value that is set while the node runs takes effect.
Effect: TypeAlias = Literal['now', 'next reset', 'next recording', 'start']

#: Most harmonics the force may have.
MAX_HARMONICS = 1024
#: One number with a decimal comma and its unit, or several: each comma may also separate two.
_WITH_COMMA = r'\s*[-+]?\d+,\d+(?:[^\d,.;][^,.;]*)?'
_DECIMAL_COMMA = re.compile(rf'{_WITH_COMMA}(?:,\s+{_WITH_COMMA})*')


def as_float(value: Any) -> float:
    """
    Return a number as a float, one too large as infinity, and NaN for what is no number.

    A float32 would otherwise limit the digits of everything computed with it.
    """
    try:
        return float(value) if hasattr(value, '__float__') else nan
    except (TypeError, ValueError):
        return nan
    except OverflowError:
        return inf if value > 0 else -inf


def check_kind(name: str, value: object, kind: type | tuple[type, ...], wanted: str) -> None:
    """Raise a TypeError if an argument is not of a kind; `wanted` is what to give."""
    if not isinstance(value, kind):
        raise TypeError(f'{name} is {quote(value)}: give {wanted}')


class ParameterError(ValueError):
    """
    A parameter value that the rig cannot take.

    Attributes
    ----------
    name : str
        Name of the offending parameter.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters
    >>> try:
    ...     RigParameters(gap=-1.0)
    ... except ParameterError as error:
    ...     print(error.name, '-', error)
    gap - gap is -1.0 m: give a number from 1e-09 to 1e+09 m
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

    Examples
    --------
    >>> from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS
    >>> PARAMETER_SPECS['gap'].unit, PARAMETER_SPECS['gap'].read('24.5 mm')
    ('m', 0.0245)
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
        """The admissible values in words."""
        if self.kind == 'bool':
            return 'true, false'
        if self.kind == 'string':
            return ', '.join(self.choices) or 'a text'
        if self.kind == 'integer' and self.low is not None and self.high is not None:
            return f'{int(self.low)} to {int(self.high)}'
        return f'{self.low:g} to {self.high:g}'

    @property
    def usual(self) -> tuple[float, float] | None:
        """The range of most rigs; a value beyond it may be meant in another unit."""
        if self.low is None or self.high is None or self.unit not in USUAL:
            return None
        least, most = USUAL[self.unit]
        low = max(self.low, -most) if self.low <= 0.0 else max(self.low, least)
        return low, min(self.high, most)

    @property
    def usual_span(self) -> str:
        """The usual range in words; empty without one."""
        return '{:.4g} to {:.4g}'.format(*self.usual) if self.usual else ''

    def check(self, value: Any) -> Value:
        """
        Return a value checked and in the type of the kind.

        It may come from a file: a text is read as one that a person typed.
        """
        if self.low is not None:
            if isinstance(value, str):
                return self.read(value)
            if isinstance(value, list | tuple) and any(isinstance(v, str) for v in value):
                return self.read('; '.join(map(str, value)))
        if self.kind == 'string':
            return self._text(value)
        if self.kind == 'double_array':
            return self._array(value)
        if self.kind != 'bool':
            return self._number(value, self.name)
        if not isinstance(value, bool):
            raise self._error(f'{self.name} is {quote(value)}: give true or false')
        return value

    def read(self, text: str, unit: str = '') -> Value:
        """
        Return the checked value of what a person typed: ``24.5 mm``, ``2,5`` or ``[1 N; 500 mN]``.

        A number without a unit is in `unit`, in SI by default. Entries of a list are separated by
        semicolons, or by commas where these are no decimal signs.
        """
        if self.low is None:
            return self.check(text)
        parts = self._parts(text, unit)
        # A unit behind the last entry is that of all
        last = unit or (parts[-1][1] if parts else '') or self.unit
        numbers = []
        for number, own in parts:
            factor = UNITS[self.unit][own or last]
            self._in(own or last).check(number)
            numbers.append(in_si(number, factor))
        return self.check(numbers if self.kind == 'double_array' else numbers[0])

    def units_of(self, value: Any) -> set[str]:
        """Return the units in a value that may be a text; empty without one."""
        entries = value if isinstance(value, list | tuple) else [value]
        texts = (entry for entry in entries if isinstance(entry, str))
        return {own for text in texts for _, own in self._parts(text, '') if own}

    def _parts(self, text: str, unit: str) -> list[tuple[float, str]]:
        """Return number and unit of each entry of a text."""
        plain = text.strip()
        listed = plain.startswith('[') and plain.endswith(']')
        entries = [plain]
        if self.kind == 'double_array':
            inner = plain[1:-1] if listed else plain
            entries = inner.split(';') if ';' in inner else inner.split(',')
            if not listed and len(entries) > 1 and _DECIMAL_COMMA.fullmatch(inner):
                pairs = range(0, len(entries), 2)
                numbers = [f'{entries[k].strip()}.{entries[k + 1].strip()}' for k in pairs]
                raise self._error(
                    f'{self.name} is {quote(text)}: write {"; ".join(numbers)}, with a decimal '
                    f'point, or {"; ".join(e.strip() for e in entries)} for {len(entries)} numbers'
                )
        parts = [
            self._split(entry.strip(), unit) for entry in entries if entry.strip() or not listed
        ]
        bare = [number for number, own in parts if not own]
        if bare and parts[-1][1] and any(own for _, own in parts[:-1]):
            raise self._error(
                f'{self.name} is {quote(text)}: {bare[0]:g} has no unit, as others have: give '
                'each entry its unit, or only the last one'
            )
        return parts

    def in_si(self, entry: str) -> float:
        """Return one number that a person typed, in SI, of any size."""
        number, unit = self._split(entry.strip(), '')
        return in_si(number, UNITS[self.unit][unit or self.unit])

    def _split(self, entry: str, unit: str) -> tuple[float, str]:
        """Return number and unit of an entry that a person typed."""
        number, own, other = split_number(entry)
        if other:
            raise self._error(f'{self.name} is {quote(entry)}: write {other}')
        if number is None:
            raise self._error(f'{self.name} is {quote(entry)}: {self._in(unit)._remedy}')
        units = UNITS[self.unit]
        if own and own not in units:
            names = [name for name in units if name and ',' not in name]
            others = f'write {", ".join(names)}' if names else 'write none'
            raise self._error(
                f'{self.name} is {quote(entry)}: {quote(own)} is no unit of it: {others}'
            )
        return number, own

    def _in(self, unit: str) -> ParameterSpec:
        """Return the parameter with its range in another unit."""
        assert self.low is not None
        assert self.high is not None
        factor = UNITS[self.unit].get(unit, 1.0)
        if factor == 1.0:
            return self
        low, high, least = (bound / factor for bound in (self.low, self.high, self.least))
        kind: Kind = 'double' if self.kind == 'integer' else self.kind
        return self._replace(unit=unit, low=low, high=high, least=least, kind=kind)

    def _error(self, message: str) -> ParameterError:
        return ParameterError(self.name, message)

    def _array(self, value: Any) -> tuple[float, ...]:
        # A numpy array may be one number.
        listed = hasattr(value, '__iter__') and getattr(value, 'shape', None) != ()
        if not listed and hasattr(value, '__float__') and not isinstance(value, bool):
            value, listed = (value,), True
        if not listed or isinstance(value, str | bytes):
            raise self._error(
                f'{self.name} is {quote(value)}: give a list of numbers, such as [1.0]'
            )
        # The value may be an iterator without end.
        entries = tuple(islice(value, MAX_HARMONICS + 1))
        if not 1 <= len(entries) <= MAX_HARMONICS:
            count = len(value) if hasattr(value, '__len__') else f'{len(entries)} or more'
            raise self._error(
                f'{self.name} has {count} entries: give 1 to {MAX_HARMONICS}, one for each '
                'harmonic (amplitude 0 switches the force off)'
            )
        return tuple(self._number(v, f'{self.name}[{i}]') for i, v in enumerate(entries))

    @property
    def _remedy(self) -> str:
        unit = f' {self.unit}' if self.unit else ''
        number = 'a whole number' if self.kind == 'integer' else 'a number'
        degrees = ' (10° = 0.1745 rad)' if self.unit == 'rad' else ''
        return f'give {number} from {self.span}{unit}{degrees}'

    def _text(self, value: Any) -> str:
        if isinstance(value, bool) and self.choices:
            # YAML 1.1 takes an unquoted off for false.
            value = 'on' if value else 'off'
        good = isinstance(value, str) and value.strip()
        if not good or (self.choices and value not in self.choices):
            remedy = f'give one of {self.span}' if self.choices else 'give a text'
            raise self._error(f'{self.name} is {quote(value)}: {remedy}')
        return str(value)

    def _number(self, value: Any, where: str) -> float:
        assert self.low is not None
        assert self.high is not None
        unit = f' {self.unit}' if self.unit else ''
        number = nan if isinstance(value, bool) else as_float(value)
        if not isfinite(number) and not isinstance(value, float):
            raise self._error(f'{where} is {quote(value)}: {self._remedy}')
        whole = self.kind == 'integer'
        if not self.low <= number <= self.high or (whole and number != int(number)):
            percent = not unit and self.low <= 0.01 * number <= self.high
            hint = f', or {number:g} %' if percent and not whole else ''
            raise self._error(f'{where} is {number!r}{unit}: {self._remedy}{hint}')
        if 0.0 < number < self.least:
            raise self._error(
                f'{where} is {value!r}{unit}: give 0 ({self.zero}) or a number from '
                f'{self.least:g} to {self.high:g}{unit}'
            )
        # Never -0.0: a parameter that was set to it would differ from one that is 0.
        return int(number) if whole else number + 0.0


def number_between(name: str, value: Any, low: float, high: float) -> float:
    """Return a number of any kind as a float; or raise a `ParameterError` that names it."""
    number = nan if isinstance(value, bool) else as_float(value)
    if not low <= number <= high:
        raise ParameterError(
            name, f'{name} is {quote(value)}: give a number from {low:g} to {high:g}'
        )
    return number


def whole_number(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number of any kind as an int; or raise a `ParameterError` that names it."""
    with suppress(ParameterError):
        number = number_between(name, value, low, high)
        if number == int(number):
            return int(number)
    raise ParameterError(
        name, f'{name} is {quote(value)}: give a whole number from {low} to {high}'
    )


_KINDS: dict[type, Kind] = {
    float: 'double',
    int: 'integer',
    bool: 'bool',
    str: 'string',
    tuple: 'double_array',
}


def numeric(
    default: Any, low: float, high: float, unit: str, description: str, **more: Any
) -> Any:
    """Declare a number, a whole number or a list of numbers, as its default is."""
    return _declare(default, description, low, high, unit=unit, **more)


def text(default: str, choices: tuple[str, ...], description: str, **more: Any) -> Any:
    """Declare a text; one of some choices, if there are any."""
    return _declare(default, description, choices=choices, **more)


def flag(default: bool, description: str, **more: Any) -> Any:
    """Declare a yes or no."""
    return _declare(default, description, **more)


def _declare(
    default: Value,
    description: str,
    low: float | None = None,
    high: float | None = None,
    *,
    unit: str = '',
    **more: Any,
) -> Any:
    """Return a dataclass field with all entries of its `ParameterSpec` but the name."""
    kind = _KINDS[type(default)]
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

    #: The object of the parameters, as messages name it.
    _owner: ClassVar[str] = ''
    #: Remedy for a name that is no parameter.
    _remedies: ClassVar[dict[str, str]] = {}

    def __new__(cls, **values: Any) -> Self:
        """Refuse unknown names; Python's own message names no remedy."""
        known = {one.name for one in fields(cls)}  # type: ignore[arg-type]
        for name in values:
            if name not in known:
                cls._check_name(name)
        return object.__new__(cls)

    def __post_init__(self) -> None:
        """Replace every value by its checked one."""
        for name, spec in specs_of(type(self)).items():
            object.__setattr__(self, name, spec.check(getattr(self, name)))
        self._check()

    def _check(self) -> None:
        """Check the conditions between values."""

    def replace(self, **changes: Any) -> Self:
        """
        Return the table with some parameters changed, all at once.

        Raises
        ------
        ParameterError
            If a name is unknown or the changed table is not admissible.
        """
        for name in changes:
            self._check_name(name)
        table = object.__new__(type(self))
        for name, spec in specs_of(type(self)).items():
            # Values that do not change have been checked.
            value = spec.check(changes[name]) if name in changes else getattr(self, name)
            object.__setattr__(table, name, value)
        table._check()
        return table

    @classmethod
    def _check_name(cls, name: str) -> None:
        """Raise `ParameterError` if there is no such parameter."""
        if name not in specs_of(cls):
            close = similar_names(name, specs_of(cls))
            hint = f'did you mean {close}?' if close else f'give one of {", ".join(specs_of(cls))}'
            hint = cls._remedies.get(name, hint)
            raise ParameterError(
                name, f'{as_name(name)} is not a parameter of {cls._owner}: {hint}'
            )

    def __repr__(self) -> str:
        """Return the values that are not the defaults, as arguments."""
        values = ((name, getattr(self, name)) for name in specs_of(type(self)))
        own = [f'{name}={v!r}' for name, v in values if v != specs_of(type(self))[name].default]
        return f'{type(self).__name__}({", ".join(own)})'

    def as_dict(self) -> dict[str, Any]:
        """Return name and value of every parameter."""
        return {name: getattr(self, name) for name in specs_of(type(self))}
