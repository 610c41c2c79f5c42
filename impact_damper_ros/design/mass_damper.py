# SPDX-License-Identifier: Apache-2.0
"""
The tuned mass damper of the same mass, with which an impact damper is compared.

References
----------
1. J. P. Den Hartog, "Mechanical Vibrations", 4th ed., 1956, section 3.3: a mass on a spring and a
   dashpot, tuned to 1/(1 + mu), so that both fixed points of the response have the same height,
   and damped so that both are maxima.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.rig_parameters import RigParameters

Array = NDArray[np.float64]


def tuning(mass_ratio: float) -> tuple[float, float]:
    """Return Den Hartog's tuning: natural frequency over that of M, and damping ratio."""
    return 1.0 / (1.0 + mass_ratio), math.sqrt(3.0 * mass_ratio / (8.0 * (1.0 + mass_ratio)))


def mass_damper_response(rig: RigParameters, frequencies: Array) -> Array:
    """
    Return the amplitude of X of a rig with a tuned mass damper in place of its impact damper, m.

    Parameters
    ----------
    rig : RigParameters
        The rig; its first harmonic shakes it, of a force or of the base.
    frequencies : ndarray
        Circular frequencies, rad/s.
    """
    m, k, c = rig.damper_mass, rig.stiffness, rig.damping
    ratio, zeta = tuning(rig.mass_ratio)
    own = ratio * rig.omega
    spring, dashpot = m * own**2, 2.0 * m * own * zeta
    link = spring + 1j * frequencies * dashpot
    inertia = -m * frequencies**2
    # What the mass on its spring does to M, as a dynamic stiffness
    reaction = inertia * link / (inertia + link)
    force = np.array([abs(rig.with_first_frequency(w).first_harmonic[0]) for w in frequencies])
    dynamic = k - rig.primary_mass * frequencies**2 + 1j * frequencies * c + reaction
    response: Array = force / np.abs(dynamic)
    return response


def bare_response(rig: RigParameters, frequencies: Array) -> Array:
    """Return the amplitude of X of M alone, m."""
    return np.array([rig.with_first_frequency(w).response_amplitude for w in frequencies])
