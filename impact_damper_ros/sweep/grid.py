# SPDX-License-Identifier: Apache-2.0
"""The grid of a sweep: the parameters that are varied, their values, and the order of the rigs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, Literal, NamedTuple, Self, get_args

import numpy as np
import numpy.typing as npt

import impact_damper_ros
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.parameters.all_parameters import RIG_SPECS
from impact_damper_ros.parameters.base_motion import QUANTITIES, quantity_of
from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.parameter_spec import ParameterError, ParameterSpec
from impact_damper_ros.parameters.quoting import as_name, plural, quote, similar_names
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    InitialConditions,
    RigParameters,
)
from impact_damper_ros.parameters.units import UNITS, split_number
from impact_damper_ros.parameters.upgrades import (
    CONSTANT_RESTITUTION,
    Document,
    Upgrade,
    newest,
    upgrade,
)

from .steady_state import Settling

_SPECS: dict[str, ParameterSpec] = {**RIG_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
_NAME = re.compile(r'([A-Za-z_][A-Za-z0-9_]*)(?:\[(\d+)\])?')
_BOOLS = {'true': True, 'false': False}
_MOST_VALUES = 1_000_000
_MOST_RIGS = 2_000_000


def upgraded_from_1(inputs: Document) -> Document:
    """Return inputs of format 1 in format 2, in which restitution may fall with the speed."""
    return {**inputs, 'parameters': {**CONSTANT_RESTITUTION, **inputs['parameters']}}


#: Steps from the inputs of version 1.0 to the present ones; see `parameters.upgrades`.
UPGRADES: tuple[Upgrade, ...] = (upgraded_from_1,)


def present_inputs(inputs: Document) -> Document:
    """Return inputs of a sweep in the present format; or raise `FormatError`."""
    return {**upgrade(inputs, inputs.get('format'), UPGRADES), 'format': newest(UPGRADES)}


#: How rigs start: from the initial conditions, or from the last state of the rig before, along
#: rising or falling values of the first axis.
Follow = Literal['none', 'up', 'down', 'both']
_DIRECTIONS = {'none': ('',), 'up': ('up',), 'down': ('down',), 'both': ('up', 'down')}


class GridError(ValueError):
    """A grid that cannot be swept; the message names the reason and the remedy."""


class Varied(NamedTuple):
    """A parameter of rig or control, an initial condition, or an entry of an array."""

    name: str
    entry: int | None = None  # index of an entry of an array, from 0

    def __str__(self) -> str:
        return self.name if self.entry is None else f'{self.name}[{self.entry}]'

    @property
    def spec(self) -> ParameterSpec:
        """Kind, unit, range and meaning."""
        return _SPECS[self.name]

    def si_unit(self, rig: RigParameters) -> str:
        """Return the SI unit; that of amplitudes of the base depends on the rig."""
        return QUANTITIES[rig.base_quantity] if self.name == 'base_amplitudes' else self.spec.unit


def _parts(text: str) -> tuple[str, int | None]:
    """Return the parameter that a user has named, and the entry of an array, if there is one."""
    text = text.strip()
    match = _NAME.fullmatch(text)
    name = match[1] if match else text
    if name not in _SPECS:
        close = similar_names(name, _SPECS)
        hint = f'did you mean {close}?' if close else f'give one of {", ".join(_SPECS)}'
        raise GridError(f'{quote(text)} is not a parameter of the rig: {hint}')
    if _SPECS[name].kind not in ('double', 'double_array', 'bool', 'integer'):
        raise GridError(f'{name} is a text and has no range: choose it with --set {name}=...')
    return name, int(match[2]) if match and match[2] else None


def _parameter_of(text: str, rig: RigParameters) -> Varied:
    """Return the parameter that a user has named, in this rig."""
    name, index = _parts(text)
    if _SPECS[name].kind == 'double_array':
        count = len(getattr(rig, name))
        if index is None and count > 1:
            raise GridError(
                f'{name} has {count} entries in this rig: say which one, such as {name}[0]'
            )
        if index is not None and index >= count:
            raise GridError(
                f'{text}: {name} has {count} entr{"y" if count == 1 else "ies"} in this '
                f'rig: give {name}[0]' + (f' to {name}[{count - 1}]' if count > 1 else '')
            )
        return Varied(name, index if count > 1 else None)
    if index is not None:
        raise GridError(f'{text}: {name} is one value, not an array: write {name}')
    return Varied(name)


@dataclass(frozen=True)
class Axis:
    """One axis of a grid: the parameters that take its values (mostly one), and rising values."""

    varied: tuple[Varied, ...]
    values: tuple[float, ...]  # SI
    unit: str = ''  # unit in which they were given; empty for SI

    @property
    def factor(self) -> float:
        """Factor from the unit of the axis to SI."""
        return UNITS[self.varied[0].spec.unit][self.unit] if self.unit else 1.0

    @property
    def shown_values(self) -> npt.NDArray[np.float64]:
        """The values in the unit of the axis."""
        return np.array(self.values, float) / self.factor

    def shown_unit(self, rig: RigParameters) -> str:
        """Return the unit of shown values, which for amplitudes of the base depends on the rig."""
        return self.unit or self.varied[0].si_unit(rig)

    def value_text(self, value: float, rig: RigParameters, digits: int = 5) -> str:
        """Return a value in the unit of the axis."""
        if self.varied[0].spec.kind == 'bool':
            return ('no', 'yes')[int(value)]
        return f'{value / self.factor:.{digits}g} {self.shown_unit(rig)}'.rstrip()

    @property
    def name(self) -> str:
        """Name of the first parameter."""
        return str(self.varied[0])

    @property
    def initial(self) -> bool:
        """Whether initial conditions are varied."""
        return self.varied[0].name in INITIAL_SPECS

    @property
    def real(self) -> bool:
        """Whether the rig can have any value between those of the axis."""
        kinds = {one.spec.kind for one in self.varied}
        return not self.initial and kinds <= {'double', 'double_array'}

    @property
    def logarithmic(self) -> bool:
        """Whether the values are in geometric progression."""
        if len(self.values) < 3 or self.values[0] <= 0.0:
            return False
        steps = np.diff(np.log(self.values))
        return bool(np.allclose(steps, steps[0], rtol=1e-6))

    def __len__(self) -> int:
        return len(self.values)


def _axis(names: str, given: npt.ArrayLike, rig: RigParameters, unit: str) -> Axis:
    """Return an axis, with names and values checked; `unit` is that of plain numbers."""
    varied = tuple(_parameter_of(name, rig) for name in names.split('='))
    if len(set(varied)) < len(varied):
        raise GridError(f'{names}: the same name is given twice')
    if len({one.name in INITIAL_SPECS for one in varied}) > 1:
        raise GridError(f'{names}: parameters and initial conditions cannot share values')
    values: list[Any] = np.atleast_1d(np.array(given)).tolist()
    if any(isinstance(value, str) for value in values):
        # numpy makes a list of texts and numbers an array of texts.
        values, unit = _in_si([*map(str, values)], names, varied[0].spec)
    if not values:
        raise GridError(f'{names}: there are no values: give at least one')
    for one in varied:
        kind = one.spec.kind
        for value in values:
            if isinstance(value, bool) is not (kind == 'bool') or isinstance(value, str):
                wanted = 'true and false' if kind == 'bool' else 'numbers'
                raise GridError(f'{names}: {one} takes {wanted}, not {quote(value)}')
            if kind == 'integer' and value != round(value):
                raise GridError(f'{names}: {one} takes whole numbers, not {quote(value)}')
            try:
                one.spec.check(value)
            except ParameterError as error:
                raise GridError(f'{names}: {error}') from None
    # No negative zero
    values = sorted(value if isinstance(value, bool) else float(value) + 0.0 for value in values)
    repeated = next((a for a, b in pairwise(values) if a == b), None)
    if repeated is not None:
        raise GridError(f'{names}: the value {repeated!r} is given twice')
    return Axis(varied, tuple(values), unit)


class RigSetup(NamedTuple):
    """A rig, its start, its gap control, and its settling."""

    parameters: RigParameters
    initial: InitialConditions
    control: GapControlParameters
    law: str  # MODULE:FUNCTION of a law of the user's own; empty for none
    law_digest: str  # digest of the source of the law
    settling: Settling

    def vary(self, settings: Mapping[Varied, float]) -> Self:
        """Return the setup with other values, all set at once."""
        rig: dict[str, Any] = {}
        start: dict[str, Any] = {}
        control: dict[str, Any] = {}
        for (name, index), value in settings.items():
            kind = _SPECS[name].kind
            if name in INITIAL_SPECS:
                start[name] = value
            elif kind == 'double_array':
                entries = list(rig.get(name, getattr(self.parameters, name)))
                entries[index or 0] = value
                rig[name] = tuple(entries)
            else:
                changed = control if name in GAP_CONTROL_SPECS else rig
                changed[name] = int(value) if kind == 'integer' else value
        parts: dict[str, Any] = {}
        if rig:
            parts['parameters'] = self.parameters.replace(**rig)
        if start:
            parts['initial'] = InitialConditions(**{**self.initial.as_dict(), **start})
        if control:
            parts['control'] = self.control.replace(**control)
        return self._replace(**parts)


@dataclass(frozen=True, init=False)
class Grid:
    """
    A grid of rigs, and how each of them is run.

    Parameters
    ----------
    parameters : RigParameters
        The rig; the axes replace the values that they vary.
    initial : InitialConditions, optional
        Where the rigs start.
    control : GapControlParameters, optional
        The gap control; off by default.
    law : str, optional
        MODULE:FUNCTION of a law of the user's own, in place of the law that `control` names.
    law_digest : str, optional
        Digest of its source (`OwnLaw.digest`); by default that of the law found now.
    follow : {'none', 'up', 'down', 'both'}, optional
        Whether each rig starts from the last state of the rig before, along the first axis.
    settling : Settling, optional
        Limits and tolerances of settling.
    units : mapping of str to str, optional
        Units in which figures and texts show axes, by their names; values that are texts with a
        unit keep that unit.
    **axes : array_like
        The values of each parameter, initial condition or parameter of the control, in SI units
        or with one, as ``['5 mm', '10 mm']``; the first axis is the one that is followed. An
        entry of an array, and parameters that share their values, are named as on the command
        line: ``**{'force_frequencies[1]': ...}``, ``**{'restitution_1=restitution_2': ...}``.

    Raises
    ------
    GridError
        If a name is unknown, a value is out of its range, or the axes cannot be used together.

    Examples
    --------
    >>> Grid(RigParameters(), gap=[10.0, 20.0], friction=[0.0, 0.1, 0.2]).size
    6
    """

    setup: RigSetup
    axes: tuple[Axis, ...]
    follow: Follow

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        control: GapControlParameters | None = None,
        law: str = '',
        *,
        law_digest: str = '',
        follow: Follow = 'none',
        settling: Settling | None = None,
        units: Mapping[str, str] | None = None,
        **axes: npt.ArrayLike,
    ) -> None:
        control = control or GapControlParameters()
        if not control.active:
            # The other parameters of the control have no effect.
            control = GapControlParameters()
        units = units or {}
        built = tuple(
            _axis(names, values, parameters, units.get(names, ''))
            for names, values in axes.items()
        )
        for axis in built:
            if axis.varied[0].name == 'base_amplitudes' and axis.unit:
                sizes = list(parameters.base_amplitudes)
                sizes[axis.varied[0].entry or 0] = axis.values[0]
                quantity = quantity_of(axis.unit)
                parameters = parameters.replace(base_amplitudes=sizes, base_quantity=quantity)
        if law and not law_digest:
            law_digest = OwnLaw.from_text(law).digest
        start, settling = initial or InitialConditions(), settling or Settling()
        setup = RigSetup(parameters, start, control, law, law_digest, settling)
        object.__setattr__(self, 'setup', setup)
        object.__setattr__(self, 'axes', built)
        object.__setattr__(self, 'follow', follow)
        self._check()

    def _check(self) -> None:
        """Check the axes together."""
        if self.follow not in get_args(Follow):
            raise GridError(f'follow is {self.follow!r}: give one of {", ".join(_DIRECTIONS)}')
        if self.setup.parameters.sweep_mode != 'off':
            raise GridError(
                f'sweep_mode is {self.setup.parameters.sweep_mode}: a force that changes its '
                'frequency has no steady state; give --set sweep_mode=off, and vary '
                'force_frequencies'
            )
        if self.setup.law and not self.setup.control.active:
            raise GridError(
                f'the law {self.setup.law} moves no stops, since gap_control is off: give '
                'gap_control=timed, which it then replaces, or leave it out'
            )
        if not self.axes:
            raise GridError('nothing is varied: give --vary NAME=RANGE, such as gap=10:60:200')
        every = [one for axis in self.axes for one in axis.varied]
        for one in every:
            if every.count(one) > 1:
                raise GridError(f'{one} is varied twice: give each name once')
            if one.name in GAP_CONTROL_SPECS and not self.setup.control.active:
                raise GridError(
                    f'{one} is varied, but gap_control is off, and nothing depends on it: '
                    'give --set gap_control=amplitude or --set gap_control=timed'
                )
        if self.follow != 'none' and self.axes[0].initial:
            raise GridError(
                f'{self.axes[0].name} cannot be followed, since a rig that continues has no '
                'initial conditions: vary a parameter first, or leave out --follow'
            )
        if self.size > _MOST_RIGS:
            raise GridError(
                f'the sweep has {self.size} rigs: give ranges that make at most {_MOST_RIGS}'
            )

    def __repr__(self) -> str:
        """Return size and axes in a line."""
        axes = ', '.join(
            f'{axis.name} {axis.values[0]:.6g} to {axis.values[-1]:.6g} ({len(axis)})'
            for axis in self.axes
        )
        return f'<Grid: {plural(self.size, "rig")}; {axes}>'

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions followed; one empty name if the rigs are independent."""
        return _DIRECTIONS[self.follow]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of rigs, one row each."""
        return len(self.directions) * math.prod(self.shape)

    def values(self, row: int) -> tuple[float, ...]:
        """Return the value on each axis: directions outermost, then the axes, the last fastest."""
        places = np.unravel_index(row % math.prod(self.shape), self.shape)
        return tuple(axis.values[i] for axis, i in zip(self.axes, places, strict=True))

    def settings(self, values: Sequence[float]) -> dict[Varied, float]:
        """Return the value of each varied parameter, given a value on each axis."""
        pairs = zip(self.axes, values, strict=True)
        return {one: value for axis, value in pairs for one in axis.varied}

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of the table that identify the rig of a row."""
        turns, places = len(self.directions), math.prod(self.shape)
        found: dict[str, list[Any]] = {
            'point': list(range(self.size)),
            'direction': [turn or None for turn in self.directions for _ in range(places)],
        }
        meshes = np.meshgrid(*(axis.values for axis in self.axes), indexing='ij')
        for axis, mesh in zip(self.axes, meshes, strict=True):
            found |= {str(one): np.tile(mesh.ravel(), turns).tolist() for one in axis.varied}
        return found

    def chains(self) -> Iterator[range]:
        """Yield the rows of rigs that start from one another, in order."""
        places = math.prod(self.shape)
        stride = places // self.shape[0]
        for turn, direction in enumerate(self.directions):
            for first in range(turn * places, turn * places + stride):
                rows = range(first, first + places, stride)
                yield rows if direction == 'up' else rows[::-1]

    def inputs(self) -> dict[str, Any]:
        """Return everything that the table depends on, for JSON."""
        rig, initial, control, law, law_digest, settling = self.setup
        inputs: dict[str, Any] = {
            'format': newest(UPGRADES),
            'version': impact_damper_ros.__version__,
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in rig.as_dict().items()
            },
            'initial': initial.as_dict(),
            'axes': {'='.join(map(str, axis.varied)): list(axis.values) for axis in self.axes},
            'follow': self.follow,
            'settling': asdict(settling),
        }
        if units := {'='.join(map(str, a.varied)): a.unit for a in self.axes if a.unit}:
            inputs['units'] = units
        if control.active:
            inputs['gap_control'] = control.as_dict()
        if law:
            inputs |= {'law': law, 'law_digest': law_digest}
        return inputs

    @classmethod
    def from_inputs(cls, inputs: dict[str, Any]) -> Self:
        """
        Return the grid that `inputs` was made from.

        Raises
        ------
        ValueError
            If this version does not know such inputs.
        """
        inputs = present_inputs(inputs)
        return cls(
            RigParameters(**inputs['parameters']),
            InitialConditions(**inputs['initial']),
            GapControlParameters(**inputs.get('gap_control', {})),
            inputs.get('law', ''),
            law_digest=inputs.get('law_digest', ''),
            follow=inputs['follow'],
            settling=Settling(**inputs['settling']),
            units=inputs.get('units'),
            **inputs['axes'],
        )


