# SPDX-License-Identifier: Apache-2.0
"""
The rig: exact event-driven motion of an inclined impact damper with friction.

Importable without ROS. What needs numpy is loaded at its first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

from .description import described, frequency_hint, robot_description
from .event_budget import RunawayError
from .parameter_spec import ParameterError, ParameterSpec
from .parameters import (
    ALL_SPECS,
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
    SETTING_SPECS,
    GapControlParameters,
    InitialConditions,
    NodeSettings,
    RigParameters,
)
from .parameters_file import ParametersFileError, load_parameters
from .swing import Swing

if TYPE_CHECKING:
    from .event import EVENT_TYPE, SAMPLE_TYPE, Event, EventKind, Sample
    from .state import Mode

__all__ = [
    'ALL_SPECS',
    'EVENT_TYPE',
    'GAP_CONTROL_SPECS',
    'INITIAL_SPECS',
    'PARAMETER_SPECS',
    'SAMPLE_TYPE',
    'SETTING_SPECS',
    'Event',
    'EventKind',
    'GapControlParameters',
    'InitialConditions',
    'Mode',
    'NodeSettings',
    'ParameterError',
    'ParameterSpec',
    'ParametersFileError',
    'RigParameters',
    'RunawayError',
    'Sample',
    'Swing',
    'described',
    'frequency_hint',
    'load_parameters',
    'robot_description',
]

#: Loads what needs numpy.
__getattr__ = lazy_names(
    __name__,
    {'event': ('EVENT_TYPE', 'SAMPLE_TYPE', 'Event', 'EventKind', 'Sample'), 'state': ('Mode',)},
)
