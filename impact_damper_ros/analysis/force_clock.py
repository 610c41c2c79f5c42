"""The force's phase at any instant of a recorded stretch, and the rig counted from its zero."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from impact_damper_ros.rig import RigParameters

from .run_curves import Array

__all__ = ['ForceClock']


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
