"""A stretch in which m hits no stop: M is a driven oscillator, with or without m on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .force_clock import ForceClock
from .recorded_stretch import RecordedStates
from .recurrence import SETTLED

__all__ = ['Oscillation', 'oscillation']


@dataclass(frozen=True)
class Oscillation:
    """
    The steady vibration that theory has without impacts, and how far the run is from it.

    Attributes
    ----------
    x_max : float
        Largest |X| of it, m.
    joined : bool
        Whether m moves with M.
    distance : float
        Amplitude of the free vibration that is left, relative to it.
    """

    x_max: float
    joined: bool
    distance: float

    @property
    def settled(self) -> bool:
        """Whether next to nothing is left of the free vibration."""
        return self.distance <= SETTLED


def oscillation(clock: ForceClock, states: RecordedStates) -> Oscillation | None:
    """
    Hold the last joint state against the steady vibration.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    states : RecordedStates
        Joint states without an impact among them.

    Returns
    -------
    Oscillation or None
        None if m slides, or the rig is undamped and driven at resonance.
    """
    rig = clock.parameters
    still = states.damper_velocity == states.velocity
    joined = bool(still.all())
    if not joined and rig.friction * rig.gravity > 0.0:
        return None
    mass = rig.primary_mass + (rig.damper_mass if joined else 0.0)
    constant = 0.0
    if joined:
        constant = rig.damper_mass * rig.gravity * math.sin(rig.angle) / rig.stiffness
    time = states.time[-1:]
    angles = clock.angles_at(time)[:, 0]
    frequencies = np.array(rig.force_frequencies)
    stiffness = rig.stiffness - mass * frequencies**2 + 1j * rig.damping * frequencies
    amplitudes = np.array(rig.force_amplitudes)
    active = amplitudes != 0.0
    if (stiffness[active] == 0.0).any():
        return None
    response = amplitudes[active] / stiffness[active]
    turning = response * np.exp(1j * angles[active])
    x = constant + float(turning.imag.sum())
    velocity = float((1j * frequencies[active] * turning).imag.sum())
    omega = math.sqrt(rig.stiffness / mass)
    left = math.hypot(float(states.x[-1]) - x, (float(states.velocity[-1]) - velocity) / omega)
    swing = float(np.abs(response).sum())
    # Of several harmonics the sum is a bound; of one it is the amplitude.
    x_max = swing + abs(constant)
    return Oscillation(x_max, joined, left / x_max if x_max > 0.0 else math.inf)
