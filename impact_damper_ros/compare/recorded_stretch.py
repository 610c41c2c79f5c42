"""A stretch of a recorded run with constant parameters, as arrays, with the phase of its force."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import Event, RigParameters

from .run_comparison import Beginning, Overall
from .run_curves import Array, SwingEnvelope

__all__ = ['ForceClock', 'RecordedImpacts', 'RecordedStates', 'RecordedStretch', 'Rows']


@dataclass(frozen=True)
class ForceClock:
    """
    The harmonics of a force whose frequencies do not change.

    Attributes
    ----------
    parameters : RigParameters
        The rig, as logged.
    time : float
        An instant, rig time, s.
    angles : tuple of float
        Angle that each harmonic has turned by then, without its phase, rad.
    """

    parameters: RigParameters
    time: float
    angles: tuple[float, ...]

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
        Return the same rig with the phases that the harmonics have when the first angle is zero.

        The periodic theory counts time from an instant at which all harmonics have turned by
        nothing; after a change of frequencies on a live rig there may be no such instant. The
        lines of a multisine, which has no theory, are left as they are.
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


class Rows:
    """Columns of the same length, as attributes."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))  # type: ignore[arg-type]

    def __getitem__(self, rows: slice | NDArray[Any]) -> Self:
        """Return some of the rows."""
        return type(self)(*(getattr(self, f.name)[rows] for f in fields(self)))  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: list[Self]) -> Self:
        """Return the rows of several in a row."""
        if not parts:
            return cls.none()
        names = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        return cls(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))

    @classmethod
    def none(cls) -> Self:
        """Return no rows."""
        return cls(*(np.empty(0) for _ in fields(cls)))  # type: ignore[arg-type]


@dataclass(frozen=True)
class RecordedStates(Rows):
    """
    Joint states, each after any event at its instant.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Rig time, s, rising.
    x, velocity : ndarray of shape (n,)
        X, m, and X', m/s.
    z, damper_velocity : ndarray of shape (n,)
        Z, m, and Z', m/s.
    stop_1, stop_2 : ndarray of shape (n,)
        Positions of the stops along the axis, m.
    stop_1_velocity, stop_2_velocity : ndarray of shape (n,)
        Their velocities, m/s.
    """

    time: Array
    x: Array
    velocity: Array
    z: Array
    damper_velocity: Array
    stop_1: Array
    stop_2: Array
    stop_1_velocity: Array
    stop_2_velocity: Array


@dataclass(frozen=True)
class RecordedImpacts(Rows):
    """
    Impacts, as logged.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Rig time, s, on whole nanoseconds; rising.
    stop : ndarray of shape (n,)
        1 or 2.
    x, z : ndarray of shape (n,)
        X and Z, m.
    velocity_after, damper_velocity_after : ndarray of shape (n,)
        X' and Z' just after, m/s.
    primary_impulse, damper_impulse : ndarray of shape (n,)
        Impulse on M and on m along the axis, N s.
    """

    time: Array
    stop: Array
    x: Array
    z: Array
    velocity_after: Array
    damper_velocity_after: Array
    primary_impulse: Array
    damper_impulse: Array

    @classmethod
    def of_events(cls, impacts: Sequence[Event]) -> Self:
        """Return impacts of a simulator, their instants as they are."""
        if not impacts:
            return cls.none()
        sign = [1.0 if event.stop == 1 else -1.0 for event in impacts]
        rows = [
            (
                event.time,
                float(event.stop),
                event.x,
                event.x + event.y,
                event.primary_velocity_after,
                event.damper_velocity_after,
                way * event.impulse,
                -way * event.impulse,
            )
            for event, way in zip(impacts, sign, strict=True)
        ]
        return cls(*np.array(rows).T)

    def velocity_before(self, parameters: RigParameters) -> Array:
        """Return X' just before, by the impulse and the logged mass, m/s."""
        return self.velocity_after - self.primary_impulse / parameters.primary_mass

    def damper_velocity_before(self, parameters: RigParameters) -> Array:
        """Return Z' just before, by the impulse and the logged mass, m/s."""
        return self.damper_velocity_after - self.damper_impulse / parameters.damper_mass


@dataclass(frozen=True, kw_only=True)
class RecordedStretch:
    """
    A stretch between two cuts.

    Attributes
    ----------
    number : int
        Counted from 1.
    start, end : float
        Rig time, s.
    begins, cause : Beginning, str
        Why it begins, and the same in words.
    parameters : RigParameters
        As logged.
    control : mapping of str to value
        Gap-control parameters as logged.
    clock : ForceClock or None
        The force; None if its phase is not known.
    states : RecordedStates
        The last ones.
    impacts : RecordedImpacts
        All of them; of very many, the first and the last ones (`skipped` in between).
    last_stop : int
        Stop hit last before the stretch; 0 for none.
    skipped : int
        Index of the first impact after those left out; 0 if none were.
    state_count, impact_count, missing_states : int
        How many were recorded, and how many samples are missing.
    lossy : bool
        Whether the recorder may have lost messages one by one, unnoticed.
    gaps : tuple of (float, float)
        Beginnings and ends of the stretches without samples, s; the first ones.
    envelope : SwingEnvelope
        X over the whole stretch.
    overall : Overall or None
        Swing, impacts and energy over the whole stretch.
    """

    number: int
    start: float
    end: float
    begins: Beginning
    cause: str
    parameters: RigParameters
    control: Mapping[str, Any] = field(default_factory=dict)
    clock: ForceClock | None
    states: RecordedStates
    impacts: RecordedImpacts
    last_stop: int = 0
    skipped: int = 0
    state_count: int
    impact_count: int
    missing_states: int = 0
    lossy: bool = False
    gaps: tuple[tuple[float, float], ...] = ()
    envelope: SwingEnvelope
    overall: Overall | None = None

    def excuses(self, time: float) -> bool:
        """Return whether the recorder may have lost an impact at an instant."""
        return self.lossy or any(start <= time <= end for start, end in self.gaps)

    def stop_before(self, time: float) -> int:
        """Return the stop hit last before an instant; 0 for none."""
        before = int(np.searchsorted(self.impacts.time, time))
        return int(self.impacts.stop[before - 1]) if before else self.last_stop

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.end - self.start
