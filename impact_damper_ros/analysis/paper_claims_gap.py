"""The claims about Figure 2, and about agreement with simulation and earlier results."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig.mode import make_machine

from .paper_claims import (
    Claim,
    Verdict,
    branch,
    judged,
    series_claims,
    stable_excess,
    stable_width,
)
from .paper_closed_forms import heavy_table_range, symmetric_displacements, vertical_range
from .paper_plan import Series
from .paper_rigs import BASIC, CASES, VERTICAL
from .paper_settled import TOLERANCE, disturbed, settle
from .paper_sweep import Status

__all__ = ['agreement_claims', 'gap_claims', 'vertical_claims']

#: Gaps, m, at which the horizontal motion is symmetric.
_ONE_BRANCH = 25.0
_WORDS = {2: 'two', 3: 'three', 4: 'four'}


def agreement_claims(results: Mapping[str, Series]) -> list[Claim]:
    """
    Judge the claims of agreement.

    Parameters
    ----------
    results : mapping of str to Series
        All series computed.
    """
    worst, count = 0.0, 0
    for rate in (1.0, 1.02):
        for gap in np.arange(24.0, 56.1, 4.0):
            rig = BASIC.replace(gap=float(gap), force_frequencies=(rate,))
            found = [o.x[0] for o in find_orbits(rig, (1, 2), simulate=False).orbits]
            for x in symmetric_displacements(rig):
                worst = max(worst, min(abs(x - other) / abs(x) for other in found))
                count += 1
    claims = [
        Claim(
            'text',
            'the theory of the horizontal damper agrees with earlier results',
            f'symmetric motion in closed form (a quadratic, derived apart) against the general '
            f'solver: {count} motions at r = 1 and 1.02, d = 24 to 56 m, X at the impacts equal '
            f'to {worst:.0e}',
            judged(worst < 1e-9),
        )
    ]
    motions, times, ratios = series_claims(results)
    claims.append(
        Claim(
            'all',
            'theory and simulation agree well, with incline, friction and unequal restitution',
            f'{motions} settled periodic motions of the simulator in the figures: durations equal '
            f'to {times:.0e} half-cycles (runs stop when they repeat to {TOLERANCE:.0e}), largest '
            f'displacements to {ratios:.0e} (sampled 240 times per cycle)',
            judged(times < 1e-6 and ratios < 1e-4),
        )
    )
    return claims


def _widths(
    results: Mapping[str, Series], stops: str, *, reversing: bool = True
) -> dict[str, float]:
    """Return the width of the stable gaps of one stop sequence in each series, m."""
    mirrored = stops.translate({ord('1'): '2', ord('2'): '1'})

    def turns(word: str) -> set[str]:
        return {word[i:] + word[:i] for i in range(len(word))}

    # On the level a motion and its mirror image are equally stable, and one stands for both
    both = turns(stops) | turns(mirrored)
    return {
        name[2:]: stable_width(
            [
                curve
                for curve in series.curves
                if ''.join(map(str, curve.stops))
                in (both if name == '2 horizontal' else turns(stops))
                and (reversing or not curve.reverses)
            ]
        )
        for name, series in results.items()
        if name.startswith('2 ')
    }


def gap_claims(results: Mapping[str, Series]) -> list[Claim]:
    """
    Judge the claims about Figure 2.

    Parameters
    ----------
    results : mapping of str to Series
        The series of Figure 2, by name.
    """
    level = results['2 horizontal']
    words, least, inner = [], np.inf, np.inf
    for gravity in (1, 2):
        for case in CASES[1:]:
            series = results[f'2 {case.key} g={gravity}']
            low, high, count = stable_excess(series, level)
            words.append(f'{case.key} g = {gravity}: {low:+.2%} to {high:+.2%} at {count} gaps')
            least = min(least, low)
            inner = min(inner, stable_excess(series, level, above=_ONE_BRANCH)[0])
    at_37 = (
        ', '.join(
            f'{name} {next(p.ratio for p in branch(results[name]) if p.value == 37.0):.4f}'
            for name in results
            if name.startswith('2 ')
        )
        if all(37.0 in s.sweep.values for s in results.values() if s.sweep.name[:2] == '2 ')
        else ''
    )
    claims = [
        Claim(
            '2',
            'gravity and friction are detrimental: the displacement is larger than that of the '
            'horizontal frictionless damper',
            'two impacts per cycle, excess of Xmax/A where both are stable: '
            + '; '.join(words)
            + f'; at gaps from {_ONE_BRANCH:g} m at least {inner:+.2%}'
            + (f'. At d = 37 m: {at_37}' if at_37 else ''),
            judged(least >= 0.0, Verdict.OTHER_NUMBER),
            ''
            if least >= 0.0
            else f'larger wherever the horizontal motion is the symmetric one; below about '
            f'{_ONE_BRANCH:g} m it is one of a lopsided pair, and larger itself',
        )
    ]
    claims += _range_claims(results)
    lowest = {
        n: min(
            (p.ratio for c in level.of(n) for p in c.points if p.status == Status.STABLE),
            default=np.inf,
        )
        for n in _WORDS
    }
    claims.append(
        Claim(
            '2',
            'two equally spaced impacts per cycle reduce the displacement most (introduction)',
            'smallest stable Xmax/A, horizontal: '
            + ', '.join(f'{_WORDS[n]} impacts {v:.4f}' for n, v in lowest.items()),
            judged(lowest[2] == min(lowest.values())),
        )
    )
    return claims


def _range_claims(results: Mapping[str, Series]) -> list[Claim]:
    """Judge the claims about ranges of stability, by stop sequence."""
    widths = {stops: _widths(results, stops) for stops in ('12', '112', '122', '1122')}
    lost = {
        (stops, name): row['horizontal'] - width
        for stops, row in widths.items()
        for name, width in row.items()
        if name != 'horizontal'
    }
    table = '; '.join(
        f'stops {stops}: ' + ', '.join(f'{name} {width:.2f}' for name, width in row.items())
        for stops, row in widths.items()
    )
    fewer = sum(value > 0.0 for value in lost.values())
    smooth = _widths(results, '12', reversing=False)
    kept = smooth['horizontal'] - min(smooth.values())
    most = {stops: max(v for (s, _), v in lost.items() if s == stops) for stops in widths}
    share = {s: most[s] / max(widths[s]['horizontal'], 1e-9) for s in widths}
    return [
        Claim(
            '2',
            'gravity and friction reduce the ranges of stability in most cases',
            f'width in gap [m] over which a motion is stable: {table}; smaller than horizontal '
            f'in {fewer} of {len(lost)}',
            judged(fewer > len(lost) / 2),
            'on the incline, two impacts below and one above (112) gain what 122 loses',
        ),
        Claim(
            '2',
            'the largest reduction of a range of stability is that of two impacts per cycle',
            'largest loss of width: '
            + ', '.join(f'{s} {most[s]:.2f} m ({share[s]:.0%})' for s in widths)
            + f'; 12 without motions that reverse between the stops, as in the paper, '
            f'{kept:.2f} m '
            f'({kept / smooth["horizontal"]:.0%})',
            Verdict.OTHER_NUMBER
            if kept > max(most['112'], most['1122'])
            else Verdict.NOT_REPRODUCED,
            'true in metres, of the motions that the paper can follow, for the sequences 12, 112 '
            'and 1122; in proportion, and for 122, three and four impacts lose far more',
        ),
    ]


def vertical_claims() -> list[Claim]:
    """Judge the claims about the vertical rig with one stop, and the platform on springs."""
    low, high = vertical_range()
    heavy = heavy_table_range(VERTICAL.restitution_1)
    close = abs(low - 0.45) < 0.005 and abs(high - 1.12) < 0.005
    rate = VERTICAL.force_frequencies[0]
    rig = VERTICAL.replace(gravity=VERTICAL.response_amplitude * rate**2 / 0.8)
    orbit = find_orbits(rig, (1,), simulate=False).orbits[0]
    settled = settle(disturbed(orbit, 1e-3))
    ratio = make_machine(rig).mass_ratio
    return [
        Claim(
            'text',
            'vertical, one stop (Ω = 10 rad/s, μ = 0.01, R = 0.75): one impact per cycle is '
            'stable for 0.45 < AΩ²/g < 1.12',
            f'ends by bisection of the solver: {low:.4f} and {high:.4f}',
            judged(close, Verdict.OTHER_NUMBER),
            '' if close else f'the upper end is {high:.3f}; the lower one rounds to 0.45',
        ),
        Claim(
            'text',
            'this range agrees with earlier results for a table too heavy to notice the ball',
            f'heavy-table range π(1−R)/(1+R) to its flip: {heavy[0]:.4f} to {heavy[1]:.4f}; '
            f'the ends differ by {low / heavy[0] - 1:+.1%} and {high / heavy[1] - 1:+.1%}, the '
            f'order of the mass ratio {ratio:g}',
            judged(abs(low / heavy[0] - 1.0) < 0.03 and abs(high / heavy[1] - 1.0) < 0.03),
        ),
        Claim(
            'text',
            'a mass on a platform on springs is a case of the general theory (conclusions)',
            f'one-sided rig at AΩ²/g = 0.8: solver and settled simulation ({settled.cycles} '
            f'cycle, {len(settled.stops)} impact) have Xmax/A = {orbit.amplitude_ratio:.8f} and '
            f'{settled.ratio:.8f}',
            judged(abs(settled.ratio / orbit.amplitude_ratio - 1.0) < 1e-5),
        ),
    ]
