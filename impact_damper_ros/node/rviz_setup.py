# SPDX-License-Identifier: Apache-2.0
"""A set-up of RViz with its view fitted to a rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import yaml

from impact_damper_ros.bag.robot_description import picture_size
from impact_damper_ros.parameters.rig_parameters import RigParameters

#: Distance of the eye, in half lengths of the rail.
_DISTANCE = 3.2
#: Cells of the grid along the rail.
_MOST_CELLS = 100


def rviz_setup(text: str, rig: RigParameters, gap_max: float = 0.0) -> str:
    """Return a set-up of RViz with its view fitted to a rig."""
    size = picture_size(rig, gap_max)
    setup: dict[str, Any] = yaml.safe_load(text)
    manager = setup['Visualization Manager']
    shown: Mapping[str, Any] = {display['Name']: display for display in manager['Displays']}
    # Where M is without load is in the view as well, unless it is far away.
    aside = math.copysign(min(abs(size.rest), size.rail), size.rest)
    half = size.rail + 0.5 * abs(aside)
    cell = max(size.damper, 2.0 * half / _MOST_CELLS)
    shown['Grid']['Cell Size'] = cell
    shown['Grid']['Plane Cell Count'] = 2 * math.ceil(1.5 * half / cell)
    shown['Grid']['Offset']['Z'] = -1.65 * size.damper
    shown['Frames']['Marker Scale'] = 2.0 * size.damper
    middle = size.rest - 0.5 * aside
    distance = _DISTANCE * half
    manager['Views']['Current'] |= {
        'Distance': distance,
        'Near Clip Distance': 0.003 * distance,
        'Focal Shape Size': 0.2 * distance,
        'Focal Point': {
            'X': middle * math.cos(rig.angle),
            'Y': 0.0,
            'Z': -middle * math.sin(rig.angle),
        },
    }
    return str(yaml.safe_dump(setup, sort_keys=False))
