# SPDX-License-Identifier: Apache-2.0
"""
What theory says of a rig: the motion to expect, and the curve of Xmax/A over the gap.

`theory` computes both, `predictions` the motion alone. `TheoryProcess` has them computed in a
process of low priority. Importable without ROS.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

from .child_process import ChildProcess
from .prediction import ObservedMotion, Prediction
from .theory_process import TheoryProcess

if TYPE_CHECKING:
    from .documents import theory
    from .expected_motion import predictions
    from .gap_curve import GapCurve
    from .motion_curve import orbit_curve

__all__ = [
    'ChildProcess',
    'GapCurve',
    'ObservedMotion',
    'Prediction',
    'TheoryProcess',
    'orbit_curve',
    'predictions',
    'theory',
]

#: Imported on first use: a program that has them computed elsewhere starts without them.
__getattr__ = lazy_names(
    __name__,
    {
        'documents': ('theory',),
        'expected_motion': ('predictions',),
        'gap_curve': ('GapCurve',),
        'motion_curve': ('orbit_curve',),
    },
)
