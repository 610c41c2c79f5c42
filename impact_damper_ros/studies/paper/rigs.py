"""The rigs of Bapat (1995), section 3, and the parameters that its figures vary."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from impact_damper_ros.rig import RigParameters

#: K = M = F = 1, m = 0.042, C = 0.01, d = 37, R1 = R2 = 0.75; horizontal, no friction, r = 1.
BASIC = RigParameters(gravity=9.81)

#: The vertical rig of the last example: one stop, Omega = 10; A Omega^2/g is varied by g.
VERTICAL = RigParameters(
    force_amplitudes=(0.8,),
    force_frequencies=(10.0,),
    damping=0.1,
    damper_mass=0.01,
    angle=0.5 * math.pi,
    gravity=1.0,
    one_sided=True,
)


@dataclass(frozen=True)
class Operation:
    """One of the three operations that Figure 2 compares."""

    key: str
    label: str  # entry in legends
    #: Degrees.
    angle: float
    friction: float

    def rig(self, basic: RigParameters, gravity: float) -> RigParameters:
        """Return the rig in this operation."""
        return basic.replace(
            angle=math.radians(self.angle), friction=self.friction, gravity=gravity
        )


OPERATIONS = (
    Operation('horizontal', 'horizontal, no friction (θ = 0°, γ = 0)', 0.0, 0.0),
    Operation('inclined', 'inclined, no friction (θ = 45°, γ = 0)', 45.0, 0.0),
    Operation('friction', 'inclined, with friction (θ = 45°, γ = 0.5)', 45.0, 0.5),
)


def scaled_rig(rig: RigParameters, omega: float) -> RigParameters:
    """Return a rig with another natural frequency, and the same M, zeta, r and F/K."""
    ratio = omega / rig.omega
    return rig.replace(
        stiffness=rig.stiffness * ratio**2,
        damping=rig.damping * ratio,
        force_amplitudes=tuple(force * ratio**2 for force in rig.force_amplitudes),
        force_frequencies=tuple(rate * ratio for rate in rig.force_frequencies),
    )


@dataclass(frozen=True)
class Variable:
    """The parameter along the horizontal axis of a figure."""

    key: str  # name of its CSV column
    label: str  # label of the axis
    apply: Callable[[RigParameters, float], RigParameters]  # returns the rig at a value


def _with_air(rig: RigParameters, share: float) -> RigParameters:
    """Set the air force as a multiple of the friction force on the level."""
    return rig.replace(air_force=share * rig.friction * rig.damper_mass * rig.gravity)


VARIABLES = {
    v.key: v
    for v in (
        Variable('gap', 'gap $d$ [m]', lambda rig, v: rig.replace(gap=v)),
        Variable(
            'angle',
            'angle of inclination $θ$ [°]',
            lambda rig, v: rig.replace(angle=math.radians(v)),
        ),
        Variable(
            'frequency',
            'input frequency $Ω$ [rad/s]',
            lambda rig, v: rig.replace(force_frequencies=(v,)),
        ),
        Variable('friction', 'friction coefficient $γ$', lambda rig, v: rig.replace(friction=v)),
        Variable('omega', 'natural frequency $ω$ [rad/s]', scaled_rig),
        Variable('air', 'air force over friction force, $p/(mγg)$', _with_air),
        Variable('gravity', 'gravity $g$ [m/s²]', lambda rig, v: rig.replace(gravity=v)),
    )
}
