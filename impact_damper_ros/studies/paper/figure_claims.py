"""The claims about the figures in section 3 of Bapat (1995), compared with computed numbers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise, takewhile

import numpy as np

from impact_damper_ros.orbits import find_orbits, plausible_stops
from impact_damper_ros.orbits.optimum import Limit, optimal_gap
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
    stable_width,
)
from .curves import Curve, SeriesPlan, Status
from .rigs import BASIC, OPERATIONS, Operation, scaled_rig
from .series import FIGURES, STRONG_FORCE, AngleOptimum, Series
from .theory_claims import agreement_claims, vertical_claims

# Figure 2: the gap


#: The horizontal motion is symmetric from this gap on, m.
_ONE_BRANCH = 25.0
_WORDS = {2: 'two', 3: 'three', 4: 'four'}


def _least_stable(series: Series, stops: tuple[int, ...]) -> dict[float, float]:
    """Return the least stable Xmax/A of a stop sequence at each value."""
    least: dict[float, float] = {}
    for curve in series.curves:
        for point in curve.points:
            if curve.stops == stops and point.status == Status.STABLE:
                least[point.value] = min(point.ratio, least.get(point.value, math.inf))
    return least


def _excesses(series: Series, level: Series, impacts: int) -> list[float]:
    """Return the excess of Xmax/A wherever one stop sequence is stable in both series."""
    sequences = {curve.stops for curve in series.of(impacts)}
    return [
        ratio / base[value] - 1.0
        for stops in sequences
        for base in [_least_stable(level, stops)]
        for value, ratio in _least_stable(series, stops).items()
        if value in base
    ]


def gap_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about displacements and ranges of stability over the gap."""
    level = results['2 horizontal']
    inner = math.inf
    rows: dict[int, list[str]] = {impacts: [] for impacts in _WORDS}
    least: dict[int, float] = dict.fromkeys(_WORDS, math.inf)
    for gravity in (1, 2):
        for operation in OPERATIONS[1:]:
            series = results[f'2 {operation.key} g={gravity}']
            for impacts in _WORDS:
                excess = _excesses(series, level, impacts)
                rows[impacts].append(
                    f'{operation.key} g = {gravity} '
                    + (f'{range_text(excess)} at {len(excess)} gaps' if excess else 'at no gap')
                )
                least[impacts] = min([least[impacts], *excess])
            inner = min([inner, *excess_over(series, level, above=_ONE_BRANCH).values()])
    at_37 = {name: branch_of(series).get(37.0) for name, series in results.items()}
    known = [f'{name[2:]} {point.ratio:.4f}' for name, point in at_37.items() if point is not None]
    smaller = [_WORDS[n] for n, value in least.items() if value < 0.0]
    yield Claim(
        '2',
        'gravity and friction are detrimental: the displacement is larger than that of the '
        'horizontal frictionless damper',
        'excess of Xmax/A where the same stop sequence is stable in both: '
        + '; '.join(f'{_WORDS[n]} impacts: {", ".join(row)}' for n, row in rows.items())
        + f'. Two impacts at gaps from {_ONE_BRANCH:g} m: at least {inner:+.2%}'
        + (f'. At d = 37 m: {", ".join(known)}' if known else ''),
        judged(not smaller, Judgement.IN_PART),
        f'two impacts: larger wherever the horizontal motion is symmetric; below about '
        f'{_ONE_BRANCH:g} m that motion is one of an asymmetric pair, and is larger itself at '
        'some gaps. Smaller somewhere with ' + ', '.join(smaller) + ' impacts'
        if smaller
        else '',
    )
    yield from range_claims(results)
    yield _least_claim(level)


