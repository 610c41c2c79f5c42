# SPDX-License-Identifier: Apache-2.0
"""
The clock of samples: equal intervals, rounded instants, and missing samples.

A logger of 512 Hz that writes whole milliseconds has steps of 1 and 2 ms. Such instants are those
of a grid, each rounded by at most half of its last digit. Larger differences are jitter of the
clock, or missing samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Intervals may differ by this part of one; an interval that differs more is a hole.
SAME_STEP = 0.3
#: Largest rounding of an instant, in its last digit, and fewest odd steps that show rounding.
_OFF_BY, _ODD_STEPS = 0.55, 5
#: Instants beside a hole that place the grid behind it, and most holes for which this is done.
_NEAR, _FEW_HOLES = 50, 1000
#: Number of times that show the last digit, and most digits of a time.
_JUDGED, _MOST_DIGITS = 2000, 12


def last_digit(times: Array, factor: float) -> float:
    """Return the size of the last digit in which times are written, s, in units of a factor."""
    finite = times[np.isfinite(times)]
    written = finite[:_JUDGED] / factor
    # Floats have no finer digit, as in times since 1970.
    size = 4.0 * float(np.spacing(np.abs(finite).max(initial=0.0)))
    for digits in range(_MOST_DIGITS):
        whole = written * 10.0**digits
        if np.all(np.abs(whole - np.rint(whole)) <= 1e-6 + 4.0 * np.spacing(np.abs(whole))):
            return max(size, factor * 10.0**-digits)
    return size


def rounded_interval(times: Array, digit: float) -> Array | None:
    """Return equally spaced times that round to the given ones; None if there are none."""
    steps = np.diff(times)
    if len(steps) < 2 or not np.isfinite(times).all() or not (steps >= 0.0).all():
        return None
    odd = np.abs(steps - np.median(steps)) > 0.5 * digit
    if odd.sum() < _ODD_STEPS:
        return None
    places = np.arange(len(times))
    since = times - times[0]
    grid = np.polyval(np.polyfit(places, since, 1), places)
    return times[0] + grid if np.abs(grid - since).max() <= _OFF_BY * digit else None


def missing_samples(times: Array, digit: float) -> NDArray[np.int64]:
    """
    Return how many samples are missing after each instant but the last; -1 where a step is odd.

    Notes
    -----
    The interval is the mean of the steps that are no holes. Where the digits are coarse, the
    instants on both sides of a hole show where the grid continues, so that rounding does not make
    a hole longer or shorter.
    """
    steps = np.diff(times)
    median = float(np.median(steps))
    # A digit as large as a step does not determine the step.
    coarse = SAME_STEP * median < digit <= 0.6 * median
    holes = np.flatnonzero(np.abs(steps - median) > max(SAME_STEP * median, 1.01 * digit * coarse))
    missing = np.zeros(len(steps), np.int64)
    if not len(holes):
        return missing
    rest = np.delete(steps, holes)
    interval = float(rest.mean()) if len(rest) else median
    gaps = steps[holes] / interval - 1.0
    if coarse and len(holes) < _FEW_HOLES:
        edges = [0, *(holes + 1).tolist(), len(times)]
        for n, (begin, here, end) in enumerate(zip(edges, edges[1:], edges[2:], strict=False)):
            near = times[max(begin, here - _NEAR) : here], times[here : min(end, here + _NEAR)]
            before, after = (part - interval * np.arange(len(part)) for part in near)
            gaps[n] = (after.mean() - before.mean()) / interval - len(before)
    whole = np.rint(gaps)
    odd = (np.abs(gaps - whole) > max(SAME_STEP, digit / interval * coarse)) | (whole < 1.0)
    missing[holes] = np.where(odd, -1.0, np.minimum(whole, 1e15)).astype(np.int64)
    return missing
