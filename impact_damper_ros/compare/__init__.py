# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs compared with the periodic theory.

`compare_bag` divides a bag into stretches with constant parameters, checks the log of each,
measures its motion, finds the motion that theory predicts, and gives a verdict. Importable without
ROS; needs numpy.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names
from impact_damper_ros.orbits.recurrence import MotionKind

from .result import (
    Beginning,
    Decay,
    EnergyBalance,
    Finding,
    ImpactStates,
    LogCheck,
    LogVerdict,
    MeasuredMotion,
    Overall,
    RunComparison,
    StretchComparison,
    Verdict,
)

if TYPE_CHECKING:
    from .comparison import compare_bag
    from .stretches import LoggedRig

__all__ = [
    'Beginning',
    'Decay',
    'EnergyBalance',
    'Finding',
    'ImpactStates',
    'LogCheck',
    'LogVerdict',
    'LoggedRig',
    'MeasuredMotion',
    'MotionKind',
    'Overall',
    'RunComparison',
    'StretchComparison',
    'Verdict',
    'compare_bag',
]

#: Imported on first use.
__getattr__ = lazy_names(
    __name__,
    {
        'comparison': ('compare_bag',),
        'stretches': ('LoggedRig',),
    },
)
