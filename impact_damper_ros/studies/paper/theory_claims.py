"""
The claims about the theory itself: earlier results, simulation, and the vertical rig.

Two cases are derived here independently of the solver: the symmetric motion with two impacts per
cycle of a horizontal, frictionless damper (Masri and Caughey 1966), and the ball on a table too
heavy to be moved by it (see Bapat, Sankar and Popplewell 1986).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.orbits.multipliers import free_vibration
from impact_damper_ros.rig import RigParameters
from impact_damper_ros.rig.state import constants_of

from .claim import Claim, Judgement, judged
from .curves import TOLERANCE, CurvePoint, Status, alike, disturbed, point_of, settle
from .rigs import BASIC, VERTICAL
from .series import Series


def symmetric_displacements(rig: RigParameters) -> tuple[float, ...]:
    """
    Return X at stop 1 in the symmetric motions, from a quadratic.

    Notes
    -----
    m crosses with the speed v = (2 X + d) Omega/pi, so momentum and restitution give M's speeds
    -v (1 - R + 2 mu)/(1 + R) before and -v (1 - R - 2 mu R)/(1 + R) after stop 1. Half a cycle
    later M must be in the mirrored state. This gives A sin and A cos linearly in v, and the sum of
    their squares is A^2.
    """
    mu, restitution = rig.mass_ratio, rig.restitution_1
    rate = rig.force_frequencies[0]
    half = math.pi / rate
    phi = free_vibration(constants_of(rig)[0].free, np.array([half]))[0]
    k = (1.0 + phi[0, 0]) / phi[0, 1]
    after = -(1.0 - restitution - 2.0 * mu * restitution) / (1.0 + restitution)
    # Free part of X over v; then X - free = A sin, and its rate over Omega = A cos
    free = 2.0 * mu / (phi[1, 0] - k * (1.0 + phi[1, 1]))
    cosine = (after + k * free) / rate
    sine = np.array([0.5 * half - free, -0.5 * rig.gap])
    roots = np.roots(
        [
            sine[0] ** 2 + cosine**2,
            2.0 * sine[0] * sine[1],
            sine[1] ** 2 - rig.response_amplitude**2,
        ]
    )
    real = sorted(float(v.real) for v in roots if abs(v.imag) < 1e-12 * abs(v) and v.real > 0.0)
    return tuple(0.5 * (v * half - rig.gap) for v in real)


def heavy_table_range(restitution: float) -> tuple[float, float]:
    """Return the ends of the stable range of A Omega^2/g, one impact per cycle, m much lighter."""
    low = math.pi * (1.0 - restitution) / (1.0 + restitution)
    rise = 2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2
    return low, math.hypot(low, rise)


def _vertical_rig(intensity: float) -> RigParameters:
    """Return the paper's vertical one-sided rig with the gravity that gives A Omega^2/g."""
    rate = VERTICAL.force_frequencies[0]
    return VERTICAL.replace(gravity=VERTICAL.response_amplitude * rate**2 / intensity)


def vertical_range(inside: float = 0.8, tolerance: float = 1e-12) -> tuple[float, float]:
    """Return the ends of the stable range of A Omega^2/g of the vertical rig."""
    from scipy.optimize import bisect

    def side(intensity: float) -> float:
        found = find_orbits(_vertical_rig(intensity), (1,), simulate=False)
        return 1.0 if any(orbit.stable and orbit.viable for orbit in found.orbits) else -1.0

    ends = (bisect(side, inside, unstable, xtol=tolerance) for unstable in (0.1, 3.0))
    return float(next(ends)), float(next(ends))


