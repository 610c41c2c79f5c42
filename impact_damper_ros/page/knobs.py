"""The parameters of a rig as the page shows them: from ROS descriptors, or from the package."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.rig import INITIAL_SPECS, PARAMETER_SPECS, ParameterSpec

#: The most important parameters, in this order.
_FIRST = (
    *('gap', 'force_frequencies', 'force_amplitudes', 'angle', 'friction'),
    *('restitution_1', 'restitution_2', 'gap_control'),
)
_UNIT = re.compile(r' Unit: (?P<unit>[^ ]+( [^ .]+)*)\.$')
_CHOICES = re.compile(r'^One of (?P<choices>[^.]+)\.')


@dataclass(frozen=True)
class Knob:
    """
    A parameter.

    Attributes
    ----------
    name, kind, unit, description, constraints : str
        As the node describes it; `kind` is double, bool, string, double_array or integer.
    low, high : float or None
        Its range.
    read_only : bool
        Whether it cannot be set while the node runs.
    choices : tuple of str
        Admissible texts; empty for any.
    value : Any
        Its value.
    """

    name: str
    kind: str
    unit: str
    description: str
    constraints: str
    low: float | None
    high: float | None
    read_only: bool
    choices: tuple[str, ...]
    value: Any

    @classmethod
    def of_descriptor(
        cls,
        name: str,
        kind: str,
        description: str,
        constraints: str,
        span: tuple[float | None, float | None],
        read_only: bool,
        value: Any,
    ) -> Self:
        """Return a parameter from its ROS descriptor, whose texts hold unit and choices."""
        unit = ''
        if found := _UNIT.search(description):
            unit, description = found['unit'], description[: found.start()]
        choices: tuple[str, ...] = ()
        if kind == 'string' and (found := _CHOICES.match(constraints)):
            choices = tuple(found['choices'].split(', '))
        return cls(
            *(name, kind, unit, description, constraints),
            *(*span, read_only, choices, value),
        )

    @property
    def group(self) -> str:
        """Group of knobs in which the page shows it."""
        if self.name in _FIRST:
            return 'first'
        if self.name in GAP_CONTROL_SPECS:
            return 'control'
        if self.name.startswith(('force_', 'multisine_', 'sweep_')):
            return 'forcing'
        return 'rig' if self.name in PARAMETER_SPECS else 'run'

    def as_dict(self) -> dict[str, Any]:
        """Return the parameter for JSON."""
        return {
            'name': self.name,
            'type': self.kind,
            'unit': self.unit,
            'description': self.description,
            'constraints': self.constraints,
            'min': self.low,
            'max': self.high,
            'read_only': self.read_only,
            'choices': list(self.choices),
            'group': self.group,
            'value': as_json(self.value),
        }


def knobs_of(values: Mapping[str, Any]) -> list[Knob]:
    """Return the parameters of a rig, of its control and its start that have values."""
    specs: dict[str, ParameterSpec] = {**PARAMETER_SPECS, **GAP_CONTROL_SPECS, **INITIAL_SPECS}
    return [
        Knob(
            *(name, spec.kind, spec.unit, spec.description, ''),
            *(spec.low, spec.high, False, spec.choices, values[name]),
        )
        for name, spec in specs.items()
        if name in values
    ]


def as_json(value: Any) -> Any:
    """Return a value with lists for tuples, and None for numbers that JSON does not have."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, list | tuple):
        return [as_json(entry) for entry in value]
    if isinstance(value, dict):
        return {str(key): as_json(entry) for key, entry in value.items()}
    return value
