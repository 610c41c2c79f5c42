# SPDX-License-Identifier: Apache-2.0
"""One period of a periodic motion as a curve."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.response import Array
from impact_damper_ros.orbits.solved_orbits import MOST_EVENTS, after_impact
from impact_damper_ros.rig.rig import Events, Outcome

#: Points per cycle of the force, and the most in a period, but for the ends of its flights.
_PER_CYCLE, _MOST = 250, 1500
#: Relative error of the end of a period.
_END_ERROR = 1e-9


def _moments(rows: Events, side: str = '') -> Array:
    """Return time, X, X', Y and Y' of samples, or of events on one side, shape (n, 5)."""
    x, velocity = rows['x'], rows[f'primary_velocity{side}']
    y = rows['y'] if side else rows['z'] - x
    relative = rows[f'damper_velocity{side}'] - velocity
    return np.stack([rows['time'], x, velocity, y, relative], axis=-1)


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
    run = after_impact(orbit, orbit.parameters).run(orbit.period, most_events=MOST_EVENTS)
    if run.outcome is not Outcome.COMPLETE:
        return None
    events = run.events
    # An impact and the rest after it have one instant
    events = events[np.diff(events['time'], prepend=-1.0) > 0.0]
    per_cycle = min(_PER_CYCLE, _MOST / orbit.cycles)
    instants = [0.0]
    for start, end in pairwise([0.0, *events['time'], orbit.period]):
        count = max(2, math.ceil(per_cycle * (end - start) / orbit.cycle))
        instants += np.linspace(start, end, count)[1:-1].tolist()
    again = after_impact(orbit, orbit.parameters)
    samples = again.run(orbit.period, [*instants, orbit.period]).samples
    # The impact that ends the period may, by round-off, be within it
    ends = events['time'] > (1.0 - _END_ERROR) * orbit.period
    rows = np.concatenate(
        [
            _moments(samples[:-1] if ends.any() else samples),
            _moments(events, '_before'),
            _moments(events[~ends], '_after'),
        ]
    )
    rows = rows[np.argsort(rows[:, 0], kind='stable')]
    rows[:, 0] = orbit.phases[0] + rows[:, 0] / orbit.cycle
    last = max(rows[-1, 0], orbit.phases[0] + orbit.cycles), *rows[0, 1:]
    return np.vstack([rows, last])
