"""The plan of a sweep: the parameters that are varied, their values, and the order of the rigs."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from itertools import pairwise
from pathlib import Path
from sys import float_info
from typing import Any, NamedTuple, Self

import numpy as np

import impact_damper_ros
from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.orbits.settling import Settling
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    ParameterError,
    ParameterSpec,
    RigParameters,
)
from impact_damper_ros.rig.parameter_spec import number_between
from impact_damper_ros.rig.parameters_file import YamlError, guarded_yaml
from impact_damper_ros.rig.quoting import named, shown

_SPECS: dict[str, ParameterSpec] = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
_NAME = re.compile(r'(?P<name>[A-Za-z_][A-Za-z0-9_]*)(\[(?P<index>\d+)\])?')
_BOOLS = {'true': True, 'false': False}
_MOST_VALUES = 1_000_000
_MOST_RIGS = 2_000_000
#: Raised whenever the same inputs give other rows.
_TABLE_FORMAT = 2


class AxisError(ValueError):
    """A range that a sweep cannot use; the message names it and the remedy."""


@dataclass(frozen=True, order=True)
class SweptParameter:
    """A parameter of rig or gap control, an initial condition, or an entry of an array."""

    name: str
    index: int | None = None  # entry of an array, from 0

    def __str__(self) -> str:
        return self.name if self.index is None else f'{self.name}[{self.index}]'

    @classmethod
    def named(cls, text: str) -> Self:
        """Return the parameter whose `str` is given."""
        match = _NAME.fullmatch(text)
        if match is None:
            raise AxisError(f'{shown(text)} is not the name of a parameter')
        return cls(match['name'], None if match['index'] is None else int(match['index']))

    @property
    def spec(self) -> ParameterSpec:
        """Kind, unit, range and meaning."""
        return _SPECS[self.name]

    @property
    def initial(self) -> bool:
        """Whether it is one of the initial conditions."""
        return self.name in INITIAL_SPECS

    @property
    def control(self) -> bool:
        """Whether it is a parameter of the gap control."""
        return self.name in GAP_CONTROL_SPECS


#: Parameters with the values that they take in one rig.
Settings = Sequence[tuple[SweptParameter, float]]


@dataclass(frozen=True)
class Axis:
    """
    One axis of the grid of a sweep.

    Attributes
    ----------
    parameters : tuple of SweptParameter
        The parameters that take the values; usually one.
    values : tuple of float or bool
        The values, strictly increasing.
    logarithmic : bool
        Whether the values are in geometric progression; figures then have a logarithmic axis.
    """

    parameters: tuple[SweptParameter, ...]
    values: tuple[float, ...]
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not self.parameters or not self.values:
            raise AxisError('an axis without parameters or values: give one of each, or more')
        for value in self.values:
            if not isinstance(value, bool):
                number_between('an entry of values', value, -float_info.max, float_info.max)

    @property
    def name(self) -> str:
        """Name of the first parameter."""
        return str(self.parameters[0])

    @property
    def initial(self) -> bool:
        """Whether initial conditions are varied."""
        return self.parameters[0].initial

    def __len__(self) -> int:
        return len(self.values)


def _parameter(text: str, rig: RigParameters) -> SweptParameter:
    """Return the parameter with the name that a user has given."""
    text = text.strip()
    match = _NAME.fullmatch(text)
    name = text if match is None else match['name']
    if name not in _SPECS:
        close = difflib.get_close_matches(name, _SPECS, 1)
        hint = f'did you mean {close[0]}?' if close else f'give one of {", ".join(_SPECS)}'
        raise AxisError(f'{shown(text)} is not a parameter of the rig: {hint}')
    kind, index = _SPECS[name].kind, SweptParameter.named(text).index
    if kind == 'double_array':
        count = len(getattr(rig, name))
        if index is None and count > 1:
            raise AxisError(
                f'{name} has {count} entries in this rig: say which one, such as {name}[0]'
            )
        if index is not None and index >= count:
            raise AxisError(
                f'{text}: {name} has {count} entr{"y" if count == 1 else "ies"} in this '
                f'rig: give {name}[0]' + (f' to {name}[{count - 1}]' if count > 1 else '')
            )
        return SweptParameter(name, index if count > 1 else None)
    if index is not None:
        raise AxisError(f'{text}: {name} is one value, not an array: write {name}')
    if kind not in ('double', 'bool', 'integer'):
        raise AxisError(f'{name} is a text and has no range: choose it with --set {name}=...')
    return SweptParameter(name)


def _number(value: Any, where: str) -> float:
    if isinstance(value, str) and value.strip().lower() in _BOOLS:
        return _BOOLS[value.strip().lower()]
    if isinstance(value, bool):
        return value
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise AxisError(f'{where}: {shown(value)} is not a number') from None
    if not math.isfinite(number):
        raise AxisError(f'{where}: {shown(value)} is not a finite number')
    return number


def _axis(
    names: Sequence[str],
    values: Sequence[float],
    rig: RigParameters,
    where: str,
    *,
    logarithmic: bool = False,
) -> Axis:
    """Return an axis, after all checks of its names and values."""
    parameters = tuple(_parameter(name, rig) for name in names)
    if len(set(parameters)) < len(parameters):
        raise AxisError(f'{where}: the same name is given twice')
    if len({parameter.initial for parameter in parameters}) > 1:
        raise AxisError(f'{where}: parameters and initial conditions cannot share values')
    if not values:
        raise AxisError(f'{where}: there are no values: give at least one')
    for parameter in parameters:
        boolean = parameter.spec.kind == 'bool'
        for value in values:
            if isinstance(value, bool) is not boolean:
                wanted = 'true and false' if boolean else 'numbers'
                raise AxisError(f'{where}: {parameter} takes {wanted}, not {shown(value)}')
            if parameter.spec.kind == 'integer' and value != round(value):
                raise AxisError(f'{where}: {parameter} takes whole numbers, not {shown(value)}')
            try:
                parameter.spec.checked(value)
            except ParameterError as error:
                raise AxisError(f'{where}: {error}') from None
    ordered = tuple(sorted(values))
    repeated = next((a for a, b in pairwise(ordered) if a == b), None)
    if repeated is not None:
        raise AxisError(f'{where}: the value {repeated!r} is given twice')
    return Axis(parameters, ordered, logarithmic)


def _spaced(low: float, high: float, count: Any, spacing: str, where: str) -> list[float]:
    """Return values from end to end, both included."""
    number = _number(count, where)
    if isinstance(low, bool) or isinstance(high, bool):
        raise AxisError(f'{where}: true and false have no range: write true,false')
    if number != round(number) or not 1 <= number <= _MOST_VALUES:
        raise AxisError(f'{where}: {count} values: give a whole number from 1 to {_MOST_VALUES}')
    if spacing not in ('linear', 'log'):
        raise AxisError(f'{where}: spacing {spacing!r}: give linear or log')
    if number == 1 and low != high:
        raise AxisError(
            f'{where}: one value cannot reach from {low:g} to {high:g}: give 2 or more'
        )
    if number > 1 and low == high:
        raise AxisError(
            f'{where}: from {low:g} to {high:g} is not a range: give two different ends'
        )
    if spacing == 'log' and min(low, high) <= 0.0:
        raise AxisError(f'{where}: a logarithmic range needs positive ends')
    progression = np.geomspace if spacing == 'log' else np.linspace
    values: list[float] = progression(low, high, int(number)).tolist()
    return values


def axis_from_text(text: str, rig: RigParameters) -> Axis:
    """
    Read an axis as the command line gives it, NAME=RANGE.

    Parameters
    ----------
    text : str
        RANGE is LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or V1,V2,...; NAME may be several names, as in
        ``restitution_1=restitution_2=0.5:0.9:41``, which then take the same value.
    rig : RigParameters
        The rig, for the lengths of its arrays.

    Returns
    -------
    Axis
        The axis, its values in rising order.

    Raises
    ------
    AxisError
        If a name is unknown or the range is empty, not finite or not a range.

    Examples
    --------
    >>> axis_from_text('gap=10:30:3', RigParameters()).values
    (10.0, 20.0, 30.0)
    """
    if '=' not in text:
        raise AxisError(f'{shown(text)}: give NAME=LOW:HIGH:COUNT, such as gap=10:60:200')
    *names, values = text.split('=')
    text = named(text)
    for name in names:
        _parameter(name, rig)
    if ':' not in values:
        listed = [part for part in values.strip().strip('[]').split(',') if part.strip()]
        return _axis(names, [_number(part, text) for part in listed], rig, text)
    low, high, *rest = (part.strip() for part in values.split(':'))
    if len(rest) not in (1, 2):
        raise AxisError(f'{text}: give LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or V1,V2,...')
    count, spacing = rest[0], rest[1] if rest[1:] else 'linear'
    spaced = _spaced(_number(low, text), _number(high, text), count, spacing, text)
    return _axis(names, spaced, rig, text, logarithmic=spacing == 'log')


def axis_from_mapping(name: str, entry: Any, rig: RigParameters) -> Axis:
    """
    Read one entry of a ranges file.

    The name or names are as on the command line. The entry is the text of the command line, a list
    of values, or a mapping with the keys ``from``, ``to``, ``count`` and optionally ``spacing``
    (linear or log). Raises `AxisError` as `axis_from_text` does.
    """
    names = name.split('=')
    if isinstance(entry, str):
        return axis_from_text(f'{name}={entry}', rig)
    if isinstance(entry, Mapping):
        keys = set(entry)
        if not {'from', 'to', 'count'} <= keys <= {'from', 'to', 'count', 'spacing'}:
            raise AxisError(
                f'{name}: has the keys {", ".join(map(str, entry)) or "(none)"}: give from, to '
                'and count, and spacing: log if wanted'
            )
        low, high = (_number(entry[key], name) for key in ('from', 'to'))
        spacing = str(entry.get('spacing', 'linear'))
        spaced = _spaced(low, high, entry['count'], spacing, name)
        return _axis(names, spaced, rig, name, logarithmic=spacing == 'log')
    listed = entry if isinstance(entry, Sequence) else [entry]
    return _axis(names, [_number(value, name) for value in listed], rig, name)


def axes_from_file(path: Path, rig: RigParameters) -> list[Axis]:
    """Read the axes of a ranges file, in YAML."""
    try:
        content: Any = guarded_yaml(path)
    except OSError as error:
        reason = error.strerror or error
        raise AxisError(f'{path}: cannot be read ({reason}): give a YAML file') from error
    except YamlError as error:
        raise AxisError(f'{path}: {error}') from error
    ranges = content.get('vary') if isinstance(content, dict) else None
    if not isinstance(ranges, dict) or set(content) != {'vary'}:
        raise AxisError(
            f'{path}: start the file with "vary:" and, indented below it, lines such as '
            '"gap: 10:60:200" or "gap: {from: 10, to: 60, count: 200}"'
        )
    return [axis_from_mapping(str(name), entry, rig) for name, entry in ranges.items()]


class Follow(Enum):
    """How the rigs of a sweep start."""

    #: Each from the initial conditions.
    NONE = 'none'
    #: Along rising values of the first axis, each from the last state of the one before.
    UP = 'up'
    #: The same along falling values.
    DOWN = 'down'
    #: Both, each from the initial conditions at its end.
    BOTH = 'both'

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions followed; one empty name if the rigs are independent."""
        if self is Follow.NONE:
            return ('',)
        return ('up', 'down') if self is Follow.BOTH else (self.value,)


