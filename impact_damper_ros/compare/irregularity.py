"""The largest Lyapunov exponent along a recorded motion."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.orbits.event_map import follow_trajectory, origin_at
from impact_damper_ros.orbits.irregularity import Indications
from impact_damper_ros.orbits.multipliers import event_matrices, state_rates
from impact_damper_ros.rig.mode import REST_1, REST_2, rig_constants

from .recorded_stretch import ForceClock, RecordedImpacts

__all__ = ['MOST_IMPACTS', 'largest_exponent']


#: Impacts on which the exponent is measured, at most, and the parts for its error.
MOST_IMPACTS = 1500
_PARTS = 8
# A stamp is rounded to the nanosecond; the flight ends as much before the impact.
_GUARD_S = 2e-9


def largest_exponent(clock: ForceClock, impacts: RecordedImpacts) -> Indications | None:
    """
    Measure how fast motions next to the recorded one diverge from it or converge to it.

    Between two recorded impacts the theory of the logged rig carries a deviation in closed form,
    through reversals too; at every impact the recorded velocities give the saltation matrix.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig.
    impacts : RecordedImpacts
        Impacts in a row; the last `MOST_IMPACTS` count.

    Returns
    -------
    Indications or None
        The exponent per cycle of the force, without a spread; None if the impacts are too few.
    """
    impacts = impacts[-MOST_IMPACTS:]
    if len(impacts) < 2 * _PARTS:
        return None
    rig = clock.counted_from_zero()
    machine = rig_constants(rig)
    since = impacts.time - clock.zero
    first = impacts.stop == 1
    air = np.where(first, -machine.air, machine.air)
    after = (impacts.velocity_after, impacts.damper_velocity_after)
    before = (impacts.velocity_before(rig), impacts.damper_velocity_before(rig))
    drive = clock.force(impacts.time) / rig.primary_mass
    rates_before, rates_after = (
        state_rates(machine, drive, impacts.x, *speeds, np.sign(speeds[1] - speeds[0]), push)
        for speeds, push in ((before, np.append(air[0], air[:-1])), (after, air))
    )
    everywhere = np.ones(len(impacts), dtype=bool)
    hits = event_matrices(
        machine.mass_ratio,
        everywhere,
        np.where(first, machine.restitution_1, machine.restitution_2),
        rates_before,
        rates_after,
        everywhere,
    )
    scale = np.array([1.0, rig.omega, 1.0, rig.omega])
    deviation = np.array([1.0, 0.6, -0.8, 0.4]) / scale
    growth = np.zeros(len(impacts))
    for i in range(1, len(impacts)):
        j = i - 1
        stop = int(impacts.stop[j])
        velocity = float(after[0][j])
        relative = float(after[1][j]) - velocity
        resting = 0 if relative else (REST_1 if stop == 1 else REST_2)
        beyond = 0.0 if stop == 1 else -2.0 * machine.stop
        origin = origin_at(
            machine,
            float(since[j]),
            float(impacts.x[j]),
            velocity,
            beyond,
            relative,
            resting,
            stop,
        )
        duration = float(impacts.time[i] - impacts.time[j])
        course = follow_trajectory(machine, origin, max(duration - _GUARD_S, 0.0))
        if course is None or before[0][i] == before[1][i]:
            continue
        deviation = hits[i] @ (course.matrix @ deviation)
        size = float(np.linalg.norm(deviation * scale))
        if size == 0.0:
            return Indications(-math.inf, 0.0, 0)
        growth[i] = math.log(size)
        deviation /= size
    phase = clock.phase(impacts.time)
    span = float(phase[-1] - phase[0])
    if span < _PARTS:
        return None
    part = np.minimum(((phase - phase[0]) * (_PARTS / span)).astype(np.int64), _PARTS - 1)
    rate = np.bincount(part, growth, _PARTS) * (_PARTS / span)
    error = float(rate.std(ddof=1)) / math.sqrt(_PARTS)
    return Indications(float(growth.sum()) / span, error, int(span))
