# SPDX-License-Identifier: Apache-2.0
"""An estimate of a parameter, with its uncertainty."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

#: A normal estimate is within this number of standard deviations in 95 % of all cases.
WITHIN = 1.959964


class Estimate(NamedTuple):
    """
    An estimate of a parameter.

    Attributes
    ----------
    value : float
        The estimate, SI units.
    standard_deviation : float
        Standard deviation of the estimate.
    interval : tuple of float
        Interval that holds the true value in 95 % of all cases.
    start : float or None
        The start value; None if there was none.
    unit : str
        SI unit; empty for a ratio.

    Examples
    --------
    >>> estimate = Estimate.normal(24.3e-3, 1e-4, 25e-3, 'm')
    >>> [round(end, 5) for end in estimate.interval]
    [0.0241, 0.0245]
    """

    value: float
    standard_deviation: float
    interval: tuple[float, float]
    start: float | None = None
    unit: str = ''

    @property
    def of_inverse(self) -> Estimate:
        """The estimate with the interval of an inverse whose error is normal."""
        part = WITHIN * self.standard_deviation / abs(self.value)
        ends = tuple(self.value / (1.0 + way) if way > -1.0 else math.inf for way in (part, -part))
        return self._replace(interval=(ends[0], ends[1]))

    @classmethod
    def normal(
        cls, value: float, deviation: float, unit: str = '', start: float | None = None
    ) -> Estimate:
        """Return an estimate whose error is normal."""
        half = WITHIN * deviation
        return cls(value, deviation, (value - half, value + half), start, unit)

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate for JSON."""
        return {
            'value': self.value,
            'standard_deviation': self.standard_deviation,
            'interval': list(self.interval),
            'start': self.start,
            'unit': self.unit,
        }
