# SPDX-License-Identifier: Apache-2.0
"""One period of a periodic motion as a curve."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from impact_damper_ros.orbits.flights import (
    Trajectory,
    flight_at_impact,
    follow_trajectory,
    machine_of,
)
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.response import Array
from impact_damper_ros.rig.state import place

#: Points per cycle of the force, and the most in a period, but for the ends of its flights.
_PER_CYCLE, _MOST = 250, 1500


def _period(orbit: PeriodicOrbit, late: int) -> tuple[int, Trajectory] | None:
    """
    Follow a motion for a period, begun some whole cycles late; None if that has no effect.

    A force of several harmonics may repeat after several cycles of the first one, while the phases
    of a motion are known up to whole cycles.
    """
    if late and len(orbit.parameters.force_frequencies) == 1:
        return None
    flight = flight_at_impact(
        machine_of(orbit.parameters),
        orbit.instants[0] + late * orbit.cycle,
        orbit.stops[0],
        orbit.x[0],
        orbit.primary_velocity_after[0],
        orbit.damper_velocity_after[0],
    )
    trajectory = follow_trajectory(flight, orbit.period)
    return None if trajectory is None else (late, trajectory)


def _open(orbit: PeriodicOrbit, trajectory: Trajectory) -> float:
    """Return how far a period is from being closed, m: X is the same before an impact."""
    return abs(trajectory.end.motion(0.0).x - orbit.x[0])


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
        shape (n, 5), in SI units. Each impact has two rows, before and after it; the last row is
        the first one a period later. None if the rig cannot move so, or has no impacts.
    """
    if not orbit.viable or not orbit.impacts:
        return None
    found = list(filter(None, map(partial(_period, orbit), range(orbit.cycles))))
    if not found:
        return None
    late, trajectory = min(found, key=lambda one: _open(orbit, one[1]))
    first = orbit.phases[0] + late
    per_cycle = min(_PER_CYCLE, _MOST / orbit.cycles)
    rows = []
    for part in trajectory.flights:
        run = part.flight.run
        count = max(2, math.ceil(per_cycle * part.duration / orbit.cycle))
        for tau in np.linspace(0.0, part.duration, count):
            motion = part.flight.motion(float(tau))
            phase = first + (part.start + float(tau)) / orbit.cycle
            # M and m move as one in a joint flight.
            travel = 0.0 if run.joint else motion.travel
            relative = 0.0 if run.joint else motion.relative_velocity
            rows.append((phase, motion.x, motion.velocity, place(run) + travel, relative))
    rows.append((max(rows[-1][0], first + orbit.cycles), *rows[0][1:]))
    return np.array(rows)
