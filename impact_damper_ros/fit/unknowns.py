# SPDX-License-Identifier: Apache-2.0
"""
The shared unknowns of a fit: parameters of all flights, and their places.

Restitution enters by alpha = (M + m)/(m (1 + R)), in which the laws are linear: a jump J of X'
comes from an approach at alpha J. Where R falls with the speed, alpha is that of R(0). Friction
enters as an acceleration gamma g cos(angle).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.impact import bounce
from impact_damper_ros.motion.state import incline
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .vibration import Array

#: Further unknowns: the offset of the sensor, the delay of the force, and 1/v_c of the law of
#: restitution, s/m.
EXTRAS = ('bias', 'force_delay', 'slowness')
#: A slowness that counts as zero, s/m, where derivatives by the slowness are taken.
_NO_SLOWNESS = 1e-8
#: Least v/v_c; from -1 on the law has no value.
_LEAST_RISE = -0.5


class Constant(NamedTuple):
    """A constant of the file: its relative deviation, and the sentence on another value."""

    uncertainty: float
    meaning: str


#: Constants of the file, which are fitted on request only. All masses and forces are determined to
#: a common factor: M is their measure.
CONSTANTS = {
    'damper_mass': Constant(0.005, 'm differs from the file, which --also damper_mass fits'),
    'primary_mass': Constant(0.0, 'M differs from the file, which --also primary_mass fits'),
    'force_amplitudes': Constant(0.01, 'the force is not as large as described'),
    'base_amplitudes': Constant(0.01, 'the base does not move as far as described'),
}


def scaled_constant(rig: RigParameters, name: str, part: float) -> RigParameters | None:
    """Return a rig with a constant that is larger by a part; None where it is zero."""
    value = getattr(rig, name)
    if not np.any(value):
        return None
    larger = np.multiply(value, 1.0 + part)
    return rig.replace(**{name: tuple(larger.tolist()) if np.ndim(value) else float(larger)})


def later(rig: RigParameters, delay: float) -> RigParameters:
    """Return a rig whose force and base are delayed, s."""
    if not delay:
        return rig
    changes = {}
    for what in ('force', 'base'):
        frequencies, phases = (
            getattr(rig, f'{what}_{name}') for name in ('frequencies', 'phases')
        )
        turned = [p - w * delay for w, p in zip(frequencies, phases, strict=True)]
        changes[f'{what}_phases'] = tuple(
            p if abs(p) < math.tau else math.remainder(p, math.tau) for p in turned
        )
    return rig.replace(**changes)


class Fall(NamedTuple):
    """The fall of restitution, in the form for `bounce`."""

    restitution_slowness: float
    restitution_exponent: float


@cache
def _names(separate: bool, slides: bool, extras: tuple[str, ...]) -> tuple[str, ...]:
    alphas = ('alpha_1', 'alpha_2') if separate else ('alpha_1',)
    return ('stiffness', 'damping', *alphas, *('grip',) * slides, 'gap', *extras)


class Unknowns(NamedTuple):
    """
    The shared unknowns, in order.

    Attributes
    ----------
    rig : RigParameters
        The known parameters: masses, force, angle.
    separate : bool
        Whether the stops have different restitutions.
    extras : tuple of str
        Further unknowns, of `EXTRAS`.
    uncertain : mapping
        Relative standard deviations of constants that differ from those of `CONSTANTS`; infinite
        for a fitted constant.
    """

    rig: RigParameters
    separate: bool
    extras: tuple[str, ...]
    uncertain: Mapping[str, float] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return _names(self.separate, self.normal > 0.0, self.extras)

    def column(self, name: str) -> int:
        """Return the place of an unknown; -1 if it is not fitted."""
        return self.names.index(name) if name in self.names else -1

    def value(self, shared: Array, name: str) -> float:
        """Return the value of an unknown, or its fixed value where it is not fitted."""
        if name in self.names:
            return float(shared[self.names.index(name)])
        return 0.0

    def alpha_columns(self) -> tuple[int, int]:
        """Return the places of the alpha of stop 1 and of stop 2."""
        first = self.names.index('alpha_1')
        return first, first + self.separate

    def start(
        self, stiffness: float, damping: float, alphas: Array, grip: float, gap: float
    ) -> Array:
        """Return the shared unknowns of a guess."""
        grips = [grip] if self.normal > 0.0 else []
        known = [stiffness, damping, *alphas[: 1 + self.separate], *grips, gap]
        return np.array([*known, *[0.0] * len(self.extras)])

    @property
    def share(self) -> float:
        """The share m/(M + m)."""
        return self.rig.damper_mass / (self.rig.primary_mass + self.rig.damper_mass)

    @property
    def normal(self) -> float:
        """The acceleration g cos(angle) that presses m to its support, m/s^2."""
        return self.rig.gravity * incline(self.rig.angle)[1]

    @property
    def slope(self) -> float:
        """The acceleration g sin(angle) of m along the axis, m/s^2."""
        return self.rig.gravity * incline(self.rig.angle)[0]

    @property
    def air(self) -> float:
        """The acceleration of m by compressed air, m/s^2."""
        return self.rig.air_force / self.rig.damper_mass

    def restitution(self, alpha: Any) -> Any:
        """Return the coefficient of restitution of an alpha, or of many."""
        return 1.0 / (self.share * alpha) - 1.0

    def alpha(self, restitution: Any) -> Any:
        """Return the alpha of a coefficient of restitution, or of many."""
        return 1.0 / (self.share * (1.0 + restitution))

    def alpha_at(
        self, shared: Array, alpha: Array, speed: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return alpha at speeds, and its derivatives by alpha at rest, speed and slowness."""
        nothing = np.zeros(len(alpha))
        if 'slowness' not in self.names:
            return alpha, nothing + 1.0, nothing, nothing
        slowness = self.value(shared, 'slowness')
        slowness = slowness if abs(slowness) > _NO_SLOWNESS else _NO_SLOWNESS
        slowness = max(slowness, _LEAST_RISE / float(speed.max(initial=_NO_SLOWNESS)))
        at_rest = self.restitution(alpha)
        part, slope = bounce(Fall(slowness, self.rig.restitution_exponent), 1.0, speed)
        there = self.alpha(at_rest * part)
        # v dR/dv, which is s dR/ds
        by_fall = -self.share * there**2 * at_rest * (slope - part)
        return there, part * (there / alpha) ** 2, by_fall / speed, by_fall / slowness

    def rig_of(self, shared: Array, least_grip: float = 0.0) -> RigParameters:
        """Return the rig of shared unknowns; inadmissible values are set to the nearest."""
        first, second = self.alpha_columns()
        grip = max(self.value(shared, 'grip'), least_grip)
        slowness = self.value(shared, 'slowness')
        return later(self.rig, self.value(shared, 'force_delay')).replace(
            stiffness=self.value(shared, 'stiffness'),
            damping=self.value(shared, 'damping'),
            restitution_1=min(max(self.restitution(shared[first]), 0.0), 1.0),
            restitution_2=min(max(self.restitution(shared[second]), 0.0), 1.0),
            friction=grip / self.normal if self.normal > 0.0 else self.rig.friction,
            restitution_speed=1.0 / max(slowness, 1e-9) if slowness > _NO_SLOWNESS else 0.0,
            gap=max(self.value(shared, 'gap'), 1e-9),
        )
