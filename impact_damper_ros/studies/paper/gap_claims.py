"""The claims about Figure 2: displacements and ranges of stability over the gap."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from impact_damper_ros.orbits import find_orbits, plausible_stops

from .claim import Claim, Judgement, branch_of, excess_over, judged, range_text, stable_width
from .curves import Curve, Status
from .rigs import BASIC, OPERATIONS
from .series import Series

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
        judged(len(holds) == len(measures)),
        (f'it holds {" and ".join(holds)} only; ' if holds else '')
        + f'in metres {max(largest, key=largest.__getitem__)} loses most, as a share '
        + max(share, key=share.__getitem__),
    )
