# SPDX-License-Identifier: Apache-2.0
"""One period of a periodic motion as a curve."""

from __future__ import annotations

import numpy as np

from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.response import Array
from impact_damper_ros.orbits.solved_orbits import flights_of

#: Points per cycle of the force, and most points in a period, without the ends of its flights.
_PER_CYCLE, _MOST = 250, 1500


def orbit_curve(orbit: PeriodicOrbit) -> Array | None:
    """
    Return one period of a motion from just after its first impact.

    Parameters
    ----------
    orbit : PeriodicOrbit
        The motion.

    Returns
    -------
    array or None
        Rows of the phase (cycles of the force since its zero angle, not falling), X, X', Y and Y',
        shape (n, 5), in SI units. Each impact has rows before and after it; the last row is the
        first one a period later. None if the rig cannot move so, or has no impacts.
    """
    if not orbit.viable or not orbit.impacts:
        return None
    per_cycle = min(_PER_CYCLE, _MOST / orbit.cycles)
    time, *columns = flights_of(orbit).curve(per_cycle / orbit.cycle)
    rows = np.stack([orbit.phases[0] + time / orbit.cycle, *columns], axis=-1)
    last = max(rows[-1, 0], orbit.phases[0] + orbit.cycles), *rows[0, 1:]
    return np.vstack([rows, last])
