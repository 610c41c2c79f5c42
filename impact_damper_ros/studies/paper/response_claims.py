"""The claims about Figure 3: restitution, angle, frequency and friction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from impact_damper_ros.rig import RigParameters

from .claim import (
    SMALL,
    Claim,
    Judgement,
    branch_of,
    excess_over,
    judged,
    least_ratio,
    range_text,
    stability_end,
    stable_ratios,
)
from .rigs import BASIC, OPERATIONS, Operation
from .series import Series

#: Gaps at which the restitutions are exchanged, m.
_SWAPPED_GAPS = (41.0, 45.0, 50.0, 55.0)
#: Gaps of Figure 3a from here on are away from the edge of stability, m.
_INNER_GAP = 41.0


def response_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about restitution, angle, frequency and friction."""
    pairs = {
        operation.key: (
            results[f'3a {operation.key} unequal'],
            results[f'3a {operation.key} equal'],
        )
        for operation in OPERATIONS
    }
    changes = {key: excess_over(*pair).values() for key, pair in pairs.items()}
    inner = {key: excess_over(*pair, above=_INNER_GAP).values() for key, pair in pairs.items()}
    values = [value for row in inner.values() for value in row]
    swapped = {operation.key: _swapped_changes(operation) for operation in OPERATIONS}
    unequal, equal = (branch_of(series)[50.0].ratio for series in pairs['horizontal'])
    signs = {min(row) >= 0.0 for row in (*inner.values(), *swapped.values())}
    yield Claim(
        '3a',
        'slightly different restitutions are detrimental, but insignificantly in practice',
        'R = 0.78, 0.72 (lower, upper stop) against 0.75, 0.75, change of Xmax/A over the common '
        'stable gaps: '
        + '; '.join(f'{key} {range_text(row)}' for key, row in changes.items())
        + f'; from {_INNER_GAP:g} m: '
        + '; '.join(f'{key} {range_text(row)}' for key, row in inner.items())
        + '; R = 0.72, 0.78 at '
        + ', '.join(f'{gap:g}' for gap in _SWAPPED_GAPS)
        + ' m: '
        + '; '.join(f'{key} {range_text(row)}' for key, row in swapped.items())
        + f'. At d = 50 m, horizontal, {equal:.5f} becomes {unequal:.5f}',
        judged(min(values) >= 0.0 and max(values) < SMALL and len(signs) == 1, Judgement.IN_PART),
        'detrimental on the level, and on the incline with the larger R at the upper stop; with '
        'the larger R at the lower stop it compensates gravity, and the change is a small gain. '
        f'Insignificant from {_INNER_GAP:g} m on; large at the edge of stability near 36 m',
    )
    yield _angle_claim(results['3b r=1'], results['3b r=1.02'])
    yield from _frequency_claims(results)
    branch = branch_of(results['3d'])
    ratios = {v: branch[v].ratio for v in (0.0, 0.1, 0.2, 0.5) if v in branch}
    yield Claim(
        '3d',
        'a large friction force has a significant effect; sliding friction should be kept low',
        'd = 50 m, r = 1, horizontal: Xmax/A '
        + ', '.join(f'{ratio:.4f} at γ = {v:g}' for v, ratio in ratios.items())
        + f'; stable up to γ = {stability_end(results["3d"]):.3f}',
        judged(ratios[max(ratios)] > 1.5 * ratios[0.0]),
    )
    yield Claim(
        '3d',
        'the friction force is largest in horizontal operation',
        'mγg cosθ: 1 at 0°, '
        + ', '.join(f'{math.cos(math.radians(v)):.3f} at {v}°' for v in (15, 45, 90))
        + ' of the force on the level',
        Judgement.REPRODUCED,
    )


def _swapped_changes(operation: Operation) -> list[float]:
    """Return the changes of Xmax/A where the upper stop has the larger restitution."""
    found = []
    for gap in _SWAPPED_GAPS:
        rig = operation.rig(BASIC, 2.0).replace(gap=gap)
        other = rig.replace(restitution_1=0.72, restitution_2=0.78)
        found.append(least_ratio(other) / least_ratio(rig) - 1.0)
    return [change for change in found if math.isfinite(change)]


