"""The presets, example rigs by name: `presets.yaml`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
)

from .knobs import as_json

_FILE = Path(__file__).with_name('presets.yaml')


@dataclass(frozen=True)
class Preset:
    """
    A rig, its control and its start.

    Attributes
    ----------
    name, title, description : str
        Texts for the user; the name is also used in links.
    rig : RigParameters
        The rig.
    control : GapControlParameters
        Its control.
    initial : InitialConditions
        Its initial conditions.
    """

    name: str
    title: str
    description: str
    rig: RigParameters
    control: GapControlParameters
    initial: InitialConditions

    def as_dict(self) -> dict[str, str]:
        """Return what the page lists."""
        return {'name': self.name, 'title': self.title, 'description': self.description}

    def all_values(self) -> dict[str, Any]:
        """Return all parameters of the rig, of its control and of its start."""
        parts = (self.rig, self.control, self.initial)
        return {n: as_json(v) for part in parts for n, v in part.as_dict().items()}


@cache
def load_presets(path: Path = _FILE) -> tuple[Preset, ...]:
    """
    Read the presets.

    Raises
    ------
    ValueError
        If the parameters of one are not admissible.
    """
    found = []
    for name, entry in yaml.safe_load(path.read_text(encoding='utf-8')).items():
        values = dict(entry['parameters'])
        parts = [
            {n: values.pop(n) for n in specs if n in values}
            for specs in (PARAMETER_SPECS, GAP_CONTROL_SPECS, INITIAL_SPECS)
        ]
        if values:
            raise ValueError(f'{path}: {name}: no parameters: {", ".join(values)}')
        rig = RigParameters(**parts[0])
        initial = InitialConditions(**parts[2])
        initial.check_within(rig)
        title, text = str(entry['title']), ' '.join(str(entry['description']).split())
        control = GapControlParameters(**parts[1])
        found.append(Preset(name, title, text, rig, control, initial))
    return tuple(found)


def preset_with(values: Mapping[str, Any]) -> str:
    """Return the title of the preset with these parameters of rig and control; empty if none."""
    for preset in load_presets():
        own = {n: as_json(v) for p in (preset.rig, preset.control) for n, v in p.as_dict().items()}
        if all(values.get(name) == value for name, value in own.items()):
            return preset.title
    return ''
