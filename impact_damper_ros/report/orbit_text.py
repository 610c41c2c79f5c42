# SPDX-License-Identifier: Apache-2.0
"""Periodic motions and their branches as text and as a table."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from impact_damper_ros.orbits.branch import Branch, SpecialKind, SpecialPoint
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.orbits.solved_orbits import transmissibility
from impact_damper_ros.orbits.transmissibility import TRANSMISSIBILITIES
from impact_damper_ros.parameters.quoting import plural

from .csv_tables import row
from .transmissibility_text import transmissibility_text


def _multipliers(multipliers: Sequence[complex]) -> str:
    """Return the multipliers as text: real ones, and modulus and angle of each pair."""
    words = []
    for value in multipliers:
        if value.imag < 0.0:
            continue
        if value.imag > 0.0:
            degrees = math.degrees(cmath.phase(value))
            words.append(f'{abs(value):.6f} (pair at +-{degrees:.2f} deg)')
        else:
            words.append(f'{value.real:.6f}')
    return ', '.join(words)


def orbit_text(number: int, orbit: PeriodicOrbit) -> str:
    """Return a motion with its impacts and multipliers, and the reason if it is not viable."""
    stops = ','.join(map(str, orbit.stops))
    lines = [
        f'motion {number}: stops {stops} in {plural(orbit.cycles, "cycle")} '
        f'({orbit.period:.9g} s), {orbit.stability}, '
        + ('viable' if orbit.viable else 'NOT VIABLE'),
        "  stop  phase [cycles]         X [m]   X' before    X' after   Z' before    Z' after "
        '[m/s]',
    ]
    lines.extend(
        f'  {stop:4d}  {phase:14.9f}  {x:12.7f} {vb:12.7f} {va:12.7f} {ub:12.7f} {ua:12.7f}'
        for stop, phase, x, vb, va, ub, ua in zip(
            orbit.stops,
            orbit.phases,
            orbit.x,
            orbit.primary_velocity_before,
            orbit.primary_velocity_after,
            orbit.damper_velocity_before,
            orbit.damper_velocity_after,
            strict=True,
        )
    )
    lines.extend(
        f'        {node.phase:14.9f}  {node.kind.name.lower()}'
        + (f' on stop {node.stop}' if node.stop else '')
        for node in orbit.events
    )
    swing = f'  largest |X|  {orbit.x_max:.9g} m'
    amplitude = orbit.parameters.response_amplitude
    if 0.0 < amplitude < math.inf:
        swing += f', {orbit.x_max_ratio:.7f} of the {amplitude:.7g} m without impacts'
    lines.append(swing)
    if orbit.viable and orbit.parameters.base_motion.moves:
        lines.append(f'  {transmissibility_text(transmissibility(orbit), orbit.parameters)}')
    lines.append(f'  multipliers  {_multipliers(orbit.multipliers)}')
    steps = len(orbit.residual_history) - 1
    lines.append(f'  residual     {orbit.residual:.1e} (relative) after {steps} Newton steps')
    if orbit.reason:
        lines.append(f'  not viable   {orbit.reason}')
    return '\n'.join(lines)


def branch_text(branch: Branch) -> str:
    """Return the extent of a branch, its special points, its best motion and how it ends."""
    if not branch.points:
        return f'  {branch.ended}'
    swings = [orbit.x_max for orbit in branch.orbits]
    lines = [
        f'  {branch.name} from {min(branch.values):.9g} to {max(branch.values):.9g}: '
        f'{plural(len(swings), "motion")}, largest |X| between {min(swings):.6g} and '
        f'{max(swings):.6g} m',
    ]
    lines.extend(
        f'  {point.kind.value} {"at" if point.converged else "near"} {branch.name} = '
        f'{point.value:.9g}{_unlike_the_rig(point)}'
        + (f': {point.reason}' if point.reason else '')
        for point in branch.special
    )
    if (best := branch.best()) is not None:
        change = branch.change_at(best.orbit)
        # The place of a minimum is known to half of the digits of its value, an end exactly.
        place = f'{best.value:.9g} ({change})' if change else f'{best.value:.6g}'
        lines.append(
            f'  least largest |X| of a stable motion: {best.orbit.x_max:.9g} m at {branch.name} = '
            f'{place}'
        )
    ends = [f'  end: {end}' for end in (branch.began, branch.ended) if end]
    return '\n'.join([*lines, *ends])


def _unlike_the_rig(special: SpecialPoint) -> str:
    """Return that a motion at a special point is not viable; a grazing is where that begins."""
    seen = special.orbit.viable or special.kind is SpecialKind.GRAZING
    return '' if seen else ', of motions that are not viable'


def branch_table(followed: Sequence[tuple[str, Branch]]) -> str:
    """Return the motions of titled branches as CSV; the lists within a column by spaces."""
    shaken = any(p.orbit.parameters.base_motion.moves for _, b in followed for p in b.points[:1])
    columns = (
        *('branch', 'x_max', 'x_max_ratio', *(TRANSMISSIBILITIES if shaken else ())),
        *('largest_multiplier', 'stable', 'viable', 'special', 'stops', 'phases', 'x'),
    )
    lines = [row((followed[0][1].name, *columns))]
    for title, branch in followed:
        special = {point.value: point.kind.value for point in branch.special}
        for value, orbit in branch.points:
            moved = transmissibility(orbit) if shaken else ()
            numbers = (orbit.x_max, orbit.x_max_ratio, *moved, abs(orbit.multipliers[0]))
            kind = (int(orbit.stable), int(orbit.viable), special.get(value, ''))
            lists = (orbit.stops, orbit.phases, orbit.x)
            joined = (' '.join(f'{v:.17g}' for v in column) for column in lists)
            lines.append(row((float(value), title, *map(float, numbers), *kind, *joined)))
    return ''.join(lines)