def agreement_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims that theory, earlier results and simulation agree."""
    errors = []
    for rate in (1.0, 1.02):
        for gap in np.arange(24.0, 56.1, 4.0):
            rig = BASIC.replace(gap=float(gap), force_frequencies=(rate,))
            found = [o.x[0] for o in find_orbits(rig, (1, 2), simulate=False).orbits]
            errors += [
                min(abs(x - other) / abs(x) for other in found)
                for x in symmetric_displacements(rig)
            ]
    yield Claim(
        'text',
        'the theory of the horizontal damper agrees with earlier results',
        f'closed form of the symmetric motion (a quadratic, derived independently) against the '
        f'general solver: {len(errors)} motions at r = 1 and 1.02, d = 24 to 56 m, X at the '
        f'impacts agrees to {max(errors):.0e}',
        judged(max(errors) < 1e-9),
        'for the symmetric motion with two impacts; ranges of stability of the earlier papers are '
        'not compared',
    )
    yield simulation_claim(results)


def _same(one: CurvePoint, other: CurvePoint) -> bool:
    """Return whether two points are one motion, on two curves that join."""
    if one.orbit is None or other.orbit is None or one.value != other.value:
        return False
    return one.orbit.stops == other.orbit.stops and alike(one, other)


def simulation_claim(results: Mapping[str, Series]) -> Claim:
    """Judge the agreement of theory and simulation, by every run and every stable motion."""
    late, far, off, longer, other = [], [], [], [], 0
    stable, reached = 0, 0
    for series in results.values():
        own = [curve for curve in series.curves if not curve.simulated]
        found = []
        for mark in series.marks:
            point = point_of(own, mark)
            if point is not None and point.orbit is not None:
                found.append(point)
                same = replace(mark, orbit=point.orbit)
                late.append(same.difference)
                far.append(abs(mark.ratio / point.ratio - 1.0))
            elif mark.cycles == 1 and len(mark.stops) in series.plan.impacts:
                off.append(f'{series.plan.name} at {mark.value:g}')
            elif mark.stops:
                longer.append(mark.difference)
            else:
                other += 1
        at_marks = [
            point
            for curve in own
            for point in curve.points
            if point.status == Status.STABLE and point.value in series.plan.marks
        ]
        stable += len(at_marks)
        reached += sum(any(_same(point, one) for one in found) for point in at_marks)
    agree = [value for value in longer if math.isfinite(value)]
    return Claim(
        'all',
        'theory and simulation agree well, with incline, friction and unequal restitution',
        f'{len(late)} settled motions of the simulator are motions of the theory: durations agree '
        f'to {max(late):.0e} half-cycles (runs stop when they repeat to {TOLERANCE:.0e}), largest '
        f'displacements to {max(far):.0e} (from 240 samples per cycle); {len(off)} of one '
        'cycle and as many impacts are not'
        + (f' ({", ".join(off)})' if off else '')
        + f'. Of {stable} stable motions of the theory at the marks, the simulator settles into '
        f'{reached}. Of {len(longer)} settled motions with longer periods or more impacts, '
        f'{len(agree)} are also found by the solver, to {max(agree, default=0.0):.0e}. {other} '
        'runs do not repeat within four cycles',
        judged(
            max(late) < 1e-6 and max(far) < 1e-4 and not off and reached == stable,
            Judgement.IN_PART,
        ),
        'with up to four impacts in one cycle; the theory says nothing of the runs that do not '
        'repeat' + (', and no start leads to the motion of ' + ' and '.join(off) if off else ''),
    )


def vertical_claims() -> Iterator[Claim]:
    """Judge the claims about the vertical rig with one stop, and the platform on springs."""
    low, high = vertical_range()
    heavy = heavy_table_range(VERTICAL.restitution_1)
    close = abs(low - 0.45) < 0.005 and abs(high - 1.12) < 0.005
    yield Claim(
        'text',
        'vertical, one stop (Ω = 10 rad/s, μ = 0.01, R = 0.75): one impact per cycle is '
        'stable for 0.45 < AΩ²/g < 1.12',
        f'ends by bisection of the solver: {low:.4f} and {high:.4f}',
        judged(close, Judgement.OTHER_NUMBER),
        '' if close else f'the upper end is {high:.3f}; the lower one rounds to 0.45',
    )
    yield Claim(
        'text',
        'this range agrees with earlier results for a table too heavy to be moved by the ball',
        f'range for a heavy table, π(1−R)/(1+R) to the period doubling: {heavy[0]:.4f} to '
        f'{heavy[1]:.4f}; the ends differ by {low / heavy[0] - 1:+.1%} and '
        f'{high / heavy[1] - 1:+.1%}, of the order of the mass ratio {VERTICAL.mass_ratio:g}',
        judged(abs(low / heavy[0] - 1.0) < 0.03 and abs(high / heavy[1] - 1.0) < 0.03),
    )
    texts, apart = [], []
    for intensity in (0.5, 0.8, 1.1):
        orbit = find_orbits(_vertical_rig(intensity), (1,), simulate=False).orbits[0]
        settled = settle(disturbed(orbit, 1e-3), intensity, 3000)
        apart.append(abs(settled.ratio / orbit.amplitude_ratio - 1.0))
        texts.append(
            f'{orbit.amplitude_ratio:.8f} and {settled.ratio:.8f} at AΩ²/g = {intensity:g} '
            f'({settled.cycles} cycle, {len(settled.stops)} impact)'
        )
    yield Claim(
        'text',
        'a mass on a platform on springs is a case of the general theory (conclusions)',
        f'Xmax/A of the one-sided rig, solver and settled simulation: {"; ".join(texts)}',
        judged(all(value < 1e-5 for value in apart)),
    )