def _least_claim(level: Series) -> Claim:
    """Judge which number of impacts reduces the displacement most, off and at the resonance."""
    lowest = {
        n: min(
            (p for c in level.of(n) for p in c.points if p.status == Status.STABLE),
            key=lambda point: point.ratio,
            default=None,
        )
        for n in _WORDS
    }
    texts = [
        f'{_WORDS[n]} impacts {point.ratio:.4f} at d = {point.value:.4g} m, spaced '
        + ' : '.join(f'{duration:.3f}' for duration in point.durations)
        for n, point in lowest.items()
        if point is not None
    ]
    settled = [mark for mark in level.marks if mark.stops and mark.cycles > 1]
    others = min((mark.ratio for mark in settled), default=math.inf)
    resonant = _least_at_resonance()
    two = lowest[2]
    return Claim(
        '2',
        'two equally spaced impacts per cycle reduce the displacement most (introduction)',
        f'smallest stable Xmax/A, horizontal, r = 1.02: {"; ".join(texts)}; settled runs of '
        f'longer periods {others:.4f}. At r = 1, gaps of {_RESONANT_GAPS[0]:g} to '
        f'{_RESONANT_GAPS[-1]:g} m in steps of {_RESONANT_GAPS[1] - _RESONANT_GAPS[0]:g} m: '
        + ', '.join(
            f'{_WORDS[n]} impacts ' + (f'{ratio:.4f}' if math.isfinite(ratio) else 'never stable')
            for n, ratio in resonant.items()
        ),
        judged(
            two is not None
            and max(abs(duration - 1.0) for duration in two.durations) < 1e-6
            and two.ratio < min(others, *(p.ratio for n, p in lowest.items() if p and n != 2))
            and resonant[2] == min(resonant.values()),
            Judgement.IN_PART,
        ),
        'among motions with up to four impacts in one cycle, and those that runs settle into',
    )


#: Gaps at which motions at the resonance are compared, m.
_RESONANT_GAPS = tuple(float(gap) for gap in np.arange(10.0, 59.0, 6.0))


def _least_at_resonance() -> dict[int, float]:
    """Return the least stable Xmax/A of each number of impacts of the basic rig."""
    return {
        impacts: min(
            (
                orbit.amplitude_ratio
                for gap in _RESONANT_GAPS
                for stops in plausible_stops(BASIC, impacts)
                for orbit in find_orbits(BASIC.replace(gap=gap), stops, simulate=False).orbits
                if orbit.stable and orbit.viable
            ),
            default=math.inf,
        )
        for impacts in _WORDS
    }


def _curves_of(series: Series, words: Collection[str], *, reversing: bool = True) -> list[Curve]:
    """Return the curves of some stop sequences."""
    return [
        curve
        for curve in series.curves
        if ''.join(map(str, curve.stops)) in words and (reversing or not curve.reverses)
    ]


#: The stop sequences of each number of impacts, counted from an impact on stop 1.
_SEQUENCES = {2: ('12',), 3: ('112', '122'), 4: ('1122', '1112', '1222')}


