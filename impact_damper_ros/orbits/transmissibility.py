# SPDX-License-Identifier: Apache-2.0
"""Transmissibility of a rig on a moving base."""

from __future__ import annotations

import cmath
import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.rig_parameters import RigParameters


def dynamic_stiffness(rig: RigParameters, rates: Any, mass: float | None = None) -> Any:
    """Return the dynamic stiffness of spring, dashpot and a mass (M by default), N/m."""
    inertia = (rig.primary_mass if mass is None else mass) * rates**2
    return rig.stiffness - inertia + 1j * rig.damping * rates


class Moments(NamedTuple):
    """
    Weighted sums over a motion and that of its base; sums of consecutive parts add up.

    Attributes
    ----------
    weight : float
        Sum of the weights: a time, or a number of samples.
    x, x_squares, base, base_squares, product : float
        Sums of X, X^2, b, b^2 and X b.
    acceleration, base_acceleration : float
        Sums of X''^2 and b''^2; NaN if not known.
    """

    weight: float = 0.0
    x: float = 0.0
    x_squares: float = 0.0
    base: float = 0.0
    base_squares: float = 0.0
    product: float = 0.0
    acceleration: float = 0.0
    base_acceleration: float = 0.0


#: Names of the fields of a `Transmissibility` as columns and in JSON.
TRANSMISSIBILITIES = (
    *('transmissibility', 'relative_transmissibility', 'acceleration_transmissibility'),
)


class Transmissibility(NamedTuple):
    """
    Steady motion of M over that of its base; NaN for a base at rest.

    Attributes
    ----------
    absolute : float
        rms X over rms b, each about its mean; X counts from a fixed place.
    relative : float
        rms (X - b) over rms b, as a strain gauge on the spring measures it.
    acceleration : float
        rms X'' over rms b'', as accelerometers measure it. The impacts, in which X'' is infinite,
        are left out.

    Examples
    --------
    >>> from impact_damper_ros import find_orbits, transmissibility
    >>> rig = RigParameters(gravity=0.0, gap=0.37, force_amplitudes=0.0, base_amplitudes=0.01)
    >>> orbit = find_orbits(rig, (1, 2))[0]
    >>> transmissibility(orbit).absolute > 1.0
    True
    """

    absolute: float = math.nan
    relative: float = math.nan
    acceleration: float = math.nan

    def by_name(self, end: str = '') -> dict[str, float]:
        """Return the numbers by their names as columns and in JSON, with an ending."""
        return dict(zip((name + end for name in TRANSMISSIBILITIES), self, strict=True))

    @classmethod
    def of_moments(cls, found: Moments) -> Transmissibility:
        """Return the transmissibility of a motion over whole periods."""
        weight, x, x_squares, base, base_squares, product, own, shaken = found
        moved = weight * base_squares - base * base
        if not moved > 0.0:
            return cls()
        taken, both = weight * x_squares - x * x, weight * product - x * base
        apart = taken - 2.0 * both + moved
        ratios = (taken / moved, apart / moved, own / shaken if shaken else math.nan)
        return cls(*(math.sqrt(max(ratio, 0.0)) for ratio in ratios))

    @classmethod
    def without_damper(cls, rig: RigParameters) -> Transmissibility:
        """
        Return the transmissibility of M alone, settled, in closed form.

        For one line, with r = W/omega: the absolute one is sqrt((1 + (2 zeta r)^2)/D) and the
        relative one r^2/sqrt(D), where D = (1 - r^2)^2 + (2 zeta r)^2. A force that acts, too, is
        part of the motion. Infinite for an undamped rig at resonance.
        """
        base = rig.base_motion
        if not base.moves or rig.sweep_mode != 'off':
            return cls()
        pulls, shakes = _phasors(*rig.harmonics), _phasors(*base)
        # A constant is no motion about the mean.
        rates = np.array(sorted(rate for rate in {*pulls, *shakes} if rate))
        pull, shake = (np.array([lines[rate] for rate in rates]) for lines in (pulls, shakes))
        dynamic = dynamic_stiffness(rig, rates)
        if (pull[dynamic == 0.0] != 0.0).any():
            return cls(*[math.inf] * 3)
        moves = pull / np.where(dynamic == 0.0, 1.0, dynamic)
        moved = _size(shake)
        if not moved:
            return cls()
        own, shaken = _size(moves * rates**2), _size(shake * rates**2)
        return cls(_size(moves) / moved, _size(moves - shake) / moved, own / shaken)


def _phasors(
    sizes: Sequence[float], rates: Sequence[float], phases: Sequence[float]
) -> dict[float, complex]:
    """Return lines by their frequency; lines of one frequency add up."""
    lines: dict[float, complex] = defaultdict(complex)
    for size, rate, phase in zip(sizes, rates, phases, strict=True):
        lines[rate] += cmath.rect(size, phase)
    return lines


def _size(lines: NDArray[Any]) -> float:
    return float(np.linalg.norm(lines))
