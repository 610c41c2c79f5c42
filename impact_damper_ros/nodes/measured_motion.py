"""The motion of the running rig, as measured since it was last changed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from impact_damper_ros.analysis.motion_kind import MotionKind
from impact_damper_ros.analysis.rhythm import MOST_CYCLES, Rhythm, rhythm_of
from impact_damper_ros.nodes.motion_trace import MotionTrace
from impact_damper_ros.rig import Event, RigParameters

__all__ = ['MeasuredMotion', 'measure']

#: Cycles of the force without a rhythm after which it is no mere transient any more.
UNDECIDED_AFTER = 200
#: Longest stretch in which impacts are counted, where there is no rhythm.
COUNTED_CYCLES = 20
#: Turning points of M are interpolated between samples; with fewer in a cycle they are not good.
LEAST_SAMPLES_PER_CYCLE = 6.0


@dataclass(frozen=True)
class MeasuredMotion:
    """
    How a rig moves.

    Attributes
    ----------
    kind : MotionKind
        `PERIODIC`: settled; `TRANSIENT`: not yet, or so short a time ago that it is not to be
        told; `UNDECIDED`: not periodic after long; `NO_IMPACTS`; or `NOT_PERIODICALLY_DRIVEN`, if
        the force has no first harmonic, or a multisine besides.
    cycles : float
        Cycles of the force since the last change or reset.
    impacts_per_cycle : float or None
        Impacts in a cycle of the force.
    rhythm : Rhythm or None
        What the impacts repeat, settled or not.
    impact : Event or None
        The last impact.
    phase : float
        Its instant in cycles of the force since its zero angle.
    x_max : float or None
        Largest |X| in the last period, or without a rhythm in the last cycles, m; None if the
        samples are too few to tell.
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
        recently = trace.largest(now - MOST_CYCLES * cycle)
        enough = state_rate * cycle >= LEAST_SAMPLES_PER_CYCLE
        return MeasuredMotion(
            MotionKind.NOT_PERIODICALLY_DRIVEN, x_max=recently if enough else None
        )
    cycle = math.tau / frequency
    cycles = (now - trace.began) / cycle
    impacts = trace.impacts()
    instants = [trace.cycles(event.time) for event in impacts]
    largest = trace.largest(now - MOST_CYCLES * cycle)
    rhythm = rhythm_of(
        instants, [event.stop for event in impacts], [event.x for event in impacts], largest
    )
    recent = min(cycles, COUNTED_CYCLES)
    count = sum(instant > trace.cycles(now) - recent for instant in instants)
    if rhythm is not None and instants[-1] < trace.cycles(now) - 2 * rhythm.cycles:
        # The impacts have stopped.
        rhythm = None
    if rhythm is not None:
        largest = trace.largest(now - rhythm.cycles * cycle)
        rhythm = replace(rhythm, x_max=largest)
        kind = MotionKind.PERIODIC if rhythm.settled else MotionKind.TRANSIENT
        per_cycle = rhythm.impacts / rhythm.cycles
    else:
        if not count and cycles >= COUNTED_CYCLES:
            kind = MotionKind.NO_IMPACTS
        elif cycles < UNDECIDED_AFTER:
            kind = MotionKind.TRANSIENT
        else:
            kind = MotionKind.UNDECIDED
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
