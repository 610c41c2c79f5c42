"""The plan of a sweep: what it varies, which rigs it runs, and what their rows depend on."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import Enum
from itertools import pairwise
from typing import Any, Self

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
from impact_damper_ros.rig.quoting import shown

__all__ = [
    'MOST_POINTS',
    'TABLE_FORMAT',
    'Axis',
    'AxisError',
    'Follow',
    'Point',
    'SweepPlan',
    'Target',
    'axis_from_mapping',
    'axis_from_text',
    'varied',
    'varied_control',
]


_SPECS: dict[str, ParameterSpec] = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
_TARGET = re.compile(r'(?P<name>[A-Za-z_][A-Za-z0-9_]*)(\[(?P<index>\d+)\])?')
#: Most values of one axis.
MOST_VALUES = 1_000_000
_BOOLS = {'true': True, 'false': False}


class AxisError(ValueError):
    """A range that a sweep cannot use; the message names it and the remedy."""


@dataclass(frozen=True, order=True)
class Target:
    """
    A parameter of rig or gap control, an initial condition, or one entry of a parameter array.

    Attributes
    ----------
    name : str
        Its name.
    index : int or None
        The entry of an array, from 0.
    """

    name: str
    index: int | None = None

    def __str__(self) -> str:
        return self.name if self.index is None else f'{self.name}[{self.index}]'

    @classmethod
    def named(cls, text: str) -> Self:
        """Read what `str` gives."""
        match = _TARGET.fullmatch(text.strip())
        if match is None:
            raise AxisError(f'{shown(text)} is not the name of a parameter')
        return cls(match['name'], None if match['index'] is None else int(match['index']))

    @property
    def label(self) -> str:
        """Name with unit."""
        return f'{self} [{self.spec.unit}]' if self.spec.unit else str(self)

    @property
    def spec(self) -> ParameterSpec:
        """What the parameter is."""
        return _SPECS[self.name]

    @property
    def initial(self) -> bool:
        """Whether it is a part of the initial conditions."""
        return self.name in INITIAL_SPECS

    @property
    def control(self) -> bool:
        """Whether it is a parameter of the gap control."""
        return self.name in GAP_CONTROL_SPECS


@dataclass(frozen=True)
class Axis:
    """
    One direction of a sweep.

    Attributes
    ----------
    targets : tuple of Target
        What takes the values; usually one.
    values : tuple of float or bool
        The values, rising and different.
    logarithmic : bool
        Whether the values are in geometric progression, for figures.
    """

    targets: tuple[Target, ...]
    values: tuple[float, ...]
    logarithmic: bool = False

    @property
    def name(self) -> str:
        """The first of its targets, as text."""
        return str(self.targets[0])

    @property
    def initial(self) -> bool:
        """Whether initial conditions are varied."""
        return self.targets[0].initial

    def __len__(self) -> int:
        return len(self.values)


def _target(text: str, rig: RigParameters) -> Target:
    try:
        name, index = Target.named(text).name, Target.named(text).index
    except AxisError:
        name, index = text.strip(), None
    if name not in _SPECS:
        close = difflib.get_close_matches(name, _SPECS, 1)
        hint = f'did you mean {close[0]}?' if close else f'give one of {", ".join(_SPECS)}'
        raise AxisError(f'{shown(text.strip())} is not a parameter of the rig: {hint}')
    spec = _SPECS[name]
    if spec.kind == 'double_array':
        count = len(getattr(rig, name))
        if index is None and count > 1:
            raise AxisError(
                f'{name} has {count} entries in this rig: say which one, such as {name}[0]'
            )
        index = index or 0
        if index >= count:
            raise AxisError(
                f'{text.strip()}: {name} has {count} entr{"y" if count == 1 else "ies"} in this '
                f'rig: give {name}[0]' + (f' to {name}[{count - 1}]' if count > 1 else '')
            )
        return Target(name, index if count > 1 else None)
    if index is not None:
        raise AxisError(f'{text.strip()}: {name} is one value, not an array: write {name}')
    if spec.kind not in ('double', 'bool', 'integer'):
        raise AxisError(f'{name} is a text and has no range: choose it with --set {name}=...')
    return Target(name)


def _number(text: Any, where: str) -> float:
    if isinstance(text, str) and text.strip().lower() in _BOOLS:
        return _BOOLS[text.strip().lower()]
    if isinstance(text, bool):
        return text
    try:
        value = float(text)
    except (TypeError, ValueError):
        raise AxisError(f'{where}: {shown(text)} is not a number') from None
    if not math.isfinite(value):
        raise AxisError(f'{where}: {shown(text)} is not a finite number')
    return value


def _axis(names: Sequence[str], values: Sequence[float], rig: RigParameters, where: str) -> Axis:
    """Check names and values against one another."""
    targets = tuple(_target(name, rig) for name in names)
    if len(set(targets)) < len(targets):
        raise AxisError(f'{where}: a name stands there twice')
    if len({target.initial for target in targets}) > 1:
        raise AxisError(f'{where}: parameters and initial conditions cannot share values')
    if not values:
        raise AxisError(f'{where}: there are no values: give at least one')
    for target in targets:
        boolean = target.spec.kind == 'bool'
        for value in values:
            if isinstance(value, bool) is not boolean:
                wanted = 'true and false' if boolean else 'numbers'
                raise AxisError(f'{where}: {target} takes {wanted}, not {shown(value)}')
            if target.spec.kind == 'integer' and value != round(value):
                raise AxisError(f'{where}: {target} takes whole numbers, not {shown(value)}')
            try:
                target.spec.checked(value)
            except ParameterError as error:
                raise AxisError(f'{where}: {error}') from None
    ordered = tuple(sorted(values))
    twice = next((a for a, b in pairwise(ordered) if a == b), None)
    if twice is not None:
        raise AxisError(f'{where}: the value {twice!r} stands there twice')
    return Axis(targets, ordered)


def _spaced(low: float, high: float, count: Any, spacing: str, where: str) -> list[float]:
    """Return values from end to end, both included."""
    number = _number(count, where)
    if isinstance(low, bool) or isinstance(high, bool):
        raise AxisError(f'{where}: true and false have no range: write true,false')
    if number != round(number) or not 1 <= number <= MOST_VALUES:
        raise AxisError(
            f'{where}: {count} values: give a whole number of them from 1 to {MOST_VALUES}'
        )
    if spacing not in ('linear', 'log'):
        raise AxisError(f'{where}: spacing {spacing!r}: give linear or log')
    if number == 1 and low != high:
        raise AxisError(
            f'{where}: one value cannot reach from {low:g} to {high:g}: give 2 or more'
        )
    if number > 1 and low == high:
        raise AxisError(f'{where}: from {low:g} to {high:g} is no range: give two different ends')
    if spacing == 'log':
        if min(low, high) <= 0.0:
            raise AxisError(f'{where}: a logarithmic range needs positive ends')
        return [float(value) for value in np.geomspace(low, high, int(number))]
    return [float(value) for value in np.linspace(low, high, int(number))]


def _values(text: str, where: str) -> tuple[list[float], bool]:
    """Read LOW:HIGH:COUNT, LOW:HIGH:COUNT:log, or a list with commas."""
    if ':' in text:
        parts = [part.strip() for part in text.split(':')]
        if len(parts) not in (3, 4):
            raise AxisError(f'{where}: give LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or V1,V2,...')
        low, high = (_number(part, where) for part in parts[:2])
        spacing = parts[3] if len(parts) == 4 else 'linear'
        return _spaced(low, high, parts[2], spacing, where), spacing == 'log'
    parts = [part for part in text.strip().strip('[]').split(',') if part.strip()]
    return [_number(part, where) for part in parts], False


def axis_from_text(text: str, rig: RigParameters) -> Axis:
    """
    Read NAME=RANGE.

    Parameters
    ----------
    text : str
        RANGE is LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or V1,V2,...; NAME may be several names, as in
        ``restitution_1=restitution_2=0.5:0.9:41``, which then take the same value.
    rig : RigParameters
        The rig, for the lengths of its arrays.

    Raises
    ------
    AxisError
        If a name is unknown or the range is empty, not finite or not a range.
    """
    *names, values = text.split('=')
    if not names:
        raise AxisError(f'{shown(text)}: give NAME=LOW:HIGH:COUNT, such as gap=10:60:200')
    for name in names:
        _target(name, rig)
    numbers, logarithmic = _values(values, text)
    axis = _axis(names, numbers, rig, text)
    return Axis(axis.targets, axis.values, logarithmic)


def axis_from_mapping(name: str, entry: Any, rig: RigParameters) -> Axis:
    """
    Read one entry of a ranges file.

    Parameters
    ----------
    name : str
        The name or names, as on the command line.
    entry : str, number, list or mapping
        The text of the command line, a list of values, or a mapping with the keys ``from``,
        ``to``, ``count`` and, if wanted, ``spacing`` (linear or log).
    rig : RigParameters
        The rig, for the lengths of its arrays.

    Raises
    ------
    AxisError
        As for `axis_from_text`.
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
        axis = _axis(names, _spaced(low, high, entry['count'], spacing, name), rig, name)
        return Axis(axis.targets, axis.values, spacing == 'log')
    listed = entry if isinstance(entry, Sequence) else [entry]
    return _axis(names, [_number(value, name) for value in listed], rig, name)


