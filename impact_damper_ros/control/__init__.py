"""
Active control of the gap: laws, sensors, actuators, and the rig under control.

`amplitude_law`, `timed_law` and docs/gap_control say what is known of the published law, and what
is reconstruction or extension. What needs numpy is loaded at its first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from impact_damper_ros.rig import GAP_CONTROL_SPECS, GapControlParameters

from .controlled_rig import ControlledRig, completed
from .controller import CONTROL_JOINTS, Action, ControlRecord
from .law import Damper, damper_of

if TYPE_CHECKING:
    from .controlled_run import ControlledRun

__all__ = [
    'CONTROL_JOINTS',
    'GAP_CONTROL_SPECS',
    'Action',
    'ControlRecord',
    'ControlledRig',
    'ControlledRun',
    'Damper',
    'GapControlParameters',
    'completed',
    'damper_of',
]


def __getattr__(name: str) -> Any:
    """Load what needs numpy."""
    if name == 'ControlledRun':
        return import_module('.controlled_run', __name__).ControlledRun
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
