# SPDX-License-Identifier: Apache-2.0
"""The rigs of Bapat (1995), section 3."""

from __future__ import annotations

import math

from impact_damper_ros import RigParameters

#: K = M = F = 1, m = 0.042, C = 0.01, d = 37, R1 = R2 = 0.75; horizontal, no friction, r = 1.
BASIC = RigParameters(gravity=9.81)
#: The same above the resonance, r = 1.02.
ABOVE = BASIC.replace(force_frequencies=(1.02,))
#: The rig of Figure 4: d = 50 m, inclined by 15 degrees, friction 0.5.
TILTED = BASIC.replace(gap=50.0, angle=math.radians(15.0), friction=0.5)
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

#: The three operations that Figure 2 compares: what they change, and their legends.
OPERATIONS = {
    'horizontal': {'angle': 0.0, 'friction': 0.0},
    'inclined': {'angle': math.radians(45.0), 'friction': 0.0},
    'friction': {'angle': math.radians(45.0), 'friction': 0.5},
}
LABELS = {
    'horizontal': 'horizontal, no friction (θ = 0°, γ = 0)',
    'inclined': 'inclined, no friction (θ = 45°, γ = 0)',
    'friction': 'inclined, with friction (θ = 45°, γ = 0.5)',
}


def scaled_rig(rig: RigParameters, omega: float) -> RigParameters:
    """Return a rig with another natural frequency, and the same M, zeta, r and F/K."""
    ratio = omega / rig.omega
    return rig.replace(
        stiffness=rig.stiffness * ratio**2,
        damping=rig.damping * ratio,
        force_amplitudes=tuple(force * ratio**2 for force in rig.force_amplitudes),
        force_frequencies=tuple(rate * ratio for rate in rig.force_frequencies),
    )


# Rigs along the axes of the figures


def at_angle(rig: RigParameters, angle: float) -> RigParameters:
    """Return a rig at another angle, degrees."""
    return rig.replace(angle=math.radians(angle))


def with_air(rig: RigParameters, share: float) -> RigParameters:
    """Return a rig with an air force that is a multiple of the friction force on the level."""
    return rig.replace(air_force=share * rig.friction * rig.damper_mass * rig.gravity)
