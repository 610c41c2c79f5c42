"""What a run amounts to: how far M swings, and what the impacts take."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.analysis.swing import Swing
from impact_damper_ros.rig import Event, EventKind, Sample

__all__ = ['Envelope', 'Response']


class Response:
    """
    Largest and mean motion of M, impacts and their energy, from samples in a row.

    Attributes
    ----------
    samples, impacts : int
        How many there were.
    energy : float
        Energy lost in the impacts, J.
    """

    def __init__(self) -> None:
        self.samples = 0
        self.impacts = 0
        self.energy = 0.0
        self._squares = self._covered = 0.0
        # The last instant, X and X' just after it
        self._last: tuple[float, float, float] | None = None
        self._swing = Swing()

    def look(self, sample: Sample, events: Sequence[Event]) -> None:
        """Take the next sample, and the events since the one before."""
        self.samples += 1
        self._swing.look(sample, events)
        for event in events:
            self._reach(event.time, event.x, event.primary_velocity_before)
            self._last = event.time, event.x, event.primary_velocity_after
            if event.kind is EventKind.IMPACT:
                self.impacts += 1
                self.energy += lost_energy(event)
        self._reach(sample.time, sample.x, sample.primary_velocity)
        self._last = sample.time, sample.x, sample.primary_velocity

    def _reach(self, time: float, x: float, velocity: float) -> None:
        """Add the integral of X squared along the cubic from the last instant to this one."""
        if self._last is None or time <= self._last[0]:
            return
        start, x0, velocity0 = self._last
        step = time - start
        u, v = velocity0 * step, velocity * step
        squares = 156.0 * (x0 * x0 + x * x) + 4.0 * (u * u + v * v) + 108.0 * x0 * x
        squares += 44.0 * (x0 * u - x * v) + 26.0 * (x * u - x0 * v) - 6.0 * u * v
        self._squares += squares * step / 420.0
        self._covered += step

    @property
    def largest(self) -> float:
        """Largest |X|, m; also between the samples."""
        return self._swing.largest

    @property
    def rms(self) -> float:
        """Root mean square of X over time, m, also between the samples; NaN without any."""
        return math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan


def lost_energy(event: Event) -> float:
    """
    Return the kinetic energy that an impact takes, J.

    Half the impulse times what the speed of approach is more than that of separation.
    """
    approach = abs(event.damper_velocity_before - event.primary_velocity_before)
    separation = abs(event.damper_velocity_after - event.primary_velocity_after)
    return 0.5 * event.impulse * (approach - separation)


class Envelope:
    """
    A long signal, for a picture: its least and greatest values in stretches of samples.

    Parameters
    ----------
    total : int
        Samples that are to come, about.
    stretches : int
        Into how many stretches they are put, at most.
    """

    def __init__(self, total: int, stretches: int) -> None:
        self._size = max(1, math.ceil(total / stretches))
        self._count = 0
        self._time: list[float] = []
        self._low: list[float] = []
        self._high: list[float] = []

    def look(self, time: float, value: float) -> None:
        """Take the next sample."""
        if self._count % self._size == 0:
            self._time.append(time)
            self._low.append(value)
            self._high.append(value)
        elif value < self._low[-1]:
            self._low[-1] = value
        elif value > self._high[-1]:
            self._high[-1] = value
        self._count += 1

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the times at which the stretches begin, and their least and greatest values."""
        return np.array(self._time), np.array(self._low), np.array(self._high)
