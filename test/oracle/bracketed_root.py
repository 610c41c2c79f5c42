"""Many roots at once, each between two times (80-bit floats)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oracle.flight_cases import REAL, Array


def bracketed_root(
    f: Callable[[Array, Array], Array],
    index: Array,
    low: Array,
    high: Array,
    accuracy: float = 1e-9,
) -> Array:
    """Return roots of f(index, t) between times where it is below and above zero (ITP-like)."""
    low, high = low.astype(REAL), high.astype(REAL)
    f_low, f_high = f(index, low), f(index, high)
    best = np.where(np.abs(f_low) < np.abs(f_high), low, high)
    work = np.flatnonzero((f_low < 0) & (f_high > 0))
    for k in range(80):
        if not len(work):
            break
        a, b, fa, fb = low[work], high[work], f_low[work], f_high[work]
        t = (a + b) / 2 if k % 4 == 3 else a - fa * (b - a) / (fb - fa)
        t = np.where((t > a) & (t < b), t, (a + b) / 2)
        value = f(index[work], t)
        move = np.abs(t - best[work])
        best[work] = t
        below = value < 0
        # Illinois: an end that stays put weighs half the next time.
        low[work], high[work] = np.where(below, t, a), np.where(below, b, t)
        f_low[work] = np.where(below, value, fa / 2)
        f_high[work] = np.where(below, fb / 2, value)
        done = (value == 0) | (move <= accuracy * np.abs(t))
        work = work[~done]
    return best
