# SPDX-License-Identifier: Apache-2.0
"""
A ball on a vibrating table: one impact per cycle, from its fold to its period doublings.

    python examples/published/bouncing_ball.py [--out DIR]

P. J. Holmes, Journal of Sound and Vibration 84 (1982), 173-189; A. C. J. Luo and R. P. S. Han,
Nonlinear Dynamics 10 (1996), 1-18.

The ball meets the table once in a cycle T with gT/2 before and after, so that at the impact the
table has the velocity (1 - R)/(1 + R) gT/2: over the amplitude A of the table a fold at
A Omega^2/g = pi (1 - R)/(1 + R). The product of the two multipliers is R^2; one of them is -1 at
the square root of that fold squared + (2 (1 + R^2)/(1 + R)^2)^2.

The table is M. Either a force moves it, and its amplitude is known in closed form, or it stands
on a moving base by a spring so stiff that it goes with the base.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

from impact_damper_ros import (
    Branch,
    RigParameters,
    SpecialKind,
    find_orbits,
    follow,
    switch_branch,
)

sys.path.append(str(Path(__file__).resolve().parents[1]))

from output import BLUE, ORANGE, blank_figure, finish_panel, options, print_style, save, show

RESTITUTION, GRAVITY, RATE = 0.8, 9.81, 10.0 * math.pi
FOLD = math.pi * (1.0 - RESTITUTION) / (1.0 + RESTITUTION)
DOUBLING = math.hypot(FOLD, 2.0 * (1.0 + RESTITUTION**2) / (1.0 + RESTITUTION) ** 2)
BALL = RigParameters(
    primary_mass=1.0,
    stiffness=1.0,
    damping=0.1,
    damper_mass=1e-9,
    gap=1e6,
    one_sided=True,
    angle=0.5 * math.pi,
    friction=0.0,
    gravity=GRAVITY,
    restitution_1=RESTITUTION,
    force_amplitudes=1.0,
    force_frequencies=RATE,
)
#: Acceleration of the table over g, for each newton of the force.
PER_NEWTON = BALL.response_amplitude * RATE**2 / GRAVITY


def on_base(acceleration: float, ratio: float = 100.0) -> RigParameters:
    """Return the ball on a base of some acceleration over g; the table has `ratio` times Omega."""
    omega = ratio * RATE
    return BALL.replace(
        stiffness=omega**2,
        damping=omega,
        force_amplitudes=(0.0,),
        base_amplitudes=(acceleration * GRAVITY,),
        base_frequencies=(RATE,),
        base_phases=(math.pi,),
    )


def once_per_cycle(path: str | Callable[[float], RigParameters]) -> Branch:
    """Follow the ball that meets the table once in each cycle, along its force or its base."""
    rig = BALL.replace(force_amplitudes=8.0) if isinstance(path, str) else path(0.8)
    low, high = (2.0, 13.0) if isinstance(path, str) else (0.2, 1.3)
    stable = next(orbit for orbit in find_orbits(rig, (1,), simulate=False).orbits if orbit.stable)
    return follow(stable, path, low, high, start=None if isinstance(path, str) else 0.8)


def special(branch: Branch, kind: SpecialKind) -> float:
    """Return where a branch has its first point of a kind."""
    return next(point.value for point in branch.special if point.kind is kind)


def results() -> tuple[list[tuple[str, float, float]], Branch, Branch]:
    """Return name, closed form and computed value of each result, and both branches by force."""
    once = once_per_cycle('force_amplitudes')
    first = next(p for p in once.special if p.kind is SpecialKind.PERIOD_DOUBLING)
    twice = switch_branch(first, 'force_amplitudes', 10.0, 12.5)
    moved = once_per_cycle(on_base)
    rows = [
        ('fold, force [N]', FOLD / PER_NEWTON, special(once, SpecialKind.FOLD)),
        ('period doubling, force [N]', DOUBLING / PER_NEWTON, first.value),
        ('second doubling, force [N]', math.nan, special(twice, SpecialKind.PERIOD_DOUBLING)),
        ('fold, acceleration of the base [g]', FOLD, special(moved, SpecialKind.FOLD)),
        ('doubling, the same [g]', DOUBLING, special(moved, SpecialKind.PERIOD_DOUBLING)),
    ]
    return rows, once, twice


@print_style()
def main() -> None:
    """Compute, print and draw the phases of the impacts."""
    arguments = options(__doc__)
    rows, *branches = results()
    show(
        ('ball on a table', 'closed form', 'computed', 'apart'),
        [(name, f'{a:.7g}', f'{b:.7g}', f'{b / a - 1.0:.1e}') for name, a, b in rows],
    )
    figure = blank_figure(5.0, 3.2)
    axes = figure.subplots()
    for branch, colour in zip(branches, (BLUE, ORANGE), strict=True):
        for status, part in branch.parts():
            points = branch.points[part]
            x = [point.value * PER_NEWTON for point in points]
            for k in range(branch.orbits[0].impacts):
                # The fold is at phase 0 of the cycle: shown from -0.5
                y = [math.remainder(point.orbit.instants[k] * RATE / math.tau, 1.0)
                     for point in points]  # fmt: skip
                axes.plot(x, y, color=colour, linestyle='-' if status == 'stable' else ':')
    finish_panel(axes, '', r'$AΩ^2/g$', 'phase of the impacts [cycles]')
    save(figure, arguments.out / 'bouncing_ball.png')


if __name__ == '__main__':
    main()
