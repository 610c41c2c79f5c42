"""
Random-phase multisine: the stand-in for broadband noise whose every harmonic is a closed form.

The phases come from SplitMix64 (Steele, Lea and Flood, 2014, OOPSLA, "Fast splittable pseudorandom
number generators"), which is a few lines in any language: the same seed gives the same force on
every machine and with every version.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from math import sqrt, tau

__all__ = ['multisine', 'split_mix']

_MASK = (1 << 64) - 1


def split_mix(seed: int) -> Iterator[int]:
    """Yield the endless sequence of SplitMix64, whole numbers of 64 bits."""
    state = seed & _MASK
    while True:
        state = (state + 0x9E3779B97F4A7C15) & _MASK
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _MASK
        yield mixed ^ (mixed >> 31)


@lru_cache(maxsize=64)
def multisine(
    level: float, low: float, high: float, lines: int, seed: int
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """
    Return the harmonics of a random-phase multisine.

    Parameters
    ----------
    level : float
        Effective (rms) value of their sum.
    low, high : float
        Band; the lines are evenly spaced, the first and the last on its ends. A single line is in
        the middle.
    lines : int
        Number of lines.
    seed : int
        Seed of the phases.

    Returns
    -------
    amplitudes, frequencies, phases : tuple of float
        One entry per line: the amplitude level sqrt(2/lines), and the phase 2 pi u with u the
        upper 53 bits of the line's number in the sequence of SplitMix64, as a fraction.
    """
    amplitude = level * sqrt(2.0 / lines)
    if lines == 1:
        frequencies: tuple[float, ...] = (0.5 * (low + high),)
    else:
        spacing = (high - low) / (lines - 1)
        frequencies = (*(low + j * spacing for j in range(lines - 1)), high)
    phases = tuple(tau * ((bits >> 11) * 2.0**-53) for bits in islice(split_mix(seed), lines))
    return (amplitude,) * lines, frequencies, phases
