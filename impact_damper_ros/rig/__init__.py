"""
The rig: exact event-driven motion of an inclined impact damper with friction.

Importable without ROS.
"""

from .event import Event, EventKind, Sample
from .mode import Mode
from .parameters import (
    ALL_SPECS,
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
    SETTING_SPECS,
    GapControlParameters,
    InitialConditions,
    NodeSettings,
    ParameterError,
    ParameterSpec,
    RigParameters,
)
from .parameters_file import ParametersFileError, load_parameters
from .simulator import Simulator

__all__ = [
    'ALL_SPECS',
    'GAP_CONTROL_SPECS',
    'INITIAL_SPECS',
    'PARAMETER_SPECS',
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
    'Sample',
    'Simulator',
    'load_parameters',
]
