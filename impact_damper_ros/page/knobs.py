# SPDX-License-Identifier: Apache-2.0
"""The parameters of a rig as the page shows them: the table of the package, with values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS
from impact_damper_ros.parameters.units import UNITS

from .requests import RequestError

#: The most important parameters in the order in which they are shown: a title, the entry of the
#: glossary that explains it, and the name in a line of the traces.
_FIRST = {
    'gap': ('Gap d', 'gap', 'd'),
    'damper_mass': ('Damper mass m', 'mass-ratio', 'm'),
    'angle': ('Inclination θ', 'inclination', 'θ'),
    'force_frequencies': ('Force frequency', 'frequency-ratio', 'f'),
    'force_amplitudes': ('Force F', 'force', 'F'),
    'friction': ('Friction γ', 'friction', 'γ'),
    'restitution_1': ('Restitution R₁', 'restitution', 'R₁'),
    'restitution_2': ('Restitution R₂', 'restitution', 'R₂'),
    'restitution_speed': ('Speed v_c', 'restitution-speed', 'v_c'),
    'gap_control': ('Gap control', 'gap-control', 'control'),
}


#: Knobs that replace those of the force where only the base is shaken.
_SHAKEN = {
    'base_frequencies': ('Base frequency', 'frequency-ratio', 'f'),
    'base_amplitudes': ('Base amplitude', '', 'b'),
}


def first_knobs(values: Mapping[str, Any]) -> dict[str, tuple[str, str, str]]:
    """Return the most important parameters of a rig."""
    if any(values.get('force_amplitudes', (1.0,))) or not any(values.get('base_amplitudes', ())):
        return _FIRST
    force, base = ('force_frequencies', 'force_amplitudes'), iter(_SHAKEN.items())
    return dict(next(base) if name in force else (name, _FIRST[name]) for name in _FIRST)


def group(name: str) -> str:
    """Return the group of knobs in which the page shows a parameter."""
    if name in GAP_CONTROL_SPECS:
        return 'control'
    if name.startswith(('force_', 'base_', 'multisine_', 'sweep_')):
        return 'forcing'
    return 'rig' if name in PARAMETER_SPECS else 'run'


def knobs_of(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the parameters that have values, for JSON."""
    first = {
        name: {'place': place, 'title': title, 'term': term, 'symbol': symbol}
        for place, (name, (title, term, symbol)) in enumerate(first_knobs(values).items())
    }
    return [
        {
            'name': name,
            'type': spec.kind,
            'unit': spec.unit,
            'description': spec.description,
            'min': spec.low,
            'max': spec.high,
            'usual': spec.usual,
            'zero': spec.zero,
            'units': [unit for unit in UNITS[spec.unit] if unit],
            'read_only': spec.effect == 'start',
            'choices': spec.choices,
            'group': group(name),
            'first': first.get(name),
            'value': as_json(values[name]),
        }
        for name, spec in ALL_SPECS.items()
        if name in values
    ]


def read_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a request; a typed value is a text with the unit it is shown in."""
    read = dict(values)
    for name, value in list(read.items()):
        if isinstance(value, dict):
            if name not in ALL_SPECS:
                raise RequestError(f'{name[:80]} is not a parameter')
            for key in ('text', 'unit'):
                if key not in value:
                    raise RequestError(f'the value of {name} has no {key}')
            try:
                read[name] = as_json(ALL_SPECS[name].read(str(value['text']), str(value['unit'])))
            except ParameterError as error:
                raise RequestError(str(error)) from None
    return read


def as_json(value: Any) -> Any:
    """Return a value with lists for tuples, and None for numbers that JSON does not have."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, list | tuple):
        return [as_json(entry) for entry in value]
    if isinstance(value, dict):
        return {str(key): as_json(entry) for key, entry in value.items()}
    return value
