# SPDX-License-Identifier: Apache-2.0
"""
The result of comparing a recorded run with theory.

A run is cut into stretches where its parameters change and where it is reset. Each stretch is
measured, classified and compared on its own. Times are rig time in s, phases are in cycles of the
first harmonic of the force, all else is in SI units. Velocities are absolute unless they are
called relative.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.orbits.ring_down import RingDown
from impact_damper_ros.orbits.swept_response import SweptResponse
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay.findings import Difference
from impact_damper_ros.replay.rows import Events

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ImpactStates:
    """The impacts of one period, in order."""

    #: The stops hit, 1 (the lower one) or 2.
    stops: tuple[int, ...]
    #: Instants in cycles of the force since its zero angle, the first in [0, 1), all in [0,
    #: k).
    phases: tuple[float, ...]
    #: X, m.
    x: tuple[float, ...]
    #: X' just before and just after, m/s.
    primary_velocity_before: tuple[float, ...]
    primary_velocity_after: tuple[float, ...]
    #: Z' just before and just after, m/s.
    damper_velocity_before: tuple[float, ...]
    damper_velocity_after: tuple[float, ...]
    #: Moduli of the impulses, N s.
    impulse: tuple[float, ...]


@dataclass(frozen=True)
class SteadyPart:
    """The steady part of a stretch or, if the motion does not settle, its second half."""

    #: The part measured, s.
    start: float
    end: float
    #: Largest |X| and root mean square of X, m.
    x_max: float
    x_rms: float
    #: x_max over the amplitude A without impacts; NaN if A is not defined.
    x_max_ratio: float
    #: Number of impacts.
    impacts: int
    #: Number of impacts per cycle of the force; NaN without a force.
    impacts_per_cycle: float
    #: Largest and mean impulse of the impacts, N s; 0 without any.
    mean_impulse: float
    largest_impulse: float
    #: The last whole period of a periodic or settling motion.
    last_period: ImpactStates | None = None
    #: Transmissibilities of a rig whose base moves; NaN for a base at rest.
    transmissibility: Transmissibility = field(default_factory=Transmissibility)

    def as_dict(self) -> dict[str, Any]:
        """Return all fields by name, each transmissibility as one entry."""
        values = dict(vars(self))
        shaken: Transmissibility = values.pop('transmissibility')
        return values | shaken.by_name()


@dataclass(frozen=True, kw_only=True)
class Overall:
    """Largest |X|, impacts and energy over a whole stretch or run, whatever the motion; exact."""

    #: Length, s.
    duration: float
    #: Largest |X|, also between the samples, m; X from the static equilibrium of M.
    x_max: float
    #: Root mean square of X, m; the mean of X is not subtracted.
    x_rms: float
    #: Number of recorded impacts.
    impacts: int
    impacts_on_stop_1: int
    impacts_on_stop_2: int
    #: Kinetic energy that M lost in the impacts, J. Contact with a resting m is no impact.
    impact_energy: float
    #: Kinetic energy that M and m together lost in the impacts, J; m received the remainder of
    #: `impact_energy`.
    impact_loss: float
    #: Energy that the dashpot between M and the base dissipated, J.
    dashpot_energy: float
    #: Work of the force on M, and of a moving base, J.
    force_work: float
    #: The part of `force_work` that the active force of a controller did, J.
    active_work: float
    #: Energy that the actuators of the stops spent, J.
    actuator_energy: float
    #: Sum and largest of the impulses of the impacts, N s.
    total_impulse: float
    largest_impulse: float

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the values over several stretches: sums, the largest |X|, the common rms."""
        # Unknown values of a stretch are left out.
        known = [part for part in parts if not math.isnan(part.x_rms)]
        duration = sum(part.duration for part in known)
        squares = sum(part.x_rms**2 * part.duration for part in known)
        joined: dict[str, Any] = {
            f.name: math.fsum(getattr(part, f.name) for part in parts)
            for f in fields(cls)
            if f.type == 'float'
        }
        for name in ('x_max', 'largest_impulse'):
            values = [getattr(part, name) for part in parts]
            joined[name] = max([v for v in values if not math.isnan(v)], default=math.nan)
        joined['x_rms'] = math.sqrt(squares / duration) if duration > 0.0 else math.nan
        counts = ('impacts', 'impacts_on_stop_1', 'impacts_on_stop_2')
        return cls(**joined, **{n: sum(getattr(part, n) for part in parts) for n in counts})


@dataclass(frozen=True)
class EnergyBalance:
    """Energy, J: force + air = dashpot + friction + impacts + stored + residual."""

    #: Rig time, s.
    start: float
    end: float
    #: Whole periods between these times; cycles of the force if the motion is not periodic.
    periods: int
    #: Work of the force on M and of a moving base, and of the compressed air on both masses.
    force: float
    air: float
    #: Energy lost in each; the bounces that end a chatter count as impacts.
    dashpot: float
    friction: float
    impacts: float
    #: Change of kinetic and potential energy.
    stored: float
    #: The unexplained remainder.
    residual: float
    #: Largest residual that round-off explains.
    tolerance: float


