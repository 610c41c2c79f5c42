# SPDX-License-Identifier: Apache-2.0
"""
Restitution over speed from the times at which a dropped ball bounces on a stop.

    python examples/published/measured_bounces.py [FILE] [--exponent P]

Between two bounces the ball flies for T = 2 v/g, so that a microphone is enough: the times give
each speed, and the speeds the law R(v) = R (1 + v/v_c)^-p. Fitted are the first bounce, the speed
after it, R and 1/v_c for a given p [0.25], all times at once; restitution_1 and restitution_2 are
R, restitution_speed is v_c. R is constant where 1/v_c may be 0. Drag of the air is not in the
model; it makes a light ball seem less elastic at high speed. FILE has the times of all bounces
from the first to the last one, as CSV, or their sound (.wav) [examples/twin/bounces.csv].
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from impact_damper_ros.fit.estimate import Estimate
from impact_damper_ros.measured.impacts import read_impacts
from impact_damper_ros.motion.impact import bounce
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
        That of slow bounces.
    slowness : Estimate
        1/v_c, s/m.
    speeds : tuple of float
        Least and largest speed before a bounce, m/s.
    residuals : ndarray
        Times less the fitted ones, s.
    """

    restitution: Estimate
    slowness: Estimate
    speeds: tuple[float, float]
    residuals: Array


def fit_rebounds(
    times: Array, gravity: float = STANDARD_GRAVITY, exponent: float = 0.25
) -> Rebounds:
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
    level = float(np.average(ratios, weights=before))

    def expected(unknowns: Array) -> Array:
        first, speed, restitution, slowness = unknowns.tolist()
        law = SimpleNamespace(restitution_slowness=slowness, restitution_exponent=exponent)
        found = [first]
        for _ in range(len(times) - 1):
            found.append(found[-1] + 2.0 * speed / gravity)
            speed *= bounce(law, restitution, speed)[0]
        return np.array(found)

    start = [times[0], before[0], level, 0.0]
    # 1 + v/v_c is positive
    least = [-np.inf, 0.0, 0.0, -0.9 / before.max()]
    best = least_squares(
        lambda u: expected(u) - times, start, bounds=(least, np.inf), x_scale='jac', xtol=1e-12
    )
    free = max(1, len(times) - 4)
    deviation = float(np.sqrt(best.fun @ best.fun / free))
    covariance = np.linalg.pinv(best.jac.T @ best.jac) * deviation**2
    sizes = np.sqrt(np.diag(covariance))
    halves = student.ppf(0.975, free) * sizes
    restitution, slowness = (
        Estimate(
            float(best.x[k]),
            float(sizes[k]),
            (float(best.x[k] - halves[k]), float(best.x[k] + halves[k])),
            unit=unit,
        )
        for k, unit in ((2, ''), (3, 's/m'))
    )
    speeds = float(before.min()), float(before.max())
    return Rebounds(restitution, slowness, speeds, -np.asarray(best.fun))


def main() -> None:
    """Fit the bounces of a file, and print."""
    twin = Path(__file__).resolve().parents[1] / 'twin'
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('file', nargs='?', type=Path, default=twin / 'bounces.csv')
    parser.add_argument('--exponent', type=float, default=0.25)
    arguments = parser.parse_args()
    found = fit_rebounds(read_impacts(arguments.file)[0], exponent=arguments.exponent)
    rows: list[tuple[Any, ...]] = [
        (name, one.value, one.standard_deviation, *one.interval)
        for name, one in (('R', found.restitution), ('1/v_c [s/m]', found.slowness))
    ]
    slow, fast = found.speeds
    print(f'{len(found.residuals)} bounces at {slow:.3g} to {fast:.3g} m/s', end='\n\n')
    show(('', 'value', '±', 'from', 'to'), rows)
    low, high = found.slowness.interval
    constant = low <= 0.0
    print(
        f'\nR may be constant: v_c is above {1.0 / high:.3g} m/s'
        if constant
        else f'\nv_c is {1.0 / found.slowness.value:.4g} m/s, {1.0 / high:.3g} to {1.0 / low:.3g}'
    )


if __name__ == '__main__':
    main()
