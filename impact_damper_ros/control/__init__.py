"""
Active control of the gap: laws, sensors, actuators, and the rig under control.

What is known of the published law, and what is reconstruction or extension, stands in
`amplitude_law`, `timed_law` and in docs/gap_control.
"""

from impact_damper_ros.rig import GAP_CONTROL_SPECS, GapControlParameters

from .controlled_rig import ControlledRig, completed
from .controller import CONTROL_JOINTS, Action, ControlRecord
from .law import Damper, damper_of

__all__ = [
    'CONTROL_JOINTS',
    'GAP_CONTROL_SPECS',
    'Action',
    'ControlRecord',
    'ControlledRig',
    'Damper',
    'GapControlParameters',
    'completed',
    'damper_of',
]
