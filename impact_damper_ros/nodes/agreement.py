"""Whether the rig moves as predicted."""

from __future__ import annotations

from dataclasses import dataclass

from impact_damper_ros.analysis.motion_kind import MotionKind
from impact_damper_ros.nodes.measured_motion import MeasuredMotion
from impact_damper_ros.nodes.predicted_motion import Answer, PredictedMotion

__all__ = ['Agreement', 'compare']

#: A settled motion agrees within this: instants in cycles of the force, X relative to the largest
#: |X|; and the largest |X|, which is interpolated between samples, within the second.
TOLERANCE, X_MAX_TOLERANCE = 1e-3, 5e-3
#: What may come to be the predicted motion yet.
MOVING = (MotionKind.TRANSIENT, MotionKind.UNDECIDED)


@dataclass(frozen=True)
class Agreement:
    """
    Measured and predicted motion side by side.

    Attributes
    ----------
    verdict : str
        'agrees', 'disagrees', 'not settled', or empty where there is nothing to compare.
    motion : PredictedMotion or None
        The predicted motion, counted as the measured one if that has the same stops.
    basis : str
        Why this one: 'measured', 'run ahead' or 'listed'.
    phase, x, x_max : float or None
        Largest differences of the instants of the impacts (in cycles of the force), of X at the
        impacts and of the largest |X| (relative to that).
    tolerance : float
        Within which the first two agree: with what is left of the transient.
    """

    verdict: str = ''
    motion: PredictedMotion | None = None
    basis: str = ''
    phase: float | None = None
    x: float | None = None
    x_max: float | None = None
    tolerance: float = TOLERANCE


def compare(measured: MeasuredMotion, answer: Answer) -> Agreement:
    """
    Choose the predicted motion that the measured one is to be held against, and do so.

    Parameters
    ----------
    measured : MeasuredMotion
        How the rig moves.
    answer : Answer
        What theory has for it.
    """
    rhythm = measured.rhythm
    near = answer.nearest(rhythm) if rhythm is not None else None
    if rhythm is None or near is None:
        verdict = ''
        if measured.settled and answer.complete and answer.applies:
            verdict = 'disagrees'
        elif answer.expected is not None and measured.kind in MOVING:
            verdict = 'not settled'
        return Agreement(verdict, answer.expected, answer.basis)
    motion, apart = near
    # What a transient that fades by the multiplier in each period still has to go
    rest = 1.0 - motion.largest_multiplier
    tolerance = TOLERANCE + (rhythm.drift / rest if rest > 0.0 else 0.0)
    largest = None
    if measured.x_max is not None:
        largest = abs(measured.x_max - motion.rhythm.x_max) / motion.rhythm.x_max
    if not measured.settled:
        verdict = 'not settled'
    elif max(apart) <= tolerance and (largest or 0.0) <= X_MAX_TOLERANCE - TOLERANCE + tolerance:
        verdict = 'agrees'
    else:
        # A nearer motion may be found yet.
        verdict = 'disagrees' if answer.complete else ''
    return Agreement(verdict, motion, 'measured', apart.phase, apart.x, largest, tolerance)
