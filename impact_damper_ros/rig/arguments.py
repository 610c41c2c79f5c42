"""Numbers of any kind as floats, for the checks of their range."""

from __future__ import annotations

from math import inf, nan
from typing import Any


def as_float(value: Any) -> float:
    """
    Return a number as a float, one too large as infinity, and NaN for what is no number.

    A float32 would otherwise have its few digits in all that is computed with it.
    """
    try:
        return float(value) if hasattr(value, '__float__') else nan
    except (TypeError, ValueError):
        return nan
    except OverflowError:
        return inf if value > 0 else -inf
