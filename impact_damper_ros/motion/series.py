# SPDX-License-Identifier: Apache-2.0
"""Taylor series of X about a point of a flight, beyond its tangent parabola."""

from __future__ import annotations

from typing import NamedTuple

from .kernels import kernel
from .oscillator import Oscillator
from .state import Lines, Waves


class Series(NamedTuple):
    """X'' at a point, and coefficients of the 2nd to 15th power in the series of X' about it."""

    x_2: float
    b_3: float
    b_4: float
    b_5: float
    b_6: float
    b_7: float
    b_8: float
    b_9: float
    b_10: float
    b_11: float
    b_12: float
    b_13: float
    b_14: float
    b_15: float
    b_16: float


@kernel(inline=True)
def series_at(
    oscillator: Oscillator,
    lines: Lines,
    first: int,
    waves: Waves,
    offset: float,
    velocity: float,
) -> Series:
    """Return the series around a point: each derivative from the two before it and the drive."""
    # To add negative zero changes nothing, and a compiler leaves it out.
    f_0 = f_1 = f_2 = f_3 = f_4 = f_5 = f_6 = f_7 = -0.0
    f_8 = f_9 = f_10 = f_11 = f_12 = f_13 = f_14 = -0.0
    for j in range(len(waves)):
        scaled = lines[first + j].scaled_force
        turn = lines[first + j].turn
        even = scaled * waves[j].sine
        odd = scaled * turn * waves[j].cosine
        turned = -turn * turn
        f_0 += even
        f_1 += odd
        even *= turned
        odd *= turned
        f_2 += even
        f_3 += odd
        even *= turned
        odd *= turned
        f_4 += even
        f_5 += odd
        even *= turned
        odd *= turned
        f_6 += even
        f_7 += odd
        even *= turned
        odd *= turned
        f_8 += even
        f_9 += odd
        even *= turned
        odd *= turned
        f_10 += even
        f_11 += odd
        even *= turned
        odd *= turned
        f_12 += even
        f_13 += odd
        even *= turned
        f_14 += even
    spring = oscillator.spring
    dashpot = oscillator.dashpot
    d_1 = velocity * oscillator.step
    d_2 = (f_0 - spring * offset) - dashpot * d_1
    d_3 = (f_1 - spring * d_1) - dashpot * d_2
    d_4 = (f_2 - spring * d_2) - dashpot * d_3
    d_5 = (f_3 - spring * d_3) - dashpot * d_4
    d_6 = (f_4 - spring * d_4) - dashpot * d_5
    d_7 = (f_5 - spring * d_5) - dashpot * d_6
    d_8 = (f_6 - spring * d_6) - dashpot * d_7
    d_9 = (f_7 - spring * d_7) - dashpot * d_8
    d_10 = (f_8 - spring * d_8) - dashpot * d_9
    d_11 = (f_9 - spring * d_9) - dashpot * d_10
    d_12 = (f_10 - spring * d_10) - dashpot * d_11
    d_13 = (f_11 - spring * d_11) - dashpot * d_12
    d_14 = (f_12 - spring * d_12) - dashpot * d_13
    d_15 = (f_13 - spring * d_13) - dashpot * d_14
    d_16 = (f_14 - spring * d_14) - dashpot * d_15
    return Series(
        d_2,
        d_3 * (1.0 / 2.0),
        d_4 * (1.0 / 6.0),
        d_5 * (1.0 / 24.0),
        d_6 * (1.0 / 120.0),
        d_7 * (1.0 / 720.0),
        d_8 * (1.0 / 5040.0),
        d_9 * (1.0 / 40320.0),
        d_10 * (1.0 / 362880.0),
        d_11 * (1.0 / 3628800.0),
        d_12 * (1.0 / 39916800.0),
        d_13 * (1.0 / 479001600.0),
        d_14 * (1.0 / 6227020800.0),
        d_15 * (1.0 / 87178291200.0),
        d_16 * (1.0 / 1307674368000.0),
    )


@kernel(inline=True)
def tail(series: Series, s: float) -> tuple[float, float, float]:
    """
    Return what the third and higher powers add to X and its first two derivatives.

    The second derivative is without the highest powers: the last step of a search, which needs
    it, needs half of its digits only. Products are taken in pairs, so that few of them wait for
    one another.
    """
    s_2 = s * s
    s_4 = s_2 * s_2
    s_8 = s_4 * s_4
    _, b_3, b_4, b_5, b_6, b_7, b_8, b_9, b_10, b_11, b_12, b_13, b_14, b_15, b_16 = series
    value = (
        ((b_3 * (1.0 / 3.0) + 0.25 * b_4 * s) + (0.2 * b_5 + b_6 * (1.0 / 6.0) * s) * s_2)
        + ((b_7 * (1.0 / 7.0) + 0.125 * b_8 * s) + (b_9 * (1.0 / 9.0) + 0.1 * b_10 * s) * s_2)
        * s_4
        + (
            (b_11 * (1.0 / 11.0) + b_12 * (1.0 / 12.0) * s)
            + (b_13 * (1.0 / 13.0) + b_14 * (1.0 / 14.0) * s) * s_2
            + (b_15 * (1.0 / 15.0) + 0.0625 * b_16 * s) * s_4
        )
        * s_8
    )
    slope = (
        ((b_3 + b_4 * s) + (b_5 + b_6 * s) * s_2)
        + ((b_7 + b_8 * s) + (b_9 + b_10 * s) * s_2) * s_4
        + ((b_11 + b_12 * s) + (b_13 + b_14 * s) * s_2 + (b_15 + b_16 * s) * s_4) * s_8
    )
    bend = (
        ((2.0 * b_3 + 3.0 * b_4 * s) + (4.0 * b_5 + 5.0 * b_6 * s) * s_2)
        + ((6.0 * b_7 + 7.0 * b_8 * s) + (8.0 * b_9 + 9.0 * b_10 * s) * s_2) * s_4
        + (10.0 * b_11 + 11.0 * b_12 * s) * s_8
    )
    return s * s_2 * value, s_2 * slope, s * bend


@kernel(inline=True)
def coarse_tail(series: Series, s: float) -> tuple[float, float, float, float]:
    """Return what the third to tenth power add to X and its first three derivatives."""
    _, b_3, b_4, b_5, b_6, b_7, b_8, b_9, b_10 = series[:9]
    s_2 = s * s
    s_4 = s_2 * s_2
    value = ((b_3 * (1.0 / 3.0) + 0.25 * b_4 * s) + (0.2 * b_5 + b_6 * (1.0 / 6.0) * s) * s_2) + (
        (b_7 * (1.0 / 7.0) + 0.125 * b_8 * s) + (b_9 * (1.0 / 9.0) + 0.1 * b_10 * s) * s_2
    ) * s_4
    slope = ((b_3 + b_4 * s) + (b_5 + b_6 * s) * s_2) + (
        (b_7 + b_8 * s) + (b_9 + b_10 * s) * s_2
    ) * s_4
    bend = (2.0 * b_3 + 3.0 * b_4 * s) + (4.0 * b_5 + 5.0 * b_6 * s) * s_2
    third = (2.0 * b_3 + 6.0 * b_4 * s) + (12.0 * b_5 + 20.0 * b_6 * s) * s_2
    return s * s_2 * value, s_2 * slope, s * bend, third