@dataclass(frozen=True)
class Decay:
    """The approach to the periodic motion."""

    #: Factor by which the distance shrinks in a period; NaN if it could not be measured.
    measured: float
    #: Largest modulus of the multipliers; NaN without a prediction.
    predicted: float
    #: Number of periods on which the factor was measured.
    periods: int
    #: Distance from the periodic motion at the end, relative.
    distance: float
    #: Smallest distance that the digits of the instants resolve.
    floor: float


class Beginning(Enum):
    """Why a stretch begins."""

    START = 'start'
    CHANGE = 'change'
    RESET = 'reset'
    RESUME = 'resume'


class Verdict(Enum):
    """How a stretch compares with theory."""

    AGREES = 'agrees'
    NOT_SETTLED = 'not settled yet'
    DIFFERS = 'differs'
    #: The predicted motion is not stable, so that the rig leaves it.
    PREDICTED_UNSTABLE = 'predicted unstable'
    NO_PREDICTION = 'no prediction'
    #: The frequency of the force is swept: the response over frequency is the result.
    SWEPT = 'swept'
    #: The recording is too short.
    TOO_SHORT = 'too short'


class LogVerdict(Enum):
    """Whether the log of a stretch is that of its rig."""

    #: Every number equals that of the replay, to the last bit or, on another machine, within
    #: round-off.
    REPRODUCED = 'reproduced'
    DIFFERS = 'differs'


@dataclass(frozen=True)
class MotionCurve:
    """The motion in detail, with both sides of each event."""

    #: Instants, s, not falling, shape (n,). Each event stands there twice, just before and after.
    time: Array
    #: X in m, and X' in m/s, shape (n,).
    x: Array
    velocity: Array
    #: Y = Z - X in m, and Y' in m/s, shape (n,).
    y: Array
    relative_velocity: Array
    #: Positions of the stops relative to M, m; NaN if there is no stop 2, shape (n,).
    stop_1: Array
    stop_2: Array


@dataclass(frozen=True)
class PredictedCurve:
    """One period of the predicted motion, beginning just after its first impact."""

    #: Cycles of the force since its zero angle, not falling, shape (n,); each impact twice.
    phase: Array
    #: As of `MotionCurve`, shape (n,).
    x: Array
    velocity: Array
    y: Array
    relative_velocity: Array
    #: A rig time, s, at which the force's angle is zero: phase p is at force_zero + p cycles.
    force_zero: float
    cycle: float  # duration of a cycle of the force, s
    cycles: int  # cycles k in a period


@dataclass(frozen=True)
class Convergence:
    """The approach of the recorded motion to the periodic one, period by period."""

    time: Array  # beginning of each period, s, shape (n,)
    #: Largest difference of a displacement, velocity or instant of its impacts from the periodic
    #: motion, each relative to its size, shape (n,).
    distance: Array
    first: int  # first of the periods on which the decay was measured
    decay: Decay


@dataclass(frozen=True)
class Spectrum:
    """Amplitude spectrum of X, of the end of a stretch."""

    frequency: Array  # Hz, shape (n,)
    amplitude: Array  # of X, m, shape (n,)
    force_frequency: float  # of the force's first harmonic, Hz
    resolution: float  # width of a line, Hz
    window: str  # name of the window


@dataclass(frozen=True)
class StretchCurves:
    """The arrays of one stretch for plots, of bounded size; None where one does not apply."""

    #: X over the whole stretch, shape (3, n): beginnings of consecutive pieces, s, and least and
    #: greatest sampled X in each, m.
    envelope: Array | None = None
    #: The end of the stretch in detail: the last periods, or the last cycles of the force.
    motion: MotionCurve | None = None
    #: The latest impacts, rows of EVENT_TYPE; their phases in cycles, in [0, 1), if known.
    impacts: Events | None = None
    phases: Array | None = None
    predicted: PredictedCurve | None = None  # one period of the predicted motion
    convergence: Convergence | None = None  # the approach to the periodic motion
    spectrum: Spectrum | None = None
    #: Xmax/A against the gap, as of `theory.GapCurve.message`; only of a report.
    gap_curve: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class LoggedStretch:
    """A stretch of a run between two cuts, with constant parameters."""

    number: int  # counted from 1
    #: Rig time, s.
    start: float
    end: float
    begins: Beginning
    cause: str  # why the stretch begins, in words, such as 'gap = 0.012 m (was 0.01 m)'
    parameters: RigParameters  # parameters of the rig as logged
    #: Parameters of the gap control as logged.
    control: Mapping[str, Any] = field(default_factory=dict)

    @property
    def recorded_part(self) -> LoggedStretch:
        """The part of a comparison that is the stretch alone."""
        return LoggedStretch(**{f.name: getattr(self, f.name) for f in fields(LoggedStretch)})

    @property
    def values(self) -> dict[str, Any]:
        """All parameters by name."""
        return {**self.parameters.as_dict(), **self.control}


