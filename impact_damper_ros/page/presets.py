# SPDX-License-Identifier: Apache-2.0
"""The presets, example rigs by name: `presets.yaml`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.parameters_file import load_parameters
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
)

from .knobs import as_json

_FILE = Path(__file__).with_name('presets.yaml')
#: Parameters whose defaults are for a rig of 1 rad/s, with the power of the natural frequency by
#: which they scale: a sweep that is switched on then passes the resonance.
_POWERS = {
    **dict.fromkeys(('multisine_low', 'multisine_high'), 1),
    **dict.fromkeys(('sweep_low', 'sweep_high', 'sweep_step'), 1),
    'sweep_dwell': -1,
}


class Preset(NamedTuple):
    """A rig, its control and its start, with texts for the user; links hold the name."""

    name: str
    title: str
    description: str
    rig: RigParameters
    control: GapControlParameters
    initial: InitialConditions

    @property
    def values(self) -> dict[str, Any]:
        """All parameters of the rig, of its control and of its start, for JSON."""
        parts = (self.rig, self.control, self.initial)
        return {n: as_json(v) for part in parts for n, v in part.as_dict().items()}


@cache
def load_presets(path: Path = _FILE) -> dict[str, Preset]:
    """Read the presets, by name; ValueError if the parameters of one are not admissible."""
    found = {}
    for name, entry in yaml.safe_load(path.read_text(encoding='utf-8')).items():
        values = _values_of(entry.get('file'), entry.get('parameters', {}))
        rig, control, initial = (
            {n: values[n] for n in values.keys() & specs}
            for specs in (PARAMETER_SPECS, GAP_CONTROL_SPECS, INITIAL_SPECS)
        )
        text = ' '.join(entry['description'].split())
        found[name] = Preset(
            *(name, entry['title'], text),
            *(RigParameters(**rig), GapControlParameters(**control), InitialConditions(**initial)),
        )
        found[name].initial.check_within(found[name].rig)
    return found


def _values_of(file: str | None, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a preset: of a file of config/ with changes, or its own list."""
    if file is not None:
        rig, initial, settings = load_parameters(file)
        return {**settings, **rig.as_dict(), **initial.as_dict(), **values}
    omega = math.sqrt(values['stiffness'] / values['primary_mass'])
    return {**scaled_to(omega), **values}


def scaled_to(omega: float) -> dict[str, Any]:
    """Return sweep, multisine and frequency of the base for a natural frequency, rad/s."""
    usual = RigParameters().as_dict()
    scaled = {name: usual[name] * omega**power for name, power in _POWERS.items()}
    rounded = {name: float(f'{value:.4g}') for name, value in scaled.items()}
    return {**rounded, 'base_frequencies': (float(f'{omega:.4g}'),)}


def change_between(
    before: Mapping[str, Any], now: Mapping[str, Any], time: float | None, kind: str = 'change'
) -> dict[str, Any] | None:
    """Return the message on a change or reset; None where nothing has changed."""
    values = {n: v for n, v in now.items() if before.get(n, v) != v}
    if not values and kind == 'change':
        return None
    whole = {**before, **now}
    return {'time': time, 'kind': kind, 'values': values, 'preset': preset_with(whole)}


def preset_with(values: Mapping[str, Any]) -> str:
    """Return the title of the preset with these parameters of rig and control; empty if none."""
    for preset in load_presets().values():
        if all(values.get(n) == v for n, v in preset.values.items() if n not in INITIAL_SPECS):
            return preset.title
    return ''
