"""
What the controller sees of the rig: samples with noise, and nothing else.

Samples are taken at its own rate, and one more at each passage of X through zero, where the
crossing detector triggers the same converters.

The noise is a pure function of its seed and the index of the sample, so that a run can be cut,
continued and replayed, and any sample be measured anew.
"""

from __future__ import annotations

from math import cos, log, pi, sin, sqrt
from typing import NamedTuple

from impact_damper_ros.rig import Sample

from .parameters import GapControlParameters

__all__ = ['Measurement', 'measured', 'noise']

_WORD = (1 << 64) - 1
_CHANNELS = 4


class Measurement(NamedTuple):
    """
    One sample of the sensors.

    Attributes
    ----------
    time : float
        Its instant, s.
    x, x_rate : float
        X and its rate, m and m/s.
    y, y_rate : float
        Y, the place of m in M, and its rate.
    stop_1, stop_2 : float
        Where the encoders of the actuators say that the stops are, Y in m.
    """

    time: float
    x: float
    x_rate: float
    y: float
    y_rate: float
    stop_1: float
    stop_2: float

    @property
    def z(self) -> float:
        """Z, the absolute place of m, m."""
        return self.x + self.y

    @property
    def z_rate(self) -> float:
        """Its rate, m/s."""
        return self.x_rate + self.y_rate


def _mixed(word: int) -> int:
    """Return 64 bits that depend on all bits of a word (the finaliser of splitmix64)."""
    word = (word + 0x9E3779B97F4A7C15) & _WORD
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & _WORD
    return word ^ (word >> 31)


def _uniform(word: int) -> float:
    """Return a number in (0, 1] from the upper 53 bits."""
    return ((word >> 11) + 1) * 2.0**-53


def noise(seed: int, index: int) -> tuple[float, float, float, float]:
    """
    Return independent standard normal numbers for the channels of one sample.

    Parameters
    ----------
    seed : int
        Which noise.
    index : int
        Which sample.
    """
    key = _mixed(_mixed(seed & _WORD) ^ (index & _WORD))
    values: list[float] = []
    for pair in range(_CHANNELS // 2):
        # Box and Muller (1958)
        radius = sqrt(-2.0 * log(_uniform(_mixed(key + 2 * pair))))
        angle = 2.0 * pi * _uniform(_mixed(key + 2 * pair + 1))
        values += (radius * cos(angle), radius * sin(angle))
    return values[0], values[1], values[2], values[3]


def measured(sample: Sample, index: int, parameters: GapControlParameters) -> Measurement:
    """
    Return what the sensors show.

    Parameters
    ----------
    sample : Sample
        The motion at that instant.
    index : int
        Which sample it is.
    parameters : GapControlParameters
        Noise and its seed.
    """
    x, x_rate = sample.x, sample.primary_velocity
    y, y_rate = sample.z - x, sample.damper_velocity - x_rate
    stop_1, stop_2 = sample.stop_1 - x, sample.stop_2 - x
    position = parameters.gap_control_noise_position
    velocity = parameters.gap_control_noise_velocity
    if position > 0.0 or velocity > 0.0:
        n = noise(parameters.gap_control_seed, index)
        x += position * n[0]
        y += position * n[1]
        x_rate += velocity * n[2]
        y_rate += velocity * n[3]
    return Measurement(sample.time, x, x_rate, y, y_rate, stop_1, stop_2)
