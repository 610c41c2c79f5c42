"""A stretch of a recorded run with constant parameters, as arrays, with the phase of its force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from sys import float_info
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.replay.rows import Events, Samples, events_as_rows
from impact_damper_ros.rig import Event, RigParameters, Sample
from impact_damper_ros.rig.parameter_spec import number_between
from impact_damper_ros.rig.snapshot import LATEST

from .result import Array, LoggedStretch, Overall, SwingEnvelope


@dataclass(frozen=True)
class ForceClock:
    """
    The harmonics of a force whose frequencies do not change.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    time : float
        An instant, rig time, s.
    angles : tuple of float
        Angles that the harmonics have turned by then, without their phases, rad.
    """

    parameters: RigParameters
    time: float
    angles: tuple[float, ...]

    def __post_init__(self) -> None:
        number_between('time', self.time, -LATEST, LATEST)
        if not self.angles:
            raise ValueError('angles is empty: give one for each harmonic')
        for angle in self.angles:
            number_between('an entry of angles', angle, -float_info.max, float_info.max)

    @property
    def frequency(self) -> float:
        """Circular frequency of the first harmonic, rad/s."""
        return self.parameters.force_frequencies[0]

    @property
    def cycle(self) -> float:
        """Duration of a cycle of the first harmonic, s."""
        return math.tau / self.frequency

    @property
    def zero(self) -> float:
        """The last instant not after `time` at which the first harmonic's angle was zero, s."""
        return self.time - (self.angles[0] % math.tau) / self.frequency

    def phase(self, time: Array) -> Array:
        """Return the cycles of the first harmonic since `zero`."""
        return (time - self.zero) / self.cycle

    def angles_at(self, time: Array) -> Array:
        """Return the angles of the harmonics, with their phases, rad, shape (harmonics, times)."""
        _, frequencies, phases = (np.array(part) for part in self.parameters.harmonics)
        # Whole turns first, so that a long run loses no digits.
        turned = np.remainder(frequencies[:, None] * (time - self.time), math.tau)
        starts = np.array(self.angles) + phases
        angles: Array = turned + starts[:, None]
        return angles

    def force(self, time: Array) -> Array:
        """Return the force, N."""
        amplitudes = np.array(self.parameters.harmonics[0])
        force: Array = amplitudes @ np.sin(self.angles_at(time))
        return force

    def counted_from_zero(self) -> RigParameters:
        """
        Return the rig with the phases that its harmonics have when the first angle is zero.

        The periodic theory counts time from an instant at which all angles are zero; after a
        change of frequencies on a live rig there may be none. The lines of a multisine, for which
        there is no periodic theory, stay as they are.
        """
        if len(self.parameters.force_phases) == 1:
            return self.parameters
        back = self.zero - self.time
        rig = self.parameters
        phases = [
            math.remainder(phase + angle + frequency * back, math.tau)
            for phase, angle, frequency in zip(
                rig.force_phases, self.angles, rig.force_frequencies, strict=False
            )
        ]
        return rig.replace(force_phases=(rig.force_phases[0], *phases[1:]))


class _Table:
    """Columns of the same length, as attributes."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))  # type: ignore[arg-type]

    def __getitem__(self, rows: slice | NDArray[Any]) -> Self:
        return type(self)(*(getattr(self, f.name)[rows] for f in fields(self)))  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of all parts."""
        if not parts:
            return cls.none()
        names = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        return cls(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))

    @classmethod
    def none(cls) -> Self:
        """Return no rows."""
        return cls(*(np.empty(0) for _ in fields(cls)))  # type: ignore[arg-type]


@dataclass(frozen=True)
class RecordedStates(_Table):
    """Joint states in the order of time, each after any event at its instant."""

    time: Array  # rig time, s
    x: Array  # X, m, from the static equilibrium
    velocity: Array  # X', m/s
    z: Array  # Z, m
    damper_velocity: Array  # Z', m/s
    stop_1: Array  # positions of the stops along the axis, m
    stop_2: Array
    stop_1_velocity: Array  # m/s
    stop_2_velocity: Array

    @classmethod
    def of_samples(cls, samples: Samples) -> Self:
        """Return samples of a simulator."""
        return cls(*(samples[name] for name in Sample._fields))


@dataclass(frozen=True)
class RecordedImpacts(_Table):
    """Impacts in the order of time, as logged."""

    time: Array  # rig time, s, on whole nanoseconds
    stop: Array  # 1 or 2
    x: Array  # X, m
    z: Array  # Z, m
    velocity_after: Array  # X' just after, m/s
    damper_velocity_after: Array  # Z' just after, m/s
    primary_impulse: Array  # on M, along the axis, N s
    damper_impulse: Array  # on m

    @classmethod
    def of_rows(cls, impacts: Events) -> Self:
        """Return impacts of a simulator, their instants not rounded."""
        impulse = np.where(impacts['stop'] == 1, impacts['impulse'], -impacts['impulse'])
        x, after = impacts['x'], impacts['primary_velocity_after']
        damper_after = impacts['damper_velocity_after']
        place = impacts['time'], impacts['stop'].astype(float), x, x + impacts['y']
        return cls(*place, after, damper_after, impulse, -impulse)

    @classmethod
    def of_events(cls, impacts: Sequence[Event]) -> Self:
        """Return impacts of a simulator, their instants not rounded."""
        return cls.of_rows(events_as_rows(impacts))

    def velocity_before(self, parameters: RigParameters) -> Array:
        """Return X' just before, from the impulse and the logged mass, m/s."""
        return self.velocity_after - self.primary_impulse / parameters.primary_mass

    def damper_velocity_before(self, parameters: RigParameters) -> Array:
        """Return Z' just before, from the impulse and the logged mass, m/s."""
        return self.damper_velocity_after - self.damper_impulse / parameters.damper_mass


