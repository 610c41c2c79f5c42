# SPDX-License-Identifier: Apache-2.0
"""The expected reversals of m in each flight, from the motion of M, before any replay."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .course import Course, Flags
from .unknowns import Unknowns
from .vibration import Array, Vibration

_POINTS = 80
_MOST = 4
#: Part of a flight after its start, or after a reversal, in which no reversal is sought.
_EARLY = 0.03
#: Reversals with less relative acceleration than this part of M's largest are held.
_FLAT = 0.1
_NEAR_STICK = 0.02


class Expected(NamedTuple):
    """Reversals of each flight, their fixed instants, and flights that can end at an impact."""

    reversals: list[Array]
    held: list[Flags]
    possible: Flags


def expected_reversals(course: Course, unknowns: Unknowns, vibration: Vibration) -> Expected:
    """Return the reversals of m if M moves as in the course."""
    rig, grip = unknowns.rig, unknowns.value(course.shared, 'grip')
    ratio = rig.damper_mass / rig.primary_mass
    span = np.diff(course.time)
    parts = np.linspace(0.0, 1.0, _POINTS + 1)[1:-1]
    times = course.time[:-1, None] + span[:, None] * parts
    first = -course.stop[:-1]
    push = ratio * (first * grip - first * unknowns.air)
    start = course.time[:-1, None]
    x, v = vibration.later(
        start, course.x[:-1, None], course.velocity[:-1, None], push[:, None], times - start
    )
    # The force per mass that m would need from its support to move with M
    joint = (vibration.acceleration(times, x, v, np.zeros(1)) + ratio * unknowns.slope) / (
        1.0 + ratio
    ) - unknowns.slope
    largest = vibration.stiffness**0.5 * np.abs(v).max(axis=1)
    reversals, held, possible = [], [], []
    for k in range(len(span)):
        direction, since, w = int(first[k]), course.time[k], course.damper_velocity[k]
        slope = unknowns.slope + first[k] * unknowns.air
        found: list[float] = []
        flat: list[bool] = []
        sticks = False
        step = span[k] / _POINTS
        for _ in range(_MOST):
            pull = slope - direction * grip
            ahead = direction * (w + pull * (times[k] - since) - v[k])
            late = np.flatnonzero((times[k] > since + _EARLY * span[k]) & (ahead < 0.0))
            if not len(late):
                break
            j = int(late[0])
            need = abs(joint[k, j])
            sticks |= bool(need < grip + _NEAR_STICK * need)
            instant = times[k, j] - 0.5 * step
            rate = abs(ahead[j] - ahead[j - 1]) / step if j else np.inf
            flat.append(bool(rate < _FLAT * largest[k]))
            found.append(float(instant))
            w, since, direction = w + pull * (instant - since), instant, -direction
        returns = course.stop[k + 1] == course.stop[k]
        right = len(found) % 2 == returns
        if not right:
            found = found[:-1] if found else [float(course.time[k] + 0.5 * span[k])]
            flat = [*flat, False][: len(found)]
            right = len(found) == 1 if returns else not found
        reversals.append(np.array(found))
        held.append(np.array(flat, bool) | (not right) | sticks)
        possible.append(right and not sticks)
    return Expected(reversals, held, np.array(possible, bool))
