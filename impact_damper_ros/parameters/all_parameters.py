# SPDX-License-Identifier: Apache-2.0
"""All parameters by their ROS names: of the rig, its start, its control and the node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .base_motion import QUANTITIES
from .gap_control_parameters import GAP_CONTROL_SPECS
from .node_settings import SETTING_SPECS
from .rig_parameters import INITIAL_SPECS, PARAMETER_SPECS
from .structure import STRUCTURE_SPECS

#: What a rig may be described by: its parameters, and those of its structure.
RIG_SPECS = {**PARAMETER_SPECS, **STRUCTURE_SPECS}
#: All parameters that a parameters file may hold, in this order in documents and lists.
ALL_SPECS = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS, **SETTING_SPECS}


def unit_of(name: str, values: Mapping[str, Any]) -> str:
    """Return the unit of a parameter of a rig with these values, if it has one."""
    if name == 'base_amplitudes':
        return QUANTITIES[values['base_quantity']]
    return ALL_SPECS[name].unit if name in ALL_SPECS else ''