def _number(text: str, where: str, spec: ParameterSpec) -> float:
    """Return a number in SI, which may have the unit of a parameter; or a bool."""
    if text.strip().lower() in _BOOLS:
        return _BOOLS[text.strip().lower()]
    try:
        number = float(text)
    except ValueError:
        if spec.low is None:
            raise GridError(f'{where}: {quote(text)} is not a number') from None
        try:
            number = spec.in_si(text)
        except ParameterError as error:
            raise GridError(f'{where}: {quote(text)} is not a number: {error}') from None
    if not math.isfinite(number):
        raise GridError(f'{where}: {quote(text)} is not a finite number')
    return number


def _in_si(texts: Sequence[str], where: str, spec: ParameterSpec) -> tuple[list[float], str]:
    """Return values in SI, and their common unit; empty if they differ."""
    units = {split_number(text)[1] for text in texts}
    (unit,) = units if len(units) == 1 else ('',)
    known = unit in UNITS.get(spec.unit, ()) and unit != spec.unit
    return [_number(text, where, spec) for text in texts], unit if known else ''


def _space(low: float, high: float, count: str, spacing: str, where: str) -> list[float]:
    """Return values from end to end, both included."""
    number, rest, _ = split_number(count)
    if isinstance(low, bool) or isinstance(high, bool):
        raise GridError(f'{where}: true and false have no range: write true,false')
    if rest or not number or number % 1.0 or not 1.0 <= number <= _MOST_VALUES:
        raise GridError(f'{where}: {count} values: give a whole number from 1 to {_MOST_VALUES}')
    if spacing not in ('linear', 'log'):
        raise GridError(f'{where}: spacing {spacing!r}: give linear or log')
    if number == 1 and low != high:
        raise GridError(
            f'{where}: one value cannot reach from {low:g} to {high:g}: give 2 or more'
        )
    if number > 1 and low == high:
        raise GridError(
            f'{where}: from {low:g} to {high:g} is not a range: give two different ends'
        )
    if spacing == 'log' and min(low, high) <= 0.0:
        raise GridError(f'{where}: a logarithmic range needs positive ends')
    progression = np.geomspace if spacing == 'log' else np.linspace
    values: list[float] = progression(low, high, int(number)).tolist()
    return values