@dataclass(frozen=True)
class Knots(_Table):
    """Joint states and impacts in the order of time."""

    time: Array  # rig time, s
    stop: Array  # the stop hit, 1 or 2; 0 for joint states
    last_stop: Array  # the stop hit last, this impact included; 0 before the first one
    x: Array  # X, m
    z: Array  # Z, m
    velocity_before: Array  # X' just before and just after, m/s; the same for joint states
    velocity: Array
    damper_velocity_before: Array  # Z' just before and just after, m/s
    damper_velocity: Array
    touched: Array  # 1 where a stop may follow m in contact with it, as far as is recorded

    @property
    def air_direction(self) -> Array:
        """Direction of the air force on m: away from the stop hit last."""
        return np.where(self.last_stop == 1.0, -1.0, np.where(self.last_stop == 2.0, 1.0, 0.0))


_AT_STOP = 1e-9


def knots_of(
    parameters: RigParameters, states: RecordedStates, impacts: RecordedImpacts, last_stop: int
) -> Knots:
    """Sort joint states and impacts by time."""
    zeros = np.zeros(len(states))
    columns = [
        (states.time, impacts.time),
        (zeros, impacts.stop),
        (states.x, impacts.x),
        (states.z, impacts.z),
        (states.velocity, impacts.velocity_before(parameters)),
        (states.velocity, impacts.velocity_after),
        (states.damper_velocity, impacts.damper_velocity_before(parameters)),
        (states.damper_velocity, impacts.damper_velocity_after),
        _touched(states, impacts),
    ]
    time, stop, *others = (np.concatenate(pair) for pair in columns)
    # A joint state shows the motion after an impact at the same instant.
    order = np.lexsort((stop == 0.0, time))
    stop = stop[order]
    latest = np.maximum.accumulate(np.where(stop > 0.0, np.arange(len(stop)), -1))
    last = np.where(latest >= 0, stop[latest], float(last_stop))
    return Knots(time[order], stop, last, *(column[order] for column in others))


def _touched(states: RecordedStates, impacts: RecordedImpacts) -> tuple[Array, Array]:
    with np.errstate(over='ignore', invalid='ignore'):
        near = [
            np.abs(stop - states.z) <= _AT_STOP * (np.abs(stop) + np.abs(states.z))
            for stop in (states.stop_1, states.stop_2)
        ]
        touched = near[0] | near[1]
        # A stop that follows m comes inwards from where the joint states show it first.
        farthest = np.abs((states.z - states.x)[touched]).max(initial=0.0)
        within = np.abs(impacts.z - impacts.x) <= (1.0 + _AT_STOP) * farthest
    return touched.astype(float), within.astype(float)


def largest_size(*columns: Array) -> float:
    """
    Return the largest modulus in some columns, 0 if they are empty.

    A number a thousand times larger than nine tenths of the others counts as a fault, which must
    not determine the tolerance of the others.
    """
    sizes = np.abs(np.concatenate(columns))
    sizes = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    if not len(sizes):
        return 0.0
    most = float(np.quantile(sizes, 0.9, method='lower'))
    return float(sizes[sizes <= 1e3 * most].max())


@dataclass(frozen=True, kw_only=True)
class RecordedStretch(LoggedStretch):
    """A stretch of a run, with its recorded states and impacts."""

    clock: ForceClock | None  # the force; None if its phase is not known
    states: RecordedStates  # the last ones
    impacts: RecordedImpacts  # all; of very many, the first and the last ones
    last_stop: int = 0  # stop hit last before the stretch; 0 for none
    state_count: int  # how many were recorded
    impact_count: int
    missing_states: int = 0
    gaps: tuple[tuple[float, float], ...] = ()  # the first intervals without samples, s
    envelope: SwingEnvelope
    overall: Overall | None = None
    #: State of the rig at the end; empty if it was not replayed.
    at_end: Mapping[str, Any] = field(default_factory=dict)
    last: bool = False  # whether the run ends with it

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.end - self.start

    @property
    def controlled(self) -> bool:
        """Whether a control may move the stops."""
        return bool(self.control.get('gap_control', 'off') != 'off')

    def stop_before(self, time: float) -> int:
        """Return the stop hit last before an instant; 0 for none."""
        before = int(np.searchsorted(self.impacts.time, time))
        return int(self.impacts.stop[before - 1]) if before else self.last_stop

    def knots(self, start: float, end: float) -> Knots:
        """Return the kept joint states and impacts from one instant to another."""
        states, impacts = self.states, self.impacts
        if len(states):
            start = max(start, float(states.time[0]))
        states = states[(states.time >= start) & (states.time <= end)]
        impacts = impacts[(impacts.time >= start) & (impacts.time <= end)]
        return knots_of(self.parameters, states, impacts, self.stop_before(start))
