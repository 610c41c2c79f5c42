"""
Recorded runs compared with the periodic theory.

`compare_bag` cuts a bag into stretches with constant parameters, checks the log of each, measures
its motion, finds the motion that theory predicts, and gives a verdict. `predictions` does the
theory's part for a rig that is running. Importable without ROS; needs numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .measured_motion import cubic_rates, cubic_swing
from .prediction import ObservedMotion, Prediction, predictions
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
    MotionKind,
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
    from .bag_stretches import BagStretches
    from .comparison import LogReplay, compare_bag, replay_log
    from .periodic_motion import GapCurves

__all__ = [
    'Array',
    'BagStretches',
    'Beginning',
    'Convergence',
    'Decay',
    'EnergyBalance',
    'Finding',
    'GapCurve',
    'GapCurves',
    'ImpactCurve',
    'ImpactStates',
    'LogCheck',
    'LogReplay',
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
    'predictions',
    'replay_log',
]


#: Imported when they are used: the node predicts without them.
_WHEN_USED = {
    'BagStretches': 'bag_stretches',
    'GapCurves': 'periodic_motion',
    'LogReplay': 'comparison',
    'compare_bag': 'comparison',
    'replay_log': 'comparison',
}


def __getattr__(name: str) -> Any:
    if name not in _WHEN_USED:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'.{_WHEN_USED[name]}', __name__), name)
