# SPDX-License-Identifier: Apache-2.0
"""
A dropped ball that comes to rest: the intervals between its rebounds.

    python examples/published/rebounds.py

A. D. Bernstein, American Journal of Physics 45 (1977), 41-44, has the method: the intervals
between the sounds of the rebounds give the coefficient of restitution.

With a constant R the n-th interval after a fall from h is 2 sqrt(2h/g) R^n, and the ball rests
after sqrt(2h/g) (1 + R)/(1 - R), with infinitely many rebounds. R = 0.942 is of a ping-pong ball
and 0.896 of a golf ball; drag and the dependence of R on the speed are left out.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import options, show

BALLS = {'ping-pong ball': 0.942, 'golf ball': 0.896}
HEIGHT, GRAVITY = 0.5, 9.81
#: The floor: M on a spring of 1 kHz, a thousand million times as heavy as the ball.
FLOOR = RigParameters(
    primary_mass=1.0,
    stiffness=(math.tau * 1000.0) ** 2,
    damping=math.tau * 1000.0,
    damper_mass=1e-9,
    gap=10.0,
    one_sided=True,
    angle=0.5 * math.pi,
    friction=0.0,
    gravity=GRAVITY,
    force_amplitudes=0.0,
)


class Rebounds(NamedTuple):
    """Rebounds of a ball."""

    intervals: np.ndarray  # between impacts, s
    apart: float  # of the closed form, s
    rest: float  # when the ball rests, s
    closed_rest: float


def rebounds(restitution: float) -> Rebounds:
    """Drop a ball on the floor until it rests."""
    rig = Rig(
        FLOOR.replace(restitution_1=restitution),
        InitialConditions(initial_damper_offset=0.5 * FLOOR.gap - HEIGHT),
    )
    fall = math.sqrt(2.0 * HEIGHT / GRAVITY)
    rest = fall * (1.0 + restitution) / (1.0 - restitution)
    events = rig.advance(1.01 * rest)
    intervals = np.diff([e.time for e in events if e.kind is EventKind.IMPACT])
    closed = 2.0 * fall * restitution ** np.arange(1, len(intervals) + 1)
    ended = next(event.time for event in events if event.kind is EventKind.REST)
    return Rebounds(intervals, float(abs(intervals - closed).max()), ended, rest)


def main() -> None:
    """Compute and print."""
    options(__doc__)
    rows = []
    for ball, restitution in BALLS.items():
        found = rebounds(restitution)
        rows.append((ball, restitution, *map(float, found.intervals[:3]), len(found.intervals),
                     f'{found.apart:.1e}', f'{found.rest:.6f}',
                     f'{found.rest - found.closed_rest:.1e}'))  # fmt: skip
    show(('ball', 'R', '1st interval [s]', '2nd', '3rd', 'resolved', 'largest error [s]',
          'rests at [s]', 'error [s]'), rows)  # fmt: skip


if __name__ == '__main__':
    main()
