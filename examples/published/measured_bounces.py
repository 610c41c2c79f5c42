# SPDX-License-Identifier: Apache-2.0
"""
Restitution over speed from the times at which a dropped ball bounces on a stop.

    python examples/published/measured_bounces.py [FILE]

Between two bounces the ball flies for T = 2 v/g, so that a microphone is enough: the times give
each speed, and the speeds the law R(v) = R + S (v - v_mean), S its slope. Fitted are the first
bounce, the speed after it, R and S, all times at once. Drag of the air is not in the model; it
makes a light ball seem less elastic at high speed. FILE has the times of all bounces from the
first to the last one, as CSV, or their sound (.wav) [examples/twin/bounces.csv].
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impact_damper_ros.fit.estimate import Estimate
from impact_damper_ros.measured.impacts import read_impacts
from impact_damper_ros.parameters.units import STANDARD_GRAVITY

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import show

Array = NDArray[np.float64]

LEAST_BOUNCES = 5


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
    residuals : ndarray
        Times less the fitted ones, s.
    """

    restitution: Estimate
    slope: Estimate
    mean_speed: float
    residuals: Array


def fit_rebounds(times: Array, gravity: float = STANDARD_GRAVITY) -> Rebounds:
    """
    Fit R(v) to the times of the bounces of a ball on a level plate.

    A flight that is longer than that before it, so that a bounce is missing, is a ValueError.
    """
    times = np.asarray(times, float)
    if len(times) < LEAST_BOUNCES:
        raise ValueError(
            f'{len(times)} bounces were measured: give {LEAST_BOUNCES} at least, the first ones'
        )
    spans = np.diff(times)
    if not (spans > 0.0).all():
        at = int(np.flatnonzero(~(spans > 0.0))[0])
        raise ValueError(f'times do not rise after {times[at]!r} s: sort them')
    ratios = spans[1:] / spans[:-1]
    if (ratios > 1.0).any():
        at = int(np.flatnonzero(ratios > 1.0)[0])
        raise ValueError(
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
        -np.asarray(best.fun),
    )


def main() -> None:
    """Fit the bounces of a file, and print."""
    twin = Path(__file__).resolve().parents[1] / 'twin'
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else twin / 'bounces.csv'
    found = fit_rebounds(read_impacts(path)[0])
    rows: list[tuple[Any, ...]] = [
        (name, one.value, one.standard_deviation, *one.interval)
        for name, one in (('R', found.restitution), ('S [s/m]', found.slope))
    ]
    print(f'{len(found.residuals)} bounces; R is that at {found.mean_speed:.4g} m/s', end='\n\n')
    show(('', 'value', '±', 'from', 'to'), rows)


if __name__ == '__main__':
    main()