def _angle_claim(*both: Series) -> Claim:
    texts, rises = [], []
    for series in both:
        branch = branch_of(series)
        shown = [angle for angle in (4.0, 5.0, 8.0, 10.0, 45.0) if angle in branch]
        rises.append({angle: branch[angle].ratio / branch[0.0].ratio - 1.0 for angle in shown})
        texts.append(
            f'{series.plan.name[3:]}: '
            + ', '.join(f'{rise:+.1%} at {angle:g}°' for angle, rise in rises[-1].items())
            + f', stable up to {stability_end(series):.2f}°'
        )
    at_one, above = rises
    elsewhere = {gap: [_rise(rate, gap) for rate in (1.0, 1.02)] for gap in _WIDER_GAPS}
    other_way = [f'{gap:g}' for gap, (one, off) in elsewhere.items() if not one > off]
    return Claim(
        '3b',
        'inclination is detrimental, and more so at r = 1 than at r = 1.02 (d = 37 m)',
        'rise of Xmax/A over its value at 0°: '
        + '; '.join(texts)
        + f'. At {_WIDER_ANGLE:g}° and other gaps, r = 1 and 1.02: '
        + ', '.join(
            f'{one:+.1%} and {off:+.1%} at {gap:g} m' for gap, (one, off) in elsewhere.items()
        ),
        judged(all(at_one[v] > above[v] > 0.0 for v in at_one if v <= 10.0 and v in above)),
        'at d = 37 m, the gap of the figure, near the edge of stability at r = 1; '
        + (f'the other way round at {", ".join(other_way)} m. ' if other_way else '')
        + 'Both motions lose stability near 12°',
    )


#: Gaps, m, and angle, degrees, at which the rise at r = 1 and 1.02 is compared besides.
_WIDER_GAPS, _WIDER_ANGLE = (41.0, 45.0, 50.0, 55.0), 10.0


def _rise(rate: float, gap: float) -> float:
    """Return the rise of Xmax/A of the basic rig at an angle over its value on the level."""
    rig = BASIC.replace(force_frequencies=(rate,), gap=gap)
    inclined = rig.replace(angle=math.radians(_WIDER_ANGLE))
    return least_ratio(inclined) / least_ratio(rig) - 1.0


def _frequency_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    level = results['3c θ=0°']
    base = stable_ratios(level)
    texts: list[str] = []
    small: list[bool] = []
    excesses: list[float] = []
    lost, nearest = 0, 0.0
    small_at: dict[bool, list[str]] = {True: [], False: []}
    for angle in (5, 10, 15):
        series = results[f'3c θ={angle}°']
        excess = excess_over(series, level)
        near = [e for v, e in excess.items() if v <= 1.005]
        far = [e for v, e in excess.items() if v > 1.005]
        small += [abs(e) < SMALL for e in excess.values()]
        excesses += excess.values()
        nearest = max([nearest, *near])
        small_at[max(far, default=math.inf) < SMALL].append(f'{angle}°')
        both = [v for v in series.plan.values if v in base]
        unstable = sum(v not in excess for v in both)
        lost += unstable
        texts.append(
            f'{angle}°: {range_text(near, 1)} up to Ω = 1.005, {range_text(far, 1)} above; not '
            f'stable at {unstable} of {len(both)} frequencies'
        )
    yield Claim(
        '3c',
        'for small inclination the effect is small, but detrimental',
        f'excess of Xmax/A over 0°, both stable, d = 37 m: {"; ".join(texts)}',
        judged(min(excesses, default=-1.0) >= 0.0 and all(small) and not lost, Judgement.IN_PART),
        'above Ω = 1.005 the excess is below 10 % at '
        f'{" and ".join(small_at[True]) or "no angle"}, not at '
        f'{" and ".join(small_at[False]) or "any"}; near r = 1 it is up to {nearest:.0%}. Where '
        f'the level rig has a stable motion the inclined one has none in {lost} cases',
    )
    yield _similar_claim()


