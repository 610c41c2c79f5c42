# SPDX-License-Identifier: Apache-2.0
"""
Active control of the gap: laws, sensors, actuators, and the rig under control.

`amplitude_law`, `timed_law` and docs/gap_control say what is known of the published law, and what
is reconstruction or extension. What needs numpy is loaded at its first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names
from impact_damper_ros.rig import GAP_CONTROL_SPECS, GapControlParameters

from .record import CONTROL_JOINTS, Action, ControlRecord

if TYPE_CHECKING:
    from .ensemble import EnsembleResult, run_ensemble
    from .law import Damper, damper_of
    from .observed_run import Observer, TimedChange, run
    from .order import Order
    from .own_law import LawError, LawInput, OwnLaw
    from .rig import Outcome, Rig, RunResult

__all__ = [
    'CONTROL_JOINTS',
    'GAP_CONTROL_SPECS',
    'Action',
    'ControlRecord',
    'Damper',
    'EnsembleResult',
    'GapControlParameters',
    'LawError',
    'LawInput',
    'Observer',
    'Order',
    'Outcome',
    'OwnLaw',
    'Rig',
    'RunResult',
    'TimedChange',
    'damper_of',
    'run',
    'run_ensemble',
]

#: Loads what needs numpy.
__getattr__ = lazy_names(
    __name__,
    {
        'ensemble': ('EnsembleResult', 'run_ensemble'),
        'law': ('Damper', 'damper_of'),
        'observed_run': ('Observer', 'TimedChange', 'run'),
        'order': ('Order',),
        'own_law': ('LawError', 'LawInput', 'OwnLaw'),
        'rig': ('Outcome', 'Rig', 'RunResult'),
    },
)