def range_from_text(text: str) -> tuple[str, list[float], str]:
    """
    Read an axis as the command line gives it.

    Parameters
    ----------
    text : str
        NAME=LOW:HIGH:COUNT, NAME=LOW:HIGH:COUNT:log or NAME=V1,V2,...; NAME may be several names,
        as in ``restitution_1=restitution_2=0.5:0.9:41``, which then take the same value. Values
        are in SI units, or have one: ``gap=10mm:30mm:3``.

    Returns
    -------
    names : str
        The names, as `Grid` takes them.
    values : list of float
        The values, in SI units.
    unit : str
        The unit in which all were given; empty for SI, or if they differ.

    Raises
    ------
    GridError
        If the range is empty, not finite or not a range.

    Examples
    --------
    >>> range_from_text('gap=10:30:3')
    ('gap', [10.0, 20.0, 30.0], '')
    """
    names, _, values = text.rpartition('=')
    if not names:
        raise GridError(f'{quote(text)}: give NAME=LOW:HIGH:COUNT, such as gap=10:60:200')
    spec, *_ = [_SPECS[_parts(name)[0]] for name in names.split('=')]
    where = as_name(text)
    if ':' not in values:
        listed = [part for part in values.strip().strip('[]').split(',') if part.strip()]
        numbers, unit = _in_si(listed, where, spec)
        return names, numbers, unit
    low, high, *rest = (part.strip() for part in values.split(':'))
    if len(rest) not in (1, 2):
        raise GridError(f'{where}: give LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or V1,V2,...')
    (start, end), unit = _in_si([low, high], where, spec)
    spacing = rest[1] if rest[1:] else 'linear'
    return names, _space(start, end, rest[0], spacing, where), unit
