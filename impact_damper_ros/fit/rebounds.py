# SPDX-License-Identifier: Apache-2.0
"""
Restitution over speed from the times at which a dropped ball bounces on a stop.

Between two bounces the ball flies for T = 2 v/g, so that a microphone is enough: the times give
each speed, and the speeds the law R(v) = R + S (v - v_mean), S its slope. Fitted are the first
bounce, the speed after it, R and S, all times at once. Drag of the air is not in the model; it
makes a light ball seem less elastic at high speed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from .estimate import Estimate
from .vibration import Array

LEAST_BOUNCES = 5
STANDARD_GRAVITY = 9.80665


class ReboundError(ValueError):
    """Times of bounces from which no restitution can be had."""


class Rebounds(NamedTuple):
    """
    Restitution of a bouncing ball.

    Attributes
    ----------
    restitution : Estimate
        At the mean speed.
    slope : Estimate
        Its change with the speed, s/m.
    mean_speed : float
        Mean of the speeds before the bounces, m/s.
    speeds, restitutions : ndarray
        Of each bounce between two flights: speed before it, and ratio of the two flights.
    residuals : ndarray
        Times less the fitted ones, s.
    deviation : float
        Standard deviation of a time, from the residuals, s.
    """

    restitution: Estimate
    slope: Estimate
    mean_speed: float
    speeds: Array
    restitutions: Array
    residuals: Array
    deviation: float


def fit_rebounds(times: Array, gravity: float = STANDARD_GRAVITY) -> Rebounds:
    """
    Fit R(v) to the times of the bounces of a ball on a level plate.

    Parameters
    ----------
    times : ndarray
        Instants of all bounces in order, none left out, s.
    gravity : float, optional
        In m/s^2.

    Raises
    ------
    ReboundError
        If there are fewer than five times, they do not rise, or a flight is longer than that
        before it, so that a bounce is missing.
    """
    times = np.asarray(times, float)
    if len(times) < LEAST_BOUNCES:
        raise ReboundError(
            f'{len(times)} bounces were measured: give {LEAST_BOUNCES} at least, the first ones'
        )
    spans = np.diff(times)
    if not (spans > 0.0).all():
        at = int(np.flatnonzero(~(spans > 0.0))[0])
        raise ReboundError(f'times do not rise after {times[at]!r} s: sort them')
    ratios = spans[1:] / spans[:-1]
    if (ratios > 1.0).any():
        at = int(np.flatnonzero(ratios > 1.0)[0])
        raise ReboundError(
            f'the flight after {times[at + 1]:.6g} s is longer than that before it: a bounce at '
            f'about {times[at + 1]:.6g} s is missing or is none'
        )
    before = 0.5 * gravity * spans[:-1]
    mean = float(before.mean())
    level = float(np.average(ratios, weights=before))

    def expected(unknowns: Array) -> Array:
        first, speed, restitution, slope = unknowns.tolist()
        found = [first]
        for _ in range(len(times) - 1):
            found.append(found[-1] + 2.0 * speed / gravity)
            speed *= restitution + slope * (speed - mean)
        return np.array(found)

    start = [times[0], before[0], level, 0.0]
    best = least_squares(lambda u: expected(u) - times, start, x_scale='jac', xtol=1e-12)
    free = max(1, len(times) - 4)
    deviation = float(np.sqrt(best.fun @ best.fun / free))
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * deviation**2
    sizes = np.sqrt(np.diag(covariance))
    return Rebounds(
        Estimate.normal(float(best.x[2]), float(sizes[2])),
        Estimate.normal(float(best.x[3]), float(sizes[3]), 's/m'),
        mean,
        before,
        ratios,
        -np.asarray(best.fun),
        deviation,
    )
