# SPDX-License-Identifier: Apache-2.0
"""
Motion of the base along the axis, and the force on M that stands for it.

The base moves by b(t), a sum of lines. In absolute coordinates the spring and the dashpot under M
pull it by K b + C b', so that each line b = B sin(W t + p) is one line of the force:

    K b + C b' = B sqrt(K^2 + C^2 W^2) sin(W t + p + atan2(C W, K)).

m touches M only, so that no force of the base acts on m. In coordinates relative to the base -M
b'' would act on M and -m b'' on m, so that m would no longer fly with a constant acceleration: X
and Z are therefore absolute, and X - b is computed from them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from .units import UNITS

#: Quantities of which amplitudes of a base may be given, and the SI unit of each.
QUANTITIES = {'displacement': 'm', 'velocity': 'm/s', 'acceleration': 'm/s^2'}
#: The derivative of a displacement that each of them is.
ORDERS = {quantity: order for order, quantity in enumerate(QUANTITIES)}
#: Search for a passage of b through zero: first number of steps in a period of the fastest line,
#: factor by which a step may be longer than the step before, and most steps.
_STEPS_PER_PERIOD, _GROWTH, _MOST_STEPS = 16, 1.01, 4000
#: Longer than any run, s.
_NEVER_S = 1e15
#: Share of the motion up to which b has just passed zero, and steps of Newton's method to there.
_JUST_PASSED, _PASSES = 1e-4, 4


def _over(amplitude: float, divisor: float) -> float:
    """Return a displacement; infinite where the frequency is too low for one."""
    if not amplitude:
        return 0.0
    return amplitude / divisor if divisor else math.copysign(math.inf, amplitude)


class BaseMotion(NamedTuple):
    """
    Lines of b(t): b = sum of B sin(W t + p).

    Attributes
    ----------
    amplitudes, frequencies, phases : tuple of float
        Displacement B of each line, m, its circular frequency W, rad/s, and phase p, rad.
    """

    amplitudes: tuple[float, ...]
    frequencies: tuple[float, ...]
    phases: tuple[float, ...]

    @classmethod
    def of(
        cls,
        amplitudes: Sequence[float],
        frequencies: Sequence[float],
        phases: Sequence[float],
        quantity: str,
    ) -> BaseMotion:
        """Return a base of which displacement, velocity or acceleration is given."""
        if quantity == 'displacement':
            return cls(tuple(amplitudes), tuple(frequencies), tuple(phases))
        if quantity == 'velocity':
            # b' = v sin(W t + p), so that b = (v/W) sin(W t + p - pi/2)
            sizes = (_over(v, w) for v, w in zip(amplitudes, frequencies, strict=True))
            return cls(tuple(sizes), tuple(frequencies), tuple(p - 0.5 * math.pi for p in phases))
        # b'' = a sin(W t + p), so that b = -(a/W^2) sin(W t + p)
        sizes = (_over(-a, w * w) for a, w in zip(amplitudes, frequencies, strict=True))
        return cls(tuple(sizes), tuple(frequencies), tuple(phases))

    @property
    def moves(self) -> bool:
        """Whether there is a motion."""
        return any(self.amplitudes)

    @property
    def size(self) -> float:
        """Bound of abs(b), m."""
        return sum(map(abs, self.amplitudes))

    def force(self, stiffness: float, damping: float) -> tuple[tuple[float, ...], ...]:
        """Return amplitudes (N), frequencies (rad/s) and phases (rad) of the force on M."""
        lines = list(zip(self.amplitudes, self.frequencies, self.phases, strict=True))
        amplitudes = tuple(b * math.hypot(stiffness, damping * w) for b, w, _ in lines)
        phases = tuple(p + math.atan2(damping * w, stiffness) for _, w, p in lines)
        return amplitudes, self.frequencies, phases

    def columns(self, stiffness: float, damping: float) -> tuple[list[float], list[float]]:
        """Return b of each line for unit sine and for unit cosine of the phase of its force, m."""
        sines, cosines = [], []
        for b, w in zip(self.amplitudes, self.frequencies, strict=True):
            pull = math.hypot(stiffness, damping * w)
            sines.append(b * (stiffness / pull))
            cosines.append(-b * (damping * w / pull))
        return sines, cosines

    def at(self, angles: Sequence[float], after: float = 0.0) -> tuple[float, float]:
        """Return b and b' some time after the lines have turned by angles, m and m/s."""
        place = speed = 0.0
        for b, w, p, angle in zip(*self, angles, strict=True):
            phase = angle + w * after + p
            place += b * math.sin(phase)
            speed += b * w * math.cos(phase)
        return place, speed

    def upward_zero(self, angles: Sequence[float]) -> float:
        """
        Return how long after angles b next passes zero upwards, s; 0 where it does so there.

        Infinite for a base that never passes zero.

        Notes
        -----
        The motion of a base may be changed at any of its upward zeros, so that the search may miss
        two passages in a step. A step is as long as b certainly keeps its sign (`_quiet`), but at
        least a length that grows: the work is bounded however far apart the frequencies are. A
        step from negative to positive b has an upward zero in it, which bisection finds.
        """
        acting = [(w, b, p, angle) for b, w, p, angle in zip(*self, angles, strict=True) if b]
        if not acting:
            return 0.0
        before, speed = self.at(angles)
        if abs(before) <= 1e-9 * self.size and speed > 0.0:
            return 0.0
        if len(acting) == 1:
            ((w, b, p, angle),) = acting
            start = 0.0 if b > 0.0 else math.pi
            return ((start - angle - p) % math.tau) / w if w else math.inf
        acting = sorted(acting)
        fastest = acting[-1][0]
        constant = sum([b * math.sin(p + angle) for w, b, p, angle in acting if not w])
        if not fastest or abs(constant) >= sum([abs(b) for w, b, _, _ in acting if w]):
            return math.inf
        least, time = math.tau / (_STEPS_PER_PERIOD * fastest), 0.0
        here, quiet = _quiet(acting, time)
        for _ in range(_MOST_STEPS):
            later = min(time + max(least, quiet), _NEVER_S)
            there, quiet = _quiet(acting, later)
            if here < 0.0 <= there:
                return self._root(angles, time, later)
            time, here = later, there
            least *= _GROWTH
        return math.inf

    def _root(self, angles: Sequence[float], low: float, high: float) -> float:
        """Return the zero between two times at which b has opposite signs, by bisection."""
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if self.at(angles, middle)[0] < 0.0 else (low, middle)
        return high

    def angles_from_zero(self, place: float = 0.0) -> list[float]:
        """
        Return the angles of the lines when b first passes zero upwards.

        With a place little above zero, m: the angles when b passes that place.
        """
        start = [0.0] * len(self.amplitudes)
        wait = self.upward_zero(start)
        if not math.isfinite(wait):
            return start
        zero = [math.fmod(w * wait, math.tau) for w in self.frequencies]
        late = 0.0
        for _ in range(_PASSES if place else 0):
            here, speed = self.at(zero, late)
            late += (place - here) / speed
        return [
            math.fmod(a + w * late, math.tau) for a, w in zip(zero, self.frequencies, strict=True)
        ]


