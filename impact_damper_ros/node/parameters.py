# SPDX-License-Identifier: Apache-2.0
"""
ROS parameters and the rig: descriptors, and the reading of requests and of arguments.

Values are read tolerantly: `37` for a double, `5`, `[1, 0.5]` or `1e-3` as the command line gives
them, one force array at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from impact_damper_ros.parameters.all_parameters import ALL_SPECS, RIG_SPECS
from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.node_settings import SETTING_SPECS, NodeSettings
from impact_damper_ros.parameters.parameter_spec import ParameterError, ParameterSpec
from impact_damper_ros.parameters.quoting import as_name, quote, similar_names
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
    base_quantity_of,
)
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS

#: Arrays with an entry for each harmonic of the force, and for each line of the base.
ARRAYS = [
    tuple(f'{what}_{part}' for part in ('amplitudes', 'frequencies', 'phases'))
    for what in ('force', 'base')
]
#: Longest name that may be a misspelt one.
_LONGEST_NAME = 80
#: Most warnings of one kind.
_MOST_WARNINGS = 8
USE_SIM_TIME = (
    'use_sim_time is true: the rig keeps its own time and follows no /clock; to have it publish '
    'one for the other nodes, give publish_clock'
)
# A name this similar to a known one counts as misspelt, not as one of another node.
_MISSPELT = 0.75


_TYPES = {
    'bool': Parameter.Type.BOOL,
    'double': Parameter.Type.DOUBLE,
    'double_array': Parameter.Type.DOUBLE_ARRAY,
    'integer': Parameter.Type.INTEGER,
    'string': Parameter.Type.STRING,
}


@dataclass(frozen=True, kw_only=True)
class NodeParameters(NodeSettings):
    """All parameters of the node: its settings, and those of the rig that it runs."""

    rig: RigParameters = field(default_factory=RigParameters)
    initial: InitialConditions = field(default_factory=InitialConditions)
    control: GapControlParameters = field(default_factory=GapControlParameters)

    def __post_init__(self) -> None:
        """Check every setting, and expand the home directory."""
        super().__post_init__()
        object.__setattr__(self, 'bag_directory', _directory(self.bag_directory))

    @property
    def simulated_time(self) -> bool:
        """Whether stamps count from 0 and /clock is published: rig time is no wall time."""
        return self.publish_clock or self.real_time_factor != 1.0 or self.lock_step != 'off'

    @property
    def priority(self) -> int:
        """The real-time priority of a rig that keeps a pace; 0 for ordinary scheduling."""
        return self.real_time_priority if self.real_time_factor else 0

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> NodeParameters:
        """Check values and fill in the defaults."""
        start = cls().with_changes(values)
        start.initial.check_within(start.rig)
        if start.lock_step != 'off' and not start.measurement_rate:
            raise ParameterError(
                'lock_step',
                f'lock_step is {start.lock_step} and measurement_rate is 0: a rig waits at its '
                'measurements, give a rate such as measurement_rate:=200.0',
            )
        return start

    def with_changes(self, values: Mapping[str, Any]) -> NodeParameters:
        """Return the parameters with some of them changed, all at once."""
        changed = replace(self, **_among(SETTING_SPECS, values))
        parts: dict[str, Any] = {}
        if rig := _among(RIG_SPECS, values):
            parts['rig'] = self.rig.replace(**rig)
        if initial := _among(INITIAL_SPECS, values):
            parts['initial'] = self.initial.replace(**initial)
            parts['initial'].check_within(parts.get('rig', self.rig))
        if control := _among(GAP_CONTROL_SPECS, values):
            parts['control'] = self.control.replace(**control)
        return replace(changed, **parts)

    def as_dict(self) -> dict[str, Any]:
        """Return name and value of every parameter."""
        parts = (self.rig, self.initial, self.control)
        rest = {name: getattr(self, name) for name in SETTING_SPECS}
        return {name: value for part in parts for name, value in part.as_dict().items()} | rest


def _among(specs: Mapping[str, ParameterSpec], values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in specs}


def _directory(text: str) -> str:
    """Return the directory of recordings, with the home directory in place of ~."""
    if not text.startswith('~'):
        return text
    try:
        return str(Path(text).expanduser())
    except RuntimeError:
        raise ParameterError(
            'bag_directory',
            f'bag_directory is {quote(text)}: there is no such home directory, write it out (or '
            './~ for a directory of that name)',
        ) from None


def descriptor(spec: ParameterSpec) -> Any:
    """Return the ROS descriptor of a parameter."""
    ranges, whole_ranges = [], []
    if spec.low is not None and spec.high is not None:
        if spec.kind == 'integer':
            limits = {'from_value': int(spec.low), 'to_value': int(spec.high), 'step': 1}
            whole_ranges.append(IntegerRange(**limits))
        else:
            ranges.append(FloatingPointRange(from_value=spec.low, to_value=spec.high, step=0.0))
    constraints = f'One of {", ".join(spec.choices)}.' if spec.choices else ''
    together = next((names for names in ARRAYS if spec.name in names), ())
    if together:
        others = ' and '.join(name for name in together if name != spec.name)
        constraints = (
            f'The range applies to each entry. If the length changes, {others} are cut or padded '
            'with zeros to match.'
        )
    elif spec.least:
        constraints = f'0, or at least {spec.least:g}.'
    if spec.effect in ('next reset', 'next recording'):
        constraints = f'{constraints} Used by the {spec.effect}.'.lstrip()
    return ParameterDescriptor(
        name=spec.name,
        type=_TYPES[spec.kind].value,
        description=f'{spec.description} Unit: {spec.unit}.' if spec.unit else spec.description,
        additional_constraints=constraints,
        read_only=spec.effect == 'start',
        floating_point_range=ranges,
        integer_range=whole_ranges,
    )


def _coerced_value(spec: ParameterSpec, value: Any) -> Any:
    """Return a value in the type of the parameter if it can be read so, else unchanged."""
    if spec.kind == 'string' and type(value) is int:
        return str(value)
    try:
        checked = spec.check([] if value is None else value)
    except ParameterError:
        return value
    return list(checked) if isinstance(checked, tuple) else checked


def coerce(parameter: Parameter) -> Parameter:
    """Return a parameter with its value in the declared type, if it can be read so."""
    spec = ALL_SPECS.get(parameter.name)
    if spec is None or parameter.type_ in (Parameter.Type.NOT_SET, _TYPES[spec.kind]):
        return parameter
    value = _coerced_value(spec, parameter.value)
    if not _TYPES[spec.kind].check(value):
        return parameter
    return Parameter(parameter.name, _TYPES[spec.kind], value)


def resized_arrays(values: Mapping[str, Any], rig: RigParameters) -> dict[str, list[float]]:
    """
    Return the arrays of force and base not given, resized to the length of those that were.

    Surplus entries are dropped; new ones are zero, and a harmonic with a zero amplitude, or with
    frequency and phase zero, exerts no force.
    """
    resized: dict[str, list[float]] = {}
    for names in ARRAYS:
        given = {name: values[name] for name in names if name in values}
        if not all(hasattr(value, '__len__') for value in given.values()):
            continue
        lengths = {len(value) for value in given.values()}
        # The validation rejects contradictory lengths.
        if len(lengths) != 1 or (count := lengths.pop()) in (0, len(getattr(rig, names[0]))):
            continue
        resized |= {
            name: [*getattr(rig, name), *[0.0] * count][:count]
            for name in names
            if name not in given
        }
    return resized


def nearest_name(name: str, cutoff: float = 0.5) -> str:
    """Return the known parameter whose name is most similar, or an empty text."""
    if len(name) > _LONGEST_NAME:
        return ''
    return similar_names(name, ALL_SPECS, cutoff)


def parameters_from_overrides(
    overrides: Mapping[str, Any], declared: Iterable[str], warn: Callable[[str], None]
) -> NodeParameters:
    """Return the parameters from the overrides of command line and parameters files."""
    strange = [n for n in overrides if n not in {*ALL_SPECS, *STRUCTURE_SPECS, *declared}]
    foreign = [name for name in strange if not name.startswith('qos_overrides.')]
    for name in foreign:
        if near := nearest_name(name, _MISSPELT):
            raise ParameterError(
                name, f'{as_name(name)} is not a parameter of this node: write {near}'
            )
    for name in foreign[:_MOST_WARNINGS]:
        warn(f'parameter {as_name(name)} is not one of this node; it is ignored')
    if len(foreign) > _MOST_WARNINGS:
        warn(f'{len(foreign) - _MOST_WARNINGS} more parameters are ignored as well')
    if overrides.get('use_sim_time'):
        raise ParameterError('use_sim_time', USE_SIM_TIME)
    values = {
        name: _coerced_value(spec, overrides[name])
        for name, spec in {**ALL_SPECS, **STRUCTURE_SPECS}.items()
        if name in overrides
    }
    if quantity := base_quantity_of(overrides.get('base_amplitudes')):
        values['base_quantity'] = quantity
    values.update(resized_arrays(values, RigParameters()))
    return NodeParameters.from_values(values)


def normalise(parameters: Iterable[Parameter], rig: RigParameters) -> list[Parameter]:
    """
    Return a request in the declared types, with the other arrays of a rig resized.

    The unit of base amplitudes sets their quantity.
    """
    given = list(parameters)
    request = list(map(coerce, given))
    for parameter in given:
        if parameter.name == 'base_amplitudes' and parameter.type_ is Parameter.Type.STRING:
            with suppress(ParameterError):  # refused with the reason where it is checked
                if quantity := base_quantity_of(parameter.value):
                    request.append(Parameter('base_quantity', value=quantity))
    values = {p.name: p.value for p in request if p.type_ is Parameter.Type.DOUBLE_ARRAY}
    resized = resized_arrays(values, rig)
    return request + [
        Parameter(name, Parameter.Type.DOUBLE_ARRAY, value) for name, value in resized.items()
    ]


def _meaning(name: str, value: Any, rig: RigParameters) -> str:
    """Return the error of a measure of the structure, which names the parameter to set."""
    target = {'natural_frequency': 'stiffness', 'mass_ratio': 'damper_mass'}.get(name, 'damping')
    meant = getattr(rig.replace(**{name: value}), target)
    return (
        f'{name} is for the start of the node: for this rig {quote(value)} is a {target} of '
        f'{meant:.9g} {PARAMETER_SPECS[target].unit}, set that (set_rig does)'
    )


def readable(
    parameters: Iterable[Parameter], now: RigParameters, has: Callable[[str], bool]
) -> list[Parameter]:
    """
    Return a request as `normalise` does; ParameterError for a name or value that cannot be.

    rclpy also refuses unknown and fixed names and values out of range, but names no remedy.
    """
    request = normalise(parameters, now)
    for parameter in request:
        name, value = parameter.name, parameter.value
        if not has(name):
            if name in STRUCTURE_SPECS:
                raise ParameterError(name, _meaning(name, value, now))
            near = nearest_name(name)
            hint = f'did you mean {near}?' if near else 'see: simulate_rig --parameters'
            raise ParameterError(name, f'{as_name(name)} is not a parameter of this node: {hint}')
        if name == 'use_sim_time' and value:
            raise ParameterError(name, USE_SIM_TIME)
        if name in ALL_SPECS:
            if ALL_SPECS[name].effect == 'start':
                raise ParameterError(
                    name,
                    f'{name} is fixed while the node runs: start it with '
                    f'--ros-args -p {name}:={quote(value)}',
                )
            ALL_SPECS[name].check(value)
    return request


def values_in(request: Iterable[Parameter]) -> dict[str, Any]:
    """Return the values of a request by name, but for parameters that every node has."""
    return {p.name: p.value for p in request if p.name in ALL_SPECS}


def admissible_part(
    request: Sequence[Parameter], now: NodeParameters, has: Callable[[str], bool]
) -> tuple[list[Parameter], dict[str, str]]:
    """
    Return the part of a list that can be set together, and by name the errors of the rest.

    Unreadable parameters are left out, then parameters that contradict others.
    """

    def check(some: Sequence[Parameter]) -> None:
        now.with_changes(values_in(readable(some, now.rig, has)))

    reasons: dict[str, str] = {}
    while rest := [one for one in request if one.name not in reasons]:
        try:
            check(rest)
        except ParameterError as error:
            if error.name not in {one.name for one in rest}:
                break
            reasons[error.name] = str(error)
        else:
            return rest, reasons
    # The parameters contradict each other: they are tried one after the other.
    together: list[Parameter] = []
    for one in rest:
        try:
            check([*together, one])
        except ParameterError as error:
            reasons[one.name] = str(error)
        else:
            together.append(one)
    return together, reasons
