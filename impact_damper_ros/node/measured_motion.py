"""
The motion of the running rig, as measured since it was last changed.

It costs the tick next to nothing, since only impacts and turning points of M are kept; whoever
wants to know more looks at them in another thread.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from impact_damper_ros.orbits.recognition import (
    LONGEST_RHYTHM,
    SETTLED_DRIFT,
    MotionKind,
    Rhythm,
    approaches,
    period_distances,
    rhythm_of,
    turned_cycles,
)
from impact_damper_ros.rig import Event, EventKind, RigParameters, Sample
from impact_damper_ros.rig.forcing import frequency_at
from impact_damper_ros.rig.swing import extremes

__all__ = ['MeasuredMotion', 'MotionTrace', 'measure']


#: Impacts and turning points that are kept: some dozens of periods, or a few with many impacts.
KEPT = 512


class MotionTrace:
    """
    The motion of a rig since it was last changed or reset, or its frequency was.

    The engine's thread writes; any other may read, since what it reads is copied at once.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    began : float
        Rig time at the beginning, s.
    turned : float
        Angle of the first harmonic then, in cycles since its zero.
    step : int
        Steps of a sweep done by then.

    Attributes
    ----------
    parameters, began
        As given.
    frequency : float
        Of the first harmonic, rad/s.
    """

    def __init__(
        self, parameters: RigParameters, began: float, turned: float, step: int = 0
    ) -> None:
        """Begin without impacts."""
        self.parameters = parameters
        self.began = began
        self.frequency = frequency_at(parameters, step)
        self._turned = turned
        self._step = step
        self._impacts: deque[Event] = deque(maxlen=KEPT)
        self._turns: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._last: Sample | None = None
        self._passed: Sequence[Event] = ()

    @classmethod
    def at(cls, parameters: RigParameters, snapshot: Mapping[str, Any]) -> MotionTrace:
        """Begin at a snapshot of the rig."""
        step = snapshot['sweep']['step']
        turned = turned_cycles(snapshot, frequency_at(parameters, step))
        return cls(parameters, snapshot['time'], turned, step)

    def after(self, events: Sequence[Event]) -> MotionTrace:
        """Take all events since the last sample, and return the trace that goes on from there."""
        trace, first = self, 0
        for i, event in enumerate(events):
            if event.kind is EventKind.IMPACT:
                trace._impacts.append(event)
            elif event.kind is EventKind.FREQUENCY_STEP:
                turned = trace.cycles(event.time)
                trace = MotionTrace(trace.parameters, event.time, turned, trace._step + 1)
                first = i + 1
        # Between two ticks far apart there may be several moves of the rig, and any many events.
        before = [] if trace is not self else trace._passed
        trace._passed = [*before, *events[first:]][-KEPT:] if before or first else events
        return trace

    def sample(self, sample: Sample) -> None:
        """Take the next sample; one that was taken before is left alone."""
        last = self._last
        if last is not None and sample.time <= last.time:
            return
        self._last = sample
        if last is None:
            self._passed = ()
        elif self._passed or last.primary_velocity * sample.primary_velocity < 0.0:
            for x in extremes(last, self._passed, sample):
                self._turns.append((sample.time, abs(x)))
            self._passed = ()

    # For other threads

    @property
    def time(self) -> float:
        """Rig time of the last sample, s."""
        return self._last.time if self._last is not None else self.began

    def cycles(self, time: float) -> float:
        """Return the angle of the first harmonic at an instant (s), in cycles since its zero."""
        return self._turned + (time - self.began) * self.frequency / math.tau

    def impacts(self) -> list[Event]:
        """Return the last impacts."""
        return list(self._impacts)

    def largest(self, since: float) -> float:
        """Return the largest |X| from an instant (s) on, m."""
        turns = list(self._turns)
        within = [x for time, x in turns if time >= since]
        if self._last is not None:
            within.append(abs(self._last.x))
        return max(within, default=0.0)


#: Cycles of the force, the last ones, that are measured where there is no rhythm; so many without
#: an impact make a motion one without impacts.
MEASURED_CYCLES = 20
#: Periods in a row that must differ little for a motion to have settled.
SETTLED_PERIODS = 3
#: Turning points of M are interpolated between samples; with fewer in a cycle they are not good.
LEAST_SAMPLES_PER_CYCLE = 6.0


@dataclass(frozen=True)
class MeasuredMotion:
    """
    How a rig moves.

    Attributes
    ----------
    kind : MotionKind
        `PERIODIC`: settled; `TRANSIENT`: its impacts come to repeat, ever more closely;
        `UNDECIDED`: neither; `NO_IMPACTS`; or `NOT_PERIODICALLY_DRIVEN`, if the force has no
        first harmonic, or a multisine besides.
    cycles : float
        Cycles of the force since the last change or reset.
    impacts_per_cycle : float or None
        Impacts in a cycle of the force, in the last period, or without a rhythm in the last
        `MEASURED_CYCLES` cycles.
    rhythm : Rhythm or None
        What the impacts repeat, settled or not.
    impact : Event or None
        The last impact.
    phase : float
        Its instant in cycles of the force since its zero angle.
    x_max : float or None
        Largest |X| in the same part, m; None if the samples are too few for it.
    amplitude_ratio : float or None
        The same as a share of the amplitude A without impacts.
    """

    kind: MotionKind
    cycles: float = 0.0
    impacts_per_cycle: float | None = None
    rhythm: Rhythm | None = None
    impact: Event | None = None
    phase: float = 0.0
    x_max: float | None = None
    amplitude_ratio: float | None = None

    @property
    def settled(self) -> bool:
        """Whether the motion repeats, but for very little."""
        return self.kind is MotionKind.PERIODIC


def measure(trace: MotionTrace, state_rate: float) -> MeasuredMotion:
    """Say how a rig moves."""
    parameters, frequency, now = trace.parameters, trace.frequency, trace.time
    if not (frequency and parameters.force_amplitudes[0] and not parameters.multisine_level):
        cycle = math.tau / parameters.omega
        recently = trace.largest(now - MEASURED_CYCLES * cycle)
        enough = state_rate * cycle >= LEAST_SAMPLES_PER_CYCLE
        return MeasuredMotion(
            MotionKind.NOT_PERIODICALLY_DRIVEN, x_max=recently if enough else None
        )
    cycle = math.tau / frequency
    cycles = (now - trace.began) / cycle
    impacts = trace.impacts()
    instants = [trace.cycles(event.time) for event in impacts]
    largest = trace.largest(now - LONGEST_RHYTHM * cycle)
    stops, x = [event.stop for event in impacts], [event.x for event in impacts]
    rhythm = rhythm_of(instants, stops, x, largest)
    turned = trace.cycles(now)
    if rhythm is not None and instants[-1] < turned - 2 * rhythm.cycles:
        # The impacts have stopped.
        rhythm = None
    if rhythm is not None:
        distances = period_distances(instants, stops, x, rhythm)
        largest = trace.largest(now - rhythm.cycles * cycle)
        rhythm = replace(rhythm, x_max=largest)
        kind = MotionKind.UNDECIDED
        if max(distances[-SETTLED_PERIODS:], default=math.inf) < SETTLED_DRIFT:
            kind = MotionKind.PERIODIC
        elif approaches(distances):
            kind = MotionKind.TRANSIENT
        per_cycle = rhythm.impacts / rhythm.cycles
    else:
        recent = min(cycles, MEASURED_CYCLES)
        if len(impacts) >= KEPT:
            # Of many impacts in a cycle, those of fewer cycles are kept.
            recent = min(recent, turned - instants[0])
        count = sum(instant > turned - recent for instant in instants)
        without = not count and cycles >= MEASURED_CYCLES
        kind = MotionKind.NO_IMPACTS if without else MotionKind.UNDECIDED
        largest = trace.largest(now - recent * cycle)
        per_cycle = count / recent if recent > 0.0 else 0.0
    x_max = ratio = None
    if state_rate * cycle >= LEAST_SAMPLES_PER_CYCLE:
        x_max = largest
        amplitude = _response_amplitude(parameters, frequency)
        if 0.0 < amplitude < math.inf:
            ratio = x_max / amplitude
    return MeasuredMotion(
        kind,
        cycles,
        per_cycle,
        rhythm,
        impacts[-1] if impacts else None,
        instants[-1] if impacts else 0.0,
        x_max,
        ratio,
    )


def _response_amplitude(parameters: RigParameters, frequency: float) -> float:
    """Return the amplitude A without impacts, also in a sweep, m."""
    if parameters.sweep_mode != 'off':
        others = parameters.force_frequencies[1:]
        parameters = parameters.replace(force_frequencies=(frequency, *others))
    return parameters.response_amplitude
