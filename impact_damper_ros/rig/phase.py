"""Time without loss of digits, and the phases of the force's harmonics."""

from __future__ import annotations

from math import floor, sin

from .kernels import elementwise, kernel, sine_and_cosine

__all__ = ['advance_time', 'sines_and_cosines_of', 'sines_of', 'turned_angles']


@kernel(inline=True)
def advance_time(time: float, time_low: float, tau: float) -> tuple[float, float]:
    """Add a duration to an instant held as an unevaluated sum."""
    total = time + tau
    back = total - time
    low = time_low + ((time - (total - back)) + (tau - back))
    rounded = total + low
    return rounded, low - (rounded - total)


@elementwise
def turned_angles(angle: float, frequency: float, tau: float) -> float:
    """Return angles after turning at their frequencies for a time, reduced mod 2 pi."""
    total = angle + frequency * tau
    turns = floor(total * 0.15915494309189535)
    # 2 pi in two parts: the reduction must not shift the frequency.
    return total - turns * 6.283185307179586 - turns * 2.4492935982947064e-16


@elementwise
def sines_of(phase: float, angle: float) -> float:
    """Return the sine of each harmonic."""
    return sin(angle + phase)


@elementwise(results=2)
def sines_and_cosines_of(phase: float, angle: float) -> tuple[float, float]:
    """Return the sine and the cosine of each harmonic."""
    return sine_and_cosine(angle + phase)
