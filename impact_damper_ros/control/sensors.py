# SPDX-License-Identifier: Apache-2.0
"""
Sensors of the gap control: samples with noise and faults, and estimates from them.

Samples are taken at the rate of the control, and one more at each passage of X through zero, where
a zero-crossing detector triggers the same converters. The noise is a function of its seed and the
index of the sample, so that a run can be cut, continued and replayed.

Amplitude, half cycle and impacts are estimated without a model of the structure. The jump of Z' at
an impact is known, which distinguishes an impact from noise.
"""

from __future__ import annotations

from math import atan2, cos, floor, log, nan, pi, sin, sqrt
from typing import NamedTuple

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.parameters.forcing import mix
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS

from .state import Estimates, Measurement

# The constants of SplitMix64 (`rig.forcing.mixed`) as signed numbers of 64 bits
_STEP_64 = 0x9E3779B97F4A7C15 - 2**64
_FACTOR_64 = 0xBF58476D1CE4E5B9 - 2**64
_OTHER_FACTOR_64 = 0x94D049BB133111EB - 2**64
_LOWER_34, _LOWER_37, _LOWER_33 = 2**34 - 1, 2**37 - 1, 2**33 - 1


def _mixed_bits(word: int) -> int:
    """Return the result of `mix` as a signed number; compiled numbers have 64 bits only."""
    word = word + _STEP_64
    word = (word ^ ((word >> 30) & _LOWER_34)) * _FACTOR_64
    word = (word ^ ((word >> 27) & _LOWER_37)) * _OTHER_FACTOR_64
    return word ^ ((word >> 31) & _LOWER_33)


@kernel(twin=_mixed_bits)
def mixed_bits(word: int) -> int:
    """Return 64 bits that depend on all bits of a word."""
    return mix(word)


def mixed_seed(seed: int) -> int:
    """Return 64 bits that depend on all bits of a seed, as a signed number."""
    bits = mix(seed)
    return bits - 2**64 if bits >= 2**63 else bits


_UPPER_53 = 2**53 - 1


@kernel(inline=True)
def uniform_of(word: int) -> float:
    """Return a number in (0, 1] from the upper 53 bits."""
    return (((word >> 11) & _UPPER_53) + 1) * 1.1102230246251565e-16


@kernel
def normal_pair(word: int, other: int) -> tuple[float, float]:
    """Return two independent standard normal numbers: Box and Muller (1958)."""
    radius = sqrt(-2.0 * log(uniform_of(mixed_bits(word))))
    angle = 2.0 * pi * uniform_of(mixed_bits(other))
    return radius * cos(angle), radius * sin(angle)


@kernel
def sensor_noise(
    seed: int, index: int, position: float, velocity: float
) -> tuple[float, float, float, float]:
    """Return the noise on X, Y, X' and Y' of one sample, from the mixed seed; see `mixed_seed`."""
    key = mixed_bits(seed ^ index)
    noise_x = noise_y = noise_x_rate = noise_y_rate = 0.0
    if position > 0.0:
        first, second = normal_pair(key, key + 1)
        noise_x = position * first
        noise_y = position * second
    if velocity > 0.0:
        first, second = normal_pair(key + 2, key + 3)
        noise_x_rate = velocity * first
        noise_y_rate = velocity * second
    return noise_x, noise_y, noise_x_rate, noise_y_rate


#: Number of each fault of the sensors.
SENSOR_FAULTS = {str(n): k for k, n in enumerate(GAP_CONTROL_SPECS['sensor_fault'].choices)}
FROZEN, DROPOUT = SENSOR_FAULTS['frozen'], SENSOR_FAULTS['dropout']
_BIAS, _SPIKE = SENSOR_FAULTS['bias'], SENSOR_FAULTS['spike']


@kernel
def fault_shift(fault: int, seed: int, index: int) -> float:
    """Return by how many sizes of the fault the positions of a sample are off."""
    if fault == _BIAS:
        return 1.0
    if fault != _SPIKE:
        return 0.0
    chance = uniform_of(mixed_bits(mixed_bits(seed ^ index) + 4))
    if chance > 0.1:
        return 0.0
    return 1.0 if chance > 0.05 else -1.0


#: Numbers from here on are whole, 2**52.
_WHOLE = 4503599627370496.0


@kernel(inline=True)
def quantised_value(value: float, step: float) -> float:
    """Return a value in whole steps, or as it is if they are none or finer than its digits."""
    if not step > 0.0:
        return value
    steps = value / step
    return step * floor(steps + 0.5) if abs(steps) < _WHOLE else value


#: Least jump in Z' taken for an impact, over the jump that an impact makes.
_JUMP_OF_AN_IMPACT = 0.3
#: Least such jump, over the standard deviation of the noise on a difference of two samples.
_CLEAR_OF_NOISE = 4.0

#: Time after a passage in which no other passage counts, in half cycles.
_HOLD_OFF = 0.02


