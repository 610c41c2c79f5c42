"""The motion of the running rig, as measured since it was last changed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from impact_damper_ros.analysis.motion_kind import MotionKind
from impact_damper_ros.analysis.rhythm import (
    MOST_CYCLES,
    SETTLED,
    Rhythm,
    approaches,
    period_distances,
    rhythm_of,
)
from impact_damper_ros.nodes.motion_trace import KEPT, MotionTrace
from impact_damper_ros.rig import Event, RigParameters

__all__ = ['MeasuredMotion', 'measure']

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
    """
    Say how a rig moves.

    Parameters
    ----------
    trace : MotionTrace
        What the engine has noted.
    state_rate : float
        Samples per second of rig time.
    """
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
    largest = trace.largest(now - MOST_CYCLES * cycle)
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
        if max(distances[-SETTLED_PERIODS:], default=math.inf) < SETTLED:
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
