# SPDX-License-Identifier: Apache-2.0
"""Waves: sine and cosine of each harmonic of the force, and the acceleration that they make."""

from __future__ import annotations

from math import cos, floor, sin

from .kernels import kernel
from .state import Lines, Waves

# Half of pi in two parts: a whole number below 2^20 times the first is exact.
_QUARTER = 1.5707963267341256
_QUARTER_LOW = 6.077100506506192e-11


@kernel(inline=True)
def sine_and_cosine(phase: float) -> tuple[float, float]:
    """
    Return sine and cosine of a phase below 1.6e6 to 0.9 units in the last place.

    Notes
    -----
    The polynomials are those of fdlibm (Sun Microsystems, 1993), for an eighth of a turn. Several
    phases in a row take a third of the time of the C library, whose calls wait for one another.
    """
    quarters = floor(phase * 0.6366197723675814 + 0.5)
    upper = phase - quarters * _QUARTER
    lower = quarters * _QUARTER_LOW
    rest = upper - lower
    low = (upper - rest) - lower
    square = rest * rest
    fourth = square * square
    half = 0.5 * square
    most = 1.0 - half
    bend = (
        (-1.66666666666666324348e-01 + square * 8.33333333332248946124e-03)
        + fourth * (-1.98412698298579493134e-04 + square * 2.75573137070700676789e-06)
        + fourth * fourth * (-2.50507602534068634195e-08 + square * 1.58969099521155010221e-10)
    )
    lift = (
        (4.16666666666666019037e-02 + square * -1.38888888888741095749e-03)
        + fourth * (2.48015872894767294178e-05 + square * -2.75573143513906633035e-07)
        + fourth * fourth * (2.08757232129817482790e-09 + square * -1.13596475577881948265e-11)
    )
    sine = rest + (low * most + rest * square * bend)
    cosine = most + (((1.0 - most) - half) + (fourth * lift - rest * low))
    quarter = quarters - 4.0 * floor(0.25 * quarters)
    odd = quarter == 1.0 or quarter == 3.0
    first = cosine if odd else sine
    second = sine if odd else cosine
    return (
        -first if quarter >= 2.0 else first,
        -second if quarter == 1.0 or quarter == 2.0 else second,
    )


@kernel(inline=True)
def set_waves(lines: Lines, waves: Waves) -> None:
    """Set the sines and cosines of the harmonics at the origin by their angles."""
    if len(waves) == 1:
        phase = waves[0].angle + lines[0].phase
        waves[0].sine_0 = sin(phase)
        waves[0].cosine_0 = cos(phase)
    else:
        for j in range(len(waves)):
            phase = waves[j].angle + lines[j].phase
            waves[j].sine_0, waves[j].cosine_0 = sine_and_cosine(phase)


@kernel(inline=True)
def waves_to_origin(waves: Waves) -> None:
    """Set the waves of the search to those at the origin."""
    for j in range(len(waves)):
        waves[j].sine = waves[j].sine_0
        waves[j].cosine = waves[j].cosine_0


@kernel(inline=True)
def turn_waves(lines: Lines, waves: Waves, tau: float) -> None:
    """Advance the angles of the harmonics by a duration, mod 2 pi."""
    for j in range(len(waves)):
        total = waves[j].angle + lines[j].frequency * tau
        turns = floor(total * 0.15915494309189535)
        # 2 pi in two parts: the reduction must not shift the frequency.
        waves[j].angle = total - turns * 6.283185307179586 - turns * 2.4492935982947064e-16
    set_waves(lines, waves)


@kernel(inline=True)
def next_point(
    lines: Lines,
    first: int,
    waves: Waves,
    offset: float,
    velocity: float,
    x_x: float,
    x_v: float,
    v_x: float,
    v_v: float,
) -> tuple[float, float]:
    """Return X from rest and X' at the next point of the grid, and advance the waves to it."""
    # To add negative zero changes nothing, and a compiler leaves it out.
    pushed = -0.0
    speeded = -0.0
    for j in range(len(waves)):
        line = lines[first + j]
        wave = waves[j]
        sine = wave.sine
        cosine = wave.cosine
        pushed += cosine * line.x_cosine + sine * line.x_sine
        speeded += cosine * line.v_cosine + sine * line.v_sine
        turn_cosine = line.turn_cosine
        turn_sine = line.turn_sine
        wave.sine = sine * turn_cosine + cosine * turn_sine
        wave.cosine = cosine * turn_cosine - sine * turn_sine
    # Terms that are known early come first: each point waits for the one before.
    return (
        (pushed + offset * x_x) + velocity * x_v,
        (speeded + offset * v_x) + velocity * v_v,
    )


@kernel(inline=True)
def turn_back(lines: Lines, first: int, waves: Waves) -> None:
    """Go back to the waves at the point of the grid before."""
    for j in range(len(waves)):
        line = lines[first + j]
        wave = waves[j]
        sine = wave.sine
        cosine = wave.cosine
        wave.sine = sine * line.turn_cosine - cosine * line.turn_sine
        wave.cosine = cosine * line.turn_cosine + sine * line.turn_sine


@kernel(inline=True)
def drive_at(lines: Lines, first: int, waves: Waves) -> float:
    """Return the acceleration by the harmonics at the instant of the waves."""
    drive = -0.0
    for j in range(len(waves)):
        drive += lines[first + j].force * waves[j].sine
    return drive


@kernel(inline=True)
def drive_before(lines: Lines, waves: Waves) -> float:
    """Return the acceleration of M by the harmonics at the point of the grid before."""
    drive = -0.0
    for j in range(len(waves)):
        line = lines[j]
        wave = waves[j]
        drive += line.force * (wave.sine * line.turn_cosine - wave.cosine * line.turn_sine)
    return drive


@kernel(inline=True)
def drive_rates(lines: Lines, waves: Waves) -> tuple[float, float]:
    """Return the rates of `drive_at`, at the point before and at the instant of the waves."""
    before = now = -0.0
    for j in range(len(waves)):
        line = lines[j]
        wave = waves[j]
        rate = line.force * line.frequency
        before += rate * (wave.cosine * line.turn_cosine + wave.sine * line.turn_sine)
        now += rate * wave.cosine
    return before, now