def range_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about ranges of stability, by stop sequence and by number of impacts."""

    def widths(words: Collection[str], *, reversing: bool = True) -> dict[str, float]:
        return {
            name[2:]: stable_width(_curves_of(series, words, reversing=reversing))
            for name, series in results.items()
        }

    def lost(row: Mapping[str, float]) -> list[float]:
        return [row['horizontal'] - width for name, width in row.items() if name != 'horizontal']

    def text(rows: Mapping[str, Mapping[str, float]]) -> str:
        return '; '.join(
            f'{key}: ' + ', '.join(f'{name} {width:.2f}' for name, width in row.items())
            for key, row in rows.items()
        )

    each = {word: widths((word,)) for words in _SEQUENCES.values() for word in words}
    all_of = {_WORDS[n]: widths(words) for n, words in _SEQUENCES.items()}
    by_stops = [loss > 0.0 for row in each.values() for loss in lost(row)]
    by_number = [loss > 0.0 for row in all_of.values() for loss in lost(row)]
    mostly = [2 * sum(smaller) > len(smaller) for smaller in (by_stops, by_number)]
    yield Claim(
        '2',
        'gravity and friction reduce the ranges of stability in most cases',
        f'width in gap [m] over which a motion is stable, by stop sequence: {text(each)}; smaller '
        f'than horizontal in {sum(by_stops)} of {len(by_stops)}. By the number of impacts, '
        f'whichever the stops: {text({k: v for k, v in all_of.items() if k != "two"})}; smaller, '
        f'with two impacts, in {sum(by_number)} of {len(by_number)}',
        judged(all(mostly), Judgement.IN_PART if any(mostly) else Judgement.NOT_REPRODUCED),
        'on the incline, two impacts below and one above (112) gain what 122 loses, and three '
        'below and one above (1112) what 1222 loses',
    )
    largest = {word: max(lost(row)) for word, row in each.items()}
    share = {word: largest[word] / max(each[word]['horizontal'], 1e-9) for word in each}
    together = {word: max(lost(row)) for word, row in all_of.items()}
    parts = {word: together[word] / max(all_of[word]['horizontal'], 1e-9) for word in all_of}
    smooth = widths(('12',), reversing=False)
    kept = max(lost(smooth))
    measures = {
        'in metres, by stop sequence': largest['12'] == max(largest.values()),
        'as a share of the range, by stop sequence': share['12'] == max(share.values()),
        'in metres, by the number of impacts': together['two'] == max(together.values()),
        'as a share, by the number of impacts': parts['two'] == max(parts.values()),
    }
    holds = [measure for measure, is_so in measures.items() if is_so]
    yield Claim(
        '2',
        'the largest reduction of a range of stability is that of two impacts per cycle',
        'largest loss of width (negative: a gain) by stop sequence: '
        + ', '.join(f'{word} {largest[word]:.2f} m ({share[word]:.0%})' for word in each)
        + '; by the number of impacts: '
        + ', '.join(f'{word} {together[word]:.2f} m ({parts[word]:.0%})' for word in all_of)
        + f'. 12 without motions that reverse between the stops, as in the paper: {kept:.2f} m '
        f'({kept / smooth["horizontal"]:.0%})',
        judged(
            len(holds) == len(measures),
            Judgement.IN_PART if holds else Judgement.NOT_REPRODUCED,
        ),
        (f'it holds {" and ".join(holds)} only; ' if holds else '')
        + f'in metres {max(largest, key=largest.__getitem__)} loses most, as a share '
        + max(share, key=share.__getitem__),
    )


# Figure 3: restitution, angle, frequency and friction


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
    yield from _input_frequency_claims(results)
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


def _input_frequency_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
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


# Figure 4: the natural frequency


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


# Figure 5: the optimal gap over the angle


def optimum_claims(points: Sequence[AngleOptimum]) -> Iterator[Claim]:
    """Judge the claims about the optimal gap over the angle."""
    start = points[0].best
    shift = max(abs(p.best.gap / start.gap - 1.0) for p in points if p.angle <= 15.0)
    shown = [p for p in points if p.angle in (0.0, 5.0, 10.0, 15.0, 30.0, 45.0, 90.0)]
    edges = [f'{p.angle:g}°' for p in points if p.best.limit is not Limit.MINIMUM]
    yield Claim(
        '5a',
        'for small angles the optimal gap is nearly that of the horizontal damper',
        'optimal gap [m]: '
        + ', '.join(f'{p.best.gap:.3f} at {p.angle:g}°' for p in shown)
        + f'; changes by at most {shift:.2%} up to 15°; a minimum inside the stable range at '
        f'{len(points) - len(edges)} angles of {len(points)}'
        + (f', at the edge of stability at {", ".join(edges)}' if edges else ''),
        judged(shift < 0.02),
    )
    ratios = [p.best.orbit.amplitude_ratio for p in points]
    yield Claim(
        '5b',
        'gravity makes the displacement at the optimal gap larger',
        'Xmax/A: '
        + ', '.join(f'{p.best.orbit.amplitude_ratio:.5f} at {p.angle:g}°' for p in shown),
        judged(min(ratios) == ratios[0] and ratios[-1] > ratios[0]),
    )


# Figure 6: compressed air


def air_claims(results: Mapping[str, Series]) -> Iterator[Claim]:
    """Judge the claims about compressed air."""
    net, own, gains = [], [], []
    ends: dict[str, float] = {}
    largest: dict[str, tuple[float, float]] = {}
    by_gap: dict[str, bool] = {}
    for series in (results['6 r=1'], results['6 r=1.02']):
        name, ratios = series.plan.name[2:], stable_ratios(series)
        without, free = ratios[0.0], branch_of(series)[1.0].ratio
        near = {v: ratio / free - 1.0 for v, ratio in ratios.items() if 0.5 <= v <= 1.5}
        small = {v: ratio / without - 1.0 for v, ratio in ratios.items() if v <= 0.5}
        largest[name] = max(abs(v) for v in near.values()), max(abs(v) for v in small.values())
        net.append(
            f'{name}: {free:.4f} without net force (p = mγg), {near[0.5]:+.1%} at p = 0.5 mγg, '
            f'{range_text(list(near.values()), 1)} from 0.5 to 1.5 mγg, '
            f'{branch_of(series)[2.0].ratio / free - 1.0:+.1%} at 2 mγg'
        )
        own.append(f'{name}: {without:.4f} without air, {small[0.5]:+.1%} at p = 0.5 mγg')
        ends[name] = stability_end(series)
        best = min(ratios, key=ratios.__getitem__)
        tuned = optimal_gap(series.plan.at(0.0), gaps=_TUNED_GAPS, points=24, tolerance=1e-5)
        by_gap[name] = tuned.orbit.amplitude_ratio < 1.05 * ratios[best]
        gains.append(
            f'{name}: {ratios[best]:.4f} at p = {best:.3g} mγg, {ratios[best] / free - 1.0:+.1%} '
            f'against the frictionless rig without air, {ratios[best] / without - 1.0:+.1%} '
            f'against this rig without air; {tuned.orbit.amplitude_ratio:.4f} with the best gap '
            f'({tuned.gap:.1f} m) and no air'
        )
    yield Claim(
        '6',
        'a small force of compressed air has an insignificant effect (γ = 0.5, horizontal)',
        f'Xmax/A, net force p − mγg small: {"; ".join(net)}. Air force p itself small: '
        + '; '.join(own),
        judged(
            all(value < SMALL for pair in largest.values() for value in pair),
            Judgement.IN_PART
            if any(value < SMALL for pair in largest.values() for value in pair)
            else Judgement.NOT_REPRODUCED,
        ),
        'Fᵢ = 2mgᵢ is read as an air force p that is twice the net force mgᵢ on m, hence '
        'p = 2mγg; ' + _insignificant(largest),
    )
    yield Claim(
        '6',
        'at a large force the motion becomes unstable',
        '; '.join(f'{name}: stable up to p = {end:.3f} mγg' for name, end in ends.items()),
        judged(all(math.isfinite(end) and end < 5.5 for end in ends.values())),
        'the motion with two impacts per cycle',
    )
    yield Claim(
        '6',
        'compressed air is not promising in practice',
        f'least stable Xmax/A with any air force: {"; ".join(gains)}',
        judged(all(by_gap.values()), Judgement.IN_PART),
        'the air recovers what friction costs and little more; the best gap without air does as '
        f'well at {_names(by_gap, True)}, but not at {_names(by_gap, False)}, where no gap '
        'reduces the displacement as much as air does, as long as friction is there',
    )


#: Gaps among which the best one without air is sought, m.
_TUNED_GAPS = (12.0, 64.0)


def _names(holds: Mapping[str, bool], wanted: bool) -> str:
    """Return the names for which something holds, or does not."""
    return ' and '.join(name for name, is_so in holds.items() if is_so is wanted) or 'none'


def _insignificant(largest: Mapping[str, tuple[float, float]]) -> str:
    """Say where small forces change the displacement by less than what counts as small."""
    parts = []
    for what, i in (('a net force of up to 0.5 mγg', 0), ('an air force p of up to 0.5 mγg', 1)):
        fit = [name for name, pair in largest.items() if pair[i] < SMALL]
        where = 'at ' + ' and '.join(fit) if fit else 'nowhere'
        parts.append(f'{what} is insignificant (below 10 %) {where}')
    return '; '.join(parts)


# All of them


_JUDGES = {
    '2': gap_claims,
    '3': response_claims,
    '4': frequency_claims,
    '6': air_claims,
}


def claims_of(
    figure: str, results: Mapping[str, Series], optima: Sequence[AngleOptimum]
) -> list[Claim]:
    """Return the judged claims about one figure; those about Figure 5 need its optima."""
    if figure == '5':
        return list(optimum_claims(optima))
    own = {name: series for name, series in results.items() if name[0] == figure}
    return list(_JUDGES[figure](own))


def all_claims(results: Mapping[str, Series], optima: Sequence[AngleOptimum]) -> list[Claim]:
    """Judge all claims."""
    by_figure = [claim for figure in FIGURES for claim in claims_of(figure, results, optima)]
    return [*agreement_claims(results), *by_figure, *vertical_claims()]
