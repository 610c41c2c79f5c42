# SPDX-License-Identifier: Apache-2.0
"""
The force: phases of its harmonics, and random-phase multisine.

The phases of a multisine come from SplitMix64 (Steele, Lea and Flood, 2014, OOPSLA, "Fast
splittable pseudorandom number generators"): the same seed gives the same force on every machine
and with every version.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt, tau

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15


def mix(word: int) -> int:
    """Return 64 bits that depend on all bits of a word, a step of SplitMix64."""
    word = (word + _GOLDEN) & _MASK
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & _MASK
    return word ^ (word >> 31)


@lru_cache(maxsize=64)
def multisine(
    level: float, low: float, high: float, lines: int, seed: int
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return the harmonics of a random-phase multisine."""
    amplitude = level * sqrt(2.0 / lines)
    if lines == 1:
        frequencies: tuple[float, ...] = (0.5 * (low + high),)
    else:
        spacing = (high - low) / (lines - 1)
        frequencies = (*(low + j * spacing for j in range(lines - 1)), high)
    return (amplitude,) * lines, frequencies, random_phases(lines, seed)


def random_phases(count: int, seed: int) -> tuple[float, ...]:
    """Return random phases, rad: the sequence of SplitMix64 from a seed on."""
    bits = (mix(seed + k * _GOLDEN) for k in range(count))
    return tuple(tau * ((word >> 11) * 2.0**-53) for word in bits)
