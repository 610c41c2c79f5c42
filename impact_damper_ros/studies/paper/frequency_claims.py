"""The claims about Figure 4: the natural frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise, takewhile

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig import RigParameters

from .claim import Claim, Judgement, branch_of, judged, least_ratio, stable_ratios
from .curves import SeriesPlan, Status
from .rigs import BASIC, scaled_rig
from .series import STRONG_FORCE, Series

#: Natural frequencies at which the effects of gravity and friction are compared, rad/s.
_OMEGAS = (1.0, 2.0, 5.0, 10.0, 20.0)


def _modulus(plan: SeriesPlan, value: float) -> float:
    """Return the largest modulus of a multiplier of the most stable motion with two impacts."""
    found = find_orbits(plan.at(value), (1, 2), simulate=False).orbits
    return min((abs(o.multipliers[0]) for o in found if o.viable), default=math.inf)


def stability_edge(plan: SeriesPlan, inside: float) -> float:
    """Return the value, just below `inside`, from which on two impacts per cycle are stable."""
    outside = inside - 1e-3 * abs(inside)
    while inside - outside > 1e-12 * abs(inside):
        middle = 0.5 * (inside + outside)
        stable = _modulus(plan, middle) < 1.0
        inside, outside = (middle, outside) if stable else (inside, middle)
    return inside


def _two_impacts(rig: RigParameters) -> str:
    found = [o for o in find_orbits(rig, (1, 2), simulate=False).orbits if o.viable]
    if not found:
        return 'no motion with two impacts per cycle'
    kind = 'stable' if found[0].stable else 'unstable only'
    return f'{kind}, Xmax/A = {found[0].amplitude_ratio:.4f}'


def frequency_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about the natural frequency."""
    rig = BASIC.replace(gap=50.0, angle=math.radians(15.0), friction=0.5)
    damped = rig.replace(damping=0.1)
    # r above resonance with A = F/K
    unit_gain = math.sqrt(2.0 - 4.0 * damped.zeta**2)
    readings = {
        'ζ = 0.05, r = 1, F/K = 1 m (AK/F = 10)': damped,
        'ζ = 0.05, r = 1, A = 100 m as in the basic rig': damped.replace(
            force_amplitudes=(STRONG_FORCE,)
        ),
        'AK/F = 1 and r = 1, so ζ = 0.5': rig.replace(damping=1.0),
        'AK/F = 1 and ζ = 0.05, so r = 1.411': damped.replace(force_frequencies=(unit_gain,)),
        'F/K = 1 m, r = 1, ζ = 0.005 as in the basic rig': rig,
    }
    other = [name for name in results if name.startswith('4 ζ=0.05')]
    never = sum(len(stable_ratios(results[name])) for name in other) == 0
    yield Claim(
        '4',
        'AK/F₀ = 1, ζ = 0.05 and r = 1 are kept while ω varies',
        'at r = 1, AK/F₀ = 1/(2ζ) = 10. At ω = 1 rad/s, θ = 15°, γ = 0.5, d = 50 m: '
        + '; '.join(f'{name}: {_two_impacts(one)}' for name, one in readings.items())
        + '. Between ω = 0.5 and 20 rad/s the first two have '
        + ('no stable motion' if never else 'stable motions')
        + ' with two impacts per cycle',
        Judgement.NOT_REPRODUCED,
        'the three values contradict one another; the figure results from F₀/K = 1 m, r = 1 '
        'and ζ = 0.005, the damping of the basic rig (AK/F₀ = 100); with no other reading '
        'are there stable motions with two impacts at ω = 1 rad/s',
    )
    tilted = results['4 ζ=0.005']
    horizontal = next(iter(branch_of(results['4 ζ=0.005 level']).values())).ratio
    downwards = takewhile(
        lambda point: point.status == Status.STABLE, reversed(branch_of(tilted).values())
    )
    stable = list(downwards)[::-1]
    # Rounded up, to the stable side
    edge = math.ceil(1e6 * stability_edge(tilted.plan, stable[0].value)) / 1e6
    moduli = [_modulus(tilted.plan, value) for value in (edge - 1e-6, edge)]
    last = stable[-1]
    falling = all(b.ratio < a.ratio for a, b in pairwise(stable))
    alone = {
        'gravity alone (15°, γ = 0)': tilted.plan.rig.replace(friction=0.0),
        'friction alone (0°, γ = 0.5)': tilted.plan.rig.replace(angle=0.0),
        'both': tilted.plan.rig,
    }
    excesses = {
        name: [least_ratio(scaled_rig(rig, omega)) / horizontal - 1.0 for omega in _OMEGAS]
        for name, rig in alone.items()
    }
    yield Claim(
        '4',
        'gravity and friction matter less as the natural frequency rises',
        f'two impacts per cycle are stable from ω = {edge:.6f} rad/s on, where the largest '
        f'multiplier is {moduli[1]:.6f} ({moduli[0]:.6f} at {edge - 1e-6:.6f}). Xmax/A falls from '
        f'{stable[0].ratio:.4f} there to '
        f'{last.ratio:.5f} at {last.value:.3g}; horizontal without friction {horizontal:.5f}. '
        'Excess over that at ω = '
        + ', '.join(f'{omega:g}' for omega in _OMEGAS)
        + ': '
        + '; '.join(
            f'{name} ' + ', '.join(f'{value:+.1%}' for value in row)
            for name, row in excesses.items()
        ),
        judged(
            falling
            and edge <= tilted.plan.values[0]
            and abs(last.ratio / horizontal - 1.0) < 0.01
            and all(b < a for row in excesses.values() for a, b in pairwise(row)),
            Judgement.IN_PART,
        ),
        f'for the reading of ζ above, and from {edge:.6f} rad/s on: below, no motion with '
        'impacts on both stops is stable',
    )
    changes = {}
    for omega in (1.0, 5.0, 20.0):
        orbit = find_orbits(tilted.plan.at(omega), (1, 2), simulate=False).orbits[0]
        before, after = orbit.damper_velocity_before, orbit.damper_velocity_after
        pairs = zip(after, before[1:] + before[:1], strict=True)
        changes[omega] = max(abs(b / a - 1.0) for a, b in pairs)
    yield Claim(
        '4',
        'because the speed of m then changes relatively less between impacts',
        'largest relative change of speed in a flight: '
        + ', '.join(f'{share:.2%} at ω = {omega:g}' for omega, share in changes.items()),
        judged(all(b < a for a, b in pairwise(changes.values()))),
    )
