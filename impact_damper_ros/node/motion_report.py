"""
Measured and predicted motion for the diagnostics, and whether they agree.

The keys and the form of the values are an interface: numbers, and lists in brackets, as JSON
writes them; True or False; words; and an empty text for what is not known.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from impact_damper_ros.orbits.recognition import LONGEST_RHYTHM, MotionKind, Rhythm

from .measured_motion import MeasuredMotion, MotionTrace, measure
from .prediction import Answer, PredictedMotion, Predictor, PredictorStatus

__all__ = [
    'Agreement',
    'MotionMonitor',
    'MotionReport',
    'compare',
    'measured_report',
    'predicted_report',
]


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
    """Choose the predicted motion that the measured one is to be held against, and do so."""
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


_HOW = {MotionKind.PERIODIC: 'settled', MotionKind.TRANSIENT: 'settling'}


class MotionReport(NamedTuple):
    """A status for the diagnostics: all is well, or a warning."""

    task: str
    warning: bool
    message: str
    values: dict[str, object]


class MotionMonitor:
    """
    Look at the motion of the rig now and then, and at what theory has for it.

    Parameters
    ----------
    trace : callable
        Returns the present trace of the engine.
    predictor : Predictor
        Is asked again if the rig settles into a motion that it has not thought of.
    state_rate : float
        Samples per second of rig time.
    """

    def __init__(
        self, trace: Callable[[], MotionTrace], predictor: Predictor, state_rate: float
    ) -> None:
        """Begin to look."""
        self._trace = trace
        self._predictor = predictor
        self._state_rate = state_rate
        self._looked = 0.0
        # What has been asked for again, of which course and worker
        self._asked_of = (0, 0)
        self._asked: set[tuple[tuple[int, ...], int]] = set()

    def may_look(self, period: float) -> bool:
        """Return whether the last look was at least so long ago, s."""
        return time.monotonic() - self._looked >= period

    def look(self) -> list[MotionReport]:
        """Return how the rig moves, and how it should."""
        self._looked = time.monotonic()
        # In this order: of a newer course there can be no rhythm yet to take for the older one's.
        status = self._predictor.status()
        measured = measure(self._trace(), self._state_rate)
        agreement = compare(measured, status.answer)
        if agreement.verdict == 'disagrees':
            self._ask_again(status, measured)
        return [measured_report(measured), predicted_report(status, agreement)]

    def _ask_again(self, status: PredictorStatus, measured: MeasuredMotion) -> None:
        """Ask for the motion that was measured; once for each kind of it."""
        rhythm, impact = measured.rhythm, measured.impact
        assert rhythm is not None
        assert impact is not None
        if self._asked_of != (status.course, status.restarts):
            self._asked_of = (status.course, status.restarts)
            self._asked.clear()
        if (rhythm.stops, rhythm.cycles) not in self._asked:
            self._asked.add((rhythm.stops, rhythm.cycles))
            self._predictor.ask_like(rhythm, impact, measured.phase, status.course)


def measured_report(measured: MeasuredMotion) -> MotionReport:
    """Report how the rig moves."""
    rhythm = measured.rhythm
    words = measured.kind.value
    if rhythm is not None:
        words = f'{_in_words(rhythm)}, {_HOW.get(measured.kind, words)}'
    elif measured.impacts_per_cycle:
        words += f', {measured.impacts_per_cycle:.3g} impacts per cycle'
    return MotionReport(
        'measured motion',
        False,
        words,
        {
            'State': measured.kind.value,
            'Reason': _why_undecided(measured),
            'Settled': measured.settled,
            'Cycles of the force since the last change': _number(measured.cycles, 3),
            'Impacts per cycle of the force': _number(measured.impacts_per_cycle),
            **_rhythm_values(rhythm),
            'Largest X [m]': _number(measured.x_max),
            'Largest X / A': _number(measured.amplitude_ratio),
            'Change from period to period': _number(rhythm.drift if rhythm else None, 3),
            'Factor of that change per period': _number(rhythm.decay if rhythm else None, 3),
        },
    )


def _why_undecided(measured: MeasuredMotion) -> str:
    """Return why nothing is said of how a rig moves; empty if something is."""
    if measured.kind is not MotionKind.UNDECIDED:
        return ''
    if measured.rhythm is not None:
        return 'the impacts nearly repeat, but do not come closer to it'
    return (
        f'no period of up to {LONGEST_RHYTHM} cycles of the force is recognised, '
        f'{measured.cycles:.0f} cycles after the last change'
    )


def predicted_report(status: PredictorStatus, agreement: Agreement) -> MotionReport:
    """Report how the rig should move, and whether it does."""
    answer, motion = status.answer, agreement.motion
    state, warning, words = _state(status, agreement)
    others = [m for m in answer.motions if m.stable and m.viable and not _same(m, motion)]
    return MotionReport(
        'predicted motion',
        warning,
        words,
        {
            'State': state,
            'Reason': status.trouble or answer.error or answer.reason,
            'Chosen as': agreement.basis,
            'Complete': answer.complete,
            **_rhythm_values(motion.rhythm if motion else None),
            'Largest X [m]': _number(motion.rhythm.x_max if motion else None),
            'Largest X / A': _number(motion.amplitude_ratio if motion else None),
            'Largest multiplier modulus': _number(motion.largest_multiplier if motion else None),
            'Stable': motion.stable if motion else '',
            'Viable': motion.viable if motion else '',
            'Other stable motions': json.dumps([_summary(m) for m in others]),
            'Agreement': agreement.verdict,
            'Phase difference [cycles of the force]': _number(agreement.phase, 3),
            'X difference / largest X': _number(agreement.x, 3),
            'Largest X difference / largest X': _number(agreement.x_max, 3),
            'Tolerance': _number(agreement.tolerance, 3),
            'Computing time [s]': _number(answer.seconds if answer.request else None, 3),
            'Process': status.process or '',
            'Restarts of the process': status.restarts,
            'Last end of the process': status.last_trouble,
        },
    )


def _state(status: PredictorStatus, agreement: Agreement) -> tuple[str, bool, str]:
    """Return the state, whether to warn, and the message."""
    answer, motion = status.answer, agreement.motion
    if not status.enabled:
        return 'off', False, 'off: predict_motion is false'
    trouble = status.trouble or (answer.error and f'the prediction failed: {answer.error}')
    if not answer.request or answer.error:
        return ('unavailable', True, trouble) if trouble else ('computing', False, 'computing')
    if motion is None:
        if agreement.verdict == 'disagrees':
            return 'none', True, 'the measured motion repeats, but theory has none like it'
        # Without a periodic force there is none to be expected.
        warning = bool(answer.motions) and answer.complete
        return 'none', warning, answer.reason or 'no viable motion found so far'
    fate = 'stable' if motion.stable else 'unstable'
    words = [f'{_in_words(motion.rhythm)}, {fate}{"" if motion.viable else ", not viable"}']
    if agreement.verdict in ('agrees', 'disagrees'):
        words.append(f'the measured motion {agreement.verdict}')
    words += filter(None, (answer.reason, trouble))
    lost = answer.complete and not (motion.stable and motion.viable)
    warning = lost or agreement.verdict == 'disagrees' or bool(trouble)
    return 'found', warning, '; '.join(words)


def _in_words(rhythm: Rhythm) -> str:
    impacts = f'{rhythm.impacts} impact{"s" if rhythm.impacts > 1 else ""}'
    cycles = f'{rhythm.cycles} cycle{"s" if rhythm.cycles > 1 else ""}'
    return f'{impacts} in {cycles} (stops {",".join(map(str, rhythm.stops))})'


def _rhythm_values(rhythm: Rhythm | None) -> dict[str, object]:
    return {
        'Impacts per period': rhythm.impacts if rhythm else '',
        'Period [cycles of the force]': rhythm.cycles if rhythm else '',
        'Stop sequence': _numbers(rhythm.stops) if rhythm else '',
        'Phases [cycles of the force]': _numbers(rhythm.phases) if rhythm else '',
        'X at the impacts [m]': _numbers(rhythm.x) if rhythm else '',
    }


def _summary(motion: PredictedMotion) -> dict[str, object]:
    return {
        'stops': list(motion.rhythm.stops),
        'cycles': motion.rhythm.cycles,
        'largest_x_over_a': float(f'{motion.amplitude_ratio:.9g}'),
        'largest_multiplier': float(f'{motion.largest_multiplier:.9g}'),
    }


def _same(one: PredictedMotion, other: PredictedMotion | None) -> bool:
    if other is None:
        return False
    turned = one.rhythm.turned_to(other.rhythm)
    return turned is not None and max(turned[1]) < 1e-9


def _number(value: float | None, digits: int = 9) -> str:
    return f'{value:.{digits}g}' if value is not None and math.isfinite(value) else ''


def _numbers(values: Iterable[float]) -> str:
    return f'[{", ".join(f"{value:.9g}" for value in values)}]'