#: Rigs above the resonance with which the effect of a small inclination is compared.
_OTHER_GAPS = (25.0, 30.0, 37.0, 45.0, 50.0, 55.0)
_OTHER_RIGS = {
    'R = 0.65': BASIC.replace(restitution_1=0.65, restitution_2=0.65),
    'R = 0.85': BASIC.replace(restitution_1=0.85, restitution_2=0.85),
    'm = 0.03 kg': BASIC.replace(damper_mass=0.03),
    'm = 0.06 kg': BASIC.replace(damper_mass=0.06),
    'C = 0.05 N s/m': BASIC.replace(damping=0.05),
    'F = 2 N': BASIC.replace(force_amplitudes=(2.0,)),
}
_OTHER_RATES = (1.01, 1.02, 1.04, 1.06, 1.08, 1.1)


def inclination_effects(rig: RigParameters, angles: Sequence[float]) -> dict[float, list[float]]:
    """
    Return the excess of Xmax/A at some angles, degrees, over the level, above the resonance.

    At each frequency at which the level rig has a stable motion with two impacts; NaN where the
    inclined one has none.
    """
    found: dict[float, list[float]] = {angle: [] for angle in angles}
    for rate in _OTHER_RATES:
        at_rate = rig.replace(force_frequencies=(rate,))
        level = least_ratio(at_rate)
        if math.isnan(level):
            continue
        for angle in angles:
            inclined = at_rate.replace(angle=math.radians(angle))
            found[angle].append(least_ratio(inclined) / level - 1.0)
    return found


def _similar_claim() -> Claim:
    angles = (5.0, 10.0, 15.0)
    rigs = {f'd = {gap:g} m': BASIC.replace(gap=gap) for gap in _OTHER_GAPS} | _OTHER_RIGS
    effects = {name: inclination_effects(rig, angles) for name, rig in rigs.items()}
    texts: list[str] = []
    similar: list[bool] = []
    gentle: list[float] = []
    for angle in angles:
        values = [value for effect in effects.values() for value in effect[angle]]
        known = [value for value in values if math.isfinite(value)]
        gentle = gentle or known
        similar += [math.isfinite(value) and 0.0 <= value < SMALL for value in values]
        texts.append(
            f'{angle:g}°: {range_text(known, 1)}, below 10 % in '
            f'{sum(0.0 <= value < SMALL for value in known)} of {len(values)} cases, not stable '
            f'in {len(values) - len(known)}'
        )
    steep = similar[len(similar) // len(angles) :]
    largest = {
        name: max((v for row in effect.values() for v in row if math.isfinite(v)), default=0.0)
        for name, effect in effects.items()
    }
    smaller = [
        name
        for name, effect in effects.items()
        if any(v < 0.0 for r in effect.values() for v in r)
    ]
    return Claim(
        '3c',
        'the effect is similar for other parameters with r > 1',
        f'excess of Xmax/A over 0° for {len(_OTHER_GAPS)} gaps of {_OTHER_GAPS[0]:g} to '
        f'{_OTHER_GAPS[-1]:g} m, and at 37 m {", ".join(_OTHER_RIGS)}, each at Ω = '
        f'{", ".join(f"{rate:g}" for rate in _OTHER_RATES)} where the level motion is stable: '
        + '; '.join(texts)
        + '. Largest: '
        + ', '.join(f'{value:+.1%} at {name}' for name, value in largest.items()),
        judged(
            all(similar),
            Judgement.IN_PART if sum(similar) > len(similar) / 2 else Judgement.NOT_REPRODUCED,
        ),
        'detrimental everywhere'
        + (f' but for {", ".join(smaller)}' if smaller else '')
        + f', but not similar in size: {range_text(gentle, 1)} at {angles[0]:g}°; at '
        f'{angles[1]:g}° and {angles[2]:g}° the excess is 10 % and more, or the motion is not '
        f'stable, in {steep.count(False)} of {len(steep)} cases',
    )
