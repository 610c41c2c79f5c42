# SPDX-License-Identifier: Apache-2.0
"""A first course of the motion from the data alone: impacts, K and C, then the parameters of m."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .course import Course
from .first_guess import regressed
from .partition import Edges, Record, fit_vibration, jumps_between, partition
from .unknowns import Unknowns
from .vibration import Array, Vibration

#: What a further impact must take from the sum of squares, in variances; where one was measured;
#: and how much more in the first round, in which K and C are guesses.
PENALTY, _PENALTY_MEASURED, _FIRST_ROUND = 24.0, 6.0, 3.0
_ROUNDS = 4
#: Changes of K, and of C, after which the impacts are looked for again.
_CHANGE, _CHANGE_DAMPING = 1e-3, 2e-2


class TooFewImpacts(Exception):  # noqa: N818
    """Fewer impacts than a fit needs; `count` of them."""

    def __init__(self, count: int) -> None:
        super().__init__(f'{count} impacts')
        self.count = count


#: Least impacts that a fit is made from.
LEAST_IMPACTS = 6


def matched(times: Array, measured: Array, limit: float) -> NDArray[np.int64]:
    """Return the measured time that belongs to each instant, -1 for none; each belongs to one."""
    found = np.full(len(times), -1)
    if not len(measured) or not len(times):
        return found
    apart = np.abs(measured[None, :] - times[:, None])
    nearest = apart.argmin(1)
    back = apart.argmin(0)
    both = (back[nearest] == np.arange(len(times))) & (apart.min(1) < limit)
    found[both] = nearest[both]
    return found


def _penalties(record: Record, measured: Array, deviation: float) -> Array:
    """Return the penalty of a cut before each sample."""
    cuts = np.full(len(record.time), PENALTY)
    step = float(np.median(np.diff(record.time)))
    around = int(np.ceil(2.0 * deviation / step)) if deviation > 0.2 * step else 0
    at = np.searchsorted(record.time, measured)
    for shift in range(-around, around + 1):
        cuts[np.clip(at + shift, 0, len(cuts) - 1)] = _PENALTY_MEASURED
    return cuts


def first_course(
    record: Record,
    unknowns: Unknowns,
    deviation: float,
    measured: Array,
    impact_deviation: float,
) -> Course:
    """
    Return the course that partition and regression find.

    Raises
    ------
    TooFewImpacts
        If there are fewer than `LEAST_IMPACTS`.
    """
    rig = unknowns.rig
    stiffness, damping = rig.stiffness, max(rig.damping, 1e-6 * rig.stiffness / rig.omega)
    cuts = _penalties(record, measured, impact_deviation)
    edges: Edges = np.array([0, len(record.time)])
    for number in range(_ROUNDS):
        vibration = Vibration.of(rig, stiffness, damping)
        more = 1.0 if number or len(measured) else _FIRST_ROUND
        edges = partition(record, vibration, deviation, cuts * more)
        before = stiffness, damping
        stiffness, damping = fit_vibration(record, rig, edges, before, deviation)
        if (
            abs(stiffness / before[0] - 1.0) < _CHANGE
            and abs(damping / before[1] - 1.0) < _CHANGE_DAMPING
        ):
            break
    jumps = jumps_between(record, Vibration.of(rig, stiffness, damping), edges, measured)
    if len(jumps.time) < LEAST_IMPACTS:
        raise TooFewImpacts(len(jumps.time))
    stops = np.where(jumps.jump >= 0.0, 1, -1)
    rate = float(np.sqrt(stiffness / rig.primary_mass))
    alphas, grip, gap = regressed(unknowns, jumps, stops, rate)
    shared = unknowns.start(stiffness, damping, alphas, grip, gap)
    ratio = rig.primary_mass / rig.damper_mass
    alpha = np.where(stops == 1, alphas[0], alphas[1])
    begins = np.zeros(len(stops), bool)
    begins[0] = True
    return Course(
        shared,
        jumps.time,
        jumps.x,
        jumps.velocity + jumps.jump,
        jumps.velocity + (alpha - ratio) * jumps.jump,
        stops,
        begins,
        matched(jumps.time, measured, max(6.0 * impact_deviation, 1e-9)),
    )
