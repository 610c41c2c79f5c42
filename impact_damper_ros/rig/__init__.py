"""
The rig: exact event-driven motion of an inclined impact damper with friction.

Importable without ROS. What needs numpy is loaded at its first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

from .description import described, frequency_hint, robot_description
from .event import Event, EventKind, Sample
from .hybrid_motion import RunawayError
from .mode import Mode
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
from .simulator import Simulator
from .swing import Swing

if TYPE_CHECKING:
    from .long_run import LongRun, Outcome, RunResult

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
    'LongRun',
    'Mode',
    'NodeSettings',
    'Outcome',
    'ParameterError',
    'ParameterSpec',
    'ParametersFileError',
    'RigParameters',
    'RunResult',
    'RunawayError',
    'Sample',
    'Simulator',
    'Swing',
    'described',
    'frequency_hint',
    'load_parameters',
    'robot_description',
]

#: Loads what needs numpy.
__getattr__ = lazy_names(__name__, {'long_run': ('LongRun', 'Outcome', 'RunResult')})
