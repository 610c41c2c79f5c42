"""
The arithmetic that an impact cannot do without, and what the machine needs for it.

Two evaluations of two sincos and one exp each, in a chain, since the instant of each impact
depends on the one before.
"""

from __future__ import annotations

from functools import cache
from math import cos, exp, inf, sin
from time import thread_time
from typing import Any

__all__ = ['chain', 'floor']


@cache
def chain() -> Any:
    """Return the compiled chain, a function of how many impacts it is to be the floor of."""
    from numba import njit

    @njit(nogil=True)
    def links(count: int) -> float:
        value = 0.3
        for _ in range(2 * count):
            first = sin(value) * cos(value)
            second = sin(0.71 * value) * cos(0.71 * value)
            value = 1.0 + 1e-3 * (first + second * exp(-0.01 * value))
        return value

    links(1)
    return links


def floor(rounds: int = 9) -> float:
    """Return the least CPU time of one impact's part of the chain, s."""
    best = inf
    for _ in range(rounds):
        began = thread_time()
        chain()(200_000)
        best = min(best, (thread_time() - began) / 200_000)
    return best
