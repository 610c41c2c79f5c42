# SPDX-License-Identifier: Apache-2.0
"""
Ice against ice: the law of restitution of the package beside a measured one.

    python examples/published/ice.py

F. G. Bridges, A. Hatzes and D. N. C. Lin, Nature 309 (1984), 333-335, let frosted balls of ice hit
ice at 0.015 to 5.1 cm/s, and summarise what they measured by R = 0.32 v^-0.234, v in cm/s. A power
has no R at speed 0. Fitted to it over that range, in the logarithm of the speed, are R and v_c of
R (1 + v/v_c)^-p, for p = 1/4 of plastic contact and for their exponent.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impact_damper_ros import RigParameters
from impact_damper_ros.motion.impact import bounce

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import options, show

Array = NDArray[np.float64]

#: m/s
SPEEDS = np.geomspace(0.015e-2, 5.1e-2, 60)
EXPONENTS = (0.25, 0.234)


def measured(speed: Array) -> Array:
    """Return R of ice at a speed, m/s."""
    return np.asarray(0.32 * (100.0 * speed) ** -0.234)


class Fit(NamedTuple):
    """The law with one exponent, and the largest difference of R."""

    rig: RigParameters
    apart: float


def fitted(exponent: float) -> Fit:
    """Fit R at speed 0, at most 1, and v_c for an exponent."""

    def rig_of(unknowns: Array) -> RigParameters:
        restitution, logarithm = unknowns.tolist()
        return RigParameters(
            restitution_1=restitution,
            restitution_2=restitution,
            restitution_speed=float(np.exp(logarithm)),
            restitution_exponent=exponent,
        )

    def differences(unknowns: Array) -> Array:
        rig = rig_of(unknowns)
        return np.asarray(bounce(rig, rig.restitution_1, SPEEDS)[0] - measured(SPEEDS))

    bounds = ([0.0, np.log(1e-6)], [1.0, np.log(1.0)])
    best = least_squares(differences, [0.8, np.log(1e-3)], bounds=bounds, x_scale=[0.1, 1.0])
    return Fit(rig_of(best.x), float(np.abs(best.fun).max()))


def main() -> None:
    """Fit and print."""
    options(__doc__)
    rows = []
    for exponent in EXPONENTS:
        rig, apart = fitted(exponent)
        v_c = 100.0 * rig.restitution_speed
        rows.append((exponent, rig.restitution_1, f'{v_c:.4f}', f'{apart:.3f}'))
    show(('p', 'R', 'v_c [cm/s]', 'largest difference of R'), rows)


if __name__ == '__main__':
    main()
