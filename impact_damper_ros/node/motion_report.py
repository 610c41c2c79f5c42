# SPDX-License-Identifier: Apache-2.0
"""
Measured and predicted motion for the diagnostics, and whether they agree.

The keys and the form of the values are an interface: numbers, and lists in brackets, as JSON
writes them; True or False; words; and an empty text for unknown values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import NamedTuple

from impact_damper_ros.motion.event import Event
from impact_damper_ros.orbits.orbit import PeriodicOrbit, Rhythm
from impact_damper_ros.orbits.recurrence import MotionKind, Period, Section, find_period
from impact_damper_ros.orbits.solved_orbits import transmissibility
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.theory.prediction import ObservedMotion, Prediction
from impact_damper_ros.theory.theory_thread import TheoryThread

from .motion_trace import KEPT, MotionTrace

#: Last cycles of the force that are measured where there is no rhythm; a motion without an impact
#: in as many cycles has none.
MEASURED_CYCLES = 20
#: Longest rhythm that is recognised, in cycles of the force.
LONGEST_RHYTHM = 8
#: Periods that differ by less than the first, in cycles of the force and relative to the largest
#: |X|, are a rhythm; if they differ by less than the second, the motion has settled.
RECOGNISED, SETTLED_DRIFT = 1e-2, 1e-4
#: Consecutive periods that must differ little in a settled motion.
SETTLED_PERIODS = 3
#: Turning points of M are interpolated between samples; with fewer per cycle they are inaccurate.
LEAST_SAMPLES_PER_CYCLE = 6.0


class RecentMotion(NamedTuple):
    """The measured motion of a rig."""

    #: `PERIODIC`: settled; `TRANSIENT`: its impacts repeat ever more closely; `UNDECIDED`:
    #: neither; `NO_IMPACTS`; or `NOT_PERIODICALLY_DRIVEN`, if the force has no first harmonic, or
    #: a multisine besides.
    kind: MotionKind
    cycles: float = 0.0  # cycles of the force since the last change or reset
    #: Impacts per cycle of the force in the last period, or without a rhythm in the last
    #: `MEASURED_CYCLES` cycles.
    impacts_per_cycle: float | None = None
    rhythm: Rhythm | None = None  # the repeated sequence of impacts, settled or not
    period: Period | None = None  # how closely it repeats
    impact: Event | None = None  # the last impact
    phase: float = 0.0  # instant of that impact in cycles of the force since its zero angle
    #: Largest |X| in the same part, m, and as a share of the amplitude A without impacts; None if
    #: the samples are too few for it.
    x_max: float | None = None
    x_max_ratio: float | None = None
    without: float = 0.0  # cycles of the force since the last impact, or change
    #: The gap that is wider than M moves from end to end, m; else 0
    too_wide: float = 0.0
    #: Transmissibilities in the last `KEPT_CYCLES` cycles, from samples; NaN for a base at rest.
    transmissibility: Transmissibility = Transmissibility()

    @property
    def settled(self) -> bool:
        """Whether the motion has settled."""
        return self.kind is MotionKind.PERIODIC


def recent_motion(trace: MotionTrace, state_rate: float) -> RecentMotion:
    """Measure the motion of a rig since its last change or reset."""
    parameters, frequency, now = trace.parameters, trace.frequency, trace.time
    if not (frequency and parameters.first_harmonic[0] and not parameters.multisine_level):
        cycle = math.tau / parameters.omega
        recently = trace.largest(now - MEASURED_CYCLES * cycle)
        enough = state_rate * cycle >= LEAST_SAMPLES_PER_CYCLE
        return RecentMotion(MotionKind.NOT_PERIODICALLY_DRIVEN, x_max=recently if enough else None)
    cycle = math.tau / frequency
    cycles = (now - trace.began) / cycle
    impacts = trace.impacts()
    instants = [trace.cycles(event.time) for event in impacts]
    largest = trace.largest(now - LONGEST_RHYTHM * cycle)
    stops, x = [event.stop for event in impacts], [event.x for event in impacts]
    section = Section.of_impacts(instants, stops, x, length=largest)
    period = find_period(section, SETTLED_DRIFT, near=RECOGNISED, longest=LONGEST_RHYTHM)
    turned, rhythm = trace.cycles(now), None
    if period is not None and instants[-1] < turned - 2 * period.cycles:
        # The impacts have stopped.
        period = None
    if period is not None:
        largest = trace.largest(now - period.cycles * cycle)
        last = slice(-period.rows, None)
        rhythm = Rhythm.of_impacts(period.cycles, stops[last], instants[last], x[last], largest)
        kind = MotionKind.UNDECIDED
        if period.repeated >= SETTLED_PERIODS:
            kind = MotionKind.PERIODIC
        elif period.approaches:
            kind = MotionKind.TRANSIENT
        per_cycle = period.rows / period.cycles
    else:
        recent = min(cycles, MEASURED_CYCLES)
        if len(impacts) >= KEPT:
            # With many impacts in a cycle fewer cycles are kept.
            recent = min(recent, turned - instants[0])
        count = sum(instant > turned - recent for instant in instants)
        without = not count and cycles >= MEASURED_CYCLES
        kind = MotionKind.NO_IMPACTS if without else MotionKind.UNDECIDED
        largest = trace.largest(now - recent * cycle)
        per_cycle = count / recent if recent > 0.0 else 0.0
    x_max = ratio = None
    taken = Transmissibility()
    if state_rate * cycle >= LEAST_SAMPLES_PER_CYCLE:
        x_max, taken = largest, trace.transmissibility()
        ratio = trace.present.x_max_ratio(x_max)
    return RecentMotion(
        kind,
        cycles,
        per_cycle,
        rhythm,
        period,
        impacts[-1] if impacts else None,
        instants[-1] if impacts else 0.0,
        x_max,
        ratio,
        turned - instants[-1] if impacts else cycles,
        parameters.gap if 2.0 * largest < parameters.gap and not parameters.one_sided else 0.0,
        taken,
    )


#: Tolerances of a settled motion: of instants in cycles of the force, and of X relative to the
#: largest |X|; and of the largest |X|, which is interpolated between samples.
TOLERANCE, X_MAX_TOLERANCE = 1e-3, 5e-3
#: Kinds that may still become the predicted motion.
MOVING = (MotionKind.TRANSIENT, MotionKind.UNDECIDED)


class Agreement(NamedTuple):
    """Measured and predicted motion side by side."""

    #: 'agrees', 'disagrees', 'not settled', or empty where there is nothing to compare.
    verdict: str = ''
    #: The predicted motion; it begins with the same impact as the measured one if that has the
    #: same stops.
    motion: PeriodicOrbit | None = None
    basis: str = ''  # why this motion: 'measured', 'run ahead' or 'listed'
    #: Largest differences of the instants of the impacts (in cycles of the force), of X at the
    #: impacts and of the largest |X| (relative to that).
    phase: float | None = None
    x: float | None = None
    x_max: float | None = None
    tolerance: float = TOLERANCE  # tolerance of the first two, including the rest of the transient


def compare(measured: RecentMotion, prediction: Prediction) -> Agreement:
    """Compare a measured motion with the nearest predicted one."""
    rhythm = measured.rhythm
    near = prediction.nearest(rhythm) if rhythm is not None else None
    if near is None:
        verdict = ''
        if rhythm is not None and measured.settled and prediction.complete and prediction.applies:
            verdict = 'disagrees'
        elif prediction.expected is not None and measured.kind in MOVING:
            verdict = 'not settled'
        return Agreement(verdict, prediction.expected, prediction.basis)
    motion, apart = near
    # The rest of a transient that fades by the multiplier in each period
    rest = 1.0 - abs(motion.multipliers[0])
    drift = 0.0 if measured.period is None else measured.period.level
    tolerance = TOLERANCE + (drift / rest if rest > 0.0 else 0.0)
    largest = None
    if measured.x_max is not None:
        largest = abs(measured.x_max - motion.x_max) / motion.x_max
    if not measured.settled:
        verdict = 'not settled'
    elif max(apart) <= tolerance and (largest or 0.0) <= X_MAX_TOLERANCE - TOLERANCE + tolerance:
        verdict = 'agrees'
    else:
        # A nearer motion may be found yet.
        verdict = 'disagrees' if prediction.complete else ''
    return Agreement(verdict, motion, 'measured', apart.phase, apart.x, largest, tolerance)


_HOW = {MotionKind.PERIODIC: 'settled', MotionKind.TRANSIENT: 'settling'}


class MotionReport(NamedTuple):
    """A status for the diagnostics: all is well, or a warning."""

    task: str
    warning: bool
    message: str
    values: dict[str, object]


class MotionMonitor:
    """Measures the motion of the rig at each report and compares it with the prediction."""

    def __init__(
        self, trace: Callable[[], MotionTrace], theory: TheoryThread, state_rate: float
    ) -> None:
        self._trace = trace
        self._theory = theory
        self._state_rate = state_rate
        # Motions that were requested again, and the number of their rig
        self._asked_of = 0
        self._asked: set[tuple[tuple[int, ...], int]] = set()

    def look(self) -> list[MotionReport]:
        """Return reports on the measured and the predicted motion."""
        measured = recent_motion(self._trace(), self._state_rate)
        agreement = compare(measured, self._theory.prediction or Prediction())
        if agreement.verdict == 'disagrees':
            self._ask_again(measured)
        return [measured_report(measured), predicted_report(self._theory, agreement)]

    def _ask_again(self, measured: RecentMotion) -> None:
        """Request the theory for the measured motion, once for each stop sequence."""
        rhythm, impact = measured.rhythm, measured.impact
        assert rhythm is not None
        assert impact is not None
        if self._asked_of != self._theory.rigs_requested:
            self._asked_of = self._theory.rigs_requested
            self._asked.clear()
        if (rhythm.stops, rhythm.cycles) not in self._asked:
            self._asked.add((rhythm.stops, rhythm.cycles))
            self._theory.ask_like(ObservedMotion(rhythm, impact, measured.phase))


def measured_report(measured: RecentMotion) -> MotionReport:
    """Report the measured motion."""
    rhythm, period = measured.rhythm, measured.period
    words = measured.kind.value
    if rhythm is not None:
        words = f'{_in_words(rhythm)}, {_HOW.get(measured.kind, words)}'
    elif measured.impacts_per_cycle:
        words += f', {measured.impacts_per_cycle:.3g} impacts per cycle'
    idle = measured.kind is MotionKind.NO_IMPACTS
    if idle:
        words = f'm has not hit a stop for {measured.without:.0f} cycles of the force'
        if why := _why_idle(measured):
            words += f': {why}'
    return MotionReport(
        'measured motion',
        idle and bool(measured.too_wide),
        words,
        {
            'State': measured.kind.value,
            'Reason': _why_undecided(measured) or _why_idle(measured),
            'Settled': measured.settled,
            'Cycles of the force since the last change': _number(measured.cycles, 3),
            'Impacts per cycle of the force': _number(measured.impacts_per_cycle),
            **_rhythm_values(rhythm),
            'Largest X [m]': _number(measured.x_max),
            'Largest X / A': _number(measured.x_max_ratio),
            **_transmissibility_values(measured.transmissibility),
            'Change from period to period': _number(period.level if period else None, 3),
            'Factor of that change per period': _number(period.decay if period else None, 3),
        },
    )


def _why_idle(measured: RecentMotion) -> str:
    """Return a possible reason for no impacts; empty if there are some, or none is known."""
    if measured.kind is not MotionKind.NO_IMPACTS or not measured.too_wide:
        return ''
    return (
        f'the gap, {measured.too_wide:.3g} m, is wider than M moves from end to end: m is not hit '
        'from rest; give a narrower gap, or more force'
    )


def _why_undecided(measured: RecentMotion) -> str:
    """Return why the kind of motion is undecided; empty if it is not."""
    if measured.kind is not MotionKind.UNDECIDED:
        return ''
    if measured.rhythm is not None:
        return 'the impacts nearly repeat, but do not converge'
    return (
        f'no period of up to {LONGEST_RHYTHM} cycles of the force is recognised, '
        f'{measured.cycles:.0f} cycles after the last change'
    )


def predicted_report(theory: TheoryThread, agreement: Agreement) -> MotionReport:
    """Report the predicted motion, and whether the measured one agrees."""
    known, motion = theory.prediction or Prediction(), agreement.motion
    state, warning, words = _state(theory, agreement)
    return MotionReport(
        'predicted motion',
        warning,
        words,
        {
            'State': state,
            'Reason': known.error or known.reason,
            'Chosen as': agreement.basis,
            'Complete': known.complete,
            **_transmissibility_values(_predicted(motion) if motion else Transmissibility()),
            'Agreement': agreement.verdict,
            'Phase difference [cycles of the force]': _number(agreement.phase, 3),
            'X difference / largest X': _number(agreement.x, 3),
            'Largest X difference / largest X': _number(agreement.x_max, 3),
            'Tolerance': _number(agreement.tolerance, 3),
        },
    )


def _state(theory: TheoryThread, agreement: Agreement) -> tuple[str, bool, str]:
    """Return the state, whether to warn, and the message."""
    known, motion = theory.prediction, agreement.motion
    if not theory.enabled:
        return 'off', False, 'off: predict_motion is false'
    if known is None:
        return 'computing', False, 'computing'
    if known.error:
        return 'unavailable', True, f'the prediction failed: {known.error}'
    if motion is None:
        if agreement.verdict == 'disagrees':
            return 'none', True, 'the measured motion repeats, but theory finds no such motion'
        # Without a periodic force no motion is to be expected.
        warning = bool(known.orbits) and known.complete
        return 'none', warning, known.reason or 'no viable motion found so far'
    words = [f'{_in_words(motion)}, {motion.stability}{"" if motion.viable else ", not viable"}']
    if agreement.verdict in ('agrees', 'disagrees'):
        words.append(f'the measured motion {agreement.verdict}')
    words += filter(None, [known.reason])
    lost = known.complete and not (motion.stable and motion.viable)
    warning = lost or agreement.verdict == 'disagrees'
    return 'found', warning, '; '.join(words)


def _in_words(rhythm: Rhythm) -> str:
    impacts, cycles = plural(rhythm.impacts, 'impact'), plural(rhythm.cycles, 'cycle')
    return f'{impacts} in {cycles} (stops {",".join(map(str, rhythm.stops))})'


def _rhythm_values(rhythm: Rhythm | None) -> dict[str, object]:
    return {
        'Impacts per period': rhythm.impacts if rhythm else '',
        'Period [cycles of the force]': rhythm.cycles if rhythm else '',
        'Stop sequence': _numbers(rhythm.stops) if rhythm else '',
        'Phases [cycles of the force]': _numbers(rhythm.phases) if rhythm else '',
        'X at the impacts [m]': _numbers(rhythm.x) if rhythm else '',
    }


#: The text is cached: the same motion is reported each second.
_predicted = lru_cache(maxsize=16)(transmissibility)


def _transmissibility_values(taken: Transmissibility) -> dict[str, object]:
    return {
        'Transmissibility, rms X / rms b': _number(taken.absolute, 5),
        'Relative transmissibility, rms (X - b) / rms b': _number(taken.relative, 5),
    }


def _number(value: float | None, digits: int = 9) -> str:
    return f'{value:.{digits}g}' if value is not None and math.isfinite(value) else ''


def _numbers(values: Iterable[float]) -> str:
    return f'[{", ".join(f"{value:.9g}" for value in values)}]'
