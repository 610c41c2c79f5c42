# SPDX-License-Identifier: Apache-2.0
"""Samples of the motion of M, and their noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .vibration import Array

#: Least number of fourth differences that show the noise.
_LEAST_DIFFERENCES = 30


class Record(NamedTuple):
    """Samples of a derivative of X; weights are 0 or 1."""

    time: Array
    motion: Array
    weight: Array
    order: int


def noise_of(motion: Array) -> float:
    """
    Return the standard deviation of white noise, from fourth differences.

    A smooth motion has almost no fourth differences; jumps are too few to alter the median.
    """
    differences = np.diff(motion, 4)
    if not len(differences):
        return 0.0
    middle = np.median(differences)
    return float(1.4826 * np.median(np.abs(differences - middle)) / np.sqrt(70.0))


def noise_between(residuals: Array, time: Array, impacts: Array) -> float:
    """
    Return the noise of residuals from fourth differences that do not span an impact.

    The result is NaN with too few differences; the residuals may have gaps of NaN.
    """
    differences = np.diff(residuals, 4)
    first = np.searchsorted(impacts, time)
    differences = differences[(first[4:] == first[:-4]) & np.isfinite(differences)]
    if len(differences) < _LEAST_DIFFERENCES:
        return float('nan')
    rough = 1.4826 * float(np.median(np.abs(differences)))
    return float(np.sqrt(np.mean(differences[np.abs(differences) <= 4.0 * rough] ** 2) / 70.0))