def _quiet(lines: Sequence[tuple[float, ...]], after: float) -> tuple[float, float]:
    """
    Return b some time after now, and a time for which it then keeps its sign.

    The lines are rows that begin with the frequency, and rise with it. The sum of the first k of
    them changes by no more than `speed` per second, and the others by no more than `rest` in all.
    """
    rest = sum([abs(line[1]) for line in lines])
    place = speed = quiet = 0.0
    for w, b, p, angle in lines:
        place += b * math.sin(angle + w * after + p)
        speed += abs(b) * w
        rest -= abs(b)
        if speed > 0.0:
            quiet = max(quiet, (abs(place) - rest) / speed)
    return place, quiet


def quantity_of(unit: str) -> str:
    """Return the quantity that has a unit: that of 0.2 g is an acceleration."""
    return next(name for name, si in QUANTITIES.items() if unit in UNITS[si])


def angles_after(before: BaseMotion, angles: Sequence[float], after: BaseMotion) -> list[float]:
    """
    Return the angles of the lines with which another motion of a base goes on.

    A line keeps its angle by its index where that keeps b continuous. Elsewhere the new motion
    begins at one of its upward zeros, which keeps b continuous if the old motion is at zero or has
    just passed it.
    """
    kept = list(angles[: len(after.amplitudes)])
    kept += [0.0] * (len(after.amplitudes) - len(kept))
    if before.moves and after.moves:
        here, there, small = before.at(angles), after.at(kept), 1e-9 * max(before.size, after.size)
        at_zero = abs(here[0]) <= small
        if abs(here[0] - there[0]) <= small and not (at_zero and here[1] * there[1] < 0.0):
            return kept
        if here[1] > 0.0 and abs(here[0]) <= _JUST_PASSED * min(before.size, after.size):
            return after.angles_from_zero(here[0])
    return after.angles_from_zero() if after.moves else kept


def wait_for_change(before: BaseMotion, angles: Sequence[float], after: BaseMotion) -> float:
    """Return how long a change has to wait so that b stays continuous, s."""
    if before == after or not before.moves:
        return 0.0
    here = before.at(angles)[0]
    there = after.at(angles_after(before, angles, after))[0] if after.moves else 0.0
    if abs(here - there) <= 1e-9 * max(before.size, after.size):
        return 0.0
    return before.upward_zero(angles)
