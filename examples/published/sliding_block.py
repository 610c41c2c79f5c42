# SPDX-License-Identifier: Apache-2.0
"""
A block on a shaken table that sticks, slips and stops: from which accelerations it does so.

    python examples/published/sliding_block.py

B. Westermo and F. Udwadia, Earthquake Engineering and Structural Dynamics 11 (1983), 135-146.

The acceleration of the block is at most gamma g: up to a = gamma g of the table it never slips.
In a motion that slips all the time its velocity is a triangle of slope gamma g, and each slope
lasts half a cycle: where the direction of slip changes, the velocity of the table,
(a/Omega) cos(phi), is gamma g pi/(2 Omega). The block slips on there if a sin(phi) >= gamma g.
With s = a/(gamma g) this is s^2 >= 1 + (pi/2)^2; between both limits it sticks for a while.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import options, show

FRICTION, GRAVITY, RATE = 0.3, 9.81, 10.0 * math.pi
SLIPS, NEVER_STICKS = 1.0, math.hypot(1.0, 0.5 * math.pi)


TABLE = RigParameters(
    primary_mass=1.0,
    stiffness=1.0,
    damping=1.0,
    damper_mass=1e-9,
    gap=1e6,
    friction=FRICTION,
    gravity=GRAVITY,
    force_amplitudes=1.0,
    force_frequencies=RATE,
)


def by_force(acceleration: float) -> Rig:
    """Return a block on a table that a force moves with some acceleration over gamma g."""
    force = acceleration * FRICTION * GRAVITY / (TABLE.response_amplitude * RATE**2)
    rig = TABLE.replace(force_amplitudes=force)
    lag = math.atan2(2.0 * rig.zeta * rig.frequency_ratio, 1.0 - rig.frequency_ratio**2)
    start = InitialConditions(
        initial_primary_position=-rig.response_amplitude * math.sin(lag),
        initial_primary_velocity=rig.response_amplitude * RATE * math.cos(lag),
    )
    return Rig(rig, start, compiled=None)


def by_base(acceleration: float, ratio: float = 100.0) -> Rig:
    """Return the block on a base; the natural frequency of the table is `ratio` times Omega."""
    omega = ratio * RATE
    return Rig(
        TABLE.replace(
            stiffness=omega**2,
            damping=omega,
            force_amplitudes=0.0,
            base_amplitudes=acceleration * FRICTION * GRAVITY,
            base_frequencies=RATE,
        ),
        compiled=None,
    )


def kinds(rig: Rig) -> set[EventKind]:
    """Return the kinds of events in five cycles of the settled motion."""
    cycle = math.tau / RATE
    rig.advance(40.0 * cycle)
    return {event.kind for event in rig.advance(45.0 * cycle)}


def threshold(
    rig_at: Callable[[float], Rig],
    begun: Callable[[set[EventKind]], bool],
    low: float,
    high: float,
) -> float:
    """Return by bisection from which acceleration on a settled motion is of a kind."""
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if begun(kinds(rig_at(middle))) else (middle, high)
    return 0.5 * (low + high)


def never_sticks(events: set[EventKind]) -> bool:
    """Return whether the block slips all the time."""
    return EventKind.REVERSAL in events and EventKind.STICK not in events


def results() -> list[tuple[str, float, float]]:
    """Return name, closed form and computed value of both limits, over gamma g."""
    return [
        (f'{name}, {mover}', closed, threshold(rig_at, begun, low, high))
        for mover, rig_at in (('table moved by a force', by_force), ('by its base', by_base))
        for name, closed, begun, low, high in (
            ('slips at all', SLIPS, bool, 0.8, 1.3),
            ('never sticks', NEVER_STICKS, never_sticks, 1.7, 2.1),
        )
    ]


def main() -> None:
    """Compute and print."""
    options(__doc__)
    show(('block, a/(gamma g)', 'closed form', 'computed', 'apart'),
         [(name, f'{a:.7g}', f'{b:.7g}', f'{b / a - 1.0:.1e}')
          for name, a, b in results()])  # fmt: skip


if __name__ == '__main__':
    main()