class SweepPoint(NamedTuple):
    """The place of one rig in a sweep."""

    row: int  # its row in the table, from 0
    direction: str  # 'up', 'down', or empty if it does not start from another rig's state
    values: tuple[float, ...]  # its value on each axis


class RigSetup(NamedTuple):
    """A rig, its start, its gap control, and how it is watched."""

    parameters: RigParameters
    initial: InitialConditions
    settling: Settling
    control: GapControlParameters
    law: str = ''  # MODULE:FUNCTION of a law of the user's own; empty for none

    def varied(self, settings: Settings) -> Self:
        """Return the setup with other values, all set at once."""
        rig: dict[str, Any] = {}
        start: dict[str, Any] = {}
        law: dict[str, Any] = {}
        for parameter, value in settings:
            name, kind = parameter.name, parameter.spec.kind
            if parameter.initial:
                start[name] = value
            elif kind == 'double_array':
                entries = list(rig.get(name, getattr(self.parameters, name)))
                entries[parameter.index or 0] = value
                rig[name] = tuple(entries)
            else:
                changed = law if parameter.control else rig
                changed[name] = int(value) if kind == 'integer' else value
        return self._replace(
            parameters=self.parameters.replace(**rig),
            initial=InitialConditions(**{**self.initial.as_dict(), **start}),
            control=self.control.replace(**law),
        )


