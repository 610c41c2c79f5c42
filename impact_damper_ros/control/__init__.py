"""
Active control of the gap: laws, sensors, actuators, and the rig under control.

What is known of the published law, and what is reconstruction or extension, stands in
`amplitude_law`, `timed_law` and in docs/gap_control.
"""

from .controlled_rig import ControlledRig
from .damper import Damper, damper_of
from .parameters import GAP_CONTROL_SPECS, GapControlParameters
from .record import Action, ControlRecord

__all__ = [
    'GAP_CONTROL_SPECS',
    'Action',
    'ControlRecord',
    'ControlledRig',
    'Damper',
    'GapControlParameters',
    'damper_of',
]
