# SPDX-License-Identifier: Apache-2.0
"""
The force: phases of its harmonics, random-phase multisine, and stepped sine.

The phases of a multisine come from SplitMix64 (Steele, Lea and Flood, 2014, OOPSLA, "Fast
splittable pseudorandom number generators"): the same seed gives the same force on every machine
and with every version.

A stepped sine takes the first harmonic through a range of frequencies with a continuous phase. The
instants of its steps are counted from its start, so that a long one does not drift.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, inf, sqrt, tau
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .parameters import RigParameters


_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15


def mixed(word: int) -> int:
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
    # The sequence of SplitMix64 from the seed on
    bits = (mixed(seed + k * _GOLDEN) for k in range(lines))
    phases = tuple(tau * ((word >> 11) * 2.0**-53) for word in bits)
    return (amplitude,) * lines, frequencies, phases


#: A change of one of these starts the sweep anew.
SWEEP_FIELDS = ('sweep_mode', 'sweep_low', 'sweep_high', 'sweep_step', 'sweep_dwell')
# A range this little longer than a whole number of steps ends with the last of them.
_WHOLE = 1e-9


def frequency_steps(parameters: RigParameters) -> int:
    """Return the number of steps of a whole sweep; 0 if there is none."""
    if parameters.sweep_mode == 'off':
        return 0
    way = (parameters.sweep_high - parameters.sweep_low) / parameters.sweep_step
    once = max(1, ceil(way - _WHOLE))
    return 2 * once if parameters.sweep_mode == 'up_down' else once


def frequency_at(parameters: RigParameters, step: int) -> float:
    """
    Return the frequency of the first harmonic after a number of steps of the sweep, rad/s.

    Up and down go through the same frequencies: from the low end on in whole steps, and the high
    end, to which the last step may be a shorter one.
    """
    steps = frequency_steps(parameters)
    if not steps:
        return parameters.force_frequencies[0]
    once = steps // 2 if parameters.sweep_mode == 'up_down' else steps
    place = min(max(step, 0), steps)
    if parameters.sweep_mode == 'down':
        place = steps - place
    elif place > once:
        place = 2 * once - place
    if place == once:
        return parameters.sweep_high
    return parameters.sweep_low + place * parameters.sweep_step


class SteppedSine(NamedTuple):
    """
    How far a sweep has come.

    Attributes
    ----------
    start : float
        When it was started, s.
    step : int
        Steps done.
    """

    start: float
    step: int = 0

    @classmethod
    def begun(cls, parameters: RigParameters, time: float) -> SteppedSine:
        """Return a sweep that starts at a time; one that is off has begun at none."""
        return cls(0.0 if parameters.sweep_mode == 'off' else time)

    def due(self, parameters: RigParameters) -> float:
        """Return the instant of the next step, s; infinity after the last one."""
        if self.step >= frequency_steps(parameters):
            return inf
        return self.start + (self.step + 1) * parameters.sweep_dwell