class ZeroPassage(NamedTuple):
    """
    Motion expected at the next passage of X through zero.

    Attributes
    ----------
    time : float
        Its instant, s; NaN if no passage is foreseen.
    x_rate : float
        X' there, m/s.
    y, y_rate : float
        Place of m in M and its rate there, without an impact before, m and m/s.
    """

    time: float
    x_rate: float
    y: float
    y_rate: float


@kernel
def clear_estimates(estimates: Estimates) -> None:
    """Put the state back to that at the start."""
    estimates.amplitude = 0.0
    estimates.half_cycle = 0.0
    estimates.crossed = nan
    estimates.peak = 0.0
    estimates.time = nan
    estimates.x = nan
    estimates.x_rate = nan
    estimates.y = nan
    estimates.y_rate = nan
    estimates.stop_1 = nan
    estimates.stop_2 = nan
    estimates.hit_time_1 = nan
    estimates.hit_speed_1 = nan
    estimates.hit_time_2 = nan
    estimates.hit_speed_2 = nan


@kernel
def look_for_impact(
    estimates: Estimates, after: Measurement, damper_jump: float, noise: float
) -> None:
    """Detect an impact between the last sample and one: m reverses in M, and Z' jumps."""
    approach = estimates.y_rate
    rate_before = estimates.x_rate + estimates.y_rate
    rate_after = after.x_rate + after.y_rate
    jump = rate_before - rate_after
    if approach * after.y_rate > 0.0 or approach * jump <= 0.0:
        return
    # Each Z' is a sum of two noisy rates, and a jump a difference of two of them.
    clear = _CLEAR_OF_NOISE * 2.0 * noise
    if abs(jump) < max(_JUMP_OF_AN_IMPACT * damper_jump * abs(approach), clear):
        return
    # Where the straight flights before and after meet
    period = after.time - estimates.time
    since = ((after.x + after.y) - rate_after * period - (estimates.x + estimates.y)) / jump
    instant = estimates.time + min(period, max(0.0, since))
    if approach > 0.0:
        estimates.hit_time_1 = instant
        estimates.hit_speed_1 = abs(approach)
    else:
        estimates.hit_time_2 = instant
        estimates.hit_speed_2 = abs(approach)


@kernel(inline=True)
def observe_sample(
    estimates: Estimates, seen: Measurement, damper_jump: float, noise: float
) -> None:
    """Update the estimates by a sample."""
    if estimates.time == estimates.time:
        look_for_impact(estimates, seen, damper_jump, noise)
    estimates.peak = max(estimates.peak, abs(seen.x))
    estimates.time = seen.time
    estimates.x = seen.x
    estimates.x_rate = seen.x_rate
    estimates.y = seen.y
    estimates.y_rate = seen.y_rate
    estimates.stop_1 = seen.stop_1
    estimates.stop_2 = seen.stop_2


@kernel(inline=True)
def is_too_soon(estimates: Estimates, time: float) -> bool:
    """Return whether a passage comes too soon after the last one to count."""
    return time - estimates.crossed <= _HOLD_OFF * estimates.half_cycle


@kernel
def note_passage(estimates: Estimates, time: float, smoothing: float) -> bool:
    """Update the estimates at a passage of X through zero; return whether a half cycle ends."""
    before = estimates.crossed
    peak = estimates.peak
    estimates.crossed = time
    estimates.peak = 0.0
    if before != before:
        return False
    span = time - before
    weight = smoothing if estimates.half_cycle > 0.0 else 1.0
    estimates.amplitude += weight * (peak - estimates.amplitude)
    estimates.half_cycle += weight * (span - estimates.half_cycle)
    return True


@kernel
def forget_hits(estimates: Estimates) -> None:
    """Begin another half cycle without impacts."""
    estimates.hit_time_1 = nan
    estimates.hit_speed_1 = nan
    estimates.hit_time_2 = nan
    estimates.hit_speed_2 = nan


@kernel
def expected_passage(estimates: Estimates) -> ZeroPassage:
    """
    Return the passage expected from the last sample.

    No passage is foreseen before the half cycle is known, and in its first half, when noise might
    show the last passage as the next one.
    """
    unknown = ZeroPassage(nan, 0.0, 0.0, 0.0)
    if estimates.half_cycle <= 0.0 or estimates.time != estimates.time:
        return unknown
    x = estimates.x
    x_rate = estimates.x_rate
    frequency = pi / estimates.half_cycle
    phase = atan2(frequency * x, x_rate)
    if phase < 0.0:
        phase += pi
    elif phase >= pi:
        phase -= pi
    ahead = (pi - phase) / frequency
    if estimates.time + ahead < estimates.crossed + 0.5 * estimates.half_cycle:
        return unknown
    rate = sqrt(x_rate * x_rate + frequency * x * (frequency * x))
    # X falls through zero if it is positive now.
    if x > 0.0 or (x == 0.0 and x_rate > 0.0):
        rate = -rate
    z_rate = x_rate + estimates.y_rate
    place = x + estimates.y + z_rate * ahead
    return ZeroPassage(estimates.time + ahead, rate, place, z_rate - rate)
