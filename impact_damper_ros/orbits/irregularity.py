# SPDX-License-Identifier: Apache-2.0
"""
Motions that do not repeat: quasi-periodic, chaotic, or not settled.

Besides the largest Lyapunov exponent, a test uses values taken once in a cycle: weighted averages
[1]_ over both halves of a motion, with weights that vanish smoothly at the ends. For a
quasi-periodic motion they agree to ever more digits, for a chaotic one as badly as random numbers.

References
----------
.. [1] E. Sander, J. D. Meiss, Physica D 411, 132569 (2020).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .recurrence import MotionKind
from .response import Array

#: Thresholds of a chaotic motion: standard errors of the exponent above zero, growth of a
#: deviation over the time measured, as a power of e, and difference of the weighted averages.
CERTAIN_ERRORS, CERTAIN_GROWTH, IRREGULAR_SPREAD = 5.0, 10.0, 3e-3
#: Thresholds of a quasi-periodic motion: largest growth or shrinkage of a deviation, as a power of
#: e, standard errors of the exponent from zero, and difference of the averages.
BOUNDED_GROWTH, DOUBTFUL_ERRORS, REGULAR_SPREAD = 2.0, 3.0, 1e-3
#: Least number of values for weighted averages.
LEAST_VALUES = 300
#: Largest number of cycles that is recommended for a decision.
_MOST_FORETOLD = 1_000_000
_CONSTANT = 1e-6


@dataclass(frozen=True)
class Indications:
    """The evidence for and against chaos."""

    #: Largest Lyapunov exponent, and its standard error, per cycle of the force.
    exponent: float
    error: float
    cycles: int  # number of cycles on which they were measured
    #: Difference of the weighted averages; NaN if there are too few values.
    spread: float = math.nan

    @property
    def grows(self) -> bool:
        """Whether neighbouring motions certainly diverge."""
        grown = self.exponent * self.cycles
        return self.exponent > CERTAIN_ERRORS * self.error and grown > CERTAIN_GROWTH

    @property
    def shrinks(self) -> bool:
        """Whether neighbouring motions certainly converge."""
        grown = self.exponent * self.cycles
        return self.exponent < -CERTAIN_ERRORS * self.error and grown < -BOUNDED_GROWTH

    @property
    def neutral(self) -> bool:
        """Whether neighbouring motions keep their distance."""
        grown = abs(self.exponent) * self.cycles
        return grown < BOUNDED_GROWTH and abs(self.exponent) <= DOUBTFUL_ERRORS * self.error

    def kind(self) -> MotionKind:
        """Return the kind of the motion: chaotic or quasi-periodic only if both tests agree."""
        # With too few values only the exponent is known.
        if self.grows and not self.spread <= IRREGULAR_SPREAD:
            return MotionKind.CHAOTIC
        if self.neutral and self.spread < REGULAR_SPREAD and self.cycles >= LEAST_VALUES:
            return MotionKind.QUASI_PERIODIC
        return MotionKind.UNDECIDED

    def cycles_to_decide(self) -> int:
        """Return how many cycles in all should make the exponent certain; 0 if unknown."""
        if self.exponent <= DOUBTFUL_ERRORS * self.error:
            return 0
        certain = self.cycles * (CERTAIN_ERRORS * self.error / self.exponent) ** 2
        needed = max(certain, CERTAIN_GROWTH / self.exponent)
        return math.ceil(needed) if self.cycles < needed < _MOST_FORETOLD else 0


def average_spread(section: Array) -> float:
    """
    Return the largest difference of weighted averages over two halves of a motion.

    The section (n, m) holds the motion once in a cycle. The averages are of each quantity, its
    cosine and the sine of its double, scaled to the standard deviation 1. The result is NaN with
    fewer than `LEAST_VALUES` values.
    """
    half = len(section) // 2
    if len(section) < LEAST_VALUES:
        return math.nan
    deviation = section.std(axis=0)
    size = float(deviation.max()) or 1.0
    moving = deviation > _CONSTANT * size
    scaled = (section[:, moving] - section[:, moving].mean(axis=0)) / deviation[moving]
    values = np.concatenate([scaled, np.cos(scaled), np.sin(2.0 * scaled)], axis=1)
    part = np.arange(1, half + 1) / (half + 1)
    weight = np.exp(-1.0 / (part * (1.0 - part)))
    weight /= weight.sum()
    # Not by `@`, whose threads would wait for the next product, beside those of a sweep
    apart = np.einsum('i,ij->j', weight, values[:half] - values[-half:])
    return float(np.abs(apart).max(initial=0.0))


def quiet_phase(phases: Array) -> float:
    """
    Return the middle of the widest gap between the phases of impacts, in cycles, in [0, 1).

    `average_spread` needs values at that phase: near impacts they jump, and their averages
    converge slowly.
    """
    if not len(phases):
        return 0.0
    inside = np.sort(phases % 1.0)
    gaps = np.diff(np.append(inside, inside[0] + 1.0))
    widest = int(gaps.argmax())
    return float(inside[widest] + 0.5 * gaps[widest]) % 1.0
