"""The phase of the force: as a clock, and found from a recorded motion that lacks it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from sys import float_info

import numpy as np

from impact_damper_ros.replay.rows import Samples
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.parameter_spec import number_between
from impact_damper_ros.rig.snapshot import LATEST

from .result import Array


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


_MOST_SAMPLES = 4000
#: Share of the impulses that the force may leave unexplained, and of the modulus of each phase.
_LEFT, _MODULUS = 1e-2, 0.5


def fitted_clock(rig: RigParameters, samples: Samples) -> ForceClock | None:
    """
    Find the phase of a force of one harmonic from samples; None if it does not explain them.

    The impulse of the force in an interval is what the momentum of M and m together gains, beside
    what spring, dashpot and weight take. Impacts, friction and air are forces between the two and
    drop out. It is linear in sine and cosine of the phase, which are found by least squares.
    """
    samples = samples[:_MOST_SAMPLES]
    if len(samples) < 4 or not rig.periodic_force or len(rig.force_phases) > 1:
        return None
    x, velocity = samples['x'], samples['primary_velocity']
    start, step = float(samples['time'][0]), np.diff(samples['time'])
    momentum = rig.primary_mass * velocity + rig.damper_mass * samples['damper_velocity']
    weight = rig.damper_mass * rig.gravity * math.sin(rig.angle)
    # The integral of the cubic through both ends
    mean = 0.5 * (x[1:] + x[:-1]) - step / 12.0 * np.diff(velocity)
    impulse = np.diff(momentum) + rig.damping * np.diff(x)
    impulse += (rig.stiffness * mean - weight) * step
    amplitude, frequency, phase = (part[0] for part in rig.harmonics)
    angle = frequency * (samples['time'] - start) + phase
    parts = np.stack(
        [-amplitude / frequency * np.diff(np.cos(angle + turn)) for turn in (0.0, 0.5 * math.pi)]
    )
    found, *_ = np.linalg.lstsq(parts.T, impulse, rcond=None)
    cosine, sine = found.tolist()
    left = impulse - found @ parts
    explained = float(np.linalg.norm(left)) < _LEFT * float(np.linalg.norm(impulse))
    if not explained or abs(math.hypot(sine, cosine) - 1.0) > _MODULUS:
        return None
    return ForceClock(rig, start, (math.atan2(sine, cosine),))
