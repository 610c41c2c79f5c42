"""
Recorded runs compared with the periodic theory.

`compare_bag` divides a bag into stretches with constant parameters, checks the log of each,
measures its motion, finds the motion that theory predicts, and gives a verdict. `predictions`
predicts the motion of a rig that is running. Importable without ROS; needs numpy.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names
from impact_damper_ros.orbits.recognition import MotionKind

from .measured_motion import cubic_rates, cubic_swing
from .prediction import ObservedMotion, Prediction, predictions
from .recorded_stretch import ForceClock
from .result import (
    Array,
    Beginning,
    Convergence,
    Decay,
    EnergyBalance,
    Finding,
    GapCurve,
    ImpactCurve,
    ImpactStates,
    LogCheck,
    MeasuredMotion,
    MotionCurve,
    Overall,
    PredictedCurve,
    RunComparison,
    Spectrum,
    StretchComparison,
    StretchCurves,
    SwingEnvelope,
    Verdict,
)

if TYPE_CHECKING:
    from .bag_stretches import BagStretches, LoggedRig
    from .comparison import LogReplay, compare_bag, replay_log
    from .periodic_motion import GapCurves, predicted_curve

__all__ = [
    'Array',
    'BagStretches',
    'Beginning',
    'Convergence',
    'Decay',
    'EnergyBalance',
    'Finding',
    'ForceClock',
    'GapCurve',
    'GapCurves',
    'ImpactCurve',
    'ImpactStates',
    'LogCheck',
    'LogReplay',
    'LoggedRig',
    'MeasuredMotion',
    'MotionCurve',
    'MotionKind',
    'ObservedMotion',
    'Overall',
    'PredictedCurve',
    'Prediction',
    'RunComparison',
    'Spectrum',
    'StretchComparison',
    'StretchCurves',
    'SwingEnvelope',
    'Verdict',
    'compare_bag',
    'cubic_rates',
    'cubic_swing',
    'predicted_curve',
    'predictions',
    'replay_log',
]

#: Imported on first use: the node predicts without them.
__getattr__ = lazy_names(
    __name__,
    {
        'bag_stretches': ('BagStretches', 'LoggedRig'),
        'comparison': ('LogReplay', 'compare_bag', 'replay_log'),
        'periodic_motion': ('GapCurves', 'predicted_curve'),
    },
)
