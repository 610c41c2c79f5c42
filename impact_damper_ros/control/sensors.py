"""
Sensors of the gap control: samples with noise, and the observer of amplitude, rhythm and impacts.

Samples are taken at the rate of the control, and one more at each passage of X through zero, where
the crossing detector triggers the same converters. The noise is a function of its seed and the
index of the sample, so that a run can be cut, continued and replayed.

The observer has no model of the structure. Of the damper it knows how m rebounds, to distinguish
an impact from noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import atan2, cos, hypot, log, pi, sin, sqrt
from typing import ClassVar, NamedTuple, TypeAlias

from impact_damper_ros.rig import GapControlParameters, Sample
from impact_damper_ros.rig.forcing import mixed

_CHANNELS = 4

LENGTH, SPEED, TIME = 'length', 'speed', 'time'
#: What the numbers of a state are, by field; of a list by its index, where its entries differ.
Kinds: TypeAlias = dict[str, str | tuple[str, ...]]


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
        Positions of the stops from the encoders of the actuators, Y in m.
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
        """Absolute position Z of m, m."""
        return self.x + self.y

    @property
    def z_rate(self) -> float:
        """Its rate, m/s."""
        return self.x_rate + self.y_rate


def _uniform(word: int) -> float:
    """Return a number in (0, 1] from the upper 53 bits."""
    return ((word >> 11) + 1) * 2.0**-53


def noise(seed: int, index: int) -> tuple[float, float, float, float]:
    """Return independent standard normal numbers for the channels of one sample."""
    key = mixed(mixed(seed) ^ (index & (2**64 - 1)))
    values: list[float] = []
    for pair in range(_CHANNELS // 2):
        # Box and Muller (1958)
        radius = sqrt(-2.0 * log(_uniform(mixed(key + 2 * pair))))
        angle = 2.0 * pi * _uniform(mixed(key + 2 * pair + 1))
        values += (radius * cos(angle), radius * sin(angle))
    return values[0], values[1], values[2], values[3]


def measured(sample: Sample, index: int, parameters: GapControlParameters) -> Measurement:
    """Return a sample with the noise of the sensors."""
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


#: Least jump in Z' taken for an impact, over the jump that an impact makes.
_JUMP_OF_AN_IMPACT = 0.3
#: ... and over the standard deviation of the noise on a difference of two samples.
_CLEAR_OF_NOISE = 4.0

#: Time after a trigger without another one, in half cycles.
_HOLD_OFF = 0.02


class Hit(NamedTuple):
    """An impact between two samples: instant and approach speed."""

    time: float
    speed: float


class Passage(NamedTuple):
    """
    Motion expected at the next passage of X through zero.

    Attributes
    ----------
    time : float
        Its instant, s.
    x_rate : float
        X' there, m/s.
    y, y_rate : float
        Place of m in M and its rate there, without an impact before, m and m/s.
    """

    time: float
    x_rate: float
    y: float
    y_rate: float


@dataclass(slots=True)
class Observer:
    """
    Estimates from the samples so far; every field goes through JSON.

    Attributes
    ----------
    amplitude : float
        Smoothed amplitude of X, m; 0 before the first whole half cycle.
    half_cycle : float
        Smoothed time from one passage of X through zero to the next, s; 0 if unknown.
    crossed : float or None
        Instant of the last passage.
    peak : float
        Largest |X| sampled since then.
    last : list of float
        The last sample.
    hit_1, hit_2 : list of float
        The last impact at each stop since the last passage, as a `Hit`; empty if there was none.
    """

    KINDS: ClassVar[Kinds] = {
        'amplitude': LENGTH,
        'half_cycle': TIME,
        'crossed': TIME,
        'peak': LENGTH,
        'last': (TIME, LENGTH, SPEED, LENGTH, SPEED, LENGTH, LENGTH),
        'hit_1': (TIME, SPEED),
        'hit_2': (TIME, SPEED),
    }

    amplitude: float = 0.0
    half_cycle: float = 0.0
    crossed: float | None = None
    peak: float = 0.0
    last: list[float] = field(default_factory=list)
    hit_1: list[float] = field(default_factory=list)
    hit_2: list[float] = field(default_factory=list)

    def see(self, sample: Measurement, rebound: float, noise: float) -> None:
        """Take a sample."""
        if self.last:
            self._look_for_impact(Measurement(*self.last), sample, rebound, noise)
        self.peak = max(self.peak, abs(sample.x))
        self.last = list(sample)

    def _look_for_impact(
        self, before: Measurement, after: Measurement, rebound: float, noise: float
    ) -> None:
        """Detect an impact between two samples: m reverses in M, and Z' jumps."""
        approach = before.y_rate
        jump = before.z_rate - after.z_rate
        if approach * after.y_rate > 0.0 or approach * jump <= 0.0:
            return
        # Each Z' is a sum of two noisy rates, and a jump a difference of two of them.
        clear = _CLEAR_OF_NOISE * 2.0 * noise
        if abs(jump) < max(_JUMP_OF_AN_IMPACT * rebound * abs(approach), clear):
            return
        # Where the straight flights before and after meet
        period = after.time - before.time
        since = (after.z - after.z_rate * period - before.z) / jump
        hit = [before.time + min(period, max(0.0, since)), abs(approach)]
        if approach > 0.0:
            self.hit_1 = hit
        else:
            self.hit_2 = hit

    def holds_off(self, time: float) -> bool:
        """Return whether a trigger comes too soon after the last one to count."""
        return self.crossed is not None and time - self.crossed <= _HOLD_OFF * self.half_cycle

    def cross(self, time: float, smoothing: float) -> bool:
        """Take the trigger of the crossing detector."""
        before, self.crossed = self.crossed, time
        peak, self.peak = self.peak, 0.0
        if before is None:
            return False
        span = time - before
        self.amplitude += smoothing * (peak - self.amplitude)
        self.half_cycle += (smoothing if self.half_cycle > 0.0 else 1.0) * (span - self.half_cycle)
        return True

    def forget_hits(self) -> None:
        """Begin another half cycle without impacts."""
        self.hit_1 = []
        self.hit_2 = []

    def next_passage(self) -> Passage | None:
        """
        Return the passage expected from the last sample.

        None before the half cycle is known, and in its first half, when noise might show the last
        passage as one to come.
        """
        if not self.last or self.half_cycle <= 0.0 or self.crossed is None:
            return None
        now = Measurement(*self.last)
        frequency = pi / self.half_cycle
        phase = atan2(frequency * now.x, now.x_rate) % pi
        ahead = (pi - phase) / frequency
        if now.time + ahead < self.crossed + 0.5 * self.half_cycle:
            return None
        rate = hypot(now.x_rate, frequency * now.x)
        # X falls through zero if it is positive now.
        x_rate = -rate if now.x > 0.0 or (now.x == 0.0 and now.x_rate > 0.0) else rate
        place = now.z + now.z_rate * ahead
        return Passage(now.time + ahead, x_rate, place, now.z_rate - x_rate)