#: Raised whenever the same inputs give other rows.
TABLE_FORMAT = 2
#: Most rigs of one sweep.
MOST_POINTS = 2_000_000


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
    def passes(self) -> tuple[str, ...]:
        """The directions followed; one empty name if the rigs are independent."""
        if self is Follow.NONE:
            return ('',)
        return ('up', 'down') if self is Follow.BOTH else (self.value,)


@dataclass(frozen=True)
class Point:
    """
    One rig of a sweep.

    Attributes
    ----------
    index : int
        Its row in the table.
    direction : str
        'up', 'down', or empty if it does not start from another rig's state.
    values : tuple of float
        Its value on each axis.
    """

    index: int
    direction: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class SweepPlan:
    """
    A sweep.

    Attributes
    ----------
    parameters, initial : RigParameters, InitialConditions
        The rig, but for what is varied.
    axes : tuple of Axis
        What is varied; the first is the one that is followed.
    follow : Follow
        How the rigs start.
    settling : Settling
        How long and how closely each rig is watched.
    control : GapControlParameters
        The gap control, but for what is varied; off, if not given.

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

    def __post_init__(self) -> None:
        """Check what holds between the axes."""
        if self.parameters.sweep_mode != 'off':
            raise AxisError(
                f'sweep_mode is {self.parameters.sweep_mode}: a force that changes its frequency '
                'has no steady state; give --set sweep_mode=off, and vary force_frequencies'
            )
        if not self.axes:
            raise AxisError('nothing is varied: give --vary NAME=RANGE, such as gap=10:60:200')
        targets = [target for axis in self.axes for target in axis.targets]
        for target in targets:
            if targets.count(target) > 1:
                raise AxisError(f'{target} is varied twice: give each name once')
            if target.control and not self.control.active:
                raise AxisError(
                    f'{target} is varied, but gap_control is off, and nothing depends on it: '
                    'give --set gap_control=amplitude or --set gap_control=timed'
                )
        if self.follow is not Follow.NONE and self.axes[0].initial:
            raise AxisError(
                f'{self.axes[0].name} cannot be followed, a rig has its initial conditions only '
                'once: vary a parameter first, or leave out --follow'
            )
        if self.size > MOST_POINTS:
            raise AxisError(
                f'the sweep has {self.size} rigs: give ranges that make at most {MOST_POINTS}'
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of rigs, one row each."""
        return len(self.follow.passes) * math.prod(self.shape)

    def point(self, index: int) -> Point:
        """Return a rig by its row: directions outermost, then the axes, the last one fastest."""
        turn, rest = divmod(index, math.prod(self.shape))
        places = []
        for count in reversed(self.shape):
            rest, place = divmod(rest, count)
            places.append(place)
        values = tuple(a.values[i] for a, i in zip(self.axes, reversed(places), strict=True))
        return Point(index, self.follow.passes[turn], values)

    def settings(self, point: Point) -> list[tuple[Target, float]]:
        """Return what takes which value at a point."""
        return [
            (target, value)
            for axis, value in zip(self.axes, point.values, strict=True)
            for target in axis.targets
        ]

    def chains(self) -> Iterator[range | list[int]]:
        """
        Yield the rows that have to be worked out in a row.

        Yields
        ------
        sequence of int
            Rows, each rig starting from the last state of the one before; without following all
            rows at once, which then need no order.
        """
        if self.follow is Follow.NONE:
            yield range(self.size)
            return
        grid = math.prod(self.shape)
        stride = grid // self.shape[0]
        for turn, direction in enumerate(self.follow.passes):
            for offset in range(stride):
                first = turn * grid + offset
                rows = range(first, first + grid, stride)
                yield rows if direction == 'up' else rows[::-1]

    def inputs(self) -> dict[str, Any]:
        """Return everything the table depends on, in a form that goes through JSON."""
        inputs: dict[str, Any] = {
            'format': TABLE_FORMAT,
            'version': impact_damper_ros.__version__,
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
            'initial': self.initial.as_dict(),
            'axes': [
                {
                    'names': [str(target) for target in axis.targets],
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
        if inputs.get('format') != TABLE_FORMAT:
            raise ValueError(
                f'a sweep of format {inputs.get("format")!r}: this version reads {TABLE_FORMAT}'
            )
        return cls(
            parameters=RigParameters(**inputs['parameters']),
            initial=InitialConditions(**inputs['initial']),
            axes=tuple(
                Axis(
                    tuple(Target.named(name) for name in axis['names']),
                    tuple(axis['values']),
                    axis['logarithmic'],
                )
                for axis in inputs['axes']
            ),
            follow=Follow(inputs['follow']),
            settling=Settling(**inputs['settling']),
            control=GapControlParameters(**inputs.get('gap_control', {})),
        )


def varied(
    parameters: RigParameters,
    initial: InitialConditions,
    settings: Sequence[tuple[Target, float]],
) -> tuple[RigParameters, InitialConditions]:
    """Return a rig with other values, all at once; those of the gap control are left out."""
    changes: dict[str, Any] = {}
    start: dict[str, Any] = {}
    for target, value in settings:
        if target.control:
            continue
        if target.initial:
            start[target.name] = value
        elif target.index is None and target.spec.kind != 'double_array':
            changes[target.name] = int(value) if target.spec.kind == 'integer' else value
        else:
            entries = list(changes.get(target.name, getattr(parameters, target.name)))
            entries[target.index or 0] = value
            changes[target.name] = tuple(entries)
    rig = parameters.replace(**changes)
    begun = InitialConditions(**{**initial.as_dict(), **start})
    return rig, begun


def varied_control(
    control: GapControlParameters, settings: Sequence[tuple[Target, float]]
) -> GapControlParameters:
    """Return a gap control with other values, all at once; those of the rig are left out."""
    return control.replace(
        **{
            target.name: int(value) if target.spec.kind == 'integer' else value
            for target, value in settings
            if target.control
        }
    )