@dataclass(frozen=True, kw_only=True)
class StretchComparison(LoggedStretch):
    """One stretch of a run compared with theory."""

    #: Numbers of recorded joint states and impacts, and of missing joint states.
    samples: int
    impacts: int
    missing_samples: int = 0
    #: The kind of the motion.
    kind: MotionKind
    #: The numbers that show the kind, as a sentence.
    evidence: str
    #: The same numbers by name.
    measures: Mapping[str, float] = field(default_factory=dict)
    #: Period k in cycles of the force; 0 if the motion is not periodic.
    cycles: int = 0
    #: Rig time from which the motion is steady, s; None if it does not become steady.
    settled_at: float | None = None
    #: Largest |X|, impacts and energy over the whole stretch.
    overall: Overall | None = None
    #: The steady part.
    measured: SteadyPart | None = None
    #: The periodic motion predicted for the logged parameters, the nearest to the measured
    #: one, beginning at the same impact as `measured.last_period`.
    predicted: PeriodicOrbit | None = None
    #: Impulses of the predicted motion, N s.
    predicted_impulse: tuple[float, ...] = ()
    #: The method that found the prediction, or why there is none.
    solver: str = ''
    #: Balance of energy over whole periods.
    energy: EnergyBalance | None = None
    #: Decay into the steady state.
    decay: Decay | None = None
    #: Ring-down of a rig without force on a base at rest: the loss of each cycle.
    ring_down: RingDown | None = None
    #: Response, at each step, of a rig whose force or base is swept.
    response: SweptResponse | None = None
    #: The verdict of the comparison with theory.
    verdict: Verdict
    #: The verdict in words, with numbers.
    sentence: str
    #: Whether the log equals the replay, whatever theory says.
    log: LogVerdict = LogVerdict.REPRODUCED
    #: Differences between log and replay, the earliest first.
    differences: tuple[Difference, ...] = ()
    #: Arrays for plots.
    curves: StretchCurves = field(default_factory=StretchCurves)

    def __repr__(self) -> str:
        """Return extent, motion and verdict in a line."""
        return (
            f'<StretchComparison {self.number}: {self.start:.6g} to {self.end:.6g} s, '
            f'{self.kind.value}, {self.verdict.value}>'
        )

    @property
    def stops(self) -> tuple[int, ...]:
        """Stops hit in a measured period; empty if the motion is not periodic."""
        if self.measured is None or self.measured.last_period is None:
            return ()
        return self.measured.last_period.stops

    @property
    def impacts_per_period(self) -> int:
        """Number N of impacts in a measured period."""
        return len(self.stops)


@dataclass(frozen=True)
class LogCheck:
    """How the numbers of a log were checked."""

    #: What was checked, in words.
    text: str
    #: Number of values and messages that differ from the replay.
    differences: int = 0
    #: Topics and parameters that were not checked.
    unchecked: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunComparison:
    """A recorded run compared with theory."""

    #: The recording, and the node that was recorded.
    bag: str
    node: str
    #: Version of this package.
    version: str
    #: Whether the bag was finished and no part of it is missing.
    complete: bool
    #: Number of the run, and of all runs of the rig in the recording.
    run: int = 1
    run_count: int = 1
    #: Rig times of the first and last sample, s.
    start: float
    end: float
    #: Numbers of joint states and of impacts.
    samples: int
    impacts: int
    #: The stretches in order.
    stretches: tuple[StretchComparison, ...]
    #: How the numbers were checked.
    log: LogCheck = field(default_factory=lambda: LogCheck('not checked'))
    #: Why the bag could be used in part only.
    faults: tuple[str, ...] = ()
    #: Other facts about the recording.
    remarks: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return recording and verdicts in a line."""
        verdicts = ', '.join(stretch.verdict.value for stretch in self.stretches[:6])
        more = ', ...' * (len(self.stretches) > 6)
        return f'<RunComparison of {self.bag}: {verdicts}{more}; log {self.log.text}>'

    @property
    def exit_code(self) -> int:
        """0: nothing differs; 1: log or theory differs; 3: neither, but the bag is incomplete."""
        if self.log.differences or any(s.verdict is Verdict.DIFFERS for s in self.stretches):
            return 1
        return 3 if self.faults else 0

    @property
    def overall(self) -> Overall | None:
        """Largest |X|, impacts and energy over all stretches; None if no stretch has them."""
        parts = [s.overall for s in self.stretches if s.overall is not None]
        return Overall.join(parts) if parts else None

    def as_dict(self) -> dict[str, Any]:
        """Return all but the curves in types of JSON; numbers that are not finite become None."""
        plain: dict[str, Any] = as_plain(vars(self), without=('curves',))
        return {**plain, 'overall': as_plain(self.overall), 'exit_code': self.exit_code}
