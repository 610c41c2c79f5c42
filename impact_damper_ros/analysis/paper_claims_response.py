"""The claims about Figures 3, 4, 5 and 6."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.orbits.optimum import Limit
from impact_damper_ros.rig import RigParameters

from .paper_claims import (
    Claim,
    Verdict,
    at_value,
    branch,
    judged,
    stability_end,
    stable_excess,
)
from .paper_optimal_gap import OptimumPoint
from .paper_plan import STRONG_FORCE, Series
from .paper_rigs import BASIC, CASES
from .paper_sweep import Status

__all__ = ['air_claims', 'frequency_scale_claims', 'optimum_claims', 'response_claims']

#: Relative changes of the displacement that count as small in practice.
SMALL = 0.1
#: Gaps of Figure 3a away from the edge of stability, m.
_INNER_GAP = 41.0


def response_claims(results: Mapping[str, Series]) -> list[Claim]:
    """
    Judge the claims about Figure 3.

    Parameters
    ----------
    results : mapping of str to Series
        Its series, by name.
    """
    changes = {
        case.key: stable_excess(results[f'3a {case.key} unequal'], results[f'3a {case.key} equal'])
        for case in CASES
    }
    inner = {
        case.key: stable_excess(
            results[f'3a {case.key} unequal'], results[f'3a {case.key} equal'], above=_INNER_GAP
        )
        for case in CASES
    }
    low = min(c[0] for c in inner.values())
    high = max(c[1] for c in inner.values())
    horizontal = at_value(results['3a horizontal unequal'], 50.0).ratio
    equal = at_value(results['3a horizontal equal'], 50.0).ratio
    claims = [
        Claim(
            '3a',
            'slightly different restitutions are detrimental, but insignificantly in practice',
            'R = 0.78, 0.72 against 0.75, 0.75, change of Xmax/A over the common stable gaps: '
            + '; '.join(f'{k} {a:+.2%} to {b:+.2%}' for k, (a, b, _) in changes.items())
            + f'; from {_INNER_GAP:g} m: '
            + '; '.join(f'{k} {a:+.2%} to {b:+.2%}' for k, (a, b, _) in inner.items())
            + f'. At d = 50 m, horizontal, {equal:.5f} becomes {horizontal:.5f}',
            judged(low >= 0.0 and high < SMALL, Verdict.OTHER_NUMBER),
            'detrimental and insignificant on the level; on the incline the larger R at the lower '
            'stop makes up for gravity, and the change is a small gain; large only at the edge '
            'near 36 m',
        ),
        _angle_claim(results),
        *_frequency_claims(results),
    ]
    friction = results['3d']
    ratios = {p.value: p.ratio for p in branch(friction)}
    chosen = [v for v in (0.0, 0.1, 0.2, 0.5) if v in ratios]
    end = stability_end(friction)
    growth = ratios[chosen[-1]] / ratios[0.0]
    claims.append(
        Claim(
            '3d',
            'a large friction force has a significant effect; sliding friction should be kept low',
            'd = 50 m, r = 1, horizontal: Xmax/A '
            + ', '.join(f'{ratios[v]:.4f} at γ = {v:g}' for v in chosen)
            + f'; stable up to γ = {end:.3f}',
            judged(growth > 1.5),
        )
    )
    claims.append(
        Claim(
            '3d',
            'the friction force is largest in horizontal operation',
            'mγg cosθ: 1 at 0°, '
            + ', '.join(f'{math.cos(math.radians(v)):.3f} at {v}°' for v in (15, 45, 90))
            + ' of the force on the level',
            Verdict.REPRODUCED,
        )
    )
    return claims


def _angle_claim(results: Mapping[str, Series]) -> Claim:
    words, rises = [], {}
    for name in ('3b r=1', '3b r=1.02'):
        series = results[name]
        start = at_value(series, 0.0).ratio
        picked = [p for p in branch(series) if p.value in (4.0, 5.0, 8.0, 10.0, 45.0)]
        rises[name] = {p.value: p.ratio / start - 1.0 for p in picked}
        words.append(
            f'{name[3:]}: '
            + ', '.join(f'{rise:+.1%} at {angle:g}°' for angle, rise in rises[name].items())
            + f', stable up to {stability_end(series):.2f}°'
        )
    at_one, above = rises['3b r=1'], rises['3b r=1.02']
    small = [angle for angle in at_one if angle <= 10.0 and angle in above]
    return Claim(
        '3b',
        'inclination is detrimental, and more so at r = 1 than at r = 1.02',
        'rise of Xmax/A over its value at 0°, d = 37 m: ' + '; '.join(words),
        judged(
            all(at_one[angle] > above[angle] > 0.0 for angle in small),
            Verdict.NOT_REPRODUCED,
        ),
        'at d = 37 m both lose stability near 12°; beyond it r = 1.02 keeps rising',
    )


def _frequency_claims(results: Mapping[str, Series]) -> list[Claim]:
    level = results['3c θ=0°']
    words, above, below = [], [], []
    for angle in (5, 10, 15):
        series = results[f'3c θ={angle}°']
        base = {p.value: p.ratio for p in branch(level) if p.status == Status.STABLE}
        excess = [
            (p.value, p.ratio / base[p.value] - 1.0)
            for p in branch(series)
            if p.status == Status.STABLE and p.value in base
        ]
        near = [e for v, e in excess if v <= 1.005]
        far = [e for v, e in excess if v > 1.005]
        above += far
        below += near
        shown = [f'{min(e):+.1%} to {max(e):+.1%}' if e else 'not stable' for e in (near, far)]
        words.append(f'{angle}°: {shown[0]} up to Ω = 1.005, {shown[1]} above')
    five = [p.ratio for p in branch(results['3c θ=5°']) if p.value == 1.02]
    zero = [p.ratio for p in branch(level) if p.value == 1.02]
    at_102 = f'; at Ω = 1.02 and 5°: {five[0] / zero[0] - 1.0:+.2%}' if five and zero else ''
    small_far = bool(above) and min(above) >= 0.0
    return [
        Claim(
            '3c',
            'for small inclination the effect is small, but detrimental',
            f'excess of Xmax/A over 0°, both stable, d = 37 m: {"; ".join(words)}{at_102}',
            judged(small_far and bool(five) and five[0] / zero[0] - 1.0 < SMALL),
            'small above resonance for 5°; at r = 1 itself it is not small',
        ),
        Claim(
            '3c',
            'the effect is similar for other parameters with r > 1',
            f'largest excess above Ω = 1.005, all of 5°, 10°, 15°: {max(above, default=0):+.1%}; '
            f'never below 0: {min(above, default=0):+.2%} at least',
            judged(small_far),
        ),
    ]


def _two_impacts(rig: RigParameters) -> str:
    found = [o for o in find_orbits(rig, (1, 2), simulate=False).orbits if o.viable]
    if not found:
        return 'no motion with two impacts per cycle'
    kind = 'stable' if found[0].stable else 'unstable only'
    return f'{kind}, Xmax/A = {found[0].amplitude_ratio:.4f}'


def frequency_scale_claims(results: Mapping[str, Series]) -> list[Claim]:
    """
    Judge the claims about Figure 4, and which reading of its parameters they hold for.

    Parameters
    ----------
    results : mapping of str to Series
        Its series, by name.
    """
    tilted, level = results['4 ζ=0.005'], results['4 ζ=0.005 level']
    horizontal = branch(level)[0].ratio
    whole = branch(tilted)
    unstable = [i for i, p in enumerate(whole) if p.status != Status.STABLE]
    stable = whole[max(unstable, default=-1) + 1 :]
    falling = all(b.ratio < a.ratio for a, b in pairwise(stable))
    rig = BASIC.replace(gap=50.0, angle=math.radians(15.0), friction=0.5)
    readings = (
        ('ζ = 0.05, r = 1, F/K = 1 m (AK/F = 10)', rig.replace(damping=0.1)),
        (
            'ζ = 0.05, r = 1, A = 100 m as in the basic rig',
            rig.replace(damping=0.1, force_amplitudes=(STRONG_FORCE,)),
        ),
        ('AK/F = 1 and r = 1, so ζ = 0.5', rig.replace(damping=1.0)),
        (
            'AK/F = 1 and ζ = 0.05, so r = 1.411',
            rig.replace(damping=0.1, force_frequencies=(_ratio_with_unit_gain(0.05),)),
        ),
        ('F/K = 1 m, r = 1, ζ = 0.005 as in the basic rig', rig),
    )
    tried = '; '.join(f'{name}: {_two_impacts(rig)}' for name, rig in readings)
    first, last = stable[0], stable[-1]
    return [
        Claim(
            '4',
            'AK/F₀ = 1, ζ = 0.05 and r = 1 are kept while ω varies',
            f'at r = 1, AK/F₀ = 1/(2ζ) = 10. At ω = 1 rad/s, θ = 15°, γ = 0.5, d = 50 m: {tried}',
            Verdict.NOT_REPRODUCED,
            'the three cannot hold at once; the figure follows with F₀/K = 1 m, r = 1 and '
            'ζ = 0.005, the damping of the basic rig (AK/F₀ = 100); no other reading has stable '
            'motion with two impacts',
        ),
        Claim(
            '4',
            'gravity and friction matter less as the natural frequency rises',
            f'Xmax/A falls from {first.ratio:.4f} at ω = {first.value:.3g} rad/s to '
            f'{last.ratio:.5f} at {last.value:.3g}; horizontal without friction {horizontal:.5f}',
            judged(falling and abs(last.ratio / horizontal - 1.0) < 0.01),
        ),
        _speed_claim(tilted),
    ]


def _ratio_with_unit_gain(zeta: float) -> float:
    """Return r above resonance with A = F/K."""
    return math.sqrt(2.0 - 4.0 * zeta**2)


def _speed_claim(series: Series) -> Claim:
    """Judge the reason given: the change of speed of m within a flight."""
    changes = []
    for omega in (1.0, 5.0, 20.0):
        orbit = find_orbits(series.sweep.at(omega), (1, 2), simulate=False).orbits[0]
        before, after = orbit.damper_velocity_before, orbit.damper_velocity_after
        share = max(abs(b / a - 1.0) for a, b in zip(after, before[1:] + before[:1], strict=True))
        changes.append((omega, share))
    return Claim(
        '4',
        'because the speed of m then changes relatively less between impacts',
        'largest relative change of speed in a flight: '
        + ', '.join(f'{share:.2%} at ω = {omega:g}' for omega, share in changes),
        judged(all(b[1] < a[1] for a, b in pairwise(changes))),
    )


def optimum_claims(points: Sequence[OptimumPoint]) -> list[Claim]:
    """
    Judge the claims about Figure 5.

    Parameters
    ----------
    points : sequence of OptimumPoint
        The optimum at each angle, 0 first.
    """
    start = points[0].best
    small = [p for p in points if p.angle <= 15.0]
    shift = max(abs(p.best.gap / start.gap - 1.0) for p in small)
    shown = [p for p in points if p.angle in (0.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0)]
    edges = [p.angle for p in points if p.best.limit is not Limit.MINIMUM]
    limits = (
        f'a minimum inside the stable range at {len(points) - len(edges)} angles of {len(points)}'
        + (f', at the edge of stability at {", ".join(f"{a:g}°" for a in edges)}' if edges else '')
    )
    rises = [p.best.orbit.amplitude_ratio for p in points]
    return [
        Claim(
            '5a',
            'for small angles the optimal gap is nearly that of the horizontal damper',
            'optimal gap [m]: '
            + ', '.join(f'{p.best.gap:.3f} at {p.angle:g}°' for p in shown)
            + f'; changes by at most {shift:.2%} up to 15°; {limits}',
            judged(shift < 0.02),
        ),
        Claim(
            '5b',
            'gravity makes the displacement at the optimal gap larger',
            'Xmax/A: '
            + ', '.join(f'{p.best.orbit.amplitude_ratio:.5f} at {p.angle:g}°' for p in shown),
            judged(min(rises) == rises[0] and rises[-1] > rises[0]),
        ),
    ]


def air_claims(results: Mapping[str, Series]) -> list[Claim]:
    """
    Judge the claims about Figure 6.

    Parameters
    ----------
    results : mapping of str to Series
        Its series, by name.
    """
    words_small, words_large, words_gain = [], [], []
    rises: list[float] = []
    ends: list[float] = []
    gains: list[float] = []
    for name in ('6 r=1', '6 r=1.02'):
        series = results[name]
        ratios = {p.value: p.ratio for p in branch(series) if p.status == Status.STABLE}
        free = at_value(series, 1.0).ratio
        near = {v: ratio / free - 1.0 for v, ratio in ratios.items() if 1.0 <= v <= 1.5}
        rises += near.values()
        ends.append(stability_end(series))
        gains.append(min(ratios.values()) / free - 1.0)
        words_small.append(
            f'{name[2:]}: {free:.4f} at p = mγg, where air cancels friction; '
            f'{min(near.values()):+.1%} to {max(near.values()):+.1%} up to p = 1.5 mγg, '
            f'{at_value(series, 2.0).ratio / free - 1.0:+.1%} at 2 mγg; without air '
            f'{ratios[0.0] / free - 1.0:+.1%}'
        )
        words_large.append(f'{name[2:]}: stable up to p = {ends[-1]:.3f} mγg')
        words_gain.append(f'{name[2:]} {gains[-1]:+.1%}')
    return [
        Claim(
            '6',
            'a small force of compressed air has an insignificant effect (γ = 0.5, horizontal)',
            'Xmax/A ' + '; '.join(words_small),
            judged(max(map(abs, rises)) < SMALL),
            'with F = 2mgᵢ read as an air force p that is twice the net force mgᵢ on m, hence '
            'p = 2mγg; small is meant of the net force p − mγg',
        ),
        Claim(
            '6',
            'at a large force the motion becomes unstable',
            '; '.join(words_large),
            judged(all(math.isfinite(end) and end < 5.5 for end in ends)),
        ),
        Claim(
            '6',
            'compressed air is not promising in practice',
            'smallest stable Xmax/A with any air force, against the frictionless rig without air: '
            + '; '.join(words_gain)
            + '; the optimal gap alone gives 0.26 of it at r = 1 (Figure 5)',
            judged(all(gain > -0.15 for gain in gains)),
            'the air recovers what friction has cost, and little more',
        ),
    ]