@dataclass(frozen=True)
class SweepPlan:
    """
    A sweep: a grid of rigs, and how each of them is run.

    Parameters
    ----------
    parameters, initial : RigParameters, InitialConditions
        The rig; the axes replace the values that they vary.
    axes : tuple of Axis
        The axes of the grid; the first one is followed.
    follow : Follow, optional
        How the rigs start.
    settling : Settling, optional
        How long each rig may take to settle, and how closely it is watched.
    control : GapControlParameters, optional
        The gap control; off by default.
    law : str, optional
        MODULE:FUNCTION of a law of the user's own, in place of the one that `control` names.

    Raises
    ------
    AxisError
        If the axes cannot be used together.
    """

    parameters: RigParameters
    initial: InitialConditions
    axes: tuple[Axis, ...]
    follow: Follow = Follow.NONE
    settling: Settling = field(default_factory=Settling)
    control: GapControlParameters = field(default_factory=GapControlParameters)
    law: str = ''

    def __post_init__(self) -> None:
        """Check the axes together."""
        if self.parameters.sweep_mode != 'off':
            raise AxisError(
                f'sweep_mode is {self.parameters.sweep_mode}: a force that changes its frequency '
                'has no steady state; give --set sweep_mode=off, and vary force_frequencies'
            )
        if not self.axes:
            raise AxisError('nothing is varied: give --vary NAME=RANGE, such as gap=10:60:200')
        parameters = [parameter for axis in self.axes for parameter in axis.parameters]
        for parameter in parameters:
            if parameters.count(parameter) > 1:
                raise AxisError(f'{parameter} is varied twice: give each name once')
            if parameter.control and not self.control.active:
                raise AxisError(
                    f'{parameter} is varied, but gap_control is off, and nothing depends on it: '
                    'give --set gap_control=amplitude or --set gap_control=timed'
                )
        if self.follow is not Follow.NONE and self.axes[0].initial:
            raise AxisError(
                f'{self.axes[0].name} cannot be followed, since a rig that continues has no '
                'initial conditions: vary a parameter first, or leave out --follow'
            )
        if self.size > _MOST_RIGS:
            raise AxisError(
                f'the sweep has {self.size} rigs: give ranges that make at most {_MOST_RIGS}'
            )

    @property
    def setup(self) -> RigSetup:
        """What all rigs have in common."""
        return RigSetup(self.parameters, self.initial, self.settling, self.control, self.law)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of rigs, one row each."""
        return len(self.follow.directions) * math.prod(self.shape)

    def point(self, row: int) -> SweepPoint:
        """Return the place of a row: directions outermost, then the axes, the last one fastest."""
        turn, *places = np.unravel_index(row, (len(self.follow.directions), *self.shape))
        values = tuple(axis.values[i] for axis, i in zip(self.axes, places, strict=True))
        return SweepPoint(row, self.follow.directions[turn], values)

    def settings(self, values: Sequence[float]) -> list[tuple[SweptParameter, float]]:
        """Return the value of each varied parameter, given a value on each axis."""
        return [
            (parameter, value)
            for axis, value in zip(self.axes, values, strict=True)
            for parameter in axis.parameters
        ]

    def chains(self) -> Iterator[range]:
        """Yield the rows of rigs that start from one another, in order; or all, if independent."""
        if self.follow is Follow.NONE:
            yield range(self.size)
            return
        grid = math.prod(self.shape)
        stride = grid // self.shape[0]
        for turn, direction in enumerate(self.follow.directions):
            for first in range(turn * grid, turn * grid + stride):
                rows = range(first, first + grid, stride)
                yield rows if direction == 'up' else rows[::-1]

    def inputs(self) -> dict[str, Any]:
        """Return everything that the table depends on, for JSON."""
        inputs: dict[str, Any] = {
            'format': _TABLE_FORMAT,
            'version': impact_damper_ros.__version__,
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
            'initial': self.initial.as_dict(),
            'axes': [
                {
                    'names': [str(parameter) for parameter in axis.parameters],
                    'values': list(axis.values),
                    'logarithmic': axis.logarithmic,
                }
                for axis in self.axes
            ],
            'follow': self.follow.value,
            'settling': asdict(self.settling),
        }
        if self.control != GapControlParameters():
            inputs['gap_control'] = self.control.as_dict()
        if self.law:
            inputs['law'] = self.law
        return inputs

    @classmethod
    def from_inputs(cls, inputs: dict[str, Any]) -> Self:
        """
        Return the plan that `inputs` was made from.

        Raises
        ------
        ValueError
            If this version does not know such inputs.
        """
        if inputs.get('format') != _TABLE_FORMAT:
            raise ValueError(
                f'a sweep of format {inputs.get("format")!r}: this version reads {_TABLE_FORMAT}'
            )
        return cls(
            parameters=RigParameters(**inputs['parameters']),
            initial=InitialConditions(**inputs['initial']),
            axes=tuple(
                Axis(
                    tuple(map(SweptParameter.named, axis['names'])),
                    tuple(axis['values']),
                    axis['logarithmic'],
                )
                for axis in inputs['axes']
            ),
            follow=Follow(inputs['follow']),
            settling=Settling(**inputs['settling']),
            control=GapControlParameters(**inputs.get('gap_control', {})),
            law=inputs.get('law', ''),
        )
