"""
The rig: exact event-driven motion of an inclined impact damper with friction.

Importable without ROS.
"""

from .event import Event, EventKind, Sample
from .mode import Mode
from .parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    ParameterError,
    ParameterSpec,
    RigParameters,
)
from .parameters_file import ParametersFileError, load_parameters
from .simulator import Simulator

__all__ = [
    'INITIAL_SPECS',
    'PARAMETER_SPECS',
    'Event',
    'EventKind',
    'InitialConditions',
    'Mode',
    'ParameterError',
    'ParameterSpec',
    'ParametersFileError',
    'RigParameters',
    'Sample',
    'Simulator',
    'load_parameters',
]
